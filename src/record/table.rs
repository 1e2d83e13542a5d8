//! A text file as a table: titles of columns with their units, and rows of cells with their lines.

use super::dialect::{self, Delimiter};
use super::error::{Names, Problem};
use super::fault::Fault;
use super::text;
use csv::ByteRecord;
use std::path::Path;

/// A file whose header has been read.
#[derive(Debug)]
pub(crate) struct Table {
    text: String,
    /// Offset of the first row below the header.
    body: usize,
    /// Line of the header.
    pub(crate) header_line: usize,
    /// What separates the cells.
    pub(crate) delimiter: Delimiter,
    /// The columns, in the order of the file; those without a title are kept with an empty name.
    pub(crate) columns: Vec<Heading>,
    /// Whether the last line ends as a line; a file that was cut does not.
    pub(crate) ended: bool,
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
    /// Reads a file and its header.
    pub(crate) fn open(path: &Path) -> Result<Self, Problem> {
        Self::new(text::load(path)?)
    }

    /// Reads the header of a text.
    pub(crate) fn new(bytes: Vec<u8>) -> Result<Self, Problem> {
        let text = text::decode(bytes)?;
        let (delimiter, ended) = (dialect::sniff(&text), text.ends_with(['\n', '\r']));
        let text = if delimiter == Delimiter::Spaces { dialect::collapse(&text) } else { text };
        let mut table = Self { text, body: 0, header_line: 1, delimiter, columns: Vec::new(), ended };
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
        Rows { body, offset: self.body, reader: dialect::splitter(body, self.delimiter) }
    }

    /// Line of an offset that [`Row`] gave.
    pub(crate) fn line(&self, offset: usize) -> usize {
        text::line_of(self.text.as_bytes(), offset)
    }

    /// Whether an offset is the end of a text that does not end with a line.
    pub(crate) fn is_cut(&self, end: usize) -> bool {
        end >= self.text.len() && !self.text.ends_with(['\n', '\r'])
    }

    /// Offset of the first row below the header.
    pub(crate) fn first_row(&self) -> Option<usize> {
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
}
