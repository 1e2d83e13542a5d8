//! How well a response matches a measurement, and what the residuals say about the noise and about what the model lacks.
//!
//! **In** the time, the measurement, the response and the inputs of a run. **Out** [`OutputQuality`] of each output: size and kind of the mismatch
//! ([`OutputFit`], Theil's coefficient), whiteness, spectrum and distribution of the residuals, correlation with the inputs; whether the noise varies ([`NoiseVariation`]); which of two responses is nearer
//! ([`advantage`], Diebold and Mariano's test); autocovariances and autoregressions for the errors of estimates. **Start** at [`run_quality`].

mod analysis;
pub(crate) mod autocovariance;
pub(crate) mod autoregression;
mod diebold_mariano;
pub(crate) mod noise_variation;
pub(crate) mod whiteness;

pub use analysis::{
    Baseline, Distribution, OutputFit, OutputQuality, Signals, TicParts, add_squares, compared, residual_quality,
    residuals, run_quality,
};
pub use diebold_mariano::{Advantage, advantage};
pub use noise_variation::{Cause, NoiseVariation, Trend};
pub use whiteness::{InputCorrelation, ResidualSpectrum, RunsTest, Untested, Whiteness};
