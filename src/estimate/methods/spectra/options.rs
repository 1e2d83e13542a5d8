//! What a user may choose about a fit in the frequency domain.

use crate::problem::Options;
use crate::problem::unknowns::Changes;
use fdm_system::frequency::EndTerms;
use fdm_system::spectrum::Frequencies;
use serde::Serialize;

/// How a nonlinear model is taken into the frequency domain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub enum Nonlinear {
    /// Its nonlinear terms are measured regressors where the records allow it, else it is linearised.
    #[default]
    Auto,
    /// Nonlinear terms are computed from measured records and become known inputs.
    MeasuredRegressors,
    /// By its derivatives at the trim.
    Linearised,
}

/// What a user may choose about a fit in the frequency domain.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
    /// Standard deviations of the noise of recorded inputs, by name: an input that is not named has none. The bias by it is removed, and errors include it.
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
