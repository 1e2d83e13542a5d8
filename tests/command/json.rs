//! What a fit through the command line promises to programs. (The figures of the shipped models and records: `tests/command/reproduce.rs`.)

use support::command::{at_home, good};

#[test]
fn json_has_the_promised_keys() {
    let words = "fit models/ship_roll_decay/linear.fdm --data models/ship_roll_decay/run.csv --json --quiet";
    let result: serde_json::Value = serde_json::from_str(&good(&mut at_home(words))).unwrap();
    for key in ["parameters", "outputs", "cost", "log_likelihood", "termination", "iterations"] {
        assert!(!result[key].is_null(), "{key}");
    }
    for key in ["name", "value", "standard_error", "unit", "status", "run"] {
        assert!(result["parameters"].as_array().unwrap().iter().all(|p| p.get(key).is_some()), "{key}");
    }
    for key in ["name", "run", "rms", "r2", "tic"] {
        assert!(result["outputs"].as_array().unwrap().iter().all(|o| !o[key].is_null()), "{key}");
    }
}
