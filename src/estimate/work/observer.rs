//! What can be seen of long work.

use crate::problem::degenerate::Degeneracy;
use crate::problem::unknowns::UnknownName;
use crate::work::termination::Termination;
use fdm_numeric::least_squares::Iteration;
use serde::{Deserialize, Serialize};

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

/// Follows long work; `()` looks away, a function sees the iterations. Parts that are at work at once tell it from many threads.
pub trait Observer: Sync {
    /// Called at the start of an estimation and after every accepted step.
    fn iteration(&self, iteration: &Iteration) {
        let _ = iteration;
    }

    /// Called when an estimation begins: `names` makes the names of what it estimates.
    fn begin(&self, names: &dyn Fn() -> Vec<UnknownName>) {
        let _ = names;
    }

    /// Called before each [`iteration`](Self::iteration) with the values as they stand, in the order of those names.
    fn values(&self, values: &[f64]) {
        let _ = values;
    }

    /// Called when something begins that is no iteration, and may take as long: what is being done.
    fn doing(&self, what: &str) {
        let _ = what;
    }

    /// As [`doing`](Self::doing), of a stage of its own, such as a search.
    fn stage(&self, what: &str) {
        self.doing(what);
    }

    /// As [`iteration`](Self::iteration), in the start with this number (from 1) of many that are at work at once.
    fn start_iteration(&self, number: usize, iteration: &Iteration) {
        let _ = number;
        self.iteration(iteration);
    }

    /// Called when one of `count` starts has ended, as the `ended`-th.
    fn start_ended(&self, start: &StartSummary, ended: usize, count: usize) {
        let _ = (start, ended, count);
    }

    /// Called when so many of equal parts, such as the repeats of a study, have ended.
    fn parts_ended(&self, done: usize) {
        let _ = done;
    }
}

impl Observer for () {}

impl<F: Fn(&Iteration) + Sync> Observer for F {
    fn iteration(&self, iteration: &Iteration) {
        self(iteration);
    }
}
