//! Coefficients against differences of the equations, and every slope against differences of the coefficients.

use super::*;
use crate::Model;
use crate::dynamics::{Point, Workspace};
use fdm_grammar::graph::Signal;

fn model(text: &str) -> Model {
    Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e}"))
}

fn evaluate(linear: &mut LinearModel, theta: &[f64]) -> Values {
    let mut values = Values::default();
    linear.evaluate(theta, &mut values).unwrap_or_else(|e| panic!("{e}"));
    values
}

/// Rates, then outputs, of a point of states, inputs and delayed signals.
fn equations(model: &Model, theta: &[f64], point: &[f64]) -> Vec<f64> {
    let (dynamics, layout) = (model.dynamics(), model.layout());
    let mut work = Workspace::new(dynamics);
    let mut known = vec![0.0; layout.known];
    dynamics.prepare(theta, &mut known, &mut work);
    let (x, drive) = point.split_at(layout.states);
    let at = Point { t: 0.0, x, drive, known: &known };
    let mut all = vec![0.0; layout.states + layout.outputs];
    let (rates, outputs) = all.split_at_mut(layout.states);
    dynamics.rates(at, rates, &mut work);
    dynamics.outputs(at, outputs, &mut work);
    all
}

/// Steps of differences.
fn step(at: f64) -> f64 {
    if at == 0.0 { 1e-5 } else { 2e-4 * at.abs() }
}

/// Central differences of fourth order of a vector function of one number.
fn difference(f: impl Fn(f64) -> Vec<f64>, at: f64) -> Vec<f64> {
    let h = step(at);
    let [a, b, c, d] = [at - 2.0 * h, at - h, at + h, at + 2.0 * h].map(f);
    (0..a.len()).map(|k| (a[k] - 8.0 * b[k] + 8.0 * c[k] - d[k]) / (12.0 * h)).collect()
}

fn close(got: f64, wanted: f64, size: f64, what: &str) {
    assert!((got - wanted).abs() <= 2e-8 * size.max(wanted.abs()).max(1e-6), "{what}: {got} {wanted}");
}

/// Everything that a linear model says, structural zeros included, against differences at these parameters.
fn verified(model: &Model, theta: &[f64]) -> (LinearModel, Values) {
    let mut linear = LinearModel::new(model).unwrap_or_else(|e| panic!("{e}"));
    let values = evaluate(&mut linear, theta);
    let s = linear.structure().clone();
    let trim = linear.trim(theta);
    assert!(s.terms.is_sorted() && s.slopes.is_sorted() && s.tau_slopes.is_sorted());
    let mut point = [&trim.states[..], &trim.inputs].concat();
    for signal in &s.delayed {
        point.push(match signal {
            Signal::State(k) => trim.states[*k as usize],
            Signal::Input(k) => trim.inputs[*k as usize],
        });
    }
    for signal in 0..point.len() {
        let moved = |v: f64| {
            let mut point = point.clone();
            point[signal] = v;
            equations(model, theta, &point)
        };
        let wanted = difference(moved, point[signal]);
        for (row, wanted) in wanted.iter().enumerate() {
            let place = s.terms.iter().position(|t| (t.row as usize, t.signal as usize) == (row, signal));
            close(place.map_or(0.0, |k| values.terms[k]), *wanted, 1.0, &format!("term {row} {signal}"));
        }
    }
    for (param, declared) in model.definition().params.iter().enumerate() {
        let moved = |v: f64| {
            let mut theta = theta.to_vec();
            theta[param] = v;
            let values = evaluate(&mut linear.clone(), &theta);
            [values.terms, values.tau].concat()
        };
        let wanted = difference(moved, theta[param]);
        let (terms, taus) = wanted.split_at(s.terms.len());
        for (k, wanted) in terms.iter().enumerate() {
            let place = s.slopes.iter().position(|l| (l.term as usize, l.param as usize) == (k, param));
            let what = format!("slope of {:?} by {}", s.terms[k], declared.quantity.name);
            if declared.fixed {
                assert!(place.is_none(), "{what}");
            } else {
                let rounding = 1e-15 * (1.0 + values.terms[k].abs()) / step(theta[param]);
                let got = place.map_or(0.0, |k| values.slopes[k]);
                assert!((got - wanted).abs() <= 2e-8 * wanted.abs() + rounding, "{what}: {got} {wanted}");
            }
        }
        for (k, wanted) in taus.iter().enumerate() {
            let place = s.tau_slopes.iter().position(|l| (l.delayed as usize, l.param as usize) == (k, param));
            let wanted = if declared.fixed { 0.0 } else { *wanted };
            close(place.map_or(0.0, |k| values.tau_slopes[k]), wanted, 1.0, &format!("delay {k} by {param}"));
        }
    }
    (linear, values)
}

fn start(model: &Model) -> Vec<f64> {
    model.definition().start()
}

#[test]
fn linear_models_are_their_own() {
    let m = model(
        "model m { input d, e; state x = 3, y; param a = -1.5, b = 2 fixed, c = 0.4, tau = 0.2, lag = 0.1;
        der(x) = a*x + exp(c)*y + b*c*delay(d, tau); der(y) = -x/c + e + delay(x, 2*tau + lag*lag) + 7;
        output p = x + y*a^2 + 3, q = delay(y, lag) - delay(d, tau)*(if c > 1 then a else c), r = d; }",
    );
    let (mut linear, _) = verified(&m, &start(&m));
    assert_eq!(linear.trim(&start(&m)).obtained, Obtained::NotNeeded);
    assert_eq!(linear.structure().delayed.len(), 3);
    assert_eq!((linear.structure().terms.len(), linear.structure().params), (11, 5));
    verified(&m, &[0.3, 2.0, 1.7, 0.05, 0.6]);
}

#[test]
fn a_ship_on_a_straight_course_and_a_pendulum_at_rest() {
    let ship = Model::from_file(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/goodman_ship/model.fdm")).unwrap();
    let (mut linear, _) = verified(&ship, &start(&ship));
    let trim = linear.trim(&start(&ship));
    assert_eq!((trim.obtained, trim.states), (Obtained::Initial, vec![25.3, 0.0, 0.0]));
    let m = model(
        "model m { state x = free, w; input u; param k = 9, c = 0.2; const w0 = 0.05;
        der(x) = w; der(w) = -k*sin(x) - c*w - 0.3*w*w*abs(w) - 0.1*tanh(w/w0) + u; output y = x; }",
    );
    let (_, values) = verified(&m, &start(&m));
    assert_eq!(values.terms, [1.0, -9.0, -2.2, 1.0, 1.0]);
}

#[test]
fn a_trim_that_is_solved_moves_with_the_parameters() {
    // two tanks that flow into each other, and a heading that only grows
    let m = model(
        "model m { state h1 = 1, h2 = 0.2, psi; input pump; param inflow = 2, k1 = 1.5, k2 = 1.1, g = 9.81 fixed, tau = 0.3;
        der(h1) = inflow + pump - k1*sqrt(2*g*h1); der(h2) = k1*sqrt(2*g*delay(h1, tau)) - k2*sqrt(2*g*h2); der(psi) = h1*h2;
        output a = h1^2, b = h2*h1 + delay(pump, tau), c = psi; }",
    );
    let (mut linear, _) = verified(&m, &start(&m));
    let trim = linear.trim(&start(&m));
    assert_eq!((trim.obtained, trim.solved.len()), (Obtained::Solved, 2));
    let h1 = (2.0_f64 / 1.5).powi(2) / (2.0 * 9.81);
    assert!((trim.states[0] - h1).abs() < 1e-15, "{trim:?}");
    verified(&m, &[0.7, 3.0, 0.4, 9.81, 0.1]);
}

#[test]
fn a_trim_that_is_given_is_held_and_the_inputs_follow() {
    let m = model(
        "model m { input throttle, e; state u = 2, x, w; param drag = 0.3, push = 4, cruise = 3, half = 2 fixed;
        der(u) = push*throttle - drag*u*abs(u); der(x) = u; der(w) = -w*u + e; output u_m = u^3*e, p = throttle^2;
        trim { u = cruise^2/half; } }",
    );
    let theta = start(&m);
    let (mut linear, _) = verified(&m, &theta);
    let trim = linear.trim(&theta);
    assert_eq!(trim.solved, [Signal::State(2), Signal::Input(0)]);
    assert_eq!((trim.obtained, &trim.states[..2]), (Obtained::Solved, &[4.5, 0.0][..]));
    assert!((trim.inputs[0] - 0.3 * 4.5 * 4.5 / 4.0).abs() < 1e-15);
    verified(&m, &[0.7, 2.0, 1.1, 2.0]);
}

#[test]
fn a_steady_turn_is_solved_from_the_equations() {
    let text =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/goodman_ship/model.fdm")).unwrap();
    let turning =
        text.replace("  output u_m", "  param angle = 0.6109 [rad];\n  trim { rudder = angle; }\n  output u_m");
    let m = model(&turning);
    let theta = start(&m);
    let (mut linear, _) = verified(&m, &theta);
    let trim = linear.trim(&theta);
    // 35 deg of rudder: 0.80 U0 and 0.88 deg/s, as the manoeuvre of the paper settles
    assert_eq!(trim.obtained, Obtained::Solved);
    assert!((trim.states[0] / 25.3 - 0.80).abs() < 0.015, "{trim:?}");
    assert!((trim.states[2].to_degrees().abs() - 0.88).abs() < 0.02, "{trim:?}");
    let mut other = theta.clone();
    other[11] = -0.3;
    verified(&m, &other);
}

#[test]
fn all_that_matters_given_is_taken_as_given() {
    let m = model(
        "model m { input e; state u, w; param a = 0.3, b = 4; der(u) = -a*u^2*w + b; der(w) = -u + e; output y = u*w;
        trim { w = a*b; u = if b > 3 then sqrt(b) else 1; e = 0; } }",
    );
    let (mut linear, _) = verified(&m, &start(&m));
    let trim = linear.trim(&start(&m));
    assert_eq!((trim.obtained, trim.states), (Obtained::Given, vec![2.0, 1.2]));
}

#[test]
fn what_cannot_rest_is_named() {
    let said = |text| LinearModel::new(&model(text)).unwrap_err().to_string();
    let never = "model m { state x, y; param a = 1; der(x) = a + x^2; der(y) = -y; output z = y; }";
    let wanted = "no trim was found: the rate of `x` cannot be made zero; open are `x`, `y`: say in the model what is known of them, \
        as in `trim { x = 0; }`";
    assert_eq!(said(never), wanted);
    let held = "model m { state x, y; param a = 1; der(x) = a - x^2; der(y) = x - y*x; output z = y; trim { x = 2; } }";
    let while_held = "no trim was found: the rate of `x` cannot be made zero while `x` is held; ";
    assert!(said(held).starts_with(while_held), "{}", said(held));
    let root = model("model m { state x; param a = 1; der(x) = a*sqrt(x); output z = x; }");
    let error = LinearModel::new(&root).and_then(|mut l| l.evaluate(&[1.0], &mut Values::default())).unwrap_err();
    assert!(error.to_string().contains("no derivative: the derivative of `x` by `x` is inf"), "{error}");
}

/// An aircraft in six degrees of freedom, its trim as far as it is named.
fn aircraft(trim: &str) -> Model {
    model(&format!(
        "model six {{ input da, de, dr, T; state u = 20, v, w, p, q, r, phi, th;
        param CL0 = 0.3, CLa = 5, CD0 = 0.04, k = 0.06, Cm0 = 0.05, Cma = -0.6, Cmq = -8, Cmd = -1, CYb = -0.5, Clb = -0.05, Clp = -0.4,
            Clda = 0.1, Cnb = 0.08, Cnr = -0.1, Cndr = -0.06;
        const m = 4, S = 0.6, c = 0.3, b = 2, Jx = 0.2, Jy = 0.2, Jz = 0.35, rho = 1.2, g = 9.81;
        let V = sqrt(u^2 + v^2 + w^2); let a = atan2(w, u); let be = asin(v/V); let Q = 0.5*rho*V^2*S;
        let CL = CL0 + CLa*a; let CD = CD0 + k*CL^2;
        der(u) = (T - Q*CD*cos(a) + Q*CL*sin(a))/m - g*sin(th) + r*v - q*w;
        der(v) = Q*CYb*be/m + g*sin(phi)*cos(th) + p*w - r*u;
        der(w) = (-Q*CD*sin(a) - Q*CL*cos(a))/m + g*cos(phi)*cos(th) + q*u - p*v;
        der(p) = (Q*b*(Clb*be + Clp*p*b/(2*V) + Clda*da) + (Jy - Jz)*q*r)/Jx;
        der(q) = (Q*c*(Cm0 + Cma*a + Cmq*q*c/(2*V) + Cmd*de) + (Jz - Jx)*p*r)/Jy;
        der(r) = (Q*b*(Cnb*be + Cnr*r*b/(2*V) + Cndr*dr) + (Jx - Jy)*p*q)/Jz;
        der(phi) = p + (q*sin(phi) + r*cos(phi))*tan(th); der(th) = q*cos(phi) - r*sin(phi);
        output q_m = q; trim {{ {trim} }} }}"
    ))
}

#[test]
fn a_rate_of_turn_is_held_where_the_equations_alone_lead_nowhere() {
    let (bare, named) = (aircraft("u = 20;"), aircraft("u = 20; q = 0;"));
    let (mut found, _) = verified(&bare, &start(&bare));
    let (found, wanted) = (found.trim(&start(&bare)), verified(&named, &start(&named)).0.trim(&start(&named)));
    assert_eq!((&found.assumed[..], &wanted.assumed[..]), (&[Signal::State(4)][..], &[][..]));
    assert_eq!((found.obtained, &found.states, &found.inputs), (Obtained::Solved, &wanted.states, &wanted.inputs));
}

#[test]
fn recorded_means_say_where_a_trim_is_looked_for() {
    let text = "model m { input u; state x = 1; param a = 2; der(x) = a*log(u) - x^3; output y = x; }";
    let model = model(text);
    assert!(LinearModel::new(&model).is_err(), "nothing is known of `u`, and log(0) is no number");
    let run = crate::record::Run {
        name: "r".into(),
        time: vec![0.0, 1.0, 2.0],
        inputs: vec![2.0, 3.0, 4.0],
        held: vec![false],
        measured: vec![1.0, f64::NAN, 1.5],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![1],
    };
    let mut linear = LinearModel::near(&model, &Recorded::of(model.definition(), &[run])).expect("a trim");
    let trim = linear.trim(&start(&model));
    assert_eq!((trim.inputs, trim.assumed), (vec![3.0], vec![Signal::Input(0)]));
    assert!((trim.states[0].powi(3) - 2.0 * 3.0_f64.ln()).abs() < 1e-12, "{:?}", trim.states);
}

#[test]
fn a_displaced_pendulum_is_linearised_where_it_hangs() {
    let m =
        Model::from_file(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/pendulum_free_swing/model.fdm")).unwrap();
    let (mut linear, _) = verified(&m, &start(&m));
    let trim = linear.trim(&start(&m));
    assert_eq!(trim.obtained, Obtained::Solved);
    assert!(trim.states.iter().all(|x| x.abs() < 1e-15), "{trim:?}");
}

#[test]
fn records_and_delayed_states_have_the_value_of_the_trim() {
    let m = model(
        "model m { input d; state x = 1, y; param a = 2, b = 0.7, tau = 0.4; der(x) = a - x*delay(x, tau)*measured(y_m) + d;
        der(y) = b*delay(x, 2*tau)^2 - y*abs(y); output y_m = y, z = delay(d, tau)*x; }",
    );
    let theta = start(&m);
    let mut linear = LinearModel::new(&m).unwrap();
    let values = evaluate(&mut linear, &theta);
    let trim = linear.trim(&theta);
    let (x, y) = (trim.states[0], trim.states[1]);
    assert!((x * x * y - 2.0).abs() < 1e-14 && (0.7 * x * x - y * y).abs() < 1e-14, "{trim:?}");
    let late = 4 + linear.structure().delayed.iter().position(|d| *d == Signal::State(0)).unwrap() as u32;
    let term = |row, signal| {
        let k = linear.structure().terms.iter().position(|t| *t == Term { row, signal }).unwrap();
        values.terms[k]
    };
    assert!((term(0, 3) + x * x).abs() < 1e-14, "by the record of y");
    assert!((term(0, 0) + x * y).abs() < 1e-14 && (term(0, late) + x * y).abs() < 1e-14);
}
