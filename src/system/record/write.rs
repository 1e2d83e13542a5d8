//! Columns of numbers to a file that [`super::read()`] reads back to the same bits.

use super::error::{Fault, RecordError};
use super::grid::{Delimiter, Dialect, Mark};
use super::text;
use std::io::{self, Write};
use std::path::Path;

/// A column to be written.
#[derive(Debug, Clone, Copy)]
pub struct Column<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its unit, written in brackets.
    pub unit: Option<&'a str>,
    /// Its values, as many as every other column has; NaN leaves the cell empty.
    pub values: &'a [f64],
}

/// Writes columns to a file with commas and decimal points.
///
/// # Errors
/// What the operating system says when the file cannot be made or filled.
///
/// # Panics
/// When columns differ in length.
pub fn write(path: &Path, columns: &[Column<'_>]) -> Result<(), RecordError> {
    let written = std::fs::File::create(path).and_then(|file| write_to(file, Dialect::default(), columns));
    written.map_err(|e| {
        let problems = vec![Fault::Unwritable(text::reason(&e)).anywhere()];
        RecordError { file: path.display().to_string(), problems }
    })
}

/// Writes columns in any dialect: a header `name [unit]`, then numbers with as many digits as tell them apart.
///
/// # Errors
/// Those of the writer.
///
/// # Panics
/// When columns differ in length.
pub fn write_to(writer: impl Write, dialect: Dialect, columns: &[Column<'_>]) -> io::Result<()> {
    let rows = columns.first().map_or(0, |c| c.values.len());
    assert!(columns.iter().all(|c| c.values.len() == rows), "columns of one table have one length");
    let mut out = csv::WriterBuilder::new().delimiter(separator(dialect.delimiter)).from_writer(writer);
    out.write_record(columns.iter().map(|c| c.unit.map_or_else(|| c.name.into(), |u| format!("{} [{u}]", c.name))))?;
    for row in 0..rows {
        for column in columns {
            out.write_field(number(column.values[row], dialect))?;
        }
        out.write_record(None::<&[u8]>)?;
    }
    out.flush()
}

fn separator(delimiter: Delimiter) -> u8 {
    if delimiter == Delimiter::Spaces { b' ' } else { delimiter.byte() }
}

/// The shortest text that reads back as the same number.
fn number(value: f64, dialect: Dialect) -> String {
    if value.is_nan() {
        // spaces cannot stand around nothing
        return if dialect.delimiter == Delimiter::Spaces { "NaN".into() } else { String::new() };
    }
    let plain = value == 0.0 || (1e-5..1e16).contains(&value.abs());
    let text = if plain || value.is_infinite() { value.to_string() } else { format!("{value:e}") };
    if dialect.decimal == Mark::Comma { text.replace('.', ",") } else { text }
}
