//! Where a run begins: doses before the first sample, records that begin under way, clocks that are left in peace.

use serde_json::Value;
use support::Normal;
use support::command::Desk;

/// One compartment, an oral dose of 200 mg at time 0; closed form below.
const ORAL: &str = "model oral { time [h]; state depot [mg] = 200, amount [mg] = 0;
    param ka = 1 in [0, 20] [1/h], V = 20 in [1, 200] [L], CL = 3 in [0, 50] [L/h];
    der(depot) = -ka*depot; der(amount) = ka*depot - CL/V*amount; output conc [mg/L] = amount/V; }";
const KA: f64 = 1.2;
const V: f64 = 25.0;
const CL: f64 = 4.0;

fn oral() -> Desk {
    let desk = Desk::with([("m.fdm", ORAL)]);
    let (k, mut normal) = (CL / V, Normal(57));
    let conc = |t: f64| 200.0 * KA / (V * (KA - k)) * ((-k * t).exp() - (-KA * t).exp());
    let mut text = String::from("time [h],conc [mg/L]\n");
    for t in [0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 24.0] {
        text.push_str(&format!("{t},{}\n", conc(t) + 0.05 * normal.next()));
    }
    desk.write("r.csv", &text);
    // the record of a logger that had been on for long
    let late = |line: &str| {
        let (t, rest) = line.split_once(',').unwrap();
        t.parse::<f64>().map_or(line.to_string(), |t| format!("{},{rest}", t + 86_400.0))
    };
    desk.write("late.csv", text.lines().map(late).collect::<Vec<String>>().join("\n") + "\n");
    desk
}

fn value(result: &Value, name: &str) -> f64 {
    let own = |p: &&Value| p["name"] == name;
    result["parameters"].as_array().unwrap().iter().find(own).unwrap()["value"].as_f64().unwrap()
}

fn is_right(result: &Value) {
    for (name, truth) in [("ka", KA), ("V", V), ("CL", CL)] {
        assert!((value(result, name) / truth - 1.0).abs() < 0.05, "{name}: {}", value(result, name));
    }
}

#[test]
fn a_dose_before_the_first_sample_is_at_the_beginning_that_is_said() {
    let desk = oral();
    let (found, _) = json(&desk, "fit m.fdm --data r.csv --begin 0 --json");
    is_right(&found);
    let compared = found["outputs"][0]["compared"].as_u64();
    assert_eq!(compared, Some(14), "the beginning is no sample");
    assert!(found.get("doubted_initials").is_none(), "{}", found["doubted_initials"]);
    // a table of runs and a map say the same
    desk.write("runs.csv", "file,begin\nr.csv,0\n");
    desk.write("map.toml", "[time]\nfrom = \"time\"\nbegin = 0\n[channel.conc]\nfrom = \"conc\"\n");
    for words in ["fit m.fdm --runs runs.csv --json", "fit m.fdm --data r.csv --map-file map.toml --json"] {
        let (other, _) = json(&desk, words);
        assert_eq!(other["parameters"], found["parameters"], "{words}");
    }
    // and a project file
    desk.write("fdm.toml", "[options]\nbegin = 0\n");
    let (other, _) = json(&desk, "fit m.fdm --data r.csv --json");
    assert_eq!(other["parameters"], found["parameters"]);
    std::fs::remove_file(desk.path("fdm.toml")).unwrap();
    // the response has the row of the beginning
    let simulated = desk.good("simulate m.fdm --data r.csv --begin 0");
    assert_eq!(simulated.lines().count(), 16, "{simulated}");
}

#[test]
fn a_first_row_at_another_time_than_zero_is_said() {
    let desk = oral();
    let (found, said) = json(&desk, "fit m.fdm --data r.csv --json");
    assert!(said.contains("0.5 h, is taken for the model's time 0") && said.contains("--begin 0"), "{said}");
    assert!((value(&found, "ka") / KA - 1.0).abs() > 0.2, "what the note is about makes a difference");
    let notes = found["records"]["assumed"][0]["notes"].to_string();
    assert!(notes.contains("\"begin\""), "{notes}");
    // neither where it is said, nor of a clock whose zero means nothing
    for words in ["fit m.fdm --data r.csv --begin 0", "fit m.fdm --data r.csv --begin 0.5", "fit m.fdm --data late.csv"]
    {
        let output = desk.fdm(words);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!said.contains("is taken for the model's time 0"), "{words}: {said}");
    }
}

#[test]
fn a_beginning_behind_the_first_sample_is_refused_with_the_way_to_cut() {
    let desk = oral();
    for (words, expected) in [
        ("fit m.fdm --data r.csv --begin 1", "--from 1"),
        ("fit m.fdm --data r.csv --begin 0 --domain frequency", "leave it out"),
    ] {
        let output = desk.fdm(words);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && said.contains(expected), "{words}: {said}");
    }
    // rows between beginning and `--from` drive the model, and are not compared
    let (found, _) = json(&desk, "fit m.fdm --data r.csv --begin 0 --from 1.5 --json");
    assert_eq!(found["outputs"][0]["compared"].as_u64(), Some(11));
    is_right(&found);
}

#[test]
fn rows_that_are_left_out_or_empty_leave_the_beginning_where_it_is() {
    let desk = oral();
    let rows = std::fs::read_to_string(desk.path("r.csv")).unwrap();
    // every second row, the first of which is not the dose's either
    let (found, _) = json(&desk, "fit m.fdm --data r.csv --begin 0 --every 2 --json");
    assert_eq!(found["outputs"][0]["compared"].as_u64(), Some(7));
    is_right(&found);
    // no value in the first sample and in one more
    let emptied = |line: &str| match line.split_once(',') {
        Some((t @ ("0.5" | "3"), _)) => format!("{t},"),
        _ => line.to_string(),
    };
    desk.write("gaps.csv", rows.lines().map(emptied).collect::<Vec<String>>().join("\n") + "\n");
    let (found, said) = json(&desk, "fit m.fdm --data gaps.csv --begin 0 --json");
    assert_eq!(found["outputs"][0]["compared"].as_u64(), Some(12));
    assert!(said.contains("missing values: 2 of `conc`"), "the beginning is no missing value: {said}");
    is_right(&found);
}

#[test]
fn a_beginning_that_a_clock_cannot_mean_is_refused() {
    let desk = oral();
    let said = desk.refused("fit m.fdm --data late.csv --begin 0");
    assert!(said.contains("times the length of the record") && said.contains("--begin 86400.5"), "{said}");
    // the record's own length in front of it is no question
    desk.good("simulate m.fdm --data late.csv --begin 86390");
}

/// A small boat, surge only: quadratic drag.
const BOAT: &str = "model surge { input thrust [N]; state u [m/s] = START; const m = 50 [kg];
    param d1 = 8 [kg/s], d2 = 10 [kg/m]; der(u) = (thrust - d1*u - d2*u*abs(u))/m; output speed [m/s] = u; }";

/// A record that begins with this speed: Runge and Kutta's method, 20 steps a sample.
fn boat(first: f64, seed: u64) -> String {
    let thrust = |t: f64| 15.0 + if (8.0..17.0).contains(&t) { 50.0 } else { 0.0 };
    let (mut u, mut normal, dt) = (first, Normal(seed), 0.1);
    let mut text = String::from("t [s],thrust [N],speed [m/s]\n");
    for k in 0..300 {
        let t = dt * f64::from(k);
        text.push_str(&format!("{t},{},{}\n", thrust(t), u + 0.02 * normal.next()));
        // between samples a record is linear
        let force = |part: f64| thrust(t) + part * (thrust(t + dt) - thrust(t));
        let rate = |part: f64, u: f64| (force(part) - 10.0 * u - 15.0 * u * u.abs()) / 50.0;
        for step in 0..20 {
            let (h, at) = (dt / 20.0, f64::from(step) / 20.0);
            let half = 0.5 / 20.0;
            let k1 = rate(at, u);
            let k2 = rate(at + half, u + 0.5 * h * k1);
            let k3 = rate(at + half, u + 0.5 * h * k2);
            let k4 = rate(at + 2.0 * half, u + h * k3);
            u += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
    }
    text
}

#[test]
fn a_record_that_begins_under_way_is_the_first_remark() {
    let desk = Desk::with([("m.fdm", BOAT.replace("START", "0"))]);
    desk.write("r.csv", boat(1.7, 3));
    let (found, _) = json(&desk, "fit m.fdm --data r.csv --json");
    let (remark, doubted) = (&found["remarks"][0], &found["doubted_initials"]);
    assert_eq!(remark["about"], "initial", "{remark}");
    let said = remark["sentence"].as_str().unwrap();
    assert!(said.contains("`u` at 1.7") && said.contains("the text says 0") && said.contains("u = free"), "{said}");
    assert!(!said.contains("--begin"), "the record begins at 0: {said}");
    let first = &doubted["values"][0];
    let (value, error) = (first["found"].as_f64().unwrap(), first["error"].as_f64().unwrap());
    assert!((value - 1.7).abs() < 4.0 * error && error < 0.05, "{first}");
    let d2 = doubted["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "d2").unwrap();
    assert!((d2["value"].as_f64().unwrap() - 15.0).abs() < 1.5, "{d2}");
    // and it is the first line below the table
    let table = desk.good("fit m.fdm --data r.csv");
    let remarks = table.split("\n\n").nth(3).unwrap_or_default();
    assert!(remarks.starts_with("the record begins with `u` at 1.7"), "{table}");
}

#[test]
fn a_diagnosis_frees_what_the_record_contradicts_before_it_asks_what_the_model_lacks() {
    let desk = Desk::with([("m.fdm", BOAT.replace("START", "0"))]);
    desk.write("r.csv", boat(1.7, 3));
    let (found, _) = json(&desk, "diagnose m.fdm --data r.csv --write more.fdm --json");
    let fault = &found["mended"]["faults"][0];
    assert_eq!((&found["verdict"], &fault["fault"]), (&"record_fault".into(), &"beginning".into()), "{found}");
    assert!(fault["what"].as_str().unwrap().contains("begins at 1.7") && found["causes"][0].is_null(), "{fault}");
    let text = std::fs::read_to_string(desk.path("more.fdm")).unwrap();
    // steps at samples were taken for held, and the record was made in straight lines
    assert_eq!(text, BOAT.replace("START", "free").replace("input thrust", "input thrust linear"));
}

#[test]
fn right_initial_values_are_not_doubted() {
    let desk = Desk::with([("m.fdm", BOAT.replace("START", "1.7"))]);
    for seed in 10..18 {
        desk.write("r.csv", boat(1.7, seed));
        let (found, _) = json(&desk, "fit m.fdm --data r.csv --json");
        assert!(found.get("doubted_initials").is_none(), "{seed}: {}", found["doubted_initials"]);
    }
}

/// What is printed as JSON, and what is said beside it.
fn json(desk: &Desk, words: &str) -> (Value, String) {
    let output = desk.fdm(words);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{words}: {said}");
    (serde_json::from_slice(&output.stdout).unwrap(), said)
}
