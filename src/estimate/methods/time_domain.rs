//! Output error in the time domain, whole: start values, one fit or many, fallback strategies, then what was asked about the
//! confidence in the result; and what a result predicts of other runs.

use super::output_error::options::{Attempt, after};
use crate::estimation::RunFit;
use crate::estimation::smoothness::add_tables;
use crate::examined::interpolation::{compare, uncompared};
use crate::examined::stated_initials::doubted_initials;
use crate::examined::unexplained::few_samples;
use crate::methods::output_error::cross_validation::weights_by_validation;
use crate::methods::output_error::error::{FitError, StrategyError};
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::noise_model::{deviations, unlimited, without_infinite};
use crate::methods::output_error::options::{FitOptions, SharedSteps};
use crate::methods::output_error::robust::mistake;
use crate::methods::output_error::single::{changed, chosen_steps, integration_faults, starts};
use crate::problem::Options;
use crate::problem::method::{Domain, Method, SmoothBy};
use crate::problem::noise::Noise;
use crate::problem::unknowns::Changes;
use crate::recovery::confidence::{fit_shorter_records, refit_with_weights};
use crate::recovery::fallback::attempt;
use crate::recovery::fallback::unless_interpolable;
use crate::recovery::fallback::{completed, without_noise};
use crate::recovery::multi_start::{StartSearch, many_starts, unbounded};
use crate::residuals::run_quality;
use crate::work::Budget;
use crate::work::Work;
use crate::work::checkpoint::{CheckpointWriter, EstimationStates};
use fdm_grammar::model::Origin;
use fdm_system::model::Model;
use fdm_system::record::{Censored, Run};
use fdm_system::simulate::Steps;
use std::borrow::Cow;

/// Fits a model to runs: all that `fdm fit` does, but reading and printing. Where the work keeps its state, the same fit goes on
/// from there.
///
/// # Errors
/// [`FitError`]; a fit that ran and went wrong is an [`Estimate`](crate::Estimate) with its [`Termination`](crate::Termination).
pub fn fit(model: &Model, runs: &[Run], options: &FitOptions, work: &Work<'_>) -> Result<Fit, FitError> {
    let Ready { given, model, runs, mut start, mut options } = Ready::of(model, runs, options, work)?;
    let runs = &runs[..];
    let ledger = CheckpointWriter::new(work.store());
    let (mut name, mut summaries, mut states, mut reached) = (String::from("fit"), Vec::new(), Vec::new(), None);
    if options.starts.count > 1 {
        options.shared_steps = shared_steps(&Attempt { model: &model, runs, starts: &start, options: &options, work })?;
        let given_start = Attempt { model: &model, runs, starts: &start, options: &options, work };
        let many = many_starts(&given_start, &given, &ledger)?;
        name = format!("fit-{}", many.number);
        (summaries, start, states, reached) = (many.summaries, many.start, many.states, many.reached);
    }
    // of two lists of states of one attempt the longer one is further on
    let kept = ledger.find(&name).states;
    states = if kept.len() > states.len() { kept } else { states };
    let budget = Budget::new(work, options.options.total);
    let states = EstimationStates::new(&ledger, name, states);
    let work = &work.within(&budget).with_states(&states);
    let first = &Attempt { model: &model, runs, starts: &start, options: &options, work };
    let found = attempt(first)
        .and_then(|fit| completed(&Attempt { model: &given, ..*first }, reached.as_deref(), fit))
        .and_then(|fit| unless_interpolable(fit, first))
        .and_then(|fit| examined(fit, first));
    ledger.flush();
    let mut found = found?;
    if found.estimate.degenerate.is_empty() {
        found.estimate.degenerate = unbounded(&summaries, found.estimate.cost);
    }
    Ok(Fit { starts: summaries, ..found })
}

/// The starts of a fit, each to be attempted by itself: [`fit()`] goes on from what came out of them.
///
/// # Errors
/// As [`fit()`].
pub fn start_search(
    model: &Model,
    runs: &[Run],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<StartSearch, FitError> {
    let Ready { given, model, runs, start, mut options } = Ready::of(model, runs, options, work)?;
    let first = Attempt { model: &model, runs: &runs, starts: &start, options: &options, work };
    options.shared_steps = shared_steps(&first)?;
    Ok(StartSearch::of((model, given), &runs, start, &options))
}

/// A fit that can begin.
struct Ready<'r> {
    /// The model with the changes that were asked for.
    given: Model,
    /// The model with the changes that were asked for, and the parameters of noises held.
    model: Model,
    /// The runs without samples whose noise is infinite.
    runs: Cow<'r, [Run]>,
    start: Vec<Vec<f64>>,
    options: FitOptions,
}

impl<'r> Ready<'r> {
    fn of(model: &Model, runs: &'r [Run], options: &FitOptions, work: &Work<'_>) -> Result<Self, FitError> {
        if (options.method, options.domain) != (Method::OutputError, Domain::Time) {
            return Err(FitError::Method { method: options.method, domain: options.domain });
        }
        let given = changed(model, &options.changes)?;
        let model = without_noise(&given);
        let mut options = options.clone().with_declared_noise(&model);
        let deviations = deviations(&model, &options.options.noise, &options.censored);
        let unlimited = deviations.as_ref().and_then(|d| unlimited(&model, &options, d));
        if let Some(mistake) = unlimited.or_else(|| mistake(&options, deviations.is_some())) {
            return Err(FitError::Strategy(mistake));
        }
        let start = starts(&model, runs, &options.changes);
        let known = deviations.as_ref().map(|d| without_infinite(&model, runs, &start, d, work)).transpose()?;
        let runs = known.map_or(Cow::Borrowed(runs), Cow::Owned);
        if let Some(refused) = smoothing_mistake(&model, &options.options.smooth_by, runs.len()) {
            return Err(FitError::Strategy(refused));
        }
        if options.options.smooth_by == SmoothBy::Validation {
            let weights = weights_by_validation(&Attempt {
                model: &model,
                runs: &runs,
                starts: &start,
                options: &options,
                work,
            })?;
            options.options.smooth_by = weights.map_or(SmoothBy::Likelihood, SmoothBy::Weights);
        }
        Ok(Self { given, model, runs, start, options })
    }
}

/// Why the smoothness of tables cannot be chosen so.
fn smoothing_mistake(model: &Model, smooth_by: &SmoothBy, runs: usize) -> Option<StrategyError> {
    let smooth = model.definition().tables.iter().filter(|t| t.smooth.is_some());
    let wanted = smooth.map(|t| t.arguments.len()).sum();
    match smooth_by {
        SmoothBy::Validation if wanted > 0 && runs < 2 => Some(StrategyError::SmoothByOneRun),
        SmoothBy::Weights(given) if given.len() != wanted || given.iter().any(|w| !(*w > 0.0 && w.is_finite())) => {
            Some(StrategyError::SmoothWeights { given: given.len(), wanted })
        }
        _ => None,
    }
}

/// Fits from start values, by the noise that the model states and the loss that was asked for, and judges nothing.
///
/// # Errors
/// [`FitError`]; an attempt that ran and went wrong is a [`Fit`] whose estimate says so.
pub fn fit_from(start: &Attempt<'_>) -> Result<Fit, FitError> {
    let Attempt { model, runs, starts, options, work } = *start;
    let squares = without_noise(model);
    let deviations = deviations(model, &options.options.noise, &options.censored);
    let known = deviations.as_ref().map(|d| without_infinite(&squares, runs, starts, d, work)).transpose()?;
    let runs = known.as_deref().unwrap_or(runs);
    let start = Attempt { runs, ..*start };
    let first = attempt(&Attempt { model: &squares, ..start })?;
    completed(&start, None, first)
}

/// The steps that all starts have in common.
fn shared_steps(given: &Attempt<'_>) -> Result<SharedSteps, FitError> {
    match given.options.per_interval {
        Some(_) => Ok(SharedSteps::default()),
        None => chosen_steps(&Attempt { work: &Work::default(), ..*given }).map(SharedSteps::of),
    }
}

/// Adds what was asked about the confidence in a fit (estimates by length, and by other weights), and judges its residuals.
///
/// # Errors
/// As for [`fit()`].
pub(crate) fn examined(mut fit: Fit, attempt: &Attempt<'_>) -> Result<Fit, FitError> {
    let Attempt { runs, starts, options, work, .. } = *attempt;
    if !options.bare {
        work.doing("judging the residuals");
        let judge = |(run, result): (&Run, &RunFit)| run_quality(&fit.model, run, &result.response);
        fit.quality = runs.iter().zip(&fit.estimate.runs).flat_map(judge).collect();
        for (k, quality) in fit.quality.iter_mut().enumerate() {
            let output = k % fit.model.definition().outputs.len().max(1);
            let of = |c: &&Censored| c.output == output && c.run == quality.fit.run;
            let censored = options.censored.iter().filter(of).count();
            *quality = quality.clone().with_censored(censored);
        }
    }
    fit.integration_faults = integration_faults(&fit, runs, starts)?;
    let chosen = options.per_interval.is_none() && options.scheme.is_none();
    fit.integration_faults.iter_mut().for_each(|fault| fault.chosen = chosen);
    if !options.bare {
        let thetas = after(&fit.model, runs, &fit.estimate, starts);
        let steps: Vec<Steps> = fit.integration.iter().map(|a| a.steps.clone()).collect();
        add_tables(&mut fit.estimate, &fit.model, runs, &thetas, &steps);
        // in segments the response is not that of the whole run
        if fit.estimate.termination.is_good() && fit.shooting.as_ref().is_none_or(|s| s.polished) {
            fit.few_samples = few_samples(&fit, runs, &thetas);
            fit.doubted_initials = doubted_initials(&fit, &Attempt { starts: &thetas, ..*attempt })?;
            match fit.loss.is_squares() && fit.noise_of_samples.is_empty() {
                true if options.options.colour => {
                    fit.interpolations = compare(&fit, &Attempt { starts: &thetas, ..*attempt });
                }
                true => {}
                false => fit.uncompared_inputs = uncompared(&fit.model, runs),
            }
        }
    }
    let sound = fit.estimate.termination.is_good();
    if options.confidence && sound && work.goes_on() {
        work.doing("fitting shorter records");
        fit.by_length = fit_shorter_records(&fit, attempt)?;
    }
    if options.reweight && sound && work.goes_on() {
        work.doing("fitting with other weights");
        fit.reweighting = refit_with_weights(&fit, attempt)?;
    }
    Ok(fit)
}

impl Fit {
    /// What the estimates predict of runs that took no part: what all runs share is held, initial states and biases are
    /// each run's own, estimated by the noise that is given.
    ///
    /// # Errors
    /// [`FitError`], as any fit.
    pub fn predict(&self, runs: &[Run], noise: Noise, work: &Work<'_>) -> Result<Fit, FitError> {
        let params = self.model.definition().params.iter();
        let shared = params.filter(|p| !p.per_run && !p.fixed && p.origin == Origin::Declared);
        let names: Vec<String> = shared.map(|p| p.quantity.name.clone()).collect();
        let value = |name: &String| Some((name.clone(), self.estimate.parameter(name, None)?.value));
        let changes = Changes { set: names.iter().filter_map(value).collect(), fix: names, ..Changes::default() };
        let options = Options { colour: false, noise, ..Options::default() };
        fit(&self.model, runs, &FitOptions { changes, options, ..FitOptions::default() }, &work.unkept())
    }
}
