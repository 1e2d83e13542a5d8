//! Sensitivities along trajectories: against central differences of the same simulation, against closed forms, and
//! between the engines.

use fdm::record::Run;
use fdm::simulate::{Scheme, Simulator, Steps};
use fdm::{Model, code};
use std::f64::consts::PI;
use support::model;

/// A smooth multisine over `n` samples, unevenly sampled.
fn run(model: &Model, n: usize, dt: f64) -> Run {
    let layout = model.layout();
    let (m, q) = (layout.inputs, layout.outputs);
    let time: Vec<f64> =
        (0..n).map(|k| dt * (k as f64 + 0.2 * (k as f64).sin() * f64::from(u8::from(k > 0)))).collect();
    let start = time[0];
    let time: Vec<f64> = time.iter().map(|t| t - start).collect();
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

/// Every column of the Jacobian against extrapolated central differences.
fn check(model: &Model, run: &Run, steps: impl Into<Steps>) {
    let columns: Vec<usize> = (0..model.layout().params).filter(|k| !model.definition().params[*k].fixed).collect();
    let mut simulator = Simulator::new(model.dynamics(), run, steps).expect("suited");
    let (rows, stride) = (run.len() * model.layout().outputs, columns.len().div_ceil(8) * 8);
    let (mut y, mut plain, mut jacobian) = (vec![0.0; rows], vec![0.0; rows], vec![f64::NAN; rows * stride]);
    let theta = model.definition().start();
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("finite");
    simulator.simulate(&theta, &mut plain).expect("finite");
    assert_eq!(y, plain, "with and without sensitivities the same bits");
    for (lane, column) in columns.iter().enumerate() {
        let name = &model.definition().params[*column].quantity.name;
        let mut at = |step: f64| {
            let mut moved = theta.clone();
            moved[*column] += step;
            let mut y = vec![0.0; rows];
            simulator.simulate(&moved, &mut y).expect("finite");
            y
        };
        // small for delays, whose second derivative jumps where a kink crosses the end of a step
        let h = if name.starts_with("tau") { 2e-6 } else { 2e-4 * theta[*column].abs().max(0.05) };
        let (a, b, c, d) = (at(h), at(-h), at(h / 2.0), at(-h / 2.0));
        let exact: Vec<f64> = (0..rows).map(|r| jacobian[r * stride + lane]).collect();
        let scale = exact.iter().fold(0.0_f64, |s, e| s.max(e.abs()));
        assert!(scale > 1e-6, "{name} moves nothing: a silent zero");
        let mut differing = 0;
        for r in 0..rows {
            let (wide, narrow) = ((a[r] - b[r]) / (2.0 * h), (c[r] - d[r]) / h);
            let best = (4.0 * narrow - wide) / 3.0;
            differing += usize::from((best - exact[r]).abs() > 2e-6 * scale);
        }
        assert!(differing == 0, "{name}: {differing} of {rows} rows differ from central differences");
    }
    assert!((0..rows).all(|r| jacobian[r * stride + columns.len()..(r + 1) * stride].iter().all(|j| *j == 0.0)));
}

const SHIP: &str = "model ship {
    input d; state u = free, v = free, r = r0; param r0 = 0.01 per run;
    param c1 = -0.1, c2 = -0.4, c3 = 0.3, c4 = -0.2, c5 = 0.5;
    der(u) = -0.1*(u - 2) + c1*v^2*u; der(v) = c2*v + c3*r*u + 0.1*d; der(r) = c4*r*abs(r) + c5*d*u - v;
    output um = u; output vm = v; output rm = r*u + d; }";

#[test]
fn nonlinear_states_and_initial_values() {
    let ship = model(
        &SHIP.replace("v = free", "v = v0; param v0 = 0.3").replace("u = free", "u = u0; param u0 = 1.5").replace(
            "state u = u0; param u0 = 1.5, v = v0; param v0 = 0.3, r = r0;",
            "param u0 = 1.5, v0 = 0.3; state u = u0, v = v0, r = r0;",
        ),
    );
    check(&ship, &run(&ship, 80, 0.1), 1);
    check(&ship, &run(&ship, 40, 0.2), 3);
    check(&ship, &run(&ship, 40, 0.2), Steps::counts(Scheme::RungeKutta, &[1, 4, 2]));
    check(&ship, &run(&ship, 40, 0.2), Steps::equal(Scheme::Radau, 1));
}

#[test]
fn delays_of_inputs_and_outputs_one_in_the_other() {
    let text = "model delays {
        input a, b; param x0 = 0.2; state x = x0, z;
        param k = 1.3, w = 2.1, tau_a = 0.137 in [0, 1], tau_b = 0.41 in [0, 1], tau_y = 0.083 in [0, 1], tau_n = 0.05 in [0, 1];
        let drive = delay(a*k + t, tau_a);
        der(x) = z; der(z) = -w^2*x - 0.4*z + drive + 0.5*delay(b, tau_b)*x;
        output y = delay(x + 0.1*b, tau_y); output n = delay(delay(z, tau_y), 2*tau_n) + k*x; output direct = x; }";
    let delays = model(text);
    check(&delays, &run(&delays, 120, 0.05), 1);
    check(&delays, &run(&delays, 60, 0.11), 4);
}

#[test]
fn delays_of_inputs_in_implicit_steps() {
    let text = "model delays {
        input a, b; param x0 = 0.2; state x = x0, z;
        param k = 1.3, w = 2.1, fast = 300, tau_a = 0.137 in [0, 1], tau_b = 0.41 in [0, 1];
        let drive = delay(a*k + t, tau_a);
        der(x) = -fast*(x - z) + drive; der(z) = -w^2*x - 0.4*z + drive + 0.5*delay(b, 2*tau_b)*x;
        output y = x; output both = x*z + 0.1*delay(b, tau_b); output zm = z; }";
    let delays = model(text);
    check(&delays, &run(&delays, 60, 0.11), Steps::equal(Scheme::Radau, 1));
    let held = Run { held: vec![true, false], ..run(&delays, 40, 0.11) };
    check(&delays, &held, Steps::equal(Scheme::Radau, 3));
}

#[test]
fn explicit_time_choices_and_functions() {
    let text = "model functions {
        input u; param x0 = 0.4; state x = x0;
        param a = 0.7, b = 1.2, c = 0.3, d = 2.3;
        der(x) = -a*tanh(x/c) + b*sin(d*t) + (if u > 0.2 then a*u else b*min(u, c));
        output y = exp(-c*x) + x^d*0 + hypot(x, b) + atan2(x, d); output z = max(x, a*t)*sqrt(b + t); }";
    let functions = model(&text.replace("x^d*0 + ", "(2 + x)^d*0.1 + "));
    check(&functions, &run(&functions, 90, 0.05), 2);
    check(&functions, &run(&functions, 30, 0.15), Steps::uneven(Scheme::Radau, [&[0.3, 1.0][..], &[0.1, 0.9, 1.0]]));
}

#[test]
fn stoichiometric_coefficients_and_orders_of_reaction() {
    let text = "model kinetics {
        input u; param a0 = 1.2, k = 0.8, d = 0.5, n = 1.7, m = 0.6; state A = a0, B = 1.4, C;
        let orders = (2 + B)^n;
        reactions { A + n*B -> C : k*A*orders*0.1; 0 + C -> 2*m*A + B : d*C*(1.5 + u*0.1); }
        output A_m = A, B_m = B, C_m = C; }";
    let kinetics = model(text);
    check(&kinetics, &run(&kinetics, 60, 0.1), 2);
    check(&kinetics, &run(&kinetics, 30, 0.2), Steps::equal(Scheme::Radau, 1));
}

/// An integrator between stops that move with params, whose own sensitivity is that of the stop while it stands there; seen by another
/// state, by outputs, with a delay, and by its derivative.
const STOPS: &str = "model stops {
    input u; param x0 = 0.1, top = 0.31, low = 0.27, k = 1.3, a = 0.6, b = 0.4, tau = 0.123 in [0, 1]; state x = x0, z, w = 0.05;
    der(x) = k*u - a*z; limit x in [-low, 0.5*top + 0.2];
    der(z) = x - b*z + 0.3*w; der(w) = 0.2*LATE - b*w + 0.4*der(x);
    output y = x; output zm = z*x; output rate = der(x) + w; }";

#[test]
fn states_at_their_limits_have_the_sensitivities_of_the_limits() {
    let now = model(&STOPS.replace("LATE", "sin(tau*x)"));
    check(&now, &run(&now, 90, 0.1), 1);
    check(&now, &run(&now, 90, 0.1), 4);
    check(&now, &run(&now, 60, 0.15), Steps::uneven(Scheme::Radau, [&[0.3, 1.0][..], &[0.1, 0.9, 1.0]]));
    let late = model(&STOPS.replace("LATE", "delay(x, tau)"));
    check(&late, &run(&late, 90, 0.1), 1);
    check(&late, &run(&late, 90, 0.1), 3);
    let soft = model(&STOPS.replace("LATE", "sin(tau*x)").replace("0.2];", "0.2] smooth 0.1*top;"));
    check(&soft, &run(&soft, 90, 0.1), 3);
    check(&soft, &run(&soft, 60, 0.15), Steps::equal(Scheme::Radau, 1));
}

/// An integrator that inputs and time drive from stop to stop, several instants to a step: coarse steps have the derivative of their own
/// response, and even these are exact where rates are polynomials between the cuts.
#[test]
fn steps_are_cut_where_limits_are_met_and_left() {
    let text = "model cut { input u; param top = 0.3, low = 0.25, k = 1.1, c = 0.4, x0 = 0.05; state x = x0, z;
        der(x) = k*u + c*cos(2*t) - 0.3*z; limit x in [-low, top]; der(z) = x - c*z; output y = x; output w = z; }";
    let cut = model(text);
    for (samples, interval, steps) in [(40, 0.25, 1), (40, 0.25, 3), (25, 0.4, 1)] {
        check(&cut, &run(&cut, samples, interval), steps);
    }
}

/// Branches that states, an input, time and params change, beside a limit: coarse steps have the derivative of their own response.
#[test]
fn steps_are_cut_at_kinks() {
    let text = "model kinks { input u; param c = 0.21, k = 1.7, b = 0.6, s = 0.4, top = 0.35, x0 = 0.05;
        table g(a) = linear { -1: -0.5, -0.3: -0.4, 0.2: 0.3, 1: 0.4 };
        state d = x0, z, w, m; limit m in [-top, top];
        der(d) = k*u - b*d - 0.5*z; der(z) = clip(d, -c, c) + g(d) - z; der(m) = d + 0.3*max(sin(2*t), s) - 0.4*m;
        der(w) = abs(d - 0.5*c) + max(s*u, z) - (if d > c then 2*d - c else d) - w + 0.1*m;
        output y = d; output v = z; output q = w + m; }";
    let kinks = model(text);
    for (samples, interval, steps) in [(40, 0.25, 1), (40, 0.25, 3), (60, 0.1, 1)] {
        check(&kinks, &run(&kinks, samples, interval), Steps::from(steps).cut_at_kinks());
    }
    // and so has order four: whole steps have not
    let run = run(&kinks, 40, 0.25);
    let response = |steps: Steps| {
        let mut y = vec![0.0; 3 * run.len()];
        Simulator::new(kinks.dynamics(), &run, steps).unwrap().simulate(&kinks.definition().start(), &mut y).unwrap();
        y
    };
    let off = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let exact = response(Steps::from(128).cut_at_kinks());
    let [coarse, fine] = [2, 8].map(|per| off(&response(Steps::from(per).cut_at_kinks()), &exact));
    let whole = off(&response(Steps::from(64)), &exact);
    assert!(fine < coarse / 100.0 && fine < 1e-5 && whole > fine, "{coarse:e} {fine:e} {whole:e}");
}

/// The integral of an input that is linear between samples, stopped at both sides: in closed form from sample to sample.
#[test]
fn an_integral_that_leaves_its_stop_inside_an_interval_is_exact() {
    let held = model("model small { input u; state d; der(d) = u; limit d in [-0.23, 0.31]; output y = d; }");
    let time: Vec<f64> = (0..60).map(|k| 0.3 * f64::from(k)).collect();
    let u: Vec<f64> = time.iter().map(|t| 1.1 * (1.3 * t).sin() + 0.7 * (2.9 * t + 0.4).cos()).collect();
    // the turns of the integral inside an interval are the roots of u: between them it moves in one direction, and is clipped
    let (mut d, mut exact) = (0.0_f64, vec![0.0]);
    for (t, u) in time.windows(2).zip(u.windows(2)) {
        let (h, slope) = (t[1] - t[0], (u[1] - u[0]) / (t[1] - t[0]));
        let turn = Some(-u[0] / slope).filter(|turn| *turn > 0.0 && *turn < h);
        let moved = |from: f64, to: f64| u[0] * (to - from) + 0.5 * slope * (to * to - from * from);
        let middle = turn.unwrap_or(h);
        d = (d + moved(0.0, middle)).clamp(-0.23, 0.31);
        d = (d + moved(middle, h)).clamp(-0.23, 0.31);
        exact.push(d);
    }
    let run = Run {
        name: "u".into(),
        inputs: u,
        measured: vec![f64::NAN; time.len()],
        held: vec![false],
        stated: vec![true],
        input_gaps: vec![0],
        output_gaps: vec![0],
        time,
    };
    let mut y = vec![0.0; exact.len()];
    Simulator::new(held.dynamics(), &run, 1).unwrap().simulate(&[], &mut y).unwrap();
    let worst = y.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-13, "{worst}");
}

#[test]
fn models_without_states() {
    let curve = model(
        "model curve { input x; param a = 2, b = 0.3, tau = 0.2 in [0, 1]; output y = a*exp(-b*x) + delay(x, tau); }",
    );
    check(&curve, &run(&curve, 50, 0.1), 1);
}

#[test]
fn many_columns_fill_several_registers() {
    // 37 parameters: five rows of eight lanes
    let names: Vec<String> = (0..37).map(|k| format!("p{k} = {}", 0.1 + 0.01 * f64::from(k))).collect();
    let terms: Vec<String> = (0..37).map(|k| format!("p{k}*cos({}*x + {k})", 1 + k % 3)).collect();
    let text = format!(
        "model wide {{ state x, y; param {}; der(x) = y; der(y) = {} - x; output z = x; }}",
        names.join(", "),
        terms.join(" + ")
    );
    let wide = model(&text);
    check(&wide, &run(&wide, 40, 0.05), 2);
}

#[test]
fn a_delayed_ramp_has_its_closed_form() {
    // x' = -k x + k u(t - tau), u(s) = s from 0 on: x = s - (1 - exp(-k s))/k with s = t - tau; y shows x still later
    let text = "model ramp { input u; state x; param k = 1.5, tau = 0.25 in [0, 1], late = 0.125 in [0, 1];
        der(x) = -k*x + k*delay(u, tau); output y = delay(x, late); }";
    let ramp = model(text);
    // exact binary fractions: the kink at the end of the delay falls on a step, and its end has not felt it yet
    let time: Vec<f64> = (0..=300).map(|k| f64::from(k) / 128.0).collect();
    let run = Run {
        name: "ramp".into(),
        inputs: time.clone(),
        measured: vec![f64::NAN; time.len()],
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
        time: time.clone(),
    };
    let mut simulator = Simulator::new(ramp.dynamics(), &run, 1).expect("suited");
    let (mut y, mut jacobian) = (vec![0.0; 301], vec![0.0; 301 * 8]);
    let columns: Vec<usize> =
        ["k", "tau", "late"].iter().map(|n| ramp.definition().param(n).expect("declared")).collect();
    simulator.sensitivities(&ramp.definition().start(), &columns, &mut y, &mut jacobian).expect("finite");
    for (i, t) in time.iter().enumerate() {
        let (k, s) = (1.5, (t - 0.375).max(0.0));
        let decay = (-k * s).exp();
        let value = s - (1.0 - decay) / k;
        let by_k = (1.0 - decay) / (k * k) - s * decay / k;
        let by_delay = -(1.0 - decay);
        for (got, want) in
            [(y[i], value), (jacobian[8 * i], by_k), (jacobian[8 * i + 1], by_delay), (jacobian[8 * i + 2], by_delay)]
        {
            assert!((got - want).abs() < 1e-9, "t = {t}: {got} instead of {want}");
        }
    }
}

#[test]
fn halving_the_step_divides_the_error_by_sixteen() {
    let text = "model swing { param x0 = 1; state x = x0, v; param w = 2; der(x) = v; der(v) = -w^2*sin(x) - 0.1*v*abs(v + 3); output y = x; }";
    let swing = model(text);
    let mut run = run(&swing, 11, 0.4);
    run.time = (0..11).map(|k| 0.4 * f64::from(k)).collect();
    let response = |per: usize| {
        let mut y = vec![0.0; 11];
        Simulator::new(swing.dynamics(), &run, per)
            .expect("suited")
            .simulate(&swing.definition().start(), &mut y)
            .expect("finite");
        y[10]
    };
    let exact = response(256);
    let orders: Vec<f64> =
        [4, 8, 16].map(|m| ((response(m) - exact) / (response(2 * m) - exact)).abs().log2()).to_vec();
    assert!(orders.iter().all(|o| (3.7..4.4).contains(o)), "orders of convergence {orders:?}");
}

#[test]
fn the_engines_give_the_same_bits() {
    let ship = model(SHIP);
    let run = run(&ship, 200, 0.05);
    let tape = code::compile(ship.schedule(), code::Engine::Tape);
    let columns: Vec<usize> = (0..ship.layout().params).collect();
    let theta: Vec<f64> = ship.definition().start().iter().map(|p| p + 0.1).collect();
    let results: Vec<_> = [ship.dynamics(), &*tape]
        .into_iter()
        .map(|dynamics| {
            let (mut y, mut jacobian) = (vec![0.0; 600], vec![0.0; 600 * 8]);
            let mut simulator = Simulator::new(dynamics, &run, 2).expect("suited");
            simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).expect("finite");
            (y, jacobian)
        })
        .collect();
    assert!(results[0] == results[1]);
}

#[test]
fn divergence_is_a_finding() {
    let text =
        "model blows { param x0 = 1, k = 1; state calm, x = x0; der(calm) = -calm; der(x) = k*x^2; output y = x; }";
    let blows = model(text);
    let mut run = run(&blows, 50, 0.1);
    run.time = (0..50).map(|k| 0.1 * f64::from(k)).collect();
    let mut simulator = Simulator::new(blows.dynamics(), &run, 4).expect("suited");
    let found = simulator.simulate(&[1.0, 1.0], &mut [0.0; 50]).expect_err("1/(1 - t) has a pole");
    assert!(found.time > 0.9 && found.time < 2.0 && found.state == Some(1), "{found:?}");
}

#[test]
fn a_held_input_behind_an_estimated_delay_has_its_derivative() {
    let delays = model(
        "model d { input u; state x, z; param tau = 0.137 in [0, 1]; der(x) = delay(u, tau) - x; der(z) = x*abs(x) - 2*z; output y = x + z; }",
    );
    let mut run = run(&delays, 60, 0.1);
    run.held[0] = true;
    check(&delays, &run, 1);
    check(&delays, &run, 3);
}

#[test]
fn an_output_that_jumps_with_a_delay_is_refused() {
    let jumps = model("model d { input u; param tau = 0.1 in [0, 1]; output y = delay(u, tau); }");
    let mut run = run(&jumps, 20, 0.1);
    run.held[0] = true;
    assert!(Simulator::new(jumps.dynamics(), &run, 1).is_err());
}

/// The same with the hidden inputs that a model computes from its records.
fn completed(model: &Model, n: usize, dt: f64) -> Run {
    run(model, n, dt).with_measured(model.definition()).expect("complete")
}

#[test]
fn coupled_derivatives_and_derivatives_of_inputs() {
    let text = "model coupled {
        input a, b; param x0 = 0.2; state x = x0, z, s = 0.1;
        param m = 2.1, j = 3.2, c = 0.7, w = 1.9, T = 0.3, e = 0.2, tau_a = 0.137 in [0, 1], tau_y = 0.21 in [0, 1];
        let force = a + T*der(a); let momentum = j*z*(1 + 0.1*x^2);
        m*der(x) + c*der(z) = z + e*delay(force, tau_a)*x; der(momentum) - c*der(x) = -w*x - 0.5*z + der(b*x);
        der(s) = -e*s + 0.1*der(x) + 0.3*der(delay(b, 2*tau_a));
        output y = x + delay(z, tau_y), az = der(z) - e*x, rate = delay(der(a), tau_y) + s, held = T*der(b); }";
    let coupled = model(text);
    check(&coupled, &completed(&coupled, 120, 0.05), 1);
    check(&coupled, &completed(&coupled, 60, 0.11), 4);
    let driven = model(
        &text
            .replace("output y = x + delay(z, tau_y), az", "output y = x, az")
            .replace("delay(der(a), tau_y)", "tau_y"),
    );
    check(&driven, &completed(&driven, 60, 0.11), Steps::equal(Scheme::Radau, 2));
}

/// `x' = -a x + b u'` is `z' = -a (z + b u)` with `x = z + b u`, in which nothing is differentiated; delayed too, where the input
/// stands still before the record.
#[test]
fn a_derivative_that_drives_is_a_change_of_state() {
    let names = "input u; param a = 1.7, b = 0.6, tau = 0.33 in [0, 1]";
    let taken = model(&format!(
        "model m {{ {names}; state x, s; der(x) = -a*x + b*der(u); der(s) = -a*s + b*der(delay(u, tau)); output y = x, l = s; }}"
    ));
    let changed = |u0: f64| {
        model(&format!(
            "model m {{ {names}; const u0 = {u0}; state z = -b*u0, r = -b*u0; der(z) = -a*(z + b*u); \
             der(r) = -a*(r + b*delay(u, tau)); output y = z + b*u, l = r + b*delay(u, tau); }}"
        ))
    };
    for even in [true, false] {
        let mut record = run(&taken, 90, 0.07);
        if even {
            record.time = (0..90).map(|k| 0.07 * f64::from(k)).collect();
        }
        let done = record.with_measured(taken.definition()).expect("complete");
        let plain = record.with_channels(&[0], &[0, 1]);
        let changed = changed(plain.inputs[0]);
        let response = |model: &Model, run: &Run, steps: Steps| {
            let mut y = vec![0.0; 180];
            let mut simulator = Simulator::new(model.dynamics(), run, steps).expect("suited");
            simulator.simulate(&model.definition().start(), &mut y).expect("finite");
            y
        };
        let recursion = Scheme::ExactDiscretisation { subsystems: 2 };
        // with one step between samples a delayed input has an error of the fourth order
        let ways =
            [(Scheme::RungeKutta, 8, 1e-7), (Scheme::Radau, 8, 1e-7), (recursion, 8, 1e-7), (recursion, 1, 1e-4)];
        for (scheme, steps, most) in ways.into_iter().filter(|(scheme, ..)| even || *scheme != recursion) {
            let steps = || Steps::equal(scheme, steps);
            let (got, want) = (response(&taken, &done, steps()), response(&changed, &plain, steps()));
            let off = got.iter().zip(&want).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < most, "{even} {scheme:?}: {off}");
        }
    }
}
