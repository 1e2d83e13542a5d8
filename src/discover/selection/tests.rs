//! Whether effects that are hidden in simulated runs are found, and nothing where there is none.
#![allow(clippy::unwrap_used)]

use super::*;
use crate::diagnosis::{Diagnosis, Verdict};
use fdm_effects::Catalogue;
use fdm_estimate::{Halt, Stop, Work};
use fdm_grammar::Source;
use fdm_numeric::random::Stream;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A ship's roll that is let go; the truth has the eddies of the bilge keels.
const ROLL: &str = "model roll { state phi = free; state p = 0; param w2 = 5 in [0, 100], d = 0.1; \
                    der(phi) = p; der(p) = -w2*phi - d*p DRAG; output roll = phi; }";
/// A motor with a delay before it.
const MOTOR: &str =
    "model motor { input u; state v = 0; param a = 1, b = 2; der(v) = b*INPUT - a*v; output speed = v; }";
/// Four effects, so that tests are quick.
const SOME: &str = "
effect quadratic_damping(x: state) unless known(der(x)) \"drag\" { param drag = 0; add der(x) += -drag*x*abs(x); }
effect cubic_stiffness(x: state, z: state) unless known(der(x)) \"cube\" { param k = 0; add der(x) += -k*z^3; }
effect input_delay(i: input) \"delay\" { param tau = 0 in [-duration/20, duration/4] try -2*step, -step/2, step/2, 2*step, 5*step, 12*step; replace i with delay(i, tau); }
effect output_scale(y: output) \"scale\" { param k = 0; replace y with(1 + k)*y; }
effect constant_force(x: state) unless known(der(x)) \"force\" { param force = 0; add der(x) += force; }
";

/// Without tables, as they have tests of their own.
fn options() -> DiagnosisOptions {
    DiagnosisOptions { tables: false, ..DiagnosisOptions::default() }
}

fn catalogue() -> Catalogue {
    let (catalogue, findings) = Catalogue::read(&Source::new("some.fdm", SOME));
    assert!(findings.is_empty(), "{findings:?}");
    catalogue
}

/// A run of a model with white noise; values of parameters by name.
fn run(text: &str, name: &str, input: impl Fn(f64) -> f64, values: &[(&str, f64)], noise: f64) -> Run {
    let model = Model::from_text("truth.fdm", text).unwrap();
    let (n, dt, m) = (300, 0.05, model.layout().inputs);
    let time: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
    let inputs = if m > 0 { time.iter().map(|t| input(*t)).collect() } else { Vec::new() };
    let mut run = Run {
        name: name.into(),
        inputs,
        held: vec![false; m],
        measured: vec![0.0; n],
        time,
        input_gaps: vec![0; m],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let mut theta = model.definition().start();
    for (name, value) in values {
        theta[model.definition().param(name).unwrap()] = *value;
    }
    let mut y = vec![0.0; n];
    Simulator::new(model.dynamics(), &run, 4).unwrap().simulate(&theta, &mut y).unwrap();
    let mut random = Stream::seeded(name.bytes().map(u64::from).sum());
    let mut normal = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
    run.measured = y.iter().map(|y| y + noise * normal()).collect();
    run
}

fn roll(drag: f64, begin: f64, name: &str) -> Run {
    let text = ROLL.replace("DRAG", &format!("- {drag}*p*abs(p)"));
    run(&text, name, |_| 0.0, &[("phi(0)", begin)], 0.004)
}

fn diagnosed(text: &str, runs: &[Run], held: &[Run]) -> Diagnosis {
    let model = Model::from_text("model.fdm", text).unwrap();
    diagnose(&model, runs, held, &catalogue(), &options(), &Work::default()).unwrap()
}

#[test]
fn hidden_drag_is_found_written_and_gains_on_a_held_out_run() {
    let runs = [roll(0.4, 0.5, "a"), roll(0.4, 0.3, "b")];
    let found = diagnosed(&ROLL.replace("DRAG", ""), &runs, &[roll(0.4, 0.4, "c")]);
    assert_eq!(found.verdict, Verdict::EffectFound, "{found:#?}");
    let cause = &found.causes[0];
    assert_eq!(cause.place.to_string(), "quadratic_damping(p)");
    assert!((cause.parameters[0].value - 0.4).abs() < 0.05, "{cause:?}");
    assert!(cause.gain_validation.is_some_and(|g| g > 10.0) && found.causes.len() == 1, "{found:#?}");
    let text = found.extended.as_ref().unwrap();
    assert!(text.contains("param drag_p = 0.") && text.contains("drag_p*p*abs(p)"), "{text}");
    let damping = found.biased.iter().find(|b| b.name == "d").unwrap();
    assert!(damping.moved.is_some_and(|m| m < -3.0) && (damping.after - 0.1).abs() < 0.05, "{damping:?}");
}

#[test]
fn nothing_is_found_where_nothing_is_hidden() {
    let found = diagnosed(&ROLL.replace("DRAG", ""), &[roll(0.0, 0.5, "a"), roll(0.0, 0.3, "b")], &[]);
    assert_eq!(found.verdict, Verdict::NoEffectFound, "{found:#?}");
    assert!(found.causes.is_empty() && found.extended.is_none() && found.family_wise_p > 0.01);
    let drag = found.detectable.iter().find(|d| d.place.effect == "quadratic_damping").unwrap();
    assert!(drag.smallest.is_some_and(|v| v > 0.002 && v < 0.2), "{drag:?}");
}

#[test]
fn a_hidden_delay_is_found_and_threads_change_nothing() {
    let late = MOTOR.replace("INPUT", "delay(u, 0.17)");
    let steps = |t: f64| if (t / 1.3).floor() % 2.0 < 1.0 { 1.0 } else { -0.6 } * if t > 0.5 { 1.0 } else { 0.0 };
    let runs = [run(&late, "a", steps, &[], 0.02)];
    let text = MOTOR.replace("INPUT", "u");
    let found = diagnosed(&text, &runs, &[]);
    assert_eq!(found.causes[0].place.to_string(), "input_delay(u)", "{found:#?}");
    assert!((found.causes[0].parameters[0].value - 0.17).abs() < 0.02, "{:?}", found.causes);
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(one.install(|| diagnosed(&text, &runs, &[])), found);
}

/// What the input moves is then ahead of the record by less than any value that is tried.
#[test]
fn an_input_that_is_recorded_a_fraction_of_a_sample_late_is_found() {
    let waves = |t: f64| 0.8 * (0.7 * t).sin() + 0.6 * (2.9 * t + 1.0).sin();
    let text = MOTOR.replace("INPUT", "u");
    let late = |name: &str, shift: f64| {
        let mut run = run(&text, name, |t| waves(t + shift), &[], 0.001);
        run.inputs = run.time.iter().map(|t| waves(t + shift - 0.01)).collect();
        run
    };
    let found = diagnosed(&text, &[late("a", 0.0), late("b", 3.0)], &[late("c", 8.0)]);
    assert_eq!(found.causes.first().map(|c| c.place.to_string()).as_deref(), Some("input_delay(u)"), "{found:#?}");
    assert!((found.causes[0].parameters[0].value + 0.01).abs() < 0.003, "{:?}", found.causes);
}

/// The second effect is small beside the first, and each would be taken for something else alone.
#[test]
fn two_hidden_effects_are_both_found_and_nothing_else() {
    let text = MOTOR.replace("b*INPUT - a*v", "b*delay(u, 0.17) - a*v - 0.5*v*abs(v)");
    let steps = |t: f64| if (t / 1.3).floor() % 2.0 < 1.0 { 1.0 } else { -0.6 } * if t > 0.5 { 1.0 } else { 0.0 };
    let waves = |t: f64| 0.8 * (0.7 * t).sin() + 0.6 * (2.9 * t + 1.0).sin();
    let runs = [run(&text, "a", steps, &[], 0.01), run(&text, "b", waves, &[], 0.01)];
    let found = diagnosed(&MOTOR.replace("INPUT", "u"), &runs, &[run(&text, "c", |t| steps(1.5 * t), &[], 0.01)]);
    let mut named: Vec<String> = found.causes.iter().map(|c| c.place.to_string()).collect();
    named.sort();
    assert_eq!(named, ["input_delay(u)", "quadratic_damping(v)"], "{found:#?}");
    let value = |k: usize| found.causes.iter().find(|c| c.place.to_string() == named[k]).unwrap().parameters[0].value;
    assert!((value(0) - 0.17).abs() < 0.02 && (value(1) - 0.5).abs() < 0.1, "{:?}", found.causes);
}

#[test]
fn what_cannot_be_judged_is_said() {
    let model = Model::from_text("model.fdm", ROLL.replace("DRAG", "")).unwrap();
    let runs = [roll(0.1, 0.5, "a")];
    let asked = |runs: &[Run], held: &[Run]| {
        diagnose(&model, runs, held, &catalogue(), &options(), &Work::default()).unwrap_err().to_string()
    };
    let mut twin = runs[0].clone();
    twin.name = "twin".into();
    assert!(asked(&runs, &[twin]).contains("has the samples of the training run `a`"));
    assert!(asked(&[runs[0].part(0..7)], &[]).contains("7 samples"));
}

#[test]
fn a_mode_that_repeats_a_free_motion_is_no_mode() {
    const MODE: &str = "effect mode(y: output) \"a mode\" { param c = 0; nuisance omega in [1.5, 3] try 1.8, 2.1, 2.5; \
                        nuisance zeta in [0.01, 0.5] try 0.05; state m, v; der(m) = v; \
                        der(v) = omega^2*(y - m) - 2*zeta*omega*v; add y += c*v/omega; }";
    let (catalogue, findings) = Catalogue::read(&Source::new("mode.fdm", MODE));
    assert!(findings.is_empty(), "{findings:?}");
    let model = Model::from_text("model.fdm", ROLL.replace("DRAG", "")).unwrap();
    let runs = [roll(0.8, 0.7, "a"), roll(0.8, 0.4, "b")];
    let found = diagnose(&model, &runs, &[], &catalogue, &options(), &Work::default()).unwrap();
    assert!(found.causes.is_empty(), "{:?}", found.causes);
    assert!(found.rejected.iter().any(|r| r.reason.contains("own motion once more")), "{:?}", found.rejected);
}

/// In a free decay the amplitude falls as time goes on, and a lag only shifts the phase: both imitate damping and stiffness that change
/// with the amplitude. Mechanisms are recommended.
#[test]
fn stand_ins_and_lags_do_not_take_the_place_of_mechanisms() {
    const LIKE: &str = "
effect changing(p: param) as stand_in \"changes\" { param k = 0; const T = duration; let varying = p*(1 + k*(t/T - 0.5)); replace p with varying; }
effect lag(y: output) as sensor \"lag\" { param T = 0 in [step/4, duration/4] try step, 3*step, 9*step, 30*step; state lagged = start(y); der(lagged) = (y - lagged)/T; replace y with lagged; }
";
    let (catalogue, findings) = Catalogue::read(&Source::new("like.fdm", format!("{SOME}{LIKE}").as_str()));
    assert!(findings.is_empty(), "{findings:?}");
    let begins = |text: &str| text.replace("state p = 0", "state p = free");
    let truth = begins(&ROLL.replace("DRAG", "- 0.4*p*abs(p) - 3*phi^3"));
    let of = |name: &str, phi: f64| run(&truth, name, |_| 0.0, &[("phi(0)", phi), ("p(0)", 0.1)], 0.002);
    let model = Model::from_text("model.fdm", begins(&ROLL.replace("DRAG", ""))).unwrap();
    let options = options();
    let found = diagnose(&model, &[of("a", 0.6)], &[], &catalogue, &options, &Work::default()).unwrap();
    let mut named: Vec<String> = found.causes.iter().map(|c| c.place.to_string()).collect();
    named.sort();
    assert_eq!(named, ["cubic_stiffness(p, phi)", "quadratic_damping(p)"], "{found:#?}");
    // a table by size, whatever search a model comes from
    assert!(found.front.windows(2).all(|two| two[0].parameters <= two[1].parameters), "{:?}", found.front);
    assert_eq!(found.front.iter().filter(|m| m.recommended).count(), 1);
}

/// A user simulates the text: that is what is told of it.
#[test]
fn what_is_told_is_what_the_written_text_does() {
    let push = |t: f64| if t % 4.0 < 2.0 { 1.0 } else { -1.0 };
    let truth = MOTOR.replace("INPUT", "delay(u, 0.23)");
    let runs = [run(&truth, "a", push, &[("a", 1.3)], 0.01), run(&truth, "b", |t| push(t + 0.7), &[("a", 1.3)], 0.01)];
    let found = diagnosed(&MOTOR.replace("INPUT", "u"), &runs[..1], &runs[1..]);
    let text = found.extended.clone().unwrap();
    assert!(text.contains("delay(u, ") && !text.contains("param a = 1,"), "{text}");
    let written = Model::from_text("written.fdm", text).unwrap();
    let theta = written.definition().start();
    for (run, (overlay, told)) in runs.iter().zip(found.overlays.iter().zip(&found.outputs)) {
        let mut y = vec![0.0; run.len()];
        Simulator::new(written.dynamics(), run, 4).unwrap().simulate(&theta, &mut y).unwrap();
        let apart = y.iter().zip(&overlay.after).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // by other steps
        assert!(apart < 1e-5, "{apart}");
        let square = run.measured.iter().zip(&y).map(|(z, y)| (z - y) * (z - y)).sum::<f64>();
        let rms = (square / run.len() as f64).sqrt();
        assert!((told.rms_after.unwrap() / rms - 1.0).abs() < 1e-4, "{told:?} {rms}");
        assert!(rms < told.rms_before.unwrap());
    }
}

/// What would be a friction below zero is something else: one-sided bounds are searched on one side, and what is positive is refused
/// in words.
#[test]
fn friction_has_one_sign() {
    let model = Model::from_text("model.fdm", ROLL.replace("DRAG", "")).unwrap();
    let found = |attribute: &str, drag: f64| {
        let signed = SOME.replace("param drag = 0;", &format!("param drag = 0 {attribute};"));
        let (catalogue, findings) = Catalogue::read(&Source::new("signed.fdm", signed.as_str()));
        assert!(findings.is_empty(), "{findings:?}");
        let runs = [roll(drag, 0.5, "a"), roll(drag, 0.3, "b")];
        diagnose(&model, &runs, &[], &catalogue, &options(), &Work::default()).unwrap()
    };
    let named = |found: &Diagnosis| found.causes.iter().any(|c| c.place.effect == "quadratic_damping");
    let screened = |found: &Diagnosis| {
        found.steps[0].ranking.iter().find(|s| s.place.effect == "quadratic_damping").map(|s| s.gain)
    };
    for attribute in ["in [0, inf]", "positive"] {
        let right = found(attribute, 0.4);
        assert!(named(&right) && screened(&right).is_some_and(|g| g > 10.0), "{right:#?}");
    }
    let bounded = found("in [0, inf]", -0.15);
    assert!(!named(&bounded) && screened(&bounded).is_none_or(|g| g < 1.0), "{bounded:#?}");
    let signed = found("positive", -0.15);
    let told = signed.rejected.iter().find(|r| r.place.effect == "quadratic_damping");
    assert!(!named(&signed) && told.is_some_and(|r| r.reason.contains("physics has none below 0")), "{signed:#?}");
}

/// Records that begin at the heel which a constant moment makes: nothing but the mean tells of it, ten times the noise in every run.
#[test]
fn a_steady_offset_is_named() {
    const HEELED: &str = "model heeled { input u; state phi = 0; state p = 0; param k = 2, d = 0.4, b = 1; \
                          der(phi) = p; der(p) = -k*phi - d*p + b*u; output roll = phi OFFSET; }";
    let push = |phase: f64| move |t: f64| ((t + phase) / 2.3).floor().rem_euclid(3.0) - 1.0;
    let runs = |offset: f64| -> Vec<Run> {
        let text = HEELED.replace("OFFSET", &format!("+ {offset}"));
        let of = |k: usize| run(&text, &format!("r{k}"), push(1.7 * k as f64), &[], 0.015);
        (0..3).map(of).collect()
    };
    let with = format!("{SOME}effect output_bias(y: output) as sensor \"zero\" {{ param bias = 0; add y += bias; }}");
    let (catalogue, findings) = Catalogue::read(&Source::new("with.fdm", with.as_str()));
    assert!(findings.is_empty(), "{findings:?}");
    let model = Model::from_text("model.fdm", HEELED.replace("OFFSET", "")).unwrap();
    let found = |offset: f64| diagnose(&model, &runs(offset), &[], &catalogue, &options(), &Work::default()).unwrap();
    let offset = found(0.15);
    assert_eq!(offset.causes.first().map(|c| c.place.to_string()).as_deref(), Some("output_bias(roll)"), "{offset:#?}");
    assert!((offset.causes[0].parameters[0].value - 0.15).abs() < 0.005 && offset.family_wise_p < 1e-6);
    // no plain residual of a tenth of that is hidden either
    assert_eq!(found(0.015).verdict, Verdict::EffectFound);
    assert_eq!(found(0.0).verdict, Verdict::NoEffectFound);
    // one record of white noise is enough for less than its noise, as none of its other bins is slow
    let alone = diagnose(&model, &runs(0.012)[..1], &[], &catalogue, &options(), &Work::default()).unwrap();
    assert_eq!(alone.causes.first().map(|c| c.place.to_string()).as_deref(), Some("output_bias(roll)"), "{alone:#?}");
    // the front tells what the written model does
    let models = &offset.front;
    assert!(models.len() == 2 && models[1].recommended && models[1].error_training < 0.2, "{models:?}");
}

/// A dead zone of an input of one sign takes a constant away: of equals the simplest is named.
#[test]
fn of_equal_effects_the_simplest_is_named() {
    const TEXT: &str =
        "model m { input u; state v = 0; param a = 1, b = 2; der(v) = b*u - a*v FORCE; output speed = v; }";
    let steps = |phase: f64| move |t: f64| ((t + phase) / 1.3).floor().rem_euclid(3.0) + 1.0;
    let truth = TEXT.replace("FORCE", "- 0.5");
    let runs = [run(&truth, "a", steps(0.0), &[], 0.02), run(&truth, "b", steps(1.9), &[], 0.02)];
    let zone = "effect input_dead_zone(i: input) \"zone\" { param width = 0 in [0, size(i)] try scale(i, 0.06), \
                scale(i, 0.18); replace i with deadzone(i, width); }";
    let (catalogue, findings) = Catalogue::read(&Source::new("zone.fdm", format!("{zone}{SOME}")));
    assert!(findings.is_empty(), "{findings:?}");
    let model = Model::from_text("model.fdm", TEXT.replace("FORCE", "")).unwrap();
    let found = diagnose(&model, &runs, &[], &catalogue, &options(), &Work::default()).unwrap();
    let group: Vec<String> = found.causes[0].group.iter().map(|member| member.place.to_string()).collect();
    assert_eq!(found.causes[0].place.to_string(), "constant_force(v)", "{group:?}");
    assert!(group.iter().any(|place| place == "input_dead_zone(u)"), "{group:?}");
}

/// One record in 1/f noise, off by seven times its noise: slow noise may be that as well, but "nothing is missing" would be wrong.
#[test]
fn an_error_beyond_its_noise_is_never_nothing() {
    const TEXT: &str = "model still { input u; state x = 0; param a = 1, b = 2; der(x) = b*u - a*x; output y = x; }";
    let steps = |t: f64| if (t / 1.3).floor() % 2.0 < 1.0 { 1.0 } else { -0.6 };
    let model = Model::from_text("model.fdm", TEXT).unwrap();
    let found = |offset: f64| {
        let mut run = run(TEXT, "r", steps, &[], 0.0);
        let (n, mut normal) = (run.len(), Stream::seeded(7));
        for k in 1..n {
            // cosines of the power 1/k, in the unit of the bins
            let size = 0.02 * normal.normal_of_pair() / (k as f64).sqrt();
            let wave = |i: usize| (std::f64::consts::PI * k as f64 * (i as f64 + 0.5) / n as f64).cos();
            run.measured.iter_mut().enumerate().for_each(|(i, y)| *y += size * wave(i));
        }
        run.measured.iter_mut().for_each(|y| *y += offset);
        diagnose(&model, &[run], &[], &catalogue(), &options(), &Work::default()).unwrap()
    };
    assert_eq!(found(0.0).verdict, Verdict::NoEffectFound);
    // nothing in this catalogue is a zero: a force alone would move the gain too
    let off = found(0.25);
    assert_ne!(off.verdict, Verdict::NoEffectFound, "{off:#?}");
    if off.verdict == Verdict::UnknownCause {
        let warnings = &off.attribution.as_ref().unwrap().warnings;
        assert!(warnings.iter().any(|w| w.contains("times the noise of the record")), "{warnings:?}");
    }
}

/// Wherever it is stopped, a search keeps what it has and says that it was stopped.
#[test]
fn a_search_that_is_stopped_says_so_and_keeps_what_it_has() {
    let runs = [roll(0.4, 0.5, "a"), roll(0.4, 0.3, "b")];
    let model = Model::from_text("model.fdm", ROLL.replace("DRAG", "")).unwrap();
    let (catalogue, options) = (catalogue(), options());
    let stopped_after = |most: usize| {
        let asked = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&asked);
        let halt = Halt::asking(move || (count.fetch_add(1, Ordering::Relaxed) >= most).then_some(Stop::Interrupt));
        let found = diagnose(&model, &runs, &[], &catalogue, &options, &Work::until(&halt));
        (found, asked.load(Ordering::Relaxed))
    };
    let (whole, asked) = stopped_after(usize::MAX);
    let whole = whole.unwrap();
    assert!(!whole.stopped && whole.verdict == Verdict::EffectFound);
    let (mut nothing, mut screened, mut accepted) = (0, 0, 0);
    for part in 0..16 {
        match stopped_after(asked * part / 16).0 {
            Err(DiagnosisError::Stopped) => nothing += 1,
            Err(other) => panic!("{other}"),
            Ok(found) => {
                assert!(found.stopped && found.ended == "it was stopped", "{part}: {}", found.ended);
                assert_eq!(found.family_wise_p < options.alpha, whole.family_wise_p < options.alpha);
                assert!(found.causes.is_empty() || found.causes[0].place == whole.causes[0].place);
                *(if found.causes.is_empty() { &mut screened } else { &mut accepted }) += 1;
            }
        }
    }
    assert!(nothing > 0 && screened > 0 && accepted > 0, "{nothing} {screened} {accepted}");
}
