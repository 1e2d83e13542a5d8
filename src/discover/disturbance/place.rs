//! Where something unknown may enter, and what of a fitted run is needed to ask.
//!
//! The order in which places are told.

use crate::bins::Record;
use fdm_grammar::graph::{Leaf, Node, Signal};
use fdm_grammar::model::Entry;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Divergence, Steps, Unsuited};
use serde::{Deserialize, Serialize};

/// Evidence above which a disturbance is there: odds of 20 to 1.
pub(super) const CLEAR: f64 = 3.0;
/// Log-likelihood by which a cause is believed, or is before another: odds of 100 : 1, as at a chance of 0.01.
pub(crate) const BELIEVED: f64 = 4.6;

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
}

/// A place, by name.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Deserialize, Serialize)]
pub struct Place {
    /// What it is.
    pub kind: PlaceKind,
    /// Its index among the model's inputs, states or outputs.
    pub index: usize,
    /// Its name.
    pub name: String,
}

/// One run of a fitted model.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FittedRun<'a> {
    /// The record, completed by the inputs that the model takes from records.
    pub run: &'a Run,
    /// How it is integrated.
    pub steps: &'a Steps,
    /// All parameters of the model, with this run's values of those that every run has for itself.
    pub theta: &'a [f64],
    /// Residual and fitted sensitivities; directions are not looked at.
    pub record: &'a Record,
}

/// Why no disturbance can be looked for.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum DisturbanceError {
    /// Nothing to look at.
    #[error("there is no run or no output to look at")]
    Nothing,
    /// Too few samples.
    #[error("run {run} has {samples} samples; {least} are needed to tell a disturbance from noise")]
    TooShort {
        /// Index of the run.
        run: usize,
        /// Its samples.
        samples: usize,
        /// The least number.
        least: usize,
    },
    /// More is fitted than there are bins.
    #[error("{fitted} values were fitted to {bins} frequency bins: nothing is left to judge by")]
    TooMany {
        /// Fitted values.
        fitted: usize,
        /// Bins.
        bins: usize,
    },
    /// The model with a disturbance cannot be simulated.
    #[error("the model with a disturbance cannot be simulated: {0}")]
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
    pub(super) fn entry(&self) -> Option<Entry> {
        match self.kind {
            PlaceKind::Input => Some(Entry::Input(self.index as u32)),
            PlaceKind::Equation => Some(Entry::Rate(self.index as u32)),
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
        }
    }
}

/// A place with what speaks for it.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct PlaceEvidence {
    /// The place.
    #[serde(flatten)]
    pub place: Place,
    /// Logarithm of the odds that something enters there.
    pub evidence: f64,
}

/// Sorts places by their evidence, the likeliest first; but a disturbance on an input is one in the equation that the input moves, in
/// another name: where both are as likely the equation stands first.
pub(super) fn rank<T>(model: &Model, list: &mut [T], of: impl Fn(&T) -> (&Place, f64)) {
    list.sort_by(|a, b| of(b).1.total_cmp(&of(a).1));
    for at in 0..list.len() {
        let (place, evidence) = of(&list[at]);
        if place.kind != PlaceKind::Input {
            continue;
        }
        let same = |other: &T| {
            let (other, own) = of(other);
            other.kind == PlaceKind::Equation && own > evidence - CLEAR && moves(model, place.index, other.index)
        };
        if let Some(behind) = list[at + 1..].iter().position(same) {
            list[at..=at + 1 + behind].rotate_right(1);
        }
    }
}

/// Whether the equation of a state contains an input, delayed or not.
fn moves(model: &Model, input: usize, state: usize) -> bool {
    let definition = model.definition();
    let graph = &definition.graph;
    let is_it = |node: Node| match node {
        Node::Leaf(Leaf::Input(k)) => k as usize == input,
        Node::Leaf(Leaf::Delayed(k)) => {
            matches!(graph.delayed()[k as usize].signal, Signal::Input(k) if k as usize == input)
        }
        _ => false,
    };
    graph.reachable([definition.states[state].rate]).into_iter().any(|e| is_it(graph.node(e)))
}
