//! Where something unknown may enter.

use fdm_grammar::model::Entry;
use fdm_system::model::Model;
use serde::{Deserialize, Serialize};

/// What kind of place it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PlaceKind {
    /// Beside the record of an input.
    Input,
    /// Into the equation of a state.
    Equation,
    /// Into the record of an output: its sensor.
    Output,
    /// Beside a parameter, wherever it stands.
    Coefficient,
}

/// A place, by name.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Deserialize, Serialize)]
pub struct Place {
    /// What it is.
    pub kind: PlaceKind,
    /// Its index among the model's inputs, states, outputs or parameters.
    pub index: usize,
    /// Its name.
    pub name: String,
}

/// Every place of a model where a disturbance may act on its states: inputs (but those whose derivative drives the model as
/// well), and equations in which something was left to be found.
pub(crate) fn places(model: &Model) -> Vec<Place> {
    let definition = model.definition();
    let differentiated = |k: usize| definition.inputs.iter().any(|i| i.slope.is_some_and(|s| s.of as usize == k));
    let inputs = definition.inputs.iter().enumerate().filter(|(k, i)| i.is_declared() && !differentiated(*k));
    let states = definition.states.iter().enumerate().filter(|(k, _)| !definition.is_known_rate(*k));
    let input = |(index, i): (usize, &fdm_grammar::model::Input)| Place {
        kind: PlaceKind::Input,
        index,
        name: i.quantity.name.clone(),
    };
    let state = |(index, s): (usize, &fdm_grammar::model::State)| Place {
        kind: PlaceKind::Equation,
        index,
        name: s.quantity.name.clone(),
    };
    inputs.map(input).chain(states.map(state)).collect()
}

impl Place {
    /// What the model is changed by; none for an output, where nothing has to be simulated.
    pub(crate) fn entry(&self) -> Option<Entry> {
        match self.kind {
            PlaceKind::Input => Some(Entry::Input(self.index as u32)),
            PlaceKind::Equation => Some(Entry::Rate(self.index as u32)),
            PlaceKind::Coefficient => Some(Entry::Param(self.index as u32)),
            PlaceKind::Output => None,
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.kind {
            PlaceKind::Input => write!(f, "the input {}", self.name),
            PlaceKind::Equation => write!(f, "der({})", self.name),
            PlaceKind::Output => write!(f, "the sensor of {}", self.name),
            PlaceKind::Coefficient => write!(f, "the coefficient {}", self.name),
        }
    }
}
