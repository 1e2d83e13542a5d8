//! An effect written into the model at its fit: which parameter is which, and what values a run has.
//!
//! What effects ask of the data: sizes, quantiles and speeds of signals, the sampling step, the length of the record.

use crate::candidates::error::DiagnosisError;
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::predictor::Predictor;
use crate::candidates::runs::{Runs, interval, is_even};
use crate::diagnosis::EffectAt;
use fdm_effects::forced::Role;
use fdm_effects::{Beginning, Candidate, Choice, Extension, NewParam, Scales};
use fdm_grammar::graph::Leaf;
use fdm_grammar::model::{Output, Param};
use fdm_grammar::{Model as Definition, Schedule};
use fdm_system::code::{Engine, compile};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;
use std::collections::BTreeMap;

/// An effect at its place.
#[derive(Clone)]
pub(crate) struct AttachedEffect {
    /// The effect and its place.
    pub(crate) candidate: Candidate,
    /// The text.
    pub(crate) extension: Extension,
    /// What the text says.
    pub(crate) definition: Definition,
    /// Where each new parameter stands in `definition`.
    pub(crate) new: Vec<usize>,
    /// Where each parameter of the base model stands there.
    old: Vec<usize>,
    /// First values of what new states follow, run by run, of those parameters that are such.
    begins: Vec<Option<Vec<f64>>>,
    /// Whether such a value is recorded, and needs no estimate.
    recorded: Vec<bool>,
}

impl AttachedEffect {
    /// Writes an effect into the model at its fit.
    ///
    /// # Errors
    /// Why it does not fit, in words.
    pub(crate) fn new(
        candidate: &Candidate,
        current: &FittedModel,
        scales: &SignalScales,
        choice: &Choice,
    ) -> Result<Self, String> {
        let extension = candidate.apply(&current.subject, scales, choice).map_err(|d| d.message)?;
        let first =
            |findings: Vec<fdm_grammar::Diagnostic>| findings.first().map_or(String::new(), |f| f.message.clone());
        let definition = extension.model().map_err(first)?;
        let place = |name: &str| definition.param(name).ok_or_else(|| format!("`{name}` is lost in the extended text"));
        let new = extension.params().iter().map(|p| place(&p.name)).collect::<Result<Vec<_>, _>>()?;
        let old = current.params().iter().map(|p| place(&p.quantity.name)).collect::<Result<Vec<_>, _>>()?;
        let begin = |p: &NewParam| {
            let signal = p.begins_as.as_ref()?;
            Some((0..current.theta.len()).map(|run| scales.first(signal, run)).collect())
        };
        let begins = extension.params().iter().map(begin).collect();
        let is_input = |p: &NewParam| {
            let input = |name: &String| current.model.definition().inputs.iter().any(|i| i.quantity.name == *name);
            p.begins_as.as_ref().is_some_and(input)
        };
        let recorded = extension.params().iter().map(is_input).collect();
        Ok(Self { candidate: candidate.clone(), extension, definition, new, old, begins, recorded })
    }

    /// The new parameters.
    pub(crate) fn params(&self) -> &[NewParam] {
        self.extension.params()
    }

    /// The first parameter that is no nuisance: the size of the effect.
    pub(crate) fn size(&self) -> usize {
        self.params().iter().position(|p| !p.nuisance).unwrap_or(0)
    }

    /// Whether a new parameter is estimated when the extended model is fitted.
    pub(crate) fn is_estimated(&self, k: usize) -> bool {
        !self.params()[k].fixed && !self.recorded[k]
    }

    /// All parameters of a run, with these values of the new ones (in their order).
    pub(crate) fn theta(&self, current: &FittedModel, run: usize, values: &[f64]) -> Vec<f64> {
        self.theta_from(&current.theta[run], run, values)
    }

    /// All parameters of a run, with these values of the base model's parameters and of the new ones.
    pub(crate) fn theta_from(&self, base: &[f64], run: usize, values: &[f64]) -> Vec<f64> {
        let mut theta = self.definition.start();
        for (k, value) in self.old.iter().zip(base) {
            theta[*k] = *value;
        }
        for (k, (at, value)) in self.new.iter().zip(values).enumerate() {
            theta[*at] = self.begins[k].as_ref().map_or(*value, |of_run| of_run[run]);
        }
        theta
    }

    /// What each parameter of the definition is where the directions of smooth effects are taken: those that are no nuisances at the values of
    /// `at`, which are nulls, with a column each of `wanted`.
    pub(crate) fn roles(&self, at: &[f64], wanted: &[usize]) -> Vec<Role> {
        let of = |k: usize| match (self.old.iter().position(|o| *o == k), self.new.iter().position(|n| *n == k)) {
            (Some(old), _) => Role::Base(old),
            (_, Some(new)) if wanted.contains(&new) => Role::Wanted(at[new]),
            (_, Some(new)) if self.begins[new].is_none() => Role::Known(at[new]),
            (None, None) if !self.definition.params[k].is_recorded() => Role::Known(self.definition.params[k].value),
            _ => Role::Given,
        };
        (0..self.definition.params.len()).map(of).collect()
    }

    /// The parameters of the extended model as a fit wants them: those of the base model as they are there.
    pub(crate) fn fitted_params(&self, current: &FittedModel) -> Vec<Param> {
        let mut params = self.definition.params.clone();
        for (k, param) in self.old.iter().zip(current.params()) {
            let origin = params[*k].origin;
            params[*k] = Param { origin, ..param.clone() };
        }
        for (k, at) in self.new.iter().enumerate() {
            params[*at].fixed = !self.is_estimated(k);
        }
        params
    }

    /// The runs as the extended model takes them; none where it needs a record that the others do not.
    pub(crate) fn takes(&self, run: &Run) -> bool {
        self.definition.inputs.len() == run.held.len()
    }
}

/// Magnitudes below this part of the largest one count as rest.
const REST: f64 = 1e-6;

/// Inputs as recorded, states and outputs as the fitted model has them; in the frequency domain, which knows no time, outputs as
/// recorded and states as outputs or spectra show them.
#[derive(Debug, Clone, Default)]
pub(crate) struct SignalScales {
    signals: BTreeMap<String, Signal>,
    step: f64,
    duration: f64,
}

/// One signal in all runs.
#[derive(Debug, Clone, Default)]
struct Signal {
    /// Magnitudes of what is not at rest, rising.
    sizes: Vec<f64>,
    /// Values, rising.
    levels: Vec<f64>,
    /// Magnitudes of the rate of change where it changes, rising.
    speeds: Vec<f64>,
    /// The value at the first sample of each run.
    first: Vec<f64>,
}

impl SignalScales {
    pub(crate) fn new(current: &FittedModel, runs: Runs<'_>) -> Self {
        let runs = runs.all;
        let definition = current.model.definition();
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
        let (traced, shown) = states_and_outputs(current, runs);
        for (names, values) in [(&outputs, &shown), (&states, &traced), (&inputs, &recorded)] {
            for (k, name) in names.iter().enumerate() {
                let columns = values.iter().map(|rows| rows.iter().skip(k).step_by(names.len()).copied().collect());
                found.signals.insert((*name).to_string(), Signal::new(columns.collect(), runs));
            }
        }
        found
    }

    /// The value of a signal at the first sample of a run.
    pub(crate) fn first(&self, signal: &str, run: usize) -> f64 {
        self.signals.get(signal).and_then(|s| s.first.get(run)).copied().unwrap_or(0.0)
    }
}

impl Signal {
    fn new(columns: Vec<Vec<f64>>, runs: &[Run]) -> Self {
        let (mut sizes, mut levels, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
        for (values, run) in columns.iter().zip(runs) {
            let dt = interval(run);
            let even = is_even(run);
            sizes.extend(values.iter().map(|v| v.abs()));
            levels.extend(values.iter().copied().filter(|v| v.is_finite()));
            let passed = run.time.windows(2).map(|t| if even { dt } else { t[1] - t[0] });
            speeds.extend(values.windows(2).zip(passed).map(|(w, dt)| (w[1] - w[0]).abs() / dt));
        }
        let first = columns.iter().map(|v| v.first().copied().unwrap_or(0.0)).collect();
        levels.sort_by(f64::total_cmp);
        Self { sizes: moving(sizes), levels, speeds: moving(speeds), first }
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

impl Scales for SignalScales {
    fn size(&self, signal: &str, q: f64) -> f64 {
        self.signals.get(signal).map_or(0.0, |s| quantile(&s.sizes, q))
    }

    fn speed(&self, signal: &str, q: f64) -> f64 {
        self.signals.get(signal).map_or(0.0, |s| quantile(&s.speeds, q))
    }

    fn level(&self, signal: &str, q: f64) -> f64 {
        self.signals.get(signal).map_or(f64::NAN, |s| quantile(&s.levels, q))
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
pub(crate) fn states_and_outputs(current: &FittedModel, runs: &[Run]) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let mut both = (Vec::new(), Vec::new());
    for (run, (predictor, theta)) in runs.iter().zip(current.predictors.iter().zip(&current.theta)) {
        match predictor {
            Predictor::Steps(_) => return (states_of(current, runs), current.response.clone()),
            Predictor::Bins { bins, run: place } => {
                both.0.push(bins.states(*place, theta, run));
                both.1.push(run.measured.clone());
            }
        }
    }
    both
}

/// States of each run (N by n), by the model with its states as outputs; nothing where that has no response.
fn states_of(current: &FittedModel, runs: &[Run]) -> Vec<Vec<f64>> {
    let mut definition = current.model.definition().clone();
    definition.params.iter_mut().for_each(|p| p.fixed = true);
    definition.derived.clear();
    let states = definition.states.clone();
    let shown = |(k, state): (usize, &fdm_grammar::model::State)| {
        Output::new(state.quantity.clone(), definition.graph.leaf(Leaf::State(k as u32)))
    };
    let outputs = states.iter().enumerate().map(shown).collect();
    definition.outputs = outputs;
    let dynamics = compile(&Schedule::new(&mut definition), Engine::Tape);
    let of = |(run, (theta, predictor)): (&Run, (&Vec<f64>, &Predictor))| {
        let mut x = vec![0.0; run.len() * states.len()];
        let simulator = predictor.steps().and_then(|steps| Simulator::new(&*dynamics, run, steps.clone()).ok());
        if let Some(mut simulator) = simulator {
            // what comes before a divergence is kept
            let _ = simulator.simulate(theta, &mut x);
        }
        x
    };
    runs.iter().zip(current.theta.iter().zip(&current.predictors)).map(of).collect()
}

/// The name under which results speak of a candidate.
pub(crate) fn place(candidate: &Candidate) -> EffectAt {
    EffectAt { effect: candidate.effect().name().to_string(), targets: candidate.targets().to_vec() }
}

/// The model at its fit with an effect in its text.
pub(crate) fn grown(text: &AttachedEffect, current: &FittedModel) -> Result<Model, DiagnosisError> {
    let extended = Model::compiled(text.extension.source().clone(), text.extension.compile())?;
    let params = text.fitted_params(current);
    let same = params.len() == extended.definition().params.len();
    Ok(if same { extended.with_params(params) } else { extended })
}
