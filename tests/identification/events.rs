//! Events: closed forms, differences of the same simulation, a record fitted, and what is refused in words.

use fdm::estimate::{FitOptions, SpectralOptions, Work, fit, fit_filter, fit_spectra};
use fdm::record::Run;
use fdm::simulate::{EventFault, Scheme, Simulator, Steps};
use fdm::{Model, code};
use support::{Normal, model};

const BALL: &str = "model ball {
    param h = 2, g = 9.81, e = 0.8; state x = h, v;
    der(x) = v; der(v) = -g; when x < 0 { v = -e*v; }
    output xm = x, vm = v; }";

/// A room that loses heat, and a heater between two temperatures.
const THERMOSTAT: &str = "model thermostat {
    param a = 0.4, b = 3, high = 4.2, low = 3.1 in [0, 4]; state T, heater = 1;
    der(T) = -a*T + b*heater; der(heater) = 0;
    when T > high { heater = 0; } when T < low { heater = 1; }
    output Tm = T; }";

fn run(model: &Model, time: Vec<f64>) -> Run {
    let (m, q, n) = (model.layout().inputs, model.layout().outputs, time.len());
    Run {
        name: "made".into(),
        inputs: time.iter().flat_map(|t| (0..m).map(move |i| (1.7 * t + i as f64).sin())).collect(),
        measured: vec![f64::NAN; n * q],
        time,
        held: (0..m).map(|i| i % 2 == 1).collect(),
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    }
}

fn even(n: usize, dt: f64) -> Vec<f64> {
    (0..n).map(|k| dt * k as f64).collect()
}

/// The response (N by q) and, column by column, its Jacobian.
fn linearised(model: &Model, run: &Run, per: usize) -> (Vec<f64>, Vec<Vec<f64>>) {
    let theta = model.definition().start();
    let columns: Vec<usize> = (0..theta.len()).collect();
    let (rows, stride) = (run.len() * model.layout().outputs, columns.len().next_multiple_of(8));
    let (mut y, mut jacobian) = (vec![0.0; rows], vec![f64::NAN; rows * stride]);
    let mut simulator = Simulator::new(model.dynamics(), run, per).unwrap();
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).unwrap();
    let column = |c: usize| (0..rows).map(|r| jacobian[r * stride + c]).collect();
    (y, columns.into_iter().map(column).collect())
}

/// Derivative of a closed form by a parameter: central differences of order six.
fn slope(form: impl Fn(&[f64]) -> f64, at: &[f64], k: usize) -> f64 {
    let h = 1e-5 * at[k].abs();
    let moved = |part: f64| {
        let mut at = at.to_vec();
        at[k] += part * h;
        form(&at)
    };
    let pair = |part: f64| moved(part) - moved(-part);
    (45.0 * pair(1.0) - 9.0 * pair(2.0) + pair(3.0)) / (60.0 * h)
}

/// Response and Jacobian against a closed form of theta and time, where its derivatives reach `tolerance` of their greatest value.
fn compare(model: &Model, run: &Run, per: usize, form: impl Fn(&[f64], f64) -> Vec<f64>, tolerance: f64) {
    let theta = model.definition().start();
    let (y, jacobian) = linearised(model, run, per);
    let q = model.layout().outputs;
    for (sample, t) in run.time.iter().enumerate() {
        for (o, value) in form(&theta, *t).into_iter().enumerate() {
            assert!((y[sample * q + o] - value).abs() < tolerance, "output {o} at {t}: {} {value}", y[sample * q + o]);
        }
    }
    for (k, column) in jacobian.iter().enumerate() {
        let scale = column.iter().fold(0.0_f64, |s, v| s.max(v.abs()));
        assert!(scale > 1e-3, "a silent zero: {k}");
        for (row, value) in column.iter().enumerate() {
            let (t, o) = (run.time[row / q], row % q);
            let exact = slope(|theta| form(theta, t)[o], &theta, k);
            assert!((value - exact).abs() < tolerance * scale, "output {o} by {k} at {t}: {value} {exact}");
        }
    }
}

#[test]
fn a_bouncing_ball_has_its_closed_form() {
    let form = |theta: &[f64], t: f64| {
        let [h, g, e] = [theta[0], theta[1], theta[2]];
        let (mut hit, mut v) = ((2.0 * h / g).sqrt(), (2.0 * h * g).sqrt());
        if t < hit {
            return vec![h - 0.5 * g * t * t, -g * t];
        }
        loop {
            v *= e;
            let since = t - hit;
            if since < 2.0 * v / g {
                return vec![v * since - 0.5 * g * since * since, v - g * since];
            }
            hit += 2.0 * v / g;
        }
    };
    let ball = model(BALL);
    let run = run(&ball, even(95, 0.0437));
    for per in [1, 3] {
        compare(&ball, &run, per, form, 1e-8);
    }
    // several bounces within one step
    let coarse = Run { time: vec![0.0, 0.3, 2.75, 4.1], measured: vec![f64::NAN; 8], ..run };
    compare(&ball, &coarse, 1, form, 1e-8);
}

/// The temperature at a time, from one instant of switching to the next.
fn temperature(theta: &[f64], t: f64) -> f64 {
    let [a, b, high, low] = [theta[0], theta[1], theta[2], theta[3]];
    let top = b / a;
    let (mut since, mut from, mut on) = (0.0, 0.0, true);
    loop {
        let (rest, to) = if on { (top, high) } else { (0.0, low) };
        let next = since - ((rest - to) / (rest - from)).ln() / a;
        if t <= next {
            return rest + (from - rest) * (-a * (t - since)).exp();
        }
        (since, from, on) = (next, to, !on);
    }
}

#[test]
fn a_relay_has_its_closed_form() {
    let thermostat = model(THERMOSTAT);
    let run = run(&thermostat, even(160, 0.109));
    compare(&thermostat, &run, 8, |theta, t| vec![temperature(theta, t)], 1e-8);
}

/// Guards and values behind events that depend on time, inputs (linear and held), parameters and all states; coarse steps, in which an approximate
/// derivative would be seen; a guard of two conditions; an event that another makes happen.
const MANY: &str = "model many {
    input u, w; param a = 0.7, k = 2.3, c = 0.21, d = 0.6, s = 0.33, x0 = 0.4;
    state x = x0, v, n, z = 0.2;
    der(x) = v + 0.1*w; der(v) = -k*x - c*v*abs(v) + u*x + 0.3*sin(a*t); der(n) = 0; der(z) = -a*z + n + 0.2*x;
    when x > d + 0.05*u*s and v > 0 { v = -a*v + s*x*t; n = n + s + 0.1*w; }
    when x < -d*cos(c*t) or x + v < -9 { v = -0.9*v*(1 + 0.1*u); z = z + s*v; }
    when n > 0.5 { n = 0.1*a; x = x - 0.03*k*d; }
    output xm = x*z + n, vm = v + u; }";

/// Every column against central differences of the same simulation, extrapolated once; steps so small that no event passes a sample.
fn check(model: &Model, run: &Run, steps: impl Into<Steps>) {
    let columns: Vec<usize> = (0..model.layout().params).collect();
    let mut simulator = Simulator::new(model.dynamics(), run, steps).unwrap();
    let (rows, stride) = (run.len() * model.layout().outputs, columns.len().next_multiple_of(8));
    let (mut y, mut plain, mut jacobian) = (vec![0.0; rows], vec![0.0; rows], vec![f64::NAN; rows * stride]);
    let theta = model.definition().start();
    simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).unwrap();
    simulator.simulate(&theta, &mut plain).unwrap();
    assert_eq!(y, plain, "with and without sensitivities the same bits");
    for column in columns {
        let name = &model.definition().params[column].quantity.name;
        let mut at = |step: f64| {
            let mut moved = theta.clone();
            moved[column] += step;
            let mut y = vec![0.0; rows];
            simulator.simulate(&moved, &mut y).unwrap();
            y
        };
        let h = 1e-5 * theta[column].abs().max(0.05);
        let (a, b, c, d) = (at(h), at(-h), at(h / 2.0), at(-h / 2.0));
        let exact: Vec<f64> = (0..rows).map(|r| jacobian[r * stride + column]).collect();
        let scale = exact.iter().fold(0.0_f64, |s, e| s.max(e.abs()));
        assert!(scale > 1e-3, "{name} moves nothing: a silent zero");
        let best = |r: usize| (4.0 * (c[r] - d[r]) / h - (a[r] - b[r]) / (2.0 * h)) / 3.0;
        let worst = (0..rows).map(|r| (best(r) - exact[r]).abs() / scale).fold(0.0, f64::max);
        println!("{name}: {worst:.1e}");
        assert!(worst < 1e-7, "{name}: {worst} of the greatest derivative");
    }
}

#[test]
fn derivatives_across_events_are_those_of_the_discrete_response() {
    let many = model(MANY);
    let run = run(&many, even(60, 0.173));
    check(&many, &run, 1);
    check(&many, &run, 3);
    check(&many, &run, Steps::uneven(Scheme::RungeKutta, [&[0.3, 1.0][..], &[0.1, 0.9, 1.0]]));
    let wide = model(&MANY.replace(
        "state x = x0",
        "state q1 = 0.1, q2, q3, q4; der(q1) = -q1 + x; der(q2) = q1 - q2; der(q3) = q2 - q3; der(q4) = q3 - d*q4; state x = x0",
    ).replace("v + u;", "v + u + q4;"));
    check(&wide, &run, 1);
    let stopped = model(&MANY.replace("when n >", "limit z in [-0.2*d, 0.5*d]; when n >"));
    check(&stopped, &run, 1);
    let found = code::verify(many.definition(), many.schedule(), &code::Nominal::start(many.definition()));
    assert!(found.passed(), "{found:?}");
}

#[test]
fn the_engines_agree_to_the_bit_on_events() {
    let many = model(MANY);
    let run = run(&many, even(60, 0.173));
    let tape = code::compile(many.schedule(), code::Engine::Tape);
    let theta = many.definition().start();
    let columns: Vec<usize> = (0..theta.len()).collect();
    let results = [many.dynamics(), &*tape].map(|dynamics| {
        let (mut y, mut jacobian) = (vec![0.0; 120], vec![0.0; 120 * 8]);
        let mut simulator = Simulator::new(dynamics, &run, 2).unwrap();
        simulator.sensitivities(&theta, &columns, &mut y, &mut jacobian).unwrap();
        y.into_iter().chain(jacobian).map(f64::to_bits).collect::<Vec<_>>()
    });
    assert!(results[0] == results[1]);
}

/// The record is the closed form with noise: no integrator of ours has part in it.
#[test]
fn a_thermostat_is_found_from_its_record() {
    let truth = [0.4, 3.0, 4.2, 3.1];
    let started =
        THERMOSTAT.replace("a = 0.4, b = 3, high = 4.2, low = 3.1", "a = 0.44, b = 3.2, high = 4.15, low = 3.15");
    let thermostat = model(&started);
    let mut run = run(&thermostat, even(400, 0.05));
    let mut noise = Normal(7);
    for (measured, t) in run.measured.iter_mut().zip(&run.time) {
        *measured = temperature(&truth, *t) + 0.02 * noise.next();
    }
    let found = fit(&thermostat, &[run], &FitOptions::default(), &Work::default()).unwrap();
    assert!(found.estimate.termination.is_good(), "{:?}", found.estimate.termination);
    for (name, truth) in ["a", "b", "high", "low"].into_iter().zip(truth) {
        let parameter = found.estimate.parameter(name, None).unwrap();
        let error = parameter.standard_error.unwrap();
        println!("{name}: {} +- {error}, {truth}", parameter.value);
        assert!((parameter.value - truth).abs() < 4.0 * error && error < 0.02 * truth, "{name}: {}", parameter.value);
    }
}

#[test]
fn infinitely_many_bounces_end_with_their_time() {
    let ball = model(&BALL.replace("e = 0.8", "e = 0.5"));
    let run = run(&ball, even(100, 0.05));
    let mut y = vec![0.0; 200];
    let ended = Simulator::new(ball.dynamics(), &run, 1).unwrap().simulate(&ball.definition().start(), &mut y);
    let ended = ended.unwrap_err();
    // the sum of all arcs: t1 (1 + 2 e/(1 - e))
    let rest = (4.0_f64 / 9.81).sqrt() * 3.0;
    assert!((ended.time - rest).abs() < 1e-6, "{} {rest}", ended.time);
    assert_eq!(ended.event, Some(EventFault::Accumulates(0)));
    assert!(ended.event.unwrap().to_string().contains("limit"));
}

#[test]
fn a_guard_that_only_touches_has_no_derivative() {
    let touching = model(
        "model touching { param a = 1; state x = -1, n; der(x) = 3*(a*t - 1)^2; der(n) = 0; when x > 0 { n = 1; } output y = n + x; }",
    );
    let run = run(&touching, even(30, 0.1));
    let (mut y, mut jacobian) = (vec![0.0; 30], vec![0.0; 30 * 8]);
    let mut simulator = Simulator::new(touching.dynamics(), &run, 1).unwrap();
    simulator.simulate(&[1.0], &mut y).unwrap();
    let ended = simulator.sensitivities(&[1.0], &[0], &mut y, &mut jacobian).unwrap_err();
    assert_eq!(ended.event, Some(EventFault::Grazes(0)));
    assert!((ended.time - 1.0).abs() < 1e-4, "{}", ended.time);
}

#[test]
fn what_does_not_know_events_says_so() {
    let text = THERMOSTAT.replace("output", "param q = 0.1; noise der(T) = q; output");
    let thermostat = model(&text);
    let mut run = run(&thermostat, even(50, 0.1));
    run.measured.iter_mut().zip(&run.time).for_each(|(y, t)| *y = temperature(&[0.4, 3.0, 4.2, 3.1], *t));
    let runs = [run];
    let refusals = [
        Simulator::new(thermostat.dynamics(), &runs[0], Steps::equal(Scheme::Radau, 1)).err().unwrap().to_string(),
        fit_filter(&thermostat, &runs, &FitOptions::default(), &Work::default()).unwrap_err().to_string(),
        fit_spectra(&thermostat, &runs, &SpectralOptions::default(), &Work::default()).unwrap_err().to_string(),
        fdm::linear::LinearModel::new(&thermostat).err().unwrap().to_string(),
        as_source(&thermostat),
    ];
    for said in refusals {
        assert!(said.contains("events (`when`)"), "{said}");
    }
}

/// What stand-alone source says of it.
fn as_source(model: &Model) -> String {
    fdm_grammar::emit::stand_alone(model.definition(), model.schedule(), &fdm_grammar::emit::Language::C)
        .unwrap_err()
        .to_string()
}
