//! Workbooks of Excel: each sheet as its cells. Parts of the archive have checksums.
//!
//! Source of the cells: calamine. Formulas have the value that was stored with them.

use crate::log::{Damage, Log, ReadError, Reader, Sheet};
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
const LARGEST: usize = 1 << 25;

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
            let mut sheet = Cells { sheet: Sheet { name: topic, ..Sheet::default() }, ..Cells::default() };
            let read = book.worksheet_cells_reader(name).map_err(|e| e.to_string()).and_then(|mut cells| {
                while let Some(cell) = cells.next_cell().map_err(|e| e.to_string())? {
                    let (row, column) = cell.get_position();
                    sheet.take((row as usize, column as usize), cell.get_value())?;
                }
                Ok(())
            });
            match read {
                Ok(()) => log.sheets.push(sheet.finish()),
                Err(e) => {
                    let what = format!("the sheet `{}` is lost: {e}", name.escape_debug());
                    log.damage.push(Damage { at: bytes.len() as u64, what });
                }
            }
        }
        Ok(log)
    }
}

/// Cells of a sheet, which come row by row.
#[derive(Default)]
struct Cells {
    sheet: Sheet,
    count: usize,
    /// Cells of the widest row.
    width: usize,
    rows: Vec<Vec<String>>,
}

impl Cells {
    /// Takes the next cell.
    fn take(&mut self, (row, at): (usize, usize), cell: &DataRef<'_>) -> Result<(), String> {
        let Some(text) = written(cell) else { return Ok(()) };
        if at >= WIDEST {
            return Err(format!("it has more than {WIDEST} columns"));
        }
        self.count = self.count.max(row.saturating_mul(self.width.max(at + 1)));
        if self.count > LARGEST {
            return Err(format!("it has more than {LARGEST} cells"));
        }
        if self.rows.len() <= row {
            self.rows.resize(row + 1, Vec::new());
        }
        let cells = &mut self.rows[row];
        if cells.len() <= at {
            cells.resize(at + 1, String::new());
        }
        cells[at] = text;
        self.width = self.width.max(at + 1);
        Ok(())
    }

    fn finish(mut self) -> Sheet {
        let empty = String::new();
        for cells in &self.rows {
            let padded = (0..self.width).map(|k| cells.get(k).unwrap_or(&empty).as_str());
            self.sheet.push(padded);
        }
        self.sheet
    }
}

/// What a cell holds, as text; dates and times are written as ISO 8601 has them, errors as Excel shows them.
fn written(cell: &DataRef<'_>) -> Option<String> {
    Some(match cell {
        DataRef::Empty => return None,
        DataRef::String(text) => text.trim().to_string(),
        DataRef::SharedString(text) => text.trim().to_string(),
        DataRef::DateTimeIso(text) | DataRef::DurationIso(text) => text.trim().to_string(),
        DataRef::Float(value) => value.to_string(),
        DataRef::Int(value) => value.to_string(),
        DataRef::Bool(value) => u8::from(*value).to_string(),
        DataRef::DateTime(when) => instant(when.as_f64()),
        DataRef::Error(error) => error.to_string(),
    })
}

/// Days of Excel, which counts from the end of 1899: a date with its time, or a time alone.
fn instant(days: f64) -> String {
    // a double holds days of our time to the microsecond
    let micros = (days * DAY * 1e6).round();
    let (day, micros) = ((micros / (DAY * 1e6)).floor(), micros.rem_euclid(DAY * 1e6) as u64);
    let (seconds, fraction) = (micros / 1_000_000, micros % 1_000_000);
    let clock = format!("{:02}:{:02}:{:02}.{fraction:06}", seconds / 3600, seconds / 60 % 60, seconds % 60);
    if day < 1.0 { clock } else { format!("{}T{clock}", date(day as i64)) }
}

/// The date of a day of Excel (Howard Hinnant's `civil_from_days`).
fn date(day: i64) -> String {
    // 25569 days of Excel lie before 1970, and 719468 before that since the March of the year 0
    let z = day - 25_569 + 719_468;
    let era = z.div_euclid(146_097);
    let of_era = z.rem_euclid(146_097);
    let of_four = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * of_four + of_four / 4 - of_four / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = of_four + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}
