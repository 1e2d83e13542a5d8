//! Recursive least squares with forgetting, and the iterate whose simulation errs least.

use fdm::Model;
use fdm::equation_error::{Detrend, Preprocessing, RecursiveEstimates, RecursiveOptions, RegressionError, recursive};
use fdm::estimate::{BestOptions, Criterion, FitOptions, Work, best_iterate, fit};
use fdm::record::Run;
use fdm::simulate::Simulator;
use support::hovering::{drive, helicopter, hovering, off};
use support::model;
use support::turbulence::Flight;

/// Roll and yaw with an equal damping, a coefficient that is known, and a product of signals.
const MODEL: &str = "model m {
  input u, s;
  state x = free, z = free;
  param a = -1, b = 1, c = 0.1, d = -1, k = 0.5 fixed;
  tie d = 2*a;
  der(x) = a*x + b*u - c*x*z + k*z;
  der(z) = d*z - x + s;
  output y1 = x, y2 = z;
}";
const TRUTH: [(&str, f64); 3] = [("a", -0.6), ("b", 1.7), ("c", 0.4)];

fn theta(model: &Model, truth: &[(&str, f64)]) -> Vec<f64> {
    let mut theta = model.definition().start();
    truth.iter().for_each(|(name, value)| theta[model.definition().param(name).unwrap()] = *value);
    theta
}

fn flown(model: &Model, truth: &[(&str, f64)], deviation: f64, seed: u64, samples: usize) -> Run {
    let q = model.layout().outputs;
    let (intensities, deviations) = (vec![0.0; model.layout().states], vec![deviation; q]);
    let flight = Flight { model, theta: theta(model, truth), intensities, deviations, samples, dt: 0.02 };
    flight.record("flight", seed, |t, _| (0..model.layout().inputs).map(|k| drive(t, k)).collect())
}

fn column(found: &RecursiveEstimates, name: &str) -> usize {
    found.parameters.iter().position(|p| p.name == name).unwrap_or_else(|| panic!("no {name}"))
}

fn with(forgetting: f64) -> RecursiveOptions {
    RecursiveOptions { forgetting, ..RecursiveOptions::default() }
}

#[test]
fn without_forgetting_the_last_iterate_is_least_squares_of_all_steps() {
    let model = model(MODEL);
    for deviation in [0.0, 0.002] {
        let found = recursive(&model, &[flown(&model, &TRUTH, deviation, 1, 1500)], &with(1.0)).unwrap();
        let last = found.iterates.last().unwrap();
        assert_eq!((found.iterates.len(), found.parameters.len()), (1499, 3), "the tied parameter is none of its own");
        for (name, truth) in TRUTH {
            let j = column(&found, name);
            let (value, batch, error) = (last.values[j], found.batch[j], last.errors[j]);
            assert!((value - batch).abs() < 2e-3 * error.max(1e-6 * truth.abs()), "{name}: {value} {batch} +- {error}");
            let room = if deviation == 0.0 { 2e-3 * truth.abs() } else { 4.0 * error };
            assert!((value - truth).abs() < room, "{name}: {value} +- {error}");
        }
    }
}

/// The trapezoidal discretisation errs with the square of the interval.
#[test]
fn the_discretisation_is_of_second_order() {
    let model = model(MODEL);
    let mut fine = flown(&model, &TRUTH, 0.0, 1, 3200);
    fine.held = vec![false; 2];
    let theta = theta(&model, &TRUTH);
    Simulator::new(model.dynamics(), &fine.clone(), 4).unwrap().simulate(&theta, &mut fine.measured).unwrap();
    let error = |every: usize| {
        let mut run = fine.clone();
        let pick = |values: &[f64], width: usize| -> Vec<f64> {
            values.chunks_exact(width).step_by(every).flatten().copied().collect()
        };
        (run.time, run.inputs, run.measured) = (pick(&run.time, 1), pick(&run.inputs, 2), pick(&run.measured, 2));
        let found = recursive(&model, &[run], &with(1.0)).unwrap();
        (found.iterates.last().unwrap().values[column(&found, "a")] + 0.6).abs()
    };
    let errors = [1, 4, 8].map(error);
    assert!(errors[0] < 1e-3 && errors[2] < 0.1, "{errors:?}");
    assert!((2.5..6.0).contains(&(errors[2] / errors[1])), "{errors:?}");
}

#[test]
fn what_is_forgotten_makes_room_for_what_has_changed() {
    let model = model(MODEL);
    let (before, mut after) =
        (flown(&model, &TRUTH, 1e-4, 1, 1200), flown(&model, &[("a", -1.5), TRUTH[1], TRUTH[2]], 1e-4, 2, 1200));
    after.name = "later".into();
    let found = recursive(&model, &[before, after], &with(0.98)).unwrap();
    let a = column(&found, "a");
    let (then, now) = (&found.iterates[1198], found.iterates.last().unwrap());
    assert!(
        (then.values[a] + 0.6).abs() < 0.05 && (now.values[a] + 1.5).abs() < 0.05,
        "{} {}",
        then.values[a],
        now.values[a]
    );
    assert!((then.run, now.run) == (0, 1));
    let remembered = recursive(&model, &found.runs, &with(1.0)).unwrap();
    let mean = remembered.iterates.last().unwrap().values[a];
    assert!(mean < -0.7 && mean > -1.4, "{mean}");
}

#[test]
fn every_run_has_values_of_its_own_where_the_model_says_so_and_gaps_are_stepped_over() {
    let model = model(
        "model m { input u; state x = free; param a = -1, b = 0 per run, w = 0; \
        der(x) = a*x + u + b; output y = x; output z = w*x^2; }",
    );
    let mut runs = [
        flown(&model, &[("a", -0.8), ("b", 0.5)], 0.0, 1, 600),
        flown(&model, &[("a", -0.8), ("b", -0.2)], 0.0, 2, 600),
    ];
    runs[1].name = "other".into();
    (0..50).for_each(|k| runs[0].measured[2 * (5 * k + 3)] = f64::NAN);
    let found = recursive(&model, &runs, &with(1.0)).unwrap();
    let last = found.iterates.last().unwrap();
    let of = |run: &str| last.values[found.parameters.iter().position(|p| p.run.as_deref() == Some(run)).unwrap()];
    assert!((of("flight") - 0.5).abs() < 1e-2 && (of("other") + 0.2).abs() < 1e-2, "{last:?}");
    assert_eq!(found.kept, ["x(0)", "w"], "these are none of an equation");
    // both steps beside a gap are lost
    assert_eq!(found.iterates.len(), 2 * 599 - 100);
}

#[test]
fn the_best_iterate_is_none_worse_than_any_other_and_output_error_starts_from_it() {
    let model = model(MODEL);
    let run = flown(&model, &TRUTH, 0.02, 3, 800);
    let options = BestOptions { recursion: with(0.97), ..BestOptions::default() };
    let found = best_iterate(&model, std::slice::from_ref(&run), &options).unwrap();
    assert_eq!(found.criterion, Criterion::Simulation);
    let best = found.error_of(found.best).unwrap();
    assert_eq!(found.simulated.len(), 799);
    assert!(found.simulated.iter().all(|(_, e)| e.is_none_or(|e| e >= best)));
    assert!(best < found.error_of(798).unwrap(), "the last one remembers some hundred steps of a noisy record");
    let better = fit(&found.model, std::slice::from_ref(&run), &FitOptions::default(), &Work::default()).unwrap();
    assert!(better.estimate.is_good(), "{}", better.estimate.termination);
    for (name, truth) in TRUTH {
        let p = better.estimate.parameter(name, None).unwrap();
        assert!((p.value - truth).abs() < 4.0 * p.error().unwrap(), "{name}: {}", p.value);
    }
    let last = BestOptions { criterion: Criterion::Last, ..options };
    assert_eq!(best_iterate(&model, std::slice::from_ref(&run), &last).unwrap().best, 798);
    let steps = best_iterate(&model, &[run], &BestOptions { criterion: Criterion::OneStep, ..options }).unwrap();
    let least = steps.recursion.iterates.iter().map(|i| i.one_step).fold(f64::INFINITY, f64::min);
    assert_eq!(steps.recursion.iterates[steps.best].one_step, least);
}

#[test]
fn smoothing_lessens_what_noise_does_to_steps() {
    let model = model(MODEL);
    let run = flown(&model, &TRUTH, 0.02, 5, 2000);
    let off = |preprocessing: Preprocessing| {
        let options = RecursiveOptions { forgetting: 1.0, preprocessing };
        let found = recursive(&model, std::slice::from_ref(&run), &options).unwrap();
        let last = found.iterates.last().unwrap();
        last.errors[column(&found, "a")]
    };
    let smoothing = Preprocessing { cutoff: Some(3.0), points: Some(9), detrend: Detrend::None };
    let (rough, smooth) = (off(Preprocessing::default()), off(smoothing));
    assert!(smooth < 0.3 * rough, "{smooth} {rough}");
}

#[test]
fn what_cannot_be_is_told() {
    let model = model(MODEL);
    let run = flown(&model, &TRUTH, 0.0, 1, 50);
    for forgetting in [0.0, 1.5, f64::NAN, -1.0] {
        let told = recursive(&model, std::slice::from_ref(&run), &with(forgetting)).unwrap_err();
        assert!(matches!(told, RegressionError::Forgetting(_)), "{told}");
    }
    assert_eq!(recursive(&model, &[], &with(1.0)), Err(RegressionError::NoRuns));
    let options = BestOptions { restart: Some(0.0), ..BestOptions::default() };
    assert_eq!(best_iterate(&model, std::slice::from_ref(&run), &options).unwrap_err(), RegressionError::Restart(0.0));
    let short = run.part(0..2);
    assert!(matches!(recursive(&model, &[short], &with(1.0)), Err(RegressionError::TooFewRows { .. })));
}

/// Closed-loop records of the unstable helicopter, with values to begin with that are all zero.
#[test]
fn the_helicopter_is_identified_while_its_pilot_holds_it() {
    let model = helicopter();
    let mut params = model.definition().params.clone();
    params.iter_mut().filter(|p| !p.fixed && !p.quantity.name.ends_with("(0)")).for_each(|p| p.value = 0.0);
    let run = hovering(&model, 0.0, 1, 1500);
    assert!(run.measured.iter().all(|z| z.abs() < 30.0), "the loops hold it");
    let options = BestOptions { recursion: with(1.0), criterion: Criterion::OneStep, restart: None };
    let found = best_iterate(&model.with_params(params), &[run], &options).unwrap();
    assert_eq!(found.recursion.parameters.len(), 50);
    let error = off(&model, &found, &found.recursion.iterates[found.best].values);
    assert!(error < 0.02, "{error}");
}

/// Parts of an unstable vehicle's record are simulated from where each begins, whatever the model says about the beginning of the record.
#[test]
fn parts_begin_where_they_were_measured() {
    let text = std::fs::read_to_string(support::repository().join("models/hover/linear.fdm")).unwrap();
    let at_rest = model(&text);
    let run = hovering(&helicopter(), 1e-4, 1, 900);
    let options = BestOptions { recursion: with(1.0), criterion: Criterion::Simulation, restart: Some(2.0) };
    let found = best_iterate(&at_rest, &[run], &options).unwrap();
    let error = found.error_of(found.best).unwrap();
    assert!(error < 0.02, "{error}");
}
