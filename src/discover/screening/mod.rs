//! Score tests of all candidates against the residuals, and what noise alone would do to the best of them.
//!
//! **In** residuals, sensitivities and one simulated direction for each candidate and size, run by run. **Out** a
//! [`Screening`]: statistic, size, p-value of each candidate, and the family-wise p-value of the best. **Never**
//! simulates or fits: directions come from whoever can extend a model. **Start** at [`screen`]. Its order is
//! `basis` (the few columns that carry all signals) -> `bands` (products in narrow bands) -> `saturated` (noise that fit and
//! candidates leave) -> `projection` (what the fit has absorbed) -> `pursuit` (what a residual follows) ->
//! `standardised` (outliers, noise that outputs share) -> `score` -> `null_distribution` (what noise does to the best of many); `consistency` compares runs.

mod bands;
mod basis;
mod consistency;
mod null_distribution;
mod projection;
mod pursuit;
mod saturated;
mod score;
mod screen;
mod standardised;
#[cfg(test)]
mod tests;

pub use crate::bins::{Record, Signals};
pub use crate::noise::LogSpectrum;
pub use consistency::Consistency;
pub(crate) use null_distribution::exceedance;
pub use score::{Direction, Shape};
pub use screen::{
    Candidate, Screening, ScreeningError, ScreeningOptions, screen, screen_bins, spectra, spectra_of_bins,
};
pub use standardised::{Outlier, OutlierPlace};
