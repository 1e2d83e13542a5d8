//! What a terminal is offered: completions, a manual, plain text where colours are not wanted, charts of braille.

use support::command::{printed, said};
use support::{Desk, command};

fn good(words: &str) -> String {
    command::good(&mut command::at_home(words))
}

#[test]
fn every_shell_gets_its_completions() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = good(&format!("completions {shell}"));
        for word in ["diagnose", "reproduce", "compare", "--noise"] {
            assert!(script.contains(word.trim_start_matches('-')), "{shell} does not know {word}");
        }
    }
    assert_eq!(command::at_home("completions dos").output().unwrap().status.code(), Some(2));
}

#[test]
fn the_manual_has_a_page_for_every_command() {
    let folder = tempfile::tempdir().unwrap();
    good(&format!("man {}", folder.path().display()));
    let page = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert!(page("fdm-fit.1").contains("filter\\-error"));
    let command = fdm_cli::command();
    let verbs = command.get_subcommands();
    let pages = verbs.flat_map(|verb| {
        let below = verb.get_subcommands().map(|sub| format!("{}-{}", verb.get_name(), sub.get_name()));
        below.chain([verb.get_name().to_string()])
    });
    for name in pages {
        assert!(folder.path().join(format!("fdm-{name}.1")).is_file(), "no page for {name}");
    }
    assert!(good("man").contains(".TH fdm 1"));
}

#[test]
fn what_is_piped_has_no_colours_and_fits_a_terminal() {
    let text = good("fit models/ship_roll_decay/model.fdm --data models/ship_roll_decay/run.csv --every 10 --watch");
    assert!(!text.contains('\x1b'), "no colours in a pipe");
    let chart: Vec<&str> = text.lines().filter(|l| l.chars().any(|c| ('\u{2801}'..='\u{28ff}').contains(&c))).collect();
    assert!(chart.len() > 8 && chart.iter().all(|l| l.chars().count() <= 80), "{text}");
}

/// Tables, remarks and messages where the terminal has 80 or 120 columns, and 100 where there is none.
#[test]
fn what_is_printed_fits_the_terminal() {
    let roll = "models/ship_roll_decay/model.fdm models/ship_roll_decay/run.csv --every 10";
    let desk =
        Desk::with([("odd.fdm", "model odd { state x; der(x) = -a_rate_that_nothing_declares*x; output y = z; }")]);
    let odd = desk.path("odd.fdm").display().to_string();
    for (words, code) in [
        (format!("fit {roll}"), 0),
        (format!("fit {roll} --verbose --intervals --history"), 0),
        (format!("doctor {roll}"), 0),
        ("regress models/t33/model.fdm models/t33/noise_2_percent.csv".into(), 0),
        (format!("profile {roll} --parameter d1"), 0),
        ("check models/hover/model.fdm".into(), 0),
        ("modes models/hover/model.fdm".into(), 0),
        ("effects models/ship_roll_decay/linear.fdm".into(), 0),
        ("explain".into(), 0),
        ("explain E0201 W0703".into(), 0),
        (format!("check {odd}"), 2),
        (
            "fit models/ship_roll_decay/model.fdm --data none.csv --noise diagonal --noise full --integrator radau"
                .into(),
            2,
        ),
        ("fit models/ship_roll_decay/model.fdm --no-such-option --and-another".into(), 2),
    ] {
        for columns in [Some(80), Some(120), None] {
            let mut command = command::at_home(&words);
            match columns {
                Some(columns) => command.env("COLUMNS", columns.to_string()),
                None => command.env_remove("COLUMNS"),
            };
            let output = command.output().unwrap();
            assert_eq!(output.status.code(), Some(code), "{words}: {}", said(&output));
            let wide = |line: &&str| {
                let is_long = line.chars().count() > columns.unwrap_or(100);
                // a word is not broken, and a model's text stands as it was written
                is_long && line.trim().contains(' ') && !line.contains(" | ") && !line.contains("-->")
            };
            for text in [printed(&output), said(&output)] {
                let told: Vec<&str> = text.lines().filter(wide).collect();
                assert!(told.is_empty(), "{words} at {columns:?}:\n{}", told.join("\n"));
            }
        }
    }
    // JSON is for programs
    let json = good(&format!("fit {roll} --json -q"));
    assert_eq!(json.trim_end().lines().count(), 1);
}

/// Names and texts that would act on a terminal: they are shown, by every verb and in every message.
#[test]
fn nothing_in_a_model_or_a_record_acts_on_a_terminal() {
    let hostile = "\u{1b}[2J\u{1b}]0;owned\u{7}\u{9b}8m\u{202e}\u{8}";
    let model = format!(
        "model wild \"first {hostile}\" {{ input u [1] \"u {hostile}\"; param a = 1 [1] \"a {hostile}\"; output y [1] \"y {hostile}\" = a*u; }}\n"
    );
    let rows: String = (0..40)
        .map(|k| {
            format!("{},{},{}\n", f64::from(k) / 10.0, 1 + k % 3, 2.1 * f64::from(1 + k % 3) + 0.01 * f64::from(k % 7))
        })
        .collect();
    let desk = Desk::with([("wild.fdm", model.clone())]);
    let record = format!("run{hostile}.csv");
    desk.write(&record, format!("t [s],u,y,other {hostile}\n{}", rows.replace('\n', ",1\n")));
    desk.write("twice.csv", format!("t [s],u,u,y [{hostile}]\n0,1,1,1\n0,1,1,1\n"));
    desk.write("wrong.fdm", model.replace("a*u", &format!("a*{hostile}u + w + \"{hostile}\"")));
    desk.fdm("new first.fdm");
    let with = |words: &str| {
        let words = words.replace("DATA", &format!("--data {record}"));
        // the name of the record holds no white space
        let output = desk.fdm(&words);
        for (stream, text) in [("stdout", printed(&output)), ("stderr", said(&output))] {
            let acts = |c: &char| c.is_control() && !matches!(c, '\n' | '\t') || ('\u{202a}'..='\u{202e}').contains(c);
            let found = text.chars().find(acts);
            // what programs read is as it is, unless it goes to a terminal
            assert_eq!(found, None, "{words}: {stream}: {text:?}");
        }
        printed(&output) + &said(&output)
    };
    assert!(with("fit wild.fdm DATA --out result").contains("first \\u001b[2J"));
    for words in [
        "check wild.fdm",
        "check wrong.fdm",
        "check wrong.fdm --json",
        "fit wild.fdm DATA -q --json",
        "fit wild.fdm --data twice.csv",
        "fit wild.fdm --data nothing.csv DATA",
        "fit wild.fdm DATA --map y=\u{1b}[2J",
        "fit wild.fdm DATA --\u{1b}[2J",
        "simulate wild.fdm DATA --json",
        "simulate --from-result result",
        "validate --from-result result DATA -q",
        "study wild.fdm DATA --repeats 3",
        "profile wild.fdm DATA",
        "regress wild.fdm DATA",
        "spectra wild.fdm DATA --band 1:2 --segment 2",
        "diagnose wild.fdm DATA --max-effects 0 --only input_curvature",
        "design wild.fdm DATA --noise y=1 --runs 1",
        "compare result result",
        "modes wild.fdm",
        "effects wild.fdm",
        "show wild.fdm",
        "show wild.fdm --stage syntax",
        "plot result",
        "report result",
        "fmt wrong.fdm",
    ] {
        with(words);
    }
}
