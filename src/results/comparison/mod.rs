//! Several results side by side: which model the data prefer, and which predicts validation data best.
//!
//! **In** results that were written ([`ResultFolder`]) and runs that none of them was fitted to. **Out**
//! [`Comparison`]: criteria where the costs are of the same data, tests of models of which one holds the other, predictions and whether
//! their differences could be chance. **Never** compares what cannot be compared: it says why. **Start** at [`compare`];
//! `candidate` (a result) -> `criteria` -> `nesting` -> `prediction` -> `averaging`.
//!
//! A model that holds another: whether its further parameters gain more than chance would.
//!
//! One of several results: what of it bears a comparison.

use crate::documents::{FitDocument, KeptParameter, Matrix, OutputDocument, Terminated};
use crate::store::{DataFile, ResultFolder};
use fdm_estimate::{Noise, Status};
use fdm_numeric::statistics::f_tail;
use fdm_system::record::ReadOptions;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

mod averaging;

pub use averaging::{Averaged, AveragedOutput, AveragedParameter, Criteria, Edge, Prediction, WeightedBy, predict};

/// What can be said of several results.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Comparison {
    /// The results, in the order in which they were given.
    pub candidates: Vec<Candidate>,
    /// By how much the scatter of estimates exceeds that under white noise: the mean ratio of their variances in the richest of the
    /// models that are comparable; none where no colour is known. Differences of costs are worth that much less.
    pub inflation: Option<f64>,
    /// Pairs of models of which one seems to hold the other.
    pub nestings: Vec<Nesting>,
    /// What each predicts of the validation runs, in the order of the results; empty without such runs.
    pub predictions: Vec<Prediction>,
    /// Squared residuals of the best prediction beside those of the others.
    pub edges: Vec<Edge>,
    /// Parameters and predictions averaged over the models; none where nothing determines their weights.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub averaged: Option<Averaged>,
}

/// Compares results; the first is what the others are measured by.
pub fn compare(mut candidates: Vec<Candidate>) -> Comparison {
    tell_apart(&mut candidates);
    for k in 1..candidates.len() {
        candidates[k].incomparable = candidates[k].incomparable.take().or(candidates[k].differs_from(&candidates[0]));
    }
    let inflation = averaging::judge(&mut candidates);
    let nestings = nestings(&candidates, inflation);
    let averaged = Averaged::of(&candidates, &[], inflation);
    Comparison { candidates, inflation, nestings, predictions: Vec::new(), edges: Vec::new(), averaged }
}

impl Comparison {
    /// Adds what was predicted of validation runs, in the order of the results.
    pub fn with_predictions(mut self, predictions: Vec<Prediction>) -> Self {
        self.edges = averaging::edges(&predictions);
        self.averaged = Averaged::of(&self.candidates, &predictions, self.inflation);
        self.predictions = predictions;
        self
    }
}

#[cfg(test)]
mod tests;

/// Two results of which the richer seems to hold the poorer: it estimates every parameter that the other estimates, and more.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Nesting {
    /// Name of the poorer result.
    pub poorer: String,
    /// Name of the richer result.
    pub richer: String,
    /// Number of further parameters.
    pub further: usize,
    /// Twice the difference of the costs; below zero when the richer fit missed the minimum that the poorer found.
    pub likelihood_ratio: f64,
    /// The F statistic for that, over the inflation by coloured residuals.
    pub f: f64,
    /// Its degrees of freedom: further parameters, and independent samples less parameters.
    pub degrees: (f64, f64),
    /// Probability of a larger one, were the further parameters at the values that the poorer model gives them.
    pub p_value: f64,
}

/// All pairs, the richer behind the poorer. Models are not asked whether they are nested, only the names of what they estimate.
fn nestings(candidates: &[Candidate], inflation: Option<f64>) -> Vec<Nesting> {
    let comparable: Vec<&Candidate> = candidates.iter().filter(|c| c.criteria.is_some()).collect();
    let mut found = Vec::new();
    for poorer in &comparable {
        for richer in &comparable {
            found.extend(nesting(poorer, richer, inflation.unwrap_or(1.0)));
        }
    }
    found
}

fn estimated(candidate: &Candidate) -> impl Iterator<Item = (&str, Option<&str>)> {
    let free = candidate.parameters.iter().filter(|p| p.status == Status::Estimated);
    free.map(|p| (p.name.as_str(), p.run.as_deref()))
}

fn nesting(poorer: &Candidate, richer: &Candidate, inflation: f64) -> Option<Nesting> {
    let known: Vec<_> = estimated(richer).collect();
    if richer.unknowns <= poorer.unknowns || !estimated(poorer).all(|p| known.contains(&p)) {
        return None;
    }
    let further = richer.unknowns - poorer.unknowns;
    let likelihood_ratio = 2.0 * (poorer.cost? - richer.cost?);
    let samples = richer.samples as f64;
    let left = (samples / inflation - richer.unknowns as f64).max(1.0);
    // of one output with estimated noise, exp(ratio/N) is the ratio of the sums of squares, and F is that of regression
    let gained = (likelihood_ratio / samples).exp_m1() * (samples - richer.unknowns as f64).max(1.0);
    let f = gained.max(0.0) / further as f64 / inflation;
    let p_value = f_tail(f, [further as f64, left])?;
    let (poorer, richer) = (poorer.name.clone(), richer.name.clone());
    Some(Nesting { poorer, richer, further, likelihood_ratio, f, degrees: (further as f64, left), p_value })
}

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
    fn differs_from(&self, first: &Self) -> Option<String> {
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
fn tell_apart(candidates: &mut [Candidate]) {
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
    records.flat_map(|r| r.sentences().into_iter().map(|s| format!("run `{}`: {s}", r.run))).collect()
}
