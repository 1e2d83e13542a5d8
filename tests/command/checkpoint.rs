//! Fits that are killed and go on: the same numbers to the last bit as without an interruption.

use std::fs;
use std::process::Stdio;
use std::time::Duration;
use support::Desk;
use support::command::said;

const MODEL: &str = "model bend \"two rates that are hard to tell apart\" {
  state a = 3, b = 0;
  param k1 = 0.5 in [0.01, 10] [1/s], k2 = 0.1 in [0.01, 10] [1/s], c = 0 in [-1, 1];
  der(a) = -k1*a;
  der(b) = k1*a - k2*b/(1 + b^2);
  output y = b + c;
}
";

fn desk() -> Desk {
    let desk = Desk::with([("model.fdm", MODEL)]);
    for (run, shift) in [("one", 0.0), ("two", 0.4)] {
        let mut rows = String::from("t [s],y\n");
        for n in 0..80 {
            let t = 0.125 * f64::from(n);
            let y = 3.0 * ((-0.3 * t).exp() - (-1.2 * t).exp()) + 0.02 * (f64::from(n * n) + shift).sin();
            rows.push_str(&format!("{t},{y}\n"));
        }
        desk.write(&format!("{run}.csv"), rows);
    }
    desk
}

/// What is printed in the end, whatever the exit code.
fn printed(desk: &Desk, words: &str) -> String {
    let output = desk.fdm(words);
    assert!(output.status.code().is_some_and(|c| c < 2), "{words}: {}", said(&output));
    String::from_utf8(output.stdout).unwrap()
}

const FIT: &str = "fit model.fdm --data one.csv --data two.csv --json -q --steps 5 --starts 4 --seed 3";

#[test]
fn killed_at_any_moment_a_fit_ends_with_the_same_bits() {
    let desk = desk();
    let begun = std::time::Instant::now();
    let whole = printed(&desk, FIT);
    let lasts = begun.elapsed();
    assert_eq!(printed(&desk, &format!("{FIT} --threads 1")), whole, "for any number of threads");
    for k in 0..2u32 {
        let kept = format!("{FIT} --checkpoint kept{k}");
        let mut kills = 0;
        // again and again, each time a little later than the time before
        for n in 1..=3 {
            let mut child = desk.command(&kept).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            std::thread::sleep(lasts.mul_f64(0.1 * f64::from(n * (k + 1))) + Duration::from_millis(7));
            kills += u32::from(child.try_wait().unwrap().is_none());
            child.kill().unwrap();
            child.wait().unwrap();
        }
        assert!(k > 0 || kills > 0, "the fit was too short to be killed");
        let threads = 1 + k;
        assert_eq!(printed(&desk, &format!("{kept} --threads {threads}")), whole, "after {kills} kills");
        // and once more from what was kept at the end
        assert_eq!(printed(&desk, &kept), whole);
    }
}

#[test]
fn a_single_fit_is_kept_too_and_goes_on_after_a_damage() {
    let desk = desk();
    let fit = "fit model.fdm --data one.csv --json -q --set k1=5 --set k2=5";
    let whole = printed(&desk, fit);
    let kept = format!("{fit} --checkpoint kept");
    assert_eq!(printed(&desk, &kept), whole);
    let newest = |slot: &str| desk.path("kept").join(format!("fit.{slot}"));
    for slot in ["1", "2"] {
        let Ok(mut bytes) = fs::read(newest(slot)) else { continue };
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x10;
        fs::write(newest(slot), bytes).unwrap();
        let output = desk.fdm(&kept);
        assert!(said(&output).contains(&format!("fit.{slot} is damaged")), "{}", said(&output));
        assert_eq!(String::from_utf8_lossy(&output.stdout), whole);
    }
}

#[test]
fn a_checkpoint_of_another_fit_is_refused_with_what_differs() {
    let desk = desk();
    let fit = "fit model.fdm --data one.csv --json -q";
    printed(&desk, &format!("{fit} --checkpoint kept"));
    let refused = |words: &str| desk.refused(&format!("{words} --checkpoint kept"));
    assert!(refused(&format!("{fit} --iterations 7")).contains("iterations: 100 there, 7 here"));
    assert!(refused(&format!("{fit} --starts 3")).contains("starts, count: 1 there, 3 here"));
    assert!(refused("fit model.fdm --data two.csv --json -q").contains("data of run `one`: there, but not here"));
    desk.write("model.fdm", MODEL.replace("k1 = 0.5", "k1 = 0.6"));
    assert!(refused(fit).contains("belongs to another fit: another model"));
    fs::create_dir(desk.path("thesis")).unwrap();
    desk.write("thesis/chapter.txt", "all of it");
    let output = desk.fdm(&format!("{fit} --checkpoint thesis"));
    assert!(said(&output).contains("holds other files (`chapter.txt`)"), "{}", said(&output));
}

/// The folder is taken away while the fit works: the fit goes on, its result is printed, and the user is warned.
#[test]
fn a_fit_outlives_its_checkpoint() {
    let desk = desk();
    let whole = printed(&desk, FIT);
    let child = desk
        .command(&format!("{FIT} --checkpoint kept"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // the lock is taken when the folder is ready
    while !desk.path("kept/identity.1").exists() {
        std::thread::sleep(Duration::from_millis(1));
    }
    fs::rename(desk.path("kept"), desk.path("gone")).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert_eq!(String::from_utf8_lossy(&output.stdout), whole);
    assert!(said(&output).contains("the work goes on"), "{}", said(&output));
    assert!(said(&output).contains("the result is complete"), "{}", said(&output));
}

#[test]
fn starts_are_told_one_by_one_and_the_best_is_the_result() {
    let desk = desk();
    let document: serde_json::Value = serde_json::from_str(&printed(&desk, FIT)).unwrap();
    let starts = document["starts"].as_array().unwrap();
    assert_eq!(starts.len(), 4);
    let costs: Vec<f64> = starts.iter().filter_map(|s| s["cost"].as_f64()).collect();
    let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
    let cost = document["cost"].as_f64().unwrap();
    assert!(cost - least <= 0.01, "{cost} is the best of {costs:?}");
    assert!(starts.iter().any(|s| s["minimum"] == 1 && s["distance"] == 0.0));
    let text = printed(&desk, &FIT.replace("--json ", ""));
    assert!(text.contains("4 starts: ") && text.contains("given"), "{text}");
}
