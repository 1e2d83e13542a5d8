//! The three independent questions of a fit: what is minimised, on what data, and how the minimum is approached.

use serde::{Deserialize, Serialize};
use std::fmt;

/// What is minimised (Maine and Iliff 1985; Klein and Morelli 2016, chapters 5 to 7).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Output error: measured minus simulated outputs; the equations carry no noise.
    #[default]
    OutputError,
    /// Filter error: innovations of a Kalman filter, where process noise enters the equations.
    FilterError,
    /// Equation error: measured rates minus the right-hand sides, by linear regression.
    EquationError,
    /// Frequency responses, measured from sweeps and weighted by coherence (Tischler and Remple 2012).
    FrequencyResponse,
}

/// On what data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Domain {
    /// Samples in time.
    #[default]
    Time,
    /// Fourier coefficients.
    Frequency,
}

/// How the minimum is approached; every way ends with Gauss-Newton steps, which give the standard errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Optimizer {
    /// Damped Gauss-Newton steps from the start.
    #[default]
    GaussNewton,
    /// The simplex of Nelder and Mead first: slow and without derivatives, for responses with jumps or starts at which the
    /// response hardly moves.
    NelderMead,
    /// Quasi-Newton steps with limited memory and exact gradients first.
    Lbfgs,
}

impl Method {
    /// Whether the method works on data of this domain.
    pub fn is_of(self, domain: Domain) -> bool {
        match self {
            Self::OutputError | Self::EquationError => true,
            Self::FilterError => domain == Domain::Time,
            Self::FrequencyResponse => domain == Domain::Frequency,
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::OutputError => "output error",
            Self::FilterError => "filter error",
            Self::EquationError => "equation error",
            Self::FrequencyResponse => "frequency response",
        })
    }
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Time => "time",
            Self::Frequency => "frequency",
        })
    }
}

impl fmt::Display for Optimizer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::GaussNewton => "Gauss-Newton",
            Self::NelderMead => "Nelder-Mead",
            Self::Lbfgs => "L-BFGS",
        })
    }
}

/// How the weights of smooth tables are chosen.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SmoothBy {
    /// By the greatest marginal likelihood of the data.
    #[default]
    Likelihood,
    /// By predicting runs that were left out, in the time domain.
    Validation,
    /// These: one for each axis of each smooth table, in the order of the model.
    Weights(Vec<f64>),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_keep_to_their_domains() {
        use Method::{EquationError, FilterError, FrequencyResponse, OutputError};
        let time = [OutputError, FilterError, EquationError, FrequencyResponse].map(|m| m.is_of(Domain::Time));
        let frequency =
            [OutputError, FilterError, EquationError, FrequencyResponse].map(|m| m.is_of(Domain::Frequency));
        assert_eq!(time, [true, true, true, false]);
        assert_eq!(frequency, [true, false, true, true]);
    }
}
