//! The language reference keeps its word: its examples compile without a warning, its tables are complete.

use fdm_grammar::op::{Form, ROWS};
use fdm_grammar::syntax::{WORDS, WordUse};
use fdm_grammar::{Code, Source, compile, gather};
use std::fs;

fn page() -> String {
    let path = support::repository().join("docs/reference/language.md");
    fs::read_to_string(path).expect("the language reference")
}

/// The blocks between "```fdm" and "```", each with the line where it begins.
fn examples(page: &str) -> Vec<(usize, String)> {
    let mut examples: Vec<(usize, String)> = Vec::new();
    let mut open = false;
    for (k, line) in page.lines().enumerate() {
        if line.starts_with("```") {
            open = line == "```fdm";
            examples.extend(open.then(|| (k + 1, String::new())));
        } else if let Some((_, text)) = examples.last_mut().filter(|_| open) {
            text.push_str(line);
            text.push('\n');
        }
    }
    examples
}

#[test]
fn every_example_compiles_without_a_warning() {
    let examples = examples(&page());
    assert!(examples.len() >= 4, "{} examples", examples.len());
    for (line, text) in examples {
        let mut source = Source::new(format!("the example of line {line}"), text);
        let folder = support::repository();
        gather(&mut source, &mut |name| fs::read_to_string(folder.join(name)).map_err(|e| e.to_string()));
        let told = match compile(&source) {
            Ok(compiled) => compiled.warnings,
            Err(findings) => findings,
        };
        let told: Vec<String> = told.iter().map(|f| f.line(&source)).collect();
        assert!(told.is_empty(), "{}", told.join("\n"));
    }
}

#[test]
fn the_table_of_codes_is_complete() {
    let page = page();
    let (_, table) = page.split_once("| code | meaning |\n|---|---|\n").expect("the table of codes");
    let rows: Vec<&str> = table.lines().take_while(|line| line.starts_with('|')).collect();
    let wanted: Vec<String> = Code::ALL.iter().map(|c| format!("| `{}` | {} |", c.text(), c.title())).collect();
    assert_eq!(rows, wanted);
}

#[test]
fn every_function_and_every_word_is_described() {
    let page = page();
    let words: Vec<&str> = page.split(|c: char| !(c.is_alphanumeric() || c == '_')).collect();
    let functions = ROWS.iter().filter(|row| row.form == Form::Function).map(|row| row.name);
    let reserved = WORDS.iter().filter(|(_, purpose)| *purpose != WordUse::Planned).map(|(word, _)| *word);
    for word in functions.chain(reserved) {
        assert!(words.contains(&word), "`{word}` is not described");
    }
}
