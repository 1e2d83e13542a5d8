//! `fdm reproduce`: the reference systems, thinned, and how the command ends.

use serde_json::Value;
use std::path::Path;
use std::process::Output;
use support::command::{printed, said};
use support::repository;

fn fdm(folder: &Path, arguments: &[&str]) -> Output {
    support::fdm().current_dir(folder).args(arguments).output().unwrap()
}

#[test]
fn every_reference_system_is_recovered() {
    let output = fdm(repository(), &["reproduce", "all", "--thin", "--json"]);
    let outcomes: Vec<Value> = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", said(&output)));
    let names: Vec<&str> = outcomes.iter().map(|o| o["system"].as_str().unwrap()).collect();
    let papers = [
        "miniature_helicopter",
        "goodman_ship",
        "hydrofoil",
        "vstol",
        "t33",
        "elovich",
        "bo105",
        "hfb320",
        "puma",
        "hover",
    ];
    let measured = [
        "ship_roll_decay",
        "pendulum_free_swing",
        "pendulum_dfki",
        "trex550",
        "tclab",
        "water_pump",
        "pinene",
        "gas_oil",
        "methanol",
        "lynx_hare",
    ];
    for name in papers.iter().chain(&measured) {
        assert!(names.contains(name), "{name} is missing: {names:?}");
    }
    let page = std::fs::read_to_string(repository().join("models/README.md")).unwrap();
    for outcome in &outcomes {
        let row = format!("[{0}]({0})", outcome["system"].as_str().unwrap());
        assert!(page.contains(&row), "models/README.md lacks {row}: `fdm reproduce all --markdown` prints its table");
        let checks = outcome["checks"].as_array().unwrap();
        assert!(!checks.is_empty(), "{outcome}");
        let failed: Vec<&Value> = checks.iter().filter(|c| c["passed"] != true).collect();
        assert!(failed.is_empty() && outcome["passed"] == true, "{}: {failed:#?}", outcome["system"]);
        for key in ["what", "expected", "got", "passed"] {
            assert!(checks.iter().all(|c| !c[key].is_null()), "{key}");
        }
        // printed errors do not know the noise of carried terms
        let most = if outcome["system"] == "bo105" { 6.0 } else { 4.0 };
        assert!(outcome["worst_error_in_standard_errors"].as_f64().is_none_or(|worst| worst <= most), "{outcome}");
    }
    assert!(output.status.success());
    assert!(output.stderr.is_empty(), "nothing moves where there is no terminal: {}", said(&output));
}

#[test]
fn what_nobody_knows_is_wrong_input_with_the_nearest_name() {
    let output = fdm(repository(), &["reproduce", "hydrofoyl"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("did you mean `hydrofoil`?"), "{}", said(&output));
    let empty = tempfile::tempdir().unwrap();
    let models = empty.path().to_str().unwrap();
    assert_eq!(fdm(repository(), &["reproduce", "all", "--models", models]).status.code(), Some(2));
}

#[test]
fn what_does_not_come_out_is_printed_and_is_the_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let own = folder.path().join("decay");
    std::fs::create_dir(&own).unwrap();
    std::fs::write(own.join("m.fdm"), "model m { state x = 1; param k = 0.5; der(x) = -k*x; output y = x; }").unwrap();
    let text_of = |wanted: f64| {
        format!(
            "title = 'decay'\nsource = 'ours'\n[[record]]\nname = 'a run'\ntruth = 'm.fdm'\ndt = 0.1\nduration = 5\nnoise.y = 0.01\n\
             [[step]]\nname = 'k'\nmodel = 'm.fdm'\nexpected.k = {{ value = {wanted} }}\npaper.k = [0.51, 0.02]\n"
        )
    };
    std::fs::write(own.join("experiment.toml"), text_of(0.5)).unwrap();
    let good = fdm(folder.path(), &["reproduce", "decay"]);
    assert!(good.status.success() && printed(&good).contains("0.51 ± 0.02"), "{}", printed(&good));
    assert_eq!(fdm(folder.path(), &["reproduce", "decay"]).stdout, good.stdout);
    let one = fdm(folder.path(), &["reproduce", "decay", "--threads", "1"]);
    assert_eq!(one.stdout, good.stdout);
    std::fs::write(own.join("experiment.toml"), text_of(0.6)).unwrap();
    let bad = fdm(folder.path(), &["reproduce", "decay"]);
    assert_eq!(bad.status.code(), Some(1));
    assert!(printed(&bad).contains("FAILED") && printed(&bad).contains("0 of 1 as expected"), "{}", printed(&bad));
    // the record as a file is what was fitted
    let records = folder.path().join("records");
    let written = fdm(folder.path(), &["reproduce", "decay", "--records", records.to_str().unwrap()]);
    assert!(written.status.success());
    let file = records.join("a_run.csv");
    let fitted = fdm(folder.path(), &["fit", "decay/m.fdm", "--data", file.to_str().unwrap(), "--json", "--quiet"]);
    let fit: Value = serde_json::from_slice(&fitted.stdout).unwrap();
    let outcome = fdm(folder.path(), &["reproduce", "decay", "--json"]);
    let outcome: Value = serde_json::from_slice(&outcome.stdout).unwrap();
    let error = |v: &Value| v.as_f64().unwrap();
    assert_eq!(
        error(&fit["parameters"][0]["corrected_error"]).to_bits(),
        error(&outcome[0]["checks"][0]["standard_error"]).to_bits()
    );
    std::fs::write(own.join("experiment.toml"), "title = 3\n").unwrap();
    let broken = fdm(folder.path(), &["reproduce", "decay"]);
    assert_eq!(broken.status.code(), Some(2));
    assert!(said(&broken).contains("line 1"), "{}", said(&broken));
}

#[test]
fn tables_of_several_systems_come_in_their_order_and_the_summary_last() {
    let folder = tempfile::tempdir().unwrap();
    for (name, rate, duration) in [("a_slow", 0.5, 400), ("b_quick", 0.3, 5), ("c_quick", 0.2, 5)] {
        let own = folder.path().join("models").join(name);
        std::fs::create_dir_all(&own).unwrap();
        let model = format!("model m {{ state x = 1; param k = {rate}; der(x) = -k*x; output y = x; }}");
        std::fs::write(own.join("m.fdm"), model).unwrap();
        let text = format!(
            "title = 'decay'\nsource = 'ours'\n[[record]]\nname = 'a run'\ntruth = 'm.fdm'\ndt = 0.1\nduration = {duration}\nnoise.y = 0.01\n\
             [[step]]\nname = 'k'\nmodel = 'm.fdm'\nexpected.k = {{ value = {rate} }}\n"
        );
        std::fs::write(own.join("experiment.toml"), text).unwrap();
    }
    let all = fdm(folder.path(), &["reproduce", "all", "--models", "models"]);
    let table = printed(&all);
    let places = ["a_slow: decay", "b_quick: decay", "c_quick: decay", "as expected"].map(|what| table.rfind(what));
    assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{places:?}\n{table}");
    let summary = table.rsplit("\n\n").next().unwrap();
    assert!(["a_slow", "b_quick", "c_quick"].iter().all(|name| summary.contains(name)), "{table}");
    let one = fdm(folder.path(), &["reproduce", "all", "--models", "models", "--threads", "1"]);
    assert_eq!(one.stdout, all.stdout);
}
