//! What the frequency domain does not determine, found in the time domain afterwards: initial states and biases of each run, with the rest held.

use crate::estimation::estimate::{Estimate, ParameterEstimate};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::FitOptions;
use crate::methods::time_domain::fit;
use crate::problem::Options;
use crate::work::Work;
use fdm_grammar::graph::{Graph, Leaf};
use fdm_grammar::model::{Origin, Param, Quantity};
use fdm_grammar::op::{Build, ExprId, Op};
use fdm_system::model::Model;
use fdm_system::record::Run;

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
