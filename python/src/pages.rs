//! Pages and figures, from the files of a result.

use crate::errors::{refused, said};
use crate::model::Files;
use fdm::ResultFolder;
use fdm::page;
use fdm::report::page::{Paper, Subject, drawings};
use fdm::request::Failure;
use fdm::store::{Destination, whole_files};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// The page as `fdm report` writes it.
#[pyfunction]
pub(crate) fn page_of(py: Python<'_>, files: Files) -> PyResult<String> {
    py.detach(|| Subject::from_files(&files).map(|subject| page(&subject))).map_err(|e| said(py, e))
}

/// The figures of the page: name, caption and SVG of each.
#[pyfunction]
pub(crate) fn figures_of(py: Python<'_>, files: Files, dark: bool) -> PyResult<Vec<(String, String, String)>> {
    let paper = if dark { Paper::Dark } else { Paper::Light };
    let drawn = py.detach(|| {
        let all = drawings(&Subject::from_files(&files)?);
        Ok(all.iter().map(|d| (d.name().to_string(), d.caption().to_string(), d.svg(paper))).collect())
    });
    drawn.map_err(|e: page::SubjectError| said(py, e))
}

/// 95 % intervals of the parameters of a result, where they have one.
#[pyfunction]
pub(crate) fn intervals(py: Python<'_>, files: Files) -> PyResult<Vec<Option<[f64; 2]>>> {
    let kept = ResultFolder::from_files("the result", &files).map_err(|e| said(py, e))?;
    Ok(match kept.result().fit() {
        Some(fit) => fit.parameters.iter().map(|p| p.interval()).collect(),
        None => vec![None; kept.parameters().len()],
    })
}

/// Writes a result folder: all of it or nothing.
#[pyfunction]
pub(crate) fn write(py: Python<'_>, folder: PathBuf, files: Files, force: bool) -> PyResult<()> {
    let written = py.detach(|| {
        let names: Vec<String> = files.iter().map(|(name, _)| name.clone()).collect();
        Destination::prepare_for(&folder, &names, force)?.fill(&files)
    });
    written.map_err(|e| said(py, e))
}

/// The files of a result folder, every one of them as it was written.
#[pyfunction]
pub(crate) fn open(py: Python<'_>, folder: PathBuf) -> PyResult<Vec<(String, Py<PyBytes>)>> {
    let files = py.detach(|| whole_files(&folder)).map_err(|e| refused(py, Failure::Input(vec![e.to_string()])))?;
    Ok(files.into_iter().map(|(name, content)| (name, PyBytes::new(py, &content).unbind())).collect())
}
