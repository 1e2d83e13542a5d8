//! `fdm plot`: one figure of a result's page as a file of its own.

use crate::failure::{Failure, NUMBERS, print};
use clap::Args;
use fdm::page::{Subject, drawings};
use fdm::store::{reason, whole_files};
use fdm_grammar::diagnostic::nearest;
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm plot` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder that `--out` wrote
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Which figure; without it their names are listed
    #[arg(long, value_name = "NAME")]
    figure: Option<String>,
    /// Where it is written [default: standard output]
    #[arg(short, long, value_name = "FILE.svg", requires = "figure")]
    output: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let files = whole_files(&arguments.folder).map_err(|e| Failure::input([e]))?;
    let all = drawings(&Subject::from_files(&files).map_err(|e| Failure::input([e]))?);
    let Some(name) = &arguments.figure else {
        let longest = all.iter().map(|d| d.name().len()).max().unwrap_or(0);
        let list: String = all.iter().map(|d| format!("{:longest$}  {}\n", d.name(), d.caption())).collect();
        return Ok(ended(print(&list)));
    };
    let Some(found) = all.iter().find(|d| d.name() == name.as_str()) else {
        let near = nearest(name, all.iter().map(|d| d.name()));
        let hint = near.map_or("`fdm plot DIR` lists them".to_string(), |near| format!("did you mean `{near}`?"));
        return Err(Failure::input([format!("the result has no figure `{name}`: {hint}")]));
    };
    let Some(path) = &arguments.output else { return Ok(ended(print(&found.svg()))) };
    if path.extension().is_some_and(|e| !e.eq_ignore_ascii_case("svg")) {
        let said = format!("{}: figures are written as SVG; give a name that ends in .svg", path.display());
        return Err(Failure::input([said]));
    }
    std::fs::write(path, found.svg()).map_err(|e| Failure::input([format!("{}: {}", path.display(), reason(&e))]))?;
    Ok(ExitCode::SUCCESS)
}

fn ended(printed: bool) -> ExitCode {
    if printed { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) }
}
