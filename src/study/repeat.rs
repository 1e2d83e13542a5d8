//! What is kept of one repeat: a few numbers for each parameter.

use crate::estimate::{Estimate, ParameterEstimate, Status, quantile};
use serde::{Deserialize, Serialize};

/// A parameter that is studied.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Subject {
    /// The step of an experiment that estimates it; empty where there is one only.
    pub step: String,
    /// Its name.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// The value that the records were made with.
    pub truth: f64,
}

/// What came out for one parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// The estimate; not a number where there is none.
    pub value: f64,
    /// Cramer-Rao and corrected standard error; not a number where there is none (a parameter at its bound, or not determined).
    pub errors: [f64; 2],
    /// How many of these errors on both sides make the interval of 95 %: more than two where the noise is poorly known.
    pub factors: [f64; 2],
}

impl Figure {
    /// Nothing came out.
    pub(super) const NONE: Self = Self { value: f64::NAN, errors: [f64::NAN; 2], factors: [f64::NAN; 2] };

    pub(super) fn of(p: &ParameterEstimate) -> Self {
        let error = |e: Option<f64>| e.filter(|e| e.is_finite() && *e > 0.0).unwrap_or(f64::NAN);
        Self {
            value: p.value,
            errors: [error(p.standard_error), error(p.corrected_error)],
            factors: [quantile(None), quantile(p.freedom)],
        }
    }
}

/// One repeat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Repeat {
    /// Steps that have no minimum, and why; empty when all have converged. Their figures are not numbers.
    pub astray: Vec<(String, String)>,
    /// What came out, in the order of the subjects.
    pub figures: Vec<Figure>,
}

impl Repeat {
    /// Whether every fit of it converged.
    pub fn is_good(&self) -> bool {
        self.astray.is_empty()
    }

    /// Nothing came out, for this reason.
    pub(super) fn gone(reason: impl ToString, subjects: usize) -> Self {
        Self { astray: vec![(String::new(), reason.to_string())], figures: vec![Figure::NONE; subjects] }
    }

    /// What an estimation says of the subjects.
    pub(super) fn of(estimate: &Estimate, subjects: &[Subject]) -> Self {
        if !estimate.termination.is_good() {
            return Self::gone(&estimate.termination, subjects.len());
        }
        let of = |s: &Subject| estimate.parameter(&s.name, s.run.as_deref()).map_or(Figure::NONE, Figure::of);
        Self { astray: Vec::new(), figures: subjects.iter().map(of).collect() }
    }
}

/// Whether a parameter was estimated, or follows from some that were.
pub(super) fn is_estimated(p: &ParameterEstimate) -> bool {
    match p.status {
        Status::Estimated | Status::AtLowerBound | Status::AtUpperBound | Status::NotDetermined => true,
        Status::Derived | Status::Tied => p.standard_error.is_some(),
        Status::Fixed | Status::NotEstimated => false,
    }
}
