//! Profile-likelihood confidence intervals.

use serde::{Deserialize, Serialize};

/// The profile of one parameter.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Profile {
    /// Its name.
    pub name: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// The estimate.
    pub value: f64,
    /// Its error to be trusted.
    pub error: f64,
    /// Corrected over Cramer-Rao error: coloured noise makes the cost rise so much (squared) too quickly.
    pub factor: f64,
    /// What the cost may rise.
    pub rise: f64,
    /// Whether the estimate stands at its bound: the error is a guess then.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub bound: bool,
    /// Where the cost has risen so much, below and above.
    pub ends: [End; 2],
    /// Other parameters that stand at their bounds beside each end: the curve has a corner where one gets there.
    #[serde(default, skip_serializing_if = "none_held")]
    pub held: [Vec<AtBound>; 2],
    /// The interval by the error.
    pub by_error: [f64; 2],
    /// Values and the rise of the cost there, by value; with the estimates of the other parameters.
    pub points: Vec<Point>,
    /// Refits that were made.
    pub refits: usize,
}

/// Where an interval ends.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// Here the cost has risen by what chance explains.
    At(f64),
    /// The cost rises no further up to here: the interval is open.
    Open(f64),
    /// The parameter's bound comes first.
    Bound(f64),
    /// The fit goes astray behind this value; the interval reaches at least that far.
    Astray(f64),
    /// The series was interrupted at this value.
    Interrupted(f64),
}

/// A parameter at its bound.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct AtBound {
    /// Its name, and its run where it has one.
    pub name: String,
    /// The bound.
    pub bound: f64,
}

/// One value and the best fit with it.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Point {
    /// The parameter.
    pub value: f64,
    /// What the best fit with it costs more than the best of all.
    pub rise: f64,
    /// The other parameters, in the order of the fit.
    pub others: Vec<(String, f64)>,
}

/// Half the interval by an error, where the cost may rise so much and the corrected error is so many Cramer-Rao errors.
pub fn reach(error: f64, factor: f64, rise: f64) -> f64 {
    // the rise is half the square of so many Cramer-Rao errors
    error / factor * (2.0 * rise).sqrt()
}

fn none_held(held: &[Vec<AtBound>; 2]) -> bool {
    held.iter().all(Vec::is_empty)
}

impl Profile {
    /// Half the interval by the error.
    pub fn reach(&self) -> f64 {
        reach(self.error, self.factor, self.rise)
    }
}

impl End {
    /// The value at which the interval ends.
    pub fn value(self) -> f64 {
        match self {
            Self::At(v) | Self::Open(v) | Self::Bound(v) | Self::Astray(v) | Self::Interrupted(v) => v,
        }
    }
}
