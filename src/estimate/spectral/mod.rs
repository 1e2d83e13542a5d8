//! Estimation in the frequency domain: maximum likelihood on the spectra of runs (Marchand and Fu 1985), for linear models and for nonlinear
//! ones, linearised at their trim or with nonlinear terms carried in as known inputs.
//!
//! **In** a model and runs. **Out** a [`SpectralFit`]: an estimate over coefficients, and what the time domain adds. **Never** another
//! likelihood than that of samples. **Start** at [`fit_spectra`].
//!
//! Real and imaginary part of a coefficient are two samples of the same problem that the time domain solves, so that cost, corrections, noise
//! and statistics are one code: R of the samples is half of S. The road is [`fit_spectra`]: `setting` (model, spectra, end
//! terms) -> `first` (values from equation error) -> `response` -> the estimation -> `finish` (initial states and biases in the time domain).

mod fault;
pub(super) mod finish;
pub(super) mod first;
mod fit;
pub(super) mod hidden;
mod known_inputs;
mod lines;
#[cfg(test)]
mod lines_tests;
pub(in crate::estimate) mod offsets;
mod options;
mod record_noise;
mod redrawn;
pub(super) mod response;
pub(super) mod setting;
#[cfg(test)]
mod tests;
mod unanswered;
mod weights;

pub use fault::SpectralError;
pub use first::FirstValue;
pub use fit::{RunSpectrum, SpectralFit, fit_spectra};
pub use hidden::HiddenMode;
pub use lines::{LineResponse, SpectralLines};
pub use options::{Nonlinear, SpectralOptions};
pub use unanswered::Unanswered;
