//! What is measured of a model: a number with its derivatives, or why there is none.

use fdm_system::linear::TrimError;

/// Why requirements cannot be measured at all.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RequirementError {
    /// There is no linear model.
    #[error("{0}")]
    Trim(#[from] TrimError),
    /// Equations hold records, which a standard manoeuvre does not have.
    #[error("the model's equations hold the record `{name}`, which a standard manoeuvre does not have")]
    Records {
        /// The hidden input.
        name: String,
    },
    /// Which run is meant must be said.
    #[error("runs have parameters of their own, so that one of them must be chosen: `fdm margins RESULT --like RUN`")]
    Runs,
    /// Which value is meant must be said.
    #[error(
        "each run brings `{name}` to the model, so that a value must be chosen: `fdm margins RESULT --known {name}=VALUE`"
    )]
    Known {
        /// The input that runs bring.
        name: String,
    },
    /// Nothing is known of the errors.
    #[error("the result has no covariance")]
    NoCovariance,
    /// A manoeuvre cannot be simulated.
    #[error("a standard manoeuvre cannot be simulated: {reason}")]
    Simulation {
        /// Why.
        reason: String,
    },
}

/// A number with its derivatives by every parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Its value; NaN where there is none.
    pub value: f64,
    /// Its derivatives (p, or the columns that were asked for); empty where they were not.
    pub gradient: Vec<f64>,
    /// Why there is none.
    pub missing: Option<String>,
}

impl Measured {
    pub(super) fn of(value: f64, gradient: Vec<f64>) -> Self {
        Self { value, gradient, missing: None }
    }

    /// Whether it has a value and a slope in every direction.
    pub(super) fn is_linear(&self) -> bool {
        self.value.is_finite() && self.gradient.iter().all(|g| g.is_finite())
    }

    pub(super) fn missing(why: impl Into<String>) -> Self {
        Self { value: f64::NAN, gradient: Vec::new(), missing: Some(why.into()) }
    }
}
