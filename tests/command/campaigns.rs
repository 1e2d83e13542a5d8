//! Several runs at once: patterns, tables of runs with values and groups, masks, angles that wrap, and the project file.

use serde_json::Value;
use support::Normal;
use support::command::Desk;

const COOLING: &str = "model cooling {
  known  T0 per run [K];
  input  Ta [K];
  state  T [K] = T0;
  param  k = 0.1 in [0, 10] [1/s] per group make;
  der(T) = -k*(T - Ta);
  output Tm [K] = T;
}";

/// Four runs of two makes, which cool at 0.3 and 0.5 1/s; the first file's unit of the start is another than the model's.
fn desk() -> Desk {
    let desk = Desk::with([("m.fdm", COOLING)]);
    let mut chance = Normal(7);
    for (file, start, k) in
        [("a1.csv", 350.0, 0.3), ("a2.csv", 320.0, 0.3), ("b1.csv", 340.0, 0.5), ("b2.csv", 310.0, 0.5)]
    {
        let mut text = String::from("t [s],Ta [K],Tm [K]\n");
        for i in 0..80 {
            let t = 0.2 * f64::from(i);
            let value = 290.0 + (start - 290.0) * (-k * t).exp() + 0.05 * chance.next();
            text.push_str(&format!("{t},{},{value}\n", 290));
        }
        desk.write(file, text);
    }
    let table = "file,run,T0 [degC],make,role\na1.csv,one,76.85,A,fit\na2.csv,,46.85,A,\n# a comment\nb1.csv,three,66.85,B,fit\nb2.csv,four,36.85,B,validation\n";
    desk.write("runs.csv", table);
    desk
}

fn value(result: &Value, name: &str) -> f64 {
    let all = result["parameters"].as_array().unwrap();
    all.iter().find(|p| p["name"] == name).unwrap_or_else(|| panic!("{name} in {result}"))["value"].as_f64().unwrap()
}

#[test]
fn a_table_of_runs_brings_values_and_groups() {
    let desk = desk();
    let found = desk.json("fit m.fdm --runs runs.csv --out result --json -q");
    assert!(
        (value(&found, "k[A]") / 0.3 - 1.0).abs() < 0.01 && (value(&found, "k[B]") / 0.5 - 1.0).abs() < 0.01,
        "{found}"
    );
    let names: Vec<&str> = found["outputs"].as_array().unwrap().iter().map(|o| o["run"].as_str().unwrap()).collect();
    assert_eq!(names, ["one", "a2", "three"], "the run of the role `validation` is not fitted");
    // a result knows groups, values and files: its simulation is that of the fit
    let again = desk.json("simulate --from-result result --like three --json");
    assert!(again[0]["run"] == "three" && again.as_array().unwrap().len() == 1, "{again}");
    let validated = desk.good("validate --from-result result --runs runs.csv -q");
    assert!(validated.contains("four"), "{validated}");
    // a record alone says neither
    let said = desk.refused("validate --from-result result --data b2.csv");
    assert!(said.contains("has no `make`") && said.contains("--group make=A"), "{said}");
    desk.good("validate --from-result result --data b2.csv --group make=B --known T0=310 -q");
    let said = desk.refused("validate --from-result result --data b2.csv --group make=C --known T0=310");
    assert!(said.contains("of the make `C`") && said.contains("`A`, `B`"), "{said}");
}

#[test]
fn all_methods_know_what_a_run_brings() {
    let desk = desk();
    let turbulent = COOLING.replace("der(T)", "param q = 0.1 in [0, 10];\n  noise der(T) = q;\n  der(T)");
    desk.write("f.fdm", turbulent);
    for (words, within) in [("fit f.fdm --method filter-error", 0.02), ("fit m.fdm --domain frequency", 0.02)] {
        let found = desk.fdm(&format!("{words} --runs runs.csv --json -q"));
        let found: Value = serde_json::from_slice(&found.stdout).unwrap_or_else(|_| panic!("{words}: {found:?}"));
        assert!((value(&found, "k[B]") / 0.5 - 1.0).abs() < within, "{words}: {found}");
    }
}

#[test]
fn mistakes_in_a_table_are_told_at_once() {
    let desk = desk();
    let said = |table: &str| {
        desk.write("runs.csv", table);
        desk.refused("fit m.fdm --runs runs.csv")
    };
    let text = said("file,T1,make,role\na1.csv,3,A,fitted\nb1.csv,4,B/C,fit\n,1,A,fit\n");
    assert!(text.contains("`known T1`") && text.contains("did you mean `T0`?"), "{text}");
    assert!(
        text.contains("line 2: role `fitted`")
            && text.contains("line 3: `B/C`")
            && text.contains("line 4: the cell `file`"),
        "{text}"
    );
    assert!(said("run,T0\na,3\n").contains("no column `file`"));
    assert!(said("file,T0\n").contains("no run below the header"));
    assert!(said("file,T0,make\na1.csv,warm,A\n").contains("line 2: `T0`: "));
    assert!(said("file,T0 [m],make\na1.csv,3,A\n").contains("in `m`, and the model has it in `K`"));
    assert!(said("file,make\na1.csv,A\n").contains("--known T0=VALUE"));
    assert!(said("file,T0,make\nnone.csv,3,A\n").contains("none.csv"));
    assert!(desk.refused("fit m.fdm --runs no.csv").contains("no.csv"));
    assert!(desk.refused("fit m.fdm --data a1.csv --known T=3").contains("did you mean `T0`?"));
}

#[test]
fn patterns_find_files_in_the_order_of_the_alphabet() {
    let desk = desk();
    let found = desk.json("fit m.fdm --data a*.csv b1.csv --known T0=340 --json -q");
    let names: Vec<&str> = found["outputs"].as_array().unwrap().iter().map(|o| o["run"].as_str().unwrap()).collect();
    assert_eq!(names, ["a1", "a2", "b1"]);
    assert!(desk.refused("fit m.fdm --data c*.csv").contains("c*.csv: no file has such a name"));
    assert!(desk.refused("fit --data a1.csv m.fdm").contains("MODEL"));
}

const HEADING: &str = "model heading {
  input  r [deg/s];
  state  psi [deg] = free;
  param  g = 0.9 in [0, 5] [1];
  der(psi) = g*r;
  output psi_m [deg] wrap 360 = psi;
}";

#[test]
fn a_heading_is_compared_the_short_way_round() {
    let desk = Desk::with([("m.fdm", HEADING), ("plain.fdm", &HEADING.replace(" wrap 360", ""))]);
    let mut chance = Normal(3);
    let (mut text, mut psi) = (String::from("t [s],r [deg/s],psi_m [deg],ok\n"), 340.0);
    for i in 0..200 {
        let r = |t: f64| 3.0 * (0.02 * t).sin() + 1.0;
        let t = 0.5 * f64::from(i);
        let seen: f64 = psi + 0.5 * chance.next();
        // where it is not to be compared it is nonsense
        let ok = i % 50 > 4;
        let shown = if ok { seen.rem_euclid(360.0) } else { 7.0 };
        text.push_str(&format!("{t},{},{shown},{}\n", r(t), u8::from(ok)));
        psi += 1.25 * 0.25 * (r(t) + r(t + 0.5));
    }
    desk.write("h.csv", text);
    let found = desk.json("fit m.fdm --data h.csv --mask psi_m=ok --json -q");
    assert!((value(&found, "g") - 1.25).abs() < 0.005, "{found}");
    let rms = found["outputs"][0]["rms"].as_f64().unwrap();
    assert!((0.4..0.6).contains(&rms), "{rms}");
    let plain = desk.fdm("fit plain.fdm --data h.csv --mask psi_m=ok --json -q");
    let plain: Value = serde_json::from_slice(&plain.stdout).unwrap();
    assert!(plain["outputs"][0]["rms"].as_f64().unwrap() > 10.0 * rms, "without the word it is another fit");
    assert!(desk.refused("fit m.fdm --data h.csv --mask psi=ok").contains("did you mean `psi_m`?"));
    assert!(desk.refused("fit m.fdm --data h.csv --mask okay").contains("okay"));
}

#[test]
fn a_project_file_says_what_is_not_typed() {
    let desk = desk();
    std::fs::create_dir(desk.path("below")).unwrap();
    desk.write(
        "fdm.toml",
        "model = \"m.fdm\"\nruns = \"runs.csv\"\n[options]\niterations = 30\n[options.fit]\nintervals = true\n",
    );
    let whole = desk.good("fit m.fdm --runs runs.csv --iterations 30 --intervals --no-project -q");
    assert_eq!(desk.good("fit -q"), whole);
    let below = support::command::fdm().args(["fit", "-q"]).current_dir(desk.path("below")).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&below.stdout), whole, "{}", String::from_utf8_lossy(&below.stderr));
    assert!(String::from_utf8_lossy(&below.stderr).contains("../fdm.toml adds ../m.fdm --runs ../runs.csv"));
    // what is typed goes before it
    let typed = desk.json("fit m.fdm --data a1.csv --known T0=350 --json -q");
    assert_eq!(typed["outputs"].as_array().unwrap().len(), 1);
    assert!(desk.refused("fit --no-project").contains("MODEL"));
    for (text, wanted) in [
        ("mode = \"m.fdm\"", "mode"),
        ("[options]\niteration = 3", "did you mean `iterations`?"),
        ("[options.fti]\niterations = 3", "did you mean `fit`?"),
        ("[options.fit]\nalpha = 3", "`fdm fit` has no option --alpha"),
    ] {
        desk.write("fdm.toml", text);
        let said = desk.refused("fit m.fdm --data a1.csv");
        assert!(said.contains("fdm.toml") && said.contains(wanted), "{text}: {said}");
    }
}
