//! Whether the draws of a posterior are what they should be.

use serde::{Deserialize, Serialize};

/// Ranks of the truth among draws, of a parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibratedParameter {
    /// Its name; `noise y` for the deviation of an output's noise.
    pub name: String,
    /// The run that it belongs to; none when all share it.
    pub run: Option<String>,
    /// Histogram of the ranks, in columns of equal width.
    pub counts: Vec<usize>,
    /// Mean rank over the number of ranks: a half where draws are neither too low nor too high.
    pub mean_rank: f64,
    /// First component of Neyman's test, standard normal under uniformity: above zero where draws lie too low.
    pub shift: f64,
    /// The second: above zero where draws lie too close together, below zero where too far apart.
    pub spread: f64,
    /// Probability of ranks that are at least so far from uniform, by Neyman's smooth test of order 4.
    pub p: f64,
}

/// A simulation-based calibration, conditional on the data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationDocument {
    /// The model's name.
    pub model: String,
    /// Decides all draws.
    pub seed: u64,
    /// Repeats that were asked for.
    pub asked: usize,
    /// Repeats that are done.
    pub done: usize,
    /// Ranks that there are.
    pub levels: usize,
    /// Trajectories that diverged, of all repeats.
    pub divergent: usize,
    /// Of each parameter.
    pub parameters: Vec<CalibratedParameter>,
    /// Family-wise p over all of them (Šidák).
    pub p: f64,
}

impl CalibrationDocument {
    /// A family-wise p below this speaks against the draws.
    pub const LEAST: f64 = 0.01;

    /// The p below which a parameter by itself is not uniform (Šidák).
    pub fn alone(&self) -> f64 {
        -((-Self::LEAST).ln_1p() / self.parameters.len().max(1) as f64).exp_m1()
    }

    /// Whether all repeats are there, and nothing speaks against uniform ranks.
    pub fn is_good(&self) -> bool {
        self.done == self.asked && self.p >= Self::LEAST
    }
}

impl CalibratedParameter {
    /// What the ranks say, in words; `alone` is the p below which one parameter by itself is not uniform.
    pub fn judgement(&self, alone: f64) -> &'static str {
        match () {
            () if self.p >= alone => "uniform",
            () if self.spread > self.shift.abs() => "draws too close together",
            () if -self.spread > self.shift.abs() => "draws too far apart",
            () if self.shift > 0.0 => "draws too low",
            () => "draws too high",
        }
    }
}
