//! What an unknown force may be a function of: simple functions of states and inputs in every equation, tried through the dynamics, so
//! that nothing measured is differentiated (the terms of a sparse regression, each as the response that it would cause).

use super::driven::Driven;
use super::place::{ForceError, Kind, Passage, Place, places};
use super::signals::Signals;
use crate::diagnose::screen::{Direction, Record, Screening, ScreeningError, ScreeningOptions, Shape, screen};
use crate::model::Model;
use serde::Serialize;

/// Most directions that are tried.
const MOST: usize = 240;
/// Draws of residuals by which the best is judged.
const DRAWS: usize = 200;

/// A function in an equation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Suggestion {
    /// Where it stands.
    pub place: Place,
    /// The function of states and inputs, as it would be written in the model.
    pub function: String,
    /// Its factor there.
    pub coefficient: f64,
    /// Twice the gain in log-likelihood that it promises.
    pub statistic: f64,
    /// The chance that noise gives it as much.
    pub chance: f64,
}

/// Functions of states and inputs that residuals look like, through the dynamics.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Suggestions {
    /// The likeliest first.
    pub list: Vec<Suggestion>,
    /// The chance that noise alone makes any of them look as good as the first.
    pub family_wise: f64,
}

/// Why nothing can be suggested.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SuggestionError {
    /// No response to a force.
    #[error(transparent)]
    Force(#[from] ForceError),
    /// The runs cannot be screened.
    #[error(transparent)]
    Screening(#[from] ScreeningError),
}

/// Tries simple functions of states and inputs in every equation in which something was left to be found.
///
/// # Errors
/// [`SuggestionError`]
pub fn suggestions(model: &Model, passages: &[Passage<'_>]) -> Result<Suggestions, SuggestionError> {
    let q = model.layout().outputs;
    if passages.is_empty() || q == 0 {
        return Err(ForceError::Nothing.into());
    }
    let places: Vec<Place> = places(model).into_iter().filter(|p| p.kind == Kind::Equation).collect();
    let driven = Driven::new(model, &places);
    let signals = Signals::new(model, &driven, passages)?;
    let functions = signals.functions.len().min(MOST / places.len().max(1));
    let mut records: Vec<Record> = Vec::new();
    for (run, passage) in passages.iter().enumerate() {
        let mut directions = vec![Vec::new(); functions * places.len()];
        driven.respond(run, *passage, &signals.courses[run][..functions], &mut |place, function, response| {
            directions[place * functions + function] = response;
        })?;
        let Record { interval, residual, fitted, .. } = passage.record;
        records.push(Record { interval: *interval, residual: residual.clone(), fitted: fitted.clone(), directions });
    }
    let directions: Vec<Direction> = (0..functions * places.len())
        .map(|candidate| Direction { candidate, size: 1.0, shape: Shape::Linear })
        .collect();
    let options = ScreeningOptions { draws: DRAWS, ..ScreeningOptions::default() };
    let Screening { candidates, ranking, family_wise, .. } = screen(&records, q, &directions, &options)?;
    let one = |k: &usize| {
        let (candidate, function) = (&candidates[*k], &signals.functions[k % functions]);
        candidate.direction.map(|_| Suggestion {
            place: places[k / functions].clone(),
            function: function.text.clone(),
            coefficient: candidate.amount * signals.factors[k % functions],
            statistic: candidate.statistic,
            chance: candidate.chance,
        })
    };
    Ok(Suggestions { list: ranking.iter().filter_map(one).collect(), family_wise })
}
