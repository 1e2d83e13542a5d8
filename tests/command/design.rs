//! `fdm design`: what it promises of a run is what a fit of that run finds.

use serde_json::Value;
use support::{Desk, repository};

const MODEL: &str = "model craft {
  input stick [deg], flap [deg];
  state q [rad/s];
  param Mq = -1.5 [1/s], Mstick = 0.2 [rad/(s^2*deg)], Mflap = 0.05 [rad/(s^2*deg)];
  der(q) = Mq*q + Mstick*stick + Mflap*flap;
  output q_m [rad/s] = q;
  noise q_m = 0.01;
}
";

#[test]
fn a_planned_run_gives_the_errors_that_were_promised() {
    let desk = Desk::with([("craft.fdm", MODEL)]);
    let design = "design craft.fdm --amplitude stick=2 --amplitude flap=0.1_rad --duration 8 --dt 0.05 --runs 1 --records plan --json -q";
    // an argument with a space, as a shell would hand it over
    let words: Vec<String> = design.split_whitespace().map(|w| w.replace('_', " ")).collect();
    let output = desk.command_of(&words).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    // the flap moves by 0.1 rad = 5.73 deg, which tells more than 2 deg of the stick, and nothing about the stick
    assert_eq!(found["steps"][0]["manoeuvre"]["input"], "stick", "0.4 rad/s^2 against 0.29");
    let outlook = |k: usize| found["outlook"][k]["then"][0].as_f64();
    assert!(outlook(0).is_some() && outlook(1).is_some() && outlook(2).is_none(), "{}", found["outlook"]);
    // the planned run, simulated and fitted: Cramer-Rao errors by the same noise
    desk.good("simulate craft.fdm --data plan/run_1.csv -o answer.csv");
    let (plan, answer) = (desk.text("plan/run_1.csv"), desk.text("answer.csv"));
    let joined: String =
        plan.lines().zip(answer.lines()).map(|(a, b)| format!("{a},{}\n", b.split_once(',').unwrap().1)).collect();
    desk.write("flown.csv", joined);
    let fit = desk.json("fit craft.fdm --data flown.csv --fix Mflap --json -q");
    for k in [0, 1] {
        let error = fit["parameters"][k]["standard_error"].as_f64().unwrap();
        assert!((outlook(k).unwrap() / error - 1.0).abs() < 1e-4, "{error}: {}", found["outlook"][k]);
    }
    // with that run made, the flap is next
    let next = desk.json("design craft.fdm --data flown.csv --amplitude stick=2 --amplitude flap=5 --runs 1 --json -q");
    assert_eq!(next["steps"][0]["manoeuvre"]["input"], "flap");
    assert!(next["undetermined_now"][0]["sentence"].as_str().unwrap().contains("`Mflap`"));
}

/// An aircraft whose states are free flies where its last run began: at rest it has no air to fly in.
#[test]
fn the_next_run_begins_where_the_first_began() {
    let desk = Desk::new();
    let of = |name: &str| repository().join("models/flight_path").join(name).display().to_string();
    let fit = ["fit", &of("joint.fdm"), &of("run.csv"), "--to=12", "--out=fit", "-q"];
    assert!(desk.command_of(fit).output().unwrap().status.success());
    let design = ["design", "--from-result=fit", "--data", &of("run.csv"), "--to=12", "--runs=1", "--json", "-q"];
    let found: Value = serde_json::from_slice(&desk.command_of(design).output().unwrap().stdout).unwrap();
    assert_eq!(found["lost"], serde_json::json!([]));
    assert!(found["steps"][0]["bits"].as_f64().unwrap() > 1.0, "{}", found["steps"]);
}

#[test]
fn what_is_missing_is_asked_for() {
    let desk = Desk::with([("craft.fdm", MODEL)]);
    for (words, expected) in [
        ("design craft.fdm --amplitude stick=2", "--duration and --dt"),
        ("design craft.fdm --duration 8 --dt 0.1", "--amplitude stick=VALUE"),
        ("design craft.fdm --duration 8 --dt 0.1 --amplitude stik=2", "did you mean `stick`?"),
        ("design craft.fdm --duration 8 --dt 5 --amplitude stick=2", "3 samples"),
        ("design craft.fdm --duration 8 --dt 0.1 --amplitude stick=0", "the height of `stick` is 0"),
        ("design craft.fdm --duration 8 --dt 0.1 --amplitude stick=two", "`two` is not a number"),
    ] {
        let said = desk.refused(words);
        assert!(said.contains(expected), "{words}: {said}");
    }
}

/// A stirred tank with a first-order reaction: its feed is moved, as a stick would be.
const REACTOR: &str = "model tank {
  input feed [mol/l];
  state A [mol/l] = 1;
  param k = 0.5 in [0.01, 10] [1/s], D = 0.2 fixed [1/s];
  reactions { A -> 0 : k*A; 0 -> A : D*feed; }
  output c [mol/l] = A;
  noise c = 0.01;
}
";

/// The same without a feed, from amounts that may be chosen.
const BATCH: &str = "model tank {
  known A0 per run [mol/l];
  state A [mol/l] = A0;
  param k = 0.5 in [0.01, 10] [1/s];
  der(A) = -k*A;
  output c [mol/l] = A;
  noise c = 0.01;
}
";

#[test]
fn chemists_are_told_of_experiments() {
    let desk = Desk::with([("tank.fdm", REACTOR), ("batch.fdm", BATCH)]);
    for plan in [
        "tank.fdm --duration 10 --dt 0.1 --amplitude feed=1 --runs 2",
        "batch.fdm --level A0=0.2..3 --samples 2 --duration 10 --runs 2",
    ] {
        let told = desk.good(&format!("design {plan} --report plan.html -q"));
        let page = desk.text("plan.html");
        // what the script draws from names runs as their files
        let page = page.split("<body>").nth(1).unwrap().split("<script").next().unwrap();
        for text in [told.as_str(), page] {
            assert!(text.contains("experiment"), "{plan}: {text}");
            assert!(["manoeuvre", "flown", "runs"].iter().all(|word| !text.contains(word)), "{plan}: {text}");
        }
        std::fs::remove_file(desk.path("plan.html")).unwrap();
    }
}

#[test]
fn experiments_are_planned_in_levels_and_times() {
    let desk = Desk::with([("batch.fdm", BATCH)]);
    let plan =
        "design batch.fdm --level A0=0.2..3 --samples 2 --duration 10 --dt 0.1 --runs 1 --records plan --json -q";
    let found = desk.json(plan);
    // A0*t*exp(-k*t) is largest at the highest amount, a time constant after the beginning
    let one = &found["experiments"][0];
    assert_eq!(one["levels"][0]["value"].as_f64(), Some(3.0), "{one}");
    let times: Vec<f64> = one["times"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
    assert!(times.len() == 2 && times.iter().all(|t| (t - 2.0).abs() <= 0.15), "{times:?}");
    assert!(desk.text("plan/run_1.csv").contains("A0"));
}
