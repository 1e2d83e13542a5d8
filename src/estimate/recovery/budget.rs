//! A limit on the iterations of all estimations together, fallback strategies included.

use crate::observer::{Iteration, Observer, StartSummary, Stop, UnknownName};
use crate::termination::Termination;
use std::ops::ControlFlow;

/// An observer that lets so many iterations be made and no more, whatever estimations they belong to.
///
/// The first estimation ends by its own limit, which is no greater: it may still find that its last iteration converged.
pub(crate) struct Budget<'o> {
    observer: &'o mut dyn Observer,
    most: Option<usize>,
    /// Iterations of the estimations that have ended.
    before: usize,
    /// Iterations of the one at work.
    now: usize,
    /// Estimations that have ended.
    estimations: usize,
}

impl<'o> Budget<'o> {
    /// Any number of iterations without `most`.
    pub(crate) fn new(observer: &'o mut dyn Observer, most: Option<usize>) -> Self {
        Self { observer, most, before: 0, now: 0, estimations: 0 }
    }

    fn is_used_up(&self) -> bool {
        self.most.is_some_and(|most| self.before + self.now >= most)
    }
}

impl Observer for Budget<'_> {
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        self.now = iteration.number;
        let flow = self.observer.iteration(iteration);
        if self.estimations > 0 && self.is_used_up() { ControlFlow::Break(()) } else { flow }
    }

    fn begin(&mut self, names: &dyn Fn() -> Vec<UnknownName>) {
        self.observer.begin(names);
    }

    fn ended(&mut self, iterations: usize) {
        self.before += iterations;
        self.now = 0;
        self.estimations += 1;
        self.observer.ended(iterations);
    }

    fn doing(&mut self, what: &str) {
        self.observer.doing(what);
    }

    fn stopped(&mut self) -> Option<Stop> {
        self.observer.stopped().or(self.is_used_up().then_some(Stop::Iterations))
    }

    fn values(&mut self, values: &[f64]) {
        self.observer.values(values);
    }

    fn state(&mut self, bytes: &dyn Fn() -> Vec<u8>) {
        self.observer.state(bytes);
    }

    fn resume(&mut self) -> Option<Vec<u8>> {
        self.observer.resume()
    }

    fn start_iteration(&mut self, number: usize, iteration: &Iteration) -> ControlFlow<()> {
        self.observer.start_iteration(number, iteration)
    }

    fn start_ended(&mut self, start: &StartSummary, ended: usize, count: usize) -> ControlFlow<()> {
        self.observer.start_ended(start, ended, count)
    }
}

/// Why work is not to go on behind an estimation that ended like this; none when it is.
pub(crate) fn stop(ended: &Termination, observer: &mut dyn Observer) -> Option<Stop> {
    let asked = match ended {
        Termination::Interrupted => Some(Stop::Interrupt),
        Termination::TimeLimit => Some(Stop::TimeLimit),
        _ => None,
    };
    asked.or_else(|| observer.stopped())
}

/// Ends every estimation where it begins: what it began with is then evaluated, and no more.
pub(crate) struct Halted(pub(crate) Stop);

impl Observer for Halted {
    fn iteration(&mut self, _: &Iteration) -> ControlFlow<()> {
        ControlFlow::Break(())
    }

    fn stopped(&mut self) -> Option<Stop> {
        Some(self.0)
    }
}
