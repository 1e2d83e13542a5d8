//! Fits and other long work on a model and runs.

use crate::errors::refused;
use crate::model::{Answer, Files, Model};
use crate::records::{Record, all, rows};
use crate::work::watched;
use fdm::request::{self, Field, Fitted, Held, Judged, Topic};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;

/// Columns by name.
type Columns<'py> = Vec<(String, Bound<'py, PyArray1<f64>>)>;

/// A fit by any method.
#[pyclass(frozen, module = "fdm._fdm")]
pub(crate) struct Fit {
    fitted: Fitted,
    #[pyo3(get)]
    interrupted: bool,
}

/// Times (N), measurement, response and residuals (N by q each) of a run of a fit.
fn history<'py>(py: Python<'py>, run: &fdm::Run, found: &fdm::estimate::RunFit) -> PyResult<Bound<'py, PyDict>> {
    let q = run.output_gaps.len();
    let dict = PyDict::new(py);
    dict.set_item("run", &found.run)?;
    dict.set_item("time", PyArray1::from_slice(py, &run.time))?;
    dict.set_item("measured", rows(py, &run.measured, q)?)?;
    dict.set_item("response", rows(py, &found.response, q)?)?;
    dict.set_item("residuals", rows(py, &found.residuals, q)?)?;
    Ok(dict)
}

#[pymethods]
impl Fit {
    /// The model with the changes that were asked for.
    #[getter]
    fn model(&self) -> Model {
        Model { model: self.fitted.found.model().clone() }
    }

    /// Whether it converged, the data determine every parameter, and no integration error falsifies that.
    #[getter]
    fn good(&self) -> bool {
        self.fitted.answer.good
    }

    /// What the command prints, and what it says behind that.
    fn text(&self) -> (String, Vec<String>) {
        (self.fitted.answer.text.clone(), self.fitted.answer.remarks.clone())
    }

    /// The runs that were fitted.
    fn records(&self) -> Vec<Record> {
        self.fitted.session.records().into_iter().map(|record| Record { record }).collect()
    }

    /// The files that `fdm fit --out` writes.
    fn files(&self, py: Python<'_>) -> Vec<(String, Py<PyBytes>)> {
        let file = |(name, content): &(String, Vec<u8>)| (name.clone(), PyBytes::new(py, content).unbind());
        self.fitted.answer.files.iter().map(file).collect()
    }

    /// Histories of every run; none without simulation.
    fn histories<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let found = self.fitted.found.in_time().map_or(&[][..], |fit| &fit.estimate.runs);
        self.fitted.session.runs.iter().zip(found).map(|(run, found)| history(py, run, found)).collect()
    }
}

/// `fdm fit`.
#[pyfunction]
pub(crate) fn fit(
    py: Python<'_>,
    model: &Model,
    records: Vec<Py<Record>>,
    validation: Vec<Py<Record>>,
    words: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Fit> {
    let (records, validation) = (all(&records), all(&validation));
    let work =
        |watch: &request::Watch| request::fit(Held { model: &model.model, records, validation, words: &words }, watch);
    let (found, interrupted) = watched(py, progress, work)?;
    Ok(Fit { fitted: found.map_err(|e| refused(py, e))?, interrupted })
}

/// `fdm validate`: quality of the prediction as JSON of a fit, and the histories.
#[pyfunction]
pub(crate) fn validate<'py>(
    py: Python<'py>,
    files: Files,
    model: &Model,
    records: Vec<Py<Record>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String, Vec<Bound<'py, PyDict>>)> {
    let runs: Vec<fdm::Run> = all(&records).into_iter().map(|r| r.run).collect();
    let (found, interrupted) = watched(py, progress, |watch| request::validate(&files, &model.model, &runs, watch))?;
    if interrupted {
        return Err(refused(py, request::Failure::Stopped(String::new())));
    }
    let found = found.map_err(|e| refused(py, e))?;
    let document = fdm::FitDocument::of(&found);
    let json = fdm::documents::to_text(&document).map_err(|e| crate::errors::said(py, e))?;
    let text = fdm::report::fit_table(&document, fdm::report::Detail::default());
    let histories = runs.iter().zip(&found.estimate.runs).map(|(run, found)| history(py, run, found));
    Ok((json, text, histories.collect::<PyResult<_>>()?))
}

/// `fdm margins` of a result.
#[pyfunction]
pub(crate) fn margins(py: Python<'_>, files: Files, words: Vec<String>) -> PyResult<Answer> {
    let told = py.detach(|| request::margins(&files, &words)).map_err(|e| refused(py, e))?;
    Ok(Answer::new(py, told, false))
}

/// `fdm diagnose`: the answer, the extended text, and the responses before and after of every run.
#[pyfunction]
pub(crate) fn diagnose<'py>(
    py: Python<'py>,
    model: &Model,
    records: Vec<Py<Record>>,
    validation: Vec<Py<Record>>,
    words: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Answer, Option<String>, Vec<Bound<'py, PyDict>>)> {
    let (records, validation) = (all(&records), all(&validation));
    let work = |watch: &request::Watch| {
        request::diagnose(Held { model: &model.model, records, validation, words: &words }, watch)
    };
    let (found, interrupted) = watched(py, progress, work)?;
    let (answer, found) = found.map_err(|e| refused(py, e))?;
    let q = model.model.layout().outputs;
    let overlay = |o: &fdm::diagnose::Overlay| {
        let dict = PyDict::new(py);
        dict.set_item("run", &o.run)?;
        dict.set_item("time", PyArray1::from_slice(py, &o.time))?;
        dict.set_item("measured", rows(py, &o.measured, q)?)?;
        dict.set_item("before", rows(py, &o.before, q)?)?;
        dict.set_item("after", rows(py, &o.after, q)?)?;
        Ok(dict)
    };
    let overlays = found.overlays.iter().map(overlay).collect::<PyResult<_>>()?;
    Ok((Answer::new(py, answer, interrupted), found.extended, overlays))
}

/// `fdm study`: the answer, and the columns of all repeats.
#[pyfunction]
pub(crate) fn study<'py>(
    py: Python<'py>,
    model: &Model,
    records: Vec<Py<Record>>,
    words: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Answer, Columns<'py>)> {
    let held = held(model, &records, &words);
    let (found, interrupted) = watched(py, progress, |watch| request::study(held, watch))?;
    let (answer, repeats) = found.map_err(|e| refused(py, e))?;
    let columns = repeats.into_iter().map(|(name, values)| (name, PyArray1::from_vec(py, values))).collect();
    Ok((Answer::new(py, answer, interrupted), columns))
}

/// A model and runs, and what is asked of them.
fn held<'h>(model: &'h Model, records: &[Py<Record>], words: &'h [String]) -> Held<'h> {
    Held { model: &model.model, records: all(records), validation: Vec::new(), words }
}

/// What work says that can be watched and stopped.
fn answered(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&request::Watch) -> Result<request::Answer, request::Failure> + Send,
) -> PyResult<Answer> {
    let (found, interrupted) = watched(py, progress, work)?;
    Ok(Answer::new(py, found.map_err(|e| refused(py, e))?, interrupted))
}

/// `fdm sample`, over these records or over the files that the result was fitted to.
#[pyfunction]
pub(crate) fn sample(
    py: Python<'_>,
    files: Files,
    records: Vec<Py<Record>>,
    words: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answer> {
    let records = all(&records);
    answered(py, progress, |watch| request::sample(&files, records, &words, watch))
}

/// What a verb answers: `profile`, or `study` with `--calibration`.
#[pyfunction]
pub(crate) fn ask(
    py: Python<'_>,
    verb: &str,
    model: &Model,
    records: Vec<Py<Record>>,
    words: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answer> {
    let held = held(model, &records, &words);
    answered(py, progress, |watch| request::ask(verb, held, watch))
}

/// `fdm design`, with the inputs of the planned runs as files.
#[pyfunction]
pub(crate) fn design(
    py: Python<'_>,
    model: &Model,
    records: Vec<Py<Record>>,
    result: Option<Files>,
    words: Vec<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Answer> {
    let held = held(model, &records, &words);
    answered(py, progress, |watch| request::design(held, result.as_deref(), watch))
}

/// `fdm spectra`.
#[pyfunction]
pub(crate) fn spectra(py: Python<'_>, model: &Model, records: Vec<Py<Record>>, words: Vec<String>) -> PyResult<Answer> {
    let held = held(model, &records, &words);
    let found = py.detach(|| request::spectra(held));
    Ok(Answer::new(py, found.map_err(|e| refused(py, e))?, false))
}

/// `fdm simulate`: outputs (N by q), how they were integrated, and what makes them wrong.
#[pyfunction]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    model: &Model,
    record: &Record,
    words: Vec<String>,
) -> PyResult<(Bound<'py, PyArray2<f64>>, String, Vec<String>)> {
    let found = py.detach(|| request::simulate(&model.model, &record.record.run, &words));
    let found = found.map_err(|e| refused(py, e))?;
    let q = model.model.layout().outputs;
    Ok((rows(py, &found.response, q)?, found.integration, found.faults))
}

/// What `fdm doctor` finds.
#[pyclass(frozen, module = "fdm._fdm")]
pub(crate) struct Doctor {
    /// What was found, what is told of it, and the map with the repairs.
    judged: (Judged, request::Answer, String),
    interrupted: bool,
}

#[pymethods]
impl Doctor {
    /// What is printed.
    fn answer(&self, py: Python<'_>) -> Answer {
        Answer::new(py, self.judged.1.clone(), self.interrupted)
    }

    /// The page: each finding with its channel drawn.
    fn page(&self, py: Python<'_>) -> String {
        py.detach(|| self.judged.0.page())
    }

    /// The map with all repairs that a map can hold.
    fn map(&self) -> &str {
        &self.judged.2
    }
}

/// `fdm doctor` beside a model.
#[pyfunction]
pub(crate) fn doctor(py: Python<'_>, model: &Model, records: Vec<Py<Record>>, words: Vec<String>) -> PyResult<Doctor> {
    let held = held(model, &records, &words);
    let (judged, interrupted) = watched(py, None, |watch| request::doctor(held, watch))?;
    Ok(Doctor { judged: judged.map_err(|e| refused(py, e))?, interrupted })
}

/// A table in memory: its name, the number of the field that is its time, and name, unit and values of every field.
type Table<'py> = (String, Option<usize>, Vec<(String, Option<String>, PyReadonlyArray1<'py, f64>)>);

/// `fdm doctor` without a model, of files and of tables in memory.
#[pyfunction]
pub(crate) fn doctor_alone(
    py: Python<'_>,
    files: Vec<PathBuf>,
    tables: Vec<Table<'_>>,
    words: Vec<String>,
) -> PyResult<Doctor> {
    let field = |(name, unit, values): (String, Option<String>, PyReadonlyArray1<'_, f64>)| Field {
        name,
        unit,
        values: values.as_array().to_vec(),
        texts: Vec::new(),
    };
    let table = |(name, time, fields): Table<'_>| {
        (name, Topic { name: String::new(), time, fields: fields.into_iter().map(field).collect() })
    };
    let tables = tables.into_iter().map(table).collect();
    let (judged, interrupted) = watched(py, None, |_| request::doctor_alone(&files, tables, &words))?;
    Ok(Doctor { judged: judged.map_err(|e| refused(py, e))?, interrupted })
}
