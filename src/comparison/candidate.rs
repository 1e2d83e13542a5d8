//! One of several results: what of it bears a comparison.

use super::criteria::Criteria;
use crate::store::{DataFile, KeptParameter, ResultFolder};
use nalgebra::DMatrix;
use serde::Serialize;
use serde_json::Value;

/// A result as others are compared with it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Candidate {
    /// The name of its folder.
    pub name: String,
    /// The name of its model.
    pub model: String,
    /// The cost at its end: minus the logarithm of the likelihood but for a constant of data and noise.
    pub cost: Option<f64>,
    /// Parameters that were estimated and are determined, those of each run counted for each.
    pub unknowns: usize,
    /// Measured values that were compared.
    pub samples: usize,
    /// Mean ratio of the variances of its estimates, corrected for the colour of the residuals, to those under white noise.
    pub inflation: Option<f64>,
    /// Parameters, with both errors.
    pub parameters: Vec<KeptParameter>,
    /// Outputs of the fitted runs as `fit` describes them.
    pub outputs: Value,
    /// What the costs say; none where they cannot be compared with those of the first result.
    pub criteria: Option<Criteria>,
    /// Why they cannot.
    pub incomparable: Option<String>,
    #[serde(skip)]
    basis: Basis,
}

/// What has to agree for costs to be compared.
#[derive(Debug, Clone, PartialEq, Default)]
struct Basis {
    data: Vec<DataFile>,
    reading: String,
    noise: String,
    /// Names of the options: those of one method.
    method: Vec<String>,
    outputs: Vec<(String, String, u64)>,
}

impl Candidate {
    /// From a folder.
    pub fn new(folder: &ResultFolder) -> Self {
        let (manifest, result) = (folder.manifest(), folder.result());
        let name = folder.folder().file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let outputs = result["outputs"].as_array().cloned().unwrap_or_default();
        let cell = |o: &Value| {
            let text = |key: &str| o[key].as_str().unwrap_or_default().to_string();
            (text("name"), text("run"), o["compared"].as_u64().unwrap_or(0))
        };
        let outputs: Vec<(String, String, u64)> = outputs.iter().map(cell).collect();
        let covered = result["covariance"]["parameters"].as_array().map_or(0, Vec::len);
        let ended = result["termination"].as_str() == Some("converged");
        let said = result["message"].as_str().unwrap_or("it did not end at a minimum");
        Self {
            name: if name.is_empty() { folder.folder().display().to_string() } else { name },
            model: manifest.model.clone(),
            cost: result["cost"].as_f64(),
            unknowns: covered,
            samples: outputs.iter().map(|(_, _, n)| *n as usize).sum(),
            inflation: inflation(result),
            parameters: folder.parameters().to_vec(),
            outputs: result["outputs"].clone(),
            criteria: None,
            incomparable: (!ended).then(|| format!("its cost is no minimum: {said}")),
            basis: Basis {
                data: manifest.data.clone(),
                reading: format!("{:?}", manifest.reading),
                noise: format!("{:?}", manifest.noise),
                method: manifest.identity.options(),
                outputs,
            },
        }
    }

    /// Why its cost cannot be compared with that of `first`; none when it can.
    pub(super) fn differs_from(&self, first: &Self) -> Option<String> {
        let (own, other) = (&self.basis, &first.basis);
        let same_data = own.data.len() == other.data.len()
            && own.data.iter().zip(&other.data).all(|(a, b)| a.is_same(b))
            && own.reading == other.reading;
        let name = &first.name;
        if let Some(reason) = &first.incomparable {
            return Some(format!("nothing to compare it with: {name}: {reason}"));
        }
        if !same_data {
            return Some(format!("it was not fitted to the data of {name}"));
        }
        if own.method != other.method {
            return Some(format!("it was fitted by another method than {name}"));
        }
        if own.outputs != other.outputs {
            return Some(format!("it has not the outputs of {name}, sample by sample"));
        }
        if own.noise != other.noise {
            return Some(format!("it assumes another noise than {name}"));
        }
        self.cost.is_none().then(|| "it has no cost".to_string())
    }
}

/// tr(C^-1 V)/p for the covariances C under white noise and V, corrected for colour (p parameters): what a quadratic cost exceeds its
/// share under white noise by, on average (Takeuchi).
fn inflation(result: &Value) -> Option<f64> {
    let matrix = |key: &str| -> Option<DMatrix<f64>> {
        let rows = result[key]["values"].as_array()?;
        let row = |r: &Value| r.as_array()?.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>();
        let rows = rows.iter().map(row).collect::<Option<Vec<_>>>()?;
        let size = rows.len();
        (size > 0 && rows.iter().all(|r| r.len() == size)).then(|| DMatrix::from_fn(size, size, |i, j| rows[i][j]))
    };
    let (white, coloured) = (matrix("covariance")?, matrix("corrected_covariance")?);
    let size = white.nrows();
    // parameters differ by many orders of magnitude: both in units of the errors
    let error: Vec<f64> = (0..size).map(|k| white[(k, k)].sqrt()).collect();
    let scaled = |m: &DMatrix<f64>| DMatrix::from_fn(size, size, |i, j| m[(i, j)] / (error[i] * error[j]));
    let factor = scaled(&white).cholesky()?;
    let ratio = factor.solve(&scaled(&coloured)).trace() / size as f64;
    (ratio.is_finite() && ratio > 0.0).then_some(ratio)
}

/// Results whose folders share a name are numbered.
pub(super) fn tell_apart(candidates: &mut [Candidate]) {
    let names: Vec<String> = candidates.iter().map(|c| c.name.clone()).collect();
    for (k, candidate) in candidates.iter_mut().enumerate() {
        if names.iter().filter(|n| **n == names[k]).count() > 1 {
            candidate.name = format!("{}#{}", names[k], 1 + names[..k].iter().filter(|n| **n == names[k]).count());
        }
    }
}
