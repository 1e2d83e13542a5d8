//! The road from a model and its runs to estimates: start values, steps, iteration, and a second look at the steps.

use super::changes::{ChangeError, Changes};
use super::derived::DerivedQuantities;
use super::estimate::Estimate;
use super::initial::initial_guess;
use super::problem::{Options, Problem, ProblemError, ProblemRun};
use super::progress::Observer;
use super::solve::estimate;
use super::termination::Termination;
use crate::model::Model;
use crate::record::Run;
use crate::simulate::{Accuracy, Scheme, Simulator, Steps, Unsuited, choose_steps_by, integration_error};
use std::fmt;

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
}

/// Estimates, and how the runs were simulated.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The model with the changes that were asked for.
    pub model: Model,
    /// The estimates.
    pub estimate: Estimate,
    /// Steps and integration error of each run at the estimates.
    pub integration: Vec<Accuracy>,
}

/// Why nothing was estimated: every reason that was found.
#[derive(Debug, Clone, PartialEq)]
pub enum FitError {
    /// Changes that cannot be made.
    Changes(Vec<ChangeError>),
    /// A run that cannot be simulated with exact derivatives.
    Unsuited {
        /// Name of the run.
        run: String,
        /// Why.
        reason: Unsuited,
    },
    /// A problem that cannot be solved.
    Problem(Vec<ProblemError>),
}

impl fmt::Display for FitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = |reasons: Vec<String>| reasons.join("\n");
        match self {
            Self::Changes(e) => write!(f, "{}", lines(e.iter().map(ToString::to_string).collect())),
            Self::Unsuited { run, reason } => write!(f, "run `{run}`: {reason}"),
            Self::Problem(e) => write!(f, "{}", lines(e.iter().map(ToString::to_string).collect())),
        }
    }
}

impl std::error::Error for FitError {}

/// Integration errors at the estimates above this part of an output's range are worth another round with finer steps.
const COARSE: f64 = 1e-7;
const MOST_ROUNDS: usize = 3;

/// Fits a model to runs: all that `fdm fit` does, but reading and printing.
///
/// Steps are chosen at the start values and then kept, so that the derivatives are exact; when they turn out too coarse at the
/// estimates, the fit goes on from there with finer ones.
///
/// # Errors
/// [`FitError`]; a fit that ran and went wrong is an [`Estimate`] with its [`Termination`].
pub fn fit(model: &Model, runs: &[Run], options: &FitOptions, observer: &mut dyn Observer) -> Result<Fit, FitError> {
    let mut params = model.definition().params.clone();
    options.changes.apply(&mut params).map_err(FitError::Changes)?;
    let model = model.with_params(params);
    let mut starts: Vec<Vec<f64>> = runs.iter().map(|run| start(&model, run, &options.changes)).collect();
    let mut steps = Vec::with_capacity(runs.len());
    for (run, theta) in runs.iter().zip(&starts) {
        steps.push(match options.per_interval {
            Some(per_interval) => Steps::equal(options.scheme.unwrap_or_default(), per_interval),
            None => choose_steps_by(model.dynamics(), run, theta, options.scheme).map_err(|e| unsuited(run, e))?.steps,
        });
    }
    let mut round = 1;
    loop {
        let estimate = estimate_once(&model, runs, &starts, &steps, &options.options, observer)?;
        let integration = check(&model, runs, &estimate, &starts, &steps)?;
        let fine = integration.iter().all(|a| a.error <= COARSE);
        let stopped = estimate.runs.is_empty() || estimate.termination == Termination::Interrupted;
        if fine || stopped || options.per_interval.is_some() || round == MOST_ROUNDS {
            return Ok(Fit { model, estimate, integration });
        }
        let mut finer = steps.clone();
        for (k, run) in runs.iter().enumerate() {
            starts[k] = at(&model, &estimate, &run.name, &starts[k]);
            let chosen = choose_steps_by(model.dynamics(), run, &starts[k], options.scheme);
            let chosen = chosen.map_err(|e| unsuited(run, e))?;
            if integration[k].error > COARSE && chosen.error < integration[k].error {
                finer[k] = chosen.steps;
            }
        }
        if finer == steps {
            // halving does not help: kinks, or a response on the edge of divergence
            return Ok(Fit { model, estimate, integration });
        }
        steps = finer;
        round += 1;
    }
}

/// Start values of all parameters for a run; free initial values from the data unless they were set by hand.
fn start(model: &Model, run: &Run, changes: &Changes) -> Vec<f64> {
    let mut theta = initial_guess(&model.definition().params, model.dynamics(), run);
    for (k, param) in model.definition().params.iter().enumerate() {
        if changes.set.iter().any(|(name, _)| *name == param.quantity.name) {
            theta[k] = param.value;
        }
    }
    theta
}

fn estimate_once(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    steps: &[Steps],
    options: &Options,
    observer: &mut dyn Observer,
) -> Result<Estimate, FitError> {
    let mut prepared = Vec::with_capacity(runs.len());
    for ((run, theta), steps) in runs.iter().zip(starts).zip(steps) {
        let simulator = Simulator::new(model.dynamics(), run, steps.clone());
        let simulator = simulator.map_err(|e| unsuited(run, e))?;
        let (name, measured, start) = (run.name.clone(), run.measured.clone(), theta.clone());
        prepared.push(ProblemRun { name, response: Box::new(simulator), measured, start });
    }
    let derived = DerivedQuantities::of(model.definition(), model.dynamics());
    let mut problem = Problem::new(model.definition(), prepared, derived);
    if let Some(first) = starts.first() {
        // shared parameters go on from where a round before left them
        problem.params.iter_mut().zip(first).filter(|(p, _)| !p.per_run).for_each(|(p, v)| p.value = *v);
    }
    estimate(&mut problem, options, observer).map_err(FitError::Problem)
}

/// Steps in use and their error at the estimates.
fn check(
    model: &Model,
    runs: &[Run],
    estimate: &Estimate,
    starts: &[Vec<f64>],
    steps: &[Steps],
) -> Result<Vec<Accuracy>, FitError> {
    let one = |((run, start), steps): ((&Run, &Vec<f64>), &Steps)| {
        let theta = at(model, estimate, &run.name, start);
        let error = integration_error(model.dynamics(), run, &theta, steps.clone());
        let error = error.map_err(|e| unsuited(run, e))?;
        Ok(Accuracy { steps: steps.clone(), error })
    };
    runs.iter().zip(starts).zip(steps).map(one).collect()
}

/// All parameters of a run at the estimates.
fn at(model: &Model, estimate: &Estimate, run: &str, start: &[f64]) -> Vec<f64> {
    let params = model.definition().params.iter().zip(start);
    params
        .map(|(p, start)| {
            let owner = p.per_run.then_some(run);
            estimate.parameter(&p.quantity.name, owner).map_or(*start, |e| e.value)
        })
        .collect()
}

fn unsuited(run: &Run, reason: Unsuited) -> FitError {
    FitError::Unsuited { run: run.name.clone(), reason }
}
