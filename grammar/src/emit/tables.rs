//! What a generated file says about the model: sizes, names, units, start values, patterns, and the equations as comments.

use super::notation::comment;
use crate::Pattern;
use crate::graph::{Leaf, Names, Node, Signal, show};
use crate::model::{Model, Origin, Quantity};
use crate::schedule::Layout;

/// Sizes and positions: constant, value, what it counts.
pub(super) fn sizes(layout: &Layout) -> Vec<(&'static str, usize, &'static str)> {
    let p = &layout.patterns;
    let mut sizes = vec![
        ("STATES", layout.states, "states"),
        ("INPUTS", layout.inputs, "inputs"),
        ("DELAYED", layout.delayed.len(), "delayed signals"),
        ("DRIVE", layout.drive(), "inputs, then delayed signals"),
        ("PARAMS", layout.params, "parameters, fixed ones included"),
        ("OUTPUTS", layout.outputs, "outputs"),
        ("DERIVED", layout.derived.len(), "parameters that follow from others"),
        ("KNOWN", layout.known, "numbers that `prepare` writes"),
        ("KNOWN_X0", layout.initial.start, "position in known: initial values of the states"),
        ("KNOWN_TAU", layout.tau.start, "position in known: delays"),
        ("KNOWN_X0_THETA", layout.initial_by_param.start, "position in known: partials of the initial values"),
        ("KNOWN_TAU_THETA", layout.tau_by_param.start, "position in known: partials of the delays"),
        ("KNOWN_DERIVED", layout.derived.start, "position in known: parameters that follow from others"),
        ("F_X_ENTRIES", p.rates_by_state.len(), "structural nonzeros, rates by states"),
        ("F_U_ENTRIES", p.rates_by_input.len(), "rates by inputs"),
        ("F_DELAYED_ENTRIES", p.rates_by_delayed.len(), "rates by delayed signals"),
        ("F_THETA_ENTRIES", p.rates_by_param.len(), "rates by parameters"),
        ("Y_X_ENTRIES", p.outputs_by_state.len(), "outputs by states"),
        ("Y_U_ENTRIES", p.outputs_by_input.len(), "outputs by inputs"),
        ("Y_DELAYED_ENTRIES", p.outputs_by_delayed.len(), "outputs by delayed signals"),
        ("Y_THETA_ENTRIES", p.outputs_by_param.len(), "outputs by parameters"),
        ("X0_THETA_ENTRIES", p.initial_by_param.len(), "initial values by parameters"),
        ("TAU_THETA_ENTRIES", p.tau_by_param.len(), "delays by parameters"),
    ];
    if !layout.limited.is_empty() {
        let about = "position in known: lower and upper limit of each limited state, in their order";
        sizes.push(("KNOWN_LIMITS", layout.limits.start, about));
    }
    sizes
}

/// The patterns by the name of their entries.
pub(super) fn patterns(layout: &Layout) -> [(&'static str, &Pattern); 10] {
    let p = &layout.patterns;
    [
        ("f_x", &p.rates_by_state),
        ("f_u", &p.rates_by_input),
        ("f_delayed", &p.rates_by_delayed),
        ("f_theta", &p.rates_by_param),
        ("y_x", &p.outputs_by_state),
        ("y_u", &p.outputs_by_input),
        ("y_delayed", &p.outputs_by_delayed),
        ("y_theta", &p.outputs_by_param),
        ("x0_theta", &p.initial_by_param),
        ("tau_theta", &p.tau_by_param),
    ]
}

/// Rows and columns of the entries of a pattern.
pub(super) fn places(pattern: &Pattern) -> (Vec<usize>, Vec<usize>) {
    pattern.entries().map(|(_, i, j)| (i, j)).unzip()
}

/// For each delayed signal what it is a delayed version of: a state, or behind the states an input.
pub(super) fn signals(layout: &Layout) -> Vec<usize> {
    let of = |s: &Signal| match *s {
        Signal::State(k) => k as usize,
        Signal::Input(k) => layout.states + k as usize,
    };
    layout.delayed.iter().map(of).collect()
}

/// What has names: the group in the singular, the constant that counts it, its members.
pub(super) fn groups(model: &Model) -> [(&'static str, &'static str, Vec<&Quantity>); 5] {
    [
        ("state", "STATES", model.states.iter().map(|s| &s.quantity).collect()),
        ("input", "INPUTS", model.inputs.iter().map(|s| &s.quantity).collect()),
        ("param", "PARAMS", model.params.iter().map(|s| &s.quantity).collect()),
        ("derived", "DERIVED", model.derived.iter().map(|s| &s.quantity).collect()),
        ("output", "OUTPUTS", model.outputs.iter().map(|s| &s.quantity).collect()),
    ]
}

pub(super) fn unit(quantity: &Quantity) -> String {
    quantity.unit.as_ref().map(ToString::to_string).unwrap_or_default()
}

/// A name with its unit and its doc string.
pub(super) fn described(quantity: &Quantity) -> String {
    let unit = quantity.unit.as_ref().map(|u| format!(" [{u}]")).unwrap_or_default();
    let doc = if quantity.doc.is_empty() { String::new() } else { format!(": {}", quantity.doc) };
    comment(&format!("{}{unit}{doc}", quantity.name))
}

/// What the whole file is about, line by line.
pub(super) fn title(model: &Model) -> Vec<String> {
    let doc = if model.doc.is_empty() { String::new() } else { format!(": {}", model.doc) };
    let mut lines = vec![comment(&format!("{}{doc}", model.name)), String::new()];
    lines.push(format!(
        "Written by fdm {} from the model's text; times are in {}.",
        env!("CARGO_PKG_VERSION"),
        model.time
    ));
    lines.push(String::new());
    let equation = |left: String, e| comment(&format!("  {left} = {}", show(&model.graph, e, model)));
    lines.extend(model.states.iter().map(|s| equation(format!("der({})", s.quantity.name), s.rate)));
    let free = |e| matches!(model.graph.node(e), Node::Leaf(Leaf::Param(k)) if model.params[k as usize].origin != Origin::Declared);
    let initial = model.states.iter().filter(|s| !free(s.initial));
    lines.extend(initial.map(|s| equation(format!("{}(0)", s.quantity.name), s.initial)));
    lines.extend(model.outputs.iter().map(|o| equation(o.quantity.name.clone(), o.expr)));
    for (k, limits) in model.limits() {
        let [lower, upper] = [limits.lower, limits.upper].map(|e| show(&model.graph, e, model));
        let name = &model.states[k].quantity.name;
        lines.push(comment(&format!(
            "  {name} in [{lower}, {upper}]: whoever integrates takes it back at the end of each step"
        )));
    }
    let delayed = |k: usize| comment(&model.leaf(Leaf::Delayed(k as u32)));
    let signals: Vec<String> = (0..model.graph.delayed().len()).map(delayed).collect();
    if !signals.is_empty() {
        lines.push(String::new());
        lines.push(format!("delayed signals: {}", signals.join(", ")));
    }
    lines
}
