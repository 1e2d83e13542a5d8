//! One attempt at a fit: everything that it takes.

use super::error::FitError;
use super::options::FitOptions;
use crate::estimation::estimate::Estimate;
use crate::problem::derived::DerivedQuantities;
use crate::problem::response::RunResponse;
use crate::problem::{Problem, ProblemRun};
use crate::work::Work;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, Steps};

/// A model and runs, where its parameters begin, how they are estimated, and the work that this is. Another attempt is this one with
/// something else in it: `Attempt { starts: &reached, ..attempt }`.
#[derive(Clone, Copy)]
pub struct Attempt<'a> {
    /// The model, with the changes that the options ask for.
    pub model: &'a Model,
    /// The runs.
    pub runs: &'a [Run],
    /// Start values: all parameters of each run (see [`starts`](crate::starts)).
    pub starts: &'a [Vec<f64>],
    /// How it is fitted.
    pub options: &'a FitOptions,
    /// When it ends, and who follows it.
    pub work: &'a Work<'a>,
}

impl<'a> Attempt<'a> {
    /// The problem of these runs with these steps; what all runs share begins where the first one does.
    ///
    /// # Errors
    /// [`FitError::Unsuited`] for a run that the model cannot be simulated on.
    pub(crate) fn problem(&self, steps: &[Steps]) -> Result<Problem<'a>, FitError> {
        let Self { model, runs, starts, options, .. } = *self;
        let one = |((run, theta), steps): ((&'a Run, &Vec<f64>), &Steps)| {
            let response = RunResponse::in_time(suited(model, run, theta, steps.clone())?);
            let (name, measured, start) = (run.name.clone(), run.measured.clone(), theta.clone());
            Ok(ProblemRun { name, response, measured, start })
        };
        let prepared = runs.iter().zip(starts).zip(steps).map(one).collect::<Result<_, FitError>>()?;
        let derived = DerivedQuantities::of(model.definition(), model.dynamics());
        let mut problem = Problem { bare: options.bare, ..Problem::new(model.definition(), prepared, derived) };
        if let Some(first) = starts.first() {
            problem.params.iter_mut().zip(first).filter(|(p, _)| !p.per_run).for_each(|(p, v)| p.value = *v);
        }
        Ok(problem)
    }

    /// The estimates as start values: all parameters of each run; its start where nothing was estimated.
    pub(crate) fn reached(&self, estimate: &Estimate) -> Vec<Vec<f64>> {
        after(self.model, self.runs, estimate, self.starts)
    }
}

/// The simulator of a run, which these parameters suit.
///
/// # Errors
/// [`FitError::Unsuited`]
pub(crate) fn suited<'a>(
    model: &'a Model,
    run: &'a Run,
    theta: &[f64],
    steps: Steps,
) -> Result<Simulator<'a>, FitError> {
    let mut simulator = Simulator::new(model.dynamics(), run, steps).map_err(|e| FitError::unsuited(run, e))?;
    simulator.suits(theta).map_err(|e| FitError::unsuited(run, e))?;
    Ok(simulator)
}

/// The estimates as start values; `starts` where nothing was estimated.
pub(crate) fn after(model: &Model, runs: &[Run], estimate: &Estimate, starts: &[Vec<f64>]) -> Vec<Vec<f64>> {
    runs.iter().zip(starts).map(|(run, start)| at(model, estimate, &run.name, start)).collect()
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
