//! What a report says, made once and printed for a terminal (`text`) or as a page (`html`): sections of sentences, tables and figures, and a
//! verdict above them.
//!
//! A sentence has its names between backticks. A part that only one of both can show says so by [`Part::in_text`] or [`Part::on_page`].

use crate::page::figure::Figure;
use maud::Markup;
use std::borrow::Cow;

/// A result as it is reported.
#[derive(Debug)]
pub(crate) struct Report {
    /// What it is about, in a word or two.
    pub(crate) kind: Cow<'static, str>,
    /// The model's name, or whatever else it is about.
    pub(crate) name: String,
    /// What that says of itself.
    pub(crate) doc: Option<String>,
    pub(crate) verdict: Verdict,
    pub(crate) sections: Vec<Section>,
}

/// How far a result can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Trust {
    Good,
    Reserved,
    Bad,
    /// Nobody knows yet.
    Open,
}

/// How far a result can be relied on, in a sentence, and what speaks against it.
#[derive(Debug, Clone)]
pub(crate) struct Verdict {
    pub(crate) trust: Trust,
    pub(crate) sentence: String,
    /// How much it rests on.
    pub(crate) facts: Option<String>,
    pub(crate) points: Vec<Point>,
}

/// What speaks for or against a result, and the section that shows it.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub(crate) sentence: String,
    pub(crate) anchor: &'static str,
}

impl Verdict {
    pub(crate) fn new(trust: Trust, sentence: impl Into<String>) -> Self {
        Self { trust, sentence: sentence.into(), facts: None, points: Vec::new() }
    }

    pub(crate) fn with_facts(self, facts: String) -> Self {
        Self { facts: Some(facts), ..self }
    }

    /// With sentences about what a section shows.
    pub(crate) fn with_points(mut self, sentences: impl IntoIterator<Item = String>, anchor: &'static str) -> Self {
        self.points.extend(sentences.into_iter().map(|sentence| Point { sentence, anchor }));
        self
    }
}

/// A clause as a sentence: with a large first letter and a full stop.
pub(crate) fn sentence(clause: &str) -> String {
    let mut letters = clause.chars();
    let first = letters.next().map(|c| c.to_uppercase().collect::<String>());
    format!("{}{}.", first.unwrap_or_default(), letters.as_str())
}

/// A sentence with its first letter large.
pub(crate) fn capital(sentence: &str) -> String {
    // names of parameters begin sentences too, and stay what they are
    let word = sentence.split(' ').next().unwrap_or_default();
    let plain = word.chars().all(|c| c.is_ascii_lowercase() || c == ':');
    let plain = plain && (word.len() > 3 || ["not", "the"].contains(&word));
    let mut letters = sentence.chars();
    match letters.next() {
        Some(first) if plain => first.to_uppercase().chain(letters).collect(),
        _ => sentence.to_string(),
    }
}

/// A part of a report that can be pointed at.
#[derive(Debug)]
pub(crate) struct Section {
    /// The name by which links find it.
    pub(crate) anchor: &'static str,
    /// Above it, and in the list of contents.
    pub(crate) title: Cow<'static, str>,
    pub(crate) parts: Vec<Part>,
}

impl Section {
    pub(crate) fn new(anchor: &'static str, title: &'static str) -> Self {
        Self { anchor, title: Cow::Borrowed(title), parts: Vec::new() }
    }

    /// Of what pages alone can show.
    pub(crate) fn drawn(anchor: &'static str, title: &'static str, markup: Markup) -> Self {
        Self::new(anchor, title).with(Part::Markup(markup))
    }

    pub(crate) fn with(mut self, part: impl Into<Part>) -> Self {
        self.parts.push(part.into());
        self
    }

    pub(crate) fn line(self, said: impl Into<String>) -> Self {
        self.with(Part::Line(said.into()))
    }

    pub(crate) fn lines<S: Into<String>>(self, said: impl IntoIterator<Item = S>) -> Self {
        self.with_all(said.into_iter().map(|said| Part::Line(said.into())))
    }

    pub(crate) fn note(self, said: impl Into<String>) -> Self {
        self.with(Part::Note(said.into()))
    }

    pub(crate) fn notes<S: Into<String>>(self, said: impl IntoIterator<Item = S>) -> Self {
        self.with_all(said.into_iter().map(|said| Part::Note(said.into())))
    }

    /// With a note that only readers of a page need.
    pub(crate) fn explained(self, said: impl Into<String>) -> Self {
        self.with(Part::Note(said.into()).on_page())
    }

    /// With one part more where there is one, or with several.
    pub(crate) fn with_all<P: Into<Part>>(mut self, parts: impl IntoIterator<Item = P>) -> Self {
        self.parts.extend(parts.into_iter().map(Into::into));
        self
    }
}

/// What sections are made of.
#[derive(Debug)]
pub(crate) enum Part {
    /// A sentence.
    Line(String),
    /// What explains a table or a figure.
    Note(String),
    /// What must not be overlooked.
    Warning(String),
    /// Above what follows.
    Heading(String),
    /// Short texts below each other.
    List(Vec<String>),
    Table(Table),
    Figure(Box<Figure>),
    /// Figures beside each other.
    Pair(Vec<Figure>),
    /// What a reader of a page may unfold.
    Folded {
        summary: String,
        open: bool,
        class: &'static str,
        parts: Vec<Part>,
    },
    /// What pages alone can show.
    Markup(Markup),
    /// A blank line of text.
    Gap,
    Only(Medium, Box<Part>),
}

/// Where a report is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Medium {
    Text,
    Page,
}

impl Part {
    /// Left out of pages.
    pub(crate) fn in_text(self) -> Self {
        Self::Only(Medium::Text, Box::new(self))
    }

    /// Left out of text.
    pub(crate) fn on_page(self) -> Self {
        Self::Only(Medium::Page, Box::new(self))
    }

    /// Folded, with nothing but a summary to be seen.
    pub(crate) fn folded(summary: impl Into<String>, parts: Vec<Part>) -> Self {
        Self::Folded { summary: summary.into(), open: false, class: "", parts }
    }
}

impl From<Table> for Part {
    fn from(table: Table) -> Self {
        Self::Table(table)
    }
}

impl From<Figure> for Part {
    fn from(figure: Figure) -> Self {
        Self::Figure(Box::new(figure))
    }
}

/// A table.
#[derive(Debug, Default)]
pub(crate) struct Table {
    /// What stands above it.
    pub(crate) caption: Option<String>,
    /// Its look on a page.
    pub(crate) class: &'static str,
    pub(crate) columns: Vec<Column>,
    pub(crate) rows: usize,
}

/// A column of a table.
#[derive(Debug)]
pub(crate) struct Column {
    pub(crate) title: String,
    /// What a page shows to a reader who points at the title.
    pub(crate) hint: &'static str,
    pub(crate) kind: Kind,
    /// None where it stands in both.
    pub(crate) only: Option<Medium>,
    pub(crate) cells: Vec<Cell>,
}

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Names from the model or its records, by which rows are known.
    Name,
    /// Words by which rows are known.
    Label,
    /// Words.
    Words,
    /// A unit, which pages typeset.
    Unit,
    /// Whole sentences.
    Sentence,
    /// Numbers, which stand on the right.
    Number,
    /// Several numbers, as of an interval.
    Span,
}

/// A cell of a table.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cell {
    pub(crate) text: String,
    pub(crate) mark: Mark,
    /// What else a page shows there.
    pub(crate) markup: Option<Markup>,
}

/// Whether a cell stands out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Mark {
    #[default]
    Plain,
    /// `!` in text, a colour on a page.
    Warned,
    /// A colour on a page.
    Coloured,
}

impl Cell {
    /// With an exclamation mark where it is to be looked at.
    pub(crate) fn warned(text: String, warned: bool) -> Self {
        Self { text, mark: if warned { Mark::Warned } else { Mark::Plain }, markup: None }
    }

    /// In the colour of a warning where it is to be looked at.
    pub(crate) fn coloured(text: String, coloured: bool) -> Self {
        Self { text, mark: if coloured { Mark::Coloured } else { Mark::Plain }, markup: None }
    }

    /// What only a page shows.
    pub(crate) fn drawn(markup: Option<Markup>) -> Self {
        Self { markup, ..Self::default() }
    }
}

impl<T: ToString> From<T> for Cell {
    fn from(text: T) -> Self {
        Self { text: text.to_string(), ..Self::default() }
    }
}

/// A table that is being made, column by column, of one thing a row.
pub(crate) struct Rows<R> {
    rows: Vec<R>,
    table: Table,
}

impl<R> Rows<R> {
    pub(crate) fn over(rows: impl IntoIterator<Item = R>) -> Self {
        let rows: Vec<R> = rows.into_iter().collect();
        let table = Table { rows: rows.len(), ..Table::default() };
        Self { rows, table }
    }

    fn column<C: Into<Cell>>(&mut self, kind: Kind, title: &str, cell: impl FnMut(&R) -> C) -> &mut Column {
        let cells = self.rows.iter().map(cell).map(Into::into).collect();
        self.table.columns.push(Column { title: title.into(), hint: "", kind, only: None, cells });
        let last = self.table.columns.len() - 1;
        &mut self.table.columns[last]
    }

    pub(crate) fn name<C: Into<Cell>>(&mut self, title: &str, cell: impl FnMut(&R) -> C) -> &mut Column {
        self.column(Kind::Name, title, cell)
    }

    /// The runs that rows belong to, where any does.
    pub(crate) fn runs(&mut self, run: impl Fn(&R) -> Option<&str>) {
        if self.rows.iter().any(|row| run(row).is_some()) {
            self.words("run", |row| run(row).unwrap_or_default().to_string());
        }
    }

    pub(crate) fn label<C: Into<Cell>>(&mut self, title: &str, cell: impl FnMut(&R) -> C) -> &mut Column {
        self.column(Kind::Label, title, cell)
    }

    pub(crate) fn words<C: Into<Cell>>(&mut self, title: &str, cell: impl FnMut(&R) -> C) -> &mut Column {
        self.column(Kind::Words, title, cell)
    }

    /// Units; a pure number has none.
    pub(crate) fn unit(&mut self, mut unit: impl FnMut(&R) -> Option<String>) -> &mut Column {
        self.column(Kind::Unit, "unit", |row| unit(row).filter(|unit| unit != "1").unwrap_or_default())
    }

    pub(crate) fn sentence<C: Into<Cell>>(&mut self, title: &str, cell: impl FnMut(&R) -> C) -> &mut Column {
        self.column(Kind::Sentence, title, cell)
    }

    pub(crate) fn number<C: Into<Cell>>(&mut self, title: &str, cell: impl FnMut(&R) -> C) -> &mut Column {
        self.column(Kind::Number, title, cell)
    }

    pub(crate) fn span<C: Into<Cell>>(&mut self, title: &str, cell: impl FnMut(&R) -> C) -> &mut Column {
        self.column(Kind::Span, title, cell)
    }

    /// With a sentence above it.
    pub(crate) fn below(mut self, caption: impl Into<String>) -> Self {
        self.table.caption = Some(caption.into());
        self
    }

    pub(crate) fn table(self) -> Table {
        self.table
    }
}

impl<R> From<Rows<R>> for Part {
    fn from(rows: Rows<R>) -> Self {
        Self::Table(rows.table)
    }
}

impl Column {
    pub(crate) fn hint(&mut self, hint: &'static str) -> &mut Self {
        self.hint = hint;
        self
    }

    /// Left out of pages.
    pub(crate) fn in_text(&mut self) {
        self.only = Some(Medium::Text);
    }

    /// Left out of text.
    pub(crate) fn on_page(&mut self) {
        self.only = Some(Medium::Page);
    }
}
