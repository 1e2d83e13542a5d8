//! `fdm sample`: draws from the posterior of a result by the No-U-Turn sampler.

use crate::deliver::{Output, Places, standing, write};
use crate::failure::{Ending, Failure, OrFailure, ended, remark};
use crate::ownership::Overwriting;
use clap::Args;
use fdm_results::store::ResultFolder;
use fdm_session::sample;
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
    let places = Places { output, plot: None, out: None, report: report.as_deref() };
    let mut conduct = places.conduct(&options.limit);
    conduct.wanted.files |= arviz.is_some();
    conduct.wanted.plot = report.is_some();
    let folder = ResultFolder::open(&options.result).or_failure()?;
    for path in [arviz, report].into_iter().flatten().filter(|_| !overwriting.force) {
        if path.symlink_metadata().is_ok() {
            return Err(Failure::input([standing(path)]));
        }
    }
    let answer = sample::draw(options, &folder, None, &mut conduct)?;
    let whole = places.hand_over(&answer);
    let draws = arviz.as_ref().zip(answer.file("draws.json")).map(|(path, draws)| write(path, draws));
    let failed = draws.and_then(Result::err);
    failed.iter().for_each(|e| remark(format_args!("error: {e}; the result is what is printed")));
    ended(whole && failed.is_none())
}
