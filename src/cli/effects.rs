//! `fdm effects`: what may be missing from a model, and where; `fdm extend`: a model's own text with effects in it.

use crate::deliver::write;
use crate::failure::{Ending, as_json, ended, print_coloured, print_data, print_lines};
use crate::ownership::Overwriting;
use clap::Args;
use fdm_results::documents::EffectsDocument;
use fdm_session::effects::{Extend, Options, as_text, difference, subject};
use std::path::PathBuf;

/// What `fdm effects` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    options: Options,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let catalogue = arguments.options.catalogue()?;
    let (_, subject) = subject(&arguments.options.model)?;
    let places = catalogue.places(&subject);
    ended(match arguments.json {
        true => print_lines(&as_json(&EffectsDocument::of(&catalogue, &places))?),
        false => print_coloured(|colour| as_text(&catalogue, &places, colour)),
    })
}

/// What `fdm extend` takes.
#[derive(Debug, Args)]
pub(crate) struct Extension {
    #[command(flatten)]
    options: Extend,
    /// Write the extended model here
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Read by the rule for files that are written over others.
    #[command(flatten)]
    _overwriting: Overwriting,
}

pub(crate) fn extend(arguments: &Extension) -> Ending {
    let (model, at) = subject(&arguments.options.model)?;
    let at = arguments.options.applied(at)?;
    let new = at.source().text();
    if let Some(file) = &arguments.write {
        write(file, new)?;
    }
    ended(print_data(&difference(model.source().text(), new, &arguments.options.model)))
}
