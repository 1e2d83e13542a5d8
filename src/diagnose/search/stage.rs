//! A model at its fit: what candidates are compared with.

use super::evenly::interval;
use super::search_error::SearchError;
use crate::diagnose::screen::{Record, Signals};
use crate::dynamics::Dynamics;
use crate::model::Model;
use crate::record::Run;
use crate::simulate::{Divergence, Simulator, Steps, choose_steps_within};
use fdm_grammar::effect::Subject;
use fdm_grammar::model::Param;

/// Part of the noise's deviation that an integration error may have.
const HIDDEN: f64 = 0.02;
/// And of an output's range, at most.
const ROUGHEST: f64 = 1e-4;

/// A model with its text, the values of its parameters, and its responses.
pub(super) struct Stage {
    /// The model.
    pub(super) model: Model,
    /// Its text.
    pub(super) subject: Subject,
    /// All parameters (p) of each run.
    pub(super) theta: Vec<Vec<f64>>,
    /// How each run is integrated.
    pub(super) steps: Vec<Steps>,
    /// Outputs of each run, N by q.
    pub(super) response: Vec<Signals>,
}

impl Stage {
    /// The model at `theta`; every run must have a response there.
    pub(super) fn new(model: Model, runs: &[Run], theta: Vec<Vec<f64>>) -> Result<Self, SearchError> {
        let subject = Subject::new(model.source(), model.definition()).map_err(SearchError::Text)?;
        let (mut steps, mut response) = (Vec::new(), Vec::new());
        let tolerance = tolerance(runs, model.layout().outputs);
        for (run, theta) in runs.iter().zip(&theta) {
            let unsuited = |reason| SearchError::Unsuited { run: run.name.clone(), reason };
            let chosen = choose_steps_within(model.dynamics(), run, theta, tolerance).map_err(unsuited)?.steps;
            let mut simulator = Simulator::new(model.dynamics(), run, chosen.clone()).map_err(unsuited)?;
            simulator.suits(theta).map_err(unsuited)?;
            let mut y = vec![0.0; simulator.samples() * simulator.outputs()];
            let diverged =
                |d: Divergence| SearchError::NoFit(format!("run `{}` diverges at time {}", run.name, d.time));
            simulator.simulate(theta, &mut y).map_err(diverged)?;
            steps.push(chosen);
            response.push(y);
        }
        Ok(Self { model, subject, theta, steps, response })
    }

    /// Number of outputs.
    pub(super) fn outputs(&self) -> usize {
        self.model.layout().outputs
    }

    /// Its parameters.
    pub(super) fn params(&self) -> &[Param] {
        &self.model.definition().params
    }
}

/// The integration error that noise hides, as a part of an output's range: by the second differences of what was measured.
fn tolerance(runs: &[Run], outputs: usize) -> f64 {
    let of = |run: &Run, o: usize| -> Option<f64> {
        let values: Vec<f64> = run.measured.iter().skip(o).step_by(outputs).copied().filter(|z| !z.is_nan()).collect();
        let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        let bends = values.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]);
        let square = bends.map(|b| b * b).sum::<f64>() / (6.0 * values.len().saturating_sub(2) as f64);
        (high > low && square.is_finite()).then(|| square.sqrt() / (high - low))
    };
    let each = runs.iter().flat_map(|run| (0..outputs).filter_map(move |o| of(run, o)));
    let least = each.fold(f64::INFINITY, f64::min);
    (HIDDEN * least).min(ROUGHEST)
}

/// Residuals and sensitivities of a run as screening sees them, without directions; with the response.
///
/// `columns` are the parameters that all runs share and those of each run, `place` is that of the run among so many.
pub(super) fn record(
    dynamics: &dyn Dynamics,
    run: &Run,
    (steps, theta): (&Steps, &[f64]),
    (shared, own): (&[usize], &[usize]),
    (place, runs): (usize, usize),
) -> Result<(Record, Signals), SearchError> {
    let columns: Vec<usize> = shared.iter().chain(own).copied().collect();
    let unsuited = |reason| SearchError::Unsuited { run: run.name.clone(), reason };
    let mut simulator = Simulator::new(dynamics, run, steps.clone()).map_err(unsuited)?;
    let stride = columns.len().next_multiple_of(8);
    let cells = simulator.samples() * simulator.outputs();
    let (mut y, mut jacobian) = (vec![0.0; cells], vec![0.0; cells * stride]);
    let no = |_| SearchError::NoFit(format!("run `{}` has no derivatives at the estimates", run.name));
    simulator.sensitivities(theta, &columns, &mut y, &mut jacobian).map_err(no)?;
    let column = |c: usize| -> Signals { jacobian.chunks_exact(stride.max(1)).map(|row| row[c]).collect() };
    let mut fitted: Vec<Option<Signals>> = (0..shared.len()).map(|c| Some(column(c))).collect();
    for other in 0..runs {
        fitted.extend((0..own.len()).map(|c| (other == place).then(|| column(shared.len() + c))));
    }
    let residual = run.measured.iter().zip(&y).map(|(z, y)| z - y).collect();
    Ok((Record { interval: interval(run), residual, fitted, directions: Vec::new() }, y))
}

/// Free parameters (by index): those that all runs share, those of each run.
pub(super) fn free(params: &[Param]) -> (Vec<usize>, Vec<usize>) {
    let pick = |own: bool| {
        let chosen = params.iter().enumerate().filter(move |(_, p)| !p.fixed && p.per_run == own);
        chosen.map(|(k, _)| k).collect()
    };
    (pick(false), pick(true))
}
