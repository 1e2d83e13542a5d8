//! One output-error fit from one vector of start values: steps chosen, Gauss-Newton iteration, and a second look at the steps.
//!
//! Start values are all parameters of each run, from the model, the data, or an estimate before.

use super::fit::{IntegrationFault, is_moving};
use super::options::{Attempt, after};
use crate::estimation::solve::estimate;
use crate::estimation::{Estimate, RunFit};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::problem::Problem;
use crate::problem::initial::initial_guess;
use crate::problem::unknowns::Changes;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{
    Accuracy, SOUND, Scheme, StepOptions, Steps, UNSOUND, choose_steps, error_of, integration_error, output_range,
    worst_errors,
};

/// Start values of all parameters (p) for each run; free initial values from the data unless they were set by hand.
pub fn starts(model: &Model, runs: &[Run], changes: &Changes) -> Vec<Vec<f64>> {
    runs.iter().map(|run| start(model, run, changes)).collect()
}

fn start(model: &Model, run: &Run, changes: &Changes) -> Vec<f64> {
    let mut theta = initial_guess(&model.definition().params, model.dynamics(), run);
    for (k, param) in model.definition().params.iter().enumerate() {
        if changes.set.iter().any(|(name, _)| *name == param.quantity.name) {
            theta[k] = param.value;
        }
    }
    theta
}

/// The model with the changes that were asked for.
///
/// # Errors
/// [`FitError::Changes`] with all that cannot be made.
pub fn changed(model: &Model, changes: &Changes) -> Result<Model, FitError> {
    let mut params = model.definition().params.clone();
    changes.apply(&mut params).map_err(FitError::Changes)?;
    Ok(model.with_params(params))
}

/// Choices of steps, each followed by a fit, at most; a fit whose steps are still too coarse then says so.
pub(crate) const MOST_ROUNDS: usize = 6;
/// Choices after which the implicit method is asked as well. Explicit steps that were chosen at estimates and were too coarse at the next
/// ones have let these run to the edge of stability, which moves with the steps: an implicit method has none (Hairer & Wanner, Solving
/// ordinary differential equations II, IV.3).
const EXPLICIT_ROUNDS: usize = 2;

/// Estimates from the start values. Steps are chosen at the start values and then kept, so that the
/// derivatives are exact; when they turn out too coarse at the estimates, the fit goes on from there with finer ones, again and again.
///
/// # Errors
/// [`FitError`] as for [`fit`](super::fit()).
pub(crate) fn single_fit(attempt: &Attempt<'_>) -> Result<Fit, FitError> {
    let Attempt { model, runs, options, work, .. } = *attempt;
    let mut starts = attempt.starts.to_vec();
    let was_stopped = work.halted().is_some();
    let mut steps = match options.per_interval {
        Some(per_interval) => vec![Steps::equal(options.scheme.unwrap_or_default(), per_interval); runs.len()],
        None => match options.shared_steps.steps(model, runs, &starts) {
            Some(steps) => steps,
            None => chosen_steps(attempt)?.into_iter().map(|a| a.steps).collect(),
        },
    };
    // what ends the choice of the steps leaves the start values with rough ones, which may be unable to follow the model
    let cut = work.halted().filter(|_| !was_stopped);
    let (mut round, coarse) = (1, options.shared_steps.coarse(options.accuracy));
    let mut before: Option<Fit> = None;
    loop {
        let smoothness = before.as_ref().map_or(Vec::new(), |fit| weights(&fit.estimate));
        let from_here = Attempt { starts: &starts, ..*attempt };
        let mut estimate = correct(&from_here, smoothness, &steps)?;
        // what these steps cannot follow leaves the result of those before, whose integration error says what it is worth
        if let Some(fit) = before.filter(|_| estimate.cost.is_none()) {
            return Ok(fit);
        }
        if let Some(stop) = cut.filter(|_| !estimate.termination.is_stopped()) {
            estimate.termination = stop.into();
        }
        let reached = from_here.reached(&estimate);
        if options.bare && options.per_interval.is_some() {
            let unjudged = steps.into_iter().map(|steps| Accuracy { steps, error: f64::NAN }).collect();
            return Ok(Fit::new(model.clone(), estimate, unjudged));
        }
        let integration = accuracy(model, runs, &reached, &steps, &estimate.runs)?;
        // a start of many that led nowhere is not worth finer steps
        let lost = options.shared_steps.is_provisional() && !estimate.termination.is_good();
        let fine = lost || integration.iter().all(|a| a.error <= coarse);
        let done = fine || estimate.runs.is_empty() || options.per_interval.is_some() || round == MOST_ROUNDS;
        let last = done || work.stop_after(&estimate.termination).is_some();
        let finer = if last {
            steps.clone()
        } else {
            let chosen = chosen_again(&Attempt { starts: &reached, ..*attempt }, round >= EXPLICIT_ROUNDS)?;
            finer(&steps, &integration, chosen, coarse)
        };
        // where halving does not help there are kinks, or a response on the edge of divergence
        if finer == steps {
            // what ends the work before steps as fine as was promised leaves the best so far
            if let Some(stop) = work.halted().filter(|_| !done && estimate.termination.is_good()) {
                estimate.termination = stop.into();
            }
            return Ok(Fit::new(model.clone(), estimate, integration));
        }
        before = Some(Fit::new(model.clone(), estimate, integration));
        (starts, steps) = (reached, finer);
        round += 1;
    }
}

/// The weights of the axes of smooth tables, as they were chosen.
pub(crate) fn weights(estimate: &Estimate) -> Vec<f64> {
    estimate.smoothing.iter().flat_map(|s| s.weights.iter().copied()).collect()
}

/// Steps that were too coarse give way to better ones.
fn finer(steps: &[Steps], integration: &[Accuracy], chosen: Vec<Accuracy>, coarse: f64) -> Vec<Steps> {
    let better = |((steps, was), chosen): ((&Steps, &Accuracy), Accuracy)| {
        if was.error > coarse && chosen.error < was.error { chosen.steps } else { steps.clone() }
    };
    steps.iter().zip(integration).zip(chosen).map(better).collect()
}

/// Method and steps for values that were reached with steps that are too coarse for them; by the implicit method where that is asked for,
/// suits the model and is no worse than was hoped for.
fn chosen_again(reached: &Attempt<'_>, implicit: bool) -> Result<Vec<Accuracy>, FitError> {
    let Attempt { model, runs, starts, options, work } = *reached;
    let mut chosen = chosen_steps(reached)?;
    if !implicit || options.scheme.is_some() {
        return Ok(chosen);
    }
    let coarse = options.shared_steps.coarse(options.accuracy);
    let radau = StepOptions { scheme: Some(Scheme::Radau), halt: work.halt_from_here(), ..StepOptions::default() };
    for ((run, theta), chosen) in runs.iter().zip(starts).zip(&mut chosen) {
        // a model that it does not suit keeps what it has
        if let Ok(stable) = choose_steps(model.dynamics(), run, theta, &radau.to(options.accuracy))
            && stable.error <= coarse.max(chosen.error)
        {
            *chosen = stable;
        }
    }
    Ok(chosen)
}

/// Method and steps of each run for these values, as accurate as was asked for. What stops the work while they are sought leaves rough
/// ones.
pub(crate) fn chosen_steps(attempt: &Attempt<'_>) -> Result<Vec<Accuracy>, FitError> {
    let Attempt { model, runs, starts, options, work } = *attempt;
    let halt = work.halt_from_here();
    let steps = |(run, theta): (&Run, &Vec<f64>)| {
        let chosen = StepOptions { scheme: options.scheme, halt, ..StepOptions::default() };
        let chosen = choose_steps(model.dynamics(), run, theta, &chosen.to(options.accuracy));
        chosen.map_err(|e| FitError::unsuited(run, e))
    };
    runs.iter().zip(starts).map(steps).collect()
}

/// Runs the iteration once.
fn correct(attempt: &Attempt<'_>, smoothness: Vec<f64>, steps: &[Steps]) -> Result<Estimate, FitError> {
    let mut problem = Problem { smoothness, ..attempt.problem(steps)? };
    estimate(&mut problem, &attempt.options.options, attempt.work).map_err(FitError::Problem)
}

/// Steps in use and their error at the estimates, whose responses are known.
fn accuracy(
    model: &Model,
    runs: &[Run],
    reached: &[Vec<f64>],
    steps: &[Steps],
    fits: &[RunFit],
) -> Result<Vec<Accuracy>, FitError> {
    let one = |(r, ((run, theta), steps)): (usize, ((&Run, &Vec<f64>), &Steps))| {
        let error = match fits.get(r) {
            Some(fit) => error_of(model.dynamics(), run, theta, steps, &fit.response),
            None => integration_error(model.dynamics(), run, theta, steps.clone()),
        };
        let error = error.map_err(|e| FitError::unsuited(run, e))?;
        Ok(Accuracy { steps: steps.clone(), error })
    };
    runs.iter().zip(reached).zip(steps).enumerate().map(one).collect()
}

/// Every output of every run whose integration error at the estimates is above 1e-3 of its range, or may move an estimate by as much as its error.
pub(crate) fn integration_faults(
    fit: &Fit,
    runs: &[Run],
    starts: &[Vec<f64>],
) -> Result<Vec<IntegrationFault>, FitError> {
    let q = fit.model.definition().outputs.len();
    // the error of every sample is taken for the worst one first; that of a record without noise is not looked at
    let moving = |r: usize, error: f64| {
        (0..q).any(|o| {
            let response = fit.estimate.runs[r].response.iter().skip(o).step_by(q);
            let matched = fit.estimate.outputs.get(r * q + o).and_then(|m| Some((m.rms?, m.compared)));
            matched.is_some_and(|(rms, n)| is_moving(error * output_range(response) * (n as f64).sqrt(), rms))
        })
    };
    let coarse =
        |r: usize| fit.integration.get(r).is_some_and(|a| a.error > UNSOUND || a.error > SOUND && moving(r, a.error));
    // in segments the response is not that of the whole run
    if fit.shooting.as_ref().is_some_and(|s| !s.polished) {
        return Ok(fit.integration_faults.clone());
    }
    if fit.estimate.runs.is_empty() || !(0..runs.len()).any(coarse) {
        return Ok(Vec::new());
    }
    let reached = after(&fit.model, runs, &fit.estimate, starts);
    let mut found = Vec::new();
    for r in (0..runs.len()).filter(|r| coarse(*r)) {
        let (run, steps) = (&runs[r], &fit.integration[r].steps);
        let worst = worst_errors(fit.model.dynamics(), run, &reached[r], steps, 0.0);
        let of = IntegrationFault::of(fit, run, &worst.map_err(|e| FitError::unsuited(run, e))?);
        found.extend(
            of.into_iter().filter(|fault| {
                fault.part > UNSOUND || fault.part > SOUND && fault.shift.is_some() && fault.is_severe()
            }),
        );
    }
    Ok(found)
}
