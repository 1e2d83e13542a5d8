//! What long work is told, and what it tells: when it is to end, who follows it, and where its state is kept.

pub(crate) mod budget;
pub(crate) mod checkpoint;
mod observer;
pub(crate) mod termination;

pub use checkpoint::CheckpointStore;
pub use observer::{Observer, StartSummary};
pub(crate) use termination::Termination;

use crate::problem::unknowns::UnknownName;

use budget::Budget;
use checkpoint::EstimationStates;
use fdm_numeric::halt::{Halt, Stop};
use fdm_numeric::least_squares::{Iteration, Monitor, Summary};
use std::ops::ControlFlow;

/// Long work: everything that may take long is given one and asks it, between its parts and while steps are tried, whether it is
/// to go on; work that was stopped ends with the best so far. Parts that are at work at once share it.
///
/// The default one never stops, tells nobody and keeps nothing.
#[derive(Clone)]
pub struct Work<'w> {
    halt: Halt,
    observer: &'w dyn Observer,
    store: Option<&'w dyn CheckpointStore>,
    /// Counts the iterations of all estimations together.
    budget: Option<&'w Budget<'w>>,
    /// That of the work which this is a quiet part of.
    outer_budget: Option<&'w Budget<'w>>,
    /// The states of the estimations of one attempt.
    states: Option<&'w EstimationStates<'w>>,
    /// Those of the work which this is a quiet part of.
    outer_states: Option<&'w EstimationStates<'w>>,
    /// Which of many starts at work at once this is, from 1.
    start: Option<usize>,
}

impl Default for Work<'_> {
    fn default() -> Self {
        Self {
            halt: Halt::default(),
            observer: &(),
            store: None,
            budget: None,
            outer_budget: None,
            states: None,
            outer_states: None,
            start: None,
        }
    }
}

impl<'w> Work<'w> {
    /// Work that ends when this says so.
    pub fn until(halt: &Halt) -> Self {
        Self { halt: halt.clone(), ..Self::default() }
    }

    /// Tells `observer` how far it is.
    #[must_use]
    pub fn telling(self, observer: &'w dyn Observer) -> Self {
        Self { observer, ..self }
    }

    /// Keeps its state in `store`, where there is one: the same work with what was kept goes on where it was interrupted and ends
    /// with the same bits. A store that fails does not stop the work.
    #[must_use]
    pub fn keeping(self, store: Option<&'w dyn CheckpointStore>) -> Self {
        Self { store, ..self }
    }

    /// A part of which nothing is told, counted or kept, but that can be stopped.
    #[must_use]
    pub fn quiet(&self) -> Self {
        let outer_budget = self.budget.or(self.outer_budget);
        let outer_states = self.states.or(self.outer_states);
        Self { outer_budget, outer_states, ..Self::until(&self.halt) }
    }

    /// A part that is done whatever stops the rest.
    #[must_use]
    pub fn endless(&self) -> Self {
        Self { halt: Halt::default(), ..self.clone() }
    }

    /// A part whose state is not kept.
    #[must_use]
    pub fn unkept(&self) -> Self {
        self.clone().keeping(None)
    }

    /// Work that ends where it begins: what an estimation begins with is evaluated, and no more.
    pub(crate) fn ended(stop: Stop) -> Self {
        Self::until(&Halt::asking(move || Some(stop)))
    }

    /// A part with a limit of its own on its iterations.
    pub(crate) fn within<'b>(&self, budget: &'b Budget<'b>) -> Work<'b>
    where
        'w: 'b,
    {
        Work { budget: Some(budget), ..self.clone() }
    }

    /// A part that goes on from the states of its estimations, and keeps them.
    pub(crate) fn with_states<'s>(&self, states: &'s EstimationStates<'s>) -> Work<'s>
    where
        'w: 's,
    {
        Work { states: Some(states), ..self.clone() }
    }

    /// The start with this number, from 1, of many that are at work at once.
    pub(crate) fn of_start(&self, number: usize) -> Self {
        Self { start: Some(number), ..self.clone() }
    }

    /// When it ends.
    pub fn halt(&self) -> &Halt {
        &self.halt
    }

    /// Where its state is kept.
    pub fn store(&self) -> Option<&'w dyn CheckpointStore> {
        self.store
    }

    /// Whether it may go on.
    pub fn goes_on(&self) -> bool {
        self.stopped().is_none()
    }

    /// Why it is to end now with what it has; none while it may go on.
    pub fn stopped(&self) -> Option<Stop> {
        if self.is_replaying() {
            return None;
        }
        let budget = self.budget.or(self.outer_budget);
        self.halt.stop().or_else(|| budget.filter(|budget| budget.is_used_up()).map(|_| Stop::Iterations))
    }

    /// Why it is to end, other than by the number of its iterations.
    pub(crate) fn halted(&self) -> Option<Stop> {
        self.stopped().filter(|stop| *stop != Stop::Iterations)
    }

    /// When a choice that is asked often is to end. What has stopped before does not end it, since then the values that were reached
    /// are still to be judged.
    pub(crate) fn halt_from_here(&self) -> Option<&Halt> {
        Some(&self.halt).filter(|_| !self.is_replaying() && self.halted().is_none())
    }

    /// Why it is not to go on behind an estimation that ended like this; none when it is.
    pub(crate) fn stop_after(&self, ended: &Termination) -> Option<Stop> {
        match ended {
            Termination::Interrupted => Some(Stop::Interrupt),
            Termination::TimeLimit => Some(Stop::TimeLimit),
            _ => self.stopped(),
        }
    }

    /// How an iteration ended; where it was interrupted, for the reason that there is.
    pub(crate) fn termination(&self, summary: Summary) -> Termination {
        match summary {
            Summary::Interrupted => self.stopped().map_or(Termination::Interrupted, Termination::from),
            other => other.into(),
        }
    }

    /// Tells that a stage of its own begins, such as a search: what is being done.
    pub fn stage(&self, what: &str) {
        self.tell(|observer| observer.stage(what));
    }

    /// Tells that something begins that is no iteration, and may take as long: what is being done.
    pub(crate) fn doing(&self, what: &str) {
        self.tell(|observer| observer.doing(what));
    }

    /// Tells how many of its equal parts have ended.
    pub fn parts_ended(&self, done: usize) {
        self.tell(|observer| observer.parts_ended(done));
    }

    /// Tells that one of `count` starts has ended, as the `ended`-th.
    pub(crate) fn start_ended(&self, start: &StartSummary, ended: usize, count: usize) {
        self.tell(|observer| observer.start_ended(start, ended, count));
    }

    /// Tells that an estimation begins: `names` makes the names of what it estimates.
    pub(crate) fn begin(&self, names: &dyn Fn() -> Vec<UnknownName>) {
        self.tell(|observer| observer.begin(names));
    }

    /// The state that the estimation that begins now is to go on from.
    pub(crate) fn resume(&self) -> Option<Vec<u8>> {
        self.states?.resume()
    }

    /// Tells that an estimation has ended, after so many iterations, those before an interruption included.
    pub(crate) fn estimation_ended(&self, iterations: usize) {
        self.budget.into_iter().for_each(|budget| budget.ended(iterations));
    }

    /// This work as the monitor of an iteration; `parameters` makes what is told of its values.
    pub(crate) fn monitor<'m, P: Fn(&[f64]) -> Vec<f64>>(&'m self, parameters: P) -> IterationMonitor<'m, 'w, P> {
        IterationMonitor { work: self, parameters }
    }

    fn tell(&self, tell: impl FnOnce(&dyn Observer)) {
        if self.start.is_none() {
            tell(self.observer);
        }
    }

    /// Whether estimations follow that were made before: what ends the work now did not end it then.
    fn is_replaying(&self) -> bool {
        self.states.or(self.outer_states).is_some_and(EstimationStates::is_replaying)
    }

    /// Tells of an iteration, and counts it; breaks where it is to be the last.
    fn iteration(&self, iteration: &Iteration) -> ControlFlow<()> {
        match self.start {
            Some(number) => self.observer.start_iteration(number, iteration),
            None => self.observer.iteration(iteration),
        }
        let used_up = match self.budget {
            Some(budget) => budget.ends(iteration),
            None => self.outer_budget.is_some_and(Budget::is_used_up),
        };
        let ends = !self.is_replaying() && (used_up || !self.halt.goes_on());
        if ends { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// An iteration tells work of itself, and asks it whether to go on.
pub(crate) struct IterationMonitor<'m, 'w, P> {
    work: &'m Work<'w>,
    parameters: P,
}

impl<P: Fn(&[f64]) -> Vec<f64>> Monitor for IterationMonitor<'_, '_, P> {
    fn iteration(
        &mut self,
        iteration: &Iteration,
        values: &[f64],
        state: Option<&dyn Fn() -> Vec<u8>>,
    ) -> ControlFlow<()> {
        if let (Some(states), Some(state)) = (self.work.states, state) {
            states.put(state);
        }
        self.work.tell(|observer| observer.values(&(self.parameters)(values)));
        self.work.iteration(iteration)
    }

    fn goes_on(&mut self) -> bool {
        self.work.halted().is_none()
    }
}
