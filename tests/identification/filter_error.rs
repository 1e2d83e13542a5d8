//! The filter-error method on vehicles in turbulence and on an unstable one.

use fdm::estimate::{FitOptions, Options, Status, Termination, Work, fit_filter};
use support::model;
use support::turbulence::{
    AIRCRAFT, CALM, Flight, TRUTH, UNSTABLE_TRUTH, filtered, gusty, held, multistep, of, open_loop, theta,
};

#[test]
fn turbulence_is_told_from_the_vehicle() {
    let (model, run) = gusty(11, 0.03, 600);
    let found = filtered(&model, &[run]);
    for (name, truth) in TRUTH {
        let (value, error) = of(&found.fit, name);
        assert!(
            (value - truth).abs() < 3.5 * error && error < 0.5 * truth.abs(),
            "{name}: {value} +- {error}, {truth}"
        );
    }
    for (deviation, truth) in found.deviations.iter().zip([0.002, 0.003]) {
        let error = deviation.standard_error.unwrap();
        assert!((deviation.value - truth).abs() < 3.5 * error, "{}: {}", deviation.name, deviation.value);
    }
    // innovations are white where the noise is right
    let white: Vec<f64> = found.fit.quality.iter().filter_map(|q| Some(q.whiteness.as_ref()?.p_value)).collect();
    assert!(white.len() == 2 && white.iter().all(|p| *p > 1e-3), "{white:?}");
}

#[test]
fn several_runs_with_gaps_and_values_of_their_own() {
    let text = AIRCRAFT.replace("alpha = 0,", "alpha = free,").replace("s = 0.02;", "s = 0.02, b = 0 per run;");
    let (model, truth) = (model(&text.replace("rate = q;", "rate = q + b;")), gusty(1, 0.03, 400));
    let mut runs = [truth.1.clone(), gusty(2, 0.03, 300).1];
    (runs[0].name, runs[1].name) = ("one".into(), "two".into());
    (0..200).for_each(|k| runs[0].measured[3 * k + 5] = f64::NAN);
    runs[1].measured.iter_mut().step_by(2).for_each(|z| *z += 0.05);
    let found = filtered(&model, &runs);
    let bias = |run: &str| found.fit.estimate.parameter("b", Some(run)).unwrap();
    let (one, two) = (bias("one"), bias("two"));
    assert!(one.value.abs() < 4.0 * one.standard_error.unwrap(), "{} {:?}", one.value, one.standard_error);
    assert!((two.value - 0.05).abs() < 4.0 * two.standard_error.unwrap(), "{} {:?}", two.value, two.standard_error);
    let (ma, error) = of(&found.fit, "Ma");
    assert!((ma + 4.2).abs() < 4.0 * error, "{ma} +- {error}");
}

/// Without noise in the equations both methods are one.
#[test]
fn with_hardly_any_noise_in_the_equations_it_is_output_error() {
    let calm = model(CALM);
    let theta = theta(&calm, &TRUTH[..4]);
    let (intensities, deviations) = (vec![0.0; 2], vec![0.002, 0.003]);
    let flight = Flight { model: &calm, theta, intensities, deviations, samples: 400, dt: 0.05 };
    let run = flight.record("flight", 5, |t, _| vec![multistep(t)]);
    let noisy = model(&CALM.replace("  output rate", "  noise der(q) = 1e-9;\n  output rate"));
    let (filtered, plain) = (filtered(&noisy, std::slice::from_ref(&run)), open_loop(&calm, &[run]));
    for (name, _) in &TRUTH[..4] {
        let (one, other) = (of(&filtered.fit, name), plain.estimate.parameter(name, None).unwrap());
        let error = other.standard_error.unwrap();
        assert!((one.0 - other.value).abs() < 0.01 * error, "{name}: {} {} +- {error}", one.0, other.value);
        // output error takes degrees of freedom off
        assert!((one.1 / error - 1.0).abs() < 0.01, "{name}: {} {error}", one.1);
    }
}

#[test]
fn noise_that_is_not_there_stands_at_zero() {
    let (model, run) = gusty(4, 0.0, 400);
    let changes = fdm::estimate::Changes { fix: vec!["L".into()], ..Default::default() };
    let options = FitOptions { changes, ..FitOptions::default() };
    let found = fit_filter(&model, &[run], &options, &Work::default()).unwrap();
    let s = found.fit.estimate.parameter("s", None).unwrap();
    let none = found.not_identifiable == ["s"] && s.value == 0.0 && s.status == Status::AtLowerBound;
    // the likelihood of a deviation that is 0 is highest at 0 in half of the records, else just above
    assert!(none || s.value < 3.0 * s.standard_error.unwrap(), "{} {:?}", s.value, found.not_identifiable);
    assert!(found.fit.estimate.is_good(), "{}", found.fit.estimate.termination);
}

#[test]
fn an_unstable_vehicle_is_identified_under_feedback() {
    let (model, run) = held(3, 600);
    let found = filtered(&model, &[run]);
    for (name, truth) in UNSTABLE_TRUTH {
        let (value, error) = of(&found.fit, name);
        assert!(
            (value - truth).abs() < 3.5 * error && error < 0.2 * truth.abs(),
            "{name}: {value} +- {error}, {truth}"
        );
    }
}

/// The intensities move no response: output error holds them and stays good.
#[test]
fn output_error_holds_what_only_noise_knows() {
    let (model, run) = gusty(7, 0.01, 300);
    let plain = open_loop(&model, &[run]);
    assert_eq!(plain.estimate.parameter("s", None).unwrap().status, Status::Fixed);
}

#[test]
fn the_same_bits_for_every_number_of_threads_and_an_end_when_asked() {
    let (model, run) = gusty(8, 0.03, 200);
    let mut runs = [run.clone(), run];
    runs[1].name = "again".into();
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| filtered(&model, &runs).fit.estimate)
    };
    assert_eq!(with(1), with(2));
    let options = FitOptions { options: Options { iterations: 1, ..Options::default() }, ..FitOptions::default() };
    let stopped = fit_filter(&model, &runs, &options, &Work::default()).unwrap().fit.estimate.termination;
    assert_eq!(stopped, Termination::IterationLimit);
}
