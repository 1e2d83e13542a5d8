//! Whether profiles find what is known: the parabola of a linear model, an interval that is open, a bound, names that nothing has.

use super::*;
use fdm_estimate::{Fit, FitOptions, Halt, Noise, Options, Work, fit};
use fdm_system::Model;
use fdm_system::record::Run;

fn fitted(text: &str, u: &[f64], y: impl Fn(f64) -> f64, deviation: f64) -> (Fit, Vec<Run>, FitOptions) {
    let model = Model::from_text("m.fdm", text).expect("a model");
    // not random, so that the estimate stays near the truth
    let shift = |k: usize| 0.5 * deviation * ((k * k * 7) as f64).sin();
    let run = Run {
        name: "run".into(),
        time: (0..u.len()).map(|k| k as f64).collect(),
        measured: u.iter().enumerate().map(|(k, u)| y(*u) + shift(k)).collect(),
        inputs: u.to_vec(),
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let noise = Noise::Given(vec![Some(deviation)]);
    let options = Options { noise, colour: false, ..Options::default() };
    let options = FitOptions { options, ..FitOptions::default() };
    let runs = vec![run];
    (fit(&model, &runs, &options, &Work::default()).expect("a fit"), runs, options)
}

#[test]
fn a_linear_model_has_the_interval_of_its_error() {
    let u: Vec<f64> = (0..40).map(|k| f64::from(k) / 10.0).collect();
    let text = "model line { input u; param a = 1, b = 0; output y = a*u + b; }";
    let (fit, runs, options) = fitted(text, &u, |u| 2.0 * u - 1.0, 0.1);
    let profiler = Profiler::new(&fit, &runs, &options, &Work::default()).expect("possible");
    for name in ["a", "b"] {
        let p = profiler.of(name).expect("estimated");
        let half = 1.959_964 * fit.estimate.parameter(name, None).and_then(|p| p.error()).expect("known");
        assert!((p.reach() / half - 1.0).abs() < 1e-6, "{} {half}", p.reach());
        let [End::At(low), End::At(high)] = p.ends else { panic!("{:?}", p.ends) };
        // an end is taken where the root of the rise is right to a hundredth
        assert!(((p.value - low) / half - 1.0).abs() < 0.011 && ((high - p.value) / half - 1.0).abs() < 0.011, "{p:?}");
        assert!(p.refits <= 12 && p.points.len() == p.refits + 1, "{}", p.refits);
        for point in &p.points {
            let want = p.rise * ((point.value - p.value) / half).powi(2);
            assert!((point.rise - want).abs() < 1e-6 + 1e-6 * want, "{point:?} {want}");
            assert_eq!(point.others.len(), 1);
        }
        assert!(p.points.is_sorted_by(|a, b| a.value < b.value));
    }
}

#[test]
fn an_interval_that_ends_nowhere_is_open_and_one_at_a_bound_says_so() {
    let u: Vec<f64> = (1..12).map(f64::from).collect();
    let text = |most: &str| {
        format!("model rise {{ input u; param a = 1, k = 2 in [0.01, {most}]; output y = a*(1 - exp(-k*u)); }}")
    };
    let profile = |most: &str| {
        let (fit, runs, options) = fitted(&text(most), &u, |u| 1.0 - (-2.5 * u).exp(), 0.06);
        Profiler::new(&fit, &runs, &options, &Work::default()).expect("possible").of("k").expect("estimated")
    };
    let [low, high] = profile("1e6").ends;
    assert!(matches!(low, End::At(v) if v > 0.5 && v < 2.0), "{low:?}");
    assert!(matches!(high, End::Open(v) if v > 20.0), "{high:?}");
    assert_eq!(profile("8").ends[1], End::Bound(8.0));
}

#[test]
fn a_value_that_was_fitted_into_another_minimum_is_fitted_again_from_beyond() {
    let u: Vec<f64> = (0..30).map(f64::from).collect();
    let (fit, runs, options) =
        fitted("model m { input u; param a = 1, b = 1; output y = a*u + b; }", &u, |u| 2.0 * u - 1.0, 0.1);
    let profiler = Profiler::new(&fit, &runs, &options, &Work::default()).expect("possible");
    let wanted = profiler.subject("a").expect("estimated");
    let mut refits = 0;
    let mut found: Vec<Refit> = [2.0, 1.0]
        .map(|at| profiler.refit(&wanted, (at, wanted.value(1.0, at)), &profiler.starts).expect("a fit"))
        .into();
    let right = found[1].rise;
    found[1].rise = 100.0;
    profiler.mend(&wanted, &mut found, &mut refits);
    assert_eq!(refits, 1);
    assert!(found[0].at == 1.0 && (found[0].rise - right).abs() < 1e-9, "{} {right}", found[0].rise);
}

#[test]
fn a_rise_may_be_asked_for_and_a_parameter_at_its_bound_has_one_side() {
    let u: Vec<f64> = (1..40).map(|k| f64::from(k) / 4.0).collect();
    let text = "model rise { input u; param a = 1, k = 2 in [0.01, 20] log; output y = a*(1 - exp(-k*u)); }";
    // a step: no rate within the bounds is fast enough
    let (fit, runs, options) = fitted(text, &u, |_| 1.0, 0.06);
    let p = fit.estimate.parameter("k", None).expect("there");
    assert_eq!(p.status, Status::AtUpperBound);
    let profile = |rise: Option<f64>| {
        let profiler = Profiler::new(&fit, &runs, &options, &Work::default()).expect("possible").with_rise(rise);
        profiler.of("k").expect("one side")
    };
    let [one, two] = [Some(1.92), Some(3.84)].map(profile);
    assert!(one.bound && one.rise == 1.92 && one.ends[1] == End::Bound(20.0), "{one:?}");
    let [End::At(low), End::At(lower)] = [one.ends[0], two.ends[0]] else { panic!("{one:?} {two:?}") };
    assert!(1.0 < lower && lower < low && low < 20.0, "{lower} {low}");
    // there the cost has risen by so much
    let near = one.points.iter().map(|p| (p.rise - 1.92).abs()).fold(f64::INFINITY, f64::min);
    assert!(near < 0.05, "{near}");
    assert_eq!(profile(None).rise, 0.5 * quantile(None).powi(2));
}

#[test]
fn what_has_no_profile_is_said_and_an_interrupt_ends_it() {
    let u: Vec<f64> = (0..20).map(f64::from).collect();
    let text = "model line { input u; param slope = 1, b = 0 fixed; output y = slope*u + b; }";
    let (fit, runs, options) = fitted(text, &u, |u| 2.0 * u, 0.1);
    let profiler = Profiler::new(&fit, &runs, &options, &Work::default()).expect("possible");
    assert!(profiler.of("slpe").expect_err("no such").to_string().contains("did you mean `slope`?"));
    assert!(profiler.of("b").expect_err("fixed").to_string().contains("not estimated"));
    assert!(profiler.of("slope").is_ok());
    let halt = Halt::default();
    halt.interrupt();
    let stopped = Profiler::new(&fit, &runs, &options, &Work::until(&halt))
        .expect("possible")
        .of("slope")
        .expect("of what is there");
    assert!(stopped.ends.iter().all(|e| matches!(e, End::Interrupted(_))), "{:?}", stopped.ends);
}

#[test]
fn others_at_their_bounds_beside_an_end_are_named() {
    let u: Vec<f64> = (0..40).map(|k| f64::from(k) / 10.0).collect();
    let text = "model line { input u; param a = 1, b = 0.1 in [0, 5]; output y = a*u + b; }";
    let (fit, runs, options) = fitted(text, &u, |u| 2.0 * u + 0.03, 0.1);
    let p = Profiler::new(&fit, &runs, &options, &Work::default()).expect("possible").of("a").expect("estimated");
    // steeper lines would begin below zero
    assert_eq!(p.held, [Vec::new(), vec![AtBound { name: "b".into(), bound: 0.0 }]], "{p:?}");
    let [End::At(_), End::At(high)] = p.ends else { panic!("{:?}", p.ends) };
    // with b at 0 the cost is a parabola of a alone
    let value = fit.estimate.parameter("b", None).expect("there").value;
    let rest = |a: f64| u.iter().map(|u| ((a - p.value) * u - value).powi(2)).sum::<f64>() / 0.02;
    assert!((rest(high) / p.rise - 1.0).abs() < 0.03, "{} {}", rest(high), p.rise);
}

/// A rate that saturates: how early hardly shows, and not at all may be right.
#[test]
fn a_bound_closes_an_interval_and_is_where_another_ends() {
    let u: Vec<f64> = (1..13).map(f64::from).collect();
    let text = "model rate { input u; param V = 1, K = 1 in [0, 50]; output y = V*u/(K + u); }";
    let (fit, runs, options) = fitted(text, &u, |u| 2.0 * u / (0.3 + u), 0.3);
    let profiler = Profiler::new(&fit, &runs, &options, &Work::default()).expect("possible");
    let [half, rate] = ["K", "V"].map(|name| profiler.of(name).expect("estimated"));
    // with K held V is a quotient of sums
    let cost = |k: f64| {
        let shape: Vec<f64> = u.iter().map(|u| u / (k + u)).collect();
        let sums =
            |of: &dyn Fn(f64, f64) -> f64| shape.iter().zip(&runs[0].measured).map(|(x, z)| of(*x, *z)).sum::<f64>();
        let v = sums(&|x, z| x * z) / sums(&|x, _| x * x);
        sums(&|x, z| (z - v * x).powi(2)) / (2.0 * 0.3_f64.powi(2))
    };
    let [End::Bound(low), End::At(high)] = half.ends else { panic!("{half:?}") };
    assert!(low == 0.0 && cost(0.0) - cost(half.value) < half.rise, "{half:?}");
    assert!(((cost(high) - cost(half.value)) / half.rise - 1.0).abs() < 0.03, "{half:?}");
    assert_eq!(rate.held, [vec![AtBound { name: "K".into(), bound: 0.0 }], Vec::new()], "{rate:?}");
}
