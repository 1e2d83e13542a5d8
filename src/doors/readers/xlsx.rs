//! Workbooks of Excel: each sheet is a table whose first row with text holds the names of its columns. Parts of the archive have checksums.
//!
//! Source of the cells: calamine. Formulas have the value that was stored with them.

use crate::log::{Damage, Field, Log, ReadError, Reader, Topic, time_of};
use crate::xml::refuse_endless_xml;
use crate::zip::directory;
use calamine::{DataRef, Reader as _};
use std::io::{Cursor, Read};

/// The reader.
pub(crate) struct Xlsx;

/// Seconds of a day, the unit in which Excel keeps times.
const DAY: f64 = 86_400.0;
/// Bytes that all parts of a workbook unpack to.
const LIMIT: u64 = 1 << 30;
/// Most columns of a sheet.
const WIDEST: usize = 1_000;
/// Most cells of a table.
const LARGEST: usize = 1 << 27;

impl Reader for Xlsx {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        let broken =
            |e: calamine::XlsxError| ReadError::Broken { format: "XLSX", what: e.to_string(), at: bytes.len() as u64 };
        // what is damaged is seen by our own reader of archives: calamine believes what it unpacks
        let mut source = Cursor::new(bytes);
        let mut left = LIMIT;
        for entry in directory(&mut source, "XLSX")? {
            let is_xml = [".xml", ".rels"].iter().any(|ending| entry.name.ends_with(ending));
            let look = |content: &mut dyn Read, _| {
                let mut text = Vec::new();
                if is_xml {
                    content.read_to_end(&mut text).map_err(|e| e.to_string())?;
                }
                refuse_endless_xml(&text)
            };
            entry.unpack(&mut source, left, look).flatten().map_err(|what| ReadError::Broken {
                format: "XLSX",
                what: format!("`{}` in it is lost: {what}", entry.name.escape_debug()),
                at: entry.at,
            })?;
            left -= entry.size;
        }
        let mut book = calamine::Xlsx::new(Cursor::new(bytes)).map_err(broken)?;
        let mut log = Log::default();
        let names = book.sheet_names();
        for name in &names {
            let topic = if names.len() == 1 { String::new() } else { name.clone() };
            let mut sheet = Sheet { name: topic, ..Sheet::default() };
            let read = book.worksheet_cells_reader(name).map_err(|e| e.to_string()).and_then(|mut cells| {
                while let Some(cell) = cells.next_cell().map_err(|e| e.to_string())? {
                    let (row, column) = cell.get_position();
                    sheet.take((row as usize, column as usize), cell.get_value(), &mut log)?;
                }
                Ok(())
            });
            match read {
                Ok(()) => sheet.finish(&mut log),
                Err(e) => {
                    let what = format!("the sheet `{}` is lost: {e}", name.escape_debug());
                    log.damage.push(Damage { at: bytes.len() as u64, what });
                }
            }
        }
        if log.topics.len() == 1 {
            log.topics[0].name.clear();
        }
        Ok(log)
    }
}

/// The name of a cell, as Excel shows it.
fn place(row: usize, column: usize) -> String {
    let (mut letters, mut left) = (String::new(), column + 1);
    while left > 0 {
        letters.insert(0, char::from(b'A' + ((left - 1) % 26) as u8));
        left = (left - 1) / 26;
    }
    format!("{letters}{}", row + 1)
}

/// A column that is being read.
struct Column {
    at: usize,
    title: String,
    values: Vec<f64>,
    /// Values that are dates or times.
    days: usize,
    numbers: usize,
    /// The first cell that holds a text, and where.
    text: Option<(String, String)>,
}

/// A sheet that is being read, cell by cell.
#[derive(Default)]
struct Sheet {
    name: String,
    /// The row of the titles, once it was met.
    header: Option<usize>,
    columns: Vec<Column>,
    /// Whether there is any cell.
    any: bool,
}

impl Sheet {
    /// In words, behind what is in it.
    fn of(&self) -> String {
        if self.name.is_empty() { String::new() } else { format!(" of the sheet `{}`", self.name.escape_debug()) }
    }

    /// Takes the next cell; they come row by row.
    fn take(&mut self, (row, at): (usize, usize), cell: &DataRef<'_>, log: &mut Log) -> Result<(), String> {
        let text = match cell {
            DataRef::Empty => return Ok(()),
            DataRef::String(text) => Some(text.trim()),
            DataRef::SharedString(text) => Some(text.trim()),
            DataRef::DateTimeIso(text) | DataRef::DurationIso(text) => Some(text.trim()),
            _ => None,
        };
        if text == Some("") {
            return Ok(());
        }
        self.any = true;
        if let (Some(title), true) = (text, self.header.is_none_or(|header| header == row)) {
            self.header = Some(row);
            if self.columns.len() == WIDEST {
                return Err(format!("it has more than {WIDEST} columns"));
            }
            let title = title.to_string();
            self.columns.push(Column { at, title, values: Vec::new(), days: 0, numbers: 0, text: None });
            return Ok(());
        }
        let Some(index) = self.header.filter(|header| row > *header).map(|header| row - header - 1) else {
            return Ok(());
        };
        if (index + 1).saturating_mul(self.columns.len()) > LARGEST {
            return Err(format!("it has more than {LARGEST} cells"));
        }
        let of = self.of();
        let Some(column) = self.columns.iter_mut().find(|c| c.at == at) else { return Ok(()) };
        let value = match cell {
            DataRef::Float(value) => *value,
            DataRef::Int(value) => *value as f64,
            DataRef::Bool(value) => f64::from(u8::from(*value)),
            DataRef::DateTime(when) => {
                column.days += 1;
                DAY * when.as_f64()
            }
            DataRef::Error(error) => {
                let what = format!("the cell {}{of} holds the error {error}", place(row, at));
                log.damage.push(Damage { at: 0, what });
                return Ok(());
            }
            _ => {
                let start: String = text.unwrap_or_default().chars().take(40).collect();
                column.text.get_or_insert_with(|| (place(row, at), start.escape_debug().to_string()));
                return Ok(());
            }
        };
        column.values.resize(index, f64::NAN);
        column.values.push(value);
        column.numbers += 1;
        Ok(())
    }

    /// Adds its table.
    fn finish(self, log: &mut Log) {
        let of = self.of();
        if self.any && self.header.is_none() {
            log.remarks.push(format!("no row{of} holds names of columns"));
        }
        let rows = self.columns.iter().map(|c| c.values.len()).max().unwrap_or_default();
        let mut fields = Vec::new();
        for mut column in self.columns {
            let title = column.title.escape_debug();
            match column.text {
                Some((at, text)) if column.numbers > 0 => {
                    let what = format!("the cell {at}{of} holds `{text}`, and no number");
                    log.damage.push(Damage { at: 0, what });
                }
                Some(_) => log.remarks.push(format!("`{title}`{of} holds no numbers")),
                None => {}
            }
            if column.days > 0 && column.days < column.numbers {
                let what = format!("`{title}`{of} holds dates and plain numbers");
                log.damage.push(Damage { at: 0, what });
            }
            if column.numbers > 0 {
                column.values.resize(rows, f64::NAN);
                fields.push(Field::new(column.title, Some("s").filter(|_| column.days > 0), column.values));
            }
        }
        if !fields.is_empty() {
            log.topics.push(Topic { name: self.name, time: time_of(&fields), fields });
        }
    }
}
