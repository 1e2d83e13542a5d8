//! Bad input to the frequency domain, through the command line: a sentence each, with what to do; exit code 2, or 1 where a result is printed.

use std::path::{Path, PathBuf};
use support::Desk;
use support::command::said;

const MODEL: &str = "model lag { time [s]; input u; state x; param a = -1.2, b = 2.0, c = 1, tau = 0.2 in [0, 500];
    der(x) = a*x + b*delay(u, tau); output y = x, z = c*x; }";

/// 200 samples, a tenth apart: u, a lag of it twice; `still` does not move.
fn record(desk: &Desk, name: &str, times: impl Fn(usize) -> f64) -> PathBuf {
    let (mut rows, mut x, mut z) = (String::from("t [s],u,y,z,still\n"), 0.0, 0.0);
    let mut noise = 1_u64;
    for k in 0..200 {
        noise = noise.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let u = (0.3 * k as f64).sin() + (0.05 * (k * k) as f64).sin() + (noise >> 40) as f64 / 1e7;
        x += 0.1 * (2.0 * u - 1.2 * x);
        z += 0.1 * (x - z);
        rows.push_str(&format!("{},{u},{x},{z},3\n", times(k)));
    }
    desk.write(name, rows)
}

/// Exit code and what was said, for these arguments behind `fdm fit MODEL --data RUN`.
fn fit(desk: &Desk, model: &str, record: &Path, more: &str) -> (Option<i32>, String) {
    desk.write("model.fdm", model);
    let output =
        desk.command("fit model.fdm --quiet --data").arg(record).args(more.split_whitespace()).output().unwrap();
    (output.status.code(), said(&output))
}

fn even(k: usize) -> f64 {
    k as f64 / 10.0
}

#[test]
fn bands_and_options_that_make_no_sense() {
    let desk = Desk::new();
    let record = record(&desk, "run.csv", even);
    let held_out = format!("--domain frequency --validation {}", record.display());
    for (more, words) in [
        ("--domain frequency --band 0.1:5", "lower the upper end"),
        ("--domain frequency --band 0.01:1", "less than one period"),
        ("--domain frequency --band 0.51:0.54", "use a wider band"),
        ("--domain frequency --band nan:1", "both above zero and finite"),
        ("--domain frequency --band 0.1:inf", "both above zero and finite"),
        ("--domain frequency --band 2:1", "give its lower end first"),
        ("--domain frequency --band 0.1:1 --df 0", "give a spacing above zero"),
        ("--domain frequency --band 0.1:1 --df nan", "give a spacing above zero"),
        ("--domain frequency --band 0.1:1 --df 1e-9", "use a narrower band or a wider spacing"),
        ("--domain frequency --band 0.1:1 --df 1e-300", "use a narrower band or a wider spacing"),
        ("--domain frequency --df 0.01", "--band"),
        ("--domain frequency --band 0.05:0.05", "too few for"),
        ("--domain frequency --noise full --map z=y", "say --noise diagonal"),
        ("--domain frequency --set tau=100", "begin with a shorter delay"),
        ("--domain frequency --shooting 3", "--shooting cannot be combined with --domain frequency"),
        ("--domain frequency --coherence 0.5", "use --method frequency-response"),
        ("--band 0.1:1", "--band cannot be combined with --domain time"),
        (
            "--method frequency-response --end-points free",
            "--end-points cannot be combined with --method frequency-response",
        ),
        ("--method frequency-response --noise full", "--noise cannot be combined with --method frequency-response"),
        ("--method frequency-response --band 0.1:5", "lower the upper end"),
        ("--method frequency-response --band nan:1", "both above zero and finite"),
        ("--method frequency-response --band 0.1:1 --df 1e-9", "use a narrower band or a wider spacing"),
        ("--method frequency-response --segments 1e9", "use shorter segments"),
        ("--method frequency-response --segments nan", "give lengths above zero"),
        ("--method frequency-response --coherence 2", "give a number from 0 to below 1"),
        ("--method frequency-response --coherence nan", "give a number from 0 to below 1"),
        ("--method frequency-response --pair q/u", "there is no output `q`"),
        ("--method frequency-response --pair y/w", "there is no input `w`"),
        (&held_out, "validation data must not be fitted"),
    ] {
        let (code, said) = fit(&desk, MODEL, &record, more);
        assert_eq!(code, Some(2), "{more}: {said}");
        assert!(said.contains(words) && !said.contains("panicked"), "{more}: {said}");
    }
}

#[test]
fn records_and_models_that_have_no_spectrum() {
    let desk = Desk::new();
    let uneven = record(&desk, "uneven.csv", |k| 0.1 * k as f64 + 0.06 * (k % 2) as f64);
    let record = record(&desk, "run.csv", even);
    let forced = "model m { time [s]; input u; state x; param a = -1; der(x) = a*x + u + 0.1*t; output y = x; }";
    let without = "model m { input u; param a = 1; output y = a*u; }";
    let silent = "model m { time [s]; input u, still; state x; param a = -1, b = 1, c = 1; der(x) = a*x + b*u + c*still; output y = x; }";
    let alone = "model m { time [s]; state x = 1; param a = -1; der(x) = a*x; output y = x; }";
    for (model, record, method, words) in [
        (MODEL, &uneven, "--domain frequency", "resample the record"),
        (MODEL, &uneven, "--method frequency-response", "resample the record"),
        (forced, &record, "--domain frequency --nonlinear linearise", "make it an input that is recorded"),
        (forced, &record, "--method frequency-response", "make it an input that is recorded"),
        (without, &record, "--domain frequency", "estimate in the time domain"),
        (without, &record, "--method frequency-response", "estimate in the time domain"),
        (silent, &record, "--domain frequency", "choose a band in which it moves"),
        (silent, &record, "--method frequency-response", "choose a band in which it moves"),
        (alone, &record, "--method frequency-response", "the model has no input"),
    ] {
        let (code, said) = fit(&desk, model, record, method);
        assert_eq!(code, Some(2), "{method} {model}: {said}");
        assert!(said.contains(words) && !said.contains("panicked"), "{method} {model}: {said}");
    }
}

/// The estimates are printed, and said not to be believed; the time domain, where the mode grows, is not entered.
#[test]
fn unstable_modes_that_no_response_shows() {
    let desk = Desk::new();
    let record = record(&desk, "run.csv", even);
    let unshown = "model m { time [s]; input u; state x, w; param a = -1.2, b = 2; der(x) = a*x + b*u; der(w) = 0.8*w + x; output y = x; }";
    let unmoved = "model m { time [s]; input u; state x, w; param a = -1.2, b = 2; der(x) = a*x + b*u + w; der(w) = 0.8*w; output y = x; }";
    for (model, words) in [(unshown, "no output shows it"), (unmoved, "no input moves it")] {
        for method in ["--domain frequency", "--method frequency-response"] {
            let (code, said) = fit(&desk, model, &record, method);
            assert_eq!(code, Some(1), "{method}: {said}");
            assert!(said.contains(words) && said.contains("0.8000 of w"), "{method}: {said}");
        }
    }
}

/// Where there is no response the sentence speaks of frequencies, not of samples and times.
#[test]
fn responses_that_cannot_be_computed() {
    let desk = Desk::new();
    let record = record(&desk, "run.csv", even);
    let large = |b: i32| {
        format!(
            "model m {{ time [s]; input u; state x; param a = 1, b = {b}; der(x) = -x + a*exp(b)*u; output y = x; }}"
        )
    };
    let (code, said) = fit(&desk, &large(800), &record, "--domain frequency --start-values model");
    assert!(code == Some(2) && said.contains("the derivative of `x` by `u` is inf"), "{said}");
    let (code, said) = fit(&desk, &large(400), &record, "--domain frequency --start-values model");
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("cycles per unit of time: output `y` is not a finite number at the start values"), "{said}");
}
