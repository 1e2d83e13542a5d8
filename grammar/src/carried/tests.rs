//! What is carried, what stays, what is refused.

use crate::carried::Carried;
use crate::graph::{Leaf, show};
use crate::model::Model;
use crate::schedule::Affine;
use crate::source::Source;

fn model(text: &str) -> Model {
    crate::compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model
}

/// Equations of the linear model, and the value of every hidden input at a point, from records that are exact.
fn equations(c: &Carried) -> Vec<String> {
    let m = &c.model;
    let rates = m.states.iter().map(|s| s.rate).chain(m.outputs.iter().map(|o| o.expr));
    rates.map(|e| show(&m.graph, e, m)).collect()
}

/// With exact records the linear model has the rates and outputs of the original.
fn equal_where_records_are_exact(before: &Model, after: &Model) {
    let states = [0.6, -1.7, 0.3, 1.1];
    let param = |k: u32| before.params[k as usize].value;
    let own = |leaf: Leaf, input: &dyn Fn(u32) -> f64| match leaf {
        Leaf::Time => 0.8,
        Leaf::State(k) => states[k as usize],
        Leaf::Input(k) => input(k),
        Leaf::Param(k) => param(k),
        Leaf::Delayed(_) => panic!("no delays here"),
    };
    let declared = |k: u32| 0.4 + f64::from(k);
    let values = std::cell::RefCell::new(Vec::new());
    for (k, input) in after.inputs.iter().enumerate() {
        let value = match (&input.computed, input.measured) {
            (Some(c), _) => c.graph.evaluate(c.expr, |l| own(l, &|k| values.borrow()[k as usize])),
            (None, Some(o)) => before.graph.evaluate(before.outputs[o as usize].expr, |l| own(l, &declared)),
            _ => declared(k as u32),
        };
        values.borrow_mut().push(value);
    }
    let roots = |m: &Model| m.states.iter().map(|s| s.rate).chain(m.outputs.iter().map(|o| o.expr)).collect::<Vec<_>>();
    for (old, new) in roots(before).into_iter().zip(roots(after)) {
        let wanted = before.graph.evaluate(old, |l| own(l, &declared));
        let got = after.graph.evaluate(new, |l| own(l, &|k| values.borrow()[k as usize]));
        assert!((wanted - got).abs() < 1e-12 * wanted.abs().max(1.0), "{wanted} {got}");
    }
}

#[test]
fn only_what_is_not_linear_becomes_an_input() {
    let before = model(
        "model m { input d; state v, r, phi; param a = 1.5, b = -2, c = 0.3, k = 2 fixed; const g = 9.81;
        der(v) = a*v + b*v*abs(r) + c*d; der(r) = b*r - c*sin(t)*r*abs(v) + d; der(phi) = r;
        output v_m = 2*v - k, r_m = r, a_m = a*v*abs(r) + c*phi + g; }",
    );
    let after = before.carried().unwrap();
    assert_eq!(
        equations(&after),
        [
            "d*c + v*a + b*measured(v*abs(r))",
            "d + b*r - c*measured(abs(v)*r*sin(t))",
            "r",
            "2*v - k",
            "r",
            "c*phi + 9.81 + a*measured(v*abs(r))"
        ]
    );
    let affine = Affine::of(&after.model);
    assert!(affine.rates && affine.outputs.iter().all(|a| *a));
    equal_where_records_are_exact(&before, &after.model);
    let words: Vec<_> =
        after.terms.iter().map(|t| (t.text.as_str(), t.equations.join(" "), t.records.join(" "))).collect();
    assert_eq!(words[0], ("v*abs(r)", "der(v) a_m".into(), "v_m r_m".into()));
    assert_eq!(words.len(), 2);
    // what is linear now stays as it is
    let again = after.model.carried().unwrap();
    assert!(again.terms.is_empty() && equations(&again) == equations(&after));
}

#[test]
fn terms_of_one_delay_are_delayed_as_a_whole() {
    let before = model(
        "model m { input u, w; state x; param a = 1, tau = 0.3; const lag = 0.5;
        der(x) = -x + a*delay(u*w, tau) + delay(x, tau) + u*delay(x, lag); output x_m = x; }",
    );
    let after = before.carried().unwrap();
    let text = &equations(&after)[0];
    assert!(text.contains("a*delay(u*w, tau)") && text.contains("delay(x, tau)"), "{text}");
    let words: Vec<_> = after.terms.iter().map(|t| t.text.as_str()).collect();
    assert_eq!(words, ["u*w", "u*delay(x, 0.5)"]);
    assert!(after.terms[0].records.is_empty());
    let delayed = |k: usize| after.model.inputs[after.terms[k].input].computed.as_ref().unwrap().graph.delayed().len();
    assert_eq!((delayed(0), delayed(1)), (0, 1));
    assert_eq!(after.model.graph.delayed().len(), 2, "what is computed brings no delay into the model");
}

#[test]
fn what_can_not_be_computed_is_named_with_what_would_help() {
    let text = "model m { input u; state v, z; param a = 1, v0 = 2, tau = 0.2;
        der(v) = -a*tanh(v/v0) + z^2; der(z) = -z + u*delay(u, tau); output v_m = v, y = abs(z); }";
    let said = model(text).carried().unwrap_err().to_string();
    let wanted = [
        "the term `z^2` of `der(v)` is not linear and no output shows the state `z` in it, so that it can not be computed \
         from records: measure it (`output z_m = z;`), or linearise the model",
        "the term `abs(z)` of `y` is not linear and no output shows the state `z`",
        "the term `tanh(v/v0)` of `der(v)` is not linear and can not be computed from records while `v0` inside it is to be \
         estimated: fix it",
        "the term `u*delay(u, tau)` of `der(z)` is not linear and takes signals at different times, while the delay by `tau` \
         is to be estimated",
    ];
    wanted.iter().for_each(|w| assert!(said.contains(w), "{said}"));
    assert_eq!(said.lines().count(), 4);
    let helped =
        text.replace("v0 = 2", "v0 = 2 fixed").replace("tau = 0.2", "tau = 0.2 fixed").replace("y =", "z_m = z, y =");
    let after = model(&helped).carried().unwrap();
    assert_eq!(after.terms.len(), 4);
}

#[test]
fn an_output_with_an_estimated_bias_is_named_with_the_bias() {
    let text = "model m { input u; state x, z; param a = 1, bias = 0, k = 2 fixed; der(x) = a*x^2 - z; der(z) = u - z;
        output x_m = k*x + bias; }";
    let said = model(text).carried().unwrap_err().to_string();
    assert_eq!(
        said,
        "the term `x^2` of `der(x)` is not linear and can not be computed from records: `x_m` shows the state `x` only \
         together with `bias`, which is to be estimated: fix that, show the state by an output of its own, or linearise the model"
    );
    assert!(model(&text.replace("bias = 0", "bias = 0 fixed")).carried().is_ok());
    let said = model(text).substituted(&[0]).unwrap_err().to_string();
    assert!(said.ends_with("`x_m` shows the state `x` only together with `bias`, which is to be estimated"), "{said}");
}

#[test]
fn records_replace_states_also_in_carried_models() {
    let before =
        model("model m { state x, z; param a = 1; der(x) = a*x^2 + z; der(z) = -z; output x_m = x, z_m = z; }");
    let after = before.carried().unwrap().model.substituted(&[1]).unwrap();
    let shown = show(&after.graph, after.states[0].rate, &after);
    assert!(shown.contains("measured(z_m)") && shown.contains("measured(x^2)"), "{shown}");
    assert!(after.inputs.iter().any(|i| i.computed.is_some()));
}
