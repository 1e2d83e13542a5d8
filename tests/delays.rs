//! Delayed states in equations: sensitivities against differences of the same simulation, responses against the method
//! of steps, orders of convergence, and delays found again.

use fdm::Model;
use fdm::record::Run;
use fdm::simulate::Simulator;
use std::f64::consts::PI;

fn model(text: &str) -> Model {
    Model::from_text("test.fdm", text).unwrap_or_else(|e| panic!("{e}"))
}

/// A multisine, the same at all samples `time`.
fn run(model: &Model, time: Vec<f64>) -> Run {
    let (m, q, n) = (model.layout().inputs, model.layout().outputs, time.len());
    let input =
        |t: f64, i: usize| (1..4).map(|h| (2.0 * PI * 0.3 * h as f64 * t + i as f64 + h as f64).sin()).sum::<f64>();
    Run {
        name: "multisine".into(),
        inputs: time.iter().flat_map(|t| (0..m).map(move |i| input(*t, i))).collect(),
        measured: vec![f64::NAN; n * q],
        time,
        held: vec![false; m],
        input_gaps: vec![0; m],
        output_gaps: vec![0; q],
    }
}

fn even(n: usize, dt: f64) -> Vec<f64> {
    (0..n).map(|k| dt * k as f64).collect()
}

fn uneven(n: usize, dt: f64) -> Vec<f64> {
    (0..n).map(|k| dt * (k as f64 + if k > 0 { 0.3 * (k as f64).sin() } else { 0.0 })).collect()
}

fn theta(model: &Model, set: &[(&str, f64)]) -> Vec<f64> {
    let mut theta = model.definition().start();
    for (name, value) in set {
        theta[model.definition().param(name).unwrap_or_else(|| panic!("no {name}"))] = *value;
    }
    theta
}

fn response(model: &Model, run: &Run, per_interval: usize, theta: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; run.len() * model.layout().outputs];
    let mut simulator = Simulator::new(model.dynamics(), run, per_interval).expect("suited");
    simulator.simulate(theta, &mut y).expect("finite");
    y
}

/// Response and Jacobian (by all free parameters).
fn linearised(model: &Model, run: &Run, per_interval: usize, theta: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
    let columns: Vec<usize> = (0..theta.len()).collect();
    let (rows, stride) = (run.len() * model.layout().outputs, columns.len().next_multiple_of(8));
    let (mut y, mut jacobian) = (vec![0.0; rows], vec![f64::NAN; rows * stride]);
    let mut simulator = Simulator::new(model.dynamics(), run, per_interval).expect("suited");
    simulator.sensitivities(theta, &columns, &mut y, &mut jacobian).expect("finite");
    assert!((0..rows).all(|r| jacobian[r * stride + columns.len()..(r + 1) * stride].iter().all(|j| *j == 0.0)));
    let column = |c: usize| (0..rows).map(|r| jacobian[r * stride + c]).collect();
    (y, columns.into_iter().map(column).collect())
}

/// Every column against differences from both sides, each extrapolated twice: where the second derivative jumps, each
/// side has its own, but the first is one.
fn check(model: &Model, run: &Run, per_interval: usize, set: &[(&str, f64)]) {
    let theta = theta(model, set);
    let (y, jacobian) = linearised(model, run, per_interval, &theta);
    assert_eq!(y, response(model, run, per_interval, &theta), "with and without sensitivities the same bits");
    for (column, exact) in jacobian.iter().enumerate() {
        let name = &model.definition().params[column].quantity.name;
        let at = |step: f64| {
            let mut moved = theta.clone();
            moved[column] += step;
            response(model, run, per_interval, &moved)
        };
        let scale = exact.iter().fold(0.0_f64, |s, e| s.max(e.abs()));
        assert!(scale > 1e-6, "{name} moves nothing: a silent zero");
        for side in [1.0, -1.0] {
            if side < 0.0 && name.starts_with("tau") && theta[column] == 0.0 {
                continue;
            }
            let h = side * if name.starts_with("tau") { 1e-5 } else { 2e-4 * theta[column].abs().max(0.05) };
            let ahead: Vec<Vec<f64>> = (1..=4).map(|k| at(f64::from(k) * h)).collect();
            let (mut worst, mut place) = (0.0, 0);
            for r in 0..y.len() {
                // five points on one side
                let [a, b, c, d] = [0, 1, 2, 3].map(|k| ahead[k][r] - y[r]);
                let difference = (4.0 * a - 3.0 * b + 4.0 / 3.0 * c - 0.25 * d) / h;
                let error = (difference - exact[r]).abs() / scale;
                if error > worst {
                    (worst, place) = (error, r);
                }
            }
            assert!(worst < 1e-7, "{name}, side {side}: off by {worst:.1e} of {scale:.1e} in row {place}, set {set:?}");
        }
    }
}

const ONE: &str = "model one {
    input u; param x0 = 0.7, z0 = -0.4 per run; state x = x0, z = z0;
    param a = -0.8, b = -1.1, c = 0.6, tau = 0.3 in [0, 20];
    der(x) = a*x + b*delay(x, tau) + c*z + u; der(z) = -z*hypot(z, 0.3) - delay(x, tau)*x + c*u;
    output y = x; output w = z + c*x; }";

#[test]
fn sensitivities_with_delays_of_many_steps() {
    let one = model(ONE);
    check(&one, &run(&one, uneven(60, 0.1)), 2, &[("tau", 1.337)]);
    check(&one, &run(&one, uneven(60, 0.1)), 1, &[("tau", 0.4217)]);
    // longer than the record: the initial values only
    let long = "model long { input u; param x0 = 0.7; state x = x0; param b = -1.1, tau = 20 in [0, 30];
        der(x) = b*delay(x, tau)*x + u; output y = x + 0.001*tau; }";
    let long = model(long);
    check(&long, &run(&long, even(40, 0.1)), 1, &[]);
}

#[test]
fn sensitivities_with_delays_shorter_than_a_step() {
    let one = model(ONE);
    for tau in [0.0713, 0.011, 1e-4, 0.0] {
        check(&one, &run(&one, uneven(40, 0.1)), 1, &[("tau", tau)]);
        check(&one, &run(&one, even(30, 0.4)), 2, &[("tau", tau)]);
    }
}

#[test]
fn sensitivities_with_delays_on_the_grid() {
    let one = model(ONE);
    // exact binary fractions: windows begin on nodes
    for tau in [0.125, 0.25, 1.0] {
        check(&one, &run(&one, even(40, 0.125)), 1, &[("tau", tau)]);
    }
    check(&one, &run(&one, even(30, 0.25)), 2, &[("tau", 0.125)]);
}

#[test]
fn sensitivities_with_several_delays_of_inputs_states_and_outputs() {
    let text = "model several {
        input u, v; param x0 = 0.7, z0 = -0.4; state x = x0, z = z0;
        param a = -0.8, b = -1.1, c = 0.6, tau_x = 0.3 in [0, 20], tau_z = 0.2 in [0, 9], tau_u = 0.2 in [0, 9], tau_y = 0.1 in [0, 9];
        der(x) = a*x + b*delay(x*z + sin(x), tau_x) + c*delay(z, tau_z) + delay(u, tau_u);
        der(z) = -z - delay(z*v, tau_z + 2*tau_x) + c*delay(u*x, tau_u);
        output y = delay(x, tau_y); output w = z + c*delay(u*x + z, 2*tau_y); output s = delay(z, tau_z); }";
    let several = model(text);
    for (tau_x, tau_z) in [(0.313, 0.1771), (0.0213, 0.517), (0.041, 0.033), (0.7, 0.0)] {
        let set = [("tau_x", tau_x), ("tau_z", tau_z), ("tau_u", 0.231), ("tau_y", 0.0871)];
        check(&several, &run(&several, uneven(50, 0.1)), 1, &set);
        check(&several, &run(&several, even(25, 0.2)), 3, &set);
    }
}

#[test]
fn sensitivities_of_many_states_and_many_parameters() {
    let terms: Vec<String> = (0..9).map(|k| format!("p{k}*delay(x{}, tau{})", (k + 4) % 9, k % 3)).collect();
    let equations: Vec<String> =
        (0..9).map(|k| format!("der(x{k}) = -x{k} + {} + u*{};", terms[k], 1 + k % 2)).collect();
    let names = |prefix: &str, value: f64| {
        (0..9).map(|k| format!("{prefix}{k} = {}", value + 0.1 * k as f64)).collect::<Vec<_>>().join(", ")
    };
    let states: Vec<String> = (0..9).map(|k| format!("x{k} = i{k}")).collect();
    let text = format!(
        "model wide {{ input u; param {}, {}, tau0 = 0.05 in [0, 1], tau1 = 0.16 in [0, 1], tau2 = 0.31 in [0, 1]; state {}; {}
        output y = x0 + x1*x2; output z = x3 - x4 + x5*x6; output w = x7 + x8; }}",
        names("p", -0.5),
        names("i", 0.2),
        states.join(", "),
        equations.join(" ")
    );
    let wide = model(&text);
    check(&wide, &run(&wide, even(20, 0.1)), 1, &[]);
}

/// x' = -x(t - tau), x = 1 before: sum of (-1)^k (t - (k - 1) tau)^k / k! over k with t > (k - 1) tau; and its
/// derivative by tau.
fn steps(t: f64, tau: f64) -> (f64, f64) {
    let (mut x, mut by_tau, mut factorial) = (1.0, 0.0, 1.0);
    for k in 1..60 {
        let (order, rest) = (f64::from(k), t - f64::from(k - 1) * tau);
        factorial *= order;
        if rest <= 0.0 {
            break;
        }
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        x += sign * rest.powi(k) / factorial;
        by_tau -= sign * (order - 1.0) * rest.powi(k - 1) / (factorial / order);
    }
    (x, by_tau)
}

#[test]
fn the_method_of_steps_gives_the_same_response_and_derivative() {
    let decay = model("model d { state x = 1; param tau = 1 in [0, 9]; der(x) = -delay(x, tau); output y = x; }");
    for tau in [1.0, 0.7312, 1.4] {
        let run = run(&decay, even(49, 0.125));
        let (y, jacobian) = linearised(&decay, &run, 8, &[tau]);
        for (k, t) in run.time.iter().enumerate() {
            let (x, by_tau) = steps(*t, tau);
            assert!((y[k] - x).abs() < 1e-8, "tau = {tau}, t = {t}: {} instead of {x}", y[k]);
            assert!((jacobian[0][k] - by_tau).abs() < 1e-6, "tau = {tau}, t = {t}: {} {by_tau}", jacobian[0][k]);
        }
    }
}

/// Largest errors of a response with 1, 2, 4, ... steps between samples.
fn errors(model: &Model, run: &Run, set: &[(&str, f64)], exact: impl Fn(f64) -> f64) -> Vec<f64> {
    let theta = theta(model, set);
    let error = |per: usize| {
        let y = response(model, run, per, &theta);
        y.iter().zip(&run.time).fold(0.0_f64, |e, (y, t)| e.max((y - exact(*t)).abs()))
    };
    (0..8).map(|k| error(1 << k)).collect()
}

#[test]
fn orders_of_convergence() {
    let decay = model("model d { state x = 1; param tau = 1 in [0, 9]; der(x) = -delay(x, tau); output y = x; }");
    for tau in [1.0, 0.7312, 0.1, 1.4, 0.03, 0.0] {
        let run = run(&decay, even(26, 0.25));
        let e = errors(&decay, &run, &[("tau", tau)], |t| if tau == 0.0 { (-t).exp() } else { steps(t, tau).0 });
        eprintln!("tau {tau}: {}", e.iter().map(|e| format!("{e:.1e} ")).collect::<String>());
    }
    let cases = [
        "input u; state x = 1, z; param tau = 0.7312 in [0, 9]; der(x) = -2*x - 4*delay(x, tau); der(z) = x - z; output y = x + z;",
        "input u; state x = 1, z; param tau = 0.7312 in [0, 9]; der(x) = -2*x - 4*delay(x, tau) + 0.5*delay(x, 0.317) + u; der(z) = x - z; output y = x + z;",
        "input u; state x = 1, z; param tau = 0.7312 in [0, 9]; der(x) = -2*x - 4*delay(x, tau) + 0.5*delay(x, 0.317) + delay(u, 0.113); der(z) = x - z; output y = delay(x, 0.1733) + z;",
        "input u; state x = 1, z; param tau = 0.7312 in [0, 9]; der(x) = 1.5*delay(x, tau)*(1 - x) - delay(x, 0.317)^3; der(z) = delay(x, tau)^2 - z; output y = x + z;",
        "input u; state x = 1, z; param tau = 0.7312 in [0, 9]; der(x) = 1.5*delay(x, tau)*(1 - x) - delay(x, 0.317)^3 + delay(u, 0.113); der(z) = delay(x, tau)^2 - z; output y = x + z;",
    ];
    for case in cases {
        let m = model(&format!("model m {{ {case} }}"));
        let run = run(&m, even(41, 0.125));
        let theta = m.definition().start();
        let exact = response(&m, &run, 1024, &theta);
        let e: Vec<f64> = (0..8)
            .map(|k| {
                response(&m, &run, 1 << k, &theta).iter().zip(&exact).fold(0.0_f64, |e, (a, b)| e.max((a - b).abs()))
            })
            .collect();
        eprintln!("{case}: {}", e.iter().map(|e| format!("{e:.1e} ")).collect::<String>());
    }
}
