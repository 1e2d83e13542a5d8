//! The field's words: what help, messages, README, guide and reference call things. `words.txt` has the list.

use crate::exceptions::Found;
use fancy_regex::Regex;
use std::fs;
use std::path::PathBuf;
use support::{files, repository};

/// Phrases that are not used, in lower case, each with what stands for it.
fn phrases() -> Vec<(String, String)> {
    let list = fs::read_to_string(repository().join("tests/house/words.txt")).unwrap();
    let lines = list.lines().filter(|l| !l.starts_with('#') && !l.is_empty());
    lines
        .map(|l| l.split_once(" = ").unwrap_or_else(|| panic!("{l}: no ` = `")))
        .map(|(a, b)| (a.into(), b.into()))
        .collect()
}

/// Terms of the field in which a word of the list is right.
const FIELD: [&str; 2] = ["end-point corrections", "end-point (leakage) corrections"];

/// Texts that a user reads, by kind.
fn read_by_users() -> Vec<(&'static str, Vec<PathBuf>)> {
    let pages = |folder: &str| -> Vec<PathBuf> {
        let there = if repository().join(folder).is_dir() { files(folder, "md") } else { Vec::new() };
        // the glossary says which word stood for which
        there.into_iter().filter(|page| !page.ends_with("glossary.md")).collect()
    };
    let messages = ["tests/bad", "tests/bad_effects"].iter().flat_map(|folder| files(folder, "fdm"));
    vec![
        ("help", files("tests/suite/help", "txt")),
        ("messages", messages.chain(files("tests/suite/explain", "txt")).collect()),
        ("README", vec![repository().join("README.md")]),
        ("guide", pages("docs/guide")),
        ("reference", pages("docs/reference")),
    ]
}

fn occurrences(text: &str, phrase: &str) -> usize {
    let part_of_a_word = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(phrase)
        .filter(|(at, _)| {
            let (before, behind) = (text[..*at].chars().next_back(), text[at + phrase.len()..].chars().next());
            !before.is_some_and(part_of_a_word) && !behind.is_some_and(part_of_a_word)
        })
        .count()
}

#[test]
fn things_have_the_names_of_the_field() {
    let phrases = phrases();
    let quoted = Regex::new(r"`[^`\n]+`|\]\([^)\s]*\)").unwrap();
    let mut found = Found::default();
    for (kind, files) in read_by_users() {
        for file in files {
            // a phrase may go over the end of a line
            let text = fs::read_to_string(&file).unwrap().to_lowercase();
            // names of keys and options are quoted in pages as they are, and links lead to names of files
            let markdown = file.extension().is_some_and(|e| e == "md");
            let text = if markdown { quoted.replace_all(&text, "").into_owned() } else { text };
            let mut text = text.split_whitespace().collect::<Vec<_>>().join(" ");
            // terms of the field that hold such a word
            FIELD.iter().for_each(|term| text = text.replace(term, ""));
            let name = file.strip_prefix(repository()).unwrap().display().to_string();
            for (phrase, instead) in &phrases {
                for _ in 0..occurrences(&text, phrase) {
                    found.add(&format!("{kind}: {phrase}"), format!("{name}: rather `{instead}`"));
                }
            }
        }
    }
    found.held_to("words", "Help, messages and docs use the words of the field.");
}

#[test]
fn phrases_are_found_between_word_boundaries() {
    assert_eq!(occurrences("the rescue, rescued; a rescue", "rescue"), 2);
}
