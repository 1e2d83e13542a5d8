//! The cells of a text: what separates them, recognised from the file itself, and how its numbers are written ([`Dialect`]).

use super::error::{Fault, Problem};
use super::text;
use csv::ByteRecord;
use std::fmt;

/// What stands between two cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delimiter {
    /// `,`
    Comma,
    /// `;`
    Semicolon,
    /// A tabulator.
    Tab,
    /// `|`
    Bar,
    /// Any number of spaces or tabulators.
    Spaces,
}

/// What stands between the integer and the fraction of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// `1.5`
    Point,
    /// `1,5`
    Comma,
}

/// How a file is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dialect {
    /// Between cells.
    pub delimiter: Delimiter,
    /// In numbers; a point when the file has no fraction at all.
    pub decimal: Mark,
}

impl Default for Dialect {
    fn default() -> Self {
        Self { delimiter: Delimiter::Comma, decimal: Mark::Point }
    }
}

impl Delimiter {
    /// The order in which equally good readings of a file are preferred.
    pub(crate) const ALL: [Self; 5] = [Self::Tab, Self::Semicolon, Self::Comma, Self::Bar, Self::Spaces];

    /// The byte that the splitter looks for; spaces have been made tabulators by [`collapse`].
    pub(crate) fn byte(self) -> u8 {
        match self {
            Self::Comma => b',',
            Self::Semicolon => b';',
            Self::Tab | Self::Spaces => b'\t',
            Self::Bar => b'|',
        }
    }

    /// Whether a text may be split by it.
    pub(crate) fn occurs(self, text: &str) -> bool {
        match self {
            Self::Spaces => text.contains([' ', '\t']),
            other => text.as_bytes().contains(&other.byte()),
        }
    }
}

impl fmt::Display for Delimiter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Comma => "comma",
            Self::Semicolon => "semicolon",
            Self::Tab => "tabulator",
            Self::Bar => "vertical bar",
            Self::Spaces => "spaces",
        })
    }
}

impl Mark {
    /// In a sentence: a decimal ...
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Point => "point",
            Self::Comma => "comma",
        }
    }
}

/// A row of a text.
pub(crate) struct Row {
    /// Its line.
    pub(crate) line: usize,
    /// Offset of its first byte.
    pub(crate) start: usize,
    /// Offset behind it.
    pub(crate) end: usize,
}

/// Reads row after row; blank ones are passed over.
pub(crate) struct Rows<'a> {
    text: &'a str,
    offset: usize,
    reader: csv::Reader<&'a [u8]>,
    /// Up to where lines were counted.
    counted: (usize, usize),
}

impl<'a> Rows<'a> {
    /// The rows of a text from an offset on, at which a line begins.
    pub(crate) fn new(text: &'a str, offset: usize, delimiter: Delimiter) -> Self {
        let reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .delimiter(delimiter.byte())
            .from_reader(&text.as_bytes()[offset..]);
        Self { text, offset, reader, counted: (offset, text::line_of(text.as_bytes(), offset)) }
    }

    /// The next row that is not blank.
    pub(crate) fn read(&mut self, record: &mut ByteRecord) -> Result<Option<Row>, Problem> {
        let bytes = self.text.as_bytes();
        loop {
            let start = self.offset + self.reader.position().byte() as usize;
            let more = self.reader.read_byte_record(record);
            if !more.map_err(|e| Fault::Unreadable(e.to_string()).anywhere())? {
                return Ok(None);
            }
            if record.iter().any(|cell| !cell.trim_ascii().is_empty()) {
                let end = self.offset + self.reader.position().byte() as usize;
                // the splitter passes over line ends before a row
                let blank = bytes[start..end].iter().take_while(|b| matches!(b, b'\n' | b'\r')).count();
                let start = start + blank;
                let (from, line) = self.counted;
                let ends = (from..start)
                    .filter(|i| bytes[*i] == b'\n' || bytes[*i] == b'\r' && bytes.get(i + 1) != Some(&b'\n'));
                let line = line + ends.count();
                self.counted = (start, line);
                return Ok(Some(Row { line, start, end }));
            }
        }
    }
}

/// Makes every run of spaces and tabulators one tabulator, so that the splitter can split there. Brackets stay with
/// the name before them (`phi [deg]`, `a (m / s)` are one cell), quoted text stays as it is, lines stay lines.
pub(crate) fn collapse(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for line in text.split_inclusive(['\n', '\r']) {
        let body = line.trim_end_matches(['\n', '\r']);
        collapse_line(body.trim(), &mut out);
        out.push_str(&line[body.len()..]);
    }
    out
}

fn collapse_line(line: &str, out: &mut String) {
    let mut rest = line;
    while let Some(first) = rest.chars().next() {
        let blank = rest.len() - rest.trim_start().len();
        if blank > 0 {
            rest = &rest[blank..];
            let joined = closing(rest).is_some() && !rest.starts_with('"');
            out.push(if joined { ' ' } else { '\t' });
            continue;
        }
        let length = closing(rest).unwrap_or(first.len_utf8());
        // a tabulator inside brackets must not split them
        out.extend(rest[..length].chars().map(|c| if c == '\t' { ' ' } else { c }));
        rest = &rest[length..];
    }
}

/// Length of the bracketed or quoted text with which this begins; `None` when it does not, or is not closed.
fn closing(text: &str) -> Option<usize> {
    let close = match text.as_bytes().first()? {
        b'[' => ']',
        b'(' => ')',
        b'"' => '"',
        _ => return None,
    };
    text[1..].find(close).map(|at| at + 2)
}
