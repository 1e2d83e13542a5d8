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
fn runs_of_the_role_validation_are_predicted_in_time_too() {
    let desk = desk();
    let turbulent = COOLING.replace("der(T)", "param q = 0.1 in [0, 10];\n  noise der(T) = q;\n  der(T)");
    desk.write("f.fdm", turbulent);
    let rms = |found: &Value| found["outputs"][0]["rms"].as_f64().unwrap();
    for words in ["fit m.fdm", "fit f.fdm --method filter-error"] {
        let found = desk.json(&format!("{words} --runs runs.csv --out result --force --json -q"));
        assert_eq!(found["validation_runs"]["outputs"][0]["run"], "four", "{words}");
        let predicted = rms(&found["validation_runs"]);
        assert!((0.04..0.07).contains(&predicted), "{words}: {predicted}");
        // as the command that does nothing else
        let validated = desk.json("validate --from-result result --runs runs.csv --json -q");
        assert_eq!(rms(&validated), predicted, "{words}");
        let page = desk.good(&format!("{words} --runs runs.csv --report page.html --force -q"));
        assert!(page.contains("validation runs, not fitted"), "{page}");
        assert!(desk.text("page.html").contains("Validation runs"));
    }
    // named by themselves, under a name that a fitted run has
    let table = "file,run,T0 [degC],make\na1.csv,one,76.85,A\na2.csv,two,46.85,A\nb1.csv,b2,66.85,B\n";
    desk.write("fitted.csv", table);
    let words = "fit m.fdm --runs fitted.csv --group make=B --known T0=310 --validation b2.csv --json -q";
    let found = desk.json(words);
    assert_eq!(found["validation_runs"]["outputs"][0]["run"], "b2 (validation)");
    let said = desk.refused("fit m.fdm --runs fitted.csv --group make=B --known T0=310 --validation b1.csv");
    assert!(said.contains("b1.csv is both fitted and validation data"), "{said}");
    let said = desk.refused("fit m.fdm --runs runs.csv --method equation-error --validation b1.csv");
    assert!(said.contains("--validation cannot be combined with --method equation-error"), "{said}");
    // what does not predict says that it leaves them aside
    let said = desk.fdm("spectra m.fdm --runs runs.csv");
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.contains("1 run(s) of --runs have the role `validation`"), "{said}");
}

#[test]
fn nothing_is_written_over_what_a_table_or_a_pattern_names() {
    let desk = desk();
    desk.write("own.toml", "[channel.Tm]\nfrom = \"Tm\"\n[channel.Ta]\nfrom = \"Ta\"\n");
    desk.write("runs.csv", "file,T0,make,map\na1.csv,350,A,own.toml\nb1.csv,340,B,\n");
    for (words, over, by) in [
        ("fit m.fdm --runs runs.csv --plot b1.csv --force", "b1.csv", "--runs"),
        ("fit m.fdm --runs runs.csv --report own.toml --force", "own.toml", "--runs"),
        ("fit m.fdm --runs runs.csv --plot runs.csv --force", "runs.csv", "--runs"),
        ("doctor --data a*.csv --fix a2.csv --force", "a2.csv", "--data"),
        ("doctor --data a1.csv --map-file own.toml --fix own.toml --force", "own.toml", "--map-file"),
        ("data a1.csv --take own.toml -o own.toml --force", "own.toml", "--take"),
    ] {
        let before = desk.text(over);
        let said = desk.refused(words);
        assert!(said.contains(&format!("would be written over {over}, which {by} reads")), "{words}: {said}");
        assert_eq!(desk.text(over), before, "{words}");
    }
}

/// A gyro that is stamped 30 ms late and a command that is stamped 20 ms late: both delays are estimated.
#[test]
fn delays_that_a_map_leaves_free_are_estimated() {
    const TEXT: &str = "model roll {
  input  u [deg];
  state  p [deg/s];
  param  L = -4 in [-20, 0] [1/s], K = 30 in [0, 100] [1/s^2];
  der(p) = L*p + K*u;
  output p_m [deg/s] = p;
}";
    let truth = TEXT.replace("= p;", "= delay(p, 0.03);").replace("K*u", "K*delay(u, skew)");
    let truth = truth.replace("  der", "  param skew = -0.02 in [-1, 1] fixed [s];\n  der");
    let desk = Desk::with([("m.fdm", TEXT.to_string()), ("truth.fdm", truth)]);
    let mut text = String::from("t [s],u [deg],p_m [deg/s]\n");
    for k in 0..600 {
        let t = 0.02 * f64::from(k);
        text.push_str(&format!("{t},{},0\n", (1.7 * t).sin() + (3.1 * t * t / 12.0).sin()));
    }
    desk.write("in.csv", text);
    desk.good("simulate truth.fdm --data in.csv -o out.csv");
    let (given, made) = (desk.text("in.csv"), desk.text("out.csv"));
    let row = |(u, p): (&str, &str)| format!("{},{}\n", u.rsplit_once(',').unwrap().0, p.split_once(',').unwrap().1);
    desk.write("one.csv", given.lines().zip(made.lines()).map(row).collect::<String>());
    let free = "[channel.u]\nfrom = \"u\"\nfree_delay = { lower = -0.1, upper = 0.1 }\n[channel.p_m]\nfrom = \"p_m\"\n";
    desk.write("map.toml", format!("{free}free_delay = {{ lower = 0, upper = 0.2, per_run = true }}\n"));
    let found = desk.json("fit m.fdm --data one.csv --map-file map.toml --set L=-3 --set K=20 --out result --json -q");
    let params = found["parameters"].as_array().unwrap();
    let of = |part: &str| params.iter().find(|p| p["name"].as_str().unwrap().contains(part)).unwrap();
    let near = |part: &str, value: f64| {
        let found = of(part)["value"].as_f64().unwrap();
        assert!((found - value).abs() < 2e-4, "{part}: {found} {found:?}");
    };
    near("tau_p_m", 0.03);
    near("tau_u", -0.02);
    assert_eq!((of("tau_p_m")["unit"].as_str(), of("tau_p_m")["run"].as_str()), (Some("s"), Some("one")));
    // the result holds the model that was fitted
    assert!(desk.text("result/model.fdm").contains("delay("), "{}", desk.text("result/model.fdm"));
    desk.good("validate --from-result result --data one.csv -q");
    desk.write("runs.csv", "file,run,map\none.csv,a,map.toml\none.csv,b,\n");
    let said = desk.refused("fit m.fdm --runs runs.csv");
    assert!(said.contains("some run has no map"), "{said}");
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
    assert!(desk.refused("fit --data a1.csv").contains("type\n  fdm fit m.fdm a1.csv"));
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
    assert!(desk.refused("fit --no-project").contains("no model and no record"));
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
