//! Results on disk: written by `fdm fit --out`, read back by `simulate`, `validate` and `compare`, refused when they are not what they
//! should be.

use serde_json::Value;
use std::fs;
use support::Desk;
use support::command::said;

const MODEL: &str = "model decay \"first order with an offset of the gauge\" {
  input u;
  state x = free;
  param k = 1 in [0, 50] [1/s], g = 1 in [-10, 10];
  param bias = 0 per run;
  der(x) = -k*x + g*u;
  output y = x + bias;
  output v = 2*x;
}
";

/// A folder with a model and three runs.
fn desk() -> Desk {
    let desk = Desk::with([("model.fdm", MODEL)]);
    for (name, start, bias, phase) in [("one", 1.0, 0.3, 0.0), ("two", -0.5, -0.2, 1.0), ("three", 0.2, 0.1, 2.0)] {
        desk.write(&format!("{name}.csv"), record(start, bias, phase));
    }
    desk
}

/// x' = -2 x + 3 u under a held square wave, exactly, with a ripple that stands for noise.
fn record(start: f64, bias: f64, phase: f64) -> String {
    let (k, g, dt) = (2.0, 3.0, 0.05);
    let mut x: f64 = start;
    let mut rows = String::from("t [s],u,y,v\n");
    for n in 0..120 {
        let u = if (0.11 * f64::from(n) + phase).sin() > 0.0 { 1.0 } else { -1.0 };
        let ripple = 0.01 * (f64::from(n * n) * 0.7 + phase).sin();
        rows.push_str(&format!("{},{u},{},{}\n", dt * f64::from(n), x + bias + ripple, 2.0 * x - ripple));
        x = (x - g / k * u) * (-k * dt).exp() + g / k * u;
    }
    rows
}

const FIT: &str = "fit model.fdm --data one.csv --data two.csv --zoh u -q";

fn value(result: &Value, name: &str, run: Option<&str>) -> f64 {
    let all = result["parameters"].as_array().unwrap();
    let found = all.iter().find(|p| p["name"] == name && p["run"].as_str() == run);
    found.unwrap_or_else(|| panic!("no {name}"))["value"].as_f64().unwrap()
}

#[test]
fn a_result_folder_holds_everything_and_nothing_is_left_beside_it() {
    let desk = desk();
    let before = desk.names("");
    let printed = desk.good(&format!("{FIT} --out result"));
    let files = "manifest.json model.fdm plot.svg quality.json result.json result.txt run_1_one.csv run_2_two.csv";
    assert_eq!(desk.names("result"), files.split(' ').collect::<Vec<_>>());
    assert_eq!(desk.names("").len(), before.len() + 1);
    let text = |name: &str| fs::read_to_string(desk.path("result").join(name)).unwrap();
    assert_eq!(text("result.txt"), printed);
    assert_eq!(text("model.fdm"), MODEL);
    assert_eq!(text("result.json"), desk.good(&format!("{FIT} --json")), "all that --json prints");
    let manifest: Value = serde_json::from_str(&text("manifest.json")).unwrap();
    assert_eq!(manifest["data"][1]["run"], "two");
    assert_eq!(manifest["data"][1]["bytes"], fs::metadata(desk.path("two.csv")).unwrap().len());
    assert_eq!(manifest["reading"]["hold"][0], "u");
    assert!(text("run_2_two.csv").starts_with("t [s],u,y,y_model,y_residual,v,v_model,v_residual\n"));
    assert_eq!(text("run_2_two.csv").lines().count(), 121);
}

#[test]
fn simulation_from_a_result_is_the_response_of_the_fit() {
    let desk = desk();
    desk.good(&format!("{FIT} --out result"));
    let fitted = desk.text("result/run_2_two.csv");
    let column = |text: &str, k: usize| -> Vec<f64> {
        text.lines().skip(1).map(|l| l.split(',').nth(k).unwrap().parse().unwrap()).collect()
    };
    // the run of that name, with the steps that are chosen again
    let again = desk.good("simulate --from-result result --data two.csv --zoh u");
    assert_eq!(column(&again, 1), column(&fitted, 3));
    assert_eq!(desk.good("simulate model.fdm --from-result result --data two.csv --zoh u"), again);
    // the data of the fit, read as the fit read them
    assert_eq!(desk.good("simulate --from-result result --like two"), again);
    let all = desk.json("simulate --from-result result --json");
    assert_eq!(all.as_array().unwrap().len(), 2);
    // a new run has no parameters of its own
    let refusal = desk.refused("simulate --from-result result --data three.csv");
    assert!(refusal.contains("runs `one`, `two`") && refusal.contains("--like RUN"), "{refusal}");
    let other = desk.good("simulate --from-result result --data three.csv --zoh u --like two");
    assert_eq!(column(&other, 1)[0], column(&again, 1)[0], "initial state and bias of run two");
    let set = desk.good("simulate --from-result result --data two.csv --zoh u --set bias=100");
    assert!(column(&set, 1)[0] > 90.0);
    assert!(desk.refused("simulate --from-result result --like four").contains("no run `four`"));
    desk.write("one.csv", record(2.0, 0.0, 0.0));
    let changed = desk.refused("simulate --from-result result --json");
    assert!(changed.contains("one.csv: changed or removed since run `one` was fitted"), "{changed}");
}

#[test]
fn one_fitted_run_lends_its_own_parameters_to_any() {
    let desk = desk();
    desk.good("fit model.fdm --data one.csv --zoh u -q --out single");
    let response = desk.good("simulate --from-result single --data three.csv --zoh u");
    let first: f64 = response.lines().nth(1).unwrap().split(',').nth(1).unwrap().parse().unwrap();
    assert!((first - 1.3).abs() < 0.05, "{first} is x(0) + bias of run one");
}

/// `--initial-from`: the beginning alone says what is a run's own, and everything behind it is predicted.
#[test]
fn initial_values_come_from_the_first_samples_alone() {
    let desk = desk();
    desk.good(&format!("{FIT} --out result"));
    let three = desk.text("three.csv");
    // `part` gives the cells of a row of time, u, y and v
    let other = |name: &str, part: &dyn Fn(f64, [&str; 4]) -> String| {
        let cells = |line: &str| -> String {
            let cells: Vec<&str> = line.split(',').collect();
            part(cells[0].parse().unwrap_or(0.0), [cells[0], cells[1], cells[2], cells[3]])
        };
        desk.write(name, three.lines().map(|line| cells(line) + "\n").collect::<String>());
    };
    let numbers = |text: &str| -> Vec<Vec<f64>> {
        text.lines().skip(1).map(|l| l.split(',').map(|cell| cell.parse().unwrap()).collect()).collect()
    };
    let simulated = |file: &str| {
        desk.good(&format!("simulate --from-result result --like two --data {file} --zoh u --initial-from 1"))
    };
    let response = simulated("three.csv");
    for (row, cells) in numbers(&response).iter().zip(numbers(&three)) {
        assert!((row[1] - cells[2]).abs() < 0.04 && (row[2] - cells[3]).abs() < 0.04, "{row:?} {cells:?}");
    }
    // run two begins elsewhere
    let like = desk.good("simulate --from-result result --like two --data three.csv --zoh u");
    assert!((numbers(&like)[0][1] - numbers(&three)[0][2]).abs() > 0.5);
    // nothing behind the beginning counts
    let far = |cell: &str| cell.parse::<f64>().unwrap() + 9.0;
    other("late.csv", &|t, [time, u, y, v]| match t > 1.0 {
        true => format!("{time},{u},{},{}", far(y), far(v)),
        false => [time, u, y, v].join(","),
    });
    assert_eq!(simulated("late.csv"), response);
    // an output without a column is predicted too
    other("no_v.csv", &|_, [time, u, y, _]| [time, u, y].join(","));
    for (row, cells) in numbers(&simulated("no_v.csv")).iter().zip(numbers(&three)) {
        assert!((row[1] - cells[2]).abs() < 0.1 && (row[2] - cells[3]).abs() < 0.1, "{row:?} {cells:?}");
    }
    let validated = |file: &str| {
        desk.json(&format!("validate --from-result result --data {file} --zoh u --initial-from 1 --json -q"))
    };
    let (whole, late) = (validated("three.csv"), validated("late.csv"));
    for (name, truth) in [("x(0)", 0.2), ("bias", 0.1)] {
        let (found, again) = (value(&whole, name, Some("three")), value(&late, name, Some("late")));
        assert!((found - truth).abs() < 0.02, "{name} = {found}");
        assert_eq!(found.to_bits(), again.to_bits(), "{name}: nothing behind the beginning counts");
    }
    let found = value(&validated("no_v.csv"), "x(0)", Some("no_v"));
    assert!((found - 0.2).abs() < 0.05, "{found} from one output");

    other("u.csv", &|_, [time, u, ..]| [time, u].join(","));
    other("blank.csv", &|t, [time, u, y, v]| {
        if t > 1.5 || time == "t [s]" { [time, u, y, v].join(",") } else { format!("{time},{u},,") }
    });
    for (command, data) in [("simulate", "--like two --data"), ("validate", "-q --data")] {
        let refused = |rest: &str| desk.refused(&format!("{command} --from-result result --zoh u {data} {rest}"));
        let short = refused("three.csv --initial-from 0.02");
        assert!(short.contains("has 1 sample in its first 0.02") && short.contains("--initial-from"), "{short}");
        let blank = refused("blank.csv --initial-from 1");
        assert!(blank.contains("run `blank`") && blank.contains("has no measured output in its first 1"), "{blank}");
        assert!(refused("three.csv --initial-from -1").contains("`-1` is not above 0"));
        assert!(refused("u.csv --initial-from 1").contains("has no measured output in its first 1"));
    }
}

#[test]
fn validation_holds_what_is_shared_and_finds_the_rest() {
    let desk = desk();
    let fit = desk.json(&format!("{FIT} --json --out result"));
    let validated = desk.json("validate model.fdm --from-result result --data three.csv --zoh u --json -q --out valid");
    for shared in ["k", "g"] {
        let (then, now) = (value(&fit, shared, None), value(&validated, shared, None));
        assert_eq!(then.to_bits(), now.to_bits(), "{shared} is held");
        assert!((now - if shared == "k" { 2.0 } else { 3.0 }).abs() < 0.02, "{shared} = {now}");
    }
    assert!((value(&validated, "bias", Some("three")) - 0.1).abs() < 0.01);
    assert!((value(&validated, "x(0)", Some("three")) - 0.2).abs() < 0.01);
    let outputs = validated["validation"]["outputs"].as_array().unwrap();
    assert_eq!(outputs.len(), 2);
    assert!(outputs.iter().all(|o| o["r2"].as_f64().unwrap() > 0.99));
    assert_eq!(validated["validation"]["fitted_outputs"].as_array().unwrap().len(), 4);
    assert!(desk.path("valid/result.txt").exists());
    let text = desk.good("validate --from-result result --data three.csv --zoh u -q --plot valid.svg");
    let rows: Vec<&str> = text.lines().map(str::trim).collect();
    assert_eq!(rows.iter().filter(|r| r.starts_with("validated  three")).count(), 2, "{text}");
    assert_eq!(rows.iter().filter(|r| r.starts_with("fitted")).count(), 4, "{text}");
    assert!(desk.path("valid.svg").exists());
    // by time and by frequency: the square wave is explained where it has its power
    assert!(text.contains("fifth 1") && text.contains("of the record explained"), "{text}");
    let lack_of_fit = validated["validation"]["lack_of_fit"].as_array().unwrap();
    assert_eq!(lack_of_fit.len(), 2);
    for m in lack_of_fit {
        assert_eq!(m["windows"].as_array().unwrap().len(), 10, "{m}");
        assert!(m["bands"].as_array().unwrap().iter().any(|b| b["explained"].as_f64().unwrap() > 0.99), "{m}");
        assert!(!m["sentences"].as_array().unwrap().is_empty(), "{m}");
    }
    let three = desk.text("three.csv");
    let kept: Vec<&str> =
        three.lines().enumerate().filter(|(k, _)| *k < 3 || k % 3 > 0).map(|(_, line)| line).collect();
    desk.write("gaps.csv", kept.join("\n") + "\n");
    let output = desk.fdm("validate --from-result result --data gaps.csv --zoh u -q");
    assert!(said(&output).contains("run `gaps` is not sampled evenly"), "{}", said(&output));
    let output = desk.fdm("validate --from-result result --data two.csv --zoh u -q");
    assert!(said(&output).contains("run `two` was part of the fit"), "{}", said(&output));
}

#[test]
fn results_of_another_model_say_what_differs() {
    let desk = desk();
    desk.good(&format!("{FIT} --out result"));
    let use_both = |model: &str| format!("{model} --from-result result --data three.csv --zoh u");
    // comments and start values are no difference
    desk.write("same.fdm", MODEL.replace("k = 1", "/* rate */ k = 7"));
    desk.good(&format!("simulate {} --like one", use_both("same.fdm")));
    desk.good(&format!("validate {} -q", use_both("same.fdm")));
    desk.write("other.fdm", MODEL.replace("-k*x +", "-k*x*abs(x) +"));
    for verb in ["simulate", "validate"] {
        let refusal = desk.refused(&format!("{verb} {}", use_both("other.fdm")));
        assert!(refusal.contains("other.fdm is not the model of the result in result"), "{refusal}");
        assert!(refusal.contains("`der(x)` is"), "{refusal}");
    }
}

#[test]
fn folders_that_are_not_results_are_refused_and_left_alone() {
    let desk = desk();
    fs::create_dir(desk.path("thesis")).unwrap();
    desk.write("thesis/result.txt", "all of it");
    let refusal = desk.refused(&format!("{FIT} --out thesis"));
    assert!(refusal.contains("thesis: left alone: fdm did not write `result.txt`"), "{refusal}");
    assert_eq!(desk.names("thesis"), ["result.txt"]);
    assert!(desk.refused("simulate --from-result thesis").contains("is not a result of fdm"));
    assert!(desk.refused("simulate --from-result none").contains("none: there is no such file or folder"));
    assert!(desk.refused(&format!("{FIT} --out model.fdm")).contains("is not a result"));
    assert!(desk.refused(&format!("{FIT} --out model.fdm/deep")).contains("a file stands where a folder is needed"));
    desk.good(&format!("{FIT} --out result"));
    let csv = desk.path("result/run_1_one.csv");
    fs::write(&csv, fs::read_to_string(&csv).unwrap().replacen('1', "2", 1)).unwrap();
    let changed = desk.refused("validate --from-result result --data three.csv");
    assert!(changed.contains("changed or missing since it was written") && changed.contains("run_1_one.csv"));
    let refusal = desk.refused(&format!("{FIT} --out result"));
    assert!(refusal.contains("`run_1_one.csv` changed since fdm wrote it"), "{refusal}");
    desk.good(&format!("{FIT} --out result --force"));
    desk.good("validate --from-result result --data three.csv --zoh u -q");
}

/// Nobody can write there, not even the superuser.
#[cfg(target_os = "linux")]
#[test]
fn places_that_cannot_be_written_are_told_before_the_work() {
    let desk = desk();
    for place in ["/proc/self/result", "/proc/result"] {
        let refusal = desk.refused(&format!("{FIT} --out {place}"));
        assert!(refusal.contains("the result folder cannot be written: /proc"), "{refusal}");
        let refusal = desk.refused(&format!("{FIT} --checkpoint {place}"));
        assert!(refusal.contains("the checkpoint cannot be kept: /proc"), "{refusal}");
    }
}

/// A disk that is full when the fit has ended: the result is printed all the same.
#[cfg(target_os = "linux")]
#[test]
fn a_result_that_cannot_be_written_at_the_end_is_printed() {
    let desk = desk();
    let printed = desk.good(FIT);
    assert!(desk.refused(&format!("{FIT} --plot none/picture.svg")).contains("none/picture.svg"));
    let output = desk.fdm(&format!("{FIT} --plot /dev/full --out result"));
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert_eq!(String::from_utf8_lossy(&output.stdout), printed);
    assert!(said(&output).contains("the result is what is printed"), "{}", said(&output));
    assert!(desk.path("result/result.json").exists(), "and what can be written is");
}

#[test]
fn the_better_model_wins_where_it_was_fitted_and_where_it_was_not() {
    let desk = desk();
    // without the input the decay is all there is
    let blind = MODEL.replace("g = 1 in [-10, 10]", "g = 0 fixed").replace("model decay", "model blind");
    desk.write("blind.fdm", blind);
    desk.good(&format!("{FIT} --out good"));
    desk.good(&format!("{} --out poor", FIT.replace("model.fdm", "blind.fdm")));
    let found = desk.json("compare poor good --data three.csv --zoh u --json -q");
    let [poor, good] = [0, 1].map(|k| found["candidates"][k].clone());
    assert_eq!(good["criteria"]["aic"], 0.0);
    let gained = 2.0 * (poor["cost"].as_f64().unwrap() - good["cost"].as_f64().unwrap());
    assert!((poor["criteria"]["aic"].as_f64().unwrap() - (gained - 2.0)).abs() < 1e-6, "{found}");
    assert_eq!(found["nestings"][0]["richer"], "good");
    assert!(found["nestings"][0]["p_value"].as_f64().unwrap() < 1e-3);
    // what validation says of the held-out run
    let validated = desk.json("validate --from-result good --data three.csv --zoh u --json -q");
    assert_eq!(found["predictions"][1]["outputs"][0]["rms"], validated["validation"]["outputs"][0]["rms"]);
    for edge in found["edges"].as_array().unwrap() {
        assert_eq!(edge["best"], "good");
        assert!(edge["advantage"]["reduction"].as_f64().unwrap() > 0.9, "{edge}");
    }
    let text = desk.good("compare poor good --data three.csv --zoh u");
    assert!(text.contains("good predicts better"), "{text}");
    let seen = desk.fdm("compare poor good --data one.csv --zoh u -q");
    assert!(said(&seen).contains("good: run `one` was part of the fit: it is no validation data"), "{}", said(&seen));
    let other = desk.good("compare good poor/../good");
    assert!(other.contains("good#2"), "{other}");
    desk.refused("compare good");
    assert!(desk.refused("compare good nothing").contains("nothing"));
}
