//! Simulated sweeps: parameters, delays, costs and errors, and the derivatives behind them.
#![expect(clippy::print_stdout, reason = "a study prints its figures")]

use super::decibels::{Decibels, Pair, measured_rows, weight};
use super::measured::Measured;
use super::*;
use crate::problem::response::Response;
use crate::work::Work;
use fdm_system::linear::LinearModel;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Simulator};
use std::f64::consts::TAU;
use std::sync::Arc;

const SECOND_ORDER: &str = include_str!("../../../../models/second_order_delay/model.fdm");
const COUPLED: &str = "model coupled {
    input a, b; state x, v, p;
    param K = 2.0, w2 = 5.0, d = 1.4, tau = 0.15 in [0, 1], L = 2.5, T = 0.6, N = 0.8, late = 0.1 in [0, 1];
    der(x) = v; der(v) = -w2*x - d*v + K*delay(a, tau); der(p) = -p/T + L*delay(b, late) + N*a;
    output x_m = x, p_m = p; }";

fn model(text: &str) -> Model {
    Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e}"))
}

/// White noise of unit deviation, by sums of twelve.
pub(super) struct White(u64);

impl White {
    fn next(&mut self) -> f64 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            sum += (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    }
}

/// A sweep from `low` to `high` cycles per unit of time, faded in and out.
fn sweep(t: f64, duration: f64, low: f64, high: f64) -> f64 {
    let rate = (high / low).ln() / duration;
    let phase = TAU * low * ((rate * t).exp() - 1.0) / rate;
    phase.sin() * (t / 3.0).min((duration - t) / 3.0).clamp(0.0, 1.0)
}

/// What the model gives for these inputs, with noise of a part of the deviation of every output.
fn flown(model: &Model, name: &str, dt: f64, inputs: &[Vec<f64>], noise: f64, seed: u64) -> Run {
    let (n, q) = (inputs[0].len(), model.layout().outputs);
    let run = Run {
        name: name.into(),
        time: (0..n).map(|k| dt * k as f64).collect(),
        inputs: (0..n).flat_map(|k| inputs.iter().map(move |u| u[k])).collect(),
        held: vec![false; inputs.len()],
        measured: vec![0.0; n * q],
        input_gaps: vec![0; inputs.len()],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    };
    let mut run = run.with_measured(model.definition()).expect("complete");
    let mut y = run.measured.clone();
    let mut simulator = Simulator::new(model.dynamics(), &run, 4).expect("suited");
    simulator.simulate(&model.definition().start(), &mut y).expect("finite");
    drop(simulator);
    let mut white = White(seed * 7919 + 12345);
    for o in 0..q {
        let size = (y.iter().skip(o).step_by(q).map(|v| v * v).sum::<f64>() / n as f64).sqrt();
        y.iter_mut().skip(o).step_by(q).for_each(|v| *v += noise * size * white.next());
    }
    run.measured = y;
    run
}

/// Two sweeps of the second order with delay.
pub(super) fn second_order(noise: f64, seed: u64) -> (Model, Vec<Run>) {
    swept(model(SECOND_ORDER), noise, seed)
}

/// Two sweeps of one input.
fn swept(model: Model, noise: f64, seed: u64) -> (Model, Vec<Run>) {
    let (dt, duration) = (0.02, 90.0);
    let n = (duration / dt) as usize;
    let run = |k: u64| {
        let mut pilot = White(seed * 31 + k);
        let u = (0..n).map(|i| sweep(dt * i as f64, duration, 0.05, 2.5) + 0.02 * pilot.next()).collect();
        flown(&model, &format!("sweep {k}"), dt, &[u], noise, 2 * seed + k)
    };
    let runs = vec![run(0), run(1)];
    (model, runs)
}

/// Two sweeps of each of two inputs, the other one moving with it.
pub(super) fn coupled(noise: f64, seed: u64) -> (Model, Vec<Run>) {
    let model = model(COUPLED);
    let (dt, duration) = (0.02, 90.0);
    let n = (duration / dt) as usize;
    let run = |k: u64| {
        let mut pilot = White(seed * 31 + k);
        let main: Vec<f64> = (0..n).map(|i| sweep(dt * i as f64, duration, 0.05, 2.5)).collect();
        let mut slow = 0.0;
        // the pilot holds the other axis: a part of the sweep, and corrections of his own
        let mut other = |u: &f64| {
            slow += 0.1 * (pilot.next() - slow);
            0.3 * u + 0.4 * slow
        };
        let other: Vec<f64> = main.iter().map(&mut other).collect();
        let inputs = if k.is_multiple_of(2) { [main, other] } else { [other, main] };
        flown(&model, &format!("sweep {k}"), dt, &inputs, noise, 4 * seed + k)
    };
    let runs = (0..4).map(run).collect();
    (model, runs)
}

/// Begins off the truth.
pub(super) fn options(model: &Model) -> ResponseOptions {
    let mut options = ResponseOptions { finish: false, ..ResponseOptions::default() };
    options.changes.set = model.definition().params.iter().map(|p| (p.quantity.name.clone(), 0.8 * p.value)).collect();
    options.frequencies = fdm_system::spectrum::Frequencies::Grid { lowest: None, highest: Some(2.3) };
    options
}

fn check(model: &Model, fit: &ResponseFit, sigmas: f64) {
    assert!(fit.is_good(), "{}", fit.estimate.termination);
    for p in &model.definition().params {
        let found = fit.estimate.parameter(&p.quantity.name, None).expect("a parameter");
        let error = found.corrected_error.expect("known from the coherence");
        println!(
            "{:6} {:8.4} {:8.4} +- {:.4} (residuals {:.4}) {:6.2}",
            p.quantity.name,
            p.value,
            found.value,
            error,
            found.standard_error.unwrap_or(0.0),
            (found.value - p.value) / error
        );
        assert!((found.value - p.value).abs() < sigmas * error, "{}", p.quantity.name);
    }
}

#[test]
fn a_second_order_with_delay_is_found_from_sweeps() {
    let (model, runs) = second_order(0.05, 1);
    let fit = fit_responses(&model, &runs, &options(&model), &Work::default()).expect("a fit");
    println!("{:?} {:?}", fit.cost(), fit.segments);
    check(&model, &fit, 3.0);
    let tau = fit.estimate.parameter("tau", None).expect("a delay").value;
    assert!((tau / 0.18 - 1.0).abs() < 0.02, "{tau}");
    let cost = fit.cost().expect("compared");
    assert!(cost < 50.0, "{cost}");
    // the same without the delay is visibly worse
    let mut without = options(&model);
    without.changes.set.retain(|(name, _)| name != "tau");
    without.changes.set.push(("tau".into(), 0.0));
    without.changes.fix.push("tau".into());
    let worse = fit_responses(&model, &runs, &without, &Work::default()).expect("a fit");
    println!("without {:?}", worse.cost());
    assert!(worse.cost().expect("compared") > 3.0 * cost.max(20.0), "{:?}", worse.cost());
}

#[test]
fn the_response_to_an_input_is_that_to_its_derivative_too() {
    let text =
        "model m { input u; state y, z; param K = 1.5, Ts = 1.2, a1 = 2.4, a0 = 4.0, tau = 0.18 in [0, 2], c = 0.4;
        der(y) = z; der(z) = -a0*y - a1*z + delay(K*(u + Ts*der(u)), tau); output y_m = y, a_m = der(z) + c*der(u); }";
    let (model, runs) = swept(model(text), 0.05, 1);
    let fit = fit_responses(&model, &runs, &options(&model), &Work::default()).expect("a fit");
    let pairs: Vec<_> = fit.pairs.iter().map(|p| (p.output.as_str(), p.input.as_str())).collect();
    assert_eq!(pairs, [("y_m", "u"), ("a_m", "u")]);
    check(&model, &fit, 3.0);
}

#[test]
fn correlated_inputs_are_taken_apart() {
    let (model, runs) = coupled(0.05, 1);
    let fit = fit_responses(&model, &runs, &options(&model), &Work::default()).expect("a fit");
    println!("{:?} {:?}", fit.cost(), fit.segments);
    let pairs: Vec<_> = fit.pairs.iter().map(|p| (p.output.as_str(), p.input.as_str())).collect();
    assert_eq!(pairs, [("x_m", "a"), ("p_m", "a"), ("p_m", "b")], "what the model connects");
    fit.pairs.iter().for_each(|p| println!("{} {} {:.1} {} {}", p.output, p.input, p.cost, p.omega.len(), p.left_out));
    check(&model, &fit, 3.0);
    assert!(fit.cost().expect("compared") < 50.0);
}

#[test]
fn derivatives_of_decibels_and_degrees_are_exact() {
    let (model, runs) = coupled(0.05, 1);
    let measured = Measured::new(&model, &runs, &options(&model)).expect("responses");
    let linear = LinearModel::new(&model).expect("linear");
    let mut pairs: Vec<Pair> = Vec::new();
    for (o, i) in [(0, 0), (1, 0), (1, 1)] {
        let first = pairs.last().map_or(0, Pair::end);
        pairs.push(Pair::new(&measured, o, i, measured.coherent(o, i, 0.6), first));
    }
    let theta = model.definition().start();
    let (plans, reason) = Default::default();
    let mut response =
        Decibels::new(&linear, &theta, &measured, &pairs, &Arc::new(plans), &reason).expect("a response");
    let (n, p) = (response.samples(), theta.len());
    let columns: Vec<usize> = (0..p).collect();
    let (mut y, mut rows) = (vec![0.0; n], vec![0.0; n * 8]);
    let mut sink = |block: Block<'_>| block.copy_to(&mut y, &mut rows, 8);
    response.sensitivities(&theta, &columns, &mut sink).expect("finite");
    let mut plain = vec![0.0; n];
    response.simulate(&theta, &mut plain).expect("finite");
    assert_eq!(y, plain, "the same bits with and without derivatives");
    for k in columns {
        let h = 1e-5 * theta[k];
        let sides = [1.0, -1.0].map(|side| {
            let (mut at, mut y) = (theta.clone(), vec![0.0; n]);
            at[k] += side * h;
            response.simulate(&at, &mut y).expect("finite");
            y
        });
        let size = (0..n).map(|i| rows[i * 8 + k].abs()).fold(0.0, f64::max);
        assert!(size > 1e-3);
        for i in 0..n {
            let difference = (sides[0][i] - sides[1][i]) / (2.0 * h);
            assert!((difference - rows[i * 8 + k]).abs() < 1e-7 * size, "{k} {i}: {difference} {}", rows[i * 8 + k]);
        }
    }
    let rows = measured_rows(&pairs);
    assert!(rows.iter().zip(&y).all(|(m, y)| (m - y).abs() < 3.0), "phases are the nearest ones");
}

#[test]
fn a_coherence_of_one_weighs_one() {
    assert!((weight(1.0) - 0.9975).abs() < 1e-3 && weight(0.6) < 0.25);
}

/// What is printed as error is what estimates scatter: `cargo test --release --lib responses::tests::scatter -- --ignored --nocapture`.
#[test]
#[ignore = "a study"]
fn scatter() {
    for (name, made) in [("one", second_order as fn(f64, u64) -> _), ("two", coupled)] {
        let repeats = 40;
        let mut all: Vec<Vec<(f64, f64, f64)>> = Vec::new();
        let mut costs = 0.0;
        for seed in 1..=repeats {
            let (model, runs): (Model, Vec<Run>) = made(0.05, seed);
            let fit = fit_responses(&model, &runs, &options(&model), &Work::default()).expect("a fit");
            costs += fit.cost().unwrap_or(0.0) / repeats as f64;
            let of = |p: &fdm_grammar::model::Param| {
                let e = fit.estimate.parameter(&p.quantity.name, None).expect("a parameter");
                (
                    e.value / p.value - 1.0,
                    e.corrected_error.unwrap_or(f64::NAN) / p.value,
                    e.standard_error.unwrap_or(f64::NAN) / p.value,
                )
            };
            all.push(model.definition().params.iter().map(of).collect());
        }
        println!("{name}: mean cost {costs:.1}");
        let count = repeats as f64;
        for k in 0..all[0].len() {
            let mean = all.iter().map(|a| a[k].0).sum::<f64>() / count;
            let scatter = (all.iter().map(|a| (a[k].0 - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
            let mut said = [0.0; 2];
            all.iter().for_each(|a| said = [said[0] + a[k].1 / count, said[1] + a[k].2 / count]);
            println!(
                "  {k}: bias {:8.3} %  scatter {:7.3} %  coherence {:7.3} %  residuals {:7.3} %  ratio {:.2}",
                100.0 * mean,
                100.0 * scatter,
                100.0 * said[0],
                100.0 * said[1],
                scatter / said[0]
            );
        }
    }
}
