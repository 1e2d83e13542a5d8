//! What was found about the colour of the noise, and why errors could not be corrected for it.

use crate::quality::autoregression::AutoRegression;
use serde::Serialize;
use std::fmt;

/// The colour of the noise of one output, in the runs that share it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NoiseColour {
    /// Name of the output.
    pub output: String,
    /// Names of the runs.
    pub runs: Vec<String>,
    /// Time between neighbouring samples; the middle one of all intervals where they differ.
    pub interval: f64,
    /// Coefficients of the autoregression `v(i) = sum of a(k) v(i - k) + e(i)`; none for white noise.
    pub coefficients: Vec<f64>,
    /// Standard deviation of the noise v.
    pub deviation: f64,
    /// Standard deviation of the innovations e.
    pub innovation: f64,
    /// Correlation of neighbouring samples.
    pub neighbours: f64,
}

impl NoiseColour {
    pub(in crate::estimate) fn new(output: String, runs: Vec<String>, interval: f64, model: &AutoRegression) -> Self {
        let r = model.autocovariances(1);
        let neighbours = if r[0] > 0.0 { r[1] / r[0] } else { 0.0 };
        let (coefficients, innovation) = (model.coefficients.clone(), model.variance.sqrt());
        Self { output, runs, interval, coefficients, deviation: r[0].sqrt(), innovation, neighbours }
    }

    /// Whether it is white.
    pub fn is_white(&self) -> bool {
        self.coefficients.is_empty()
    }
}

/// Why errors were not corrected for the colour of the residuals.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Uncorrected {
    /// As many parameters as data, or nothing estimated.
    NoDegreesOfFreedom,
    /// The sensitivities do not fit into memory all at once.
    TooLarge,
    /// Numbers left the finite ones.
    NotFinite,
    /// It was not asked for.
    NotAsked,
    /// The residuals are innovations, white where the noise that the model declares is right.
    Innovations,
}

impl fmt::Display for Uncorrected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoDegreesOfFreedom => f.write_str("no more data than parameters"),
            Self::TooLarge => f.write_str("too many samples times parameters; take every k-th sample"),
            Self::NotFinite => f.write_str("the colour of the residuals could not be told"),
            Self::NotAsked => f.write_str("not asked for"),
            Self::Innovations => f.write_str("innovations of a filter have none where its noise is right"),
        }
    }
}
