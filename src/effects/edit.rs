//! Edits of a text: nothing is written anew that was not changed.

use fdm_grammar::source::Span;
use fdm_grammar::syntax::{ExprRef, Role, StatementKind, SyntaxTree, value_extent};
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
