//! Reference systems: what came out of an experiment, beside what was expected.

use serde::{Deserialize, Serialize};

/// A figure or a statement that was expected, and what came out.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Check {
    /// The step that it is about.
    pub step: String,
    /// The parameter, the figure or the statement.
    pub what: String,
    /// What the paper has.
    pub paper: Option<String>,
    /// What was expected.
    pub expected: String,
    /// What came out.
    pub got: String,
    /// Its standard error.
    pub standard_error: Option<f64>,
    /// How far it is off, in standard errors; none where that is not what is asked.
    pub off: Option<f64>,
    /// Whether it is as expected.
    pub passed: bool,
}

/// What came out of an experiment.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Outcome {
    /// Name of the experiment.
    pub system: String,
    /// The system in a few words.
    pub title: String,
    /// Who published it, or who measured it.
    pub source: String,
    /// Whether the paper's figure is reproduced, and why not.
    pub remark: String,
    /// Whether everything came out as expected.
    pub passed: bool,
    /// Most parameters that a step estimates.
    pub parameters: usize,
    /// Of all values that are compared by their standard errors: how far the worst is off.
    pub worst_error_in_standard_errors: Option<f64>,
    /// All that was expected.
    pub checks: Vec<Check>,
}

impl Outcome {
    /// How many came out as expected.
    pub fn count_passed(&self) -> usize {
        self.checks.iter().filter(|c| c.passed).count()
    }
}
