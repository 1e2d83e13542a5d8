//! Several results side by side: which model the data prefer, and which predicts validation data best.
//!
//! **In** results that were written ([`ResultFolder`](crate::store::ResultFolder)) and runs that none of them was fitted to. **Out**
//! [`Comparison`]: criteria where the costs are of the same data, tests of models of which one holds the other, predictions and whether
//! their differences could be chance. **Never** compares what cannot be compared: it says why. **Start** at [`compare`];
//! `candidate` (a result) -> `criteria` -> `nesting` -> `prediction` -> `averaging`.

mod averaging;
mod candidate;
mod criteria;
mod nesting;
mod prediction;

pub use averaging::{Averaged, AveragedOutput, AveragedParameter, WeightedBy};
pub use candidate::Candidate;
pub use criteria::Criteria;
pub use nesting::Nesting;
pub use prediction::{Edge, Prediction, predict};

use serde::{Deserialize, Serialize};

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
    candidate::tell_apart(&mut candidates);
    for k in 1..candidates.len() {
        candidates[k].incomparable = candidates[k].incomparable.take().or(candidates[k].differs_from(&candidates[0]));
    }
    let inflation = criteria::judge(&mut candidates);
    let nestings = nesting::nestings(&candidates, inflation);
    let averaged = Averaged::of(&candidates, &[], inflation);
    Comparison { candidates, inflation, nestings, predictions: Vec::new(), edges: Vec::new(), averaged }
}

impl Comparison {
    /// Adds what was predicted of validation runs, in the order of the results.
    pub fn with_predictions(mut self, predictions: Vec<Prediction>) -> Self {
        self.edges = prediction::edges(&predictions);
        self.averaged = Averaged::of(&self.candidates, &predictions, self.inflation);
        self.predictions = predictions;
        self
    }
}

#[cfg(test)]
mod tests;
