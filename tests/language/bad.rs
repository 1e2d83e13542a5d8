//! Broken models in `tests/bad/` and broken effects in `tests/bad_effects/`, each with the message that a user must get beside the mistake.
//!
//! Under a line with a mistake stand comments: carets (an arrow `<--` for what begins in the first two columns, where
//! the comment begins) with kind, code and sentence, below them the hint; dashes under the further places that a
//! message shows. `FDM_BLESS=1 cargo test --test bad` writes them anew: read the difference before committing it.

use fdm_effects::Catalogue;
use fdm_grammar::{Code, Diagnostic, Source, Span, compile, gather};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Codes that no file of the corpus can have.
const ELSEWHERE: &[Code] = &[
    // more than 64 MiB or two million words; tested beside the parser
    Code::TooLarge,
    // a file that is not text cannot hold the message as text; tested beside `Model::from_file` and in `tests/command/hostile.rs`
    Code::NotText,
];

fn corpus() -> Vec<PathBuf> {
    let root = support::repository().join("tests");
    let entries = ["bad", "bad_effects"].map(|folder| fs::read_dir(root.join(folder)).expect("the corpus"));
    let mut files: Vec<PathBuf> = entries.into_iter().flatten().flatten().map(|e| e.path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "fdm"));
    files.sort();
    files
}

/// Whether a file of the corpus holds effects.
fn holds_effects(file: &Path) -> bool {
    file.parent().is_some_and(|folder| folder.ends_with("bad_effects"))
}

/// The text with the files of `tests/bad/parts` that it uses.
fn source(text: &str) -> Source {
    let mut source = Source::new("bad.fdm", text);
    let folder = support::repository().join("tests/bad");
    gather(&mut source, &mut |name| {
        fs::read_to_string(folder.join(name)).map_err(|_| "there is no such file".to_string())
    });
    source
}

/// Every finding about a text, warnings too.
fn findings(text: &str, effects: bool) -> Vec<Diagnostic> {
    if effects {
        return Catalogue::read(&Source::new("bad.fdm", text)).1;
    }
    match compile(&source(text)) {
        Ok(compiled) => compiled.warnings,
        Err(findings) => findings,
    }
}

/// The text without expected messages: the lines `//   ^^^ ...`, `//   --- ...`, `//<-- ...`, `//   help: ...`.
fn without_messages(text: &str) -> String {
    let is_message = |line: &&str| {
        let Some(comment) = line.strip_prefix("//") else { return false };
        ["^", "<-", "-", "help: "].iter().any(|sign| comment.trim_start().starts_with(sign))
    };
    text.split_inclusive('\n').filter(|line| !is_message(line)).collect()
}

/// Where a message stands: the line, and the comment up to the words.
fn marked(source: &Source, span: Span, sign: &str) -> (usize, String) {
    let start = source.position(span.start);
    let line: Vec<char> = source.line(start.line).chars().collect();
    let width = source.slice(span).lines().next().map_or(1, |part| part.trim_end().chars().count().max(1));
    if start.column < 3 {
        return (start.line, format!("//<{}", "-".repeat(width)));
    }
    let tabs = |c: &char| if *c == '\t' { '\t' } else { ' ' };
    let pad: String = line.iter().chain(std::iter::repeat(&' ')).skip(2).take(start.column - 3).map(tabs).collect();
    (start.line, format!("//{pad}{}", sign.repeat(width)))
}

/// The text with every finding as comments under its line.
fn annotated(text: &str, effects: bool) -> String {
    let source = source(text);
    let mut below: BTreeMap<usize, String> = BTreeMap::new();
    for finding in findings(text, effects) {
        let code = finding.code.text();
        let kind = if finding.is_error() { "error" } else { "warning" };
        let (line, mark) = marked(&source, finding.span, "^");
        let comments = below.entry(line).or_default();
        comments.push_str(&format!("{mark} {kind}[{code}]: {}\n", finding.message));
        if let Some(hint) = &finding.hint {
            let pad: String = mark[2..].chars().map(|c| if c == '\t' { '\t' } else { ' ' }).collect();
            comments.push_str(&format!("//{pad} help: {hint}\n"));
        }
        // what stands in another file cannot be shown in this one
        for label in finding.labels.iter().filter(|l| source.text_at(l.span.start).used_at().is_none()) {
            let (line, mark) = marked(&source, label.span, "-");
            below.entry(line).or_default().push_str(&format!("{mark} {code}: {}\n", label.text));
        }
    }
    let mut whole = String::new();
    for (k, line) in text.split_inclusive('\n').enumerate() {
        whole.push_str(line);
        whole.push_str(&below.remove(&(k + 1)).unwrap_or_default());
    }
    // behind the last line
    whole.extend(below.into_values());
    whole
}

#[test]
fn every_mistake_is_told_at_its_place_and_nothing_else() {
    let bless = std::env::var_os("FDM_BLESS").is_some();
    let mut wrong = Vec::new();
    for file in corpus() {
        let expected = fs::read_to_string(&file).expect("the corpus is text");
        let told = annotated(&without_messages(&expected), holds_effects(&file));
        if bless && told != expected {
            fs::write(&file, &told).expect("the corpus can be written");
        } else if told != expected {
            let (k, want, got) = first_difference(&expected, &told);
            wrong.push(format!("{}:{k}:\n  expected {want}\n  told     {got}", file.display()));
        }
    }
    assert!(wrong.is_empty(), "{}\nFDM_BLESS=1 writes the messages anew", wrong.join("\n"));
}

fn first_difference<'a>(a: &'a str, b: &'a str) -> (usize, &'a str, &'a str) {
    let (mut a, mut b) = (a.lines(), b.lines());
    (1..)
        .map(|k| (k, a.next(), b.next()))
        .find(|(_, x, y)| x != y || x.is_none())
        .map_or((0, "", ""), |(k, x, y)| (k, x.unwrap_or("nothing"), y.unwrap_or("nothing")))
}

#[test]
fn every_code_occurs() {
    let texts: Vec<String> = corpus().iter().map(|f| fs::read_to_string(f).expect("text")).collect();
    assert!(texts.len() >= 40, "{} models", texts.len());
    for code in Code::ALL.iter().filter(|c| !ELSEWHERE.contains(c)) {
        let mark = format!("[{}]: ", code.text());
        assert!(texts.iter().any(|t| t.contains(&mark)), "no model has the mistake {}: {}", code.text(), code.title());
    }
}

/// The expected messages are comments: a file of the corpus gives the same findings as it stands.
#[test]
fn the_messages_themselves_change_nothing() {
    for file in corpus() {
        let text = fs::read_to_string(&file).expect("text");
        // the hint about an open comment shows the sign that closes it
        if text.contains("/*") {
            continue;
        }
        let told = |text: &str| {
            findings(text, holds_effects(&file)).into_iter().map(|f| (f.code, f.message, f.hint)).collect::<Vec<_>>()
        };
        assert_eq!(told(&text), told(&without_messages(&text)), "{}", file.display());
    }
}
