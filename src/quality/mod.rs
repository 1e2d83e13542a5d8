//! How well a response matches a measurement, and what the residuals say about the noise and about what is missing.
//!
//! **In** the time, the measurement, the response and the inputs of a run. **Out** [`OutputQuality`] of each output: size and
//! kind of the mismatch, whiteness, spectrum and distribution of the residuals, correlation with the inputs; which of two responses is nearer ([`advantage`]); the colour of noise
//! for the errors of estimates.
//! **Never** simulates, estimates parameters or judges a model's structure. **Start** at [`run_quality`].

mod advantage;
pub(crate) mod autocovariance;
pub(crate) mod autoregression;
pub(crate) mod colour;
mod distribution;
mod input_correlation;
pub(crate) mod ladder;
pub(crate) mod lagged;
mod output_fit;
mod recurrence;
mod residual_spectrum;
mod residuals;
pub(crate) mod sampling;
#[cfg(test)]
pub(crate) mod specimen;
mod whiteness;

pub use advantage::{Advantage, advantage};
pub use distribution::Distribution;
pub use input_correlation::InputCorrelation;
pub use output_fit::{OutputFit, TicParts};
pub use residual_spectrum::ResidualSpectrum;
pub use residuals::{OutputQuality, Signals, residual_quality, run_quality};
pub use sampling::Untested;
pub use whiteness::{RunsTest, Whiteness};
