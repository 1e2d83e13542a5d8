//! One attempt: everything that is done from one vector of start values, the strategies that were asked for and the
//! rescue included.

use super::fit::{Fit, FitOptions};
use super::fit_error::FitError;
use super::plain::plain;
use super::progress::Observer;
use crate::model::Model;
use crate::record::Run;

/// Estimates from `starts` (all parameters of each run, see [`starts`](super::starts)); `model` has the changes in
/// `options` already.
///
/// # Errors
/// [`FitError`]; an attempt that ran and went wrong is a [`Fit`] whose estimate says so.
pub fn attempt(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    plain(model, runs, starts, options, observer)
}
