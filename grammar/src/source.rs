//! Named texts and places in them.
//!
//! **In** names and texts of files. **Out** [`Source`], [`Span`], text, line and column of an offset.
//! **Never** reads files: the texts are handed in. **Start** at [`Source::position`].

use std::collections::BTreeMap;

/// A half-open range of byte offsets among the texts of a [`Source`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Span {
    /// Offset of the first byte.
    pub start: u32,
    /// Offset behind the last byte.
    pub end: u32,
}

impl Span {
    /// The span of `start..end`; texts are limited far below 4 GiB, so offsets fit in 32 bits.
    pub fn new(start: usize, end: usize) -> Self {
        Self { start: start as u32, end: end as u32 }
    }

    /// The smallest span that holds both.
    pub fn to(self, other: Self) -> Self {
        Self { start: self.start.min(other.start), end: self.end.max(other.end) }
    }

    /// The span as it is counted where everything stands `by` bytes later.
    pub fn moved(self, by: u32) -> Self {
        Self { start: self.start + by, end: self.end + by }
    }

    /// As a range of byte offsets.
    pub fn range(self) -> std::ops::Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// A line and a column, both counted from 1; columns count characters, as editors do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Position {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
}

/// One text and the name under which messages show it.
#[derive(Debug, Clone)]
pub struct Text {
    name: String,
    text: String,
    start: u32,
    line_starts: Vec<u32>,
    used_at: Option<Span>,
}

impl Text {
    fn new(name: String, text: String, start: u32, used_at: Option<Span>) -> Self {
        let line_starts =
            std::iter::once(0).chain(text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i as u32 + 1));
        Self { name, line_starts: line_starts.collect(), text, start, used_at }
    }

    /// The name that messages show.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The whole text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The offset of its first byte among all texts of the source.
    pub fn start(&self) -> u32 {
        self.start
    }

    /// The first `use` that names this text; `None` for the model itself.
    pub fn used_at(&self) -> Option<Span> {
        self.used_at
    }

    /// A line (from 1) without its end; empty behind the last line.
    pub fn line(&self, line: usize) -> &str {
        let Some(start) = line.checked_sub(1).and_then(|i| self.line_starts.get(i)) else { return "" };
        let end = self.line_starts.get(line).map_or(self.text.len(), |e| *e as usize);
        self.text[*start as usize..end].trim_end_matches(['\n', '\r'])
    }

    /// Line and column of an offset in this text; offsets behind the end give the end.
    fn position(&self, offset: usize) -> Position {
        let offset = offset.min(self.text.len());
        let line = self.line_starts.partition_point(|s| *s as usize <= offset);
        let start = self.line_starts[line - 1] as usize;
        let column = self.text.get(start..offset).map_or(0, |s| s.chars().count()) + 1;
        Position { line, column }
    }
}

/// A file that a model uses and that could not be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// The name under which it was looked for.
    pub name: String,
    /// Why it is not there.
    pub reason: String,
}

/// The text of one model, and behind it the texts of the files that it uses. All of them stand in one row of offsets, so
/// that a [`Span`] says in which text it lies.
#[derive(Debug, Clone)]
pub struct Source {
    texts: Vec<Text>,
    missing: Vec<Missing>,
    groups: Groups,
}

/// The groups of the runs by the name of the grouping: `aircraft` to `A`, `B`.
pub type Groups = BTreeMap<String, Vec<String>>;

impl Source {
    /// Most bytes in all texts together.
    pub const MOST_BYTES: usize = 256 << 20;

    /// Takes the text; `name` is what messages call it, usually the path as the user typed it.
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self { texts: vec![Text::new(name.into(), text.into(), 0, None)], missing: Vec::new(), groups: Groups::new() }
    }

    /// This source for runs of these groups (`param k per group aircraft`).
    #[must_use]
    pub fn with_groups(self, groups: Groups) -> Self {
        Self { groups, ..self }
    }

    /// The groups of the runs; of a grouping that is not among them nothing is known, and its params are shared.
    pub fn groups(&self) -> &Groups {
        &self.groups
    }

    /// The name of the model's own text.
    pub fn name(&self) -> &str {
        &self.texts[0].name
    }

    /// The model's own text, without the files that it uses.
    pub fn text(&self) -> &str {
        &self.texts[0].text
    }

    /// The model's own text, then the files that it uses in the order in which they are met.
    pub fn texts(&self) -> &[Text] {
        &self.texts
    }

    /// Adds a file that is used at a place; `false` when there is no room for it.
    pub fn append(&mut self, name: impl Into<String>, text: impl Into<String>, used_at: Span) -> bool {
        let text = text.into();
        // the gap of one byte tells the end of a text from the beginning of the next
        let start = self.texts.last().map_or(0, |t| t.start as usize + t.text.len() + 1);
        let fits = start + text.len() <= Self::MOST_BYTES;
        if fits {
            self.texts.push(Text::new(name.into(), text, start as u32, Some(used_at)));
        }
        fits
    }

    /// The file of that name, by its place among [`Self::texts`].
    pub fn find(&self, name: &str) -> Option<usize> {
        self.texts.iter().position(|t| t.name == name)
    }

    /// Remembers that a file could not be read.
    pub fn lacks(&mut self, name: impl Into<String>, reason: impl Into<String>) {
        self.missing.push(Missing { name: name.into(), reason: reason.into() });
    }

    /// The files that are used and could not be read.
    pub fn missing(&self) -> &[Missing] {
        &self.missing
    }

    /// Whether two sources hold the same texts, whatever their names.
    pub fn same_texts(&self, other: &Self) -> bool {
        self.texts.iter().map(Text::text).eq(other.texts.iter().map(Text::text))
    }

    /// The text in which an offset lies.
    pub fn text_at(&self, offset: u32) -> &Text {
        let behind = self.texts.partition_point(|t| t.start <= offset);
        &self.texts[behind.saturating_sub(1)]
    }

    /// The text of a span; empty when the span does not lie on character boundaries of one text.
    pub fn slice(&self, span: Span) -> &str {
        let text = self.text_at(span.start);
        let range = span.range();
        let start = text.start as usize;
        range.end.checked_sub(start).and_then(|end| text.text.get(range.start - start..end)).unwrap_or("")
    }

    /// Line and column of an offset in its text; offsets behind the end give the end.
    pub fn position(&self, offset: u32) -> Position {
        let text = self.text_at(offset);
        text.position((offset - text.start) as usize)
    }

    /// A line (from 1) of the model's own text without its end; empty behind the last line.
    pub fn line(&self, line: usize) -> &str {
        self.texts[0].line(line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_lines_and_characters_from_one() {
        let source = Source::new("a.fdm", "ab\nαβ = c\n");
        let at = |o| {
            let p = source.position(o);
            (p.line, p.column)
        };
        assert_eq!((at(0), at(1), at(3), at(5), at(99)), ((1, 1), (1, 2), (2, 1), (2, 2), (3, 1)));
        assert_eq!((source.line(2), source.line(9)), ("αβ = c", ""));
    }

    #[test]
    fn every_offset_belongs_to_one_text() {
        let mut source = Source::new("a.fdm", "ab\ncd");
        assert!(source.append("b.fdm", "αβ\nγ", Span::new(3, 5)));
        let at = |o| {
            let (text, p) = (source.text_at(o), source.position(o));
            (text.name(), p.line, p.column)
        };
        assert_eq!((at(0), at(5), at(6), at(11)), (("a.fdm", 1, 1), ("a.fdm", 2, 3), ("b.fdm", 1, 1), ("b.fdm", 2, 1)));
        assert_eq!(
            (source.slice(Span::new(6, 10)), source.slice(Span::new(3, 8)), source.slice(Span::new(9, 7))),
            ("αβ", "", "")
        );
        assert!(!source.append("c.fdm", " ".repeat(Source::MOST_BYTES), Span::default()));
        assert_eq!(source.texts().len(), 2);
    }
}
