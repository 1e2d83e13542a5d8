//! `fdm doctor`: records judged before they are believed, by themselves and beside a model.

use crate::deliver::{Output, write};
use crate::failure::{Ending, ended};
use crate::ownership::{Overwriting, refuse_other_tables};
use clap::Args;
use fdm_session::doctor;

/// What `fdm doctor` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: doctor::Options,
    #[command(flatten)]
    overwriting: Overwriting,
    #[command(flatten)]
    output: Output,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let Arguments { options, overwriting, output } = arguments;
    if let Some(path) = options.fix.as_ref().filter(|_| !overwriting.force) {
        refuse_other_tables(path, doctor::BEGINNING.as_bytes())?;
    }
    let mut conduct = output.conduct(&options.limit);
    let (judged, answer) = doctor::judge(options, &mut conduct)?;
    let printed = output.print(&answer);
    if let Some(path) = &options.fix {
        write(path, options.map(&judged))?;
    }
    if let Some(path) = &options.report {
        write(path, judged.page())?;
    }
    ended(printed && answer.good)
}
