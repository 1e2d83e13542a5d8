//! `fdm sample`: draws from the posterior of a result by the No-U-Turn sampler.

use crate::deliver::{Output, Wanted, standing};
use crate::failure::{Ending, Failure, OrFailure, ended};
use crate::ownership::Overwriting;
use clap::Args;
use fdm_results::store::ResultFolder;
use fdm_session::{Conduct, sample};
use std::path::PathBuf;

/// What `fdm sample` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: sample::Options,
    /// Write all draws to a file that ArviZ reads (`az.from_json`)
    #[arg(long, value_name = "FILE.json", help_heading = "Result")]
    arviz: Option<PathBuf>,
    /// Write one page for a browser: parameters, traces, ranks, predictive bands
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    report: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    overwriting: Overwriting,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let Arguments { options, arviz, report, output, overwriting } = arguments;
    let wanted = Wanted { files: arviz.is_some() || report.is_some(), plot: report.is_some(), ..output.wanted() };
    let mut conduct = Conduct::shown(output.manner.quiet, wanted).within(&options.limit);
    let folder = ResultFolder::open(&options.result).or_failure()?;
    for path in [arviz, report].into_iter().flatten().filter(|_| !overwriting.force) {
        if path.symlink_metadata().is_ok() {
            return Err(Failure::input([standing(path)]));
        }
    }
    let answer = sample::draw(options, &folder, None, &mut conduct)?;
    let places = [(arviz.as_ref(), answer.file("draws.json")), (report.as_ref(), answer.file("page.html"))];
    ended(output.hand_over(&answer, places))
}
