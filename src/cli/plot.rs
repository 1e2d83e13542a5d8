//! `fdm plot`: one figure of a result's page as a file of its own, SVG or PNG.

use crate::failure::{Failure, NUMBERS, print};
use clap::Args;
use fdm::page::{Paper, Subject, drawings};
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
    /// Where it is written, as SVG or as PNG by its name [default: SVG to standard output]
    #[arg(short, long, value_name = "FILE.svg|FILE.png", requires = "figure")]
    output: Option<PathBuf>,
    /// Pixels across of a PNG [default: twice the drawing's own]
    #[arg(long, value_name = "N", requires = "output", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(16..=10_000))]
    width: Option<u32>,
    /// In the colours of the page in the dark
    #[arg(long, requires = "figure")]
    dark: bool,
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
    let paper = if arguments.dark { Paper::Dark } else { Paper::Light };
    let Some(path) = &arguments.output else { return Ok(ended(print(&found.svg(paper)))) };
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let bytes = match ending.as_deref() {
        Some("png") => found.png(paper, arguments.width.unwrap_or_else(|| 2 * found.width())),
        Some("svg") if arguments.width.is_some() => {
            return Err(Failure::input([
                "--width belongs to PNG: an SVG has no pixels; leave it out, or give a name that ends in .png",
            ]));
        }
        Some("svg") => Ok(found.svg(paper).into_bytes()),
        _ => {
            let said =
                format!("{}: figures are written as SVG or PNG; give a name that ends in .svg or .png", path.display());
            return Err(Failure::input([said]));
        }
    };
    let bytes = bytes.map_err(|e| Failure::input([e]))?;
    std::fs::write(path, bytes).map_err(|e| Failure::input([format!("{}: {}", path.display(), reason(&e))]))?;
    Ok(ExitCode::SUCCESS)
}

fn ended(printed: bool) -> ExitCode {
    if printed { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) }
}
