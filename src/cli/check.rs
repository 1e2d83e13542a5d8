//! `fdm check`
use crate::failure::Failure;
use crate::subject::Subject;
use clap::Args;
use std::process::ExitCode;
/// What `fdm check` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
}
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    arguments.subject.load()?;
    Ok(ExitCode::SUCCESS)
}
