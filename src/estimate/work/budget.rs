//! A limit on the iterations of all estimations together, fallback strategies included.

use super::Work;
use fdm_numeric::least_squares::Iteration;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Lets so many iterations be made and no more, whatever estimations they belong to.
///
/// The first estimation ends by its own limit, which is no greater: it may still find that its last iteration converged.
pub(crate) struct Budget<'o> {
    /// That of the work which this is a part of, and whether iterations count there too.
    outer: Option<(&'o Budget<'o>, bool)>,
    most: Option<usize>,
    /// Iterations of the estimations that have ended.
    before: AtomicUsize,
    /// Iterations of the one at work.
    now: AtomicUsize,
    /// Estimations that have ended.
    estimations: AtomicUsize,
}

impl<'o> Budget<'o> {
    /// Of a part of this work; any number of iterations without `most`.
    pub(crate) fn new(work: &Work<'o>, most: Option<usize>) -> Self {
        let outer = work.budget.map(|outer| (outer, true)).or(work.outer_budget.map(|outer| (outer, false)));
        Self { outer, most, before: 0.into(), now: 0.into(), estimations: 0.into() }
    }

    pub(super) fn is_used_up(&self) -> bool {
        self.outer.is_some_and(|(outer, _)| outer.is_used_up()) || self.is_own_used_up()
    }

    fn is_own_used_up(&self) -> bool {
        self.most.is_some_and(|most| self.before.load(Relaxed) + self.now.load(Relaxed) >= most)
    }

    /// Counts an iteration; whether it is the last.
    pub(super) fn ends(&self, iteration: &Iteration) -> bool {
        self.now.store(iteration.number, Relaxed);
        let of_outer =
            |(outer, counts): (&Budget<'_>, bool)| if counts { outer.ends(iteration) } else { outer.is_used_up() };
        let outer = self.outer.is_some_and(of_outer);
        outer || self.estimations.load(Relaxed) > 0 && self.is_own_used_up()
    }

    /// Counts an estimation that has ended, after so many iterations.
    pub(super) fn ended(&self, iterations: usize) {
        self.before.fetch_add(iterations, Relaxed);
        self.now.store(0, Relaxed);
        self.estimations.fetch_add(1, Relaxed);
        self.outer.filter(|(_, counts)| *counts).into_iter().for_each(|(outer, _)| outer.ended(iterations));
    }
}
