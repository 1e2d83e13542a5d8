//! Why a run has no response: a method that does not suit the model, values that left the finite numbers, or events without end.

use serde::{Deserialize, Serialize};
use std::fmt;

/// The simulation left the finite numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Divergence {
    /// Time since the run began at which the first value was not finite.
    pub time: f64,
    /// The state that was not finite; `None` when it was an output, a delay or a sensitivity.
    pub state: Option<usize>,
    /// The last sample before that time.
    pub sample: usize,
    /// Not the numbers but an event ended the run.
    pub event: Option<EventFault>,
}

/// What an event did to a run; events are counted from 0 in the order of the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventFault {
    /// It happens again and again in ever shorter time (Zeno's paradox).
    Accumulates(usize),
    /// Its guard only touches zero: the instant has no derivative by the parameters.
    Grazes(usize),
}

impl fmt::Display for EventFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Accumulates(event) => write!(
                f,
                "`when` number {} happens more than {MOST_EVENTS} times within one step, ever more often: what comes to rest needs a \
                 `limit`, or a condition with a distance between on and off",
                event + 1
            ),
            Self::Grazes(event) => write!(
                f,
                "the condition of `when` number {} is only touched, not passed: the response has no derivative there",
                event + 1
            ),
        }
    }
}

/// Most events in one step.
pub(super) const MOST_EVENTS: usize = 100;

/// Most steps of a run; every step keeps its time and its drive.
pub(super) const MOST_STEPS: usize = 20_000_000;

/// Why a run cannot be simulated with exact sensitivities.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Unsuited {
    /// The run was made for another model, or lacks the records that drive this one.
    #[error(
        "the run has {found} inputs where the model has {expected}, those that are measured outputs included \
         (`Run::with_measured` completes them)"
    )]
    OtherInputs {
        /// Inputs of the run.
        found: usize,
        /// Inputs of the model, hidden ones included.
        expected: usize,
    },
    /// An output that shows a zero-order-hold input directly moves in jumps with its delay: its derivative is zero or infinite.
    #[error(
        "an output shows an input directly that is held between samples and delayed by an estimated delay: it moves in \
         jumps with that delay, so that nothing can be estimated from it; take input {input} as linear between samples, or fix the delay"
    )]
    HeldAndDelayed {
        /// Index of the input.
        input: usize,
    },
    /// Foreign code that the model calls cannot be used.
    #[error("{0}")]
    ForeignCode(String),
    /// The steps would not fit into memory.
    #[error("{steps} steps are more than {MOST_STEPS} in a run of {samples} samples")]
    TooManySteps {
        /// Steps of the run.
        steps: usize,
        /// Samples of the run.
        samples: usize,
    },
    /// Delayed states would have to be interpolated with the sensitivities of the collocation polynomial.
    #[error(
        "the implicit method does not know delayed states yet: integrate this model by Runge-Kutta (`--integrator runge-kutta`)"
    )]
    DelayedStates,
    /// An event would fall into the middle of a step that has no solution up to there.
    #[error(
        "the implicit method does not know events (`when`): integrate this model by Runge-Kutta (`--integrator runge-kutta`)"
    )]
    Events,
    /// The equations of an implicit step would not fit into memory.
    #[error("{states} states are more than the {MOST_IMPLICIT} of the implicit method: use `--integrator runge-kutta`")]
    TooManyStates {
        /// States of the model.
        states: usize,
    },
    /// The past that a delay reaches back to would not fit into memory.
    #[error(
        "a state delayed by {longest} reaches back over {nodes} steps, too many to keep with their sensitivities; shorten the delay, \
         or thin out the record"
    )]
    LongMemory {
        /// The longest delay of a state, in the model's time unit.
        longest: f64,
        /// Steps that it covers.
        nodes: usize,
    },
    /// Too many states are delayed by less than a step: the equations of a step that sees itself would be too large.
    #[error(
        "{states} states are delayed, some by less than a step, and have to be found at once; {} at most: take more steps between \
         samples, or bound the delays from below",
        MOST_AT_ONCE
    )]
    ShortDelays {
        /// States that would have to be found at once.
        states: usize,
    },
}

/// Most states of the implicit method: its matrix has nine times their square entries.
pub(super) const MOST_IMPLICIT: usize = 1000;

/// Most states that a step can see of itself: their equations are dense, three for each.
pub(super) const MOST_AT_ONCE: usize = 200;
