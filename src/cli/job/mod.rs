//! `fdm job`: a command that many machines share, stage by stage.

mod engine;
mod merge;
mod plan;
mod run;
mod status;
mod work;

use crate::deliver::{Asked, Places};
use crate::failure::Ending;
use clap::{Args, Subcommand};
use fdm_session::Verb;

/// A verb that many machines can share.
pub(crate) trait Shared {
    /// Its options.
    fn verb(&self) -> &dyn Verb;

    /// Where its answer goes.
    fn places(&self) -> Places<'_>;

    /// What the command does.
    fn run(&self, asked: &Asked) -> Ending {
        self.places().deliver(self.verb(), asked)
    }
}

/// What `fdm job` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    stage: Stage,
}

/// The stages of a job.
#[derive(Debug, Subcommand)]
enum Stage {
    /// Cut a job into tasks that many machines can share, and say what it costs
    Plan(plan::Arguments),
    /// Do a share of the tasks of a plan; done ones are not done again
    Run(run::Arguments),
    /// End a job with what all machines have done: the result of its command, to the bit
    Merge(merge::Arguments),
    /// How far a job is, and who is at work on it
    Status(status::Arguments),
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    match &arguments.stage {
        Stage::Plan(a) => plan::run(a),
        Stage::Run(a) => run::run(a),
        Stage::Merge(a) => merge::run(a),
        Stage::Status(a) => status::run(a),
    }
}
