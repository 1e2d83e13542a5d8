//! An open text, what is known of it, and its places as editors count them: lines from 0, columns in UTF-16 units.

use fdm_effects::Catalogue;
use fdm_grammar::syntax::{self, Declaration, Role, StatementKind, SyntaxTree, Table, Token, TokenKind, Use};
use fdm_grammar::{Diagnostic, Model, Source, Span};

/// A place in a text as editors count: lines from 0, columns in UTF-16 units from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Position {
    pub(crate) line: u32,
    pub(crate) character: u32,
}

/// A text of the editor.
#[derive(Debug)]
pub(crate) struct Document {
    pub(crate) source: Source,
    pub(crate) lines: Lines,
    pub(crate) tokens: Vec<Token>,
    pub(crate) comments: Vec<Span>,
    /// All statements that can be read.
    pub(crate) tree: Option<SyntaxTree>,
    /// The model, when there is no mistake, once it is checked.
    pub(crate) model: Option<Model>,
    pub(crate) findings: Vec<Diagnostic>,
}

/// What a name was declared as.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Declared<'a> {
    /// `param a ...`
    Quantity(Role, &'a Declaration),
    /// `table CL(...)`
    Table(&'a Table),
    /// `use "..." as act`
    Submodel(&'a Use),
}

impl<'a> Declared<'a> {
    pub(crate) fn name(self) -> &'a syntax::Name {
        match self {
            Self::Quantity(_, d) => &d.name,
            Self::Table(t) => &t.name,
            Self::Submodel(u) => &u.alias,
        }
    }

    /// The word that declares it.
    pub(crate) fn keyword(self) -> &'static str {
        match self {
            Self::Quantity(role, _) => role.keyword(),
            Self::Table(_) => "table",
            Self::Submodel(_) => "submodel",
        }
    }

    pub(crate) fn unit(self) -> Option<&'a str> {
        match self {
            Self::Quantity(_, d) => d.unit.as_ref(),
            Self::Table(t) => t.unit.as_ref(),
            Self::Submodel(_) => None,
        }
        .map(|u| u.text.as_str())
    }

    pub(crate) fn doc(self) -> Option<&'a str> {
        match self {
            Self::Quantity(_, d) => d.doc.as_ref(),
            Self::Table(t) => t.doc.as_ref(),
            Self::Submodel(_) => None,
        }
        .map(|d| d.text.as_str())
    }
}

/// What is wrong in a file that is used is told where it is used.
fn at_the_use(finding: &mut Diagnostic, whole: &Source) {
    let told = |span: Span, message: &str| {
        let text = whole.text_at(span.start);
        let place = text.used_at().filter(|place| place.end as usize <= whole.text().len());
        let at = whole.position(span.start);
        (place.unwrap_or_default(), format!("{}:{}:{}: {message}", text.name(), at.line, at.column))
    };
    let elsewhere = |span: Span| whole.text_at(span.start).used_at().is_some();
    if elsewhere(finding.span) {
        (finding.span, finding.message) = told(finding.span, &finding.message);
    }
    for label in finding.labels.iter_mut().filter(|l| elsewhere(l.span)) {
        (label.span, label.text) = told(label.span, &label.text);
    }
}

impl Document {
    pub(crate) fn new(name: &str, text: String) -> Self {
        let source = Source::new(name, text);
        let lines = Lines::new(source.text());
        let (tokens, comments) = syntax::tokens(source.text());
        let (tree, findings) = match syntax::holds_effects(source.text()) {
            true => (None, syntax::parse_effects(&source).1),
            false => syntax::parse_recovering(&source),
        };
        Self { source, lines, tokens, comments, tree, model: None, findings }
    }

    /// Finds every mistake of the text, which takes longer than the rest.
    pub(crate) fn check(&mut self) {
        if syntax::holds_effects(self.source.text()) {
            self.findings = Catalogue::read(&self.source).1;
            return;
        }
        let mut whole = self.source.clone();
        fdm_system::Model::gather_files(&mut whole);
        (self.model, self.findings) = match fdm_grammar::examine(&whole) {
            Ok((model, warnings)) => (Some(model), warnings),
            Err(findings) => (None, findings),
        };
        self.findings.iter_mut().for_each(|f| at_the_use(f, &whole));
    }

    pub(crate) fn text(&self) -> &str {
        self.source.text()
    }

    pub(crate) fn range(&self, span: Span) -> [Position; 2] {
        self.lines.range(self.text(), span)
    }

    pub(crate) fn offset(&self, position: Position) -> usize {
        self.lines.offset(self.text(), position)
    }

    /// Everything that is declared, in the order of the text.
    pub(crate) fn declared(&self) -> impl Iterator<Item = Declared<'_>> {
        let statements = self.tree.iter().flat_map(|t| &t.statements);
        statements.flat_map(|s| match &s.kind {
            StatementKind::Declare(role, list) => list.iter().map(|d| Declared::Quantity(*role, d)).collect(),
            StatementKind::Table(table) => vec![Declared::Table(table)],
            StatementKind::Use(submodel) => vec![Declared::Submodel(submodel)],
            _ => Vec::new(),
        })
    }

    pub(crate) fn find(&self, name: &str) -> Option<Declared<'_>> {
        self.declared().find(|d| d.name().text == name)
    }

    /// Index of the first token that ends at or behind a byte.
    pub(crate) fn token_at(&self, offset: usize) -> usize {
        self.tokens.partition_point(|t| (t.span.end as usize) < offset)
    }

    /// The word that stands at a byte or ends there.
    pub(crate) fn word(&self, offset: usize) -> Option<&Token> {
        let at = self.token_at(offset);
        let touches =
            |t: &&Token| (t.span.start as usize) <= offset && matches!(t.kind, TokenKind::Name | TokenKind::Keyword);
        // between two tokens that touch, the one behind wins when it is the word
        self.tokens[at..].iter().take(2).find(touches)
    }

    /// The declared name at a byte, and the span of it there.
    pub(crate) fn name_at(&self, offset: usize) -> Option<(&str, Span)> {
        let token = self.word(offset).filter(|t| t.kind == TokenKind::Name)?;
        let text = token.text(self.text());
        // of `act.y` the submodel is declared here
        let own = text.split('.').next().unwrap_or(text);
        let start = token.span.start as usize;
        self.find(own)?;
        Some((own, Span::new(start, start + own.len())))
    }

    /// Whether a byte lies inside a comment.
    pub(crate) fn in_comment(&self, offset: usize) -> bool {
        let at = self.comments.partition_point(|c| (c.end as usize) < offset);
        self.comments.get(at).is_some_and(|c| {
            let line = self.source.slice(*c).starts_with("//");
            (c.start as usize) < offset && (offset < c.end as usize || line && offset == c.end as usize)
        })
    }
}

/// Where the lines of a text begin.
#[derive(Debug, Clone)]
pub(crate) struct Lines {
    starts: Vec<u32>,
}

impl Lines {
    pub(crate) fn new(text: &str) -> Self {
        let bytes = text.as_bytes();
        // `\n`, `\r\n` and a `\r` that stands alone end lines, for editors as for the language
        let ends = |k: &usize| bytes[*k] == b'\n' || bytes[*k] == b'\r' && bytes.get(k + 1) != Some(&b'\n');
        let starts = std::iter::once(0).chain((0..bytes.len()).filter(ends).map(|k| k as u32 + 1));
        Self { starts: starts.collect() }
    }

    /// The editor's place of a byte.
    pub(crate) fn position(&self, text: &str, offset: usize) -> Position {
        let mut offset = offset.min(text.len());
        while !text.is_char_boundary(offset) {
            offset -= 1;
        }
        let line = self.starts.partition_point(|s| *s as usize <= offset) - 1;
        let before = &text[self.starts[line] as usize..offset];
        Position { line: line as u32, character: before.encode_utf16().count() as u32 }
    }

    /// The byte of an editor's place; behind the end of a line its end, behind the last line the end of the text.
    pub(crate) fn offset(&self, text: &str, position: Position) -> usize {
        let Some(start) = self.starts.get(position.line as usize).map(|s| *s as usize) else { return text.len() };
        let end = self.starts.get(position.line as usize + 1).map_or(text.len(), |s| *s as usize);
        let line = text[start..end].trim_end_matches(['\n', '\r']);
        let mut units = 0;
        for (at, c) in line.char_indices() {
            if units >= position.character as usize {
                return start + at;
            }
            units += c.len_utf16();
        }
        start + line.len()
    }

    pub(crate) fn range(&self, text: &str, span: Span) -> [Position; 2] {
        let range = span.range();
        [range.start, range.end].map(|at| self.position(text, at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_utf16_units() {
        let text = "a𝛼β\r\nc\rd\n";
        let lines = Lines::new(text);
        let position = |offset| {
            let p = lines.position(text, offset);
            (p.line, p.character)
        };
        assert_eq!([0, 1, 5, 7].map(position), [(0, 0), (0, 1), (0, 3), (0, 4)]);
        assert_eq!([9, 10, 11, 12, 13, 99].map(position), [(1, 0), (1, 1), (2, 0), (2, 1), (3, 0), (3, 0)]);
        let offset = |line, character| lines.offset(text, Position { line, character });
        assert_eq!([offset(0, 0), offset(0, 1), offset(0, 3), offset(0, 4), offset(0, 9)], [0, 1, 5, 7, 7]);
        // inside a pair of surrogates: behind it
        assert_eq!((offset(0, 2), offset(1, 7), offset(2, 0), offset(9, 9)), (5, 10, 11, 13));
    }
}
