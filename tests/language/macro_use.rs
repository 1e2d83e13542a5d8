//! `model!` where users put it: in functions, closures, other macros, beside names of their own.

#![deny(warnings, clippy::all, clippy::pedantic)]

use fdm::Model;
use fdm::dynamics::{Point, Workspace};

/// The outputs of a model without states, at its start values.
fn outputs(model: &Model, drive: &[f64]) -> Vec<f64> {
    let (layout, dynamics) = (model.layout(), model.dynamics());
    let work = &mut Workspace::new(dynamics);
    let (mut known, mut out) = (vec![0.0; layout.known], vec![0.0; layout.outputs]);
    dynamics.prepare(&model.definition().start(), &mut known, work);
    dynamics.outputs(Point { t: 0.0, x: &[], drive, known: &known }, &mut out, work);
    out
}

#[test]
fn names_of_the_user_and_of_the_generated_code_do_not_meet() {
    #![allow(non_upper_case_globals, non_camel_case_types, dead_code, clippy::pedantic)]
    const v0: f64 = 5.0;
    const out: f64 = 6.0;
    struct f64x;
    struct Box;
    mod generated {}
    let known = 3;
    let model = fdm::model! {
        model names {
            input out, t_, self_, fn_;
            param known = 2, v0 = 3, Box = 4, Vec = 5, crate_ = 6;
            output x = known*out + v0*t_ + Box*Vec*crate_;
        }
    };
    assert_eq!((outputs(&model, &[1.0, 10.0, 0.0, 0.0]), known), (vec![152.0], 3));
}

#[test]
fn a_model_can_be_built_by_another_macro() {
    macro_rules! gain {
        ($name:ident, $gain:expr, $least:literal) => {
            fdm::model! { model $name { input u; param k = 2*$gain in [$least, 100]; output y = k*u; } }
        };
    }
    let model = gain!(amplifier, 1 + 2, -1);
    assert_eq!(model.name(), "amplifier");
    assert_eq!(outputs(&model, &[1.5]), [9.0]);
}

#[test]
fn models_have_places_and_their_text() {
    let model = fdm::model! {
        model a {
            param k = 1; /// a comment, as in a file
            output y = k;   // another
        }
    };
    assert_eq!(model.source().name(), format!("model! at {}:{}", file!(), line!() - 6));
    assert_eq!(model.source().line(1).trim_start(), "model a {");
    assert_eq!(model.source().line(3).trim_start(), "output y = k;");
    assert_eq!(
        model.source().line(3).len() - model.source().line(1).len(),
        "    output y = k;".len() - "model a {".len()
    );
}

#[test]
fn several_models_live_in_one_function() {
    let models = [
        fdm::model! { model one { param k = 1; output y = k; } },
        fdm::model!(model two { param k = 2; output y = k; }),
    ];
    assert_eq!(models.each_ref().map(|m| outputs(m, &[])), [vec![1.0], vec![2.0]]);
    let again = models[1].clone();
    assert_eq!(std::thread::spawn(move || outputs(&again, &[])[0]).join().ok(), Some(2.0));
}

#[test]
fn warnings_are_kept() {
    let model = fdm::model! { model a { input idle; param k = 1; output y = k; } };
    assert!(model.warnings().iter().any(|w| w.message.contains("idle")), "{:?}", model.warnings());
}

#[test]
fn a_trim_stands_in_a_model_as_in_a_file() {
    let model = fdm::model! {
        model surge {
            input throttle;
            state u = 2;
            param drag = 0.3, push = 4, cruise = 3 fixed;
            trim { u = cruise; throttle = if push > 1 then drag*cruise^2/push else 0; }
            der(u) = push*throttle - drag*u^2;
            output y = u;
        }
    };
    assert_eq!(model.definition().trim.len(), 2);
    let mut linear = fdm::linear::LinearModel::new(&model).expect("a trim");
    assert_eq!(linear.trim(&[0.3, 4.0, 3.0]).states, [3.0]);
    assert_eq!(linear.trim(&[0.3, 4.0, 3.0]).inputs, [0.3 * 9.0 / 4.0]);
}
