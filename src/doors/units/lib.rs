//! Functional mock-up units as parts of a model: `use fmu "engine.fmu" as eng(...)`.
//!
//! **In** the bytes of a unit for model exchange (FMI 2.0 or 3.0). **Out** [`read()`]: the text of a model that stands for it, whose
//! equations call the unit's functions, and these functions made known to the language ([`fdm_grammar::external`]). **Never** runs the
//! unit's code while a model is compiled, and never lets it integrate: states, steps and sensitivities are those of the model.
//! **Start** at [`read()`].
//!
//! A unit is a function: time, states, inputs and parameters to rates and outputs. What is no function of these is refused in words, when it
//! shows: events, delays inside, a memory of what was asked before. Source: Functional Mock-up Interface 2.0.4 and 3.0.1, Modelica
//! Association.

mod archive;
mod description;
mod folders;
mod functions;
mod instance;
mod text;
mod unit;

pub use archive::{DESCRIPTION, Files, UnitError, Version, library_folder, library_name, unpacked};
pub use description::{Description, Variable};

use fdm_grammar::external;
use sha2::{Digest, Sha256};
use std::sync::Arc;
use unit::Unit;

/// Reads a unit, makes its functions known, and returns the text of the model that stands for it. `name` is what messages call it.
///
/// # Errors
/// [`UnitError`] where the file is no unit, is none for model exchange, or has no library for this kind of machine.
pub fn read(name: &str, bytes: &[u8]) -> Result<String, UnitError> {
    let key: String = Sha256::digest(bytes).iter().take(8).map(|byte| format!("{byte:02x}")).collect();
    let (description, files) = description::of(unpacked(bytes)?)?;
    let text = text::written(&description, &key)?;
    external::register(&key, || Arc::new(Unit::new(name, description, files)));
    Ok(text)
}

/// Whether the unit that a text stands for is known to this process; a text that stands for none needs none.
pub fn is_known(text: &str) -> bool {
    text::key(text).is_none_or(external::is_registered)
}
