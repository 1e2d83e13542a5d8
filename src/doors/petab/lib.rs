//! PEtab problems and SBML models: **in** the files of a problem, **out** a readable model of the language, its records, and a report of what
//! was left out ([`Import`]); and the way back, from a model with its records to the files of a problem ([`problem()`]).
//!
//! **Never** simulates, and never guesses: what the language or the estimation has not is refused in words, with file, line and column.
//! **Start** at [`import`] (tables, expressions, values by experiment, text). PEtab: Schmiester and others, PLOS Computational Biology 17 (2021).

mod events;
mod experiments;
mod expression;
mod formula;
mod mathml;
mod problem;
mod records;
mod sbml;
mod sbml_text;
mod tables;
mod translation;
mod writing;

pub use problem::{Deviation, Record, Unsuited, problem};
pub use records::File;

use std::path::Path;

/// What becomes of a problem.
#[derive(Debug, Clone)]
pub struct Import {
    /// Text of the model.
    pub model: String,
    /// Records, one for each experiment and repetition, below the folder `runs`; none for an SBML model alone.
    pub runs: Vec<File>,
    /// Table of the runs with the values that each brings (`--runs`).
    pub table: String,
    /// Project file.
    pub project: String,
    /// What was read, what was renamed, what was left out: Markdown.
    pub report: String,
    /// Sentences of the report that a user must know of.
    pub remarks: Vec<String>,
    /// What is added to the log-likelihood that `fdm fit` prints for that of PEtab: the densities of measured numbers that are compared by their
    /// logarithms.
    pub constant: f64,
}

/// Reads a PEtab problem (`.yaml`, versions 1 and 2) or an SBML model (`.xml`).
///
/// # Errors
/// Every part that cannot be read, or that the language has no counterpart for, one sentence each.
pub fn import(path: &Path) -> Result<Import, Vec<String>> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    match ending.as_str() {
        "yaml" | "yml" => translation::problem(&tables::Problem::read(path)?, &stem),
        "xml" | "sbml" => {
            let file = path.display().to_string();
            let text = fdm_results::store::read_input_text(path).map_err(|e| vec![format!("{file}: {e}")])?;
            translation::model(&text, &file, &stem)
        }
        _ => {
            let what = "a PEtab problem ends with .yaml, an SBML model with .xml";
            Err(vec![format!("{}: {what}", path.display())])
        }
    }
}
