//! `fdm modes`: eigenvalues of a model, linear or linearised at its trim.

use crate::deliver::Wanted;
use crate::failure::{Ending, ended, print_answer};
use clap::Args;
use fdm_session::modes;

/// What `fdm modes` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: modes::Options,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let wanted = Wanted { json: arguments.json, ..Wanted::default() };
    ended(print_answer(&modes::answer(&arguments.options, wanted)?))
}
