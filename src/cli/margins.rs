//! `fdm margins`: what a result is used for. Modes with their intervals, and the requirements of the model's text, each with the probability that it holds.

use crate::deliver::Wanted;
use crate::failure::{Ending, OrFailure, ended, print_answer};
use clap::Args;
use fdm_results::store::ResultFolder;
use fdm_session::margins;
use std::path::PathBuf;

/// What `fdm margins` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Result folder that `fdm fit --out` wrote
    #[arg(value_name = "RESULT")]
    result: PathBuf,
    #[command(flatten)]
    options: margins::Options,
    /// Print JSON
    #[arg(long, help_heading = "Result")]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let folder = ResultFolder::open(&arguments.result).or_failure()?;
    let wanted = Wanted { json: arguments.json, ..Wanted::default() };
    let answer = margins::answer(&arguments.options, &folder, wanted)?;
    ended(print_answer(&answer) && answer.good)
}
