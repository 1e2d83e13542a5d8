//! What cannot be diagnosed: a sentence each through the command line, and exit code 2.

use std::fs;
use support::Desk;

const MODEL: &str = "model lag { time [s]; input u; state x; param a = 1.2, b = 2; der(x) = b*u - a*x; output y = x; }";

fn desk() -> Desk {
    let desk = Desk::with([("model.fdm", MODEL)]);
    record(&desk, "run.csv", 1, 300, 0.1);
    record(&desk, "other.csv", 2, 300, 0.1);
    desk
}

/// A lag of a moving input, with noise.
fn record(desk: &Desk, name: &str, seed: u64, samples: usize, step: f64) {
    let mut rows = String::from("t [s],u,y\n");
    let (mut x, mut noise) = (0.0, seed);
    for k in 0..samples {
        noise = noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let t = step * k as f64;
        let u = (0.9 * t).sin() + (2.3 * t + seed as f64).sin();
        x += step * (2.0 * u - 1.2 * x);
        rows.push_str(&format!("{t},{u},{}\n", x + (noise >> 40) as f64 / 1e8));
    }
    desk.write(name, rows);
}

/// `fdm diagnose` with these arguments is refused with all of these words.
fn refused(desk: &Desk, arguments: &str, words: &[&str]) {
    let said = desk.refused(&format!("diagnose {arguments} --quiet"));
    for word in words {
        assert!(said.contains(word), "{arguments}: no `{word}` in {said}");
    }
}

#[test]
fn an_effect_with_an_unknown_name() {
    let desk = desk();
    desk.write("my.fdm", "effect gap(x: state) \"a gap\" { param c = 0; add der(x) += c*rudder; }");
    refused(&desk, "model.fdm --data run.csv --effects my.fdm", &["`rudder` is not declared", "my.fdm:1"]);
}

#[test]
fn an_effect_without_a_null_value() {
    let desk = desk();
    desk.write("my.fdm", "effect gap(x: state) \"a gap\" { param c; add der(x) += c*x; }");
    refused(&desk, "model.fdm --data run.csv --effects my.fdm", &["`c` has no null value", "my.fdm:1"]);
}

#[test]
fn an_effect_that_does_not_vanish_at_its_null() {
    let desk = desk();
    desk.write("my.fdm", "effect gap(x: state) \"a gap\" { param c = 1; add der(x) += c*x; }");
    refused(&desk, "model.fdm --data run.csv --effects my.fdm", &["my.fdm:1"]);
}

#[test]
fn a_held_out_run_that_is_one_of_the_others() {
    let desk = desk();
    refused(
        &desk,
        "model.fdm --data run.csv --validation run.csv",
        &["run.csv is both fitted and validation data", "must not be fitted"],
    );
    fs::copy(desk.path("run.csv"), desk.path("copy.csv")).unwrap();
    let twice = "model.fdm --data run.csv --data other.csv --validation copy.csv";
    refused(&desk, twice, &["`copy` (copy.csv) has the samples of the training run `run`", "prove nothing"]);
    refused(
        &desk,
        &format!("{twice} --domain frequency"),
        &["`copy` (copy.csv) has the samples of the training run `run`"],
    );
}

#[test]
fn records_too_short_to_judge() {
    let desk = desk();
    record(&desk, "short.csv", 3, 7, 0.1);
    for domain in ["", " --domain frequency"] {
        refused(
            &desk,
            &format!("model.fdm --data short.csv{domain}"),
            &["`short` (short.csv) has 7 samples", "8 are needed"],
        );
    }
    record(&desk, "brief.csv", 3, 40, 0.1);
    refused(
        &desk,
        "model.fdm --data brief.csv --domain frequency --band 0.3:2",
        &["`brief` (brief.csv) has 14 bins", "32 are needed"],
    );
}

#[test]
fn bands_without_lines() {
    let desk = desk();
    let asked = |more: &str, words: &str| {
        refused(&desk, &format!("model.fdm --data run.csv --domain frequency {more}"), &[words]);
    };
    asked("--band 0.201:0.21", "none of the record's own frequencies");
    asked("--band 2:1", "give its lower end first");
    asked("--band 0.1:50", "lower the upper end");
    asked("--band 0.1:2 --df 0.01", "bins 0.01 apart repeat each other");
    asked("--band 0.1:2 --df 0", "give a spacing above zero");
}

#[test]
fn a_model_that_is_not_linear_in_the_frequency_domain() {
    let desk = desk();
    let text = MODEL
        .replace("state x;", "state x, hidden;")
        .replace("b*u - a*x;", "b*u - a*x + hidden^2; der(hidden) = u - a*hidden;");
    desk.write("model.fdm", &text);
    refused(
        &desk,
        "model.fdm --data run.csv --domain frequency",
        &["the model is not linear", "hidden", "--nonlinear linearise"],
    );
}

#[test]
fn options_of_the_frequency_domain_are_refused_in_time() {
    let desk = desk();
    refused(&desk, "model.fdm --data run.csv --band 0.1:1", &["--band cannot be combined with --domain time"]);
    refused(
        &desk,
        "model.fdm --data run.csv --end-points free --start-values model",
        &["--end-points, --start-values"],
    );
    refused(&desk, "model.fdm --data run.csv --domain spectral", &["time", "frequency"]);
}
