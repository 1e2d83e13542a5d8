//! Everything that the residuals of a fit say.

use super::ground::Ground;
use super::law::{Laws, laws};
use super::leftover::{Leftover, leftover};
use super::localise::{Localisation, localise};
use super::place::{ForceError, Passage};
use crate::model::Model;

/// What the residuals of a fit say.
#[derive(Debug, Clone, PartialEq)]
pub struct Heard {
    /// Where a force that does not repeat would enter.
    pub places: Localisation,
    /// Where one that is the same function of states and inputs in every run would.
    pub laws: Laws,
    /// Whether the residuals follow the inputs.
    pub leftover: Leftover,
}

/// Asks residuals for forces, laws, and for what follows the inputs.
///
/// # Errors
/// [`ForceError`]
pub fn heard(model: &Model, passages: &[Passage<'_>]) -> Result<Heard, ForceError> {
    let ground = Ground::new(passages, model.layout().outputs)?;
    Ok(Heard {
        places: localise(model, passages, &ground)?,
        laws: laws(model, passages, &ground)?,
        leftover: leftover(model, passages, &ground),
    })
}
