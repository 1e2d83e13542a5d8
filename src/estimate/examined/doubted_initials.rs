//! Initial values that the model states and the data contradict: what a fit with free ones finds.

use serde::{Deserialize, Serialize};

/// Initial values that the model states and the data contradict.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct DoubtedInitials {
    /// The initial values, run by run.
    pub values: Vec<DoubtedInitial>,
    /// What the logarithm of the likelihood rises by when they are free.
    pub gain: f64,
    /// What of that they cost: half the logarithm of the number of compared values for each (Schwarz).
    pub cost: f64,
    /// The parameters that all runs share, as they become; with their values before.
    pub parameters: Vec<MovedParameter>,
}

/// An initial value that is stated, and what the data say.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct DoubtedInitial {
    /// The state.
    pub state: String,
    /// The run.
    pub run: String,
    /// Its unit, as text.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// What the model states.
    pub stated: f64,
    /// What it becomes when it is free.
    pub found: f64,
    /// The standard error of that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
}

/// A parameter with other initial values.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct MovedParameter {
    /// Its name.
    pub name: String,
    /// Its estimate with the initial values as they are stated.
    pub before: f64,
    /// Its estimate with free ones.
    pub value: f64,
    /// The standard error of that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
}
