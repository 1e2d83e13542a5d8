//! `fdm verify`: what a file of `fdm export` computes beside what the model does.

use crate::export::with_values;
use crate::failure::{Ending, Failure, ended, print};
use clap::Args;
use fdm_exchange::verify::{Artefact, VerifyError};
use fdm_report::verification_table;
use fdm_results::store::{WorkFolder, read_input};
use fdm_session::load::ModelOrResult;
use fdm_session::value::assignment;
use std::path::PathBuf;

/// What `fdm verify` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Unit (.fmu) or source (.c, .rs), as `fdm export` wrote it
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Result folder or model file that it should be of
    #[arg(long, value_name = "RESULT")]
    against: PathBuf,
    /// Value that it was written with (free initial values are called `x(0)`)
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment, help_heading = "Parameters")]
    set: Vec<(String, f64)>,
    /// Run of the result that it was written for
    #[arg(long, value_name = "RUN", help_heading = "Parameters")]
    like: Option<String>,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let file = arguments.file.display();
    let subject = ModelOrResult::at(&arguments.against, &arguments.set);
    let (model, _) = with_values(&subject, arguments.like.as_deref())?;
    let bytes = read_input(&arguments.file).map_err(|e| Failure::at(&arguments.file, &e))?;
    let told = |error: VerifyError| {
        let said = format!("{file}: {error}");
        match error {
            // what is asked for was understood, and is not so, or cannot be said
            VerifyError::Other { .. }
            | VerifyError::NoCompiler(_)
            | VerifyError::Refused { .. }
            | VerifyError::Status { .. } => Failure::Numbers(said),
            _ => Failure::input([said]),
        }
    };
    let artefact = Artefact::read(&arguments.file.display().to_string(), &bytes).map_err(told)?;
    artefact.belongs_to(&model).map_err(told)?;
    let folder = WorkFolder::with(&artefact.files(&model)).map_err(|e| Failure::at(&arguments.file, &e))?;
    let found = artefact.compare(&model, folder.path()).map_err(told)?;
    ended(print(&verification_table(&found)) && found.is_good())
}
