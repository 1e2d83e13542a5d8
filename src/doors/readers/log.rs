//! What a file holds: topics, each a table of fields over one clock; and what of it is damaged.

use std::fmt;
use std::io::{Read, Seek};

/// Everything that was read from a file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Log {
    /// The format, as people call it.
    pub format: &'static str,
    /// The topics, in the order of the file.
    pub topics: Vec<Topic>,
    /// Tables of cells as they stand: of which of them are names and units nothing is known yet.
    pub sheets: Vec<Sheet>,
    /// What could not be read, and where; empty for a whole file.
    pub damage: Vec<Damage>,
    /// What else is to be known: fields that hold no numbers, dropouts that the logger itself reports.
    pub remarks: Vec<String>,
}

/// A table of cells: rows are lines, tabulators stand between cells, which hold neither.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Sheet {
    /// Its name.
    pub name: String,
    /// The cells; numbers are written with all their digits.
    pub text: String,
    /// Whether the first row is known to hold the names of the columns.
    pub titled: bool,
}

/// A table of fields over one clock: a message of a logger, or the arrays of one length of a data file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Topic {
    /// Its name; empty for the only table of a file.
    pub name: String,
    /// The field that is its time, where it has one.
    pub time: Option<usize>,
    /// The fields, all of one length (N).
    pub fields: Vec<Field>,
}

/// One column of numbers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Field {
    /// Its name in the topic.
    pub name: String,
    /// Its unit, where the file states it.
    pub unit: Option<String>,
    /// Its values (N); NaN where the file has none. Nothing for a column of texts.
    pub values: Vec<f64>,
    /// Its texts (N), where it holds some; nothing for a column of numbers.
    pub texts: Vec<String>,
}

/// A part of a file that could not be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Offset in the file, in bytes.
    pub at: u64,
    /// What is wrong there, and what is lost by it.
    pub what: String,
}

/// A file of which nothing can be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// The build has no reader for it.
    #[error("this is {format}, whose reader is not in this build; build with `--features {feature}`")]
    Off {
        /// The format.
        format: &'static str,
        /// The feature of Cargo that switches its reader on.
        feature: &'static str,
    },
    /// Another format, which other programs write as one that is read.
    #[error("this is {format}, which is not read: {how}")]
    Foreign {
        /// The format.
        format: &'static str,
        /// What writes it as a format that is read.
        how: &'static str,
    },
    /// It is of no format that is known.
    #[error("the file is none of the formats that are read ({0})")]
    Unknown(String),
    /// The operating system does not give its bytes.
    #[error("the file cannot be read: {0}")]
    Unread(String),
    /// The bytes are not what the format prescribes.
    #[error("the {format} file cannot be read: {what}, at byte {at}")]
    Broken {
        /// The format.
        format: &'static str,
        /// What is wrong.
        what: String,
        /// Where.
        at: u64,
    },
    /// The contents are larger than is read.
    #[error("the contents of the {format} file are larger than the limit of {} GiB", .limit >> 30)]
    TooLarge {
        /// The format.
        format: &'static str,
        /// The limit in bytes.
        limit: u64,
    },
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "at byte {}: {}", self.at, self.what)
    }
}

impl Field {
    /// A column of this name.
    pub fn new(name: impl Into<String>, unit: Option<&str>, values: Vec<f64>) -> Self {
        Self { name: name.into(), unit: unit.map(String::from), values, texts: Vec::new() }
    }

    /// A column of texts.
    pub fn of_texts(name: impl Into<String>, texts: Vec<String>) -> Self {
        Self { name: name.into(), unit: None, values: Vec::new(), texts }
    }

    /// Number of samples.
    pub fn rows(&self) -> usize {
        self.values.len().max(self.texts.len())
    }
}

impl Sheet {
    /// Adds a row; line ends and tabulators in cells become spaces.
    #[cfg(any(feature = "json", feature = "xlsx"))]
    pub(crate) fn push<'c>(&mut self, cells: impl IntoIterator<Item = &'c str>) {
        for (k, cell) in cells.into_iter().enumerate() {
            if k > 0 {
                self.text.push('\t');
            }
            let plain = |c: char| if matches!(c, '\t' | '\n' | '\r' | '"') { ' ' } else { c };
            self.text.extend(cell.chars().map(plain));
        }
        self.text.push('\n');
    }
}

impl Topic {
    /// Number of samples.
    pub fn rows(&self) -> usize {
        self.fields.first().map_or(0, Field::rows)
    }

    /// The field of this name.
    pub fn field(&self, name: &str) -> Option<&Field> {
        self.fields.iter().find(|field| field.name == name)
    }

    /// The times in seconds (N), where the topic has a time in a unit that is known.
    pub fn seconds(&self) -> Option<Vec<f64>> {
        let field = &self.fields[self.time?];
        let second = in_seconds(field.unit.as_deref().unwrap_or("s"))?;
        // a division by a whole number is exact where a product with its inverse is not
        Some(if second < 1.0 {
            let parts = (1.0 / second).round();
            field.values.iter().map(|t| t / parts).collect()
        } else {
            field.values.iter().map(|t| t * second).collect()
        })
    }
}

/// A unit of time in seconds.
pub(crate) fn in_seconds(unit: &str) -> Option<f64> {
    Some(match unit {
        "s" => 1.0,
        "ms" => 1e-3,
        "us" | "µs" => 1e-6,
        "ns" => 1e-9,
        "min" => 60.0,
        "h" => 3600.0,
        "d" => 86_400.0,
        _ => return None,
    })
}

impl Log {
    /// Names of all topics.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.topics.iter().map(|topic| topic.name.as_str())
    }

    /// The topic and field that `topic.field` names, or `field` alone in a file of one table. The first instance of a topic may be named
    /// without its number.
    pub fn find(&self, path: &str) -> Option<(usize, usize)> {
        let inside = |k: usize, name: &str| self.topics[k].fields.iter().position(|f| f.name == name).map(|f| (k, f));
        for (k, topic) in self.topics.iter().enumerate() {
            let named = |name: &str| path.strip_prefix(name).and_then(|rest| rest.strip_prefix('.'));
            let first = topic.name.strip_suffix("[0]");
            let rest =
                if topic.name.is_empty() { Some(path) } else { named(&topic.name).or_else(|| first.and_then(named)) };
            if let Some(found) = rest.and_then(|field| inside(k, field)) {
                return Some(found);
            }
        }
        // in a file of one table of values a field's own name says enough
        let mut holding = (0..self.topics.len()).filter_map(|k| inside(k, path));
        match (holding.next(), holding.next()) {
            (Some(found), None) => Some(found),
            _ => None,
        }
    }
}

/// Adds the arrays of a data file as topics: those of one length stand over one clock, which is the array named as times are.
#[cfg(any(feature = "json", feature = "npz", feature = "mat", feature = "hdf5", feature = "parquet"))]
pub(crate) fn by_length(fields: Vec<Field>) -> Vec<Topic> {
    let mut lengths: Vec<usize> = Vec::new();
    for field in &fields {
        if !lengths.contains(&field.rows()) {
            lengths.push(field.rows());
        }
    }
    let several = lengths.iter().filter(|n| **n > 1).count() > 1;
    let mut topics: Vec<Topic> =
        lengths.iter().map(|n| Topic { name: name_of(*n, several), ..Topic::default() }).collect();
    for field in fields {
        let k = lengths.iter().position(|n| *n == field.rows()).unwrap_or(0);
        topics[k].fields.push(field);
    }
    for topic in &mut topics {
        topic.time = time_of(&topic.fields);
    }
    topics
}

/// The columns of a matrix (rows by columns), whose number at a row and column `at` gives: of one far wider than high the rows are signals.
#[cfg(any(feature = "npz", feature = "mat", feature = "hdf5"))]
pub(crate) fn of_matrix(
    (rows, columns): (usize, usize),
    name: &dyn Fn(Option<usize>, Option<usize>) -> String,
    at: &dyn Fn(usize, usize) -> f64,
) -> Vec<Field> {
    /// A table has more samples than signals.
    const WIDER: usize = 8;
    if rows > 1 && columns > WIDER * rows {
        let signal = |r| Field::new(name(Some(r), None), None, (0..columns).map(|c| at(r, c)).collect());
        return (0..rows).map(signal).collect();
    }
    let column = |c| Field::new(name(None, Some(c)), None, (0..rows).map(|r| at(r, c)).collect());
    (0..columns).map(column).collect()
}

/// One value is a constant beside the tables, and not a table.
#[cfg(any(feature = "json", feature = "npz", feature = "mat", feature = "hdf5", feature = "parquet"))]
fn name_of(length: usize, several: bool) -> String {
    match length {
        1 => "constants".into(),
        _ if several => format!("length {length}"),
        _ => String::new(),
    }
}

/// The field that is the time by its name.
#[cfg(any(feature = "json", feature = "npz", feature = "mat", feature = "hdf5", feature = "parquet"))]
pub(crate) fn time_of(fields: &[Field]) -> Option<usize> {
    let is = |wanted: &dyn Fn(&str) -> bool| fields.iter().position(|f| wanted(&f.name));
    is(&|n| n == "t")
        .or_else(|| is(&|n| n.eq_ignore_ascii_case("time")))
        .or_else(|| is(&|n| n == "T"))
        .or_else(|| is(&|n| n.ends_with(".t") || n.to_ascii_lowercase().ends_with(".time")))
        .or_else(|| is(&|n| n.ends_with("/t") || n.to_ascii_lowercase().ends_with("/time")))
}

/// What reads the files of one format.
pub(crate) trait Reader {
    /// All that the bytes hold, with what is damaged in them.
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError>;

    /// All that a file holds which is open, with what is damaged in it; most formats are read into memory first.
    fn read_from(&self, source: &mut dyn Source) -> Result<Log, ReadError> {
        let mut bytes = Vec::new();
        let read = source.rewind().and_then(|()| source.read_to_end(&mut bytes));
        read.map_err(|e| ReadError::Unread(e.to_string()))?;
        self.read(&bytes)
    }
}

/// What can be read from any place.
pub(crate) trait Source: Read + Seek {}

impl<T: Read + Seek> Source for T {}
