//! What a fit through the command line promises to programs. (The figures of the shipped models and records: `tests/reproduce.rs`.)
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
