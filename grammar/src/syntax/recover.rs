//! Text to tree, statement by statement: what is wrong with one does not hide what is wrong with the next.

use super::expression::Builder;
use super::outline::{Extent, Outline};
use super::parse::{self, Refusal, continues_name, starts_name};
use super::scan::{Kind, Token, scan};
use super::slips::Slips;
use super::tree::{Name, Statement, SyntaxTree};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::{Source, Span, Text};
use std::collections::BTreeSet;
use std::ops::Range;

/// Longest text in bytes.
const TEXT_LIMIT: usize = 64 << 20;
/// Most words, numbers and signs in a text: they bound the memory, since a tree takes some hundred bytes for each.
const TOKEN_LIMIT: usize = 2_000_000;

/// Text to tree.
///
/// # Errors
/// What could not be read, in the order of the text, up to 20 findings.
pub fn parse(source: &Source) -> Result<SyntaxTree, Vec<Diagnostic>> {
    match parse_recovering(source) {
        (Some(tree), findings) if findings.is_empty() => Ok(tree),
        (_, findings) => Err(findings),
    }
}

/// Text to a tree of all statements that could be read, and what was wrong with the others (up to 20 findings, in the
/// order of the text). There is no tree when nothing in the text looks like a model. `suspended` holds every word of the
/// statements that are missing in the tree, their keywords too, sorted.
pub fn parse_recovering(source: &Source) -> (Option<SyntaxTree>, Vec<Diagnostic>) {
    parse_text(source.text())
}

/// One of the texts of a source, like [`parse_recovering`]; its places are those of the source.
pub fn parse_used(text: &Text) -> (Option<SyntaxTree>, Vec<Diagnostic>) {
    let (mut tree, findings) = parse_text(text.text());
    if let Some(tree) = &mut tree {
        tree.each_span(|span| *span = span.moved(text.start()));
    }
    (tree, findings.into_iter().map(|f| f.moved(text.start())).collect())
}

fn parse_text(text: &str) -> (Option<SyntaxTree>, Vec<Diagnostic>) {
    let too_large = |span, message: String| (None, vec![Diagnostic::new(Code::TooLarge, span, message)]);
    if text.len() > TEXT_LIMIT {
        return too_large(Span::default(), format!("the text has {} bytes; the limit is {TEXT_LIMIT}", text.len()));
    }
    let tokens = match scan(text, TOKEN_LIMIT) {
        Ok(tokens) => tokens,
        Err(span) => return too_large(span, format!("the text has more than {TOKEN_LIMIT} words, numbers and signs")),
    };
    let outline = Outline::new(text, &tokens);
    // the grammar recurses for each level of nesting; a caller's stack is trusted with this many
    let deep = outline.deepest > 32;
    let read = || read(text, &tokens, &outline);
    if deep { on_deep_stack(read).unwrap_or_else(read) } else { read() }
}

/// Runs on a thread with [`DEEP_STACK`]; `None` when the system gives no thread.
fn on_deep_stack<T: Send>(run: impl FnOnce() -> T + Send) -> Option<T> {
    std::thread::scope(|scope| {
        let builder = std::thread::Builder::new().stack_size(DEEP_STACK);
        builder.spawn_scoped(scope, run).ok()?.join().ok()
    })
}

/// Stack for texts that nest more deeply, in bytes; the limit of nesting takes less than 2 MiB of it.
const DEEP_STACK: usize = 16 << 20;

fn read(text: &str, tokens: &[Token], outline: &Outline) -> (Option<SyntaxTree>, Vec<Diagnostic>) {
    let mut slips = Slips::new(text, tokens);
    let tree = slips.outline(outline).then(|| {
        let builder = Builder::default();
        Reader { text, tokens, slips: &mut slips, builder, suspended: BTreeSet::new() }.model(outline)
    });
    (tree, slips.finish())
}

struct Reader<'a, 's> {
    text: &'a str,
    tokens: &'a [Token],
    slips: &'s mut Slips<'a>,
    builder: Builder,
    suspended: BTreeSet<&'a str>,
}

impl<'a> Reader<'a, '_> {
    fn model(mut self, outline: &Outline) -> SyntaxTree {
        self.suspend(&outline.before);
        let header = outline.header.as_ref().and_then(|h| self.header(h));
        let (name, doc) = header.unwrap_or_else(|| (Name { text: String::new(), span: Span::default() }, None));
        let mut statements = Vec::new();
        for extent in &outline.statements {
            self.statements(extent, &mut statements);
        }
        let suspended = self.suspended.into_iter().map(String::from).collect();
        SyntaxTree { name, doc, statements, expressions: self.builder.expressions, suspended }
    }

    /// Nothing shall be said about the words that stand here, also in strings and comments that are not closed.
    fn suspend(&mut self, tokens: &Range<usize>) {
        for token in &self.tokens[tokens.clone()] {
            let text = token.text(self.text);
            match token.kind {
                Kind::Name | Kind::Keyword => drop(self.suspended.insert(text)),
                Kind::OpenText | Kind::OpenComment => {
                    self.suspended.extend(text.split(|c| !continues_name(c)).filter(|w| w.starts_with(starts_name)));
                }
                _ => {}
            }
        }
    }

    /// The text of some tokens, and the byte where it begins.
    fn passage(&self, tokens: &Range<usize>) -> (&'a str, usize) {
        let start = self.tokens[tokens.start].span.start as usize;
        (&self.text[start..self.tokens[tokens.end - 1].span.end as usize], start)
    }

    fn header(&mut self, extent: &Extent) -> Option<(Name, Option<Name>)> {
        if self.slips.flaws(extent) {
            return None;
        }
        let (text, start) = self.passage(&(extent.tokens.start..extent.tokens.end + usize::from(extent.closed)));
        parse::header(text, start).map_err(|refusal| self.slips.refused(extent, &refusal)).ok()
    }

    /// Reads an extent: one statement, or several where semicolons are missing.
    fn statements(&mut self, extent: &Extent, into: &mut Vec<Statement>) {
        if self.slips.flaws(extent) {
            return self.suspend(&extent.tokens);
        }
        let mut rest = extent.clone();
        loop {
            let Err(refusal) = self.statement(&rest, into) else {
                if !rest.closed {
                    self.slips.semicolon(&rest.tokens);
                }
                return;
            };
            let Some(end) = self.slips.statement_end(&rest.tokens, &refusal) else {
                self.slips.refused(&rest, &refusal);
                return self.suspend(&rest.tokens);
            };
            let first = Extent { tokens: rest.tokens.start..end, closed: false, fault: None };
            if self.statement(&first, into).is_ok() {
                self.slips.semicolon(&first.tokens);
            }
            rest.tokens.start = end;
        }
    }

    /// Reads one statement into the tree; what is wrong with its parts is reported, what does not fit is returned.
    fn statement(&mut self, extent: &Extent, into: &mut Vec<Statement>) -> Result<(), Refusal> {
        let length = self.builder.expressions.len();
        let (text, start) = self.passage(&extent.tokens);
        let (kind, findings) = parse::statement(text, start, &mut self.builder)?;
        self.slips.report(findings);
        match kind {
            Some(kind) => {
                // a trim ends with its brace
                let semicolon =
                    self.tokens.get(extent.tokens.end).filter(|t| extent.closed && t.kind == Kind::Semicolon);
                let last = semicolon.unwrap_or(&self.tokens[extent.tokens.end - 1]).span;
                into.push(Statement { kind, span: Span::new(start, last.end as usize) });
            }
            None => {
                self.builder.cut(length);
                self.suspend(&extent.tokens);
            }
        }
        Ok(())
    }
}
