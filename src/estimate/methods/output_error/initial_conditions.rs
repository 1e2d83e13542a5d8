//! What is a run's own (free initial values, biases) from its first samples, and what a model predicts from there: nothing of the rest
//! of the record enters but the inputs.

use super::options::{Attempt, after};
use crate::methods::output_error::error::{FitError, StrategyError};
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::FitOptions;
use crate::methods::output_error::single::{changed, starts};
use crate::methods::time_domain::{examined, fit_from};
use crate::work::Work;
use fdm_system::model::Model;
use fdm_system::record::Run;

/// All parameters (p) of each run, of which those that are the run's own are estimated from its first `length` (in the model's unit
/// of time), from the starts of any fit; all others stay at their values. `model` has the changes in `options` already.
/// Where these samples do not determine a parameter it keeps its start value.
///
/// # Errors
/// [`FitError`], as any fit; [`StrategyError::InitialConditions`] where there are no two samples in that time, or nothing is measured.
pub fn initial_values(
    model: &Model,
    runs: &[Run],
    length: f64,
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Vec<Vec<f64>>, FitError> {
    let mut params = model.definition().params.clone();
    params.iter_mut().filter(|p| !p.per_run).for_each(|p| p.fixed = true);
    let starts = starts(model, runs, &options.changes);
    if params.iter().all(|p| p.fixed) {
        return Ok(starts);
    }
    let heads = runs.iter().map(|run| head(run, length)).collect::<Result<Vec<Run>, _>>()?;
    let own = model.with_params(params);
    let mut found = Vec::with_capacity(runs.len());
    // each by itself, so that the noise of one says nothing of another
    for (head, start) in heads.iter().zip(&starts) {
        let options = FitOptions { bare: true, ..options.clone() }.with_declared_noise(model);
        let (runs, starts) = (std::slice::from_ref(head), std::slice::from_ref(start));
        let fit = fit_from(&Attempt { model: &own, runs, starts, options: &options, work })?;
        found.extend(after(&fit.model, runs, &fit.estimate, starts));
    }
    Ok(found)
}

/// As [`fit()`](crate::fit()), with what is a run's own estimated from its first `length` and then held: the match of all samples behind
/// them is a prediction.
///
/// # Errors
/// As [`initial_values`].
pub fn fit_from_initial_conditions(
    model: &Model,
    runs: &[Run],
    length: f64,
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Fit, FitError> {
    let given = changed(model, &options.changes)?;
    let values = initial_values(&given, runs, length, options, work)?;
    let mut params = given.definition().params.clone();
    params.iter_mut().filter(|p| p.per_run).for_each(|p| p.fixed = true);
    let held = given.with_params(params);
    let options = options.clone().with_declared_noise(&held);
    let held = Attempt { model: &held, runs, starts: &values, options: &options, work };
    examined(fit_from(&held)?, &held)
}

/// The samples of the first `length` of a run.
fn head(run: &Run, length: f64) -> Result<Run, FitError> {
    let begin = run.time.first().copied().unwrap_or(0.0);
    let count = run.time.partition_point(|t| *t <= begin + length);
    let head = (count >= 2).then(|| run.part(0..count));
    let said =
        || FitError::Strategy(StrategyError::InitialConditions { run: run.name.clone(), length, samples: count });
    head.filter(|head| head.measured.iter().any(|z| !z.is_nan())).ok_or_else(said)
}
