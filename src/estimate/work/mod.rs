//! What long work is told, and what it tells: when it is to end, who follows it, and where its state is kept.
//!
//! A limit on the iterations of all estimations together, fallback strategies included.
//!
//! What can be seen of long work.
//!
//! How an estimation ended.

use crate::problem::noise::Degeneracy;
use crate::problem::unknowns::UnknownName;
use checkpoint::EstimationStates;
use fdm_numeric::halt::{Halt, Stop};
use fdm_numeric::least_squares::{Iteration, Monitor, Summary};
use fdm_system::simulate::EventFault;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::ControlFlow;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

pub(crate) mod checkpoint;

pub use checkpoint::CheckpointStore;

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

    fn is_used_up(&self) -> bool {
        self.outer.is_some_and(|(outer, _)| outer.is_used_up()) || self.is_own_used_up()
    }

    fn is_own_used_up(&self) -> bool {
        self.most.is_some_and(|most| self.before.load(Relaxed) + self.now.load(Relaxed) >= most)
    }

    /// Counts an iteration; whether it is the last.
    fn ends(&self, iteration: &Iteration) -> bool {
        self.now.store(iteration.number, Relaxed);
        let of_outer =
            |(outer, counts): (&Budget<'_>, bool)| if counts { outer.ends(iteration) } else { outer.is_used_up() };
        let outer = self.outer.is_some_and(of_outer);
        outer || self.estimations.load(Relaxed) > 0 && self.is_own_used_up()
    }

    /// Counts an estimation that has ended, after so many iterations.
    fn ended(&self, iterations: usize) {
        self.before.fetch_add(iterations, Relaxed);
        self.now.store(0, Relaxed);
        self.estimations.fetch_add(1, Relaxed);
        self.outer.filter(|(_, counts)| *counts).into_iter().for_each(|(outer, _)| outer.ended(iterations));
    }
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

pub use fdm_numeric::least_squares::Reason;

/// How an estimation ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Termination {
    /// At a minimum of the cost.
    Converged(Reason),
    /// All iterations were used.
    IterationLimit,
    /// No step lowers the cost, though the slope says that one should: a kink in the model, or partials that do
    /// not fit it.
    NoProgress,
    /// The simulation at the start values diverged; nothing was estimated.
    Diverged {
        /// The run.
        run: String,
        /// Time since the run began, in the model's time unit.
        time: f64,
        /// Index of the state, when it can be told.
        state: Option<usize>,
        /// The sample (from 0) that was not reached.
        sample: usize,
        /// Not the numbers but an event ended the run.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        event: Option<EventFault>,
    },
    /// In the frequency domain: there is no response at the start values; nothing was estimated.
    Unanswered {
        /// The run.
        run: String,
    },
    /// An output at the start values, or its partial by a parameter, is not finite; nothing was estimated.
    NotFinite {
        /// The run.
        run: String,
        /// The output.
        output: String,
        /// The sample, from 0.
        sample: usize,
        /// Its frequency in cycles per unit of time, in the frequency domain.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        frequency: Option<f64>,
        /// The parameter, when the output itself is finite.
        parameter: Option<String>,
    },
    /// Somebody asked for the end.
    Interrupted,
    /// The time that was given is over.
    TimeLimit,
    /// The cost that was reached is none: not a finite number, or below that of a perfect match.
    Impossible,
    /// The free response grows beyond all that could follow it, while the outputs stay in place: the values are those of a shorter record.
    Unstable {
        /// E-folds over the longest run.
        growth: f64,
        /// What that lasts, in the model's time unit.
        length: f64,
        /// A state of the mode that grows.
        state: String,
        /// The unit of time.
        unit: String,
    },
}

impl Termination {
    /// Whether the estimates are at a minimum.
    pub fn is_good(&self) -> bool {
        matches!(self, Self::Converged(_))
    }

    /// Whether the work was ended from outside before it was done.
    pub fn is_stopped(&self) -> bool {
        matches!(self, Self::Interrupted | Self::TimeLimit)
    }
}

impl From<Stop> for Termination {
    fn from(stop: Stop) -> Self {
        match stop {
            Stop::Interrupt => Self::Interrupted,
            Stop::TimeLimit => Self::TimeLimit,
            Stop::Iterations => Self::IterationLimit,
        }
    }
}

impl From<Summary> for Termination {
    fn from(summary: Summary) -> Self {
        match summary {
            Summary::Converged(reason) => Self::Converged(reason),
            Summary::IterationLimit => Self::IterationLimit,
            Summary::NoProgress => Self::NoProgress,
            Summary::Interrupted => Self::Interrupted,
        }
    }
}

impl fmt::Display for Termination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Converged(Reason::SmallStep) => write!(f, "converged"),
            Self::Converged(Reason::Rounding) => write!(f, "converged to rounding"),
            Self::Converged(Reason::Stationary) => write!(f, "converged: no step lowers the cost any more"),
            Self::Converged(Reason::AllHeld) => {
                write!(f, "every free parameter is held: it is at a bound, or has no influence on what was compared")
            }
            Self::Converged(Reason::NothingToEstimate) => {
                write!(f, "no parameter is free: the model was compared only")
            }
            Self::IterationLimit => write!(f, "not converged: all iterations were used"),
            Self::NoProgress => {
                write!(f, "not converged: no step lowers the cost, though its slope is not zero here")
            }
            Self::Diverged { run, time, event: Some(event), .. } => {
                write!(f, "run `{run}` ends at time {time} already at the start values: {event}")
            }
            Self::Diverged { run, time, .. } => {
                write!(f, "run `{run}` diverges at time {time} already at the start values")
            }
            Self::Unanswered { run } => write!(
                f,
                "run `{run}`: the model has no response in the frequency domain at the start values; begin with other values (`--set NAME=VALUE`)"
            ),
            Self::NotFinite { run, output, sample, frequency, parameter } => {
                let place = match frequency {
                    Some(f) => format!("at {f} cycles per unit of time"),
                    None => format!("sample {}", sample + 1),
                };
                let what = match parameter {
                    Some(parameter) => format!("the partial of output `{output}` by `{parameter}`"),
                    None => format!("output `{output}`"),
                };
                write!(f, "run `{run}`, {place}: {what} is not a finite number at the start values")
            }
            Self::Unstable { growth, length, state, unit } => write!(
                f,
                "unstable as a free response over {length} {unit} (growth e^{growth:.0}), though the outputs stay in place: use `--method filter-error` (add `noise der({state}) = s;` and `param s`) or `--domain frequency`"
            ),
            Self::Interrupted => write!(f, "interrupted"),
            Self::TimeLimit => write!(f, "stopped by the time limit"),
            Self::Impossible => write!(
                f,
                "no result: the cost that was reached is lost in rounding or not a finite number; begin with other values, or \
                 with fewer fallback strategies"
            ),
        }
    }
}
