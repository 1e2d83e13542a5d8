//! The verbs of somebody who begins: `new`, `show`, `explain`, `export`, as they are typed.

use fdm_grammar::Code;
use serde_json::Value;
use std::fs;
use support::Desk;

const MODEL: &str = "model swing \"a pendulum\" {
  input  push [deg/s^2];
  state  angle [deg] = 10, rate [deg/s] = free;
  const  g = 9.81 [m/s^2] \"gravity\";
  param  length = 1 in [0.1, 5] [m], tau = 0.1 in [0, 1] [s], c = 0.2 [1/s] fixed;
  param  slow = 2*tau;
  let    pull = rad2deg(g/length*sin(deg2rad(angle)));
  der(angle) = rate;
  der(rate) = delay(push, tau) - pull - (c*rate);
  output y [deg] = angle;
  trim { push = 0; angle = 0; rate = 0; }
}
";

fn desk() -> Desk {
    Desk::with([("m.fdm", MODEL)])
}

#[test]
fn a_new_model_checks_simulates_and_fits() {
    let at = Desk::new();
    let kinds = [
        ("second-order", "gain", 1.3),
        ("kinetics", "k1", 0.31),
        ("short-period", "Ma", -6.1),
        ("servo", "drive.c", 0.11),
    ];
    for (kind, name, truth) in kinds {
        let said = at.good(&format!("new my-{kind}.fdm --kind {kind}"));
        assert!(said.contains(&format!("fdm fit my-{kind}.fdm my-{kind}.csv")), "{said}");
        at.good(&format!("fmt --check my-{kind}.fdm"));
        let checked = at.fdm(&format!("check my-{kind}.fdm"));
        assert_eq!((checked.status.code(), checked.stderr.len()), (Some(0), 0), "{kind}: {checked:?}");
        let simulated = at.good(&format!("simulate my-{kind}.fdm my-{kind}.csv"));
        assert!(simulated.lines().count() > 30 && !simulated.contains("NaN"), "{simulated}");
        let fitted = at.good(&format!("fit my-{kind}.fdm --data my-{kind}.csv --json -q"));
        let fitted: Value = serde_json::from_str(&fitted).unwrap();
        let parameter = fitted["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        let value = parameter["value"].as_f64().unwrap();
        assert!((value - truth).abs() < 0.05 * truth.abs(), "{kind}: {name} is {value}, made up with {truth}");
    }
    let before = fs::read(at.path("my-short-period.fdm")).unwrap();
    assert!(at.refused("new my-short-period.fdm").contains("exists already"));
    assert_eq!(fs::read(at.path("my-short-period.fdm")).unwrap(), before);
    at.write("only.csv", "t,x\n");
    assert!(at.refused("new only.fdm").contains("only.csv"));
    assert!(!at.path("only.fdm").exists());
    assert!(at.refused("new model.txt").contains(".fdm"));
    // names that the language uses itself, and names that cannot be names
    for file in ["state.fdm", "2nd.fdm", "{{name}}.fdm", "ünicode.fdm"] {
        at.good(&format!("new {file}"));
        at.good(&format!("check {file}"));
    }
}

/// A first-order lag under a command that steps, as a logger writes it: names that are none of the language, a row of units, a text.
fn logged() -> String {
    let mut text = "Vehicle,7\nTimestamp,/drive/cmd,Speed,State,Constant\nms,V,m/s,,-\n".to_string();
    let mut speed = 0.2;
    for k in 0..200 {
        let command = if (k / 25) % 2 == 0 { 1.0 } else { -0.5 };
        let noise = 0.01 * f64::from((k * k) % 13 - 6) / 6.0;
        text += &format!("{},{command},{:.5},run,3\n", 20 * k, speed + noise);
        speed += (1.0 - (-0.02_f64 / 0.25).exp()) * (1.8 * command - speed);
    }
    text
}

#[test]
fn a_model_is_made_for_a_record_and_fits_at_once() {
    let at = Desk::with([("log.csv", logged().as_str())]);
    let said = at.good("new own.fdm --from log.csv");
    assert!(said.contains("drive_cmd [V], column `/drive/cmd`, held between samples"), "{said}");
    assert!(said.contains("outputs  Speed [m/s]") && said.contains("left out Constant"), "{said}");
    assert!(said.contains("fdm fit own.fdm log.csv --map drive_cmd=/drive/cmd"), "{said}");
    at.good("fmt --check own.fdm");
    let fitted = at.good("fit own.fdm log.csv --map drive_cmd=/drive/cmd --json -q");
    let fitted: Value = serde_json::from_str(&fitted).unwrap();
    let value = |name: &str| {
        let parameters = fitted["parameters"].as_array().unwrap();
        parameters.iter().find(|p| p["name"] == name).and_then(|p| p["value"].as_f64()).unwrap()
    };
    assert!((value("T_Speed") - 0.25).abs() < 0.01 && (value("K_Speed_drive_cmd") - 1.8).abs() < 0.02, "{fitted}");
    assert!(at.refused("new own.fdm --from log.csv").contains("exists already"));
    at.write("untimed.csv", "u,y\n1,2\n2,3\n3,5\n");
    assert!(at.refused("new other.fdm --from untimed.csv").contains("no column holds the time"));
    assert!(at.refused("new folder --from log.csv").contains(".fdm"));
}

#[test]
fn what_is_refused_names_the_option_that_opens_it() {
    let model = "model lag { input u [V]; state x = free; param K = 1, T = 0.5 in [0.01, 10] [s]; der(x) = (K*u - x)/T; output y = x; }";
    let rows = |form: &dyn Fn(i32, f64, f64) -> String| -> String {
        let y = |k: i32| 1.8 * (1.0 - (-0.08 * f64::from(k)).exp()) + 0.001 * f64::from((k * k) % 7);
        (0..60).map(|k| form(k, 1.0, y(k))).collect()
    };
    let at = Desk::with([("m.fdm", model)]);
    at.write("bare.csv", format!("u,y\n{}", rows(&|_, u, y| format!("{u},{y}\n"))));
    at.write("micro.csv", format!("timestamp,u,y\n{}", rows(&|k, u, y| format!("{},{u},{y}\n", 20_000 * k))));
    let run = |name: &str| rows(&|k, u, y| format!("{name},{},{u},{y}\n", 0.02 * f64::from(k)));
    at.write("runs.csv", format!("id,t,u,y\n{}{}", run("a"), run("b")));
    let refused = |words: &str| at.refused(words).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(refused("fit m.fdm bare.csv").contains("--rate N"));
    at.good("fit m.fdm bare.csv --rate 50 -q");
    assert!(refused("fit m.fdm micro.csv").contains("t=timestamp [UNIT]"));
    at.good("fit m.fdm micro.csv --map t=timestamp[us] -q");
    assert!(refused("fit m.fdm runs.csv").contains("--runs-by \"id\""));
    let fitted: Value = serde_json::from_str(&at.good("fit m.fdm runs.csv --runs-by id --json -q")).unwrap();
    let runs: Vec<_> =
        fitted["records"]["assumed"].as_array().into_iter().flatten().map(|r| r["run"].clone()).collect();
    assert_eq!(runs, ["runs#a", "runs#b"]);
    at.write("empty.csv", "t,x\n");
    assert!(refused("data empty.csv").contains("no rows"));
    at.write("slow.csv", format!("t,u,y\n{}", rows(&|k, u, y| format!("{},{u},{y}\n", 5 * k))));
    assert_ne!(
        at.good("extend m.fdm --effect input_delay(u)"),
        at.good("extend m.fdm --effect input_delay(u) --data slow.csv")
    );
}

#[test]
fn a_new_project_of_every_kind_fits_and_predicts() {
    let kinds = [
        ("short-period", "Ma", -6.1),
        ("lateral", "Lp", -2.6),
        ("aircraft-6dof", "aero.Cma", -0.38),
        ("helicopter-hover", "heli.tau", 0.14),
        ("quadrotor-axis", "K", 75.0),
        ("ship-mmg", "ship.Nr", -0.052),
        ("nomoto", "ship.T", 34.0),
        ("roll-decay", "ship.d2", 0.08),
        ("servo", "drive.k", 0.042),
        ("cstr", "E", 7.1e4),
        ("batch", "tank.E", 6.4e4),
        ("thermal", "body.C", 14.0),
    ];
    let at = Desk::new();
    for (kind, name, truth) in kinds {
        at.good(&format!("new {kind} --kind {kind}"));
        let model = format!("{kind}/model.fdm");
        at.good(&format!("fmt --check {model}"));
        let checked = at.fdm(&format!("check {model}"));
        assert_eq!((checked.status.code(), checked.stderr.len()), (Some(0), 0), "{kind}: {checked:?}");
        let fitted = at.good(&format!(
            "fit {model} --data {kind}/run.csv --map-file {kind}/map.toml --out {kind}/result --json -q"
        ));
        let fitted: Value = serde_json::from_str(&fitted).unwrap();
        let parameter = fitted["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
        let (value, error) = (parameter["value"].as_f64().unwrap(), parameter["standard_error"].as_f64().unwrap());
        assert!(
            (value - truth).abs() < 4.0 * error && error < 0.1 * truth.abs(),
            "{kind}: {name} is {value} ({error}), made up with {truth}"
        );
        at.good(&format!(
            "validate {model} --from-result {kind}/result --data {kind}/validation.csv --map-file {kind}/map.toml -q"
        ));
        assert!(fs::read_to_string(at.path(&format!("{kind}/README.md"))).unwrap().lines().count() <= 14);
    }
    assert!(at.refused("new servo --kind servo").contains("exists already"));
}

#[test]
fn every_stage_is_shown_to_people_and_to_programs() {
    let (at, stages) = (desk(), ["syntax", "model", "graph", "derivatives", "schedule", "code", "linear"]);
    for stage in stages {
        let json = at.good(&format!("show m.fdm --stage {stage} --json"));
        assert!(serde_json::from_str::<Value>(&json).unwrap().is_object(), "{json}");
    }
    let shown = |stage: &str, wanted: &[&str]| {
        let text = at.good(&format!("show m.fdm --stage {stage}"));
        wanted.iter().for_each(|w| assert!(text.contains(w), "--stage {stage} lacks `{w}`:\n{text}"));
    };
    // normal form: no bracket that means nothing
    shown("syntax", &["der(rate) = delay(push, tau) - pull - c*rate;", "trim {"]);
    let gravity = "= rad2deg(g/length*sin(deg2rad(angle)))";
    shown(
        "model",
        &["der(rate)", "free initial value", "in [0.1, 5]", "derived param", gravity, "angle at the trim = 0"],
    );
    shown("graph", &["der(angle) = n", "tau of delay(push, tau) = n"]);
    shown("derivatives", &["der(angle)\n  by rate  1\n", "by length", "tau of delay(push, tau)\n  by tau  1\n"]);
    shown("schedule", &["rates_and_partials: ", "known[0] = 10   angle(0)\n", "der(rate) by length = "]);
    shown(
        "linear",
        &[" A ", "-9.81", "A_delayed[der(rate), delay(push, tau)] = 1", "linearised where the model's `trim` says"],
    );
    let other = at.good("show m.fdm --stage linear --set length=2 --json");
    let other: Value = serde_json::from_str(&other).unwrap();
    let entries = other["A"]["entries"].as_array().unwrap();
    let slope = entries.iter().find(|e| e["row"] == "der(rate)" && e["column"] == "angle").unwrap();
    assert!((slope["value"].as_f64().unwrap() + 4.905).abs() < 1e-12, "{slope}");
    if cfg!(target_arch = "x86_64") {
        shown("code", &["rates_and_partials: ", "mulsd", "ret"]);
    }
    let dot = at.good("show m.fdm --stage graph --dot");
    assert!(dot.starts_with("digraph \"swing\" {") && dot.contains(" -> e0;") && dot.ends_with("}\n"));
    assert!(at.refused("show m.fdm --dot").contains("--stage graph"));
}

#[test]
fn every_code_is_explained_and_messages_say_where() {
    let at = desk();
    let list = at.good("explain");
    for code in Code::ALL {
        assert!(list.contains(&format!("{}  {}\n", code.text(), code.title())));
        let page = at.good(&format!("explain {}", code.text().to_lowercase()));
        assert!(page.starts_with(code.text()) && page.contains("The same without:"), "{page}");
    }
    assert!(at.refused("explain E02O1").contains("did you mean `E0201`?"));
    at.write("bad.fdm", MODEL.replace("2*tau", "2*tua"));
    at.write("odd.fdm", MODEL.replace("trim {", "const unused = 1; trim {"));
    let said = at.refused("check bad.fdm");
    assert!(said.ends_with("\n`fdm explain E0201` says more\n\n"), "{said}");
    let warned = String::from_utf8(at.fdm("show odd.fdm --stage syntax").stderr).unwrap();
    assert!(warned.contains("1 warning\n`fdm explain W0702` says more\n"), "{warned}");
}

#[test]
fn code_goes_to_the_terminal_or_to_a_file_that_is_not_the_model() {
    let at = desk();
    let c = at.good("export m.fdm --to c");
    assert!(c.contains("void swing_sensitivity_rates(") && c.contains("#define fdm_sin sin"));
    assert_eq!(at.good("export m.fdm --to rust -o m.rs"), "");
    let rust = at.text("m.rs");
    assert!(rust.contains("use libm as elementary;") && rust.contains("pub fn sensitivity_rates("));
    assert!(at.good("export m.fdm --to rust --elementary std").contains("x.sin()"));
    let count = |text: &str| {
        let line = text.lines().find(|l| l.starts_with("pub const F_THETA_ENTRIES")).unwrap().to_string();
        line.trim_end_matches(';').rsplit(' ').next().unwrap().parse::<usize>().unwrap()
    };
    assert_eq!(count(&at.good("export m.fdm --to rust --free c")), count(&rust) + 1);
    assert!(at.refused("export m.fdm --to c -o m.fdm").contains("written over"));
    assert_eq!(at.text("m.fdm"), MODEL);
    assert!(at.refused("export m.fdm --to rust --elementary a;b").contains("not the path"));
    assert!(at.refused("export m.fdm --to c --elementary std").contains("cc -DFDM_ELEMENTARY"));
    // a tie that is switched off is a parameter more
    at.write("tied.fdm", MODEL.replace("param  slow", "param  o = 1 [m]; tie o = 2*length; param  slow"));
    let derived = |words: &str| at.good(words).contains("DERIVED_NAMES: [&str; 2]");
    assert!(derived("export tied.fdm --to rust") && !derived("export tied.fdm --to rust --untie o"));
}
