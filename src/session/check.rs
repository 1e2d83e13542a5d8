//! `fdm check`: every derivative of a model against a complex step.

use crate::answer::{Answer, Wanted};
use crate::failure::Failure;
use fdm_report::check_text;
use fdm_results::documents::ModelDocument;
use fdm_system::Model;
use fdm_system::code::{Nominal, verify};

/// Compares every derivative with a complex step.
///
/// # Errors
/// [`Failure::Input`], for a document without a text.
pub fn answer(model: &Model, wanted: Wanted) -> Result<Answer, Failure> {
    // the noise of outputs has derivatives too
    let whole = model.definition().with_precisions().map_or_else(|| model.clone(), |whole| model.altered(whole));
    let found = verify(whole.definition(), whole.schedule(), &Nominal::start(whole.definition()));
    let answer = Answer::of(check_text(model, &found), &ModelDocument::of(model, &found), wanted)?;
    Ok(Answer { good: found.passed(), ..answer })
}
