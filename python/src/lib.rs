//! fdm in Python: the extension module `fdm._fdm` below the package `fdm`.
//!
//! Thin on purpose: words, defaults and refusals are those of the command ([`fdm::request`]); what a Python user sees is written in
//! Python. There is no state but the threads.

mod errors;
mod model;
mod pages;
mod records;
mod residuals;
mod results;
mod work;

use pyo3::prelude::*;
use std::ffi::OsString;
use std::process::ExitCode;

/// What the command `fdm` does with these words; its exit code.
#[pyfunction]
fn command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    let code = py.detach(|| fdm::main_with(words));
    (0..=u8::MAX).find(|number| code == ExitCode::from(*number)).unwrap_or(1)
}

/// fdm's extension module; the package `fdm` is what programs use.
#[pymodule]
mod _fdm {
    #[pymodule_export]
    use super::command;
    #[pymodule_export]
    use super::model::{Answer, Model};
    #[pymodule_export]
    use super::pages::{figures_of, intervals, open, page_of, write};
    #[pymodule_export]
    use super::records::{Record, Source};
    #[pymodule_export]
    use super::residuals::Residuals;
    #[pymodule_export]
    use super::results::{
        Doctor, Fit, ask, design, diagnose, doctor, doctor_alone, fit, margins, sample, simulate, spectra, study,
        validate,
    };
    #[pymodule_export]
    use super::work::{set_threads, threads};
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
