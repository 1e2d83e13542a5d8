//! Draws from the posterior of a result.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What the draws say of a parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SampledParameter {
    /// Its name; `noise y` for the deviation of an output's noise.
    pub name: String,
    /// The run that it belongs to; none when all share it.
    pub run: Option<String>,
    /// Its unit.
    pub unit: Option<String>,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// Median.
    pub median: f64,
    /// From the 2.5 % to the 97.5 % quantile.
    pub interval: [f64; 2],
    /// Monte Carlo standard error of the mean.
    pub error_of_mean: Option<f64>,
    /// Rank-normalised split R-hat; near 1 where the chains agree.
    pub r_hat: Option<f64>,
    /// Effective number of draws for the middle of the law.
    pub bulk: Option<f64>,
    /// Effective number of draws for its tails.
    pub tail: Option<f64>,
}

/// How a chain went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChainDocument {
    /// Draws whose trajectory diverged.
    pub divergent: usize,
    /// Draws whose trajectory had all doublings that are allowed.
    pub deepest: usize,
    /// Length of a step, in units of the metric.
    pub step: f64,
    /// Mean acceptance.
    pub accepted: f64,
    /// Mean number of steps.
    pub steps: f64,
    /// Evaluations of the gradient, those of the warm-up among them.
    pub evaluations: u64,
}

/// Bands of an output of a run: 2.5 %, 50 % and 97.5 % quantiles at each sample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PredictiveBand {
    /// The run.
    pub run: String,
    /// The output, by its place in the model.
    pub output: usize,
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Times (N).
    pub time: Vec<f64>,
    /// Of the response.
    pub response: [Vec<Option<f64>>; 3],
    /// Of a new measurement.
    pub measurement: [Vec<Option<f64>>; 3],
}

/// The draws of a result, summed up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SampleDocument {
    /// The model's name.
    pub model: String,
    /// The folder of the result.
    pub result: String,
    /// Draws of each chain that were kept.
    pub draws: usize,
    /// Transitions before them.
    pub warmup: usize,
    /// The seed.
    pub seed: u64,
    /// Parameters, then the noise.
    pub parameters: Vec<SampledParameter>,
    /// The chains.
    pub chains: Vec<ChainDocument>,
    /// By how much the likelihood was widened to the corrected errors, as factors of a deviation, least and largest; left out where it was not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub widened: Option<[f64; 2]>,
    /// Posterior predictive bands; empty where they were not asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bands: Vec<PredictiveBand>,
    /// What is to be said of it.
    pub remarks: Vec<String>,
}

impl SampleDocument {
    /// Whether nothing speaks against the draws: chains agree (R-hat below 1.01), no trajectory diverged, and at least a hundred effective draws a chain.
    pub fn is_good(&self) -> bool {
        self.remarks.iter().all(|r| r.starts_with("note:"))
    }
}

/// Draws in the form that ArviZ reads (`az.from_json`): of every variable chain by draw.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ArvizDocument {
    /// Parameters and noise.
    pub posterior: BTreeMap<String, Vec<Vec<f64>>>,
    /// Of every draw.
    pub sample_stats: BTreeMap<String, Vec<Vec<f64>>>,
    /// What was measured, by run and output.
    pub observed_data: BTreeMap<String, Vec<Option<f64>>>,
}
