//! The figures that the project promises, from the shipped models and records, through the command line.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::process::Command;

fn fit(model: &str, data: &str) -> serde_json::Value {
    let output = Command::new(env!("CARGO_BIN_EXE_fdm"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["fit", model, "--data", data, "--json", "--quiet"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn rms(result: &serde_json::Value) -> f64 {
    assert_eq!(result["termination"], "converged");
    result["outputs"][0]["rms"].as_f64().unwrap()
}

fn parameter(result: &serde_json::Value, name: &str) -> (f64, f64) {
    let parameters = result["parameters"].as_array().unwrap();
    let p = parameters.iter().find(|p| p["name"] == name).unwrap();
    (p["value"].as_f64().unwrap(), p["standard_error"].as_f64().unwrap())
}

#[test]
fn ship_roll_decay() {
    let run = "models/ship_roll_decay/run.csv";
    let linear = fit("models/ship_roll_decay/linear.fdm", run);
    assert!((rms(&linear) - 0.200).abs() < 0.001, "linear: {}", rms(&linear));
    let full = fit("models/ship_roll_decay/model.fdm", run);
    assert!(rms(&full) <= 0.0245, "with quadratic damping and cubic stiffness: {}", rms(&full));
    for (name, published, tolerance) in [("omega2", 6.05, 0.01), ("d2", 0.104, 0.001), ("k3", 5.2, 0.1)] {
        let (value, error) = parameter(&full, name);
        assert!((value - published).abs() < tolerance, "{name}: {value}");
        assert!(error > 0.0 && error < 0.05 * value.abs());
    }
}

#[test]
fn pendulum_free_swing() {
    let run = "models/pendulum_free_swing/run.csv";
    let viscous = rms(&fit("models/pendulum_free_swing/viscous.fdm", run));
    assert!((viscous - 0.0279).abs() < 0.0001, "viscous: {viscous}");
    let coulomb = rms(&fit("models/pendulum_free_swing/coulomb.fdm", run));
    assert!((coulomb - 0.0194).abs() < 0.0001, "with Coulomb friction: {coulomb}");
    let full = rms(&fit("models/pendulum_free_swing/model.fdm", run));
    assert!(full <= 0.0028, "with Coulomb friction and quadratic drag: {full}");
}

#[test]
fn json_has_the_promised_keys() {
    let result = fit("models/ship_roll_decay/linear.fdm", "models/ship_roll_decay/run.csv");
    for key in ["parameters", "outputs", "cost", "termination", "iterations"] {
        assert!(!result[key].is_null(), "{key}");
    }
    for key in ["name", "value", "standard_error", "unit", "status", "run"] {
        assert!(result["parameters"].as_array().unwrap().iter().all(|p| p.get(key).is_some()), "{key}");
    }
    for key in ["name", "run", "rms", "r2", "tic"] {
        assert!(result["outputs"].as_array().unwrap().iter().all(|o| !o[key].is_null()), "{key}");
    }
}
