//! What a terminal is offered: completions, a manual, plain text where colours are not wanted, charts of braille.

use std::path::Path;
use support::command;

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
    let listed = good("--help");
    let (_, commands) = listed.split_once("Commands:\n").unwrap();
    for line in
        commands.lines().take_while(|l| !l.trim().is_empty()).filter(|l| l.starts_with("  ") && !l.starts_with("   "))
    {
        let name = line.split_whitespace().next().unwrap();
        // clap's own
        if name == "help" {
            continue;
        }
        let there = Path::new(folder.path()).join(format!("fdm-{name}.1")).is_file();
        assert!(there, "no page for {name}");
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
