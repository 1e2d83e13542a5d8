//! `fdm report`: a result as one page for a browser.

use crate::failure::{Failure, NUMBERS, print};
use clap::Args;
use fdm::page::{Subject, page};
use fdm::store::{reason, whole_files};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// What `fdm report` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Result folder that `--out` wrote
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Where the page is written; `-` for standard output [default: report.html in the folder]
    #[arg(short, long, value_name = "FILE.html")]
    output: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let files = whole_files(&arguments.folder).map_err(|e| Failure::input([e]))?;
    let text = page(&Subject::from_files(&files).map_err(|e| Failure::input([e]))?);
    let place = arguments.output.clone().unwrap_or_else(|| arguments.folder.join("report.html"));
    if place == Path::new("-") {
        return Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) });
    }
    std::fs::write(&place, text).map_err(|e| Failure::input([format!("{}: {}", place.display(), reason(&e))]))?;
    let said = print(&format!("{}\n", place.display()));
    Ok(if said { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}
