//! Substitution (Goodman and Sargent 1971, end of section II): a first fit with the measured records of states in the place of
//! these states in the equations, whose result starts the fit of the full model.
//!
//! The response then depends on most parameters linearly, so that hardly any start is too poor; but noise enters through the
//! equations, and the estimates of that first fit are biased by it.

use crate::methods::output_error::attempt::Attempt;
use crate::methods::output_error::error::{FitError, StrategyError};
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::FitOptions;
use crate::methods::output_error::single::single_fit;
use crate::problem::Options;
use fdm_grammar::diagnostic::nearest;
use fdm_system::model::Model;
use fdm_system::record::Run;

/// A model driven by records in the place of some of its states, and the runs that drive it.
pub(crate) struct Substitution {
    /// Names of the states.
    pub(crate) states: Vec<String>,
    model: Model,
    runs: Vec<Run>,
}

impl Substitution {
    /// Records in the place of the states that are named; `all` stands for every state that is measured.
    ///
    /// # Errors
    /// A state that the model does not have, that no output shows or that was not measured in some run.
    pub(crate) fn new(model: &Model, runs: &[Run], names: &[String]) -> Result<Self, StrategyError> {
        let states = &model.definition().states;
        if names.iter().any(|n| n == "all") {
            return Self::all(model, runs).ok_or(StrategyError::NothingMeasured);
        }
        let mut chosen = Vec::new();
        for name in names {
            let Some(k) = states.iter().position(|s| s.quantity.name == *name) else {
                let hint = nearest(name, states.iter().map(|s| s.quantity.name.as_str())).map(String::from);
                return Err(StrategyError::UnknownState { name: name.clone(), nearest: hint });
            };
            chosen.push(k);
        }
        chosen.sort_unstable();
        chosen.dedup();
        Self::of(model, runs, &chosen)
    }

    /// Records in the place of every state that is measured in all runs; none when there is no such state.
    pub(crate) fn all(model: &Model, runs: &[Run]) -> Option<Self> {
        let alone = |k: &usize| Self::of(model, runs, &[*k]).is_ok();
        let chosen: Vec<usize> = (0..model.layout().states).filter(alone).collect();
        if chosen.is_empty() { None } else { Self::of(model, runs, &chosen).ok() }
    }

    fn of(model: &Model, runs: &[Run], chosen: &[usize]) -> Result<Self, StrategyError> {
        let refused = |reason: String| StrategyError::NotMeasured { reason };
        let states = chosen.iter().map(|k| model.definition().states[*k].quantity.name.clone()).collect();
        let model = model.substituted(chosen).map_err(|e| refused(e.to_string()))?;
        let completed = runs.iter().map(|run| run.with_measured(model.definition()));
        let runs = completed.collect::<Result<_, _>>().map_err(|e| refused(e.to_string()))?;
        Ok(Self { states, model, runs })
    }

    /// Fits the substituted model and gives it with the start values of the full one that follow.
    ///
    /// # Errors
    /// As for [`fit`](crate::fit()).
    pub(crate) fn first_fit(&self, full: &Attempt<'_>) -> Result<(Fit, Vec<Vec<f64>>), FitError> {
        let inner = Options { colour: false, ..full.options.options.clone() };
        let options = FitOptions { options: inner, ..full.options.clone() };
        let first = Attempt { model: &self.model, runs: &self.runs, options: &options, ..*full };
        let fit = single_fit(&first)?;
        let starts = first.reached(&fit.estimate);
        Ok((fit, starts))
    }
}
