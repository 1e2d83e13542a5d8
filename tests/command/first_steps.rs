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
