//! One attempt at a fit: everything that it takes.

use super::options::FitOptions;
use crate::estimation::estimate::Estimate;
use crate::work::Work;
use fdm_system::model::Model;
use fdm_system::record::Run;

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

impl Attempt<'_> {
    /// The estimates as start values: all parameters of each run; its start where nothing was estimated.
    pub(crate) fn reached(&self, estimate: &Estimate) -> Vec<Vec<f64>> {
        after(self.model, self.runs, estimate, self.starts)
    }
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
