//! The colours of VS Code (`editors/vscode/syntaxes`) against the compiler's own words, on every model of the repository.
//!
//! The rules of TextMate grammars that ours uses are run here: `match`, `begin`/`end`, `captures`, `include`, a line at a time.

use fancy_regex::{Captures, Regex};
use fdm_grammar::syntax::{TokenKind, tokens};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    support::repository().to_path_buf()
}

/// One rule of the grammar.
struct Rule {
    name: Option<String>,
    start: Option<Regex>,
    captures: Vec<(usize, String)>,
    end: Option<Regex>,
    end_captures: Vec<(usize, String)>,
    patterns: Vec<Value>,
}

struct Grammar {
    rules: BTreeMap<String, Rule>,
    repository: Value,
    top: Vec<Value>,
}

fn regex(rule: &Value, key: &str) -> Option<Regex> {
    rule[key].as_str().map(|text| Regex::new(text).unwrap_or_else(|e| panic!("{text}: {e}")))
}

fn captures(rule: &Value, key: &str) -> Vec<(usize, String)> {
    let entries = rule[key].as_object().into_iter().flatten();
    entries.filter_map(|(k, v)| Some((k.parse().ok()?, v["name"].as_str()?.to_string()))).collect()
}

impl Rule {
    fn new(rule: &Value) -> Self {
        let start = regex(rule, "match").or_else(|| regex(rule, "begin"));
        let key = if rule["match"].is_null() { "beginCaptures" } else { "captures" };
        Self {
            name: rule["name"].as_str().map(String::from),
            start,
            captures: captures(rule, key),
            end: regex(rule, "end"),
            end_captures: captures(rule, "endCaptures"),
            patterns: rule["patterns"].as_array().cloned().unwrap_or_default(),
        }
    }
}

impl Grammar {
    fn read() -> Self {
        let path = root().join("editors/vscode/syntaxes/fdm.tmLanguage.json");
        let text = fs::read_to_string(path).expect("the grammar");
        let grammar: Value = serde_json::from_str(&text).expect("JSON");
        let top = grammar["patterns"].as_array().expect("patterns").clone();
        let mut all = Self { rules: BTreeMap::new(), repository: grammar["repository"].clone(), top };
        all.collect(&grammar);
        all
    }

    /// Every rule, by its own text.
    fn collect(&mut self, value: &Value) {
        match value {
            Value::Object(entries) => {
                if value["match"].is_string() || value["begin"].is_string() {
                    self.rules.insert(value.to_string(), Rule::new(value));
                }
                entries.values().for_each(|v| self.collect(v));
            }
            Value::Array(list) => list.iter().for_each(|v| self.collect(v)),
            _ => {}
        }
    }

    /// The rules that patterns lead to, in their order.
    fn flat<'a>(&'a self, patterns: &[Value], into: &mut Vec<&'a Rule>) {
        for pattern in patterns {
            if let Some(name) = pattern["include"].as_str() {
                let part = &self.repository[name.trim_start_matches('#')];
                assert!(part.is_object(), "{name} is in the repository");
                self.flat(std::slice::from_ref(part), into);
            } else if let Some(rule) = self.rules.get(&pattern.to_string()) {
                into.push(rule);
            } else {
                self.flat(pattern["patterns"].as_array().map_or(&[], |p| p), into);
            }
        }
    }

    /// The scope of every byte, empty where there is none.
    fn scopes(&self, text: &str) -> Vec<String> {
        let mut scopes = vec![String::new(); text.len()];
        let mut stack: Vec<&Rule> = Vec::new();
        let mut start = 0;
        for line in text.split_inclusive('\n') {
            let mut at = 0;
            // no rule is entered and left without a step for ever
            for _ in 0..4 * line.len() + 8 {
                let Some(next) = self.step(line, at, start, &mut stack, &mut scopes) else { break };
                at = next;
            }
            start += line.len();
        }
        scopes
    }

    /// Applies the rule that matches first; returns where to go on.
    fn step<'a>(
        &'a self,
        line: &str,
        at: usize,
        start: usize,
        stack: &mut Vec<&'a Rule>,
        scopes: &mut [String],
    ) -> Option<usize> {
        let mut rules = Vec::new();
        self.flat(stack.last().map_or(&self.top, |r| &r.patterns), &mut rules);
        let find = |r: &Regex| r.captures_from_pos(line, at).expect("the search ends");
        let begin = |c: &Captures<'_, str>| c.get(0).map_or(usize::MAX, |m| m.start());
        let end = stack.last().and_then(|r| find(r.end.as_ref()?));
        let mut best: Option<(&Rule, Captures<'_, str>)> = None;
        for rule in rules {
            if let Some(found) = rule.start.as_ref().and_then(find)
                && best.as_ref().is_none_or(|(_, b)| begin(&found) < begin(b))
            {
                best = Some((rule, found));
            }
        }
        let outer = stack.last().and_then(|r| r.name.clone());
        let mut mark = |from: usize, to: usize, name: Option<&str>| {
            for scope in &mut scopes[start + from..start + to] {
                *scope = name.or(outer.as_deref()).unwrap_or_default().to_string();
            }
        };
        // the end of the rule that is open comes first where both begin
        if let Some(found) = end.filter(|e| best.as_ref().is_none_or(|(_, b)| begin(e) <= begin(b))) {
            let closed = stack.pop()?;
            let whole = found.get(0)?;
            mark(at, whole.start(), None);
            mark(whole.start(), whole.end(), closed.name.as_deref());
            for (k, name) in &closed.end_captures {
                found.get(*k).into_iter().for_each(|m| mark(m.start(), m.end(), Some(name)));
            }
            return Some(whole.end());
        }
        let Some((rule, found)) = best else {
            mark(at, line.len(), None);
            return None;
        };
        let whole = found.get(0)?;
        mark(at, whole.start(), None);
        mark(whole.start(), whole.end(), rule.name.as_deref());
        for (k, name) in &rule.captures {
            found.get(*k).into_iter().for_each(|m| mark(m.start(), m.end(), Some(name)));
        }
        if rule.end.is_some() {
            stack.push(rule);
        }
        assert!(whole.end() > at || rule.end.is_some(), "a rule that matches nothing");
        Some(whole.end())
    }
}

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
        if path.is_dir() {
            files(&path, found);
        } else if path.extension().is_some_and(|e| e == "fdm") {
            found.push(path);
        }
    }
    found.sort();
}

/// Scopes that a word of a kind may have.
fn expected(kind: TokenKind) -> &'static [&'static str] {
    match kind {
        TokenKind::Name => {
            // words of effects are names to the compiler's scanner: `nuisance` declares
            &["variable", "entity", "support.function", "constant.language", "keyword", "storage"]
        }
        TokenKind::Keyword => &["keyword", "storage"],
        TokenKind::Number => &["constant.numeric"],
        TokenKind::Text => &["string"],
        TokenKind::Unit => &["support.type.unit", "constant.numeric.index"],
        TokenKind::Sign => &["keyword.operator", "punctuation"],
        TokenKind::Open | TokenKind::Close | TokenKind::Semicolon => &["punctuation"],
        _ => &[""],
    }
}

fn compare(grammar: &Grammar, text: &str, place: &str) {
    let scopes = grammar.scopes(text);
    let (words, comments) = tokens(text);
    let fits = |scope: &str, wanted: &[&str]| wanted.iter().any(|w| scope.starts_with(w));
    for word in words {
        let wanted = expected(word.kind);
        for at in word.span.range() {
            let own = &scopes[at];
            assert!(fits(own, wanted), "{place}: `{}` at byte {at} is `{own}`, not {wanted:?}", word.text(text));
        }
    }
    for at in comments.into_iter().flat_map(|c| c.range()) {
        assert!(scopes[at].starts_with("comment"), "{place}: byte {at} of a comment is `{}`", scopes[at]);
    }
}

#[test]
fn every_word_of_every_model_has_its_colour() {
    let grammar = Grammar::read();
    let mut found = Vec::new();
    files(&root().join("models"), &mut found);
    assert!(found.len() > 60);
    for path in found {
        let text = fs::read_to_string(&path).expect("text");
        compare(&grammar, &text, &path.display().to_string());
    }
    // the broken ones: nothing hangs, and every byte has been seen
    let mut broken = Vec::new();
    files(&root().join("tests/bad"), &mut broken);
    for path in broken {
        let Ok(text) = fs::read_to_string(&path) else { continue };
        assert_eq!(grammar.scopes(&text).len(), text.len());
    }
}

#[test]
fn what_no_model_has_yet_is_coloured_too() {
    let text = "model m \"doc\" { // c
  state x[3] \"d\" [m] = free, v [1] = x[2];
  table CL(alpha [rad]) \"lift\" [1] = linear { -0.2: -0.9, 0: c0 };
  use \"a.fdm\" as act(x = dlon, T = T_act);
  der(x) = if t > 1 and not (a <= b) then A*x else [1, 2]; /* a
  b */ tie a = 2*b; time [min];
  prior a ~ normal(0, 1), x(0) ~ normal(1, 2); noise y = 1; trim { u = 1e-3; }
}
effect lag(y: output, z: state | input) unless depends(der(y), z) \"{y}\" { param T = 0 in [0, 1] try a, b; replace y with T; add der(x) += c*z; }
";
    let grammar = Grammar::read();
    compare(&grammar, text, "the text");
    let scopes = grammar.scopes(text);
    let of = |word: &str| scopes[text.find(word).expect("it is there")].as_str();
    for (word, scope) in [
        ("m \"doc", "entity.name.type.fdm"),
        ("CL(", "entity.name.function.fdm"),
        ("act(", "entity.name.namespace.fdm"),
        ("[3]", "constant.numeric.index.fdm"),
        ("[1]", "support.type.unit.fdm"),
        ("[1, 2]", "punctuation.section.brackets.fdm"),
        ("der(", "support.function.fdm"),
        ("tie", "keyword.control.fdm"),
        ("replace", "keyword.control.fdm"),
        ("try", "storage.modifier.fdm"),
        ("v [", "variable.other.fdm"),
        ("x[3]", "variable.other.definition.fdm"),
    ] {
        assert_eq!(of(word), scope, "{word}");
    }
}

#[test]
fn every_function_and_every_word_is_known() {
    let path = root().join("editors/vscode/syntaxes/fdm.tmLanguage.json");
    let text = fs::read_to_string(path).expect("the grammar");
    let words: Vec<&str> = text.split(|c: char| !(c.is_alphanumeric() || c == '_')).collect();
    // `\\b` stands before the first word of a list
    let known = |word: &str| words.iter().any(|w| *w == word || w.strip_prefix('b') == Some(word));
    for (name, _) in fdm_grammar::check::function_forms() {
        assert!(known(name), "{name}");
    }
    for (word, _) in fdm_grammar::syntax::WORDS {
        assert!(known(word), "{word}");
    }
}
