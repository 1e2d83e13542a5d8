//! What the frequency domain does not determine, found in the time domain afterwards: initial states and biases of each run, with the rest held.
//!
//! Unstable modes that the frequency domain cannot see: what no output shows or no input moves is in no response, and grows all the same.
//!
//! The noise behind spectra, in time: what the responses leave with initial states and biases of their own, and whether that is everywhere
//! of one size.

use crate::estimation::{Estimate, ParameterEstimate};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::FitOptions;
use crate::methods::time_domain::fit;
use crate::problem::{NoiseInTime, NoiseSizes, Options};
use crate::residuals::noise_variation::{OutputSeries, profile, range, test};
use crate::work::Work;
use fdm_grammar::graph::{Graph, Leaf};
use fdm_grammar::model::{Origin, Param, Quantity};
use fdm_grammar::op::{Build, ExprId, Op};
use fdm_system::linear::{LinearModel, Modes, Values};
use fdm_system::model::Model;
use fdm_system::record::Run;
use num_complex::Complex64;
use std::sync::{Arc, Mutex, PoisonError};

/// The values of all parameters of a model at an estimate; what belongs to a run may be known of another one only.
pub(crate) fn values_of(model: &Model, found: &Estimate) -> Vec<f64> {
    let value = |name: &str| found.parameters.iter().find(|e| e.name == name).map(|e| e.value);
    model.definition().params.iter().map(|p| value(&p.quantity.name).unwrap_or(p.value)).collect()
}

/// The fit of initial states, biases and the parameters that are not identifiable in the frequency domain (`unseen`); the others are
/// held at `values` (of all parameters).
///
/// # Errors
/// [`FitError`], as any fit in the time domain.
pub(crate) fn in_time(
    model: &Model,
    values: &[f64],
    unseen: &[String],
    runs: &[Run],
    work: &Work<'_>,
) -> Result<Fit, FitError> {
    let params = &model.definition().params;
    let seen: Vec<bool> = params.iter().map(|p| !unseen.contains(&p.quantity.name)).collect();
    let model = with_offsets(model, values, &seen);
    let options = FitOptions { options: Options { colour: false, ..Options::default() }, ..FitOptions::default() };
    fit(&model, runs, &options, work)
}

/// Parameters as the frequency domain found them, or as the time domain did afterwards where they are `unseen` before.
pub(crate) fn found_later(
    parameters: &[ParameterEstimate],
    finish: Option<&Fit>,
    unseen: &[String],
) -> Vec<ParameterEstimate> {
    let later = |p: &ParameterEstimate| {
        let later = finish.filter(|_| unseen.contains(&p.name))?;
        later.estimate.parameter(&p.name, p.run.as_deref()).cloned()
    };
    parameters.iter().map(|p| later(p).unwrap_or_else(|| p.clone())).collect()
}

/// The model whose initial states and biases of outputs are free in every run, while what all runs share is fixed where the frequency
/// domain has `seen` it. `values` and `seen` are about all parameters, in the model's order. Initial values and outputs that
/// have a free parameter of their run already keep it and get no other.
pub(crate) fn with_offsets(model: &Model, values: &[f64], seen: &[bool]) -> Model {
    let mut definition = model.definition().clone();
    for (k, param) in definition.params.iter_mut().enumerate() {
        param.value = values[k];
        param.fixed |= seen[k] && !param.per_run;
    }
    let own = free_initials(&mut definition, values, &|_| true);
    for k in 0..definition.outputs.len() {
        if own.get(definition.outputs[k].expr.index()).is_some_and(|own| *own) {
            continue;
        }
        let quantity = named(&definition.outputs[k].quantity, |name| format!("bias({name})"));
        let leaf = definition.graph.leaf(Leaf::Param(definition.params.len() as u32));
        definition.params.push(of_each_run(quantity, Origin::Declared, 0.0));
        let shown = definition.outputs[k].expr;
        definition.outputs[k].expr = definition.graph.apply(Op::Add, &[shown, leaf]);
    }
    model.altered(definition)
}

/// The model with an initial value of each run's own for every state (by index) that is `wanted` and has none; `values` are those of all parameters.
pub fn with_initials(model: &Model, values: &[f64], wanted: &dyn Fn(usize) -> bool) -> Model {
    let mut definition = model.definition().clone();
    free_initials(&mut definition, values, wanted);
    model.altered(definition)
}

/// Whether every initial value depends on a free parameter of each run.
pub(crate) fn all_are_free(model: &Model) -> bool {
    let definition = model.definition();
    let own = own(&definition.graph, &definition.params);
    definition.states.iter().all(|state| own[state.initial.index()])
}

/// Frees initial values; returns for each node from before whether it depends on a free parameter of each run.
fn free_initials(definition: &mut fdm_grammar::Model, values: &[f64], wanted: &dyn Fn(usize) -> bool) -> Vec<bool> {
    let own = own(&definition.graph, &definition.params);
    for k in 0..definition.states.len() {
        if own[definition.states[k].initial.index()] || !wanted(k) {
            continue;
        }
        let value = value(&definition.graph, definition.states[k].initial, values);
        let quantity = named(&definition.states[k].quantity, |name| format!("{name}(0)"));
        let leaf = Leaf::Param(definition.params.len() as u32);
        definition.params.push(of_each_run(quantity, Origin::FreeInitial(k as u32), value));
        definition.states[k].initial = definition.graph.leaf(leaf);
    }
    own
}

/// For each node whether it depends on a free parameter of each run.
fn own(graph: &Graph, params: &[Param]) -> Vec<bool> {
    graph.depends(|leaf| matches!(leaf, Leaf::Param(k) if params[k as usize].per_run && !params[k as usize].fixed))
}

fn value(graph: &Graph, e: ExprId, theta: &[f64]) -> f64 {
    graph.evaluate(e, |leaf| match leaf {
        Leaf::Param(k) => theta[k as usize],
        _ => f64::NAN,
    })
}

fn named(quantity: &Quantity, name: impl Fn(&str) -> String) -> Quantity {
    Quantity { name: name(&quantity.name), ..quantity.clone() }
}

fn of_each_run(quantity: Quantity, origin: Origin, value: f64) -> Param {
    let (lower, upper) = (f64::NEG_INFINITY, f64::INFINITY);
    Param {
        quantity,
        origin,
        value,
        lower,
        upper,
        fixed: false,
        per_run: true,
        group: None,
        logarithmic: false,
        prior: None,
    }
}

/// An unstable mode that is in no frequency response.
#[derive(Debug, Clone, PartialEq)]
pub struct UnobservableMode {
    /// The eigenvalue, in rad per unit of time.
    pub s: Complex64,
    /// Indices of the states that dominate it.
    pub states: Vec<usize>,
    /// Whether an output shows it.
    pub observable: bool,
    /// Whether an input moves it.
    pub controllable: bool,
}

/// The unstable modes without part in any response that grow e-fold within `duration`; one of a pair.
pub(crate) fn unobservable_modes(linear: &LinearModel, theta: &[f64], duration: f64) -> Vec<UnobservableMode> {
    let (mut linear, mut values) = (linear.clone(), Values::default());
    if theta.is_empty() || linear.evaluate(theta, &mut values).is_err() {
        return Vec::new();
    }
    let Ok(modes) = Modes::new(linear.structure(), &values) else { return Vec::new() };
    let unobservable = modes.modes.iter().filter(|m| m.s.re * duration > 1.0 && m.s.im >= 0.0 && !(m.shown && m.moved));
    let of = |m: &fdm_system::linear::Mode| UnobservableMode {
        s: m.s,
        states: m.dominant().collect(),
        observable: m.shown,
        controllable: m.moved,
    };
    unobservable.map(of).collect()
}

/// Length of the longest run.
pub(crate) fn longest(runs: &[Run]) -> f64 {
    let duration = |run: &Run| run.time.last().zip(run.time.first()).map_or(0.0, |(last, first)| last - first);
    runs.iter().map(duration).fold(0.0, f64::max)
}

/// Values of all parameters, and the fit in time with these held.
type Finish = (Vec<f64>, Result<Fit, FitError>);

/// The last fit in time, for whoever needs it behind the estimation.
#[derive(Clone, Default)]
pub(super) struct LastFinish(Arc<Mutex<Option<Finish>>>);

impl LastFinish {
    /// The fit in time at these values, where it has been made.
    pub(super) fn at(&self, values: &[f64]) -> Option<Result<Fit, FitError>> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        last.filter(|(at, _)| at == values).map(|(_, found)| found)
    }
}

/// Fits in time what spectra do not show.
pub(super) struct FinishInTime<'a> {
    pub(super) model: &'a Model,
    pub(super) runs: &'a [Run],
    /// Parameters that the frequency domain does not see.
    pub(super) unseen: Vec<String>,
    pub(super) last: LastFinish,
    pub(super) work: &'a Work<'a>,
}

impl NoiseInTime for FinishInTime<'_> {
    fn sizes(&self, theta: &[Vec<f64>]) -> Option<NoiseSizes> {
        let values = &theta.first()?[..self.model.layout().params];
        let found = in_time(self.model, values, &self.unseen, self.runs, self.work);
        let sizes = found.as_ref().ok().and_then(|fit| self.judged(fit));
        *self.last.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((values.to_vec(), found));
        sizes
    }
}

impl FinishInTime<'_> {
    fn judged(&self, fit: &Fit) -> Option<NoiseSizes> {
        if !fit.estimate.termination.is_good() || fit.estimate.runs.len() != self.runs.len() {
            return None;
        }
        let outputs = &self.model.definition().outputs;
        let q = outputs.len();
        let of = |o: usize| -> Vec<OutputSeries> {
            let runs = self.runs.iter().zip(&fit.estimate.runs);
            runs.map(|(run, own)| OutputSeries::of_run(&run.time, &own.response, &own.residuals, (o, q))).collect()
        };
        let series: Vec<_> = outputs.iter().enumerate().map(|(o, out)| (out.quantity.name.clone(), of(o))).collect();
        let mut variation = test(&series);
        let one = |run: &OutputSeries| vec![1.0; run.residuals.len()];
        let mut shapes: Vec<Vec<Vec<f64>>> =
            (0..self.runs.len()).map(|r| series.iter().map(|(_, runs)| one(&runs[r])).collect()).collect();
        for v in variation.iter_mut().filter(|v| v.is_significant()) {
            let Some(o) = series.iter().position(|(name, _)| *name == v.output) else { continue };
            let shape = profile(v, &series[o].1);
            v.deviations = range(v.deviations[0], &series[o].1, &shape);
            shapes.iter_mut().zip(shape).for_each(|(to, shape)| to[o] = shape);
        }
        Some(NoiseSizes { variation, shapes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn initial_states_and_biases_are_free_and_what_was_seen_is_held() {
        let text =
            "model m { input u; state x = 2, z = z0; param a = -1, b = 1, z0 = 0 per run, zero = 0 per run, c = 0;
            der(x) = a*x + b*u + c; der(z) = x; output x_m = x, z_m = z + zero; }";
        let model = Model::from_text("m.fdm", text).expect("a model");
        let freed = with_offsets(&model, &[-3.0, 1.0, 0.0, 0.0, 0.0], &[true, true, false, false, false]);
        let params = &freed.definition().params;
        let free: Vec<&str> = params.iter().filter(|p| !p.fixed).map(|p| p.quantity.name.as_str()).collect();
        assert_eq!(free, ["z0", "zero", "c", "x(0)", "bias(x_m)"]);
        assert_eq!((params[0].value, params[5].value), (-3.0, 2.0));
        assert_eq!(freed.layout().patterns.outputs_by_param.len(), 2);
    }
}
