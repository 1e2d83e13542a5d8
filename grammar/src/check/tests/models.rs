//! Good models: names, roles, units, values, bounds, and what the expressions compute.

use super::good;
use crate::graph::{Leaf, Signal, show};
use crate::model::{Model, Origin};
use crate::op::ExprId;

/// The value of an expression for named states, inputs and params; `t` is 0.
fn value(model: &Model, e: ExprId, names: &[(&str, f64)]) -> f64 {
    use crate::graph::Names;
    model.graph.evaluate(e, |leaf| {
        let name = model.leaf(leaf);
        names.iter().find(|(n, _)| *n == name).map_or_else(|| panic!("`{name}` has no value"), |(_, v)| *v)
    })
}

/// The value of the output `y = expression` of x, u, a.
fn output(expression: &str, x: f64, u: f64, a: f64) -> f64 {
    let model = good(&format!("state x; input u; param a = 1; der(x) = a*u; output y = {expression};"));
    value(&model, model.outputs[0].expr, &[("x", x), ("u", u), ("a", a), ("t", 0.25)])
}

#[test]
fn params_are_estimated_by_their_logarithms_where_that_is_said() {
    let model = good(
        "input u; param a = 1, b = 1e-3 in [1e-6, 1e3] log, c = log(8) log, d = 3 in [0, inf] log, e = 1 fixed log;
        output y = (a + b + c + d + e)*log(u);",
    );
    let flags: Vec<_> = model.params.iter().map(|p| (p.quantity.name.as_str(), p.logarithmic, p.lower)).collect();
    let free = f64::NEG_INFINITY;
    assert_eq!(flags, [("a", false, free), ("b", true, 1e-6), ("c", true, 0.0), ("d", true, 0.0), ("e", true, 0.0)]);
}

#[test]
fn everything_declared_is_in_the_model() {
    let model = good(
        "time [min];
        input u \"drive\" [V], w;
        state x \"level\" [m] = x0, z [m/min] = free, q;
        param x0 = 1 [m] per run, k = 2 in [0.5, 1e3], g = 9.81 fixed, half = k/2, n = 2*c in [0, inf];
        const c = 2*d, d = 3;
        let sum = k*x + g;
        der(x) = z; der(z) = 0; der(q) = half + u + w + n;
        output y \"measured level\" [m] = x, p = sum;",
    );
    let names: Vec<_> = model.params.iter().map(|p| p.quantity.name.as_str()).collect();
    assert_eq!(names, ["z(0)", "x0", "k", "g", "n"]);
    let range = |k: usize| (model.params[k].value, model.params[k].lower, model.params[k].upper);
    assert_eq!(range(0), (0.0, f64::NEG_INFINITY, f64::INFINITY));
    assert_eq!(range(2), (2.0, 0.5, 1000.0));
    assert_eq!(range(4), (12.0, 0.0, f64::INFINITY));
    let flags: Vec<_> = model.params.iter().map(|p| (p.fixed, p.per_run)).collect();
    assert_eq!(flags, [(false, true), (false, true), (false, false), (true, false), (false, false)]);
    assert_eq!(model.params[0].origin, Origin::FreeInitial(1));
    let unit = |unit: &Option<crate::Unit>| unit.as_ref().map_or(String::new(), |u| u.text().to_string());
    assert_eq!(unit(&model.params[0].quantity.unit), "m/min", "the unit of the state");
    assert_eq!((model.time.text(), unit(&model.inputs[0].quantity.unit).as_str()), ("min", "V"));
    assert_eq!(
        (model.inputs[0].quantity.doc.as_str(), model.outputs[0].quantity.doc.as_str()),
        ("drive", "measured level")
    );
    assert_eq!(model.derived.iter().map(|d| d.quantity.name.as_str()).collect::<Vec<_>>(), ["half"]);
    let shown = |e| show(&model.graph, e, &model);
    assert_eq!(shown(model.states[0].initial), "x0");
    assert_eq!(shown(model.states[1].initial), "z(0)");
    assert_eq!(shown(model.states[2].initial), "0");
    assert_eq!(value(&model, model.derived[0].expr, &[("k", 7.0)]), 3.5);
    assert_eq!(value(&model, model.outputs[1].expr, &[("k", 2.0), ("x", 3.0), ("g", 4.0)]), 10.0);
    assert_eq!(model.states.iter().map(|s| s.quantity.name.as_str()).collect::<Vec<_>>(), ["x", "z", "q"]);
}

#[test]
fn functions_and_signs_compute_what_they_say() {
    let rows: [(&str, f64); 24] = [
        ("x + u*a - x/u", 2.0 + 3.0 * 5.0 - 2.0 / 3.0),
        ("-x^2", -4.0),
        ("+x", 2.0),
        ("clip(x, 3, 4) + clip(9*x, 3, 4)", 7.0),
        ("clip(x, 1, 4)", 2.0),
        ("deadzone(x, 0.5) + deadzone(-x, 0.5)", 0.0),
        ("deadzone(x, 0.5)", 1.5),
        ("deadzone(-x, 0.5)", -1.5),
        ("deadzone(x, 2.5)", 0.0),
        ("min(x, u, a, -1)", -1.0),
        ("max(x, u, a)", 5.0),
        ("deg2rad(180) + rad2deg(pi)", std::f64::consts::PI + 180.0),
        ("if x > u then 1 else 2", 2.0),
        ("if x >= 2 and x != 3 then 1 else 0", 1.0),
        ("if x < 2 or not (u > 3) then 1 else 0", 1.0),
        ("if x <= 2 and x == 2 then 1 else 0", 1.0),
        ("if x < u then if u < a then 7 else 8 else 9", 7.0),
        ("atan2(x, x)", std::f64::consts::FRAC_PI_4),
        ("hypot(3, 4)*sign(-x)", -5.0),
        ("sqrt(x*x) + abs(-u)", 5.0),
        ("t", 0.25),
        ("delay(t, 0.25)", 0.0),
        ("delay(a*x, 0)", 10.0),
        ("exp(log(x)) + log10(100)", 4.0),
    ];
    for (expression, want) in rows {
        let got = output(expression, 2.0, 3.0, 5.0);
        assert!((got - want).abs() < 1e-14, "{expression}: {got}, not {want}");
    }
}

#[test]
fn the_order_of_declarations_is_free() {
    let model = good("output y = b; let b = c + x; der(x) = b; const c = 2*d; state x; const d = 4;");
    assert_eq!(value(&model, model.outputs[0].expr, &[("x", 1.0)]), 9.0);
    assert_eq!(model.outputs[0].expr, model.states[0].rate);
}

#[test]
fn outputs_are_names_too() {
    let model = good("state x; der(x) = -x; output v = 2*x, w = v + 1;");
    assert_eq!(value(&model, model.outputs[1].expr, &[("x", 3.0)]), 7.0);
}

#[test]
fn a_model_may_have_no_states() {
    let model = good("input alpha; param c0 = 0.1, ca = 5; output lift = c0 + ca*alpha;");
    assert!(model.states.is_empty() && model.outputs.len() == 1);
}

#[test]
fn delays_reach_the_signals() {
    let model = good(
        "input u; state x; param tau = 0.1, sigma = 0.2 in [0.05, 1], a = 1;
        let slow = delay(a*u + t, tau);
        der(x) = slow; output y = delay(slow*x, sigma) + u, z = delay(a, tau);",
    );
    let seen: Vec<_> = model.graph.delayed().iter().map(|d| (d.signal, show(&model.graph, d.tau, &model))).collect();
    let text = |s: &str| s.to_string();
    assert_eq!(
        seen,
        [(Signal::Input(0), text("tau")), (Signal::State(0), text("sigma")), (Signal::Input(0), text("tau + sigma")),]
    );
    let lower = |name| model.params[model.param(name).unwrap()].lower;
    assert_eq!((lower("tau"), lower("sigma"), lower("a")), (0.0, 0.05, f64::NEG_INFINITY));
    let (a, tau, sigma, t) = (2.0, 0.1, 0.2, 1.0);
    let (u, x) = (|s: f64| s.sin(), |s: f64| s.cos());
    let at = |e| {
        model.graph.evaluate(e, |leaf| match leaf {
            Leaf::Time => t,
            Leaf::Input(_) => u(t),
            Leaf::State(_) => x(t),
            Leaf::Param(k) => [tau, sigma, a][k as usize],
            Leaf::Delayed(k) => [u(t - tau), x(t - sigma), u(t - tau - sigma)][k as usize],
        })
    };
    let slow = |s: f64| a * u(s - tau) + s - tau;
    let want = slow(t - sigma) * x(t - sigma) + u(t);
    assert!((at(model.outputs[0].expr) - want).abs() < 1e-14);
    assert!((at(model.states[0].rate) - slow(t)).abs() < 1e-14);
    assert_eq!(at(model.outputs[1].expr), a);
}

/// `delay(x*u, tau)` and a delay of it in equations of states: delayed signals, with their partials.
#[test]
fn delays_of_states_enter_equations() {
    let text = "model m { input u; state x = 1, z; param tau = 0.1, k = 2, sigma = 0.2 in [0, 1];
        let product = delay(x*u, tau);
        der(x) = -k*product; der(z) = delay(product, sigma) - delay(z, 0) + delay(x, tau); output y = z; }";
    let compiled = crate::compile(&crate::Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}"));
    let model = &compiled.model;
    let seen: Vec<_> = model.graph.delayed().iter().map(|d| (d.signal, show(&model.graph, d.tau, model))).collect();
    let (x, u) = (Signal::State(0), Signal::Input(0));
    assert_eq!(seen.iter().map(|(s, _)| *s).collect::<Vec<_>>(), [u, x, u, x]);
    assert_eq!(seen.iter().map(|(_, t)| t.as_str()).collect::<Vec<_>>(), ["tau", "tau", "tau + sigma", "tau + sigma"]);
    let entries = |pattern: &crate::Pattern| pattern.entries().map(|(_, i, j)| (i, j)).collect::<Vec<_>>();
    let patterns = &compiled.schedule.layout.patterns;
    assert_eq!(entries(&patterns.rates_by_delayed), [(0, 0), (0, 1), (1, 1), (1, 2), (1, 3)]);
    assert_eq!(entries(&patterns.rates_by_state), [(1, 1)], "a delay of nothing is the state itself");
    assert_eq!(entries(&patterns.tau_by_param), [(0, 0), (1, 0), (2, 0), (2, 2), (3, 0), (3, 2)]);
    assert!(compiled.warnings.is_empty(), "tau acts on the output through the states: {:?}", compiled.warnings);
}

#[test]
fn branches_that_are_never_taken_may_be_infinite() {
    let model = good("const a = 0; state x; der(x) = if a > 0 then 1/a else x; output y = x;");
    assert_eq!(value(&model, model.states[0].rate, &[("x", 2.0)]), 2.0);
}

#[test]
fn only_signals_that_are_used_are_delayed() {
    let model = good("input u; param a = 1, b = 2; let v = delay(u, a); output y = delay(v, b) + 3*delay(v, b + 1);");
    let taus: Vec<_> = model.graph.delayed().iter().map(|d| show(&model.graph, d.tau, &model)).collect();
    assert_eq!(taus, ["a + b", "a + b + 1"]);
    assert_eq!(model.params.iter().map(|p| p.lower).collect::<Vec<_>>(), [0.0, 0.0]);
}

#[test]
fn a_checked_model_compiles() {
    let text = "model roll { input aileron [deg]; state p [deg/s], phi [deg] = free; param L = -2 in [-10, 0] [1/s],
        K = 3 [1/s^2], tau = 0.1 in [0, 0.5] [s], off = 0 [deg] per run; der(p) = L*p + K*delay(aileron + off, tau);
        der(phi) = p; output phi_m [deg] = phi, r [deg/s] = if abs(p) > 1 then p else 0; }";
    let compiled = crate::compile(&crate::Source::new("roll.fdm", text)).unwrap_or_else(|e| panic!("{e:?}"));
    assert!(compiled.warnings.is_empty(), "{:?}", compiled.warnings);
    let layout = &compiled.schedule.layout;
    assert_eq!((layout.states, layout.inputs, layout.params, layout.outputs, layout.delayed.len()), (2, 1, 5, 2, 1));
}

#[test]
fn records_are_hidden_inputs_behind_the_declared_ones() {
    let model = good(
        "state x \"level\" [m], z [m]; const c = 1 [1/s]; param tau = 0.5 [s];
        der(x) = c*measured(z_m) - c*delay(measured(x), tau); der(z) = c*measured(y); input u [m];
        let shown = x; output z_m [m] = z + u; output y \"depth\" [m] = shown;",
    );
    let inputs: Vec<_> = model.inputs.iter().map(|i| (i.quantity.name.as_str(), i.measured)).collect();
    assert_eq!(inputs, [("u", None), ("measured(z_m)", Some(0)), ("measured(y)", Some(1))]);
    assert_eq!(model.inputs[2].quantity.unit.as_ref().map(|u| u.text()), Some("m"));
    assert_eq!(model.inputs[2].quantity.doc, "depth");
    let rates: Vec<_> = model.states.iter().map(|s| show(&model.graph, s.rate, &model)).collect();
    assert_eq!(rates, ["measured(z_m) - delay(measured(y), tau)", "measured(y)"]);
}

#[test]
fn an_output_may_contain_a_record_of_another_and_they_each_other() {
    let model = good("state x; der(x) = -x; output a = x + measured(b), b = x - measured(a);");
    assert_eq!(model.inputs.len(), 2);
    assert_eq!(show(&model.graph, model.outputs[0].expr, &model), "x + measured(b)");
}

#[test]
fn what_is_known_is_in_the_model() {
    let model = good(
        "const s = 0.1; state x = free, z = free; param a = 1, b = 2 per run, k = 3 fixed; der(x) = -a*x + k; der(z) = b;
        output y = x, w = z; prior b ~ normal(2*s, s^2), z(0) ~ normal(-1, 3); noise w = 3*s; prior k ~ normal(3, 1);",
    );
    let prior = |name| model.params[model.param(name).unwrap()].prior.map(|p| (p.mean, p.deviation));
    assert_eq!((prior("a"), prior("x(0)"), prior("z(0)")), (None, None, Some((-1.0, 3.0))));
    assert_eq!((prior("b"), prior("k")), (Some((0.2, 0.1 * 0.1)), Some((3.0, 1.0))));
    assert_eq!(model.outputs.iter().map(|o| o.noise).collect::<Vec<_>>(), [None, Some(3.0 * 0.1)]);
}
