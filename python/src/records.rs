//! A run in the channels, order and units of a model, and the files that runs are read from.

use fdm::request::{self, Role};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A run that was bound to a model.
#[pyclass(frozen, module = "fdm._fdm")]
pub(crate) struct Record {
    pub(crate) record: request::Record,
}

/// A file of a run, and how it is read.
#[pyclass(frozen, module = "fdm._fdm")]
pub(crate) struct Source {
    pub(crate) source: request::Source,
}

#[pymethods]
impl Source {
    /// Where it is.
    #[getter]
    fn path(&self) -> PathBuf {
        self.source.file.path.clone()
    }

    /// Name of the run, where a table gives one.
    #[getter]
    fn name(&self) -> Option<&str> {
        self.source.file.name.as_deref()
    }

    /// Whether it is predicted, not fitted.
    #[getter]
    fn validation(&self) -> bool {
        self.source.file.role == Role::Validation
    }

    /// This record for a run of this name.
    fn named(&self, name: String) -> Self {
        let mut source = self.source.clone();
        source.file.name = Some(name);
        Self { source }
    }

    /// The groups that it belongs to, by grouping.
    #[getter]
    fn groups(&self) -> BTreeMap<String, String> {
        self.source.file.options.groups.clone()
    }
}

/// Rows of numbers as an array (N by width).
pub(crate) fn rows<'py>(py: Python<'py>, values: &[f64], width: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let count = values.len().checked_div(width).unwrap_or(0);
    PyArray1::from_slice(py, values).reshape([count, width])
}

/// The records of several runs.
pub(crate) fn all(records: &[Py<Record>]) -> Vec<request::Record> {
    records.iter().map(|r| r.get().record.clone()).collect()
}

#[pymethods]
impl Record {
    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.record.run.name
    }

    /// Number of samples N.
    fn __len__(&self) -> usize {
        self.record.run.len()
    }

    /// Times (N), from 0.
    fn time<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.record.run.time)
    }

    /// Inputs (N by m), hidden ones behind the declared ones.
    fn inputs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let run = &self.record.run;
        rows(py, &run.inputs, run.held.len())
    }

    /// Measured outputs (N by q).
    fn measured<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let run = &self.record.run;
        rows(py, &run.measured, run.output_gaps.len())
    }

    /// This record with every number compared: with zero where none was measured. For the sensitivities of all samples.
    fn compared(&self) -> Self {
        let mut record = self.record.clone();
        record.run.measured.iter_mut().filter(|z| z.is_nan()).for_each(|z| *z = 0.0);
        Self { record }
    }

    /// Which outputs (q) have a value in any sample.
    fn measures(&self) -> Vec<bool> {
        (0..self.record.run.output_gaps.len()).map(|k| self.record.run.measures(k)).collect()
    }
}
