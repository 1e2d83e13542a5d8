//! Tests that hide an effect in the data and require finding it: families of systems, truths that the model file does not show,
//! and the tool as a process that sees the model and the records only. docs/blind.md describes it.
//!
//! The whole set: `cargo test --release --test blind -- --ignored --nocapture`.
#![allow(clippy::print_stdout, reason = "studies print their figures")]

mod answer;
mod case;
mod chance;
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
use families::{FAMILIES, Family};
use noise::Colour;
use plan::{Hides, Plan, Spec};

#[test]
#[ignore = "the whole set lasts hours; FDM_BLIND_... choose a part of it"]
fn blind() {
    let all = study::study(&Plan::of_environment());
    table::print(&all);
}

#[test]
#[ignore = "prints the table of what has been run"]
fn blind_table() {
    table::print(&study::results(&study::folder()));
}

#[test]
#[ignore = "makes the cases of a plan and prints their truths, without the tool"]
fn blind_cases() {
    let folder = study::folder();
    for spec in Plan::of_environment().specs() {
        let begun = std::time::Instant::now();
        match std::panic::catch_unwind(|| Case::new(spec)) {
            Ok(case) => {
                case.write(&folder.join(spec.name()));
                let t = &case.truth;
                let names: Vec<String> = t.places.iter().map(hidden::Place::to_string).collect();
                println!(
                    "{} [{}] {:?} gain {:.1}, held out {:.1}, parts {:.1?}, rivals {:?}, {:.1} s",
                    spec.name(),
                    names.join(", "),
                    t.numbers,
                    t.gain,
                    t.gain_holdout,
                    t.parts,
                    t.rivals.iter().take(3).map(|(p, d)| format!("{p} {d:.2}")).collect::<Vec<_>>(),
                    begun.elapsed().as_secs_f64()
                );
            }
            Err(_) => println!("{}: could not be made", spec.name()),
        }
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
