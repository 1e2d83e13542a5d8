//! Likelihoods without a maximum, and those whose maximum lies behind a wall: the right values, or said.

use fdm::Model;
use fdm::estimate::{Degeneracy, Fit, FitOptions, MultiStart, Noise, Options, Work, fit};
use fdm::record::Run;
use support::Normal;

fn run(time: Vec<f64>, measured: Vec<f64>, q: usize) -> Run {
    let (inputs, held, input_gaps) = (Vec::new(), Vec::new(), Vec::new());
    Run { name: "r".into(), time, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps: vec![0; q] }
}

fn value(fit: &Fit, name: &str) -> f64 {
    fit.estimate.parameters.iter().find(|p| p.name == name).unwrap().value
}

/// Product that is made at a constant rate from 0.2 on, its error in proportion to its value.
fn growth(seed: u64) -> Run {
    let mut normal = Normal(seed);
    let time: Vec<f64> = (0..15).map(f64::from).collect();
    let measured = time.iter().map(|t| (0.2 + 3.0 * t) * (1.0 + 0.2 * normal.next())).collect();
    run(time, measured, 1)
}

const FREE: &str = "model acid { state l = free; param k = 1 in [0, 100], rel = 0.1 in [0.001, 1]; der(l) = k;
    output y = l; noise y = rel*abs(y); }";
const BOUNDED: &str =
    "model acid { param l0 = 0.2 in [0, 100], k = 1 in [0, 100], rel = 0.1 in [0.001, 1]; state l = l0; der(l) = k;
    output y = l; noise y = rel*abs(y); }";

/// The likelihood by noise in proportion, its relative size at its maximum.
fn likelihood(run: &Run, l0: f64, k: f64) -> f64 {
    let (n, line) = (run.len() as f64, |t: f64| l0 + k * t);
    let pairs = || run.time.iter().zip(&run.measured);
    let square = pairs().map(|(t, z)| (z / line(*t) - 1.0).powi(2)).sum::<f64>() / n;
    -0.5 * n * ((std::f64::consts::TAU * square).ln() + 1.0) - pairs().map(|(t, _)| line(*t).ln()).sum::<f64>()
}

#[test]
fn noise_in_proportion_is_fitted_on_the_right_side_of_zero_from_the_start_values_of_the_user() {
    for text in [FREE, BOUNDED] {
        let model = Model::from_text("m.fdm", text).unwrap();
        for seed in 0..12 {
            let record = growth(seed);
            let found = fit(&model, std::slice::from_ref(&record), &FitOptions::default(), &Work::default()).unwrap();
            // by hand: a grid around the maximum, refined
            let (mut best, mut at, mut width) = (f64::NEG_INFINITY, (0.2, 3.0), (0.19, 1.5));
            for _ in 0..12 {
                let (center, reach) = (at, width);
                for i in -10..=10 {
                    for j in -10..=10 {
                        let place =
                            (center.0 + reach.0 * f64::from(i) / 10.0, center.1 + reach.1 * f64::from(j) / 10.0);
                        let own = if place.0 > 0.0 { likelihood(&record, place.0, place.1) } else { f64::NEG_INFINITY };
                        (best, at) = if own > best { (own, place) } else { (best, at) };
                    }
                }
                width = (0.4 * reach.0, 0.4 * reach.1);
            }
            let reached = found.estimate.log_likelihood.unwrap();
            assert!(
                found.is_good() && reached > best - 1e-3,
                "{seed}: {reached} {best} {}",
                found.estimate.termination
            );
        }
    }
}

#[test]
fn a_deviation_that_passes_zero_is_said_and_one_with_a_floor_is_not() {
    let time: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k)).collect();
    let mut normal = Normal(3);
    let measured: Vec<f64> = time.iter().map(|t| 1.0 - t + (0.02 + 0.1 * (1.0 - t).abs()) * normal.next()).collect();
    let record = run(time, measured, 1);
    let fitted = |noise: &str| {
        let text = format!(
            "model m {{ state x = free; param k = 1 in [0, 10], rel = 0.1 in [0.001, 1]; der(x) = -k; output y = x; noise y = {noise}; }}"
        );
        let model = Model::from_text("m.fdm", text).unwrap();
        fit(&model, std::slice::from_ref(&record), &FitOptions::default(), &Work::default()).unwrap()
    };
    let bare = fitted("rel*abs(y)");
    assert!(!bare.is_good());
    assert!(matches!(&bare.estimate.degenerate[..], [Degeneracy::Deviation { time, .. }] if (time - 1.0).abs() < 0.3));
    let floored = fitted("0.02 + rel*abs(y)");
    assert!(floored.is_good() && floored.estimate.degenerate.is_empty(), "{:?}", floored.estimate.degenerate);
}

/// A chain of three substances at five times, measured with 8 percent of noise; and that noise.
fn chain(seed: u64) -> (Model, Run, Vec<f64>) {
    let text = "model chain { state a = free, b = free, c = free;
        param k = 0.1 in [0, 10], l = 0.1 in [0, 10], m = 0.1 in [0, 10], n = 0.1 in [0, 10];
        der(a) = -k*a; der(b) = k*a - (l + m)*b; der(c) = l*b - n*c; output A = a, B = b, C = c; }";
    let model = Model::from_text("m.fdm", text).unwrap();
    let time = vec![0.0, 10.0, 25.0, 50.0, 90.0];
    let mut normal = Normal(seed);
    // the rates in closed form
    let (k, s, n) = (0.15f64, 0.07f64, 0.02f64);
    let truth = time.iter().flat_map(|t: &f64| {
        let (ek, es, en) = ((-k * t).exp(), (-s * t).exp(), (-n * t).exp());
        let (u, v) = (30.0 * k / (s - k), 90.0 - 30.0 * k / (s - k));
        let b = u * ek + v * es;
        let c = 0.04 * (u * (ek - en) / (n - k) + v * (es - en) / (n - s)) + 1.5 * en;
        [30.0 * ek, b, c]
    });
    let (measured, noise) = truth.map(|y| (y, 0.08 * y * normal.next())).map(|(y, e)| (y + e, e)).unzip();
    (model, run(time, measured, 3), noise)
}

#[test]
fn a_variance_of_an_output_that_is_interpolated_is_said_and_stated_noise_has_none() {
    let mut told = 0;
    for seed in 0..10 {
        let (model, record, noise) = chain(seed);
        let runs = std::slice::from_ref(&record);
        let found = fit(&model, runs, &FitOptions::default(), &Work::default()).unwrap();
        for (o, name) in ["A", "B", "C"].iter().enumerate() {
            // residuals of a hundredth of the noise that is there
            let squares: f64 = noise[o..].iter().step_by(3).map(|e| e * e).sum();
            let interpolated = found.estimate.outputs[o].rms.unwrap() < 0.01 * (squares / 5.0).sqrt();
            let said = found
                .estimate
                .degenerate
                .iter()
                .any(|d| matches!(d, Degeneracy::Variance { outputs, .. } if outputs.contains(&name.to_string())));
            assert!(!interpolated || said, "{seed} {name}: {:?}", found.estimate.degenerate);
        }
        told += usize::from(!found.is_good() && !found.estimate.degenerate.is_empty());
        let noise = Noise::Given(vec![Some(1.0), Some(4.0), Some(1.5)]);
        let options = FitOptions { options: Options { noise, ..Options::default() }, ..FitOptions::default() };
        let stated = fit(&model, runs, &options, &Work::default()).unwrap();
        assert!(stated.estimate.degenerate.is_empty() && (value(&stated, "k") - 0.15).abs() < 0.1, "{seed}");
    }
    assert!(told > 2, "{told} of 10");
}

/// Two outputs that are one cubic, seen at `few` and at ten times.
fn cubic(seed: u64, few: usize) -> (Model, Run) {
    let text = "model cubic { time [s]; param a = 0.5, b = 0.5, c = 0.5, d = 0.5;
        let s = a + t*(b + t*(c + t*d)); output y = s, z = s; }";
    let mut normal = Normal(seed);
    let time: Vec<f64> = (0..10 * few).map(|k| k as f64 / (10 * few) as f64).collect();
    let mut sample = |k: usize, t: &f64| {
        let s = 1.0 + t * (2.0 - t * (1.5 - 0.5 * t));
        let seen = |every: usize, z: f64| if k % every == every / 2 { z } else { f64::NAN };
        [seen(10, s + 0.1 * normal.next()), seen(few, s + 0.1 * normal.next())]
    };
    let measured = time.iter().enumerate().flat_map(|(k, t)| sample(k, t)).collect();
    let record = run(time, measured, 2);
    (Model::from_text("m.fdm", text).unwrap(), Run { output_gaps: vec![9 * few, 10 * few - 10], ..record })
}

#[test]
fn a_maximum_beside_an_output_that_can_be_passed_through_is_said_and_one_sample_more_has_none() {
    let mut elsewhere = 0;
    for seed in 0..10 {
        // four values lie on a cubic, whatever they are
        let (model, record) = cubic(seed, 4);
        let found = fit(&model, std::slice::from_ref(&record), &FitOptions::default(), &Work::default()).unwrap();
        // where the other output says more of every parameter the weight of this one decides nothing
        assert!(!found.estimate.degenerate.is_empty() || found.estimate.leverages[0] < 1.0, "{seed}");
        elsewhere += usize::from(matches!(&found.estimate.degenerate[..],
            [Degeneracy::Elsewhere { output, samples: 4, gain }] if output == "y" && *gain > 1.0));
        let noise = Noise::Given(vec![Some(0.1), None]);
        let stated = FitOptions { options: Options { noise, ..Options::default() }, ..FitOptions::default() };
        assert!(fit(&model, &[record], &stated, &Work::default()).unwrap().is_good(), "{seed}");
        let (model, more) = cubic(seed, 8);
        assert!(fit(&model, &[more], &FitOptions::default(), &Work::default()).unwrap().is_good(), "{seed}");
    }
    assert!(elsewhere > 0, "of the others the weight is lost where the fit ends");
}

#[test]
fn minima_of_one_cost_at_two_places_are_two_and_that_of_the_given_start_is_kept() {
    let model =
        Model::from_text("m.fdm", "model m { state x = 0; param a = 1 in [-5, 5]; der(x) = a*a; output y = x; }");
    let model = model.unwrap();
    let time: Vec<f64> = (0..30).map(|k| 0.1 * f64::from(k)).collect();
    let mut normal = Normal(5);
    let measured = time.iter().map(|t| 4.0 * t + 0.1 * normal.next()).collect();
    let options = FitOptions { starts: MultiStart { count: 12, seed: 1 }, ..FitOptions::default() };
    let found = fit(&model, &[run(time, measured, 1)], &options, &Work::default()).unwrap();
    let other = found.equal_minima();
    assert!(other.len() == 1 && other[0].minimum == Some(2), "{:?}", found.starts);
    assert!((value(&found, "a") - 2.0).abs() < 0.05 && (other[0].values[0] + value(&found, "a")).abs() < 1e-6);
}
