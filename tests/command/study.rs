//! `fdm study`: how the command ends, what it prints, and that an interruption changes no bit.

use serde_json::Value;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;
use support::Desk;
use support::command::{at_home, printed, said};

const MODEL: &str = "model decay { state x = free; param k = 0.5 in [0, 10] [1/s], c = 0.1;
    der(x) = -k*x; output y = x + c; }";

fn desk() -> Desk {
    let desk = Desk::with([("decay.fdm", MODEL)]);
    let mut rows = String::from("t [s],y\n");
    for n in 0..60 {
        let (t, noise) = (0.1 * f64::from(n), 0.02 * (f64::from(n * n) * 0.7).sin());
        rows.push_str(&format!("{t},{}\n", 2.0 * (-0.8 * t).exp() + 0.2 + noise));
    }
    desk.write("run.csv", rows);
    desk
}

const STUDY: &str = "study decay.fdm --data run.csv -q";

#[test]
fn a_study_says_what_intervals_are_worth() {
    let desk = desk();
    let out = desk.fdm(&format!("{STUDY} --repeats 200 --json --out kept"));
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    let study = &document["study"];
    assert_eq!((study["asked"].as_u64(), study["converged"].as_u64()), (Some(200), Some(200)));
    let parameters = study["parameters"].as_array().unwrap();
    let names: Vec<&str> = parameters.iter().map(|p| p["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["x(0)", "k", "c"]);
    for p in parameters {
        assert_eq!(p["intervals"].as_array().unwrap().len(), 2, "{p}");
        for interval in p["intervals"].as_array().unwrap() {
            let (cover, ratio) = (interval["coverage"]["share"].as_f64().unwrap(), interval["ratio"].as_f64().unwrap());
            // a coverage of 200 is known to 1.5 %, a scatter to 5 %
            assert!((0.88..=1.0).contains(&cover) && (0.8..1.25).contains(&ratio), "{p}");
        }
        assert!(p["bias"].as_f64().unwrap().abs() < 0.3, "{p}");
    }
    let csv = desk.text("kept/repeats.csv");
    assert_eq!(csv.lines().count(), 201);
    assert!(
        csv.starts_with("\"repeat\",\"converged\",\"x(0) of run\",\"x(0) of run: Cramer-Rao error\""),
        "{csv:.200}"
    );
    for file in ["study.json", "result.txt", "fit.txt", "manifest.json"] {
        assert!(desk.path("kept").join(file).is_file(), "{file}");
    }
    assert!(study["requirements"].is_null() && study["no_requirements"].is_null(), "{study}");
    // the folder is the result of the fit too
    let again = desk.fdm("simulate --from-result kept --data run.csv");
    assert_eq!(again.status.code(), Some(0), "{}", said(&again));

    let table = printed(&desk.fdm(&format!("{STUDY} --repeats 200")));
    for word in ["parameter", "bias", "scatter", "Cramer-Rao", "corrected", "covers %", "200 repeats with white noise"]
    {
        assert!(table.contains(word), "{word}\n{table}");
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads_and_any_interruption() {
    let desk = desk();
    let study = format!("{STUDY} --repeats 300 --noise-colour fitted --seed 4 --json");
    let whole = desk.fdm(&study);
    assert_eq!(desk.fdm(&format!("{study} --threads 1")).stdout, whole.stdout);
    assert_ne!(desk.fdm(&study.replace("--seed 4", "--seed 5")).stdout, whole.stdout);
    for after in [150, 400, 900] {
        let words = format!("{study} --checkpoint kept");
        let mut child = desk.command(&words).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(after));
        let _ = child.kill();
        let _ = child.wait();
    }
    assert_eq!(desk.fdm(&format!("{study} --checkpoint kept")).stdout, whole.stdout);
    // what is there is there
    let begun = std::time::Instant::now();
    assert_eq!(desk.fdm(&format!("{study} --checkpoint kept")).stdout, whole.stdout);
    assert!(begun.elapsed() < Duration::from_secs(20));
    let other = desk.fdm(&format!("{STUDY} --repeats 300 --seed 5 --checkpoint kept"));
    assert_eq!(other.status.code(), Some(2));
    assert!(said(&other).contains("belongs to another fit"), "{}", said(&other));
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_with_the_repeats_that_are_done() {
    let desk = desk();
    let words = "study decay.fdm --data run.csv --repeats 1000000 --json -q --checkpoint kept";
    let child = desk.command(words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let kept = desk.path("kept").join("repeats.1");
    wait_for(&kept);
    let pid = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(1), "{}", said(&out));
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    let done = document["study"]["done"].as_u64().unwrap();
    assert!(done > 0 && done < 1_000_000, "{done}");
    assert_eq!(document["study"]["asked"], 1_000_000);
}

#[cfg(unix)]
fn wait_for(file: &Path) {
    for _ in 0..600 {
        if file.is_file() {
            return;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    panic!("nothing was kept at {}", file.display());
}

#[test]
fn what_cannot_be_studied_is_wrong_input() {
    let desk = desk();
    let says = |words: &str, code: i32, sentence: &str| {
        let out = desk.fdm(words);
        assert_eq!(out.status.code(), Some(code), "{words}: {}", said(&out));
        assert!(said(&out).contains(sentence), "{words}: {}", said(&out));
    };
    says(&format!("{STUDY} --repeats 1"), 2, "--repeats");
    says(&format!("{STUDY} --noise-colour green"), 2, "pink");
    says(&format!("{STUDY} --fix x(0) --fix k --fix c"), 2, "no parameter is free");
    says(&format!("{STUDY} --set k=20"), 2, "bounds");
    let exact: String = (0..20).map(|n| format!("{},{}\n", 0.1 * f64::from(n), (-0.05 * f64::from(n)).exp())).collect();
    desk.write("exact.csv", format!("t [s],y\n{exact}"));
    says("study decay.fdm --data exact.csv -q --repeats 5", 2, "no noise to draw");
}

#[test]
fn a_profile_says_how_far_a_parameter_may_go() {
    let desk = desk();
    let out = desk.fdm("profile decay.fdm --data run.csv --parameter k --parameter c -q --json --plot k.svg");
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let profiles: Value = serde_json::from_slice(&out.stdout).unwrap();
    for (profile, name) in profiles.as_array().unwrap().iter().zip(["k", "c"]) {
        assert_eq!(profile["name"], name);
        let (value, by_error) = (profile["value"].as_f64().unwrap(), &profile["by_error"]);
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let (end, straight) = (profile["ends"][side]["at"].as_f64().unwrap(), by_error[side].as_f64().unwrap());
            let ratio = (end - value) / (straight - value);
            assert!((0.8..1.25).contains(&ratio) && (end - value) * sign > 0.0, "{name} {ratio}");
        }
        assert!(profile["points"].as_array().unwrap().len() >= 9 && profile["refits"].as_u64().unwrap() < 40);
    }
    assert!(desk.text("k.svg").starts_with("<svg"));
    let table = desk.fdm("profile decay.fdm --data run.csv -q");
    for word in ["95 % by error", "95 % by cost", "refits"] {
        assert!(printed(&table).contains(word), "{}", printed(&table));
    }
    let wrong = desk.fdm("profile decay.fdm --data run.csv -q --parameter kk");
    assert_eq!(wrong.status.code(), Some(2));
    assert!(said(&wrong).contains("no such parameter"), "{}", said(&wrong));
}

#[test]
fn reference_systems_are_repeated() {
    let out = at_home("reproduce elovich --repeats 40 --noise-colour white --json").output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let studies: Value = serde_json::from_slice(&out.stdout).unwrap();
    let study = &studies[0];
    assert_eq!((study["name"].as_str(), study["done"].as_u64()), (Some("elovich"), Some(40)));
    // two steps of two parameters; the step without noise is none
    assert_eq!(study["parameters"].as_array().unwrap().len(), 4);
    let cover = study["pooled"][1]["coverage"].as_f64().unwrap();
    assert!((0.85..=1.0).contains(&cover), "{cover}");
    let truths: Vec<f64> =
        study["parameters"].as_array().unwrap().iter().map(|p| p["truth"].as_f64().unwrap()).collect();
    assert_eq!(truths, [7.79, 0.0146, 7.09, 0.0388]);
    // measured records: what the fit says of them
    let out = at_home("reproduce gas_oil --repeats 10 --markdown").output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    assert!(printed(&out).contains("| gas_oil | the described | 10 | 3 |"), "{}", printed(&out));
    for (words, sentence) in [
        ("reproduce elovich --noise-colour pink", "--noise-colour belongs to --repeats"),
        ("reproduce elovich --repeats 10 --noise-colour fitted", "belongs to `fdm study`"),
    ] {
        let out = at_home(words).output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{words}");
        assert!(said(&out).contains(sentence), "{words}: {}", said(&out));
    }
}

#[test]
fn a_study_says_what_intervals_of_requirements_are_worth() {
    let desk = desk();
    let asked = "requirement half [s] = time_to_half(x) in [0.5, 1], left = at(y, 2, hold(u, 0));";
    let text = MODEL.replace("output y", &format!("input u; {} output y", asked)).replace("= -k*x", "= -k*x + c*u");
    desk.write("decay.fdm", text);
    let rows =
        desk.text("run.csv").replace("t [s],y", "t [s],u,y").replace(",", ",0,").replace("t [s],0,u,0,y", "t [s],u,y");
    desk.write("run.csv", rows);
    let out = desk.fdm(&format!("{STUDY} --repeats 100 --json --out kept"));
    assert_eq!(out.status.code(), Some(0), "{}", said(&out));
    let document: Value = serde_json::from_slice(&out.stdout).unwrap();
    let requirements = document["study"]["requirements"].as_array().unwrap();
    assert_eq!(requirements.iter().map(|r| r["name"].as_str().unwrap()).collect::<Vec<_>>(), ["half", "left"]);
    for r in requirements {
        assert_eq!(r["coverage"]["of"], 100, "{r}");
        assert!((0.85..=1.0).contains(&r["coverage"]["share"].as_f64().unwrap()), "{r}");
    }
    // the truth is what `fdm margins` says of the fit that is repeated
    let margins: Value = serde_json::from_str(&desk.good("margins kept --json")).unwrap();
    assert_eq!(margins["requirements"][0]["value"], requirements[0]["truth"]);
    assert!(desk.text("kept/repeats.csv").lines().next().unwrap().ends_with("\"requirement left: high\""));
    let text = desk.text("kept/result.txt");
    assert!(text.contains("half width") && text.contains("nominal 95 % intervals of requirements"), "{text}");
    desk.good("report kept -o page.html");
    assert!(desk.text("page.html").contains("What intervals of requirements are worth"));
}
