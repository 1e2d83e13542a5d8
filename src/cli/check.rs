//! `fdm check`: every mistake of a model's text, then every derivative against a complex step; of a text of effects, whether
//! each vanishes at its null.

use crate::effects::invalid;
use crate::failure::{Failure, NUMBERS, print, tell};
use crate::subject::{Estimated, Subject};
use clap::Args;
use fdm::ModelError;
use fdm::code::{Nominal, verify};
use fdm::effect::Catalogue;
use fdm::report::{check_json, check_text};
use fdm_grammar::syntax::holds_effects;
use fdm_grammar::{Diagnostic, Source};
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
    let model = match arguments.subject.load() {
        Err(Failure::Model(e)) => match &*e {
            ModelError::Invalid { text, .. } if holds_effects(text.text()) => return effects(text, arguments.json),
            _ => return Err(Failure::Model(e)),
        },
        model => model?,
    };
    let mut params = model.definition().params.clone();
    arguments.subject.changes(&Estimated::default()).apply(&mut params).map_err(Failure::input)?;
    let model = model.with_params(params);
    let found = verify(model.definition(), model.schedule(), &Nominal::start(model.definition()));
    let printed =
        print(&if arguments.json { format!("{}\n", check_json(&model, &found)) } else { check_text(&model, &found) });
    Ok(if found.passed() && printed { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

/// A text of effects: each must vanish at its null and do something elsewhere.
fn effects(source: &Source, json: bool) -> Result<ExitCode, Failure> {
    let (catalogue, findings) = Catalogue::read(source);
    if findings.iter().any(Diagnostic::is_error) {
        return Err(invalid(source, findings));
    }
    tell(source, &findings);
    let all: Vec<String> = catalogue.effects().map(|e| e.signature()).collect();
    let text = match json {
        true => format!("{}\n", serde_json::json!({ "effects": all, "passed": true })),
        false => {
            let all: Vec<String> =
                all.iter().map(|e| format!("{e}: vanishes at its null, and does something elsewhere\n")).collect();
            all.concat()
        }
    };
    Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}
