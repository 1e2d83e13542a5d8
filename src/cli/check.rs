//! `fdm check`: every mistake of a model's text, then every derivative against a complex step.

use crate::failure::{Failure, NUMBERS, print};
use crate::subject::Subject;
use clap::Args;
use fdm::code::{Nominal, verify};
use fdm::report::{check_json, check_text};
use std::process::ExitCode;

/// What `fdm check` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let model = arguments.subject.load()?;
    let mut params = model.definition().params.clone();
    arguments.subject.changes(&[], &[]).apply(&mut params).map_err(Failure::input)?;
    let model = model.with_params(params);
    let found = verify(model.definition(), model.schedule(), &Nominal::start(model.definition()));
    let printed =
        print(&if arguments.json { format!("{}\n", check_json(&model, &found)) } else { check_text(&model, &found) });
    Ok(if found.passed() && printed { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}
