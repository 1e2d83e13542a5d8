//! Edits of a text: nothing is written anew that was not changed.
//!
//! Names of what an effect brings into a model: telling ones that the model does not have.
//!
//! Start values of a text: what was estimated takes their place, and nothing else is touched.

use crate::subject::Subject;
use fdm_grammar::check::function_form;
use fdm_grammar::source::{Source, Span};
use fdm_grammar::syntax::{Expr, ExprRef, Role, StatementKind, SyntaxTree, Value, value_extent, word_use};
use std::collections::HashSet;
use std::ops::Range;

/// Text for a range of bytes; an empty range is an insertion.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Edit {
    range: Range<usize>,
    text: String,
}

/// What a new line declares; it goes beside its like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Line {
    /// A declaration.
    Declare(Role),
    /// `der(m) = ...;`
    Equation,
}

/// Collects edits of one text.
pub(super) struct Editor<'a> {
    text: &'a str,
    tree: &'a SyntaxTree,
    edits: Vec<Edit>,
}

impl<'a> Editor<'a> {
    pub(super) fn new(text: &'a str, tree: &'a SyntaxTree) -> Self {
        Self { text, tree, edits: Vec::new() }
    }

    /// The text of a value with the brackets around it, of an expression at the root of a statement.
    pub(super) fn value(&self, statement: Span, root: ExprRef) -> Range<usize> {
        value_extent(self.text, statement, self.tree.span(root)).range()
    }

    /// Puts a text in the place of a range.
    pub(super) fn replace(&mut self, range: Range<usize>, text: impl Into<String>) {
        self.edits.push(Edit { range, text: text.into() });
    }

    /// Takes a range out of its place: its text with the edits inside it, which are done with.
    pub(super) fn take(&mut self, range: &Range<usize>) -> String {
        let inside = |e: &Edit| e.range.start >= range.start && e.range.end <= range.end;
        let (mut own, rest): (Vec<Edit>, Vec<Edit>) = std::mem::take(&mut self.edits).into_iter().partition(inside);
        self.edits = rest;
        own.iter_mut().for_each(|e| e.range = e.range.start - range.start..e.range.end - range.start);
        applied(&self.text[range.clone()], own)
    }

    /// New lines behind the last of their like, or where a careful writer would begin with them.
    pub(super) fn insert(&mut self, line: Line, lines: &[String]) {
        if lines.is_empty() {
            return;
        }
        let likes: &[&[Line]] = match line {
            Line::Declare(Role::State) => &[&[Line::Declare(Role::State)], &[Line::Declare(Role::Input)]],
            Line::Declare(Role::Let) => &[&[Line::Declare(Role::Let)], DECLARED],
            Line::Declare(role) => match role {
                Role::Const => &[&[Line::Declare(Role::Const)], &[Line::Declare(Role::Param)], DECLARED],
                _ => &[&[Line::Declare(Role::Param)], DECLARED],
            },
            Line::Equation => &[&[Line::Equation], &[Line::Declare(Role::Let)], DECLARED],
        };
        let anchor = likes.iter().find_map(|like| self.last(like));
        let breaks = if self.text.contains("\r\n") { "\r\n" } else { "\n" };
        match anchor {
            Some(span) => {
                let indent = self.indent(span);
                let text: String = lines.iter().map(|l| format!("{breaks}{indent}{}", self.aligned(l, span))).collect();
                let at = self.behind(span);
                self.edits.push(Edit { range: at..at, text });
            }
            None => {
                let Some(first) = self.tree.statements.first() else { return };
                let at = first.span.start as usize;
                let indent = self.indent(first.span);
                let text: String = lines.iter().map(|l| format!("{l}{breaks}{indent}")).collect();
                self.edits.push(Edit { range: at..at, text });
            }
        }
    }

    /// New lines directly behind a statement.
    pub(super) fn insert_behind(&mut self, statement: Span, line: &str) {
        let breaks = if self.text.contains("\r\n") { "\r\n" } else { "\n" };
        let at = self.behind(statement);
        let text = format!("{breaks}{}{line}", self.indent(statement));
        self.edits.push(Edit { range: at..at, text });
    }

    fn last(&self, like: &[Line]) -> Option<Span> {
        let is = |kind: &StatementKind| match kind {
            StatementKind::Declare(role, _) => like.contains(&Line::Declare(*role)),
            StatementKind::Equation(..) => like.contains(&Line::Equation),
            _ => false,
        };
        self.tree.statements.iter().rev().find(|s| is(&s.kind)).map(|s| s.span)
    }

    /// The blanks before the line of a statement.
    fn indent(&self, statement: Span) -> &'a str {
        let start = statement.start as usize;
        let line = self.text[..start].rfind('\n').map_or(0, |k| k + 1);
        let blanks = self.text[line..start].len() - self.text[line..start].trim_start().len();
        &self.text[line..line + blanks]
    }

    /// The end of the line of a statement with its comment; where something else follows, its semicolon.
    fn behind(&self, statement: Span) -> usize {
        let end = statement.end as usize;
        let line = self.text[end..].lines().next().unwrap_or("");
        let mut rest = line.trim_start();
        while let Some(comment) = rest.strip_prefix("/*") {
            match comment.split_once("*/") {
                Some((_, behind)) => rest = behind.trim_start(),
                None => return end,
            }
        }
        match rest {
            _ if line.trim().is_empty() => end,
            _ if rest.is_empty() || rest.starts_with("//") => end + line.trim_end().len(),
            _ => end,
        }
    }

    /// A new declaration with its name and its `=` where the line beside it has them.
    fn aligned(&self, line: &str, beside: Span) -> String {
        let other = &self.text[beside.range()];
        let (Some((word, rest)), Some((own_word, own_rest))) = (other.split_once(' '), line.split_once(' ')) else {
            return line.into();
        };
        let (Some(sign), Some(own_sign)) = (rest.find('='), own_rest.find(" = ")) else { return line.into() };
        if word != own_word || other.contains('\n') {
            return line.into();
        }
        let gap = rest.len() - rest.trim_start().len();
        let name = &own_rest[..own_sign];
        let plain = rest[gap..sign].trim_end().chars().all(|c| c.is_alphanumeric() || c == '_');
        let width = if plain { rest[gap..sign].chars().count().saturating_sub(1) } else { 0 };
        format!("{word} {}{name:width$}{}", &rest[..gap], &own_rest[own_sign..])
    }

    /// The text with all edits.
    pub(super) fn finish(self) -> String {
        applied(self.text, self.edits)
    }
}

const DECLARED: &[Line] = &[
    Line::Declare(Role::Param),
    Line::Declare(Role::Const),
    Line::Declare(Role::State),
    Line::Declare(Role::Input),
    Line::Declare(Role::Let),
];

fn applied(text: &str, mut edits: Vec<Edit>) -> String {
    // insertions at one place keep their order
    edits.sort_by_key(|e| (e.range.start, e.range.end));
    let mut out = String::with_capacity(text.len() + edits.iter().map(|e| e.text.len()).sum::<usize>());
    let mut at = 0;
    for edit in edits {
        out.push_str(text.get(at..edit.range.start).unwrap_or(""));
        out.push_str(&edit.text);
        at = edit.range.end.max(at);
    }
    out.push_str(text.get(at..).unwrap_or(""));
    out
}

/// Every name that a text uses for something, and those given since.
pub(super) struct Taken {
    names: HashSet<String>,
}

impl Taken {
    /// The names of a model.
    pub(super) fn of(tree: &SyntaxTree) -> Self {
        let mut names = HashSet::new();
        for statement in &tree.statements {
            match &statement.kind {
                StatementKind::Declare(_, list) => names.extend(list.iter().map(|d| d.name.text.clone())),
                StatementKind::Table(table) => drop(names.insert(table.name.text.clone())),
                StatementKind::Use(submodel) => drop(names.insert(submodel.alias.text.clone())),
                _ => {}
            }
        }
        // what is not declared here may come from elsewhere
        names.extend(tree.expressions.iter().filter_map(|(e, _)| match e {
            Expr::Name(name) => Some(name.clone()),
            Expr::Call(name, _) | Expr::Element(name, _) => Some(name.text.clone()),
            _ => None,
        }));
        Self { names }
    }

    /// A new name: the wanted one, with a number where it is taken.
    pub(super) fn give(&mut self, wanted: &str) -> String {
        let free = |name: &String| !self.names.contains(name) && !is_reserved(name);
        let numbered = (2..).map(|k: u32| format!("{wanted}_{k}"));
        let name = std::iter::once(wanted.to_string()).chain(numbered).find(free).unwrap_or_default();
        self.names.insert(name.clone());
        name
    }
}

/// Whether the language uses a name itself.
pub(super) fn is_reserved(name: &str) -> bool {
    word_use(name).is_some() || function_form(name).is_some()
}

impl Subject {
    /// The text with these values behind the `=` of params that it declares itself; params of submodels and vectors
    /// stay as they are.
    pub fn with_start_values(&self, values: &[(String, f64)]) -> Source {
        let mut editor = Editor::new(self.source.text(), &self.tree);
        for statement in &self.tree.statements {
            let StatementKind::Declare(Role::Param, list) = &statement.kind else { continue };
            for d in list.iter().filter(|d| d.shape.is_none()) {
                let (Some(Value::Expr(e)), Some((_, value))) =
                    (&d.value, values.iter().find(|(name, _)| *name == d.name.text))
                else {
                    continue;
                };
                let range = editor.value(d.span, *e);
                editor.replace(range, written(*value));
            }
        }
        self.with_text(editor.finish())
    }

    /// The text with `free` as the initial value of these states, and with what is said of inputs between samples (held, else in straight lines). None
    /// where one of the states is none that the text declares by itself, as those of submodels and of vectors; of such an input nothing is written.
    pub fn with_free_initials_and_holds(&self, states: &[&str], holds: &[(&str, bool)]) -> Option<Source> {
        let mut editor = Editor::new(self.source.text(), &self.tree);
        let mut missing = states.len();
        for statement in &self.tree.statements {
            let StatementKind::Declare(role, list) = &statement.kind else { continue };
            for d in list.iter().filter(|d| d.shape.is_none()) {
                let name = d.name.text.as_str();
                let end = d.name.span.range().end;
                match (role, holds.iter().find(|(input, _)| *input == name)) {
                    (Role::State, _) if states.contains(&name) => {
                        missing -= 1;
                        match d.value {
                            Some(Value::Expr(e)) => editor.replace(editor.value(d.span, e), "free"),
                            Some(Value::Free(_)) => (),
                            None => editor.replace(end..end, " = free"),
                        }
                    }
                    (Role::Input, Some((_, held))) => {
                        let word = if *held { "held" } else { "linear" };
                        match d.hold {
                            Some(hold) => editor.replace(hold.span.range(), word),
                            None => editor.replace(end..end, format!(" {word}")),
                        }
                    }
                    _ => (),
                }
            }
        }
        (missing == 0).then(|| self.with_text(editor.finish()))
    }
}

/// A number as a person writes it, read back as the same.
fn written(value: f64) -> String {
    let plain = value == 0.0 || (1e-4..1e7).contains(&value.abs());
    if plain { format!("{value}") } else { format!("{value:e}") }
}

#[cfg(test)]
mod start_values_tests {
    use super::*;
    use fdm_grammar::compile;

    #[test]
    fn only_the_values_change() {
        let text = "model a { input u; state x = free; // one\n param k = (1) in [0, 9] /* two */, b=-2 , c = 3 fixed;\n\
            der(x) = u - k*x + b + c; output y = x; }";
        let source = Source::new("a.fdm", text);
        let subject = Subject::new(&source, &compile(&source).unwrap().model).unwrap();
        let values = [("k", 2.5), ("b", -1.25e-9), ("x", 7.0)].map(|(name, value)| (name.to_string(), value));
        let new = subject.with_start_values(&values);
        let wanted = text.replace("k = (1)", "k = 2.5").replace("b=-2", "b=-1.25e-9");
        assert_eq!(new.text(), wanted);
        let model = compile(&new).unwrap().model;
        assert_eq!(model.params[model.param("b").unwrap()].value, -1.25e-9);
    }

    #[test]
    fn an_initial_value_is_freed_and_nothing_else_changes() {
        let text = "model a { input u; state x = (1.5) /* m */ \"way\", v \"speed\"; param k = 1; // one\n\
            der(x) = v; der(v) = u - k*x; output y = x; }";
        let source = Source::new("a.fdm", text);
        let subject = Subject::new(&source, &compile(&source).unwrap().model).unwrap();
        let new = subject.with_free_initials_and_holds(&["x", "v"], &[("u", false), ("w", true), ("x", true)]).unwrap();
        let wanted =
            text.replace("= (1.5)", "= free").replace(", v ", ", v = free ").replace("input u", "input u linear");
        assert_eq!(new.text(), wanted);
        assert_eq!(compile(&new).unwrap().model.params.len(), 3);
        assert!(subject.with_free_initials_and_holds(&["x", "z"], &[]).is_none());
        let again = Subject::new(&new, &compile(&new).unwrap().model).unwrap();
        let held = again.with_free_initials_and_holds(&[], &[("u", true)]).unwrap();
        assert_eq!(held.text(), wanted.replace("linear", "held"));
        assert_eq!(compile(&held).unwrap().model.inputs[0].held, Some(true));
    }
}
