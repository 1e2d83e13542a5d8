//! What may be chosen about a fit of frequency responses, and why there is none.

use crate::methods::spectra::SpectralError;
use crate::problem::unknowns::Changes;
use crate::problem::{Options, ProblemError};
use fdm_system::spectrum::{Frequencies, SpectrumError};
use serde::Serialize;

/// What a user may choose about a fit of frequency responses.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResponseOptions {
    /// Start values, and which parameters are fixed and free.
    pub changes: Changes,
    /// How to estimate; its noise is not read, since decibels and degrees have their own.
    pub options: Options,
    /// At which frequencies: an end that is not given is where the inputs have their power, and frequencies stand a tenth apart from each other
    /// but not closer than the longest segment resolves; of a band with a spacing every one.
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

/// Why no frequency responses were fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ResponseError {
    /// What keeps any fit in the frequency domain from beginning.
    #[error("{0}")]
    Spectral(SpectralError),
    /// No responses could be measured.
    #[error("{0}")]
    Spectrum(SpectrumError),
    /// A pair of something that the model does not have.
    #[error("there is no {role} `{name}` to compare; the model has {there}")]
    NoChannel {
        /// `input` or `output`.
        role: &'static str,
        /// What was asked for.
        name: String,
        /// Those that there are.
        there: String,
    },
    /// A model without inputs has no frequency response.
    #[error("the model has no input, and a frequency response is one to an input; estimate in the time domain")]
    NoInputs,
    /// Inputs that only the time domain, or spectra, know.
    #[error(
        "`{0}` is computed from measured outputs, to which there is no frequency response of its own; say `--domain frequency`"
    )]
    Hidden(String),
    /// A pair that the model does not connect.
    #[error("the model's `{output}` does not respond to `{input}`; leave the pair out")]
    NotConnected {
        /// The output.
        output: String,
        /// The input.
        input: String,
    },
    /// Nothing to trust.
    #[error(
        "no response is coherent: of all pairs and frequencies none has a coherence of {least} or more (the best is {best:.2}); use sweeps that move \
         the inputs more, or more of them, or another band (`--band`)"
    )]
    Incoherent {
        /// Coherence that was asked for.
        least: f64,
        /// Best that there is.
        best: f64,
    },
    /// A coherence that is none.
    #[error("a least coherence of {0} makes no sense; give a number from 0 to below 1")]
    NoCoherence(f64),
    /// A length that is none.
    #[error("a segment cannot be {0} long; give lengths above zero, within the records")]
    NoSegment(f64),
    /// More unknowns than numbers.
    #[error(
        "{points} points of frequency responses are {} numbers, too few for {unknowns} unknowns; widen the band (`--band`), use longer or more \
         runs, or fix parameters (`--fix NAME`)", 2 * points
    )]
    TooFewPoints {
        /// Unknowns.
        unknowns: usize,
        /// Points of all pairs.
        points: usize,
    },
    /// A problem that cannot be solved.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Problem(Vec<ProblemError>),
}

impl From<SpectralError> for ResponseError {
    fn from(e: SpectralError) -> Self {
        Self::Spectral(e)
    }
}
