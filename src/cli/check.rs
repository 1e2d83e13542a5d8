//! `fdm check`: every mistake of a model's text, then every derivative against a complex step; of a text of effects, whether
//! each vanishes at its null.

use crate::deliver::Wanted;
use crate::failure::{Ending, Failure, as_json, ended, print, print_answer, print_lines, tell};
use clap::Args;
use fdm_effects::Catalogue;
use fdm_grammar::syntax::holds_effects;
use fdm_grammar::{Diagnostic, Source};
use fdm_results::documents::CatalogueDocument;
use fdm_session::check;
use fdm_session::effects::invalid;
use fdm_session::load::{Estimated, ModelFile};
use fdm_system::ModelError;

/// What `fdm check` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    model: ModelFile,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let model = match arguments.model.load_changed(&Estimated::default()) {
        Err(Failure::Model(e)) => match &*e {
            ModelError::Invalid { text, .. } if holds_effects(text.text()) => return effects(text, arguments.json),
            _ => return Err(Failure::Model(e)),
        },
        model => model?,
    };
    let answer = check::answer(&model, Wanted { json: arguments.json, ..Wanted::default() })?;
    ended(print_answer(&answer) && answer.good)
}

/// A text of effects: each must vanish at its null and do something elsewhere.
fn effects(source: &Source, json: bool) -> Ending {
    let (catalogue, findings) = Catalogue::read(source);
    if findings.iter().any(Diagnostic::is_error) {
        return Err(invalid(source, findings));
    }
    tell(source, &findings);
    let all: Vec<String> = catalogue.effects().map(|e| e.signature()).collect();
    ended(match json {
        true => print_lines(&as_json(&CatalogueDocument { effects: all, passed: true })?),
        false => {
            let all: Vec<String> =
                all.iter().map(|e| format!("{e}: vanishes at its null value, and has an effect elsewhere\n")).collect();
            print(&all.concat())
        }
    })
}
