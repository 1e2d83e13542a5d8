//! `fdm design`: optimal input design: the manoeuvres of the next runs that reduce the standard errors most.

use crate::deliver::{Output, Places, standing, write_all};
use crate::failure::{Ending, Failure, ended};
use clap::Args;
use fdm_session::design;
use std::path::PathBuf;

/// What `fdm design` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: design::Options,
    #[command(flatten)]
    output: Output,
    /// Write one page for a browser: what is known after each planned run, and what is flown
    #[arg(long, value_name = "FILE.html", conflicts_with = "between", help_heading = "Result")]
    report: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let Arguments { options, output, report } = arguments;
    refuse_others(options)?;
    let places = Places { output, plot: None, out: None, report: report.as_deref() };
    let mut conduct = places.conduct(&options.limit);
    let answer = design::answer(options, &mut conduct);
    conduct.progress.finish();
    let answer = answer?;
    if let Some(folder) = &options.records {
        let runs: Vec<_> = answer.files.iter().filter(|(name, _)| name != "page.html").cloned().collect();
        write_all(folder, &runs)?;
    }
    ended(places.hand_over(&answer))
}

/// Files that stand where runs would be written are told before the work.
fn refuse_others(options: &design::Options) -> Result<(), Failure> {
    let Some(folder) = options.records.as_ref().filter(|_| !options.force) else { return Ok(()) };
    let places = (0..options.runs.into()).map(|k| folder.join(format!("{}.csv", design::run_name(k))));
    let there: Vec<String> =
        places.filter(|path| path.symlink_metadata().is_ok()).map(|path| standing(&path)).collect();
    if there.is_empty() { Ok(()) } else { Err(Failure::Input(there)) }
}
