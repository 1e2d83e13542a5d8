//! One attempt: everything that is done from one vector of start values, the strategies that were asked for and the
//! rescue included.

use super::continuation::{Continuation, Lengthening};
use super::estimate::Estimate;
use super::fit::{Fit, FitOptions};
use super::fit_error::FitError;
use super::plain::plain;
use super::progress::Observer;
use super::rescue::{Trouble, rescue};
use super::shooting::shoot;
use super::termination::Termination;
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
    let fit = as_asked(model, runs, starts, options, observer)?;
    match trouble(&fit.estimate).filter(|_| options.continuation == Continuation::Auto) {
        Some(trouble) => rescue(model, runs, starts, options, (fit, trouble), observer),
        None => Ok(fit),
    }
}

/// By the strategies that were asked for, plainly when there are none.
fn as_asked(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    if let Some(shooting) = options.shooting {
        return shoot(model, runs, starts, (shooting, options), observer);
    }
    match options.continuation.lengths() {
        Some(lengths) => Lengthening { model, runs, options, stages: Vec::new() }.along(&lengths, starts, observer),
        None => plain(model, runs, starts, options, observer),
    }
}

/// Mean R^2 below which an estimate cannot be what was meant.
const POOR: f64 = 0.5;

/// What is wrong with an estimate, if anything is that another way could better.
pub(super) fn trouble(estimate: &Estimate) -> Option<Trouble> {
    match &estimate.termination {
        Termination::Interrupted => None,
        Termination::Converged(_) | Termination::IterationLimit => {
            let r2: Vec<f64> = estimate.outputs.iter().filter_map(|o| o.r2).map(|r2| r2.max(-1.0)).collect();
            let mean = r2.iter().sum::<f64>() / r2.len().max(1) as f64;
            (!r2.is_empty() && mean < POOR).then_some(Trouble::PoorMatch { r2: mean })
        }
        ended => Some(Trouble::Ended(ended.clone())),
    }
}
