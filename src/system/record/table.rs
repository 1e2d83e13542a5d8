//! A text file as a table: how it separates cells and writes numbers ([`Dialect`], recognised from the file itself), titles of columns with
//! their units, and rows of cells with their lines.

use super::error::{Fault, Names, Problem};
use super::text;
use csv::ByteRecord;
use std::borrow::Cow;
use std::fmt;

/// A file whose header has been read.
#[derive(Debug)]
pub(crate) struct Table {
    text: String,
    /// Offset of the first row below the header.
    body: usize,
    /// The columns of a file that is no text.
    pub(crate) numbers: Option<Numbers>,
    /// The format, as people call it.
    pub(crate) format: &'static str,
    /// Line of the header.
    pub(crate) header_line: usize,
    /// What separates the cells.
    pub(crate) delimiter: Delimiter,
    /// The columns, in the order of the file; those without a title are kept with an empty name.
    pub(crate) columns: Vec<Heading>,
    /// Whether the last line ends as a line; a file that was cut does not.
    pub(crate) ended: bool,
}

/// Columns of numbers.
#[derive(Debug, Default)]
pub(crate) struct Numbers {
    headings: Vec<Heading>,
    /// By column; all of one length.
    pub(crate) columns: Vec<Vec<f64>>,
    /// Channels whose values hold until the next.
    pub(crate) held: Vec<(String, bool)>,
    /// By column, in which rows its sensor was sampled; nothing where in all of them.
    pub(crate) sampled: Vec<Vec<bool>>,
}

impl Numbers {
    pub(crate) fn new(columns: Vec<(Heading, Vec<f64>)>, held: Vec<(String, bool)>) -> Self {
        let (headings, columns) = columns.into_iter().unzip();
        Self { headings, columns, held, sampled: Vec::new() }
    }

    /// Whether the sensor of a column was sampled in a row: where it was not, nothing is missing.
    pub(crate) fn is_sampled(&self, column: usize, row: usize) -> bool {
        self.sampled.get(column).and_then(|sampled| sampled.get(row)).is_none_or(|sampled| *sampled)
    }

    /// Number of samples.
    pub(crate) fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }
}

/// The title of a column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Heading {
    /// As it stands in the file.
    pub(crate) title: String,
    /// The title without the unit.
    pub(crate) name: String,
    /// What stands in the brackets at the end.
    pub(crate) unit: Option<String>,
}

impl Heading {
    /// Longest title that is accepted.
    const LONGEST: usize = 1000;

    /// `name [unit]` or `name (unit)`; brackets alone are a name, and so is an index at a name: `y[2]`, `A[1,2]`.
    pub(crate) fn new(title: &str) -> Self {
        let title = title.trim();
        let title = title.strip_prefix('"').and_then(|t| t.strip_suffix('"')).unwrap_or(title).trim();
        let split = opening(title).map(|at| (title[..at].trim_end(), title[at + 1..title.len() - 1].trim()));
        match split {
            Some((name, unit)) if !name.is_empty() && !is_element(title, name, unit) => {
                let unit = Some(unit.to_string()).filter(|u| !u.is_empty());
                Self { title: title.into(), name: name.into(), unit }
            }
            _ => Self { title: title.into(), name: title.into(), unit: None },
        }
    }
}

/// Whether a title is that of an element of a vector or matrix: no unit stands close to its name and is a number.
fn is_element(title: &str, name: &str, index: &str) -> bool {
    let part = |p: &str| !p.trim().is_empty() && p.trim().bytes().all(|b| b.is_ascii_digit());
    title[name.len()..].starts_with('[') && index.split(',').all(part)
}

/// Offset of the bracket that is closed by the last character.
fn opening(title: &str) -> Option<usize> {
    let (open, close) = match title.chars().last()? {
        ']' => ('[', ']'),
        ')' => ('(', ')'),
        _ => return None,
    };
    let mut depth = 0_usize;
    for (at, c) in title.char_indices().rev() {
        if c == close {
            depth += 1;
        } else if c == open {
            depth -= 1;
            if depth == 0 {
                return Some(at);
            }
        }
    }
    None
}

impl Table {
    /// A table of numbers.
    pub(crate) fn of_numbers(format: &'static str, mut numbers: Numbers) -> Self {
        let columns = std::mem::take(&mut numbers.headings);
        let (text, delimiter) = (String::new(), Delimiter::Comma);
        Self { text, body: 0, numbers: Some(numbers), format, header_line: 0, delimiter, columns, ended: true }
    }

    /// A problem of the header.
    pub(crate) fn in_header(&self, fault: Fault) -> Problem {
        if self.numbers.is_some() { fault.anywhere() } else { fault.at(self.header_line) }
    }

    /// What its rows are called in a message.
    pub(crate) fn place(&self) -> &'static str {
        if self.numbers.is_some() { "sample" } else { "line" }
    }

    /// Whether the first cell of a column is a date or a clock time.
    pub(crate) fn is_clock(&self, column: usize) -> bool {
        let mut record = ByteRecord::new();
        let first = self.numbers.is_none() && matches!(self.rows().read(&mut record), Ok(Some(_)));
        let cell = record.get(column).filter(|_| first).and_then(|c| str::from_utf8(c).ok());
        cell.is_some_and(|c| super::clock::stamp(c).is_some())
    }

    /// Reads the header of a text.
    pub(crate) fn new(bytes: Vec<u8>) -> Result<Self, Problem> {
        let text = text::decode(bytes)?;
        let (delimiter, ended) = (sniff(&text), text.ends_with(['\n', '\r']));
        let text = if delimiter == Delimiter::Spaces { collapse(&text) } else { text };
        let columns = Vec::new();
        let mut table =
            Self { text, body: 0, numbers: None, format: "text", header_line: 1, delimiter, columns, ended };
        let mut record = ByteRecord::new();
        let mut rows = table.rows();
        let Some(row) = rows.read(&mut record)? else { return Err(Fault::Empty.anywhere()) };
        let end = row.end;
        let mut columns: Vec<_> = record.iter().map(|c| Heading::new(str::from_utf8(c).unwrap_or(""))).collect();
        while columns.last().is_some_and(|c| c.title.is_empty()) {
            columns.pop();
        }
        (table.header_line, table.body) = (table.line(row.start), end);
        let length = columns.iter().map(|c| c.title.chars().count()).max().unwrap_or(0);
        if length > Heading::LONGEST {
            return Err(Fault::LongName(length).at(table.header_line));
        }
        table.columns = columns;
        Ok(table)
    }

    /// The rows below the header.
    pub(crate) fn rows(&self) -> Rows<'_> {
        let body = &self.text[self.body..];
        Rows { body, offset: self.body, reader: splitter(body, self.delimiter) }
    }

    /// Line of an offset that [`Row`] gave.
    pub(crate) fn line(&self, offset: usize) -> usize {
        if self.numbers.is_some() {
            return offset + 1;
        }
        text::line_of(self.text.as_bytes(), offset)
    }

    /// Whether an offset is the end of a text that does not end with a line.
    pub(crate) fn is_cut(&self, end: usize) -> bool {
        self.numbers.is_none() && end >= self.text.len() && !self.text.ends_with(['\n', '\r'])
    }

    /// Offset of the first row below the header.
    pub(crate) fn first_row(&self) -> Option<usize> {
        if self.numbers.is_some() {
            return None;
        }
        self.rows().read(&mut ByteRecord::new()).ok()?.map(|row| row.start)
    }

    /// Titles of the columns that have one, for messages.
    pub(crate) fn titles(&self) -> Names {
        Names::new(self.columns.iter().map(|c| c.title.as_str()).filter(|t| !t.is_empty()))
    }
}

/// Where a row is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    /// Offset of its first byte.
    pub(crate) start: usize,
    /// Offset behind it.
    pub(crate) end: usize,
}

/// Reads row after row.
pub(crate) struct Rows<'a> {
    body: &'a str,
    offset: usize,
    reader: csv::Reader<&'a [u8]>,
}

impl Rows<'_> {
    /// The next row that is not blank.
    pub(crate) fn read(&mut self, record: &mut ByteRecord) -> Result<Option<Row>, Problem> {
        loop {
            let start = self.reader.position().byte() as usize;
            let more = self.reader.read_byte_record(record);
            if !more.map_err(|e| Fault::Unreadable(e.to_string()).anywhere())? {
                return Ok(None);
            }
            if record.iter().any(|cell| !cell.trim_ascii().is_empty()) {
                let end = self.reader.position().byte() as usize;
                // the splitter passes over line ends before a row
                let blank = self.body.as_bytes()[start..end].iter().take_while(|b| matches!(b, b'\n' | b'\r')).count();
                return Ok(Some(Row { start: self.offset + start + blank, end: self.offset + end }));
            }
        }
    }
}

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
fn filled(record: &ByteRecord) -> Vec<bool> {
    let blank_end = record.iter().rev().take_while(|c| c.trim_ascii().is_empty()).count();
    let cells = record.iter().take(record.len() - blank_end);
    cells.map(|c| text::is_number(str::from_utf8(c).unwrap_or(""))).collect()
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

    fn heading(title: &str) -> (String, Option<String>) {
        let h = Heading::new(title);
        (h.name, h.unit)
    }

    #[test]
    fn titles_split_into_name_and_unit() {
        let pair = |name: &str, unit: Option<&str>| (name.to_string(), unit.map(str::to_string));
        assert_eq!(heading("phi [deg]"), pair("phi", Some("deg")));
        assert_eq!(heading(" Heater 1 (%) "), pair("Heater 1", Some("%")));
        assert_eq!(heading("a(m/s^(2))"), pair("a", Some("m/s^(2)")));
        assert_eq!(heading(" \"q [rad/s]\""), pair("q", Some("rad/s")));
        assert_eq!(heading("[s]"), pair("[s]", None));
        assert_eq!(heading("x []"), pair("x", None));
        assert_eq!(heading("t_s"), pair("t_s", None));
        assert_eq!(heading("y[2]"), pair("y[2]", None));
        assert_eq!(heading("y[2] [deg]"), pair("y[2]", Some("deg")));
        assert_eq!(heading("act.Y[1,2] (m)"), pair("act.Y[1,2]", Some("m")));
        assert_eq!(heading("n [1]"), pair("n", Some("1")));
        assert_eq!(heading("a) b]"), pair("a) b]", None));
    }

    fn table(text: &str) -> Vec<(usize, Vec<String>)> {
        let table = Table::new(text.as_bytes().to_vec()).unwrap();
        let (mut rows, mut record, mut found) = (table.rows(), ByteRecord::new(), Vec::new());
        found.push((table.header_line, table.columns.iter().map(|c| c.title.clone()).collect()));
        while let Some(row) = rows.read(&mut record).unwrap() {
            found
                .push((table.line(row.start), record.iter().map(|c| String::from_utf8(c.to_vec()).unwrap()).collect()));
        }
        found
    }

    #[test]
    fn rows_know_their_lines_in_spite_of_comments_blanks_and_line_ends() {
        for text in [
            "# c\n\nt,x\n\n0,1\n% \"c\n  \n,\n2,3",
            "# c\r\n\r\nt,x\r\n\r\n0,1\r\n% \"c\r\n  \r\n,\r\n2,3\r\n",
            "# c\r\rt,x\r\r0,1\r% c\r  \r,\r2,3\r",
            "\u{feff}# c\n\n t  x \n\n 0 1\n%\n\n\n2\t3\n",
        ] {
            let rows = table(text);
            assert_eq!(rows.iter().map(|r| r.0).collect::<Vec<_>>(), [3, 5, 9], "{text:?}");
            assert_eq!(rows[2].1, ["2", "3"], "{text:?}");
        }
        assert_eq!(table("t,\"a\nb\",\n0,1,\n")[1].0, 3);
    }

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
