//! How a file separates its cells and writes its numbers, recognised from the file itself.

use super::cell;
use std::borrow::Cow;
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
    const ALL: [Self; 5] = [Self::Tab, Self::Semicolon, Self::Comma, Self::Bar, Self::Spaces];

    /// The byte that the splitter looks for; spaces have been made tabulators by [`collapse`].
    pub(crate) fn byte(self) -> u8 {
        match self {
            Self::Comma => b',',
            Self::Semicolon => b';',
            Self::Tab | Self::Spaces => b'\t',
            Self::Bar => b'|',
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

/// A splitter of text into rows; rows may have different lengths.
pub(crate) fn splitter(text: &str, delimiter: Delimiter) -> csv::Reader<&[u8]> {
    csv::ReaderBuilder::new().has_headers(false).flexible(true).delimiter(delimiter.byte()).from_reader(text.as_bytes())
}

/// Which delimiter the text is written with: the one under which most cells below the header are numbers in rows as
/// long as the header. Looks at the first hundred rows, so that a few bad rows do not mislead.
pub(crate) fn sniff(text: &str) -> Delimiter {
    let beginning = beginning(text);
    let found: Vec<_> = Delimiter::ALL.into_iter().map(|d| (d, fit(beginning, d))).collect();
    let best = found.iter().map(|(_, fit)| (fit.numbers, fit.width)).max().unwrap_or_default();
    if best.0 > 0 {
        return found.iter().find(|(_, f)| (f.numbers, f.width) == best).map_or(Delimiter::Comma, |(d, _)| *d);
    }
    // nothing fits: the header decides, words with spaces between them last
    let by_header = found.iter().find(|(d, f)| f.width > 1 && (*d != Delimiter::Spaces || f.rows_split));
    by_header.map_or(Delimiter::Comma, |(d, _)| *d)
}

/// How well a delimiter explains a text.
#[derive(Default)]
struct Fit {
    /// Cells that are numbers, in rows as long as the header; none when the header is not split at all.
    numbers: usize,
    /// Cells of the header.
    width: usize,
    /// Whether rows below the header are split too, or there are none.
    rows_split: bool,
}

fn fit(beginning: &str, delimiter: Delimiter) -> Fit {
    let text = if delimiter == Delimiter::Spaces { Cow::Owned(collapse(beginning)) } else { Cow::Borrowed(beginning) };
    let mut reader = splitter(&text, delimiter);
    let mut rows = reader.byte_records().map_while(Result::ok).map(|r| filled(&r)).filter(|row| !row.is_empty());
    let width = rows.next().map_or(0, |header| header.len());
    if width < 2 {
        return Fit { width, ..Fit::default() };
    }
    let mut fit = Fit { width, rows_split: true, numbers: 0 };
    for (k, row) in rows.enumerate() {
        if k == 0 {
            fit.rows_split = row.len() > 1;
        }
        if row.len() <= width && (row.len() == width || delimiter != Delimiter::Spaces) {
            fit.numbers += row.iter().filter(|number| **number).count();
        }
    }
    fit
}

/// For each cell whether it is a number, without the empty cells at the end of the row.
fn filled(record: &csv::ByteRecord) -> Vec<bool> {
    let blank_end = record.iter().rev().take_while(|c| c.trim_ascii().is_empty()).count();
    let cells = record.iter().take(record.len() - blank_end);
    cells.map(|c| cell::is_number(str::from_utf8(c).unwrap_or(""))).collect()
}

/// The header and the first hundred rows.
fn beginning(text: &str) -> &str {
    const ROWS: usize = 101;
    const BYTES: usize = 1 << 20;
    let (mut rows, mut end) = (0, 0);
    for line in text.split_inclusive(['\n', '\r']) {
        end += line.len();
        rows += usize::from(!line.trim().is_empty());
        if rows == ROWS || (rows > 1 && end > BYTES) {
            break;
        }
    }
    &text[..end]
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delimiters_are_recognised() {
        let cases = [
            ("t,x\n0,1\n1,2\n", Delimiter::Comma),
            ("t;x\n1,5;2,5\n", Delimiter::Semicolon),
            ("t;x\n1;2\n", Delimiter::Semicolon),
            ("t\tx, y\tz\n0,5\t1\t2\n", Delimiter::Tab),
            ("t x\n0,1 2,5\n", Delimiter::Spaces),
            ("  t [s]   roll angle\n 0.0   1.0  3\n", Delimiter::Spaces),
            ("t|x\n0|1\n", Delimiter::Bar),
            ("Time (sec), Heater 1 (%)\n0,0\n1.5,0\n", Delimiter::Comma),
            ("t, x\n0, 1\n1, 2\n", Delimiter::Comma),
            ("t,x\n0,1\n1,2,3\nabc,4\n,\n5,\n", Delimiter::Comma),
            ("\"a;b\",t\n1,2\n", Delimiter::Comma),
            ("t,comment\n0,ok; x; y\n1,no; 5; 6\n", Delimiter::Comma),
            ("roll angle\n1\n2\n", Delimiter::Comma),
            ("x\n1,5\n2,5\n", Delimiter::Comma),
            ("t x\n", Delimiter::Spaces),
            ("a b;c\nx;y\n", Delimiter::Semicolon),
        ];
        for (text, expected) in cases {
            assert_eq!(sniff(text), expected, "{text:?}");
        }
    }

    #[test]
    fn spaces_become_tabulators_between_cells_only() {
        let text = "  t [s]  a (m / s)\t\"b c\" \r\n 0   1 2 \n\n[x 1";
        assert_eq!(collapse(text), "t [s]\ta (m / s)\t\"b c\"\r\n0\t1\t2\n\n[x\t1");
    }
}
