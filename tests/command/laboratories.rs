//! Tables of laboratories as they are: runs by a column, doses in rows, values below a limit.

use serde_json::Value;
use support::command::Desk;

const MODEL: &str = "model oral \"one compartment, doses by mouth\" {
  time [h];
  input dose \"amount given so far\" [mg];
  state depot [mg] = 0, amount [mg] = 0;
  param ka = 1 in [0, 20] [1/h], V = 30 in [1, 200] [L], CL = 3 in [0, 50] [L/h];
  der(depot)  = der(dose) - ka*depot;
  der(amount) = ka*depot - CL/V*amount;
  output conc [mg/L] = amount/V;
}
";

const KA: f64 = 1.5;
const V: f64 = 33.0;
const CL: f64 = 2.8;

/// The concentration a time after a dose.
fn after(dose: f64, t: f64) -> f64 {
    let k = CL / V;
    if t > 0.0 { dose * KA / V / (KA - k) * ((-k * t).exp() - (-KA * t).exp()) } else { 0.0 }
}

/// Four subjects with two doses each, 24 hours apart, as NONMEM has them; what is below `limit` is written so.
fn table(limit: f64) -> String {
    let mut text = String::from("ID,TIME,AMT,II,ADDL,DV,EVID\n");
    for (subject, dose) in [(1, 320.0), (2, 200.0), (3, 450.0), (4, 280.0)] {
        text.push_str(&format!("{subject},0,{dose},24,1,.,1\n"));
        for (k, t) in
            [0.5, 1.0, 2.0, 4.0, 8.0, 12.0, 23.5, 24.5, 26.0, 30.0, 36.0, 48.0, 60.0, 72.0].into_iter().enumerate()
        {
            let true_conc = after(dose, t) + after(dose, t - 24.0);
            let noise = 0.05 * (1.7 * (k * 5 + subject) as f64 + (k * k) as f64).sin();
            let conc = true_conc + noise;
            let cell = if conc < limit { format!("<{limit}") } else { format!("{conc:.4}") };
            text.push_str(&format!("{subject},{t},.,.,.,{cell},0\n"));
        }
    }
    text
}

fn value(result: &Value, name: &str) -> f64 {
    let parameter = result["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
    parameter["value"].as_f64().unwrap()
}

#[test]
fn a_table_of_nonmem_is_fitted_as_it_is() {
    let desk = Desk::with([("m.fdm", MODEL), ("theo.csv", &table(0.0))]);
    let found = desk.json("fit m.fdm theo.csv --runs-by ID --json");
    for (name, truth) in [("ka", KA), ("V", V), ("CL", CL)] {
        assert!((value(&found, name) / truth - 1.0).abs() < 0.01, "{name}: {}", value(&found, name));
    }
    let told = support::command::said(&desk.fdm("fit m.fdm theo.csv --runs-by ID"));
    assert!(told.contains("amount given so far, by 2 dose(s) of column `AMT`"), "{told}");
    // a model without an input for them
    let bare = MODEL
        .replace("  input dose \"amount given so far\" [mg];\n", "")
        .replace("der(dose) ", "")
        .replace("depot [mg] = 0", "depot [mg] = 320");
    desk.write("bare.fdm", bare);
    let told = support::command::said(&desk.fdm("fit bare.fdm theo.csv --runs-by ID"));
    assert!(told.contains("no input takes them") && told.contains("der(dose)"), "{told}");
}

#[test]
fn values_below_a_limit_are_censored_where_a_method_can() {
    let desk = Desk::with([("m.fdm", MODEL), ("blq.csv", &table(0.6))]);
    let found = desk.json("fit m.fdm blq.csv --runs-by ID --json");
    for (name, truth) in [("ka", KA), ("V", V), ("CL", CL)] {
        assert!((value(&found, name) / truth - 1.0).abs() < 0.01, "{name}: {}", value(&found, name));
    }
    assert!((0.01..0.1).contains(&value(&found, "sigma_conc")), "{}", value(&found, "sigma_conc"));
    let outputs = found["outputs"].as_array().unwrap();
    let count = |key: &str| outputs.iter().filter_map(|o| o[key].as_u64()).sum::<u64>();
    let below = table(0.6).matches('<').count() as u64;
    assert_eq!((count("censored"), count("compared")), (below, 4 * 14 - below));
    let told = desk.good("fit m.fdm blq.csv --runs-by ID --out kept");
    assert!(told.contains("below limit"), "{told}");
    assert!(desk.text("kept/model.fdm").contains("noise conc = sigma_conc;"));
    let told = support::command::said(&desk.fdm("validate --from-result kept --data blq.csv --runs-by ID"));
    assert!(told.contains("below their limit") && told.contains("predicted there"), "{told}");
    desk.good("fit m.fdm blq.csv --runs-by ID --below-limit missing");
    for (words, said) in [
        ("fit m.fdm blq.csv --runs-by ID --method filter-error", "--below-limit missing"),
        ("fit m.fdm blq.csv --runs-by ID --noise diagonal", "param sigma"),
        ("diagnose m.fdm blq.csv --runs-by ID", "a diagnosis cannot compare"),
        ("regress m.fdm blq.csv --runs-by ID", "--below-limit missing"),
        ("study m.fdm blq.csv --runs-by ID", "--below-limit missing"),
        ("fit m.fdm blq.csv --runs-by ID --below-limit lower", "a limit such as 0.5"),
    ] {
        let refused = desk.refused(words);
        assert!(refused.split_whitespace().collect::<Vec<_>>().join(" ").contains(said), "{words}: {refused}");
    }
    let given = desk.json("fit m.fdm blq.csv --runs-by ID --noise conc=0.035 --json");
    assert!((value(&given, "CL") / CL - 1.0).abs() < 0.01 && given["parameters"].as_array().unwrap().len() == 3);
}
