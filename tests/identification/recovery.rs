//! Known parameters hidden in simulated data, and found again.

use fdm::Model;
use fdm::estimate::{Changes, Fit, FitOptions, Options, Work, fit};
use fdm::record::Run;
use fdm::simulate::Simulator;
use std::f64::consts::PI;
use support::Normal;

/// Steps between samples with which data are made.
const STEPS: usize = 8;

/// Multisine inputs over `n` samples; measured is what the model gives for `truth`.
fn recorded(name: &str, model: &Model, truth: &[(&str, f64)], n: usize, dt: f64, phase: f64) -> Run {
    recorded_with(STEPS, name, model, truth, (n, dt), phase)
}

fn recorded_with(
    per_interval: usize,
    name: &str,
    model: &Model,
    truth: &[(&str, f64)],
    (n, dt): (usize, f64),
    phase: f64,
) -> Run {
    let layout = model.layout();
    let time: Vec<f64> = (0..n).map(|k| dt * k as f64).collect();
    let input = |t: f64, i: usize| {
        let harmonic = |h: usize| (2.0 * PI * 0.17 * h as f64 * t + phase + (i * h) as f64).sin();
        (t / 2.0).min(1.0) * (1..6).map(harmonic).sum::<f64>()
    };
    let mut run = Run {
        name: name.into(),
        inputs: time.iter().flat_map(|t| (0..layout.inputs).map(move |i| input(*t, i))).collect(),
        measured: vec![0.0; n * layout.outputs],
        time,
        held: vec![false; layout.inputs],
        input_gaps: vec![0; layout.inputs],
        stated: Vec::new(),
        output_gaps: vec![0; layout.outputs],
    };
    let mut theta = model.definition().start();
    for (name, value) in truth {
        theta[model.definition().param(name).expect("declared")] = *value;
    }
    let mut y = vec![0.0; n * layout.outputs];
    Simulator::new(model.dynamics(), &run, per_interval).expect("suited").simulate(&theta, &mut y).expect("finite");
    run.measured = y;
    run
}

fn value(fit: &Fit, name: &str, run: Option<&str>) -> f64 {
    fit.estimate.parameter(name, run).unwrap_or_else(|| panic!("no {name}")).value
}

fn check(fit: &Fit, truth: &[(&str, f64)], relative: f64) {
    assert!(fit.estimate.is_good(), "{}", fit.estimate.termination);
    for (name, want) in truth {
        let run = fit.estimate.runs[0].run.clone();
        let own = fit.estimate.parameter(name, Some(&run)).is_some().then_some(run.as_str());
        let got = value(fit, name, own);
        assert!((got - want).abs() <= relative * want.abs(), "{name}: {got} instead of {want}");
    }
}

const DELAYS: &str = r#"model short_period "pitch response with two delays" {
    input stick; state alpha, q;
    param Za = -1.0, Zd = -0.1, Ma = -3.0, Mq = -1.5, Md = -4.0;
    param tau_in = 0.05 in [0, 0.5], tau_out = 0.05 in [0, 0.5];
    let moved = delay(stick, tau_in);
    der(alpha) = q + Za*alpha + Zd*moved;
    der(q) = Ma*alpha + Mq*q + Md*moved;
    output q_m = delay(q, tau_out);
    output n_m = 8*Za*alpha + 8*Zd*moved;
}"#;

const TRUTH: [(&str, f64); 7] =
    [("Za", -0.8), ("Zd", -0.15), ("Ma", -4.2), ("Mq", -1.1), ("Md", -6.0), ("tau_in", 0.137), ("tau_out", 0.0835)];

#[test]
fn an_input_delay_and_an_output_delay_to_one_part_in_a_million() {
    let model = Model::from_text("delays.fdm", DELAYS).unwrap();
    let run = recorded("doublet", &model, &TRUTH, 1000, 0.02, 0.3);
    // the data were made with 8 steps between samples; the same discretisation leaves only the estimation's own error
    let options = FitOptions { per_interval: Some(STEPS), ..FitOptions::default() };
    let found = fit(&model, std::slice::from_ref(&run), &options, &Work::default()).unwrap();
    check(&found, &TRUTH, 1e-6);
    assert!(found.estimate.iterations < 30, "{} corrections", found.estimate.iterations);
}

#[test]
fn the_steps_that_are_chosen_are_fine_enough_for_the_same_answer() {
    let model = Model::from_text("delays.fdm", DELAYS).unwrap();
    let run = recorded_with(64, "doublet", &model, &TRUTH, (1000, 0.02), 0.3);
    let found = fit(&model, std::slice::from_ref(&run), &FitOptions::default(), &Work::default()).unwrap();
    assert!(found.integration[0].steps.most() < 64, "{:?}", found.integration);
    check(&found, &TRUTH, 1e-6);
}

#[test]
fn the_same_model_by_file_and_by_macro_gives_the_same_bits() {
    let by_macro = fdm::model! {
        model short_period "pitch response with two delays" {
            input stick; state alpha, q;
            param Za = -1.0, Zd = -0.1, Ma = -3.0, Mq = -1.5, Md = -4.0;
            param tau_in = 0.05 in [0, 0.5], tau_out = 0.05 in [0, 0.5];
            let moved = delay(stick, tau_in);
            der(alpha) = q + Za*alpha + Zd*moved;
            der(q) = Ma*alpha + Mq*q + Md*moved;
            output q_m = delay(q, tau_out);
            output n_m = 8*Za*alpha + 8*Zd*moved;
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short_period.fdm");
    std::fs::write(&path, DELAYS).unwrap();
    let by_file = Model::from_file(&path).unwrap();
    let run = recorded("doublet", &by_file, &TRUTH, 400, 0.05, 0.3);
    assert_eq!(run, recorded("doublet", &by_macro, &TRUTH, 400, 0.05, 0.3));
    let fits = [&by_file, &by_macro]
        .map(|m| fit(m, std::slice::from_ref(&run), &FitOptions::default(), &Work::default()).unwrap());
    assert_eq!(fits[0].estimate, fits[1].estimate);
}

#[test]
fn two_runs_with_their_own_biases_and_free_initial_states() {
    let text = r#"model spring "mass on a spring" {
        input force; state x = free, v = v0;
        param k = 2, c = 0.2, v0 = 0 per run, bias = 0 per run; param double = 2*k;
        der(x) = v; der(v) = force - k*x - c*v*abs(v);
        output x_m = x + bias; output v_m = v; }"#;
    let model = Model::from_text("spring.fdm", text).unwrap();
    let shared = [("k", 3.3), ("c", 0.45)];
    let own = [[("x(0)", 0.7), ("v0", -0.4), ("bias", 0.02)], [("x(0)", -1.1), ("v0", 0.9), ("bias", -0.3)]];
    let runs: Vec<Run> = own
        .iter()
        .zip(["first", "second"])
        .map(|(own, name)| recorded(name, &model, &[&shared[..], &own[..]].concat(), 300, 0.05, 0.1))
        .collect();
    let found =
        fit(&model, &runs, &FitOptions { per_interval: Some(STEPS), ..FitOptions::default() }, &Work::default())
            .unwrap();
    assert!(found.estimate.is_good());
    for (name, want) in shared.iter().chain(&[("double", 6.6)]) {
        assert!((value(&found, name, None) - want).abs() < 1e-6, "{name}");
    }
    for (own, run) in own.iter().zip(["first", "second"]) {
        for (name, want) in own {
            assert!((value(&found, name, Some(run)) - want).abs() < 1e-6, "{name} of {run}");
        }
    }
}

#[test]
fn standard_errors_agree_with_the_scatter_of_repeats() {
    let text = "model lag { input u; state x; param T = 0.5 in [0.01, 10], K = 2, tau = 0.1 in [0, 1];
        der(x) = (K*delay(u, tau) - x)/T; output y = x; }";
    let model = Model::from_text("lag.fdm", text).unwrap();
    let truth = [("T", 0.6), ("K", 1.7), ("tau", 0.153)];
    let clean = recorded_with(1, "lag", &model, &truth, (200, 0.1), 0.7);
    let size = (clean.measured.iter().map(|y| y * y).sum::<f64>() / 200.0).sqrt();
    let mut noise = Normal(20_261_121);
    let (repeats, options) = (200, FitOptions { per_interval: Some(1), ..FitOptions::default() });
    let (mut estimates, mut errors) = (vec![Vec::new(); 3], vec![0.0; 3]);
    for _ in 0..repeats {
        let mut run = clean.clone();
        run.measured.iter_mut().for_each(|y| *y += 0.05 * size * noise.next());
        let found = fit(&model, &[run], &options, &Work::default()).unwrap();
        for (k, (name, _)) in truth.iter().enumerate() {
            let parameter = found.estimate.parameter(name, None).unwrap();
            estimates[k].push(parameter.value);
            errors[k] += parameter.standard_error.unwrap() / repeats as f64;
        }
    }
    for (k, (name, want)) in truth.iter().enumerate() {
        let mean = estimates[k].iter().sum::<f64>() / repeats as f64;
        let scatter = (estimates[k].iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (repeats - 1) as f64).sqrt();
        assert!((mean - want).abs() < 4.0 * scatter / (repeats as f64).sqrt(), "{name}: mean {mean} instead of {want}");
        // the scatter of 200 repeats is itself known to five percent
        assert!((scatter / errors[k] - 1.0).abs() < 0.15, "{name}: scatter {scatter}, standard error {}", errors[k]);
    }
}

#[test]
fn what_the_user_changes_is_done() {
    let text = "model decay { state x = 2; param k = 1 fixed, a = 1; der(x) = -k*x; output y = a*x; }";
    let model = Model::from_text("decay.fdm", text).unwrap();
    let run = recorded("decay", &model, &[("k", 0.4), ("a", 1.5)], 50, 0.1, 0.0);
    let changes = Changes { set: vec![("k".into(), 0.8)], free: vec!["k".into()], ..Changes::default() };
    let found =
        fit(&model, std::slice::from_ref(&run), &FitOptions { changes, ..FitOptions::default() }, &Work::default())
            .unwrap();
    check(&found, &[("k", 0.4), ("a", 1.5)], 1e-6);
    let changes = Changes { set: vec![("a".into(), 1.5)], fix: vec!["a".into()], ..Changes::default() };
    let held =
        fit(&model, std::slice::from_ref(&run), &FitOptions { changes, ..FitOptions::default() }, &Work::default())
            .unwrap();
    assert_eq!((value(&held, "k", None), value(&held, "a", None)), (1.0, 1.5));
    let unknown = Changes { set: vec![("kk".into(), 1.0)], ..Changes::default() };
    assert!(fit(&model, &[run], &FitOptions { changes: unknown, ..FitOptions::default() }, &Work::default()).is_err());
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let model = Model::from_text("delays.fdm", DELAYS).unwrap();
    let runs: Vec<Run> =
        (0..5).map(|k| recorded(&format!("run {k}"), &model, &TRUTH, 200, 0.04, f64::from(k))).collect();
    let options = FitOptions { options: Options { iterations: 4, ..Options::default() }, ..FitOptions::default() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| fit(&model, &runs, &options, &Work::default()).unwrap().estimate)
    };
    assert_eq!(with(1), with(3));
}
