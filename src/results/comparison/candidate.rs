//! One of several results: what of it bears a comparison.

use super::criteria::Criteria;
use crate::documents::{FitDocument, KeptParameter, Matrix, OutputDocument, Terminated};
use crate::store::{DataFile, ResultFolder};
use fdm_estimate::Noise;
use fdm_system::record::ReadOptions;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// A result as others are compared with it.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
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
    /// Outputs of the fitted runs; none of regressions.
    pub outputs: Option<Vec<OutputDocument>>,
    /// What the costs say; none where they cannot be compared with those of the first result.
    pub criteria: Option<Criteria>,
    /// Why they cannot.
    pub incomparable: Option<String>,
    /// What was assumed about its records, one sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub assumed: Vec<String>,
    #[serde(skip)]
    basis: Basis,
}

/// What has to agree for costs to be compared.
#[derive(Debug, Clone, PartialEq, Default)]
struct Basis {
    data: Vec<DataFile>,
    reading: ReadOptions,
    noise: Noise,
    /// Names of the options: those of one method.
    method: Vec<String>,
    outputs: Vec<(String, String, usize)>,
}

impl Candidate {
    /// From a folder.
    pub fn new(folder: &ResultFolder) -> Self {
        let (manifest, fit) = (folder.manifest(), folder.result().fit());
        let name = folder.folder().file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let cell = |o: &OutputDocument| (o.name.clone(), o.run.clone(), o.compared);
        let outputs: Vec<_> = fit.iter().flat_map(|fit| &fit.outputs).map(cell).collect();
        let ended = fit.is_some_and(|fit| fit.termination == Terminated::Converged);
        let said = fit.map_or("it did not end at a minimum", |fit| &fit.message);
        Self {
            name: if name.is_empty() { folder.folder().display().to_string() } else { name },
            model: manifest.model.clone(),
            cost: fit.and_then(|fit| fit.cost),
            unknowns: fit.map_or(0, |fit| fit.covariance.parameters.len()),
            samples: outputs.iter().map(|(_, _, n)| n).sum(),
            inflation: fit.and_then(inflation),
            parameters: folder.parameters().to_vec(),
            outputs: fit.map(|fit| fit.outputs.clone()),
            criteria: None,
            assumed: assumed(folder),
            incomparable: (!ended).then(|| format!("its cost is no minimum: {said}")),
            basis: Basis {
                data: manifest.data.clone(),
                reading: manifest.reading.clone(),
                noise: manifest.noise.clone(),
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
fn inflation(fit: &FitDocument) -> Option<f64> {
    let matrix = |m: &Matrix| -> Option<DMatrix<f64>> {
        let (rows, size) = (&m.values, m.values.len());
        let known = size > 0 && rows.iter().all(|r| r.len() == size && r.iter().all(|v| !v.is_nan()));
        known.then(|| DMatrix::from_fn(size, size, |i, j| rows[i][j]))
    };
    let (white, coloured) = (matrix(&fit.covariance)?, matrix(&fit.corrected_covariance)?);
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

/// What was assumed about the records of a result, with the run.
fn assumed(folder: &ResultFolder) -> Vec<String> {
    let records = folder.result().records().into_iter().flat_map(|r| &r.assumed);
    records.flat_map(|r| r.assumed.iter().map(|sentence| format!("run `{}`: {sentence}", r.run))).collect()
}
