//! Where something unknown may enter, and what of a fitted run is needed to ask.

use crate::diagnose::screen::Record;
use crate::model::Model;
use crate::record::Run;
use crate::simulate::{Divergence, Steps, Unsuited};
use fdm_grammar::model::Entry;
use serde::Serialize;

/// What kind of place it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Beside the record of an input.
    Input,
    /// Into the equation of a state.
    Equation,
    /// Into the record of an output: its sensor.
    Output,
}

/// A place, by name.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize)]
pub struct Place {
    /// What it is.
    pub kind: Kind,
    /// Its index among the model's inputs, states or outputs.
    pub index: usize,
    /// Its name.
    pub name: String,
}

/// One run of a fitted model.
#[derive(Debug, Clone, Copy)]
pub struct Passage<'a> {
    /// The record, completed by the inputs that the model takes from records.
    pub run: &'a Run,
    /// How it is integrated.
    pub steps: &'a Steps,
    /// All parameters of the model, with this run's values of those that every run has for itself.
    pub theta: &'a [f64],
    /// Residual and fitted sensitivities; directions are not looked at.
    pub record: &'a Record,
}

/// Why no force can be looked for.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ForceError {
    /// Nothing to look at.
    #[error("there is no run or no output to look at")]
    Nothing,
    /// Too few samples.
    #[error("run {run} has {samples} samples; {least} are needed to tell a force from noise")]
    TooShort {
        /// Index of the run.
        run: usize,
        /// Its samples.
        samples: usize,
        /// The least number.
        least: usize,
    },
    /// More is fitted than there are lines.
    #[error("{fitted} values were fitted to {lines} lines: nothing is left to judge by")]
    TooMany {
        /// Fitted values.
        fitted: usize,
        /// Lines.
        lines: usize,
    },
    /// The model with a force cannot be simulated.
    #[error("the model with a force in it cannot be simulated: {0}")]
    Unsuited(#[from] Unsuited),
    /// The fitted model diverges.
    #[error("the fitted model leaves the finite numbers in run {run} at t = {}", at.time)]
    Diverged {
        /// Index of the run.
        run: usize,
        /// Where.
        at: Divergence,
    },
}

/// Every place of a model where a force may act on its states: inputs (but those whose derivative drives the model as
/// well), and equations in which something was left to be found.
pub fn places(model: &Model) -> Vec<Place> {
    let definition = model.definition();
    let differentiated = |k: usize| definition.inputs.iter().any(|i| i.slope.is_some_and(|s| s.of as usize == k));
    let inputs = definition.inputs.iter().enumerate().filter(|(k, i)| i.is_declared() && !differentiated(*k));
    let states = definition.states.iter().enumerate().filter(|(k, _)| !definition.is_known_rate(*k));
    let input = |(index, i): (usize, &fdm_grammar::model::Input)| Place {
        kind: Kind::Input,
        index,
        name: i.quantity.name.clone(),
    };
    let state = |(index, s): (usize, &fdm_grammar::model::State)| Place {
        kind: Kind::Equation,
        index,
        name: s.quantity.name.clone(),
    };
    inputs.map(input).chain(states.map(state)).collect()
}

impl Place {
    /// What the model is changed by; none for an output, where nothing has to be simulated.
    pub(super) fn entry(&self) -> Option<Entry> {
        match self.kind {
            Kind::Input => Some(Entry::Input(self.index as u32)),
            Kind::Equation => Some(Entry::Rate(self.index as u32)),
            Kind::Output => None,
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.kind {
            Kind::Input => write!(f, "the input {}", self.name),
            Kind::Equation => write!(f, "der({})", self.name),
            Kind::Output => write!(f, "the sensor of {}", self.name),
        }
    }
}
