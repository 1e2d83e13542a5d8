//! A model as stand-alone C or Rust, with its stamp.

use crate::Stamp;
use fdm_grammar::emit::{EmitError, Language, stand_alone};
use fdm_system::Model;

/// The source file of a model; its last line is the stamp, a comment in both languages.
///
/// # Errors
/// [`EmitError`] as [`stand_alone`].
pub fn source(model: &Model, language: &Language) -> Result<String, EmitError> {
    let text = stand_alone(model.definition(), model.schedule(), language)?;
    Ok(format!("{text}\n/* {} */\n", Stamp::of(model)))
}
