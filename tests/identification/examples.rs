//! The examples do what they say.

#[path = "../../examples/model_in_rust.rs"]
mod model_in_rust;
#[path = "../../examples/outside/main.rs"]
mod outside;
#[path = "../../examples/roll_decay.rs"]
mod roll_decay;

#[test]
fn roll_decay_reaches_its_figure() {
    let fit = roll_decay::estimated(support::repository()).unwrap();
    assert!(fit.estimate.is_good());
    assert!(fit.estimate.outputs[0].rms.unwrap() <= 0.0245);
}

#[test]
fn the_model_in_rust_finds_its_own_parameters() {
    let fit = model_in_rust::estimated().unwrap();
    assert!(fit.estimate.is_good());
    for (name, value) in [("omega", 2.0), ("zeta", 0.7), ("K", 6.0), ("tau", 0.15)] {
        let found = fit.estimate.parameter(name, None).unwrap().value;
        assert!((found - value).abs() < 1e-6 * value, "{name}: {found}");
    }
}

#[test]
fn the_sample_outside_finds_a_pendulum_of_nine_per_second_squared() {
    let fit = outside::estimated().unwrap();
    assert!(fit.estimate.is_good());
    // omega^2 + (d/2)^2 of what was recorded
    let k = fit.estimate.parameter("k", None).unwrap();
    assert!((k.value - 9.01).abs() < 0.01, "{}", k.value);
}
