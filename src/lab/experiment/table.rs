//! A record as columns: what is written to a file, and what a model's runs are read from.

use super::experiment_error::ExperimentError;
use fdm_results::store::{reason, write_file};
use fdm_system::record::{Column, Dialect, write_to};
use std::path::{Path, PathBuf};

/// The columns of a record that was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Name of the record, and of its file.
    pub name: String,
    /// Name, unit and values of each column; the time is the first.
    pub columns: Vec<(String, Option<String>, Vec<f64>)>,
}

impl Table {
    /// The samples `first..first + count`, with a clock of their own.
    #[must_use]
    pub fn part(&self, name: String, first: usize, count: usize) -> Self {
        let cut = |values: &[f64]| {
            let end = values.len().min(first + count);
            values[first.min(end)..end].to_vec()
        };
        let mut columns: Vec<_> = self.columns.iter().map(|(n, u, v)| (n.clone(), u.clone(), cut(v))).collect();
        if let Some((_, _, time)) = columns.first_mut()
            && let Some(begin) = time.first().copied()
        {
            time.iter_mut().for_each(|t| *t -= begin);
        }
        Self { name, columns }
    }

    /// The name of its file.
    pub fn file(&self) -> String {
        format!("{}.csv", self.name.replace([' ', '/'], "_"))
    }

    /// What its file holds.
    ///
    /// # Panics
    /// When columns differ in length.
    pub fn bytes(&self) -> Vec<u8> {
        let mut columns = Vec::with_capacity(self.columns.len());
        for (name, unit, values) in &self.columns {
            columns.push(Column { name, unit: unit.as_deref(), values });
        }
        let mut bytes = Vec::new();
        // memory takes everything that is written to it
        let _ = write_to(&mut bytes, Dialect::default(), &columns);
        bytes
    }

    /// Writes the record to a folder and says where.
    ///
    /// # Errors
    /// [`ExperimentError::Unwritable`]; a file that stood there before stands there still then.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, ExperimentError> {
        let path = folder.join(self.file());
        match write_file(&path, &self.bytes()) {
            Ok(()) => Ok(path),
            Err(e) => Err(ExperimentError::Unwritable { reason: reason(&e), file: path }),
        }
    }
}
