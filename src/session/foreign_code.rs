//! Machine code of units in a model that only a file names, such as a project, a job or an experiment: it is run after `--allow-units`.

use fdm_grammar::expand::is_unit;
use fdm_system::{Model, read_source};
use std::path::PathBuf;
use std::sync::OnceLock;

/// The option that lets machine code of units run.
pub const ALLOW_UNITS: &str = "--allow-units";

/// What names the model in the place of the user, where machine code is not allowed.
static NAMED_BY: OnceLock<String> = OnceLock::new();

/// From now on models are named by a file, and not by the user: machine code in them is not run unless he has allowed it.
pub fn models_are_named_by(what: impl Into<String>, allowed: bool) {
    if !allowed {
        let _ = NAMED_BY.set(what.into());
    }
}

/// Refuses a model with machine code that only a file names.
pub(crate) fn refuse_foreign_code(model: &Model) -> Result<(), String> {
    match NAMED_BY.get() {
        Some(what) if model.holds_foreign_code() => Err(format!(
            "{}: the model holds machine code of a unit, and {what} names it; {ALLOW_UNITS} lets it run",
            model.source().name()
        )),
        _ => Ok(()),
    }
}

/// Refuses models with machine code that only a file names, where they are compiled elsewhere: their texts are looked at.
pub fn refuse_units_of(models: impl Iterator<Item = PathBuf>) -> Result<(), String> {
    let Some(what) = NAMED_BY.get() else { return Ok(()) };
    for path in models {
        // what cannot be read is told where it is compiled
        let Ok(mut source) = read_source(&path) else { continue };
        Model::gather_files(&mut source);
        if let Some(unit) = source.texts().iter().find(|text| is_unit(text.name())) {
            return Err(format!(
                "{}: {} is machine code of a unit, and {what} names the model; {ALLOW_UNITS} lets it run",
                path.display(),
                unit.name()
            ));
        }
    }
    Ok(())
}
