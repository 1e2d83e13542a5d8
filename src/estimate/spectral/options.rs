//! What a user may choose about a fit in the frequency domain.

use crate::estimate::changes::Changes;
use crate::estimate::problem::Options;
use crate::frequency::EndTerms;
use crate::spectrum::Frequencies;

/// How a nonlinear model is taken into the frequency domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Nonlinear {
    /// Its terms are carried in as known inputs where the records allow it, else it is linearised.
    #[default]
    Auto,
    /// Nonlinear terms are computed from measured records and become known inputs.
    Carried,
    /// By its derivatives at the trim.
    Linearised,
}

/// What a user may choose about a fit in the frequency domain.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectralOptions {
    /// Start values, and which parameters are fixed and free.
    pub changes: Changes,
    /// How to estimate.
    pub options: Options,
    /// At which frequencies.
    pub frequencies: Frequencies,
    /// What is done about the end terms of the transforms.
    pub ends: EndTerms,
    /// What is done about nonlinear terms.
    pub nonlinear: Nonlinear,
    /// Standard deviations of the noise of recorded inputs, by name: what is not said has none. What it draws estimates by is taken off, and errors know it.
    pub input_noise: Vec<(String, f64)>,
    /// Whether the estimation begins with values from equation error, where states are measured.
    pub regressed: bool,
    /// Whether initial states and biases are found in the time domain afterwards.
    pub finish: bool,
}

impl Default for SpectralOptions {
    fn default() -> Self {
        Self {
            changes: Changes::default(),
            options: Options::default(),
            frequencies: Frequencies::Grid { lowest: None, highest: None },
            ends: EndTerms::Unknown,
            nonlinear: Nonlinear::default(),
            input_noise: Vec::new(),
            regressed: true,
            finish: true,
        }
    }
}
