//! What a command works on is told apart by what it is: models, results and records in any order, and slips that are answered with the
//! line to type.

use support::Desk;
use support::command::said;

const MODEL: &str = "model tank { input u; state x = 1; param k = 1; der(x) = u - k*x; output y = x; }\n";

/// The closed form of the decay with k = 1.3, and a ripple in the place of noise.
fn record(phase: u32) -> String {
    let row = |n: u32| {
        let t = f64::from(n) / 10.0;
        format!("{t},0,{}\n", (-1.3 * t).exp() + 0.002 * f64::from((n * 7 + phase) % 5) - 0.004)
    };
    format!("t,u,y\n{}", (0..60).map(row).collect::<String>())
}

fn desk() -> Desk {
    Desk::with([("tank.fdm", MODEL.to_string()), ("one.csv", record(0)), ("two.csv", record(2))])
}

#[test]
fn every_order_gives_the_same_fit() {
    let at = desk();
    let expected = at.good("fit tank.fdm --data one.csv -q");
    for words in [
        "fit tank.fdm one.csv -q",
        "fit one.csv tank.fdm -q",
        "-q fit one.csv tank.fdm",
        "fit -q --data one.csv tank.fdm",
        "fit --set k=1 one.csv -q tank.fdm",
    ] {
        assert_eq!(at.good(words), expected, "{words}");
    }
    let both = at.good("fit tank.fdm --data one.csv --data two.csv -q");
    assert_eq!(at.good("fit one.csv tank.fdm two.csv -q"), both);
    assert_eq!(at.good("doctor one.csv -q"), at.good("doctor --data one.csv -q"));
    // a model with another ending is the word beside `--data`
    at.write("tank.txt", MODEL);
    assert_eq!(at.good("fit tank.txt --data one.csv -q"), expected.replace("tank.fdm", "tank.txt"));
    // the command of a result is one that can be typed again
    at.good("fit one.csv tank.fdm -q --out found");
    assert!(at.text("found/manifest.json").contains("\"--data=one.csv\""));
    let validated = at.fdm("validate --from-result found --data two.csv -q");
    assert_eq!(at.fdm("validate two.csv found -q").stdout, validated.stdout);
    assert_eq!(at.good("simulate found -q"), at.good("simulate --from-result found -q"));
    assert_eq!(at.good("simulate found two.csv -q"), at.good("simulate --from-result found --data two.csv -q"));
    assert_eq!(at.good("modes found"), at.good("modes --from-result found"));
    assert_eq!(at.good("export found --to c"), at.good("export --from-result found --to c"));
    assert_eq!(at.good("compare found found two.csv -q"), at.good("compare found found --data two.csv -q"));
}

#[test]
fn a_project_gives_what_is_not_typed() {
    let at = desk();
    let expected = at.good("fit tank.fdm two.csv -q");
    at.write("fdm.toml", "model = \"tank.fdm\"\ndata = \"one.csv\"\n");
    assert_eq!(at.good("fit two.csv -q"), expected);
}

#[test]
fn a_slip_is_answered_with_the_line_to_type() {
    let at = desk();
    at.good("fit tank.fdm one.csv -q --out found");
    for (words, expected) in [
        ("fit one.csv", "no model among these words, which would end in .fdm: type\n  fdm fit tank.fdm one.csv"),
        ("fit --data one.csv", "type\n  fdm fit tank.fdm one.csv"),
        ("fit tank.fdm", "no record of a run: type\n  fdm fit tank.fdm RUN.csv"),
        ("fit", "no model and no record: type\n  fdm fit tank.fdm RUN.csv"),
        ("doctor", "no record of a run: type\n  fdm doctor"),
        (
            "fit tank.fdm other.fdm one.csv",
            "two models, tank.fdm and other.fdm: `fdm fit` works on one:\n  fdm fit tank.fdm one.csv",
        ),
        ("fit found one.csv", "found is a result, and `fdm fit` takes a model:\n  fdm fit found/model.fdm one.csv"),
        ("fit tank.mdl one.csv", "where it is the model, type\n  fdm fit tank.mdl --data one.csv"),
        ("simulate tank.fdm", "no record of a run: type\n  fdm simulate tank.fdm RUN.csv"),
        ("fit tank.fdm none.csv", "none.csv"),
    ] {
        let told = at.refused(words);
        assert!(told.contains(expected), "{words}: {told}");
        assert_eq!(told.lines().filter(|line| line.starts_with("error")).count(), 1, "{words}: {told}");
    }
    let empty = Desk::new();
    assert!(empty.refused("fit one.csv").contains("fdm fit MODEL.fdm one.csv\n`fdm new MODEL.fdm` writes a first one"));
}

#[test]
fn every_verb_may_be_quiet_or_say_all() {
    let at = desk();
    for words in ["simulate tank.fdm one.csv", "fit tank.fdm one.csv", "check tank.fdm", "regress tank.fdm one.csv"] {
        assert_eq!(said(&at.fdm(&format!("{words} -q"))), said(&at.fdm(&format!("--quiet {words}"))), "{words}");
        at.fdm(&format!("{words} --verbose"));
        assert_eq!(at.fdm(&format!("--verbose {words}")).status.code(), at.fdm(words).status.code(), "{words}");
    }
    assert!(said(&at.fdm("simulate tank.fdm one.csv")).contains("one: "));
    assert!(!said(&at.fdm("simulate tank.fdm one.csv -q")).contains("one: "));
}
