//! Candidates are scored against the residuals, and judged against what noise alone would do.
//!
//! **In** residuals, sensitivities and one simulated direction for each candidate and size, run by run. **Out** a
//! [`Screening`]: statistic, size, chance of each candidate, and the chance that the best of all is noise. **Never**
//! simulates or fits: directions come from whoever can extend a model. **Start** at [`screen`]; its road is
//! `lines` (cosine transform) -> `shared` (the few columns that carry all signals, by a `sketch`) -> `repeats` (runs that repeat each
//! other) -> `cells` (bands) -> `noise` (spectrum of each output) -> `projection` (what the fit has eaten) -> `ends` (where a record cuts a
//! resonance off) -> `rest` (outliers, noise that outputs share) -> `score` -> `drawing` and `calibration` (what noise does to the best of
//! many); `saturated` goes the first part of it, `judge` the second, `consistency` compares runs.

mod banded;
mod calibration;
mod cells;
mod consistency;
mod drawing;
mod ends;
mod judge;
mod lines;
mod noise;
mod projection;
mod repeats;
mod rest;
mod saturated;
mod score;
mod screening;
mod shared;
mod sketch;
mod squared;
#[cfg(test)]
mod tests;

pub(in crate::diagnose) use calibration::{Normal, exceedance};
pub use consistency::Consistency;
pub use lines::{Record, Signals};
pub(in crate::diagnose) use noise::Left;
pub use noise::LogSpectrum;
pub use rest::{Outlier, Place};
pub use score::{Direction, Shape};
pub use screening::{
    Candidate, Screening, ScreeningError, ScreeningOptions, screen, screen_lines, spectra, spectra_of_lines,
};
