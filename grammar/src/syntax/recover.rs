//! Text to tree, statement by statement: what is wrong with one does not hide what is wrong with the next.

use super::expression::Builder;
use super::outline::{Extent, Outline};
use super::parse::{self, Refusal, starts_name};
use super::scan::{Token, scan};
use super::slips::Slips;
use super::tree::{Name, Statement, SyntaxTree};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::{Source, Span};
use std::collections::BTreeSet;
use std::ops::Range;

/// Longest text in bytes.
const TEXT_LIMIT: usize = 64 << 20;
/// Most words, numbers and signs in a text: they bound the memory, since a tree takes some hundred bytes for each.
const TOKEN_LIMIT: usize = 4_000_000;

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
/// order of the text). There is no tree when nothing in the text looks like a model.
pub fn parse_recovering(source: &Source) -> (Option<SyntaxTree>, Vec<Diagnostic>) {
    let text = source.text();
    let too_large = |span, message: String| (None, vec![Diagnostic::new(Code::TooLarge, span, message)]);
    if text.len() > TEXT_LIMIT {
        return too_large(Span::default(), format!("the text has {} bytes; the limit is {TEXT_LIMIT}", text.len()));
    }
    let tokens = match scan(text, TOKEN_LIMIT) {
        Ok(tokens) => tokens,
        Err(span) => return too_large(span, format!("the text has more than {TOKEN_LIMIT} words, numbers and signs")),
    };
    let outline = Outline::new(text, &tokens);
    let mut slips = Slips::new(text, &tokens);
    let tree = slips.outline(&outline).then(|| {
        let reader = Reader {
            text,
            tokens: &tokens,
            slips: &mut slips,
            builder: Builder::default(),
            suspended: BTreeSet::new(),
        };
        reader.model(&outline)
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

    /// Nothing shall be said about the words that stand here.
    fn suspend(&mut self, tokens: &Range<usize>) {
        let words = self.tokens[tokens.clone()].iter().map(|t| t.text(self.text));
        self.suspended.extend(words.filter(|w| w.starts_with(starts_name)));
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
                let last = self.tokens[extent.tokens.end - usize::from(!extent.closed)].span;
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
