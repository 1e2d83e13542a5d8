//! Substitution of states by records: which occurrences change, and what the records say about the states.

use super::*;
use crate::graph::show;
use crate::{Schedule, Source, compile};

fn model(text: &str) -> Model {
    compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model
}

fn rates(model: &Model) -> Vec<String> {
    model.states.iter().map(|s| show(&model.graph, s.rate, model)).collect()
}

#[test]
fn records_replace_states_in_all_equations_and_nowhere_else() {
    let before = model(
        "model m { input d; state u = u0, v; param a = 1, b = 2, u0 = 3, tau = 0.5; param c = 2*a;
        der(u) = a*u*v + d; der(v) = b*delay(u, tau)^2 - v; output v_m = v*u, u_m = u, late = delay(u, 1); }",
    );
    let after = before.substituted(&[0]).unwrap();
    assert_eq!(rates(&after), ["d + v*measured(u_m)*a", "b*delay(measured(u_m), tau)^2 - v"]);
    let outputs: Vec<String> = after.outputs.iter().map(|o| show(&after.graph, o.expr, &after)).collect();
    assert_eq!(outputs, ["v*u", "u", "delay(u, 1)"]);
    assert_eq!(show(&after.graph, after.states[0].initial, &after), "u0");
    assert_eq!(show(&after.graph, after.derived[0].expr, &after), "2*a");
    let measured: Vec<_> = after.inputs.iter().map(|i| (i.quantity.name.as_str(), i.measured)).collect();
    assert_eq!(measured, [("d", None), ("measured(u_m)", Some(1))]);
    assert!(rates(&before.substituted(&[]).unwrap()) == rates(&before), "nothing chosen, nothing changed");
}

#[test]
fn derivatives_are_those_of_the_new_equations() {
    let before = model("model m { state x; param a = 1; der(x) = a*x^2; output y = x; }");
    let mut after = before.substituted(&[0]).unwrap();
    let patterns = Schedule::new(&mut after).layout.patterns;
    assert_eq!(
        (patterns.rates_by_state.len(), patterns.rates_by_param.len(), patterns.rates_by_input.len()),
        (0, 1, 1)
    );
    assert_eq!(patterns.outputs_by_state.len(), 1);
}

#[test]
fn affine_outputs_are_solved_for_the_state() {
    let before = model(
        "model m { state x, z; param a = 1, k = 4 fixed, b = 3; const c = 2; der(x) = -a*x; der(z) = x + z;
        output w = z + b, y = (c - 3*x)/k + k*0.5, z_m = rad2deg(z); }",
    );
    let after = before.substituted(&[1, 0]).unwrap();
    let sources: Vec<_> = after.inputs.iter().map(|i| i.measured).collect();
    assert_eq!(sources, [Some(1), Some(2)], "not `w`: its offset is estimated");
    let (x, z) = (0.7, -0.3);
    let at = |model: &Model, e, record: &dyn Fn(u32) -> f64| {
        model.graph.evaluate(e, |leaf| match leaf {
            Leaf::State(k) => [x, z][k as usize],
            Leaf::Param(k) => model.params[k as usize].value,
            Leaf::Input(k) => record(k),
            other => panic!("{other:?}"),
        })
    };
    let none = |_| f64::NAN;
    // a record without noise says what the states are
    let record = |k: u32| {
        let output = after.inputs[k as usize].measured.unwrap();
        at(&before, before.outputs[output as usize].expr, &none)
    };
    for (old, new) in before.states.iter().zip(&after.states) {
        let (wanted, got) = (at(&before, old.rate, &none), at(&after, new.rate, &record));
        assert!((wanted - got).abs() < 1e-14, "{wanted} {got}");
    }
}

#[test]
fn states_that_no_output_shows_are_named() {
    let before = model(
        "model m { state x, y, z, w; param a = 1; const none = 0; der(x) = a*x; der(y) = a*x; der(z) = y; der(w) = z;
        output p = a*x, q = none*y + delay(y, 1), r = z^2 + w, s = x; }",
    );
    let error = before.substituted(&[0, 1, 2]).unwrap_err();
    assert_eq!(error.states, ["y", "z"]);
    assert!(error.to_string().starts_with("no output shows the states `y`, `z`: "), "{error}");
}

/// The intensity of a noise is part of the model wherever it goes: ties put into effect, records in the place of states.
#[test]
fn noise_in_equations_goes_where_the_equations_go() {
    let text = "model m { input u; state x, z; param a = -1, q = 0.1, r = 0.2, s = 1; tie r = 2*q;
        der(x) = a*x + u; der(z) = x - s*z; noise der(x) = r, der(z) = q*s; output y = z, w = x; }";
    let model = compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model;
    let shown =
        |model: &Model, k: usize| model.states[k].noise.map(|e| show(&model.graph, e, model)).expect("there is noise");
    assert_eq!(shown(&model, 0), "2*q");
    // in which order a product stands is nobody's concern
    assert!(["s*q", "q*s"].contains(&shown(&model, 1).as_str()), "{}", shown(&model, 1));
    let names = |model: &Model| -> Vec<String> {
        let only = model.only_in_noise();
        let chosen = model.params.iter().zip(only).filter(|(_, only)| *only);
        chosen.map(|(p, _)| p.quantity.name.clone()).collect()
    };
    assert_eq!(names(&model), ["q"]);
    let substituted = model.substituted(&[0]).expect("x is shown");
    assert_eq!(shown(&substituted, 0), "2*q");
    assert!(["s*q", "q*s"].contains(&shown(&substituted, 1).as_str()), "{}", shown(&substituted, 1));
    let carried = model.carried().expect("linear").model;
    assert_eq!(names(&carried), ["q"]);
}
