//! What is refused, as the exceptions of `fdm._errors`: each carries text, code and place.

use fdm::record::{RecordError, RunError};
use fdm::request::Failure;
use fdm::{Diagnostic, ModelError};
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// An exception of the package with these arguments.
fn raised<'py>(py: Python<'py>, name: &str, arguments: impl pyo3::call::PyCallArgs<'py>) -> PyErr {
    let made =
        py.import("fdm._errors").and_then(|module| module.getattr(name)).and_then(|class| class.call1(arguments));
    made.map_or_else(|failure| failure, PyErr::from_value)
}

/// Wrong input that has neither code nor line: one sentence each.
pub(crate) fn input(py: Python<'_>, reasons: Vec<String>) -> PyErr {
    raised(py, "InputError", (reasons,))
}

/// Anything of the library that says in a sentence what is wrong with its input.
pub(crate) fn said(py: Python<'_>, error: impl std::fmt::Display) -> PyErr {
    input(py, vec![error.to_string()])
}

/// Numbers that went wrong.
pub(crate) fn numbers(py: Python<'_>, reason: String) -> PyErr {
    raised(py, "NumericalError", (reason,))
}

/// A request that came to nothing.
pub(crate) fn refused(py: Python<'_>, failure: Failure) -> PyErr {
    match failure {
        Failure::Words { said, unknown: Some(option) } => raised(py, "UnknownOption", (said, option)),
        Failure::Words { said, unknown: None } => raised(py, "OptionError", (said,)),
        Failure::Model(error) => model(py, &error),
        Failure::Records(errors) => records(py, &errors),
        Failure::Input(reasons) => input(py, reasons),
        Failure::Numbers(said) | Failure::Astray { said, .. } => numbers(py, said),
        Failure::Strict => numbers(py, "the records have findings, and `strict` refuses to go on".into()),
        Failure::Unwritten(file) => numbers(py, file.to_string()),
        Failure::Stopped(_) => PyKeyboardInterrupt::new_err("stopped before there was a result"),
    }
}

/// A model that cannot be read or compiled.
pub(crate) fn model(py: Python<'_>, error: &ModelError) -> PyErr {
    match error {
        ModelError::Unreadable { path, reason } => {
            raised(py, "UnreadableError", (path.display().to_string(), reason.clone()))
        }
        ModelError::Invalid { text, diagnostics } => {
            let findings = findings(py, text, diagnostics);
            let rendered = fdm::report::render(text, diagnostics, false);
            findings.map_or_else(|failure| failure, |findings| raised(py, "ModelError", (rendered, findings)))
        }
    }
}

/// Findings about a text, one dictionary each.
pub(crate) fn findings<'py>(
    py: Python<'py>,
    source: &fdm::grammar::Source,
    diagnostics: &[Diagnostic],
) -> PyResult<Bound<'py, PyList>> {
    let list = PyList::empty(py);
    for finding in diagnostics {
        let (at, to) = (source.position(finding.span.start), source.position(finding.span.end));
        let dict = PyDict::new(py);
        dict.set_item("code", finding.code.text())?;
        dict.set_item("title", finding.code.title())?;
        dict.set_item("error", finding.is_error())?;
        dict.set_item("message", &finding.message)?;
        dict.set_item("hint", finding.hint.as_deref())?;
        dict.set_item("file", source.text_at(finding.span.start).name())?;
        dict.set_item("line", at.line)?;
        dict.set_item("column", at.column)?;
        dict.set_item("end_line", to.line)?;
        dict.set_item("end_column", to.column)?;
        dict.set_item("excerpt", source.slice(finding.span))?;
        let labels = PyList::empty(py);
        for label in &finding.labels {
            let at = source.position(label.span.start);
            labels.append((at.line, at.column, &label.text))?;
        }
        dict.set_item("labels", labels)?;
        list.append(dict)?;
    }
    Ok(list)
}

/// Files that cannot be used.
pub(crate) fn records(py: Python<'_>, errors: &[RecordError]) -> PyErr {
    let text = errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    let problems: PyResult<Bound<'_, PyList>> = (|| {
        let list = PyList::empty(py);
        for error in errors {
            for problem in &error.problems {
                let dict = PyDict::new(py);
                dict.set_item("file", &error.file)?;
                dict.set_item("line", problem.line)?;
                dict.set_item("column", problem.column.as_deref())?;
                dict.set_item("message", problem.fault.to_string())?;
                dict.set_item("hint", problem.hint.as_deref())?;
                list.append(dict)?;
            }
        }
        Ok(list)
    })();
    problems.map_or_else(|failure| failure, |problems| raised(py, "RecordError", (text, problems)))
}

/// Samples in memory that cannot be used.
pub(crate) fn run(py: Python<'_>, error: &RunError) -> PyErr {
    let faults: Vec<String> = error.faults.iter().map(ToString::to_string).collect();
    raised(py, "RunError", (error.to_string(), error.run.clone(), faults))
}

/// What cannot happen unless a thread died.
pub(crate) fn lost() -> PyErr {
    PyRuntimeError::new_err("the work ended without a result")
}
