//! Delayed states in equations: sensitivities against differences of the same simulation, responses against the method
//! of steps, orders of convergence, and delays found again.

use fdm::estimate::{Changes, FitOptions, Work, fit};
use fdm::record::Run;
use fdm::simulate::{Simulator, StepOptions, Steps, choose_steps};
use fdm::{Model, code};
use std::f64::consts::PI;
use support::model;

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
        stated: Vec::new(),
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

fn response(model: &Model, run: &Run, steps: impl Into<Steps>, theta: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; run.len() * model.layout().outputs];
    let mut simulator = Simulator::new(model.dynamics(), run, steps).expect("suited");
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
    // h b = -3: a fixed-point iteration would diverge
    let fast = "model fast { input u; param x0 = 0.7; state x = x0; param b = -6, tau = 0.02 in [0, 1];
        der(x) = b*delay(x, tau) + u; output y = x; }";
    let fast = model(fast);
    check(&fast, &run(&fast, even(30, 0.5)), 1, &[]);
}

#[test]
fn sensitivities_by_the_time_that_a_recorder_was_late() {
    let linear =
        "model linear { input u, w; param x0 = 0.7; state x = x0, z; param a = -1.1, b = 0.8, tau = -0.3 in [-20, 1];
        der(x) = a*x + b*delay(u, tau) + z; der(z) = -2*z + delay(w, tau); output y = x + 0.1*delay(w, tau); }";
    let curved = linear.replace("a*x", "a*x*hypot(x, 0.2)");
    for text in [linear, &curved] {
        let late = model(text);
        for tau in [-0.31, -0.27, -1.337, -0.013, -5.555] {
            check(&late, &run(&late, even(60, 0.1)), 2, &[("tau", tau)]);
            check(&late, &run(&late, uneven(60, 0.1)), 1, &[("tau", tau)]);
        }
        let held = Run { held: vec![true, false], ..run(&late, even(60, 0.1)) };
        check(&late, &held, 1, &[("tau", -0.317)]);
    }
}

#[test]
fn a_step_that_sees_itself_leaves_zero_and_lives_with_noise() {
    let text = "model rest { input u; state x, z; param b = -1.3, tau = 0.02 in [0, 1];
        der(x) = b*delay(x, tau) + u; der(z) = b*delay(z, tau) + 0.1*x; output o = x + z; }";
    let rest = model(text);
    check(&rest, &run(&rest, even(30, 0.1)), 1, &[]);
    // y - z is nothing but rounding, and n is driven by it alone
    let text = "model rounding { input u; state y, z, n; param tau = 0.02 in [0, 1];
        der(y) = 0.1*u*3 - y; der(z) = 0.3*u - z; der(n) = y - z - 2*delay(n, tau); output o = y; output m = n; }";
    let noise = model(text);
    let y = response(&noise, &run(&noise, even(200, 0.1)), 1, &[0.02]);
    assert!(y.chunks_exact(2).all(|y| y[1].abs() < 1e-15));
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

/// The solution of x' = b x(t - p) + c x(t - q) + u(t - r) by the method of steps, for x = 1 until 0 and u linear between samples
/// of a run, constant before: polynomial pieces.
struct BySteps<'r> {
    b: f64,
    c: f64,
    delays: [f64; 3],
    run: &'r Run,
}

impl BySteps<'_> {
    /// The fundamental solution, integrated `times` times: sum of (n over i) b^i c^j (t - i p - j q)^(n + times)/(n + times)!
    fn fundamental(&self, t: f64, times: i32) -> f64 {
        let [p, q, _] = self.delays;
        let mut sum = 0.0;
        for i in 0..60 {
            // the next term of the inner sum by the one before
            let (mut factor, mut power) = (1.0, f64::from(i + times));
            for k in 1..=i {
                factor *= self.b / f64::from(k);
            }
            for k in i + 1..=i + times {
                factor /= f64::from(k);
            }
            for j in 0..60 {
                let rest = t - f64::from(i) * p - f64::from(j) * q;
                if rest <= 0.0 || factor == 0.0 {
                    break;
                }
                sum += factor * rest.powf(power);
                power += 1.0;
                let n = f64::from(i + j + 1);
                factor *= self.c * n / (f64::from(j + 1) * power);
            }
        }
        sum
    }

    fn at(&self, t: f64) -> f64 {
        let (u, time) = (&self.run.inputs, &self.run.time);
        let slope = |k: usize| if k == 0 || k >= u.len() { 0.0 } else { (u[k] - u[k - 1]) / (time[k] - time[k - 1]) };
        let kinks = (0..u.len()).map(|k| (slope(k + 1) - slope(k)) * self.fundamental(t - time[k] - self.delays[2], 2));
        1.0 + (self.b + self.c + u[0]) * self.fundamental(t, 1) + kinks.sum::<f64>()
    }
}

/// Largest errors of a response with 2, 4, ... steps between samples.
fn errors(model: &Model, run: &Run, set: &[(&str, f64)], exact: impl Fn(f64) -> f64) -> Vec<f64> {
    let theta = theta(model, set);
    let exact: Vec<f64> = run.time.iter().map(|t| exact(*t)).collect();
    let error = |per: usize| {
        let y = response(model, run, per, &theta);
        y.iter().zip(&exact).fold(0.0_f64, |e, (y, x)| e.max((y - x).abs()))
    };
    (1..7).map(|k| error(1 << k)).collect()
}

/// The order with which errors of halved steps fall, over the whole sequence.
fn order(errors: &[f64]) -> f64 {
    let above: Vec<f64> = errors.iter().copied().take_while(|e| *e > 1e-13).collect();
    if above.len() < 2 {
        return 0.0;
    }
    (above[0] / above[above.len() - 1]).log2() / (above.len() - 1) as f64
}

const LINEAR: &str =
    "model linear { input u; state x = 1; param b = -1, c = 0, p = 1 in [0, 9], q = 0 in [0, 9], r = 0 in [0, 9];
    der(x) = b*delay(x, p) + c*delay(x, q) + delay(u, r); output y = x; }";

#[test]
fn linear_delay_equations_converge_to_the_method_of_steps() {
    let linear = model(LINEAR);
    let (mut forced, mut free) = (run(&linear, even(33, 0.125)), run(&linear, even(33, 0.125)));
    free.inputs.fill(0.0);
    forced.inputs.iter_mut().enumerate().for_each(|(k, u)| *u = f64::from(k as u8 % 7) * 0.3 - 0.5);
    for (run, set) in [
        (&free, [-1.0, 0.0, 1.0, 0.0, 0.0]),
        (&free, [-1.0, 0.0, 0.7312, 0.0, 0.0]),
        (&free, [-1.7, 0.0, 0.9131, 0.0, 0.0]),
        (&free, [-1.0, 0.0, 0.0123, 0.0, 0.0]),
        (&free, [-1.0, -0.7, 0.7312, 0.4417, 0.0]),
        (&free, [-2.0, 0.9, 0.5, 0.0177, 0.0]),
        (&forced, [-1.0, 0.0, 0.7312, 0.0, 0.0]),
        (&forced, [-1.0, -0.7, 0.7312, 0.4417, 0.0713]),
    ] {
        let [b, c, p, q, r] = set;
        let steps = BySteps { b, c, delays: [p, q, r], run };
        let set = [("b", b), ("c", c), ("p", p), ("q", q), ("r", r)];
        let errors = errors(&linear, run, &set, |t| steps.at(t));

        // pieces of polynomials on the grid are found exactly
        let exact = errors[0] < 1e-13;
        assert!((exact || order(&errors) > 3.4) && errors[5] < 1e-9, "{set:?}: {errors:?}");
    }
}

#[test]
fn a_decay_beside_the_delay_converges_with_order_four() {
    // x = 1 + (a + b) int X, X = sum of b^k (t - k tau)^k exp(a (t - k tau))/k!
    let text = "model m { input u; state x = 1; param a = -1.3, b = -2, tau = 0.4371 in [0, 9]; der(x) = a*x + b*delay(x, tau); output y = x; }";
    let decay = model(text);
    let run = run(&decay, even(25, 0.125));
    for tau in [0.4371, 0.03, 0.0] {
        let (a, b) = (-1.3, -2.0);
        let fundamental = |t: f64| {
            let (mut sum, mut factor) = (0.0, 1.0);
            for k in 0..200 {
                let rest = t - f64::from(k) * tau;
                if rest < 0.0 {
                    break;
                }
                sum += factor * rest.powi(k) * (a * rest).exp();
                factor *= b / f64::from(k + 1);
            }
            sum
        };
        let exact = |t: f64| {
            if tau == 0.0 {
                return ((a + b) * t).exp();
            }
            // Gauss's three points on pieces between the kinks
            let pieces =
                (0..).map(|k| (f64::from(k) * tau, (f64::from(k + 1) * tau).min(t))).take_while(|(l, _)| *l < t);
            let piece = |(low, high): (f64, f64)| {
                let h = (high - low) / 20.0;
                let part = |m: i32, x: f64| fundamental(low + h * (f64::from(m) + 0.5 + x * 0.15_f64.sqrt()));
                (0..20).map(|m| h / 18.0 * (5.0 * part(m, -1.0) + 8.0 * part(m, 0.0) + 5.0 * part(m, 1.0))).sum::<f64>()
            };
            1.0 + (a + b) * pieces.map(piece).sum::<f64>()
        };
        let errors = errors(&decay, &run, &[("tau", tau)], exact);
        assert!(order(&errors) > 3.6, "{tau}: {errors:?}");
    }
}

#[test]
fn nonlinear_delay_equations_converge_with_order_three_across_kinks() {
    let cases = [
        "der(x) = 1.5*delay(x, tau)*(1 - x) - delay(x, 0.317)^3; output y = x;",
        "der(x) = 1.5*delay(x, tau)*(1 - x) - delay(x, 0.317)^3 + delay(u, 0.113); output y = x;",
        "der(x) = 1.5*delay(x, tau)*(1 - x) + u*delay(x*u, 0.113); output y = delay(x, 0.1733);",
    ];
    for case in cases {
        let nonlinear = model(&format!("model m {{ input u; state x = 0.6; param tau = 0.7312 in [0, 9]; {case} }}"));
        let run = run(&nonlinear, even(41, 0.125));
        let exact = response(&nonlinear, &run, 1024, &[0.7312]);
        let at = |t: f64| exact[(t / 0.125).round() as usize];
        let errors = errors(&nonlinear, &run, &[], at);
        assert!(order(&errors) > 2.5, "{case}: {errors:?}");
        let chosen = choose_steps(nonlinear.dynamics(), &run, &[0.7312], &StepOptions::default()).expect("suited");
        let y = response(&nonlinear, &run, chosen.steps.clone(), &[0.7312]);
        let (low, high) = exact.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let error = y.iter().zip(&exact).fold(0.0_f64, |e, (y, x)| e.max((y - x).abs())) / (high - low);
        assert!(chosen.error <= 1e-8 && error < 3e-8, "{chosen:?} {error:e}");
    }
}

#[test]
fn the_derivative_by_the_delay_has_its_closed_form() {
    // x' = -x(t - tau), x = 1 before: x = 1 + sum of (-1)^k (t - (k - 1) tau)^k/k!
    let decay = model("model d { state x = 1; param tau = 1 in [0, 9]; der(x) = -delay(x, tau); output y = x; }");
    let run = run(&decay, even(49, 0.125));
    for tau in [1.0, 0.7312, 1.4, 0.0871] {
        let (y, jacobian) = linearised(&decay, &run, 16, &[tau]);
        for (n, t) in run.time.iter().enumerate() {
            let (mut x, mut by_tau, mut factor) = (1.0, 0.0, 1.0);
            for k in 1..200 {
                let rest = t - f64::from(k - 1) * tau;
                if rest <= 0.0 {
                    break;
                }
                by_tau -= -factor * f64::from(k - 1) * rest.powi(k - 1);
                factor *= -1.0 / f64::from(k);
                x += factor * rest.powi(k);
            }
            assert!((y[n] - x).abs() < 1e-9, "tau = {tau}, t = {t}: {} instead of {x}", y[n]);
            assert!((jacobian[0][n] - by_tau).abs() < 2e-7, "tau = {tau}, t = {t}: {} {by_tau}", jacobian[0][n]);
        }
    }
}

#[test]
fn a_response_goes_smoothly_through_delays_of_one_step_and_none() {
    // second differences of a smooth function are small of second order, a jump of the value or slope would stand out
    let one = model(ONE);
    let run = run(&one, even(30, 0.125));
    for (around, step) in [(0.125, 1e-4), (0.25, 1e-4), (1e-4, 5e-5)] {
        let at = |k: f64| response(&one, &run, 1, &theta(&one, &[("tau", around + k * step)]));
        let samples: Vec<Vec<f64>> = [-2.0, -1.0, 0.0, 1.0, 2.0].iter().map(|k| at(*k)).collect();
        for (low, middle, high) in [(0, 1, 2), (1, 2, 3), (2, 3, 4)] {
            let pairs = samples[low].iter().zip(&samples[middle]).zip(&samples[high]);
            let second = pairs.map(|((a, b), c)| (a - 2.0 * b + c).abs()).fold(0.0, f64::max);
            assert!(second < 40.0 * step * step, "tau = {around}: {second:e}");
        }
    }
}

#[test]
fn engines_and_the_macro_give_the_same_bits() {
    let by_macro = fdm::model! {
        model one {
            input u; param x0 = 0.7, z0 = -0.4 per run; state x = x0, z = z0;
            param a = -0.8, b = -1.1, c = 0.6, tau = 0.3 in [0, 20];
            der(x) = a*x + b*delay(x, tau) + c*z + u; der(z) = -z*hypot(z, 0.3) - delay(x, tau)*x + c*u;
            output y = x; output w = z + c*x;
        }
    };
    let by_file = model(ONE);
    let tape = code::compile(by_file.schedule(), code::Engine::Tape);
    let run = run(&by_file, uneven(60, 0.1));
    for tau in [0.03, 0.3117] {
        let theta = theta(&by_file, &[("tau", tau)]);
        let columns: Vec<usize> = (0..theta.len()).collect();
        let results = [by_file.dynamics(), &*tape, by_macro.dynamics()].map(|dynamics| {
            let (mut y, mut jacobian) = (vec![0.0; 120], vec![0.0; 120 * 8]);
            let mut simulator = Simulator::new(dynamics, &run, 2).expect("suited");
            simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("finite");
            // again, by memory that has been used with another delay
            let mut other = theta.clone();
            other[columns.len() - 1] = 2.0;
            let mut again = vec![0.0; 120];
            simulator.simulate(&other, &mut again).expect("finite");
            simulator.simulate(&theta, &mut again).expect("finite");
            assert_eq!(again, y);
            (y, jacobian)
        });
        assert!(results[0] == results[1] && results[0] == results[2]);
    }
}

#[test]
fn divergence_is_a_finding() {
    let text = "model m { input u; state calm, x = 1; param tau = 0.1 in [0, 9]; der(calm) = -calm; der(x) = 3*delay(x, tau)*x; output y = x; }";
    let blows = model(text);
    let run = run(&blows, even(60, 0.1));
    for tau in [0.31, 0.02] {
        let mut simulator = Simulator::new(blows.dynamics(), &run, 4).expect("suited");
        let found = simulator.simulate(&[tau], &mut [0.0; 60]).expect_err("it grows faster than any exponential");
        assert!(found.time > 0.2 && found.time < 6.0, "{found:?}");
        let stride = 8;
        let again = simulator.sensitivities(&[tau], &[0], &mut [0.0; 60], &mut vec![0.0; 60 * stride]);
        assert_eq!(again, Err(found));
    }
    let mut simulator = Simulator::new(blows.dynamics(), &run, 1).expect("suited");
    assert!(
        simulator.simulate(&[f64::NAN], &mut [0.0; 60]).is_err()
            && simulator.simulate(&[-0.1], &mut [0.0; 60]).is_err()
    );
}

#[test]
fn a_past_that_memory_cannot_hold_is_an_error() {
    let params: Vec<String> = (0..400).map(|k| format!("p{k} = {k}")).collect();
    let terms: Vec<String> = (0..400).map(|k| format!("p{k}")).collect();
    let text = format!(
        "model m {{ input u; state x = 1; param {}, tau = 1 in [0, inf]; der(x) = -delay(x, tau); output y = x + ({}); }}",
        params.join(", "),
        terms.join(" + ")
    );
    let long = model(&text);
    let mut run = run(&long, even(1001, 1.0));
    run.measured.fill(0.0);
    let mut simulator = Simulator::new(long.dynamics(), &run, 256).expect("suited");
    assert_eq!(simulator.suits(&theta(&long, &[("tau", 100.0)])), Ok(()));
    let found = simulator.suits(&theta(&long, &[("tau", 2000.0)])).expect_err("300 million numbers");
    assert!(found.to_string().contains("reaches back over"), "{found}");
    assert!(simulator.simulate(&theta(&long, &[("tau", 100.0)]), &mut vec![0.0; 1001]).is_ok());
    // a fit on steps that the user chose says the same
    let changes = Changes { set: vec![("tau".into(), 2000.0)], ..Changes::default() };
    let options = FitOptions { changes, per_interval: Some(256), ..FitOptions::default() };
    let found = fit(&long, &[run.clone()], &options, &Work::default()).expect_err("300 million numbers");
    assert!(
        found.to_string().contains("run `multisine`: ") && found.to_string().contains("reaches back over"),
        "{found}"
    );
}

#[test]
fn delays_of_a_state_an_input_and_an_output_are_found_again() {
    let text = "model loop_with_delays {
        input u; state x, z;
        param a = 1 in [0, 20], g = -1.5 in [-20, 0], c = 1 in [0, 20], tau_u = 0.1 in [0, 1], tau_x = 0.3 in [0, 2], tau_y = 0.1 in [0, 1];
        der(x) = -a*x + g*delay(z, tau_x) + delay(u, tau_u); der(z) = x - c*z;
        output y = delay(x, tau_y); output w = z; }";
    let truth = [("a", 0.7), ("g", -2.3), ("c", 1.6), ("tau_u", 0.1637), ("tau_x", 0.4419), ("tau_y", 0.0713)];
    let looped = model(text);
    let mut run = run(&looped, even(500, 0.04));
    run.inputs.iter_mut().zip(&run.time).for_each(|(u, t)| *u *= (t / 2.0).min(1.0));
    run.measured = response(&looped, &run, 64, &theta(&looped, &truth));
    let found = fit(&looped, std::slice::from_ref(&run), &FitOptions::default(), &Work::default()).expect("runs");
    assert!(found.estimate.is_good(), "{}", found.estimate.termination);
    for (name, want) in truth {
        let got = found.estimate.parameter(name, None).expect("estimated").value;
        assert!((got - want).abs() < 1e-6 * want.abs(), "{name}: {got} instead of {want}");
    }
}
