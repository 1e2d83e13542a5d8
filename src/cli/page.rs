//! The page of a result: `fdm report` writes it, `fdm plot` draws one of its figures, `fdm serve` shows it to a browser on this
//! machine, also while a fit or a study works on it.

use crate::deliver::write;
use crate::failure::{Ending, Failure, OrFailure, did_you_mean, ended, print, print_data, print_lines};
use crate::ownership::{Kind, Overwriting, refuse_foreign};
use clap::Args;
use fdm_report::page::{Paper, Subject, drawings, page};
use fdm_results::store::whole_files;
use std::path::{Path, PathBuf};

/// What `fdm report` takes.
#[derive(Debug, Args)]
pub(crate) struct Report {
    /// Result folder that `--out` wrote
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// File to write; `-` for standard output [default: report.html in the folder]
    #[arg(short, long, value_name = "FILE.html")]
    output: Option<PathBuf>,
    #[command(flatten)]
    overwriting: Overwriting,
}

/// The result in a folder.
fn subject(folder: &Path) -> Result<Subject, Failure> {
    Subject::from_files(&whole_files(folder).or_failure()?).or_failure()
}

pub(crate) fn report(arguments: &Report) -> Ending {
    let text = page(&subject(&arguments.folder)?);
    let place = arguments.output.clone().unwrap_or_else(|| arguments.folder.join("report.html"));
    if place == Path::new("-") {
        return ended(print_data(&text));
    }
    // a place that was typed has been looked at
    if arguments.output.is_none() && !arguments.overwriting.force {
        refuse_foreign(&place, Kind::Page).or_failure()?;
    }
    write(&place, text)?;
    ended(print_lines(&format!("{}\n", place.display())))
}

/// What `fdm plot` takes.
#[derive(Debug, Args)]
pub(crate) struct Plot {
    /// Result folder that `--out` wrote
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Name of the figure [default: list the names]
    #[arg(long, value_name = "NAME")]
    figure: Option<String>,
    /// File to write, SVG or PNG by its name; `-` for SVG to standard output [default: SVG to standard output]
    #[arg(short, long, value_name = "FILE.svg|FILE.png", requires = "figure")]
    output: Option<PathBuf>,
    /// Width of a PNG in pixels [default: twice that of the drawing]
    #[arg(long, value_name = "N", requires = "output", allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(16..=10_000))]
    width: Option<u32>,
    /// Dark colours
    #[arg(long, requires = "figure")]
    dark: bool,
    #[command(flatten)]
    overwriting: Overwriting,
}

pub(crate) fn plot(arguments: &Plot) -> Ending {
    let all = drawings(&subject(&arguments.folder)?);
    let Some(name) = &arguments.figure else {
        let longest = all.iter().map(|d| d.name().len()).max().unwrap_or(0);
        let list: String = all.iter().map(|d| format!("{:longest$}  {}\n", d.name(), d.caption())).collect();
        return ended(print(&list));
    };
    let Some(found) = all.iter().find(|d| d.name() == name.as_str()) else {
        let near = did_you_mean(name, all.iter().map(|d| d.name()));
        return Err(Failure::input([format!("the result has no figure `{name}`{near} (`fdm plot DIR` lists them)")]));
    };
    let paper = if arguments.dark { Paper::Dark } else { Paper::Light };
    let Some(path) = arguments.output.as_deref().filter(|path| *path != Path::new("-")) else {
        return ended(print_data(&found.svg(paper)));
    };
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let bytes = match ending.as_deref() {
        #[cfg(feature = "png")]
        Some("png") => {
            found.png(paper, arguments.width.unwrap_or_else(|| 2 * found.width())).map_err(|e| e.to_string())
        }
        #[cfg(not(feature = "png"))]
        Some("png") => Err("this build of fdm writes figures as SVG only: give a name that ends in .svg, or build it with `--features png`".into()),
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
    let bytes: Result<Vec<u8>, String> = bytes;
    write(path, bytes.or_failure()?)?;
    ended(true)
}

/// What `fdm serve` takes.
#[derive(Debug, Args)]
pub(crate) struct Serve {
    /// Result folder that `--out` writes; it need not exist yet
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Port on this machine [default: any that is free]
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    port: u16,
}

pub(crate) fn serve(arguments: &Serve) -> Ending {
    #[cfg(feature = "studio")]
    return crate::serve::serve(arguments.folder.clone(), arguments.port);
    #[cfg(not(feature = "studio"))]
    Err(Failure::input([format!(
        "{} at port {}: this build of fdm serves no pages: build it with `--features studio`",
        arguments.folder.display(),
        arguments.port
    )]))
}
