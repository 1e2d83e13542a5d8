//! Every model of the repository is read; broken ones are read around their mistakes; the kept trees hold.

use std::fs;
use std::path::{Path, PathBuf};
use tree_sitter::{Node, Parser, Query, Tree};

fn parse(text: &str) -> Tree {
    let mut parser = Parser::new();
    parser.set_language(&tree_sitter_fdm::LANGUAGE.into()).expect("a grammar of this version");
    parser.parse(text, None).expect("a tree")
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
        if path.is_dir() && !path.ends_with("target") && !path.ends_with(".git") {
            files(&path, found);
        } else if path.extension().is_some_and(|e| e == "fdm") {
            found.push(path);
        }
    }
    found.sort();
}

fn mistakes(node: Node<'_>, found: &mut Vec<String>) {
    if node.is_error() || node.is_missing() {
        let at = node.start_position();
        found.push(format!("{}:{}: {}", at.row + 1, at.column + 1, node.to_sexp()));
    }
    let mut cursor = node.walk();
    node.children(&mut cursor).for_each(|child| mistakes(child, found));
}

#[test]
fn every_file_that_the_compiler_reads_is_read() {
    let mut found = Vec::new();
    files(&root(), &mut found);
    assert!(found.len() > 100, "the walk found the models");
    let (mut good, mut wrong) = (0, Vec::new());
    for path in found {
        let Ok(text) = fs::read_to_string(&path) else { continue };
        let tree = parse(&text);
        let source = fdm_grammar::Source::new("file", &*text);
        if fdm_grammar::syntax::parse(&source).is_ok() {
            good += 1;
            let mut places = Vec::new();
            mistakes(tree.root_node(), &mut places);
            wrong.extend(places.into_iter().map(|p| format!("{}:{p}", path.display())));
        }
        assert_eq!(tree.root_node().byte_range().end, text.len());
    }
    assert!(good > 60, "{good} files");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_reference_is_read() {
    let page = fs::read_to_string(root().join("docs/reference/language.md")).expect("the language reference");
    let examples: Vec<&str> = page.split("```fdm\n").skip(1).filter_map(|p| p.split("```").next()).collect();
    assert!(examples.len() >= 4);
    for example in examples {
        let tree = parse(example);
        assert!(!tree.root_node().has_error(), "{example}\n{}", tree.root_node().to_sexp());
    }
}

/// The cases of `test/corpus`, in the form of `tree-sitter test`: a title between lines of `=`, a text, `---`, its tree.
#[test]
fn the_corpus_holds() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("test/corpus");
    let mut count = 0;
    for file in fs::read_dir(folder).expect("the corpus").flatten() {
        let text = fs::read_to_string(file.path()).expect("text");
        let lines: Vec<&str> = text.lines().collect();
        let titles: Vec<usize> = (0..lines.len()).filter(|k| lines[*k].starts_with("===")).step_by(2).collect();
        for (k, title) in titles.iter().enumerate() {
            let case = &lines[title + 3..titles.get(k + 1).copied().unwrap_or(lines.len())];
            let middle = case.iter().position(|l| *l == "---").expect("`---` stands between text and tree");
            let wanted: Vec<&str> = case[middle + 1..].iter().flat_map(|l| l.split_whitespace()).collect();
            let wanted = wanted.join(" ").replace(" )", ")");
            let got = parse(&case[..middle].join("\n")).root_node().to_sexp();
            assert_eq!(got, wanted, "{}: {}", file.path().display(), lines[title + 1]);
            count += 1;
        }
    }
    assert!(count >= 5, "{count} cases");
}

/// The text of every `STRING` and `PATTERN` below a rule.
fn literals(rule: &serde_json::Value, found: &mut Vec<String>) {
    if matches!(rule["type"].as_str(), Some("STRING" | "PATTERN")) {
        found.extend(rule["value"].as_str().map(String::from));
    }
    match rule {
        serde_json::Value::Object(parts) => parts.values().for_each(|p| literals(p, found)),
        serde_json::Value::Array(parts) => parts.iter().for_each(|p| literals(p, found)),
        _ => {}
    }
}

#[test]
fn the_grammar_that_is_built_is_the_one_that_is_written() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let written = fs::read_to_string(folder.join("grammar.js")).expect("the grammar");
    let built = fs::read_to_string(folder.join("src/grammar.json")).expect("what is built from it");
    let built: serde_json::Value = serde_json::from_str(&built).expect("JSON");
    let rules = built["rules"].as_object().expect("rules");
    let (_, body) = written.split_once("  rules: {").expect("the rules");
    // a rule begins with its name, four spaces in
    let names = body.lines().filter_map(|l| l.strip_prefix("    ")?.split_once(": ("));
    let names: Vec<&str> =
        names.map(|(name, _)| name).filter(|n| !n.contains(|c: char| !c.is_alphanumeric() && c != '_')).collect();
    assert_eq!(names.len(), rules.len(), "run `tree-sitter generate --no-parser`");
    for (name, rule) in rules {
        assert!(names.contains(&name.as_str()), "{name}: run `tree-sitter generate --no-parser`");
        let mut found = Vec::new();
        literals(rule, &mut found);
        for text in found {
            let quoted = [format!("'{text}'"), format!("/{text}/")];
            assert!(quoted.iter().any(|q| body.contains(q)), "{name}: `{text}` is not in grammar.js");
        }
    }
}

#[test]
fn what_editors_colour_exists() {
    let query =
        Query::new(&tree_sitter_fdm::LANGUAGE.into(), tree_sitter_fdm::HIGHLIGHTS).expect("a query of this grammar");
    assert!(query.capture_names().contains(&"variable.definition"));
    // every function of the language is a builtin, every word a keyword
    let words: Vec<&str> = tree_sitter_fdm::HIGHLIGHTS.split('"').skip(1).step_by(2).collect();
    for (name, _) in fdm_grammar::check::function_forms() {
        assert!(words.contains(&name), "{name}");
    }
    let roles = fdm_grammar::syntax::Role::ALL.map(|r| r.keyword());
    for (word, _) in fdm_grammar::syntax::WORDS {
        assert!(words.contains(word) || roles.contains(word), "{word}");
    }
}

#[test]
fn broken_text_leaves_the_rest_readable() {
    let tree = parse("model m { param a = ; state x [m]; output y = x; ");
    let whole = tree.root_node().to_sexp();
    assert!(tree.root_node().has_error() && whole.contains("(unit)"), "{whole}");
    for text in ["", "}", "\"", "/*", "model", "effect a(", &"(".repeat(10_000)] {
        parse(text);
    }
}
