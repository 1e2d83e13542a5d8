//! What cannot be diagnosed: a sentence each through the command line, and exit code 2.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use tempfile::TempDir;

const MODEL: &str = "model lag { time [s]; input u; state x; param a = 1.2, b = 2; der(x) = b*u - a*x; output y = x; }";

struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        let desk = Self(tempfile::tempdir().unwrap());
        desk.file("model.fdm", MODEL);
        desk.record("run.csv", 1, 300, 0.1);
        desk.record("other.csv", 2, 300, 0.1);
        desk
    }

    fn file(&self, name: &str, content: &str) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, content).unwrap();
        path
    }

    /// A lag of a moving input, with noise.
    fn record(&self, name: &str, seed: u64, samples: usize, step: f64) {
        let mut rows = String::from("t [s],u,y\n");
        let (mut x, mut noise) = (0.0, seed);
        for k in 0..samples {
            noise = noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let t = step * k as f64;
            let u = (0.9 * t).sin() + (2.3 * t + seed as f64).sin();
            x += step * (2.0 * u - 1.2 * x);
            rows.push_str(&format!("{t},{u},{}\n", x + (noise >> 40) as f64 / 1e8));
        }
        self.file(name, &rows);
    }

    /// Exit code and what was said, for these arguments behind `fdm diagnose`.
    fn diagnose(&self, words: &str) -> (Option<i32>, String) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fdm"));
        command.arg("diagnose").args(words.split_whitespace()).arg("--quiet").current_dir(self.0.path());
        let out = command.output().unwrap();
        assert!(out.stdout.is_empty(), "{}", String::from_utf8_lossy(&out.stdout));
        (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
    }

    fn refused(&self, arguments: &str, words: &[&str]) {
        let (code, said) = self.diagnose(arguments);
        assert_eq!(code, Some(2), "{arguments}: {said}");
        for word in words {
            assert!(said.contains(word), "{arguments}: no `{word}` in {said}");
        }
    }
}

#[test]
fn an_effect_with_an_unknown_name() {
    let desk = Desk::new();
    desk.file("my.fdm", "effect gap(x: state) \"a gap\" { param c = 0; add der(x) += c*rudder; }");
    desk.refused("model.fdm --data run.csv --effects my.fdm", &["`rudder` is not declared", "my.fdm:1"]);
}

#[test]
fn an_effect_without_a_null_value() {
    let desk = Desk::new();
    desk.file("my.fdm", "effect gap(x: state) \"a gap\" { param c; add der(x) += c*x; }");
    desk.refused("model.fdm --data run.csv --effects my.fdm", &["`c` has no null value", "my.fdm:1"]);
}

#[test]
fn an_effect_that_does_not_vanish_at_its_null() {
    let desk = Desk::new();
    desk.file("my.fdm", "effect gap(x: state) \"a gap\" { param c = 1; add der(x) += c*x; }");
    desk.refused("model.fdm --data run.csv --effects my.fdm", &["my.fdm:1"]);
}

#[test]
fn a_held_out_run_that_is_one_of_the_others() {
    let desk = Desk::new();
    desk.refused("model.fdm --data run.csv --holdout run.csv", &["has the samples of `run`", "prove nothing"]);
    fs::copy(desk.0.path().join("run.csv"), desk.0.path().join("copy.csv")).unwrap();
    let twice = "model.fdm --data run.csv --data other.csv --holdout copy.csv";
    desk.refused(twice, &["`copy` has the samples of `run`"]);
    desk.refused(&format!("{twice} --domain frequency"), &["`copy` has the samples of `run`"]);
}

#[test]
fn records_too_short_to_judge() {
    let desk = Desk::new();
    desk.record("short.csv", 3, 20, 0.1);
    for domain in ["", " --domain frequency"] {
        desk.refused(&format!("model.fdm --data short.csv{domain}"), &["`short` has 20 samples", "32 are needed"]);
    }
    desk.record("brief.csv", 3, 40, 0.1);
    desk.refused(
        "model.fdm --data brief.csv --domain frequency --band 0.3:2",
        &["`brief` has 14 lines", "32 are needed"],
    );
}

#[test]
fn bands_without_lines() {
    let desk = Desk::new();
    let asked = |more: &str, words: &str| {
        desk.refused(&format!("model.fdm --data run.csv --domain frequency {more}"), &[words]);
    };
    asked("--band 0.201:0.21", "none of the record's own frequencies");
    asked("--band 2:1", "give its lower end first");
    asked("--band 0.1:50", "lower the upper end");
    asked("--band 0.1:2 --df 0.01", "lines 0.01 apart repeat each other");
    asked("--band 0.1:2 --df 0", "give a spacing above zero");
}

#[test]
fn a_model_that_is_not_linear_in_the_frequency_domain() {
    let desk = Desk::new();
    let text = MODEL
        .replace("state x;", "state x, hidden;")
        .replace("b*u - a*x;", "b*u - a*x + hidden^2; der(hidden) = u - a*hidden;");
    desk.file("model.fdm", &text);
    desk.refused(
        "model.fdm --data run.csv --domain frequency",
        &["the model is not linear", "hidden", "--nonlinear linearise"],
    );
}

#[test]
fn options_of_the_frequency_domain_are_refused_in_time() {
    let desk = Desk::new();
    desk.refused("model.fdm --data run.csv --band 0.1:1", &["--band belongs to the frequency domain"]);
    desk.refused("model.fdm --data run.csv --ends free --own-values", &["--ends, --own-values"]);
    desk.refused("model.fdm --data run.csv --domain spectral", &["time", "frequency"]);
}
