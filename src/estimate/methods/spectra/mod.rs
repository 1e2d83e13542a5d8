//! Estimation in the frequency domain: maximum likelihood on the spectra of runs (Marchand and Fu 1985), for linear models and for nonlinear ones, linearised at
//! their trim or with nonlinear terms as measured regressors.
//!
//! **In** a model and runs. **Out** a [`SpectralFit`]: an estimate over coefficients, and what the time domain adds. **Start** at [`fit_spectra`].
//!
//! Real and imaginary part of a coefficient are two samples of the same problem that the time domain solves, so that cost, iteration, noise and statistics
//! are one code: R of the samples is half of S. `setting` (model, spectra, end-point corrections) -> `starting_values` (from equation error) -> `response` ->
//! the estimation -> `initial_conditions` (initial states and biases in the time domain).

pub(crate) mod bins;
#[cfg(test)]
mod bins_tests;
mod error;
mod fit;
pub(crate) mod initial_conditions;
mod options;
mod regressor_noise;
pub(crate) mod setting;
#[cfg(test)]
mod tests;

pub use bins::{BinResponse, SpectralBins};
pub use error::{SpectralError, Unanswered};
pub use fit::{RunSpectrum, SpectralFit, fit_spectra};
pub use initial_conditions::{UnobservableMode, with_initials};
pub use options::{Nonlinear, SpectralOptions};
pub use setting::StartingValue;
