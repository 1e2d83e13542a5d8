//! Where an attempt starts: all parameters of each run, from the model, the data, or an estimate before.

use crate::estimate::changes::Changes;
use crate::estimate::estimate::Estimate;
use crate::estimate::initial::initial_guess;
use crate::model::Model;
use crate::record::Run;

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

/// The estimates as start values; `starts` where nothing was estimated.
pub(in crate::estimate) fn after(
    model: &Model,
    runs: &[Run],
    estimate: &Estimate,
    starts: &[Vec<f64>],
) -> Vec<Vec<f64>> {
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
