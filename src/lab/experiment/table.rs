//! A record as columns: what is written to a file, and what a model's runs are read from.

use super::experiment_error::ExperimentError;
use fdm_system::record::{Column, write};
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

    /// Writes the record to a folder and says where.
    ///
    /// # Errors
    /// As [`write()`].
    pub fn write(&self, folder: &Path) -> Result<PathBuf, ExperimentError> {
        let path = folder.join(format!("{}.csv", self.name.replace([' ', '/'], "_")));
        let mut columns = Vec::with_capacity(self.columns.len());
        for (name, unit, values) in &self.columns {
            columns.push(Column { name, unit: unit.as_deref(), values });
        }
        write(&path, &columns)?;
        Ok(path)
    }
}
