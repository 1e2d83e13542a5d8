//! The likelihood against a joint normal distribution, its gradient against central differences.

use super::likelihood::Setting;
use crate::methods::output_error::single::starts;
use crate::problem::Options;
use crate::specimen::Normal;
use crate::work::Work;
use crate::{Changes, FilterError, FitOptions, Noise, fit_filter};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Scheme, Steps};
use nalgebra::{DMatrix, DVector};

/// A run over noise of its own, with some gaps.
fn run(name: &str, (n, m, q): (usize, usize, usize), dt: f64, seed: u64, gaps: usize) -> Run {
    let mut noise = Normal(seed);
    let mut measured: Vec<f64> = (0..n * q).map(|k| 0.3 + (0.2 * k as f64).sin() + 0.2 * noise.next()).collect();
    (0..gaps).for_each(|k| measured[(7 + 5 * k) % (n * q)] = f64::NAN);
    Run {
        name: name.into(),
        time: (0..n).map(|k| dt * k as f64).collect(),
        inputs: (0..n * m).map(|k| (0.3 * k as f64).sin() + 0.1 * noise.next()).collect(),
        held: vec![false; m],
        measured,
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    }
}

fn with<T>(model: &Model, runs: &[Run], options: &Options, work: impl FnOnce(&Setting<'_>) -> T) -> T {
    let start = starts(model, runs, &Changes::default());
    work(&Setting::new(model, runs, &start, options).expect("suited"))
}

#[test]
fn the_likelihood_is_that_of_a_joint_normal_distribution() {
    let text = "model m { state x = 0.5; param a = -0.7, q = 0.4; der(x) = a*x; noise der(x) = q; output y = 2*x; }";
    let model = Model::from_text("m.fdm", text).expect("a model");
    let (dt, r) = (0.25, 0.3);
    let runs = [run("r", (9, 0, 1), dt, 3, 1)];
    let options = Options { noise: Noise::Given(vec![Some(r)]), ..Options::default() };
    let cost = with(&model, &runs, &options, |setting| {
        let steps = [Steps::equal(Scheme::RungeKutta, 16)];
        let mut likelihood = setting.likelihood(&steps).expect("suited");
        likelihood.evaluate(&setting.unknowns.start, false).expect("finite")
    });
    // Cov(x_i, x_j) = q^2 (e^{a |ti - tj|} - e^{a (ti + tj)}) / (-2 a)
    let (a, q): (f64, f64) = (-0.7, 0.4);
    let there: Vec<usize> = (0..9).filter(|k| !runs[0].measured[*k].is_nan()).collect();
    let t = |k: usize| dt * there[k] as f64;
    let covariance = DMatrix::from_fn(there.len(), there.len(), |i, j| {
        let both = ((a * (t(i) - t(j)).abs()).exp() - (a * (t(i) + t(j))).exp()) / (-2.0 * a);
        4.0 * q * q * both + if i == j { r * r } else { 0.0 }
    });
    let v = DVector::from_fn(there.len(), |k, _| runs[0].measured[there[k]] - 2.0 * 0.5 * (a * t(k)).exp());
    let factor = covariance.cholesky().expect("positive");
    let determinant: f64 = factor.l().diagonal().iter().map(|d| d.ln()).sum();
    let joint = 0.5 * v.dot(&factor.solve(&v)) + determinant;
    assert!((cost - joint).abs() < 1e-8 * joint.abs(), "{cost} {joint}");
}

const WING: &str = "model wing {
  input u;
  state x = free, z = 0.1 + 0.2*initial(u), g = c/4;
  param a = -0.8, b = 0.6, c = 0.5, tau = 0.13 in [0, 1], s = 0.4, L = 1.5, k = 0.2;
  param bias = 0.05 per run;
  der(x) = a*x + b*delay(u, tau) - c*x^3 + g;
  der(z) = x - 0.5*z + k*sin(z);
  der(g) = -g/L;
  noise der(g) = sqrt(2*s^2/L), der(z) = 0.1*c;
  output y1 = z + bias + c*x^2;
  output y2 = x*(1 + 0.1*k);
}";

#[test]
fn the_gradient_is_that_of_central_differences_for_every_unknown() {
    let model = Model::from_text("wing.fdm", WING).expect("a model");
    let runs = [run("one", (25, 1, 2), 0.1, 5, 6), run("two", (18, 1, 2), 0.15, 9, 0)];
    with(&model, &runs, &Options::default(), |setting| {
        let steps = vec![Steps::equal(Scheme::RungeKutta, 2); 2];
        let mut likelihood = setting.likelihood(&steps).expect("suited");
        let values = setting.unknowns.start.clone();
        let plain = likelihood.evaluate(&values, false).expect("finite");
        let cost = likelihood.evaluate(&values, true).expect("finite");
        assert!((plain - cost).abs() <= 1e-12 * cost.abs(), "{plain} {cost}");
        let gradient = likelihood.score.gradient.clone();
        // seven shared, two deviations, bias and x(0) of each run
        assert_eq!(values.len(), 7 + 2 + 4);
        for j in 0..values.len() {
            let h = 1e-5 * values[j].abs().max(0.1);
            let mut at = |d: f64| {
                let mut moved = values.clone();
                moved[j] += d;
                likelihood.evaluate(&moved, false).expect("finite")
            };
            // fourth order
            let difference = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            let size = gradient.iter().fold(0.0f64, |m, g| m.max(g.abs()));
            assert!(gradient[j] != 0.0, "unknown {j} moves nothing");
            assert!((gradient[j] - difference).abs() < 1e-7 * size, "unknown {j}: {} {difference}", gradient[j]);
        }
    });
}

#[test]
fn what_a_filter_cannot_do_is_told() {
    let said = |text: &str, options: FitOptions| -> FilterError {
        let model = Model::from_text("m.fdm", text).expect("a model");
        let runs = [run("r", (20, model.layout().inputs, model.layout().outputs), 0.1, 1, 0)];
        fit_filter(&model, &runs, &options, &Work::default()).expect_err("refused")
    };
    let plain = "model m { state x = 1; param a = -1; der(x) = a*x; output y = x; }";
    assert_eq!(said(plain, FitOptions::default()), FilterError::NoProcessNoise);
    let noisy = "model m { state x = 1; param a = -1, q = 0; der(x) = a*x; noise der(x) = q; output y = x; }";
    assert_eq!(said(noisy, FitOptions::default()), FilterError::StartsAtZero { parameter: "q".into() });
    let options = Options { noise: Noise::Full, ..Options::default() };
    assert_eq!(said(noisy, FitOptions { options, ..FitOptions::default() }), FilterError::FullNoise);
    let late = "model m { state x = 1; param a = -1; der(x) = a*delay(x, 0.1); noise der(x) = 0.1; output y = x; }";
    assert_eq!(said(late, FitOptions::default()), FilterError::DelayedState { state: "x".into() });
    let held =
        "model m { state x = 1; param a = -1; der(x) = a*x; limit x in [0, 2]; noise der(x) = 0.1; output y = x; }";
    assert_eq!(said(held, FitOptions::default()), FilterError::Limit { state: "x".into() });
}
