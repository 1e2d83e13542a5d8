//! `fdm design`: optimal input design: the manoeuvres of the next runs that reduce the standard errors most.

use crate::deliver::{Output, close, standing, write_all};
use crate::failure::{Ending, Failure, ended};
use clap::Args;
use fdm_session::design;

/// What `fdm design` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: design::Options,
    #[command(flatten)]
    output: Output,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let Arguments { options, output } = arguments;
    refuse_others(options)?;
    let mut conduct = output.conduct(&options.limit);
    let answer = design::answer(options, &mut conduct);
    conduct.progress.finish();
    let answer = answer?;
    let printed = output.print(&answer);
    if let Some(folder) = &options.records {
        write_all(folder, &answer.files)?;
    }
    ended(close(&answer) && printed)
}

/// Files that stand where runs would be written are told before the work.
fn refuse_others(options: &design::Options) -> Result<(), Failure> {
    let Some(folder) = options.records.as_ref().filter(|_| !options.force) else { return Ok(()) };
    let places = (0..options.runs.into()).map(|k| folder.join(format!("{}.csv", design::run_name(k))));
    let there: Vec<String> =
        places.filter(|path| path.symlink_metadata().is_ok()).map(|path| standing(&path)).collect();
    if there.is_empty() { Ok(()) } else { Err(Failure::Input(there)) }
}
