//! Tests that hide an effect in the data and require finding it: families of systems, truths that the model file does not show,
//! and the tool as a process that sees the model and the records only. studies/README.md describes it.
//!
//! The whole set: `cargo test --release --manifest-path studies/Cargo.toml --test blind -- --ignored --nocapture`.
#![allow(clippy::print_stdout, reason = "studies print their figures")]

mod answer;
mod case;
mod chance;
mod cheapness;
mod experiment;
mod families;
mod hidden;
mod noise;
mod oracle;
mod plan;
mod plant;
mod scales;
mod scorer;
mod sizing;
mod study;
mod table;
mod twins;

use case::Case;
use families::{CHAIN, FAMILIES, Family};
use fdm::effect::Subject;
use noise::Colour;
use plan::{Hides, Plan, Spec};
use std::time::Duration;

#[test]
#[ignore = "the whole set lasts hours; FDM_BLIND_... choose a part of it"]
fn blind() {
    match std::env::var("FDM_BLIND_DO").unwrap_or_default().as_str() {
        "" => table::print(&study::study(&Plan::of_environment())),
        "table" => table::print(&study::results(&study::folder())),
        "cases" => cases(),
        "speed" => speed(),
        "screening" => cheapness::compare(&large()),
        other => panic!("FDM_BLIND_DO={other}: table, cases, speed, screening, or nothing for the whole set"),
    }
}

/// Makes the cases of a plan and prints their truths, without asking the tool.
fn cases() {
    let folder = study::folder();
    for spec in Plan::of_environment().specs() {
        let begun = std::time::Instant::now();
        let Ok(case) = std::panic::catch_unwind(|| Case::new(spec)) else {
            println!("{}: could not be made", spec.name());
            continue;
        };
        case.write(&folder.join(spec.name()));
        let t = &case.truth;
        let names: Vec<String> = t.places.iter().map(hidden::Place::to_string).collect();
        let rivals: Vec<String> = t.rivals.iter().take(4).map(|(p, lacking)| format!("{p} {lacking:.2}")).collect();
        println!(
            "{} [{}] {:?} gain {:.1}, held out {:.1}, parts {:.1?}, rivals {rivals:?}, {:.1} s",
            spec.name(),
            names.join(", "),
            t.numbers,
            t.gain,
            t.gain_validation,
            t.parts,
            begun.elapsed().as_secs_f64()
        );
    }
}

/// Three runs of 2,000 samples, eight states, about a hundred candidates.
fn large() -> Case {
    let spec = Spec { family: &CHAIN, hides: Hides::Effect, colour: Colour::White, level: 0.02, number: 0 };
    Case::hiding(spec, "quadratic_damping(v)", 150.0)
}

/// How long a diagnosis takes.
fn speed() {
    let case = large();
    let subject = Subject::new(case.base.source(), case.base.definition()).expect("a text that compiles");
    let count = hidden::INSIDE.places(&subject).candidates.len();
    println!("{count} candidates, {} states, 3 runs of {} samples", case.base.layout().states, CHAIN.samples);
    for _ in 0..3 {
        let outcome = study::run(&case, &study::folder(), Duration::from_secs(600));
        println!("{:.2} s: {} {:?} {:?}", outcome.seconds, outcome.verdict, outcome.named, outcome.failure);
    }
}

/// Strong effects in families that differ, and records with nothing in them: short records of small families.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation")]
fn a_quick_set_is_answered() {
    let folder = tempfile::tempdir().expect("a folder");
    // short records: without optimisation a whole case takes a minute
    let short =
        |name: &str| -> &'static Family { Box::leak(Box::new(Family { samples: 160, ..*Family::named(name) })) };
    let spec =
        |family: &str, hides, number| Spec { family: short(family), hides, colour: Colour::White, level: 0.02, number };
    let limit = Duration::from_secs(600);
    for family in ["thermal", "motor"] {
        let outcome = study::run(&Case::new(spec(family, Hides::Nothing, 0)), folder.path(), limit);
        // one of these two is below 0.001 in one of 500 tools that are right; the cases are always the same
        assert!(outcome.failure.is_none() && outcome.p > 0.001, "{outcome:?}");
    }
    for (family, hidden) in [
        ("aeroplane", "input_delay(de)"),
        ("motor", "coulomb_friction(omega)"),
        ("pendulum", "quadratic_damping(omega)"),
    ] {
        let case = Case::hiding(spec(family, Hides::Effect, 0), hidden, 200.0);
        let outcome = study::run(&case, folder.path(), limit);
        assert!(outcome.failure.is_none() && outcome.detected() && outcome.grouped, "{outcome:?}");
    }
}

/// 1/f noise, and effects that screening hardly promises: a delay below zero and below a sample, a play that the heat of reaction makes up for,
/// a drift in lines where noise is known from nothing else.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation")]
fn effects_that_promise_little_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    for (family, level, number, hidden) in [
        ("aeroplane", 0.02, 1, "input_delay(de)"),
        ("kinetics", 0.08, 2, "backlash(temp)"),
        ("kinetics", 0.02, 2, "output_bias_drift(b_m)"),
        ("ship", 0.02, 3, "output_bias_drift(v_m)"),
    ] {
        let family = Family::named(family);
        let case = Case::new(Spec { family, hides: Hides::Effect, colour: Colour::Pink, level, number });
        let outcome = study::run(&case, folder.path(), Duration::from_secs(600));
        assert_eq!(outcome.truth, [hidden]);
        assert!(outcome.failure.is_none() && outcome.top, "{outcome:?}");
    }
}

/// Under a controller a dead time has several minima: at the best fit no step helps (two roots that meet), and the one that is found has
/// a likelier one beside it, which the effects that are fitted show. A ship whose sensor is elsewhere is likeliest where all of its motion
/// has bent to that, and the cause is seen from a less likely minimum only.
#[test]
#[cfg_attr(debug_assertions, ignore = "takes minutes without optimisation")]
fn searches_begin_where_a_cause_is_seen() {
    let folder = tempfile::tempdir().expect("a folder");
    for (family, hides, number, hidden) in [
        ("thermal", Hides::Loop, 0, "slow_mode(near)"),
        ("thermal", Hides::Loop, 1, "slow_mode(near)"),
        ("ship", Hides::Effect, 17, "sensor_position(v_m, u)"),
    ] {
        let family = Family::named(family);
        let case = Case::new(Spec { family, hides, colour: Colour::Pink, level: 0.08, number });
        let outcome = study::run(&case, folder.path(), Duration::from_secs(600));
        assert_eq!(outcome.truth, [hidden]);
        assert!(outcome.failure.is_none() && outcome.grouped, "{outcome:?}");
    }
}

#[test]
fn families_compile_and_have_something_to_hide() {
    for family in FAMILIES {
        let model = fdm::Model::from_text(family.name, family.text).unwrap_or_else(|e| panic!("{}: {e}", family.name));
        assert!(model.warnings().is_empty(), "{}: {:?}", family.name, model.warnings());
        let inputs: Vec<&str> = model.definition().inputs.iter().map(|i| i.quantity.name.as_str()).collect();
        assert_eq!(family.drives.iter().map(|d| d.name).collect::<Vec<_>>(), inputs);
        for catalogue in [&*hidden::INSIDE, &*hidden::OUTSIDE] {
            assert!(!hidden::menu(family, &model, catalogue).is_empty(), "{}", family.name);
        }
        assert!(!hidden::disturbed(&model).is_empty(), "{}", family.name);
    }
}

#[test]
fn cases_are_the_same_again_and_gain_what_was_asked_for() {
    let spec =
        Spec { family: Family::named("motor"), hides: Hides::Effect, colour: Colour::White, level: 0.02, number: 3 };
    let (first, again) = (Case::new(spec), Case::new(spec));
    assert_eq!(first.truth.places, again.truth.places);
    let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits());
    assert!(first.runs.iter().zip(&again.runs).all(|(a, b)| same(&a.measured, &b.measured)));
    assert!(first.truth.gain > 3.0, "{}", first.truth.gain);
}
