//! A file as a table of columns: one for every format, made of the cells of a text, or of the fields of a topic.

use super::column::{Builder, Column};
use super::error::{Fault, Names, Problem};
use super::grid::{Delimiter, Rows, collapse};
use super::heading::Heading;
use super::layout::{self, Layout};
use super::note::Note;
use super::shape;
use super::text::{self, Decoded};
use csv::ByteRecord;
use fdm_readers::{Field, Sheet, Topic};

/// Columns over the same rows.
#[derive(Debug, Default)]
pub(crate) struct Table {
    /// The format, as people call it.
    pub(crate) format: &'static str,
    /// What separates the cells of a text.
    pub(crate) delimiter: Option<Delimiter>,
    /// The columns, in the order of the file; those without a title are kept with an empty name.
    pub(crate) columns: Vec<Column>,
    /// Lines of the rows (N); empty where rows are samples.
    pub(crate) lines: Vec<usize>,
    /// What a row is called in a message.
    pub(crate) place: &'static str,
    /// Line of the header; none where there are no lines.
    pub(crate) header_line: Option<usize>,
    /// Rows with more or fewer cells than the header: line, cells, and what may be the cause.
    pub(crate) ragged: Vec<(usize, usize, Option<&'static str>)>,
    /// Whether the last line ends as a line; a file that was cut does not.
    pub(crate) ended: bool,
    /// Channels about which a map says how they go between samples.
    pub(crate) held: Vec<(String, bool)>,
    /// What the file says of itself above its table.
    pub(crate) about: Vec<(String, String)>,
    /// Whether the file holds no names of its columns.
    pub(crate) unnamed: bool,
    /// What was understood.
    pub(crate) notes: Vec<Note>,
}

/// What a ragged row may be.
const OPEN_QUOTE: &str = "a quote that opens in this line is not closed in it";
/// What the last row may be.
pub(crate) const CUT: &str = "the file ends here without a line end; it may have been cut off";

impl Table {
    /// Columns of numbers.
    pub(crate) fn of_columns(format: &'static str, columns: Vec<Column>) -> Self {
        Self { format, columns, place: "sample", ended: true, ..Self::default() }
    }

    /// The table of a text.
    pub(crate) fn of_text(bytes: Vec<u8>) -> Result<Self, Problem> {
        let decoded = text::decode(bytes)?;
        if text::is_model(&decoded.text) {
            let hint = "records stand behind the model, `fdm fit MODEL RECORD`: tables such as CSV with a header `t [s],u [V],..`";
            return Err(Fault::IsModel.anywhere().hint(hint));
        }
        let encoding = decoded.encoding;
        let mut table = Self::of_decoded(decoded, None)?;
        table.notes.extend(encoding.map(|e| Note::Layout(format!("the text is written in {e}"))));
        Ok(table)
    }

    /// The table of a sheet; none where it holds no row of numbers.
    pub(crate) fn of_sheet(format: &'static str, sheet: &Sheet) -> Result<Option<Self>, Problem> {
        if sheet.text.trim().is_empty() {
            return Ok(None);
        }
        let decoded = Decoded { text: sheet.text.clone(), ..Decoded::default() };
        let table = Self::of_decoded(decoded, Some(sheet.titled))?;
        if !table.columns.iter().any(Column::has_numbers) {
            return Ok(None);
        }
        Ok(Some(Self { format, delimiter: None, place: "row", ended: true, ..table }))
    }

    /// The table of a topic.
    pub(crate) fn of_topic(format: &'static str, topic: Topic) -> Self {
        let columns = topic.fields.into_iter().map(|field| {
            let heading = heading(&field);
            match field.texts.is_empty() {
                true => Column::of_numbers(heading, field.values),
                false => Column::of_cells(heading, field.texts.iter().map(String::as_str)),
            }
        });
        Self::of_columns(format, columns.collect()).shaped()
    }

    fn of_decoded(decoded: Decoded, sheet: Option<bool>) -> Result<Self, Problem> {
        let Decoded { text, comments, .. } = decoded;
        let ended = text.ends_with(['\n', '\r']);
        let (labels, text) = match shape::labelled(&text) {
            Some((labels, text)) => (labels, text),
            None => (Vec::new(), text),
        };
        let mut layout = layout::find(&text, &comments, sheet.map(|_| Delimiter::Tab));
        if sheet == Some(true) {
            layout = titled(&text, layout);
        }
        let text = if layout.delimiter == Delimiter::Spaces { collapse(&text) } else { text };
        let length = layout.headings.iter().map(|c| c.title.chars().count()).max().unwrap_or(0);
        if length > Heading::LONGEST {
            return Err(Fault::LongName(length).at(layout.header_line));
        }
        if let Some(lying) = shape::lying(&text, &layout) {
            return Ok(Self { ended, ..lying });
        }
        let Layout { delimiter, mut headings, header_line, first_line, width, about, mut notes } = layout;
        if headings.is_empty() && labels.len() == width {
            headings = labels.iter().map(|name| Heading::new(name)).collect();
            notes.push(Note::Layout("the names of the columns stand before each value".into()));
        }
        let unnamed = headings.is_empty();
        if unnamed {
            headings = (1..=width).map(|k| Heading::new(&format!("#{k}"))).collect();
            let said = format!("no line above the rows holds names: the columns are called `#1` to `#{width}`");
            notes.push(Note::Layout(said));
        }
        let table = Self {
            format: "text",
            delimiter: Some(delimiter),
            place: "line",
            header_line: Some(header_line),
            ended,
            about,
            unnamed,
            notes,
            ..Self::default()
        };
        Ok(table.filled(&text, first_line, headings)?.shaped())
    }

    /// With the rows of a text from a line on.
    fn filled(mut self, text: &str, first_line: usize, headings: Vec<Heading>) -> Result<Self, Problem> {
        let width = headings.len();
        let mut columns: Vec<Builder> = headings.into_iter().map(Builder::new).collect();
        let mut rows = Rows::new(text, offset_of(text, first_line), self.delimiter.unwrap_or(Delimiter::Comma));
        let mut record = ByteRecord::new();
        // lines that hold no number may be the foot of the table
        let mut foot: Vec<(usize, Vec<String>)> = Vec::new();
        while let Some(row) = rows.read(&mut record)? {
            let cell = |k: usize| record.get(k).and_then(|c| str::from_utf8(c).ok()).unwrap_or("").trim();
            let longer = record.len() > width && (width..record.len()).any(|k| !cell(k).is_empty());
            let ragged = record.len() < width || longer;
            let words = (0..record.len()).all(|k| matches!(text::scan(cell(k)), text::Cell::Text | text::Cell::Gap));
            if words && !(0..record.len()).any(|k| super::clock::is_stamp(cell(k))) && (ragged || !cell(0).is_empty()) {
                foot.push((row.line, (0..record.len()).map(|k| cell(k).to_string()).collect()));
                continue;
            }
            for (line, cells) in foot.drain(..) {
                self.row(&mut columns, line, &cells.iter().map(String::as_str).collect::<Vec<_>>());
            }
            if ragged {
                let lines = text[row.start..row.end].trim_end().lines().count();
                let hint = match () {
                    () if lines > 1 => Some(OPEN_QUOTE),
                    () if row.end >= text.len() && !self.ended => Some(CUT),
                    () => None,
                };
                self.ragged.push((row.line, record.len(), hint));
                continue;
            }
            self.lines.push(row.line);
            (0..width).for_each(|k| columns[k].push(cell(k)));
        }
        if self.lines.is_empty() || foot.len() > FOOT {
            for (line, cells) in foot.drain(..) {
                self.row(&mut columns, line, &cells.iter().map(String::as_str).collect::<Vec<_>>());
            }
        } else if let [(first, _), ..] = &foot[..] {
            let said = format!("{} line(s) below the rows are left out, from line {first} on", foot.len());
            self.notes.push(Note::Layout(said));
        }
        self.columns = columns.into_iter().map(Builder::finish).collect();
        Ok(self)
    }

    /// One row of cells.
    fn row(&mut self, columns: &mut [Builder], line: usize, cells: &[&str]) {
        let longer = cells.iter().skip(columns.len()).any(|c| !c.is_empty());
        if cells.len() < columns.len() || longer {
            self.ragged.push((line, cells.len(), None));
            return;
        }
        self.lines.push(line);
        columns.iter_mut().zip(cells).for_each(|(column, cell)| column.push(cell));
    }

    /// With all that is the same for every format.
    fn shaped(self) -> Self {
        let mut table = shape::long(self, &[]);
        shape::dated(&mut table);
        shape::split_seconds(&mut table);
        shape::packed(&mut table);
        shape::begun(&mut table);
        table
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.columns.first().map_or(0, |c| c.values.len())
    }

    /// A problem of the header.
    pub(crate) fn in_header(&self, fault: Fault) -> Problem {
        match self.header_line {
            Some(line) => Problem { place: self.place, ..fault.at(line) },
            None => fault.anywhere(),
        }
    }

    /// Line of a row, or its number from 1.
    pub(crate) fn line(&self, row: usize) -> usize {
        self.lines.get(row).copied().unwrap_or(row + 1)
    }

    /// Whether a row is the last of a text that does not end with a line.
    pub(crate) fn is_cut(&self, row: usize) -> bool {
        !self.ended && row + 1 == self.rows()
    }

    /// Titles of the columns that have one, for messages.
    pub(crate) fn titles(&self) -> Names {
        Names::new(self.headings().map(|c| c.title.as_str()).filter(|t| !t.is_empty()))
    }

    pub(crate) fn headings(&self) -> impl Iterator<Item = &Heading> {
        self.columns.iter().map(|c| &c.heading)
    }

    /// Whether a column holds dates or clock times.
    pub(crate) fn is_clock(&self, column: usize) -> bool {
        self.columns[column].stamps.is_some()
    }

    /// These rows of it.
    pub(crate) fn part(&self, rows: &[usize]) -> Self {
        Self {
            columns: self.columns.iter().map(|c| c.rows(rows)).collect(),
            lines: if self.lines.is_empty() { Vec::new() } else { rows.iter().map(|k| self.lines[*k]).collect() },
            ragged: self.ragged.clone(),
            held: self.held.clone(),
            about: self.about.clone(),
            notes: self.notes.clone(),
            ..*self
        }
    }
}

/// Lines below a table that say something of it; more are rows.
const FOOT: usize = 20;

/// The layout of a sheet whose first line holds the titles.
fn titled(text: &str, layout: Layout) -> Layout {
    let first = text.lines().next().unwrap_or_default();
    let headings: Vec<Heading> = first.split('\t').map(Heading::new).collect();
    let (width, notes, about) = (headings.len(), Vec::new(), Vec::new());
    Layout { headings, header_line: 1, first_line: 2, width, notes, about, ..layout }
}

/// Offset at which a line begins.
fn offset_of(text: &str, line: usize) -> usize {
    let mut at = 0;
    for (k, one) in text.split_inclusive('\n').flat_map(pieces).enumerate() {
        if k + 1 == line {
            return at;
        }
        at += one.len();
    }
    text.len()
}

/// The lines of a piece that ends with a line feed: a carriage return alone ends one too.
fn pieces(text: &str) -> impl Iterator<Item = &str> {
    let body = text.strip_suffix("\r\n").map_or(text.len(), str::len);
    let mut start = 0;
    let mut ends: Vec<usize> = text[..body].match_indices('\r').map(|(at, _)| at + 1).collect();
    if ends.last() != Some(&text.len()) {
        ends.push(text.len());
    }
    ends.into_iter().map(move |end| {
        let piece = &text[start..end];
        start = end;
        piece
    })
}

/// Slices of arrays have brackets that are no units.
fn heading(field: &Field) -> Heading {
    match &field.unit {
        None if !field.name.contains(":,") && !field.name.contains(",:") => Heading::new(&field.name),
        unit => Heading::plain(&field.name, unit.clone()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows with their lines.
    type Rows = Vec<(usize, Vec<f64>)>;

    fn table(text: &str) -> (usize, Vec<String>, Rows) {
        let table = Table::of_text(text.as_bytes().to_vec()).unwrap();
        let rows = (0..table.rows()).map(|k| (table.line(k), table.columns.iter().map(|c| c.values[k]).collect()));
        (table.header_line.unwrap(), table.headings().map(|h| h.title.clone()).collect(), rows.collect())
    }

    #[test]
    fn rows_know_their_lines_in_spite_of_comments_blanks_and_line_ends() {
        for text in [
            "# c\n\nt,x\n\n0,1\n% \"c\n  \n,\n2,3",
            "# c\r\n\r\nt,x\r\n\r\n0,1\r\n% \"c\r\n  \r\n,\r\n2,3\r\n",
            "# c\r\rt,x\r\r0,1\r% c\r  \r,\r2,3\r",
            "\u{feff}# c\n\n t  x \n\n 0 1\n%\n\n\n2\t3\n",
        ] {
            let (header, titles, rows) = table(text);
            assert_eq!((header, titles), (3, vec!["t".to_string(), "x".to_string()]), "{text:?}");
            assert_eq!(rows, [(5, vec![0.0, 1.0]), (9, vec![2.0, 3.0])], "{text:?}");
        }
        assert_eq!(table("t,\"a\nb\",\n0,1,\n").2[0].0, 3);
    }

    #[test]
    fn spaces_become_tabulators_between_cells_only() {
        let text = "  t [s]  a (m / s)\t\"b c\" \r\n 0   1 2 \n\n[x 1";
        assert_eq!(collapse(text), "t [s]\ta (m / s)\t\"b c\"\r\n0\t1\t2\n\n[x\t1");
    }

    #[test]
    fn the_foot_of_a_table_is_left_out() {
        let (_, _, rows) = table("t,x\n0,1\n1,2\nEnd of data\n");
        assert_eq!(rows.len(), 2);
        let table = Table::of_text(b"t,x\n0,1\nabc,de\n2,3\n".to_vec()).unwrap();
        assert_eq!((table.rows(), table.columns[0].text(1)), (3, Some("abc")));
    }
}
