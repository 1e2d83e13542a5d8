//! What can be seen of an estimation while it works.

use crate::estimate::road::starts::StartSummary;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// The state after one correction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Iteration {
    /// Number of the correction; 0 is the start.
    pub number: usize,
    /// Minus the logarithm of the likelihood, without its constant.
    pub cost: f64,
    /// What this correction changed of the cost; 0 at the start.
    pub change: f64,
    /// Damping of the correction, relative to the scaled information matrix; 0 is a full Gauss-Newton step.
    pub damping: f64,
    /// Largest part of the correction, in standard errors; 0 at the start.
    pub step: f64,
    /// Corrections that were tried and refused on the way.
    pub refused: usize,
}

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

/// Watches an estimation; `()` looks away.
pub trait Observer: Send {
    /// Called at the start and after every accepted correction; [`ControlFlow::Break`] ends the estimation there.
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()>;

    /// Called when an estimation begins: `names` makes the names of what it estimates.
    fn begin(&mut self, names: &dyn Fn() -> Vec<UnknownName>) {
        let _ = names;
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

impl<F: FnMut(&Iteration) -> ControlFlow<()> + Send> Observer for F {
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        self(iteration)
    }
}
