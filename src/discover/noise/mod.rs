//! The noise of one output: its spectrum, from what is left of its bins.

mod growth;
mod hat;
mod log_spectrum;
mod parametric;
mod residual_power;
mod resonance;
mod smooth_spectrum;

pub(crate) use growth::Growth;
pub use log_spectrum::LogSpectrum;
use nalgebra::DMatrix;
pub(crate) use residual_power::ResidualPower;
pub(crate) use resonance::Resonance;
pub(crate) use smooth_spectrum::{BandedPower, PENALTY, SmoothSpectrum};

/// Logarithm of e^a + e^b.
fn added(a: f64, b: f64) -> f64 {
    a.max(b) + (-(a - b).abs()).exp().ln_1p()
}

/// L of a correlation L L' of outputs; correlations are made smaller until there is one.
pub(super) fn correlation_factor(mut correlation: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = correlation.nrows();
    for _ in 0..100 {
        if (&correlation - DMatrix::identity(size, size) * 0.01).cholesky().is_some() {
            break;
        }
        correlation *= 0.95;
        correlation.fill_diagonal(1.0);
    }
    correlation.cholesky().map(|c| c.unpack())
}
