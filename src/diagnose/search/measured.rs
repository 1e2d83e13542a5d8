//! What effects ask of the data: sizes, quantiles and speeds of signals, the sampling step, the length of the record.

use super::evenly::interval;
use super::round::Runs;
use super::stage::Stage;
use super::way::Way;
use crate::code::{Engine, compile};
use crate::record::Run;
use crate::simulate::Simulator;
use fdm_grammar::Schedule;
use fdm_grammar::effect::{Beginning, Scales};
use fdm_grammar::graph::Leaf;
use fdm_grammar::model::Output;
use std::collections::BTreeMap;

/// Magnitudes below this part of the largest one count as rest.
const REST: f64 = 1e-6;

/// Inputs as recorded, states and outputs as the fitted model has them; in the frequency domain, which knows no time, outputs as
/// recorded and states as outputs or spectra show them.
#[derive(Debug, Clone, Default)]
pub(super) struct Measured {
    signals: BTreeMap<String, Signal>,
    step: f64,
    duration: f64,
}

/// One signal in all runs.
#[derive(Debug, Clone, Default)]
struct Signal {
    /// Magnitudes of what is not at rest, rising.
    sizes: Vec<f64>,
    /// Magnitudes of the rate of change where it changes, rising.
    speeds: Vec<f64>,
    /// The value at the first sample of each run.
    first: Vec<f64>,
}

impl Measured {
    pub(super) fn new(stage: &Stage, runs: Runs<'_>) -> Self {
        let runs = runs.all;
        let definition = stage.model.definition();
        let mut found = Self::default();
        for run in runs {
            found.step = if found.step > 0.0 { found.step.min(interval(run)) } else { interval(run) };
            let length = run.time.last().copied().unwrap_or(0.0) - run.time.first().copied().unwrap_or(0.0);
            found.duration = found.duration.max(length);
        }
        let inputs: Vec<&str> = definition.inputs.iter().map(|i| i.quantity.name.as_str()).collect();
        let outputs: Vec<&str> = definition.outputs.iter().map(|o| o.quantity.name.as_str()).collect();
        let states: Vec<&str> = definition.states.iter().map(|s| s.quantity.name.as_str()).collect();
        let recorded: Vec<Vec<f64>> = runs.iter().map(|r| r.inputs.clone()).collect();
        let (traced, shown) = states_and_outputs(stage, runs);
        for (names, values) in [(&outputs, &shown), (&states, &traced), (&inputs, &recorded)] {
            for (k, name) in names.iter().enumerate() {
                let columns = values.iter().map(|rows| rows.iter().skip(k).step_by(names.len()).copied().collect());
                found.signals.insert((*name).to_string(), Signal::new(columns.collect(), runs));
            }
        }
        found
    }

    /// The value of a signal at the first sample of a run.
    pub(super) fn first(&self, signal: &str, run: usize) -> f64 {
        self.signals.get(signal).and_then(|s| s.first.get(run)).copied().unwrap_or(0.0)
    }
}

impl Signal {
    fn new(columns: Vec<Vec<f64>>, runs: &[Run]) -> Self {
        let (mut sizes, mut speeds) = (Vec::new(), Vec::new());
        for (values, run) in columns.iter().zip(runs) {
            let dt = interval(run);
            sizes.extend(values.iter().map(|v| v.abs()));
            speeds.extend(values.windows(2).map(|w| (w[1] - w[0]).abs() / dt));
        }
        let first = columns.iter().map(|v| v.first().copied().unwrap_or(0.0)).collect();
        Self { sizes: moving(sizes), speeds: moving(speeds), first }
    }
}

/// What is not at rest, rising.
fn moving(mut values: Vec<f64>) -> Vec<f64> {
    let largest = values.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    values.retain(|v| v.is_finite() && *v > REST * largest);
    values.sort_by(f64::total_cmp);
    values
}

fn quantile(rising: &[f64], q: f64) -> f64 {
    let last = rising.len().saturating_sub(1);
    rising.get((q * last as f64).round() as usize).copied().unwrap_or(0.0)
}

impl Scales for Measured {
    fn size(&self, signal: &str, q: f64) -> f64 {
        self.signals.get(signal).map_or(0.0, |s| quantile(&s.sizes, q))
    }

    fn speed(&self, signal: &str, q: f64) -> f64 {
        self.signals.get(signal).map_or(0.0, |s| quantile(&s.speeds, q))
    }

    fn beginning(&self, signal: &str) -> Beginning {
        let Some(signal) = self.signals.get(signal) else { return Beginning::Same(0.0) };
        let first = signal.first.first().copied().unwrap_or(0.0);
        let size = signal.sizes.last().copied().unwrap_or(0.0);
        let same = signal.first.iter().all(|v| (v - first).abs() <= 1e-9 * size);
        if same { Beginning::Same(first) } else { Beginning::Varies(first) }
    }

    fn step(&self) -> f64 {
        self.step
    }

    fn duration(&self) -> f64 {
        self.duration
    }
}

/// States and outputs of each run (N by n, N by q).
pub(super) fn states_and_outputs(stage: &Stage, runs: &[Run]) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let mut both = (Vec::new(), Vec::new());
    for (run, (way, theta)) in runs.iter().zip(stage.ways.iter().zip(&stage.theta)) {
        match way {
            Way::Steps(_) => return (states_of(stage, runs), stage.response.clone()),
            Way::Lines { lines, run: place } => {
                both.0.push(lines.states(*place, theta, run));
                both.1.push(run.measured.clone());
            }
        }
    }
    both
}

/// States of each run (N by n), by the model with its states as outputs; nothing where that has no response.
fn states_of(stage: &Stage, runs: &[Run]) -> Vec<Vec<f64>> {
    let mut definition = stage.model.definition().clone();
    definition.params.iter_mut().for_each(|p| p.fixed = true);
    definition.derived.clear();
    let states = definition.states.clone();
    let shown = |(k, state): (usize, &fdm_grammar::model::State)| Output {
        quantity: state.quantity.clone(),
        expr: definition.graph.leaf(Leaf::State(k as u32)),
        noise: None,
    };
    let outputs = states.iter().enumerate().map(shown).collect();
    definition.outputs = outputs;
    let dynamics = compile(&Schedule::new(&mut definition), Engine::Tape);
    let of = |(run, (theta, way)): (&Run, (&Vec<f64>, &Way))| {
        let mut x = vec![0.0; run.len() * states.len()];
        let simulator = way.steps().and_then(|steps| Simulator::new(&*dynamics, run, steps.clone()).ok());
        if let Some(mut simulator) = simulator {
            // what comes before a divergence is kept
            let _ = simulator.simulate(theta, &mut x);
        }
        x
    };
    runs.iter().zip(stage.theta.iter().zip(&stage.ways)).map(of).collect()
}
