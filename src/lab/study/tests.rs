//! Whether a study finds what is known: the scatter of a linear model, intervals that are too short, repeats that go astray.

use super::*;
use crate::requirement::Draws;
use fdm_estimate::{Fit, FitOptions, Halt, Noise, Observer, Options, Work, fit};
use fdm_numeric::random::Stream;
use fdm_system::Model;
use fdm_system::record::Run;
use std::sync::atomic::{AtomicUsize, Ordering};

const LINE: &str = "model line { input u; param a = 1, b = 0; output y = a*u + b; }";

fn run(deviation: f64) -> Run {
    let (n, mut chance) = (30, Stream::named(5, &["record"]));
    let u: Vec<f64> = (0..n).map(|k| f64::from(k) / 10.0).collect();
    Run {
        name: "run".into(),
        time: (0..n).map(f64::from).collect(),
        measured: u.iter().map(|u| 2.0 * u - 1.0 + deviation * chance.normal()).collect(),
        inputs: u,
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    }
}

fn fitted(noise: Noise) -> (Fit, Vec<Run>, FitOptions) {
    let model = Model::from_text("line.fdm", LINE).expect("a model");
    let options = FitOptions { options: Options { noise, ..Options::default() }, ..FitOptions::default() };
    let runs = vec![run(0.1)];
    (fit(&model, &runs, &options, &Work::default()).expect("a fit"), runs, options)
}

fn studied(bootstrap: &Bootstrap, count: usize) -> Vec<Option<Repeat>> {
    series(count, &Work::default(), &|_, _| (), &|k| bootstrap.once(k, &Halt::default()))
}

#[test]
fn a_linear_model_has_the_scatter_of_the_textbook_and_its_intervals_hold() {
    let (fit, runs, options) = fitted(Noise::Given(vec![Some(0.1)]));
    let bootstrap = Bootstrap::new(&fit, &runs, &options, (Colour::White, 3)).expect("possible");
    let repeats = studied(&bootstrap, 400);
    let study = Study::of("line", (Some(Colour::White), 3), bootstrap.subjects(), &repeats);
    assert_eq!((study.done, study.converged, study.parameters.len()), (400, 400, 2));
    for p in &study.parameters {
        let interval = p.interval(Kind::CramerRao).expect("printed");
        // a scatter of 400 is known to 3.5 %, a coverage to 1.1 %
        assert!((interval.ratio - 1.0).abs() < 0.12, "{} {}", p.subject.name, interval.ratio);
        assert!((interval.coverage.share - 0.95).abs() < 0.035, "{} {:?}", p.subject.name, interval.coverage);
        assert!(p.bias.abs() < 2.0 * p.bias_chance && p.bias_chance < 0.12, "{} {}", p.bias, p.bias_chance);
        let known = fit.estimate.parameter(&p.subject.name, None).expect("fitted");
        assert_eq!(p.subject.truth, known.value);
        assert!((interval.error / known.standard_error.expect("known") - 1.0).abs() < 1e-9);
    }
    let pooled = study.pooled.first().expect("all together");
    assert!((pooled.coverage - 0.95).abs() < 0.03 && pooled.interval[0] < pooled.coverage);
}

/// Of a linear requirement by its own law; of a bent one by draws; and the same bits in any order.
#[test]
fn intervals_of_requirements_hold_as_often_as_they_say() {
    let text = LINE.replace("output", "requirement sum = a + 2*b in [-1, 1], bent = exp(8*a) in [0, inf]; output");
    let model = Model::from_text("line.fdm", &text).expect("a model");
    let noise = Noise::Given(vec![Some(0.1)]);
    let options = FitOptions { options: Options { noise, ..Options::default() }, ..FitOptions::default() };
    let runs = vec![run(0.1)];
    let first = fit(&model, &runs, &options, &Work::default()).expect("a fit");
    let bootstrap = Bootstrap::new(&first, &runs, &options, (Colour::White, 3)).expect("possible");
    assert_eq!(bootstrap.goals(), Ok(&[][..]));
    let bootstrap = bootstrap.judging(&first, Draws { count: 400, seed: 1 });
    let theta = |name: &str| first.estimate.parameter(name, None).expect("fitted").value;
    let goals = bootstrap.goals().expect("two");
    assert!((goals[0].truth.expect("a value") - theta("a") - 2.0 * theta("b")).abs() < 1e-12);
    let repeats = studied(&bootstrap, 300);
    let study = bootstrap.study(&repeats);
    let [sum, bent] = &study.requirements[..] else { panic!("{:?}", study.requirements) };
    // a coverage of 300 is known to 1.3 %
    for r in [sum, bent] {
        assert!((r.coverage.share - 0.95).abs() < 0.04 && r.coverage.of == 300, "{r:?}");
        assert!(r.missed.iter().all(|n| *n > 0), "{r:?}");
    }
    assert!(sum.drawn == 0 && bent.drawn == 300, "{sum:?} {bent:?}");
    assert!((1.96 * sum.scatter.expect("known") / sum.half_width.expect("known") - 1.0).abs() < 0.12, "{sum:?}");
    assert_eq!(bootstrap.once(7, &Halt::default()), repeats[7]);
}

/// Noise that is an expression is drawn by it, and repeats and profiles are fitted by its likelihood.
#[test]
fn noise_that_is_part_of_the_model_is_drawn_and_fitted_as_such() {
    let text = LINE.replace("output", "param g = 0.05 in [1e-3, 10]; noise y = g*(0.1 + u); output");
    let model = Model::from_text("line.fdm", &text).expect("a model");
    let (mut run, mut chance) = (run(0.0), Stream::named(6, &["record"]));
    let noise: Vec<f64> = run.inputs.iter().map(|u| 0.1 * (0.1 + u) * chance.normal()).collect();
    run.measured.iter_mut().zip(noise).for_each(|(z, v)| *z += v);
    let (runs, options) = (vec![run], FitOptions::default());
    let fit = fit(&model, &runs, &options, &Work::default()).expect("a fit");
    assert!(fit.is_good() && !fit.noise_of_samples.is_empty());
    let bootstrap = Bootstrap::new(&fit, &runs, &options, (Colour::White, 3)).expect("possible");
    let repeats = studied(&bootstrap, 400);
    let study = Study::of("line", (Some(Colour::White), 3), bootstrap.subjects(), &repeats);
    assert_eq!((study.converged, study.parameters.len()), (400, 3));
    for p in study.parameters.iter().filter(|p| p.subject.name != "g") {
        let interval = p.interval(Kind::CramerRao).expect("printed");
        // of noise of one size, the scatter of `b` would be four times as large
        assert!((interval.ratio - 1.0).abs() < 0.15, "{} {}", p.subject.name, interval.ratio);
        assert!((interval.coverage.share - 0.95).abs() < 0.045, "{} {:?}", p.subject.name, interval.coverage);
        assert!(p.bias.abs() < 2.0 * p.bias_chance, "{} {}", p.bias, p.bias_chance);
    }
    let profiler = Profiler::new(&fit, &runs, &options, &Work::default()).expect("possible");
    let profile = profiler.of("a").expect("a profile");
    assert!(profile.points.iter().all(|p| p.rise > -1e-9), "{:?}", profile.points);
    for (end, by_error) in profile.ends.iter().zip(profile.by_error) {
        let End::At(end) = *end else { panic!("{end:?}") };
        assert!(((end - profile.value) / (by_error - profile.value) - 1.0).abs() < 0.25, "{end} {by_error}");
    }
}

#[test]
fn errors_that_do_not_know_the_colour_are_found_out() {
    let (fit, runs, options) = fitted(Noise::Diagonal);
    let bootstrap = Bootstrap::new(&fit, &runs, &options, (Colour::Ar1, 3)).expect("possible");
    let study = Study::of("line", (Some(Colour::Ar1), 3), bootstrap.subjects(), &studied(&bootstrap, 100));
    let raw = study.parameters[1].interval(Kind::CramerRao).expect("printed");
    assert!(raw.ratio > 1.5 && raw.coverage.interval[1] < 0.9, "{raw:?}");
    assert!(study.parameters[1].interval(Kind::Corrected).is_some());
}

#[test]
fn repeats_know_nothing_of_threads_and_order_and_go_on_where_they_were() {
    let (fit, runs, options) = fitted(Noise::Diagonal);
    let bootstrap = Bootstrap::new(&fit, &runs, &options, (Colour::White, 9)).expect("possible");
    let whole = studied(&bootstrap, 30);
    let backwards: Vec<_> = (0..30).rev().map(|k| bootstrap.once(k, &Halt::default())).collect();
    assert!(whole.iter().eq(backwards.iter().rev()));
    assert_ne!(whole[0], whole[1]);
    let other = Bootstrap::new(&fit, &runs, &options, (Colour::White, 10)).expect("possible");
    assert_ne!(other.once(0, &Halt::default()), whole[0]);

    let keeper = Memory::default();
    let kept = Work::default().keeping(Some(&keeper));
    let patience = Patience(Halt::default());
    let patient = Work::until(&patience.0).telling(&patience).keeping(Some(&keeper));
    let first = series(30, &patient, &|_, _| (), &|k| bootstrap.once(k, patient.halt()));
    let reached = first.iter().flatten().count();
    assert!(reached < 30, "{reached}");
    let made = AtomicUsize::new(0);
    let counting = |k: u64| {
        made.fetch_add(1, Ordering::Relaxed);
        bootstrap.once(k, &Halt::default())
    };
    assert_eq!(series(30, &kept, &|_, _| (), &counting), whole);
    assert_eq!(made.load(Ordering::Relaxed), 30 - reached);
    // a shorter series afterwards makes none, and forgets none
    assert_eq!(series(4, &kept, &|_, _| (), &counting), whole[..4]);
    assert_eq!(series(30, &kept, &|_, _| (), &counting), whole);
    assert_eq!(made.load(Ordering::Relaxed), 30 - reached);
}

#[test]
fn repeats_that_went_astray_are_counted() {
    let subject = Subject { step: String::new(), name: "a".into(), run: None, unit: None, truth: 1.0 };
    let figure = |value: f64| Figure { value, errors: [0.1, f64::NAN], factors: [1.96; 2] };
    let good = |value: f64| Some(Repeat { astray: Vec::new(), figures: vec![figure(value)], requirements: Vec::new() });
    let repeats = [good(1.0), good(1.1), good(0.5), Some(Repeat::gone("lost", 1)), None];
    let study = Study::of("a", (None, 0), std::slice::from_ref(&subject), &repeats);
    assert_eq!((study.asked, study.done, study.converged, study.is_whole()), (5, 4, 3, false));
    assert_eq!(study.astray, [("lost".to_string(), 1)]);
    let interval = study.parameters[0].interval(Kind::CramerRao).expect("printed");
    assert_eq!((interval.coverage.hits, interval.coverage.of, interval.of_all.of), (2, 3, 4));
    assert!(study.parameters[0].interval(Kind::Corrected).is_none());
    assert_eq!(study.trusted().expect("one kind").of_all, 0.5);
}

#[test]
fn what_cannot_be_repeated_is_said() {
    let (fit, runs, options) = fitted(Noise::Diagonal);
    let mut astray = fit.clone();
    astray.estimate.termination = fdm_estimate::Termination::IterationLimit;
    let refused = |fit: &Fit, colour| Bootstrap::new(fit, &runs, &options, (colour, 0)).err().expect("refused");
    assert!(refused(&astray, Colour::White).is_of_numbers());
    let mut silent = fit.clone();
    silent.estimate.noise = None;
    assert_eq!(refused(&silent, Colour::White), StudyError::NoNoise);
    let mut colourless = fit.clone();
    colourless.estimate.uncorrected = Some(fdm_estimate::Uncorrected::TooLarge);
    assert!(refused(&colourless, Colour::Fitted).to_string().contains("--noise-colour"));
    assert!(Bootstrap::new(&fit, &runs, &options, (Colour::Fitted, 0)).is_ok());
}

/// Keeps in memory.
#[derive(Default)]
struct Memory(std::sync::Mutex<Option<Vec<u8>>>);

impl fdm_estimate::CheckpointStore for Memory {
    fn keep(&self, _: &str, state: &[u8]) -> Result<(), String> {
        *self.0.lock().expect("not poisoned") = Some(state.to_vec());
        Ok(())
    }

    fn find(&self, _: &str) -> Result<Option<Vec<u8>>, String> {
        Ok(self.0.lock().expect("not poisoned").clone())
    }
}

/// Ends a series after so many repeats.
struct Patience(Halt);

impl Observer for Patience {
    fn parts_ended(&self, done: usize) {
        if done >= 7 {
            self.0.interrupt();
        }
    }
}
