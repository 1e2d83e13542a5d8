//! The road from a model and its runs to estimates: start values, then one attempt (steps, iteration, second look at the
//! steps, rescue), then what was asked about the confidence in its result.

use super::attempt::attempt;
use super::fit_error::FitError;
use super::ledger::Ledger;
use super::plain::chosen_steps;
use super::stages::Stages;
use super::start::starts;
use super::starts::{MultiStart, StartSummary, many_starts};
use crate::estimate::changes::Changes;
use crate::estimate::estimate::{Estimate, RunFit};
use crate::estimate::keeper::Keeper;
use crate::estimate::problem::Options;
use crate::estimate::progress::Observer;
use crate::estimate::road::footing::Footing;
use crate::estimate::strategy::continuation::Continuation;
use crate::estimate::strategy::lengths::{LengthFit, shortened};
use crate::estimate::strategy::rescue::Rescue;
use crate::estimate::strategy::reweighting::{Reweighting, reweighted};
use crate::estimate::strategy::shooting::{Continuity, Shooting};
use crate::model::Model;
use crate::quality::{OutputQuality, run_quality};
use crate::record::Run;
use crate::simulate::{Accuracy, Scheme};

/// What a user may choose about a fit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FitOptions {
    /// Start values, and which parameters are fixed and free.
    pub changes: Changes,
    /// How to estimate.
    pub options: Options,
    /// Equal steps between neighbouring samples; chosen for accuracy when not given.
    pub per_interval: Option<usize>,
    /// How to integrate; chosen for accuracy and speed when not given.
    pub scheme: Option<Scheme>,
    /// Whether and how the record is lengthened from a short one.
    pub continuation: Continuation,
    /// States whose measured record takes their place in the equations of a first fit, whose result starts the fit of the
    /// full model; `all` for every state that is measured.
    pub substitute: Vec<String>,
    /// Whether and how the record is cut for multiple shooting.
    pub shooting: Option<Shooting>,
    /// Fit shorter records too and order the parameters by confidence ([`Fit::by_length`]).
    pub confidence: bool,
    /// Fit with other weights of the outputs too ([`Fit::reweighting`]).
    pub reweight: bool,
    /// From how many starts to fit.
    pub starts: MultiStart,
    /// Steps that these starts have in common.
    pub footing: Footing,
    /// Estimates and their errors alone: the residuals are not judged, nor is the integration where its steps were given
    /// (its error is then not a number). For fits by the thousand.
    pub bare: bool,
}

impl FitOptions {
    /// The same, but noise that the model declares is known where all variances were to be estimated.
    pub fn with_declared_noise(mut self, model: &Model) -> Self {
        self.options.noise = self.options.noise.or_declared(&model.definition().outputs);
        self
    }
}

/// Estimates, and how they were reached.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The model with the changes that were asked for.
    pub model: Model,
    /// The estimates.
    pub estimate: Estimate,
    /// Steps and integration error of each run at the estimates.
    pub integration: Vec<Accuracy>,
    /// What the residuals say: every output of every run, runs outermost; empty when nothing could be simulated, or when that
    /// was not asked for.
    pub quality: Vec<OutputQuality>,
    /// What was done about start values that could not be used, and why; none when they could.
    pub rescue: Option<Rescue>,
    /// Estimates by length of the record, the whole record's last; empty when only that was fitted.
    pub by_length: Vec<LengthFit>,
    /// Estimates with other weights of the outputs; none when that was not asked for, or there was no noise to weigh.
    pub reweighting: Option<Reweighting>,
    /// States whose measured records took their place in a first fit, because that was asked for.
    pub substituted: Vec<String>,
    /// How continuous the result of multiple shooting is; none when there was none.
    pub shooting: Option<Continuity>,
    /// What came out of each start; empty when there was only one. Those that an interruption prevented are missing.
    pub starts: Vec<StartSummary>,
}

impl Fit {
    /// A plain fit, without a rescue and without anything said about confidence.
    pub(in crate::estimate) fn new(model: Model, estimate: Estimate, integration: Vec<Accuracy>) -> Self {
        Self {
            model,
            estimate,
            integration,
            quality: Vec::new(),
            rescue: None,
            by_length: Vec::new(),
            reweighting: None,
            substituted: Vec::new(),
            shooting: None,
            starts: Vec::new(),
        }
    }
}

/// Fits a model to runs: all that `fdm fit` does, but reading and printing.
///
/// # Errors
/// [`FitError`]; a fit that ran and went wrong is an [`Estimate`] with its [`Termination`](crate::estimate::Termination).
pub fn fit(model: &Model, runs: &[Run], options: &FitOptions, observer: &mut dyn Observer) -> Result<Fit, FitError> {
    fit_kept(model, runs, options, None, observer)
}

/// As [`fit()`], keeping its state with `keeper` while it works: the same fit with what was kept goes on where it was
/// interrupted and ends with the same bits. A keeper that fails does not stop the fit.
///
/// # Errors
/// As [`fit()`].
pub fn fit_kept(
    model: &Model,
    runs: &[Run],
    options: &FitOptions,
    keeper: Option<&dyn Keeper>,
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    let model = without_noise(&changed(model, &options.changes)?);
    let mut options = options.clone().with_declared_noise(&model);
    let mut start = starts(&model, runs, &options.changes);
    let ledger = Ledger::new(keeper);
    let (mut name, mut summaries, mut states) = (String::from("fit"), Vec::new(), Vec::new());
    if options.starts.count > 1 {
        options.footing = footing(&model, runs, &start, &options)?;
        let many = many_starts(&model, runs, &start, &options, &ledger, observer)?;
        name = format!("fit-{}", many.number);
        (summaries, start, states) = (many.summaries, many.start, many.states);
    }
    // of two lists of states of one attempt the longer one is further on
    let kept = ledger.find(&name).states;
    states = if kept.len() > states.len() { kept } else { states };
    let mut stages = Stages::new(observer, &ledger, name, states);
    let found = attempt(&model, runs, &start, &options, &mut stages)
        .and_then(|fit| examined(fit, runs, &start, &options, &mut stages));
    ledger.flush();
    Ok(Fit { starts: summaries, ..found? })
}

/// The steps that all starts have in common.
fn footing(model: &Model, runs: &[Run], given: &[Vec<f64>], options: &FitOptions) -> Result<Footing, FitError> {
    match options.per_interval {
        Some(_) => Ok(Footing::default()),
        None => chosen_steps(model, runs, given, options.scheme).map(Footing::of),
    }
}

/// Adds what was asked about the confidence in a fit (estimates by length, and by other weights), and judges its residuals.
///
/// # Errors
/// As for [`fit()`].
pub fn examined(
    mut fit: Fit,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    if !options.bare {
        let judge = |(run, result): (&Run, &RunFit)| run_quality(&fit.model, run, &result.response);
        fit.quality = runs.iter().zip(&fit.estimate.runs).flat_map(judge).collect();
    }
    let sound = fit.estimate.termination.is_good();
    if options.confidence && sound {
        fit.by_length = shortened(&fit, runs, starts, options, observer)?;
    }
    if options.reweight && sound {
        fit.reweighting = reweighted(&fit, runs, starts, options, observer)?;
    }
    Ok(fit)
}

/// The model with the intensities of noises held: they move no response, so that output error says nothing of them.
fn without_noise(model: &Model) -> Model {
    let only = model.definition().only_in_noise();
    if !only.contains(&true) {
        return model.clone();
    }
    let mut params = model.definition().params.clone();
    params.iter_mut().zip(only).filter(|(_, only)| *only).for_each(|(p, _)| p.fixed = true);
    model.with_params(params)
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
