//! What is known after a fit beyond its estimates: bands of predictions ([`Predicted`]), and draws from the posterior ([`sample`]).
//!
//! **In** a model, runs, estimates. **Out** [`Bands`]; [`Samples`] with their diagnostics. **Never** estimates. The sampler: `nuts` moves in the units of
//! `coordinates`, whose density is that of `density`, widened by `correction` where residuals are coloured; `sample` runs several chains, `convergence` judges them, `calibration` the sampler itself.

mod bands;
#[cfg(test)]
mod bands_tests;
mod convergence;
mod coordinates;
mod correction;
mod density;
mod nuts;
mod sample;
#[cfg(test)]
mod tests;

pub use bands::{BandError, Bands, Errors, Predicted};
pub use convergence::{Calibration, Ranks, calibrated};
pub use correction::CorrectedErrors;
pub use density::{Given, Posterior, SampledName};
pub use sample::{Chain, SampleError, Samples, Sampling, sample};
