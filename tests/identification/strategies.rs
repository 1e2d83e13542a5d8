//! Starts that the plain correction cannot use, and the strategies that can.

use fdm::Model;
use fdm::estimate::{
    Changes, Continuation, Fit, FitOptions, Options, RecoveryStrategy, Shooting, Termination, Work, by_confidence, fit,
};
use fdm::record::Run;
use fdm::simulate::Simulator;
use support::Normal;

fn blank(model: &Model, name: &str, time: Vec<f64>) -> Run {
    let (n, m, q) = (time.len(), model.layout().inputs, model.layout().outputs);
    Run {
        name: name.into(),
        time,
        inputs: vec![0.0; n * m],
        held: vec![false; m],
        measured: vec![0.0; n * q],
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    }
}

/// The run as the model answers it with these parameters.
fn answered(model: &Model, run: Run, truth: &[(&str, f64)]) -> Run {
    let mut theta = model.definition().start();
    for (name, value) in truth {
        theta[model.definition().param(name).unwrap()] = *value;
    }
    let mut measured = vec![0.0; run.measured.len()];
    Simulator::new(model.dynamics(), &run, 8).unwrap().simulate(&theta, &mut measured).unwrap();
    Run { measured, ..run }
}

fn at(set: &[(&str, f64)]) -> Changes {
    Changes { set: set.iter().map(|(n, v)| (n.to_string(), *v)).collect(), ..Changes::default() }
}

fn value(fit: &Fit, name: &str, run: Option<&str>) -> f64 {
    fit.estimate.parameter(name, run).unwrap().value
}

/// A pendulum that stands on its pivot and is held there by a controller, whose torque is recorded.
const PENDULUM: &str = r#"model inverted "pendulum on its pivot" {
    input torque; state th = free; state w = free;
    param k = 4, c = 0.3, b = 1;
    der(th) = w;
    der(w) = k*sin(th) - c*w + b*torque;
    output th_m = th; output w_m = w;
}"#;

/// Balanced for `n` samples; measured with noise of this deviation.
fn balanced(model: &Model, name: &str, n: usize, noise: f64, seed: u64) -> Run {
    const DT: f64 = 0.05;
    let mut run = blank(model, name, (0..n).map(|k| DT * k as f64).collect());
    run.held = vec![true];
    let mut normal = Normal(seed);
    let rate = |x: [f64; 2], u: f64| [x[1], 5.0 * x[0].sin() - 0.4 * x[1] + 1.3 * u];
    let moved = |x: [f64; 2], k: [f64; 2], h: f64| [x[0] + h * k[0], x[1] + h * k[1]];
    let mut x = [0.1, -0.2];
    for sample in 0..n {
        let t = DT * sample as f64;
        let wanted = 0.3 * (0.7 * t).sin() + 0.2 * (1.9 * t).sin();
        let u = -9.0 * (x[0] - wanted) - 4.0 * x[1];
        run.inputs[sample] = u;
        run.measured[2 * sample] = x[0] + noise * normal.next();
        run.measured[2 * sample + 1] = x[1] + noise * normal.next();
        let h = DT / 16.0;
        for _ in 0..16 {
            let k1 = rate(x, u);
            let k2 = rate(moved(x, k1, h / 2.0), u);
            let k3 = rate(moved(x, k2, h / 2.0), u);
            let k4 = rate(moved(x, k3, h), u);
            for j in 0..2 {
                x[j] += h / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]);
            }
        }
    }
    run
}

/// The same about upright, with a delay that is estimated, so that it cannot be cut into segments.
const UPRIGHT: &str = r#"model upright "pendulum about upright" {
    input torque; state th = free; state w = free;
    param k = 4, c = 0.3, b = 1, tau = 0.01 in [0, 0.1];
    der(th) = w;
    der(w) = k*th - c*w + b*delay(torque, tau);
    output th_m = th; output w_m = w;
}"#;

#[test]
fn a_plant_that_is_held_in_place_is_told_to_be_unstable_with_the_method_that_works() {
    let model = Model::from_text("upright.fdm", UPRIGHT).unwrap();
    let run = [balanced(&model, "balanced", 300, 0.002, 3)];
    let fit = fitted(&model, &run, &[], FitOptions::default());
    let Termination::Unstable { growth, state, .. } = &fit.estimate.termination else {
        panic!("{}", fit.estimate.termination)
    };
    // the root of s^2 + 0.4 s = 5 over 14.95 s
    let want = 14.95 * (0.2f64.hypot(5f64.sqrt()) - 0.2);
    assert!((growth / want - 1.0).abs() < 0.25 && state == "w", "{growth} for {want}, {state}");
    assert!(!fit.is_good() && fit.estimate.termination.to_string().contains("--method filter-error"));
}

#[test]
fn an_unstable_start_of_a_stable_plant_is_led_to_it() {
    let text =
        "model two { input u; state x = 0, v = 0; param theta = 1 in [-20, 20]; der(x) = v; der(v) = theta*v + u;
        output y = x; }";
    let model = Model::from_text("two.fdm", text).unwrap();
    let mut run = blank(&model, "saw", (0..600).map(|k| 0.1 * f64::from(k)).collect());
    run.inputs = (0..600).map(|k| f64::from(k % 63) / 31.5 - 1.0).collect();
    let mut run = answered(&model, run, &[("theta", -1.6)]);
    let mut normal = Normal(5);
    run.measured.iter_mut().for_each(|z| *z += 0.02 * normal.next());
    let fit = fitted(&model, &[run], &[], FitOptions::default());
    check(&fit, &[("theta", -1.6)], 0.02);
}

/// The fit from these start values.
fn fitted(model: &Model, runs: &[Run], start: &[(&str, f64)], options: FitOptions) -> Fit {
    fit(model, runs, &FitOptions { changes: at(start), ..options }, &Work::default()).unwrap()
}

fn never() -> FitOptions {
    FitOptions { continuation: Continuation::Never, ..FitOptions::default() }
}

fn check(fit: &Fit, truth: &[(&str, f64)], relative: f64) {
    assert!(fit.estimate.termination.is_good(), "{}", fit.estimate.termination);
    for (name, want) in truth {
        let got = value(fit, name, None);
        assert!((got / want - 1.0).abs() < relative, "{name}: {got} instead of {want}");
    }
}

#[test]
fn an_unstable_model_is_found_by_multiple_shooting_where_the_plain_correction_fails() {
    let model = Model::from_text("inverted.fdm", PENDULUM).unwrap();
    let start = [("k", 2.0), ("c", 0.0), ("b", 0.5)];
    // over 8 s an error grows by e^16, over 20 s by e^40: no initial state holds the uncut model on its record then
    for (n, polished) in [(160, true), (400, false)] {
        let run = [balanced(&model, "balanced", n, 0.01, 7)];
        if polished {
            let options = Options { iterations: 30, ..Options::default() };
            let plain = fitted(&model, &run, &start, FitOptions { options, ..never() });
            assert!(!plain.estimate.termination.is_good(), "{}", plain.estimate.termination);
        }
        let shooting = Some(Shooting::Length(1.0));
        let shot = fitted(&model, &run, &start, FitOptions { shooting, ..never() });
        assert!(shot.estimate.is_good(), "{}", shot.estimate.termination);
        let cut = shot.shooting.as_ref().unwrap();
        assert_eq!(cut.polished, polished);
        assert!(cut.largest_gap <= 1e-9, "{cut:?}");
        for (name, want) in [("k", 5.0), ("c", 0.4), ("b", 1.3)] {
            let p = shot.estimate.parameter(name, None).unwrap();
            let error = p.standard_error.unwrap();
            assert!((p.value - want).abs() < 3.0 * error && error < 0.05 * want, "{name} {} +- {error}", p.value);
        }
        assert_eq!(shot.estimate.parameters.len(), 5, "what belongs to the cuts is not shown");
        for output in &shot.estimate.outputs {
            assert!((output.rms.unwrap() / 0.01 - 1.0).abs() < 0.15, "{output:?}");
        }
    }
}

const ELOVICH: &str =
    "model elovich { state q; param a = 5, alpha = 0.02; der(q) = a*exp(-alpha*q); output volume = q; }";
const TAKEN_UP: [(&str, f64); 2] = [("a", 7.79), ("alpha", 0.0146)];

fn taken_up(model: &Model, name: &str, until: usize) -> Run {
    answered(model, blank(model, name, (0..=until).map(|k| 5.0 * k as f64).collect()), &TAKEN_UP)
}

#[test]
fn a_start_that_diverges_is_rescued_and_that_is_said() {
    let model = Model::from_text("elovich.fdm", ELOVICH).unwrap();
    let run = [taken_up(&model, "run", 24)];
    // the rate grows with what is taken up: no simulation reaches the end
    let start = [("a", 5.0), ("alpha", -0.03)];
    let plain = fitted(&model, &run, &start, never());
    assert!(plain.estimate.runs.is_empty(), "{}", plain.estimate.termination);
    assert!(plain.fallback.is_none());
    let auto = fitted(&model, &run, &start, FitOptions::default());
    check(&auto, &TAKEN_UP, 1e-6);
    let fallback = auto.fallback.unwrap();
    assert_eq!(fallback.by, Some(RecoveryStrategy::Continuation));
    let said = fallback.to_string();
    assert!(said.contains("already at the start values") && said.contains("short record first"), "{said}");
    assert!(auto.by_length.len() > 2, "estimates by length are kept");
    let times = Continuation::Times(vec![5.0, 10.0, 20.0, 40.0, 80.0]);
    check(&fitted(&model, &run, &start, FitOptions { continuation: times, ..never() }), &TAKEN_UP, 1e-6);
    let substitute = vec!["q".to_string()];
    let measured = fitted(&model, &run, &start, FitOptions { substitute, ..never() });
    check(&measured, &TAKEN_UP, 1e-6);
    assert_eq!(measured.substituted, ["q"]);
    let shooting = Some(Shooting::Segments(12));
    let shot = fitted(&model, &run, &[("alpha", 0.0)], FitOptions { shooting, ..never() });
    check(&shot, &TAKEN_UP, 1e-6);
    assert!(shot.shooting.unwrap().polished);
    // not even from the first sample to the second
    let auto = fitted(&model, &run, &[("alpha", -0.05)], FitOptions::default());
    check(&auto, &TAKEN_UP, 1e-6);
    assert_eq!(auto.fallback.unwrap().by, Some(RecoveryStrategy::Substitution { states: vec!["q".into()] }));
}

#[test]
fn a_ship_from_a_start_that_leads_the_plain_correction_astray() {
    let model = support::shipped("goodman_ship/model.fdm");
    let mut run = blank(&model, "turn", (0..=60).map(f64::from).collect());
    run.inputs = run.time.iter().map(|t| (2.32 * t).min(35.0).to_radians()).collect();
    let run = [answered(&model, run, &[])];
    let params = &model.definition().params;
    let truth: Vec<(&str, f64)> = params.iter().map(|p| (p.quantity.name.as_str(), p.value)).collect();
    // C5 and C9 doubled, the others halved
    let factor = |k: usize| if k == 4 || k == 8 { 2.0 } else { 0.5 };
    let start: Vec<(&str, f64)> = truth.iter().enumerate().map(|(k, (n, v))| (*n, v * factor(k))).collect();
    let with = |options: FitOptions| fitted(&model, &run, &start, FitOptions { per_interval: Some(8), ..options });
    let plain = with(never());
    assert!((value(&plain, "C9", None) / -3.97e-3 - 1.0).abs() > 0.1, "the plain correction finds it");
    let auto = with(FitOptions::default());
    check(&auto, &truth, 1e-6);
    assert_eq!(auto.fallback.unwrap().by, Some(RecoveryStrategy::Continuation));
    let continuation = "8".parse().unwrap();
    check(&with(FitOptions { continuation, ..never() }), &truth, 1e-6);
    check(&with(FitOptions { substitute: vec!["all".into()], ..never() }), &truth, 1e-6);
}

const SPRING: &str = r#"model spring "mass on a spring" {
    input force; state x = free, v = v0;
    param k = 2, c = 0.2, v0 = 0 per run, bias = 0 per run; param double = 2*k;
    der(x) = v; der(v) = force - k*x - c*v*abs(v);
    output x_m = x + bias; output v_m = v; }"#;

/// Two runs of different length with initial states and biases of their own.
fn springs(model: &Model) -> [Run; 2] {
    let own = [[("x(0)", 0.7), ("v0", -0.4), ("bias", 0.02)], [("x(0)", -1.1), ("v0", 0.9), ("bias", -0.3)]];
    let make = |k: usize, n: usize| {
        let mut run = blank(model, ["first", "second"][k], (0..n).map(|i| 0.05 * i as f64).collect());
        run.inputs = run.time.iter().map(|t| (1.3 * t + k as f64).sin()).collect();
        answered(model, run, &[&[("k", 3.3), ("c", 0.45)][..], &own[k]].concat())
    };
    [make(0, 300), make(1, 130)]
}

#[test]
fn runs_of_different_length_with_values_of_their_own_take_every_way() {
    let model = Model::from_text("spring.fdm", SPRING).unwrap();
    let runs = springs(&model);
    let ways = [
        FitOptions { continuation: "5".parse().unwrap(), ..never() },
        FitOptions { continuation: Continuation::Times(vec![2.0, 5.0, 10.0]), ..never() },
        FitOptions { shooting: Some(Shooting::Length(1.5)), ..never() },
        FitOptions { substitute: vec!["v".into()], ..never() },
    ];
    for way in ways {
        let said = format!("{way:?}");
        let found = fitted(&model, &runs, &[], FitOptions { per_interval: Some(8), ..way });
        assert!(found.estimate.is_good(), "{said}: {}", found.estimate.termination);
        check(&found, &[("k", 3.3), ("c", 0.45)], 1e-6);
        for (run, x0, v0, bias) in [("first", 0.7, -0.4, 0.02), ("second", -1.1, 0.9, -0.3)] {
            for (name, want) in [("x(0)", x0), ("v0", v0), ("bias", bias)] {
                let got = value(&found, name, Some(run));
                assert!((got - want).abs() < 1e-6, "{said}: {name} of {run}: {got} instead of {want}");
            }
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit_on_any_way() {
    let model = Model::from_text("elovich.fdm", ELOVICH).unwrap();
    let runs = [taken_up(&model, "long", 24), taken_up(&model, "short", 11), taken_up(&model, "third", 17)];
    let options =
        FitOptions { changes: at(&[("alpha", -0.05)]), confidence: true, reweight: true, ..FitOptions::default() };
    let with = |threads: usize, shooting| {
        let options = FitOptions { shooting, ..options.clone() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let fit = pool.install(|| fit(&model, &runs, &options, &Work::default()).unwrap());
        format!("{:?} {:?} {:?} {:?}", fit.estimate, fit.by_length, fit.fallback, fit.shooting)
    };
    for shooting in [None, Some(Shooting::Segments(4))] {
        assert_eq!(with(1, shooting), with(3, shooting));
    }
}

#[test]
fn weights_and_lengths_tell_which_parameters_to_trust() {
    let text = "model two { input u; state x, z; param a = 1, b = 1;
        der(x) = a*(u - x); der(z) = b*(u - z); output x_m = x; output z_m = z; output sum = x + z; }";
    let model = Model::from_text("two.fdm", text).unwrap();
    let mut run = blank(&model, "run", (0..200).map(|k| 0.05 * f64::from(k)).collect());
    run.inputs = run.time.iter().map(|t| if *t > 1.0 { 1.0 } else { 0.0 }).collect();
    let mut run = answered(&model, run, &[("a", 0.8), ("b", 1.5)]);
    let mut normal = Normal(3);
    run.measured.iter_mut().for_each(|y| *y += 0.01 * normal.next());
    // what z_m reads grows too large with time, which the model knows nothing of
    let time = run.time.clone();
    run.measured.chunks_mut(3).zip(time).for_each(|(row, t)| row[1] += 0.02 * t);
    let found = fitted(&model, &[run], &[], FitOptions { confidence: true, reweight: true, ..never() });
    let weights = found.reweighting.as_ref().unwrap();
    assert_eq!(weights.variations.len(), 9);
    let largest = |name: &str| weights.largest(weights.parameters.iter().position(|p| p.name == name).unwrap());
    assert!(largest("b") > 2.0 && largest("b") > 1.5 * largest("a"), "a {} b {}", largest("a"), largest("b"));
    let order = by_confidence(&found.by_length);
    assert_eq!(order.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
    let shown = fdm::report::confidence(&fdm::FitDocument::of(&found));
    assert!(shown.contains("by confidence") && shown.contains("without z_m"), "{shown}");
}

#[test]
fn strategies_that_cannot_be_followed_are_refused_with_the_reason() {
    let model = Model::from_text("elovich.fdm", ELOVICH).unwrap();
    let run = [taken_up(&model, "run", 24)];
    let refused = |model: &Model, run: &[Run], options: FitOptions| {
        fit(model, run, &options, &Work::default()).expect_err("impossible").to_string()
    };
    let said = refused(&model, &run, FitOptions { substitute: vec!["p".into()], ..never() });
    assert!(said.contains("no state `p`"), "{said}");
    let said = refused(&model, &run, FitOptions { shooting: Some(Shooting::Length(-1.0)), ..never() });
    assert!(said.contains("above 0"), "{said}");
    let text = "model lag { input u; state x; param T = 0.5, tau = 0.1 in [0, 1]; der(x) = (delay(u, tau) - x)/T; output y = 2*x^2; }";
    let late = Model::from_text("lag.fdm", text).unwrap();
    let record = [blank(&late, "run", (0..20).map(f64::from).collect())];
    let said = refused(&late, &record, FitOptions { shooting: Some(Shooting::Segments(3)), ..never() });
    assert!(said.contains("delays"), "{said}");
    let said = refused(&late, &record, FitOptions { substitute: vec!["x".into()], ..never() });
    assert!(said.contains("no output shows"), "{said}");
}

#[test]
fn what_no_way_can_better_ends_and_says_so() {
    // decay cannot follow growth, from whatever start and in whatever segments
    let model = Model::from_text(
        "decay.fdm",
        "model decay { state x = 1; param k = 1 in [0, 9]; der(x) = -k*x; output y = x; }",
    )
    .unwrap();
    let mut run = blank(&model, "grows", (0..40).map(|k| 0.1 * f64::from(k)).collect());
    run.measured = run.time.iter().map(|t| t.exp()).collect();
    let found = fitted(&model, &[run.clone()], &[], FitOptions::default());
    let fallback = found.fallback.unwrap();
    assert!(fallback.by.is_none() && fallback.to_string().contains("no better"), "{fallback}");
    let fixed = Changes { fix: vec!["k".into()], ..Changes::default() };
    let compared =
        fit(&model, &[run], &FitOptions { changes: fixed, ..FitOptions::default() }, &Work::default()).unwrap();
    assert!(compared.fallback.is_none() && compared.estimate.termination.is_good());
}

#[test]
fn slow_noise_is_no_reason_for_a_rescue() {
    let model = Model::from_text("spring.fdm", SPRING).unwrap();
    let clean = springs(&model)[0].clone();
    let size = |o: usize| (clean.measured.iter().skip(o).step_by(2).map(|y| y * y).sum::<f64>() / 300.0).sqrt();
    for seed in 0..6 {
        let (mut normal, mut run) = (Normal(seed), clean.clone());
        for o in 0..2 {
            let mut v = normal.next();
            for z in run.measured.iter_mut().skip(o).step_by(2) {
                *z += 0.7 * size(o) * v;
                v = 0.95 * v + (1.0f64 - 0.95 * 0.95).sqrt() * normal.next();
            }
        }
        let start = [("k", 3.0), ("c", 0.4)];
        let plain = fitted(&model, &[run.clone()], &start, never());
        let auto = fitted(&model, &[run], &start, FitOptions::default());
        assert!(plain.estimate.is_good(), "seed {seed}: {}", plain.estimate.termination);
        assert!(auto.fallback.is_none(), "seed {seed}: {}", auto.fallback.unwrap());
        assert_eq!(auto.estimate.cost, plain.estimate.cost);
        assert!(auto.estimate.parameters.iter().any(|p| p.corrected_error.is_some()), "seed {seed}");
    }
}

/// `fdm fit` of a shipped record with these options: whether it went well, its output and its errors.
fn typed(model: &str, data: &str, options: &[&str]) -> (bool, String, String) {
    let output = support::fdm()
        .current_dir(support::repository())
        .args(["fit", model, "--data", data, "--quiet"])
        .args(options)
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.success(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn the_command_line_takes_every_strategy_and_says_what_came_of_it() {
    let (model, data) = ("models/t33/model.fdm", "models/t33/noise_2_percent.csv");
    let (good, said, _) = typed(model, data, &["--confidence", "--weights", "--continuation", "4"]);
    assert!(good && said.contains("by confidence") && said.contains("without r_m"), "{said}");
    let (good, said, _) = typed(model, data, &["--shooting", "5", "--substitute", "p,beta,r"]);
    assert!(good && said.contains("multiple shooting in 5 segments"), "{said}");
    assert!(said.contains("started from a fit with the measured p, beta, r in the equations"), "{said}");
    let (model, data) = ("models/elovich/model.fdm", "models/elovich/at_100_degC.csv");
    let (good, said, _) = typed(model, data, &["--set", "alpha=-0.03"]);
    assert!(good && said.contains("failed (run `at_100_degC` diverges"), "{said}");
    let (good, said, _) = typed(model, data, &["--set", "alpha=-0.03", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    assert!(good && json["fallback"]["by"] == "continuation" && json["by_length"].as_array().unwrap().len() > 2);
    let (good, _, errors) = typed(model, data, &["--continuation", "20,10"]);
    assert!(!good && errors.contains("rising times"), "{errors}");
    let (good, _, errors) = typed(model, data, &["--substitute", "p"]);
    assert!(!good && errors.contains("no state `p`"), "{errors}");
}
