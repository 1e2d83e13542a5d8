//! Requirements on a model as it was found: value, interval, and the probability that each holds.

use serde::{Deserialize, Serialize};

/// How an interval was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// By the delta method: the requirement is taken for linear in the parameters.
    Linear,
    /// By draws of the parameters, since it is not.
    Draws,
}

/// What a parameter contributes to the variance of a requirement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Its name.
    pub parameter: String,
    /// Share of the variance; shares of correlated parameters may be negative.
    pub share: f64,
}

/// A requirement on a model as it was found.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Assessment {
    /// Its name.
    pub name: String,
    /// Its doc string.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub doc: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Its expression, as it was written.
    pub expression: String,
    /// Least value that is wanted; none where there is no such limit.
    pub lower: Option<f64>,
    /// Greatest value that is wanted; none where there is no such limit.
    pub upper: Option<f64>,
    /// The value; none where it does not exist.
    pub value: Option<f64>,
    /// Standard error by the delta method.
    pub error: Option<f64>,
    /// Degrees of freedom of the error, where they are known.
    pub freedom: Option<f64>,
    /// The interval that holds the true value in 95 of 100 cases.
    pub interval: Option<[f64; 2]>,
    /// How the interval and the probability were found.
    pub by: Option<By>,
    /// The probability that the requirement holds; none without limits.
    pub probability: Option<f64>,
    /// Share of the draws at which there is no value; they count as not held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missing: Option<f64>,
    /// Why there is no value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// The parameters that contribute most to the variance.
    pub parts: Vec<Part>,
}

/// A mode with 95 % intervals; a pair is one.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ModeMargin {
    /// The states that dominate it.
    pub states: Vec<String>,
    /// Real part.
    pub re: f64,
    /// Imaginary part, not negative.
    pub im: f64,
    /// Its interval; none where the eigenvalue is not apart from others.
    pub re_interval: Option<[f64; 2]>,
    /// Undamped natural frequency, in rad per unit of time.
    pub frequency: f64,
    /// Its interval.
    pub frequency_interval: Option<[f64; 2]>,
    /// Damping ratio.
    pub damping: Option<f64>,
    /// Its interval.
    pub damping_interval: Option<[f64; 2]>,
    /// Time to half the amplitude.
    pub time_to_half: Option<f64>,
    /// Interval of the time to half, by that of the real part; an end is open where the mode may not decay.
    pub time_to_half_interval: Option<[Option<f64>; 2]>,
    /// Time to twice the amplitude.
    pub time_to_double: Option<f64>,
    /// Interval of the time to twice the amplitude, by that of the real part; an end is open where the mode may not grow.
    pub time_to_double_interval: Option<[Option<f64>; 2]>,
}

/// The margins of a result.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MarginsDocument {
    /// The model's name.
    pub model: String,
    /// The folder of the result.
    pub result: String,
    /// The run whose own parameters were used, of several.
    pub run: Option<String>,
    /// The unit of time.
    pub time: String,
    /// Modes with intervals.
    pub modes: Vec<ModeMargin>,
    /// Why there are no modes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_modes: Option<String>,
    /// Draws that were made.
    pub draws: usize,
    /// Their seed.
    pub seed: u64,
    /// Requirements in the order of the text.
    pub requirements: Vec<Assessment>,
}

impl MarginsDocument {
    /// Whether every requirement has a value.
    pub fn is_good(&self) -> bool {
        self.requirements.iter().all(|r| r.value.is_some())
    }
}
