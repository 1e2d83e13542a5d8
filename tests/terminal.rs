//! What a terminal is offered: completions, a manual, plain text where colours are not wanted, charts of braille.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;
use std::process::{Command, Output};

fn fdm(words: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_fdm"));
    command.args(words.split_whitespace()).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap()
}

fn good(words: &str) -> String {
    let output = fdm(words);
    assert_eq!(output.status.code(), Some(0), "{words}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn every_shell_gets_its_completions() {
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = good(&format!("completions {shell}"));
        for word in ["diagnose", "reproduce", "compare", "--noise"] {
            assert!(script.contains(word.trim_start_matches('-')), "{shell} does not know {word}");
        }
    }
    assert_eq!(fdm("completions dos").status.code(), Some(2));
}

#[test]
fn the_manual_has_a_page_for_every_command() {
    let folder = tempfile::tempdir().unwrap();
    good(&format!("man {}", folder.path().display()));
    let page = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert!(page("fdm-fit.1").contains("filter error") || page("fdm-fit.1").contains("fe"));
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
