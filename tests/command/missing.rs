//! Runs that do not measure what others measure, outputs that are left out, and samples that are missing.

use serde_json::Value;
use support::command::Desk;

const MODEL: &str = "model m { input u; state p = p0, r = 0; param k = 3 in [0, 20], c = 1 in [0, 10], b = 1 in [0, 10], p0 per run = 0;
    der(p) = r; der(r) = -k*p - c*r + b*u; output x = p, v = r, acc = -k*p - c*r + b*u; }";

/// The values that made the records.
const TRUTH: [(&str, f64); 3] = [("k", 4.0), ("c", 0.8), ("b", 2.0)];

/// A folder with the model and the records `both.csv`, `no_acc.csv`, `no_v.csv` (an empty column), `only_x.csv` and `slip.csv`.
fn desk() -> Desk {
    let desk = Desk::with([("m.fdm", MODEL)]);
    let names = ["x", "v", "acc"];
    for (seed, (file, columns)) in [
        ("both.csv", [Some("x"), Some("v"), Some("acc")]),
        ("no_acc.csv", [Some("x"), Some("v"), None]),
        ("no_v.csv", [Some("x"), Some(""), Some("acc")]),
        ("only_x.csv", [Some("x"), None, None]),
        ("slip.csv", [Some("x"), Some("v"), Some("acx")]),
    ]
    .into_iter()
    .enumerate()
    {
        let phase = seed as f64;
        let u = |k: usize| (0.18 * k as f64 + phase).sin() + 0.5 * (0.062 * k as f64 * (1.0 + phase)).cos();
        let inputs: String = (0..120).map(|k| format!("{},{}\n", 0.1 * k as f64, u(k))).collect();
        desk.write("input.csv", format!("t,u\n{inputs}"));
        let response = desk.good("simulate m.fdm --data input.csv --set k=4 --set c=0.8 --set b=2");
        let mut text = String::from("t,u");
        for (name, column) in names.iter().zip(columns) {
            column.iter().for_each(|title| text.push_str(&format!(",{}", if title.is_empty() { name } else { title })));
        }
        for (k, row) in response.lines().skip(1).enumerate() {
            text.push_str(&format!("\n{},{}", 0.1 * k as f64, u(k)));
            let cells = row.split(',').skip(1);
            for (o, (cell, column)) in cells.zip(columns).enumerate() {
                let noise = 0.01 * ((k * (7 + o)) as f64 * 1.7 + phase).sin();
                match column {
                    Some("") => text.push(','),
                    Some(_) => text.push_str(&format!(",{}", cell.parse::<f64>().unwrap() + noise)),
                    None => {}
                }
            }
        }
        desk.write(file, text + "\n");
    }
    desk
}

fn near_the_truth(result: &Value) {
    for (name, truth) in TRUTH {
        let own = |p: &&Value| p["name"] == name;
        let value = result["parameters"].as_array().unwrap().iter().find(own).unwrap()["value"].as_f64().unwrap();
        assert!((value / truth - 1.0).abs() < 0.02, "{name}: {value}");
    }
}

fn compared(result: &Value, output: &str, run: &str) -> u64 {
    let own = |o: &&Value| o["name"] == output && o["run"] == run;
    result["outputs"].as_array().unwrap().iter().find(own).unwrap()["compared"].as_u64().unwrap()
}

fn remarks(result: &Value) -> Vec<&str> {
    let remarks = result["remarks"].as_array().unwrap().iter().filter(|r| r["about"] == "not_measured");
    remarks.map(|r| r["sentence"].as_str().unwrap()).collect()
}

#[test]
fn runs_measure_different_outputs_in_every_method() {
    let desk = desk();
    let data = "--data both.csv --data no_acc.csv --data no_v.csv";
    for method in ["", "--domain frequency --band 0.1:1.5"] {
        let result = desk.json(&format!("fit m.fdm {data} --json -q {method}"));
        near_the_truth(&result);
        let counts = [("acc", "no_acc"), ("v", "no_v"), ("acc", "both")].map(|(o, run)| compared(&result, o, run));
        assert!(counts[0] == 0 && counts[1] == 0 && counts[2] > 0, "{counts:?}");
        assert_eq!(
            remarks(&result),
            [
                "`acc` is not compared in no_acc, where no value of it can be used",
                "`v` is not compared in no_v, where no value of it can be used"
            ]
        );
    }
    desk.write("noisy.fdm", MODEL.replace("output", "param q = 0.05 in [0, 1]; noise der(r) = q; output"));
    let filtered = "fit noisy.fdm --data both.csv --data no_acc.csv --method filter-error --fix q --json -q";
    near_the_truth(&desk.json(filtered));
    for words in ["fit m.fdm --method equation-error", "regress m.fdm", "regress m.fdm --band 0.1:1.5"] {
        near_the_truth(&desk.json(&format!("{words} {data} --json -q")));
    }
    let said = desk.fdm(&format!("fit m.fdm {data}"));
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.contains("note: run `no_acc` (no_acc.csv): the output `acc` is not measured in this run"), "{said}");
    assert!(said.contains("note: run `no_v` (no_v.csv): the output `v` is not measured in this run"), "{said}");
}

#[test]
fn a_result_is_judged_by_runs_that_measure_less() {
    let desk = desk();
    desk.good("fit m.fdm --data both.csv --data no_acc.csv --out result -q");
    let judged = desk.json("validate --from-result result --data only_x.csv --json -q");
    assert_eq!((compared(&judged, "v", "only_x"), compared(&judged, "x", "only_x")), (0, 120));
    desk.good("compare result result --data no_v.csv --data only_x.csv -q");
    desk.good("study m.fdm --data both.csv --data no_v.csv --repeats 2 -q");
    desk.good("profile m.fdm --data both.csv --data no_v.csv --parameter k -q");
    desk.good("report result -o page.html");
    assert!(desk.text("page.html").contains("is not compared in no_acc"));
}

#[test]
fn an_output_that_no_run_has_is_refused_and_can_be_left_out() {
    let desk = desk();
    let said = desk.refused("fit m.fdm --data no_acc.csv --data only_x.csv");
    assert!(said.contains("no_acc.csv: no column for the output `acc`"), "{said}");
    assert!(said.contains("only_x.csv: no column for the output `acc`"), "{said}");
    assert!(said.contains("--without-output acc") && !said.contains("output `v`"), "{said}");
    let result = desk.json("fit m.fdm --data no_acc.csv --data only_x.csv --without-output acc --json -q");
    near_the_truth(&result);
    assert_eq!(remarks(&result)[0], "`acc` is not compared: no value of it can be used");
    // measured, and left out all the same
    let result = desk.json("fit m.fdm --data both.csv --without-output acc --without-output v --json -q");
    assert_eq!((compared(&result, "v", "both"), compared(&result, "x", "both")), (0, 120));
    for words in ["regress m.fdm", "spectra m.fdm"] {
        desk.good(&format!("{words} --data no_acc.csv --without-output acc -q"));
    }
    let said = desk.refused("fit m.fdm --data both.csv --without-output ac");
    assert!(said.contains("no such output; its outputs are `x`, `v`, `acc` (did you mean `acc`?)"), "{said}");
    let said = desk.refused("fit m.fdm --data no_v.csv");
    assert!(said.contains("the output `v` has no value in any selected row (if it was not measured, say"), "{said}");
}

#[test]
fn missing_values_of_one_output_do_not_refuse_spectra() {
    let desk = desk();
    let without = |rows: std::ops::Range<usize>| -> String {
        let text = desk.text("both.csv");
        let row = |(k, line): (usize, &str)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            if rows.contains(&k) {
                cells[3] = "NaN";
            }
            cells.join(",") + "\n"
        };
        text.lines().enumerate().map(row).collect()
    };
    let words = "fit m.fdm --data gap.csv --domain frequency --band 0.1:1.5 --json -q";
    desk.write("gap.csv", without(60..63));
    let result = desk.json(words);
    near_the_truth(&result);
    let bridge = &result["frequency_domain"]["bridged"][0];
    assert_eq!((&bridge["channel"], &bridge["missing"], &bridge["longest"]), (&"v".into(), &3.into(), &3.into()));
    assert!(bridge["error"].as_f64().is_some_and(|e| e < 0.02), "{bridge}");
    let told = |result: &Value| result["remarks"].as_array().unwrap().iter().any(|r| r["about"] == "bridged");
    assert!(told(&result) && compared(&result, "v", "gap") <= compared(&result, "x", "gap"));
    // a quarter of the record is not bridged: the others are compared all the same
    desk.write("gap.csv", without(40..70));
    let result = desk.json(words);
    near_the_truth(&result);
    assert!(told(&result) && compared(&result, "v", "gap") == 0 && compared(&result, "x", "gap") > 0);
}

#[test]
fn a_slip_in_a_title_is_no_missing_output() {
    let desk = desk();
    let said = desk.refused("fit m.fdm --data both.csv --data slip.csv");
    assert!(said.contains("slip.csv: no column for the output `acc`, and `acx` looks like it"), "{said}");
    near_the_truth(&desk.json("fit m.fdm --data both.csv --data slip.csv --without-output acc --json -q"));
    // `v` and `x` are near each other, and columns of their own
    desk.good("fit m.fdm --data both.csv --data only_x.csv -q");
}

#[test]
fn a_model_without_states_knows_the_time_of_its_record() {
    let desk = Desk::with([("m.fdm", "model m { input u; param a = 1; output y = a*u; }")]);
    let rows: String = (0..120)
        .map(|k| {
            format!(
                "{},{},{}\n",
                0.02 * f64::from(k),
                (0.3 * f64::from(k)).sin(),
                (0.3 * f64::from(k)).sin() * 2.0 + 0.01 * (1.9 * f64::from(k)).cos()
            )
        })
        .collect();
    desk.write("r.csv", format!("t,u,y\n{rows}"));
    let table = desk.good("simulate m.fdm --data r.csv");
    assert!(table.lines().nth(2).is_some_and(|row| row.starts_with("0.02,")), "{table}");
    let result = desk.json("fit m.fdm --data r.csv --json -q");
    assert_eq!(result["outputs"][0]["whiteness"]["interval"], 0.02);
    // rows in any order are samples all the same
    desk.write("r.csv", "t,u,y\n3,1,2\n1,2,4\nnoon,3,6.1\n1,4,8\n");
    assert!(desk.good("simulate m.fdm --data r.csv").lines().nth(2).is_some_and(|row| row.starts_with("1,")));
}

/// A reader mends pauses and numbers that stand for missing values; the doctor tells what the record had.
#[test]
fn what_the_reader_mends_is_found_by_the_doctor_once() {
    let desk = desk();
    let text = desk.text("both.csv");
    let rows = text.lines().enumerate().filter(|(k, _)| !(61..75).contains(k));
    let marked = rows.map(|(k, line)| match (k, &line.splitn(4, ',').collect::<Vec<_>>()[..]) {
        (21 | 44 | 99, [t, u, _, rest]) => format!("{t},{u},-9999,{rest}\n"),
        _ => format!("{line}\n"),
    });
    desk.write("marked.csv", marked.collect::<String>());
    for text in
        [MODEL.to_string(), MODEL.replace("p = p0, r = 0", "p = free, r = free").replace(", p0 per run = 0", "")]
    {
        desk.write("m.fdm", text);
        let output = desk.fdm("doctor m.fdm --data marked.csv --json");
        let found: Value = serde_json::from_str(&support::command::printed(&output)).unwrap();
        let told = |fault: &str| {
            let of = |f: &&Value| f["fault"] == fault && f["severity"] == "finding";
            found["findings"].as_array().unwrap().iter().filter(of).count()
        };
        assert_eq!((told("gap"), told("sentinel")), (1, 1), "{found:#}");
        // the repair that it names is one: a part without the pause has none
        let part = desk.fdm("doctor m.fdm --data marked.csv --from 7.6 --json");
        assert!(!support::command::printed(&part).contains("\"gap\""), "{}", support::command::printed(&part));
    }
}
