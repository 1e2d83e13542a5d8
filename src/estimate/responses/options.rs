//! What a user may choose about a fit of frequency responses.

use crate::estimate::changes::Changes;
use crate::estimate::problem::Options;
use crate::spectrum::Frequencies;

/// What a user may choose about a fit of frequency responses.
#[derive(Debug, Clone, PartialEq)]
pub struct ResponseOptions {
    /// Start values, and which parameters are fixed and free.
    pub changes: Changes,
    /// How to estimate; its noise is not read, since decibels and degrees have their own.
    pub options: Options,
    /// At which frequencies: an end that is not given is where the inputs have their power, and frequencies stand a tenth apart from each other
    /// but not closer than the longest segment tells apart; of a band with a spacing every one.
    pub frequencies: Frequencies,
    /// Lengths of the segments that are averaged, in the model's time; none for two of them, the second half as long as the first.
    pub segments: Vec<f64>,
    /// Pairs of output and input that are compared; none for all that the model connects.
    pub pairs: Vec<(String, String)>,
    /// Coherence below which a frequency does not count.
    pub coherence: f64,
    /// Whether initial states and biases are found in the time domain afterwards.
    pub finish: bool,
}

impl Default for ResponseOptions {
    fn default() -> Self {
        Self {
            changes: Changes::default(),
            options: Options::default(),
            frequencies: Frequencies::Grid { lowest: None, highest: None },
            segments: Vec::new(),
            pairs: Vec::new(),
            coherence: 0.6,
            finish: true,
        }
    }
}
