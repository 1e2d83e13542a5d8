//! Linear models by recursion: against Runge-Kutta stage by stage, against tiny steps, against closed forms and central
//! differences.

use fdm::Model;
use fdm::record::Run;
use fdm::simulate::{Scheme, Simulator, StepOptions, Steps, choose_steps};
use std::f64::consts::PI;
use support::model;

/// Samples at the given times of a sum of sines.
fn run(model: &Model, time: Vec<f64>) -> Run {
    let (m, q) = (model.layout().inputs, model.layout().outputs);
    let input = |t: f64, i: usize| (1..4).map(|h| (2.0 * PI * 0.3 * h as f64 * t + i as f64 + h as f64).sin()).sum();
    let sine: &dyn Fn(f64, usize) -> f64 = &input;
    Run {
        name: "sines".into(),
        inputs: time.iter().flat_map(|t| (0..m).map(move |i| sine(*t, i))).collect(),
        measured: vec![f64::NAN; time.len() * q],
        held: vec![false; m],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
        time,
    }
}

fn even(n: usize, dt: f64) -> Vec<f64> {
    (0..n).map(|k| k as f64 * dt).collect()
}

/// Free parameters in an order of their own.
fn columns(model: &Model) -> Vec<usize> {
    (0..model.layout().params).rev().filter(|k| !model.definition().params[*k].fixed).collect()
}

fn exact(model: &Model) -> Scheme {
    let run = run(model, even(3, 0.1));
    choose_steps(model.dynamics(), &run, &model.definition().start(), &StepOptions::default())
        .expect("suited")
        .steps
        .scheme()
}

/// Outputs and Jacobian.
fn response(model: &Model, run: &Run, scheme: Scheme, per: usize) -> (Vec<f64>, Vec<f64>) {
    let (theta, columns) = (model.definition().start(), columns(model));
    let mut simulator = Simulator::new(model.dynamics(), run, Steps::equal(scheme, per)).expect("suited");
    let rows = run.len() * model.layout().outputs;
    let (mut y, mut plain) = (vec![0.0; rows], vec![0.0; rows]);
    let mut jacobian = vec![f64::NAN; rows * columns.len().next_multiple_of(8)];
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("finite");
    simulator.simulate(&theta, &mut plain).expect("finite");
    assert_eq!(y, plain, "with and without sensitivities the same bits");
    (y, jacobian)
}

/// Largest difference in a column, relative to the column's largest number.
fn difference(a: &[f64], b: &[f64], columns: usize) -> f64 {
    assert_eq!(a.len(), b.len());
    let column = |c: usize| {
        let pairs = || a.iter().zip(b).skip(c).step_by(columns);
        let size = pairs().map(|(a, _)| a.abs()).fold(0.0, f64::max);
        let apart = pairs().map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(pairs().all(|(a, b)| a.is_finite() && b.is_finite()));
        if size > 0.0 { apart / size } else { apart }
    };
    (0..columns).map(column).fold(0.0, f64::max)
}

/// The same equations, disguised so that nothing proves them linear.
fn disguised(text: &str) -> Model {
    let place = text.find("der(").expect("an equation");
    let state = text[place + 4..].split(')').next().expect("a state");
    let (head, tail) = text.split_at(place);
    let end = tail.find(';').expect("its end");
    model(&format!(
        "{head}{} + nothing*{state}*abs({state}){}\n const nothing = 1e-300; }}",
        &tail[..end],
        tail[end..].trim_end().trim_end_matches('}')
    ))
}

/// Runge-Kutta by recursion and stage by stage, and the exact recursion against tiny steps.
fn compare(text: &str, run_of: impl Fn(&Model) -> Run, tiny: usize, tolerance: f64) {
    let (linear, hidden) = (model(text), disguised(text));
    assert!(linear.layout().affine.rates && !hidden.layout().affine.rates);
    let run = run_of(&linear);
    let stride = columns(&linear).len().next_multiple_of(8);
    for per in [1, 3] {
        let ((y, j), (want_y, want_j)) =
            (response(&linear, &run, Scheme::RungeKutta, per), response(&hidden, &run, Scheme::RungeKutta, per));
        let (dy, dj) = (
            difference(&want_y, &y, linear.layout().outputs),
            rows_apart(&want_j, &j, stride, linear.layout().outputs),
        );
        assert!(dy < 1e-12 && dj < 1e-11, "{per} steps: outputs {dy:e}, sensitivities {dj:e}");
    }
    let scheme = exact(&linear);
    assert!(matches!(scheme, Scheme::ExactDiscretisation { .. }), "{scheme:?}");
    let per = if linear.layout().delayed.is_empty() { 1 } else { tiny / 4 };
    let ((y, j), (want_y, want_j)) =
        (response(&linear, &run, scheme, per), response(&hidden, &run, Scheme::RungeKutta, tiny));
    let (dy, dj) =
        (difference(&want_y, &y, linear.layout().outputs), rows_apart(&want_j, &j, stride, linear.layout().outputs));
    assert!(dy < tolerance && dj < tolerance, "exact: outputs {dy:e}, sensitivities {dj:e}");
}

/// As `difference`, for every output and column by itself.
fn rows_apart(a: &[f64], b: &[f64], stride: usize, outputs: usize) -> f64 {
    difference(a, b, stride * outputs)
}

const HOVER: &str = include_str!("../../models/helicopter_benchmark/model.fdm");

#[test]
fn a_helicopter_in_three_subsystems() {
    compare(HOVER, |m| run(m, even(700, 1.0 / 350.0)), 64, 1e-10);
    let hover = model(HOVER);
    let Scheme::ExactDiscretisation { subsystems } = exact(&hover) else { panic!("it is linear") };
    assert_eq!(subsystems, 3);
}

/// Thirteen masses in a row: more states than are discretised exactly in any case. With stiff springs, whose steps would have to be short,
/// exact discretisation pays; with soft ones it does not.
#[test]
fn many_states_are_discretised_exactly_where_steps_would_be_short() {
    let chain = |stiffness: f64| -> String {
        let masses = 13;
        let mut text = String::from("model chain { input u; param b = 2;\n");
        for i in 0..masses {
            let next = if i + 1 < masses { format!(" + f{}", i + 1) } else { String::new() };
            let before = if i > 0 { format!("(x{i} - x{})", i - 1) } else { "x0".into() };
            text.push_str(&format!(
                "state x{i} = 0, v{i} = 0; param k{i} = {};\n",
                stiffness * (1.0 + 0.05 * f64::from(i))
            ));
            text.push_str(&format!("let f{i} = k{i}*{before}; der(x{i}) = v{i};\n"));
            text.push_str(&format!("der(v{i}) = -f{i}{next} - 0.3*v{i}{};\n", if i == 0 { " + b*u" } else { "" }));
        }
        text + "output y = x12, z = x0 + k3*x4; }"
    };
    let chosen = |model: &Model| {
        let run = run(model, even(300, 0.1));
        let found =
            choose_steps(model.dynamics(), &run, &model.definition().start(), &StepOptions::default()).expect("suited");
        assert!(found.error <= 1e-8, "{found:?}");
        found.steps.scheme()
    };
    let (soft, stiff) = (model(&chain(0.02)), chain(200.0));
    assert_eq!(chosen(&soft), Scheme::RungeKutta);
    let (linear, hidden) = (model(&stiff), disguised(&stiff));
    assert_eq!(chosen(&linear), Scheme::ExactDiscretisation { subsystems: 1 });
    let run = run(&linear, even(60, 0.1));
    let ((y, j), (want_y, want_j)) = (
        response(&linear, &run, Scheme::ExactDiscretisation { subsystems: 1 }, 1),
        response(&hidden, &run, Scheme::RungeKutta, 256),
    );
    let (dy, dj) = (difference(&want_y, &y, 2), rows_apart(&want_j, &j, columns(&linear).len().next_multiple_of(8), 2));
    assert!(dy < 1e-8 && dj < 1e-8, "outputs {dy:e}, sensitivities {dj:e}");
}

const EVERYTHING: &str = "model everything { input u, w; param a = -0.7, b = 1.3, c = 0.2, tau = 0.137 in [0, 1], bias = 0.4, x0 = 1.5, z0 = -0.3; \
     state x = x0*a, z = z0, s; \
     der(x) = a*x + z/(b^2 + 1) + delay(u, tau)*b + c; der(z) = -2*x - 0.3*z + (if a > 0 then u else 2*u) - w; \
     der(s) = -b*s + delay(w, 0.05); \
     output y1 = x; output y2 = b*x + c*delay(u, tau) + bias; output y3 = s; output y4 = s; output y5 = w*a; }";

#[test]
fn delays_constants_and_outputs_that_mix() {
    compare(EVERYTHING, |m| run(m, even(200, 0.05)), 32, 1e-9);
}

#[test]
fn held_inputs_and_two_lengths_of_intervals() {
    let held = |m: &Model| {
        let mut run = run(m, (0..150).map(|k| (f64::from(k) * 50.0 / 3.0).round() / 1000.0).collect());
        run.held[1] = true;
        run
    };
    compare(EVERYTHING, held, 64, 1e-9);
}

#[test]
fn outputs_that_are_not_linear_are_observed_in_general() {
    let text = "model m { input u; param k = 2, d = 0.3, g = 1.1; state x = g, v; der(x) = v; der(v) = -k*x - d*v + u; \
                output y1 = g*x^2 + sin(v); output y2 = t*x; output y3 = v; }";
    compare(text, |m| run(m, even(120, 0.05)), 64, 1e-10);
}

#[test]
fn many_parameters_and_a_stiff_block() {
    let params: String = (0..20).map(|k| format!("param p{k} = {}; ", 0.1 + 0.05 * f64::from(k))).collect();
    let sum: Vec<String> = (0..20).map(|k| format!("p{k}*u*{}", 1 + k % 3)).collect();
    let text = format!(
        "model m {{ input u; {params} param fast = 400; state x, y1, y2; der(x) = -fast*(x - y1); \
         der(y1) = -y1 + {} - 0.2*y2; der(y2) = y1*p3 - p4*y2; output o1 = x; output o2 = y2; }}",
        sum.join(" + ")
    );
    compare(&text, |m| run(m, even(60, 0.005)), 256, 1e-9);
}

/// An undamped oscillator from (1, 0), and a first-order lag under a ramp.
#[test]
fn closed_forms() {
    let swing = model("model s { param w = 3; state x = 1, v; der(x) = v; der(v) = -w^2*x; output y = x; }");
    let run = run(&swing, even(100, 0.7));
    let (y, jacobian) = response(&swing, &run, exact(&swing), 1);
    for (k, t) in run.time.iter().enumerate() {
        let (want, by_w) = ((3.0 * t).cos(), -t * (3.0 * t).sin());
        assert!((y[k] - want).abs() < 1e-12 && (jacobian[8 * k] - by_w).abs() < 1e-10, "{t}: {} {want}", y[k]);
    }
}

#[test]
fn central_differences_agree() {
    let everything = model(EVERYTHING);
    let run = run(&everything, even(120, 0.05));
    let (mut theta, columns, q) = (everything.definition().start(), columns(&everything), 5);
    for scheme in [Scheme::RungeKutta, exact(&everything)] {
        let (_, jacobian) = response(&everything, &run, scheme, 1);
        let mut simulator = Simulator::new(everything.dynamics(), &run, Steps::equal(scheme, 1)).expect("suited");
        for (lane, column) in columns.iter().enumerate() {
            let at = theta[*column];
            let mut moved = |by: f64| {
                let mut y = vec![0.0; run.len() * q];
                theta[*column] = at + by;
                simulator.simulate(&theta, &mut y).expect("finite");
                theta[*column] = at;
                y
            };
            let (h, name) = (1e-5, &everything.definition().params[*column].quantity.name);
            let (ahead, behind) = (moved(h), moved(-h));
            let apart = (0..run.len() * q)
                .map(|k| ((ahead[k] - behind[k]) / (2.0 * h) - jacobian[k * 8 + lane]).abs())
                .fold(0.0, f64::max);
            let size = (0..run.len() * q).map(|k| jacobian[k * 8 + lane].abs()).fold(0.0, f64::max);
            assert!(size > 1e-3 && apart < 1e-6 * size, "{scheme:?} {name}: {apart:e} of {size}");
        }
    }
}

#[test]
fn divergence_is_found_at_its_step() {
    let unstable =
        model("model m { param k = 60; state calm = 1, x = 1; der(calm) = -calm; der(x) = k*x; output y = x; }");
    let run = run(&unstable, even(500, 0.1));
    let mut simulator = Simulator::new(unstable.dynamics(), &run, Steps::equal(exact(&unstable), 1)).expect("suited");
    let mut y = vec![0.0; 500];
    let found = simulator.simulate(&[60.0], &mut y).expect_err("e^(60 t) overflows");
    // 709.78/60 = 11.83
    assert!((found.time - 11.9).abs() < 1e-9 && found.state == Some(1) && found.sample == 118, "{found:?}");
    assert!((y[118] / (60.0 * run.time[118]).exp() - 1.0).abs() < 1e-9, "rows before it are there");
}

#[test]
fn uneven_samples_are_left_to_runge_kutta() {
    let lag = model("model m { input u; param k = 2; state x; der(x) = k*(u - x); output y = x; }");
    let run = run(&lag, (0..60).map(|k| 0.1 * f64::from(k) + 0.002 * f64::from(k * k)).collect());
    let chosen =
        choose_steps(lag.dynamics(), &run, &lag.definition().start(), &StepOptions::default()).expect("suited");
    assert!(chosen.steps.scheme() == Scheme::RungeKutta && chosen.error < 1e-8, "{chosen:?}");
}
