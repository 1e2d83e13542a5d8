//! What can be seen of an estimation while it works, and where its state is kept.

use crate::degenerate::Degeneracy;
use crate::termination::Termination;
pub use fdm_numeric::least_squares::Iteration;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// What is estimated, as it is called while the estimation works.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownName {
    /// The parameter.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Its unit, as text.
    pub unit: Option<String>,
}

/// What came out of one start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StartSummary {
    /// Its number; 1 is the given start.
    pub number: usize,
    /// Cost that was reached; none when the start values could not be simulated.
    pub cost: Option<f64>,
    /// Corrections made in the last estimation.
    pub iterations: usize,
    /// How it ended; none when the attempt was not possible.
    pub termination: Option<Termination>,
    /// How it ended, in words.
    pub message: String,
    /// The minimum that was reached, numbered by cost from 1; none without a cost.
    pub minimum: Option<usize>,
    /// Largest difference of a parameter from the best start's, relative to the greater of both.
    pub distance: Option<f64>,
    /// Free parameters where it ended, in the order of [`Estimate::parameters`](crate::Estimate::parameters).
    pub values: Vec<f64>,
    /// Their standard errors: 0 at a bound, none where the data do not determine one.
    pub errors: Vec<Option<f64>>,
    /// All parameters of each run there; empty where nothing was estimated.
    pub reached: Vec<Vec<f64>>,
    /// Why the likelihood has no maximum there, if it has none: such a place is taken only where there is no other.
    pub degenerate: Vec<Degeneracy>,
}

/// Why work ends before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// Somebody asked for the end.
    Interrupt,
    /// The time that was given is over.
    TimeLimit,
    /// The iterations that were given are used up.
    Iterations,
}

/// Watches an estimation; `()` looks away.
pub trait Observer: Send {
    /// Called at the start and after every accepted step; [`ControlFlow::Break`] ends the estimation there.
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()>;

    /// Called when an estimation begins: `names` makes the names of what it estimates.
    fn begin(&mut self, names: &dyn Fn() -> Vec<UnknownName>) {
        let _ = names;
    }

    /// Called when an estimation has ended, after so many iterations, those before an interruption included.
    fn ended(&mut self, iterations: usize) {
        let _ = iterations;
    }

    /// Called when something begins that is no iteration, and may take as long: what is being done.
    fn doing(&mut self, what: &str) {
        let _ = what;
    }

    /// Why the work is to end now with what it has; none while it may go on. Asked between the parts of long work, and while
    /// steps are tried.
    fn stopped(&mut self) -> Option<Stop> {
        None
    }

    /// Called before each [`iteration`](Self::iteration) with the values as they stand, in the order of those names.
    fn values(&mut self, values: &[f64]) {
        let _ = values;
    }

    /// Called before each [`iteration`](Self::iteration): `bytes` makes the state from which
    /// [`estimate_from`](super::estimate_from) goes on and ends with the same bits as without an interruption.
    fn state(&mut self, bytes: &dyn Fn() -> Vec<u8>) {
        let _ = bytes;
    }

    /// Called when an estimation begins: the state that it is to go on from, which [`state`](Self::state) was given by the
    /// same estimation before.
    fn resume(&mut self) -> Option<Vec<u8>> {
        None
    }

    /// As [`iteration`](Self::iteration), in the start with this number (from 1) of many that are at work at once.
    fn start_iteration(&mut self, number: usize, iteration: &Iteration) -> ControlFlow<()> {
        let _ = number;
        self.iteration(iteration)
    }

    /// Called when one of `count` starts has ended, as the `ended`-th; [`ControlFlow::Break`] ends the others.
    fn start_ended(&mut self, start: &StartSummary, ended: usize, count: usize) -> ControlFlow<()> {
        let _ = (start, ended, count);
        ControlFlow::Continue(())
    }
}

impl Observer for () {
    fn iteration(&mut self, _: &Iteration) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// Estimations whose iterations are nobody's business, but can be stopped.
pub(crate) struct Quiet<'o>(pub(crate) &'o mut dyn Observer);

impl Observer for Quiet<'_> {
    fn iteration(&mut self, _: &Iteration) -> ControlFlow<()> {
        if self.0.stopped().is_some() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn stopped(&mut self) -> Option<Stop> {
        self.0.stopped()
    }
}

impl<F: FnMut(&Iteration) -> ControlFlow<()> + Send> Observer for F {
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        self(iteration)
    }
}

/// Keeps byte strings under names. What was kept last is found again, whole, whenever the program ended: an implementation
/// must never lose the state before when it is interrupted while keeping the next (see the room `store`).
pub trait CheckpointStore: Send + Sync {
    /// Keeps `state` under `name`, in place of what was kept there.
    ///
    /// # Errors
    /// A sentence that names the place and the reason; what was kept before is still there.
    fn keep(&self, name: &str, state: &[u8]) -> Result<(), String>;

    /// What was kept under `name` last; none when nothing was.
    ///
    /// # Errors
    /// A sentence that names the place and the reason, when something was kept that cannot be read.
    fn find(&self, name: &str) -> Result<Option<Vec<u8>>, String>;
}
