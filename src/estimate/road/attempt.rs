//! One attempt: everything that is done from one vector of start values, the strategies that were asked for and the
//! rescue included.

use super::fit::{Fit, FitOptions};
use super::fit_error::FitError;
use super::plain::plain;
use crate::estimate::progress::Observer;
use crate::estimate::strategy::continuation::{Continuation, Lengthening};
use crate::estimate::strategy::rescue::rescue;
use crate::estimate::strategy::shooting::{Shooting, shoot};
use crate::estimate::strategy::substitution::Substitution;
use crate::estimate::strategy::trouble::trouble;
use crate::estimate::termination::Termination;
use crate::model::Model;
use crate::record::Run;

/// Estimates from `starts` (all parameters of each run, see [`starts`](crate::estimate::starts)); `model` has the changes in
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
    if options.substitute.is_empty() {
        return from_here(model, runs, starts, options, observer);
    }
    let substitution = Substitution::new(model, runs, &options.substitute).map_err(FitError::Strategy)?;
    let (first, starts) = substitution.first_fit(starts, options, observer)?;
    let fit = match first.estimate.termination {
        Termination::Interrupted => Fit { model: model.clone(), ..first },
        _ => from_here(model, runs, &starts, options, observer)?,
    };
    Ok(Fit { substituted: substitution.states, ..fit })
}

/// The full model by shooting, by lengthening the record, or plainly.
fn from_here(
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

/// The model of a finished fit once more, to other runs or with other weights, from values near its estimates: in segments
/// when there was no other way, else plainly.
pub(in crate::estimate) fn again(
    fit: &Fit,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    match &fit.shooting {
        Some(cut) if !cut.polished => {
            shoot(&fit.model, runs, starts, (Shooting::Segments(cut.segments), options), observer)
        }
        _ => plain(&fit.model, runs, starts, options, observer),
    }
}
