//! Everything that is wrong with a text, collected: its outline, its tokens, its brackets, its statements.

use super::expected::{Expected, Want, shown};
use super::outline::{Extent, Fault, NESTING_LIMIT, Outline};
use super::parse::Refusal;
use super::scan::{Kind, Token, holds_effects};
use super::scan::{WordUse, word_use};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use std::ops::Range;

/// Most findings about one text.
const FINDINGS_LIMIT: usize = 20;
const MODEL_FORM: &str = "a model is written `model NAME { ... }`";
const COMMENT_FORM: &str = "a comment begins with `//`";

/// The findings about one text.
pub(super) struct Slips<'a> {
    text: &'a str,
    tokens: &'a [Token],
    findings: Vec<Diagnostic>,
    /// Findings beyond the limit.
    unsaid: usize,
}

impl<'a> Slips<'a> {
    pub(super) fn new(text: &'a str, tokens: &'a [Token]) -> Self {
        Self { text, tokens, findings: Vec::new(), unsaid: 0 }
    }

    /// All findings in the order of the text, and how many there are beyond the limit.
    pub(super) fn finish(mut self) -> Vec<Diagnostic> {
        self.findings.sort_by_key(|f| f.span);
        if let Some(last) = self.findings.last().filter(|_| self.unsaid > 0) {
            let (count, plural) = (self.unsaid, if self.unsaid == 1 { "" } else { "s" });
            let message = format!("{count} more mistake{plural} of grammar behind this place");
            let rest = Diagnostic::new(Code::Unexpected, last.span, message);
            self.findings.push(rest.hint("they are shown when those before are mended"));
        }
        self.findings
    }

    /// Takes findings until there are enough.
    pub(super) fn report(&mut self, findings: impl IntoIterator<Item = Diagnostic>) {
        for finding in findings {
            if self.is_full() {
                self.unsaid += 1;
            } else {
                self.findings.push(finding);
            }
        }
    }

    fn is_full(&self) -> bool {
        self.findings.len() == FINDINGS_LIMIT
    }

    fn span(&self, at: usize) -> Span {
        self.tokens[at].span
    }

    fn shown(&self, at: usize) -> String {
        shown(self.tokens[at].text(self.text))
    }

    /// Looks at the frame of the model; whether there is anything of a model in the text.
    pub(super) fn outline(&mut self, outline: &Outline) -> bool {
        let Some(first) = self.tokens.first() else {
            let found = Diagnostic::new(Code::Unexpected, Span::default(), "the text holds no model");
            self.report([found.hint(MODEL_FORM)]);
            return false;
        };
        if outline.header.is_none() || !outline.before.is_empty() {
            if first.kind == Kind::OpenComment {
                self.flaw(0);
                return false;
            }
            if is_table(self.text) {
                let message = "this looks like a table of data, not like a model";
                self.report([
                    Diagnostic::new(Code::Unexpected, first.span, message).hint("a record is given with `--data`")
                ]);
                return false;
            }
            if holds_effects(self.text) {
                let message = "these are effects, not a model";
                let hint = "a file of effects is given with `--effects`; `fdm check` checks one by itself";
                self.report([Diagnostic::new(Code::Unexpected, first.span, message).hint(hint)]);
                return false;
            }
            self.report([self.no_header(first)]);
            let keyword = |t: &Token| t.kind == Kind::Keyword && self.begins_statement(t);
            if outline.header.is_none() && !self.tokens.iter().any(keyword) {
                return false;
            }
        }
        self.braces(outline);
        true
    }

    /// Something stands where the model should begin.
    fn no_header(&self, first: &Token) -> Diagnostic {
        let message = format!("expected `model NAME {{`, found `{}`", self.shown(0));
        let found = Diagnostic::new(Code::Unexpected, first.span, message);
        found.hint(if self.shown(0).starts_with(['%', '#']) { COMMENT_FORM } else { MODEL_FORM })
    }

    fn begins_statement(&self, token: &Token) -> bool {
        matches!(word_use(token.text(self.text)), Some(WordUse::Statement | WordUse::Planned))
    }

    /// The braces of the model and what stands behind them.
    fn braces(&mut self, outline: &Outline) {
        let comment_open = self.tokens.last().is_some_and(|t| t.kind == Kind::OpenComment);
        if let Some(header) = outline.header.as_ref().filter(|h| h.closed && outline.end.is_none() && !comment_open) {
            let found = Diagnostic::new(Code::Unterminated, self.span(header.tokens.end), "this brace is not closed");
            self.report([found.hint("write `}` behind the last statement of the model")]);
        }
        if let Some(second) = outline.second {
            let message = "a second model begins here; a text holds one model";
            let found = Diagnostic::new(Code::Unexpected, self.span(second), message);
            self.report([found.hint("put it into a file of its own")]);
        }
        if let Some(surplus) = outline.surplus {
            let message = format!("the model ends before this `{}`: its brace is closed already", self.shown(surplus));
            let found = Diagnostic::new(Code::Unexpected, self.span(surplus), message)
                .hint("nothing but comments may follow the `}` that closes the model");
            let brace = outline.end.filter(|end| *end != surplus);
            self.report([match brace {
                Some(end) => found.label(self.span(end), "the model ends here"),
                None => found,
            }]);
        }
    }

    /// Reports what is wrong with the tokens and brackets of an extent; whether anything is.
    pub(super) fn flaws(&mut self, extent: &Extent) -> bool {
        let first = extent.tokens.start;
        if self.planned(first) {
            let message = format!("`{}` cannot stand inside a model", self.shown(first));
            let found = Diagnostic::new(Code::Unexpected, self.span(first), message);
            self.report([found.hint("effects stand in a file of their own")]);
            return true;
        }
        self.flawed(extent)
    }

    /// Whether tokens or brackets are wrong, whatever word begins the extent.
    pub(super) fn flawed(&mut self, extent: &Extent) -> bool {
        // One finding about depth is enough: the rest of such a statement is not read.
        if let Some(fault @ Fault::TooDeep(_)) = extent.fault {
            self.fault(fault);
            return true;
        }
        let mut flawed = false;
        for at in extent.tokens.clone() {
            flawed |= self.flaw(at);
        }
        if let Some(fault) = extent.fault.filter(|_| !flawed) {
            self.fault(fault);
            flawed = true;
        }
        flawed
    }

    fn planned(&self, at: usize) -> bool {
        let token = &self.tokens[at];
        token.kind == Kind::Keyword && word_use(token.text(self.text)) == Some(WordUse::Planned)
    }

    /// Reports a token that belongs to no statement.
    fn flaw(&mut self, at: usize) -> bool {
        let (kind, span) = (self.tokens[at].kind, self.span(at));
        if !matches!(kind, Kind::Malformed | Kind::Junk | Kind::OpenText | Kind::OpenComment) {
            return false;
        }
        if self.is_full() {
            self.unsaid += 1;
            return true;
        }
        let written = self.tokens[at].text(self.text);
        let start = Span::new(span.start as usize, span.start as usize + 1);
        let found = match kind {
            Kind::Malformed => malformed(written, span),
            Kind::Junk => junk(written, span),
            Kind::OpenText => Diagnostic::new(Code::Unterminated, start, "this string is not closed on its line")
                .hint("write `\"` at its end"),
            _ => Diagnostic::new(Code::Unterminated, start, "this comment is not closed").hint("write `*/` at its end"),
        };
        self.report([found]);
        true
    }

    fn fault(&mut self, fault: Fault) {
        let found = match fault {
            Fault::TooDeep(at) => {
                let message = format!("nested deeper than {NESTING_LIMIT} levels");
                Diagnostic::new(Code::TooDeep, self.span(at), message)
                    .hint("give inner parts names of their own with `let`")
            }
            Fault::Unclosed(at) => {
                let close = closing(self.tokens[at].text(self.text));
                let message = format!("this `{}` is not closed in its statement", self.shown(at));
                Diagnostic::new(Code::Unterminated, self.span(at), message)
                    .hint(format!("write `{close}` where it ends"))
            }
            Fault::Mismatch(open, close) => {
                let message = format!("`{}` is closed by `{}`", self.shown(open), self.shown(close));
                let wanted = closing(self.tokens[open].text(self.text));
                Diagnostic::new(Code::Unterminated, self.span(open), message)
                    .label(self.span(close), format!("`{wanted}` should stand here"))
            }
        };
        self.report([found]);
    }

    /// Reports the semicolon that is missing behind the last of these tokens.
    pub(super) fn semicolon(&mut self, tokens: &Range<usize>) {
        let end = self.span(tokens.end - 1).end as usize;
        let subject = self.expected(tokens, true, tokens.end, &[Want::End]).subject();
        let message = format!("expected `;` after {subject}");
        self.report([Diagnostic::new(Code::Unexpected, Span::new(end, end), message)]);
    }

    /// Where the first statement of an extent ends, if all that is wrong there is a missing semicolon.
    pub(super) fn statement_end(&self, tokens: &Range<usize>, refusal: &Refusal) -> Option<usize> {
        let at = self.token_at(tokens, refusal.offset);
        let token = self.tokens.get(at).filter(|_| at < tokens.end && at > tokens.start)?;
        let word = matches!(token.kind, Kind::Name | Kind::Keyword);
        let begins = token.first_on_line || token.text(self.text) == "der";
        (word && begins && refusal.wants.contains(&Want::End)).then_some(at)
    }

    /// Reports what the grammar did not take.
    pub(super) fn refused(&mut self, extent: &Extent, refusal: &Refusal) {
        if self.is_full() {
            self.unsaid += 1;
            return;
        }
        let at = self.token_at(&extent.tokens, refusal.offset);
        let found = self.expected(&extent.tokens, extent.closed, at, &refusal.wants).finding();
        self.report([found]);
    }

    /// The token at or behind a byte; the end of the range when none is left.
    fn token_at(&self, tokens: &Range<usize>, offset: usize) -> usize {
        tokens.start + self.tokens[tokens.clone()].partition_point(|t| t.span.end as usize <= offset)
    }

    fn expected<'s>(&'s self, tokens: &Range<usize>, closed: bool, at: usize, wants: &'s [Want]) -> Expected<'s> {
        Expected { text: self.text, tokens: self.tokens, statement: tokens.clone(), closed, at, wants }
    }
}

/// Whether a text begins with names between commas, semicolons or tabs and goes on with as many numbers.
fn is_table(text: &str) -> bool {
    let mut lines = text.lines().filter(|l| !l.trim().is_empty() && !l.starts_with("//"));
    let (Some(header), Some(row)) = (lines.next(), lines.next()) else { return false };
    let number = |cell: &str| cell.trim().replace(',', ".").parse::<f64>().is_ok();
    ['\t', ';', ','].iter().any(|mark| {
        let cells = row.split(*mark).count();
        cells > 1 && cells == header.split(*mark).count() && row.split(*mark).all(|c| c.trim().is_empty() || number(c))
    })
}

fn closing(open: &str) -> char {
    match open {
        "(" => ')',
        "[" => ']',
        _ => '}',
    }
}

/// A word that begins like a number.
fn malformed(written: &str, span: Span) -> Diagnostic {
    let digits = written.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.');
    let number = &written[..written.len() - digits.len()];
    if matches!(digits, "e" | "E") {
        let message = format!("the number `{}` lacks the digits of its exponent", shown(written));
        return Diagnostic::new(Code::BadNumber, span, message).hint("an exponent is written `1e-3`");
    }
    let found = |what: &str| Diagnostic::new(Code::Unexpected, span, format!("`{}` is {what}", shown(written)));
    if written.chars().all(|c| c.is_ascii_digit() || c == '_' || c == '.') && written.contains('_') {
        return found("not a number").hint("digits are written without `_` between them");
    }
    if digits.is_empty() || number.matches('.').count() > 1 || digits.contains('.') {
        return found("not a number");
    }
    found("neither a number nor a name").hint(format!("a product is written `{}*{}`", shown(number), shown(digits)))
}

/// Characters that the language does not use; some of them have a meaning elsewhere.
fn junk(written: &str, span: Span) -> Diagnostic {
    let first = written.chars().next().unwrap_or(' ');
    let hint = match first {
        '%' | '#' => COMMENT_FORM,
        '\u{2212}' | '\u{2013}' | '\u{2014}' => "the minus sign is `-`",
        '×' | '·' | '⋅' | '∙' | '∗' => "a product is written with `*`",
        '÷' | '∕' => "a quotient is written with `/`",
        '≤' | '⩽' => "write `<=`",
        '≥' | '⩾' => "write `>=`",
        '≠' => "write `!=`",
        '²' => "a square is written `x^2`",
        '³' => "a cube is written `x^3`",
        '√' => "a square root is written `sqrt(x)`",
        '“' | '”' | '„' | '«' | '»' => "a string stands between `\"`",
        '’' | '‘' | '`' | '′' => "a derivative is written `der(x)`",
        '?' => "a choice is written `if c then a else b`",
        '∧' => "write `and`",
        '∨' => "write `or`",
        '¬' => "write `not`",
        _ => "",
    };
    let count = written.chars().count();
    let what = if count == 1 { "the character" } else { "the characters" };
    let found = Diagnostic::new(Code::Unexpected, span, format!("{what} `{}` cannot stand here", shown(written)));
    if hint.is_empty() { found } else { found.hint(hint) }
}
