//! Checkpoints of a fit: the last state of each of its estimations, kept as often as costs little time. A fit that is repeated
//! with them goes through the estimations that had ended at once, and goes on in the last.

use crate::observer::{CheckpointStore, Iteration, Observer, StartSummary, Stop, UnknownName};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// States are not kept more often than this.
const LEAST: Duration = Duration::from_millis(50);
/// Time that passes before the next keeping, relative to what the last took: 5 percent of the time at most.
const SHARE: u32 = 20;

/// What is kept under one name: the states of all estimations of an attempt so far, and what came out when it has ended.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct SavedStates {
    pub(crate) summary: Option<StartSummary>,
    pub(crate) states: Vec<Vec<u8>>,
}

/// Hands states to a keeper, the newest of each name, not more often than is cheap. When it does so depends on the clock;
/// what comes out of the fit does not, because every state leads to the same end.
pub(crate) struct CheckpointWriter<'k> {
    keeper: Option<&'k dyn CheckpointStore>,
    pending: Mutex<Pending>,
}

struct Pending {
    states: BTreeMap<String, Vec<u8>>,
    due: Instant,
}

impl<'k> CheckpointWriter<'k> {
    pub(crate) fn new(keeper: Option<&'k dyn CheckpointStore>) -> Self {
        Self { keeper, pending: Mutex::new(Pending { states: BTreeMap::new(), due: Instant::now() }) }
    }

    /// Whether anything is kept at all.
    pub(crate) fn is_open(&self) -> bool {
        self.keeper.is_some()
    }

    /// What was kept under a name. What cannot be read is computed anew, which gives the same.
    pub(crate) fn find(&self, name: &str) -> SavedStates {
        let found = self.keeper.and_then(|k| k.find(name).ok().flatten());
        found.and_then(|bytes| postcard::from_bytes(&bytes).ok()).unwrap_or_default()
    }

    /// Keeps this now, or soon.
    pub(crate) fn put(&self, name: &str, summary: Option<&StartSummary>, states: &[Vec<u8>]) {
        let Some(keeper) = self.keeper else { return };
        // as the fields of `SavedStates` are written, without a copy
        let Ok(bytes) = postcard::to_stdvec(&(summary, states)) else { return };
        let mut pending = self.lock();
        pending.states.insert(name.to_string(), bytes);
        if Instant::now() >= pending.due {
            pending.write(keeper);
        }
    }

    /// Keeps what has not been kept yet.
    pub(crate) fn flush(&self) {
        if let Some(keeper) = self.keeper {
            self.lock().write(keeper);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Pending> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pending {
    fn write(&mut self, keeper: &dyn CheckpointStore) {
        let begun = Instant::now();
        // what cannot be kept now is tried again later; the keeper tells the user
        self.states.retain(|name, state| keeper.keep(name, state).is_err());
        self.due = Instant::now() + LEAST.max(SHARE * begun.elapsed());
    }
}

/// An observer that remembers the states, keeps them, and hands them out again.
pub(crate) struct CheckpointObserver<'a> {
    observer: &'a mut dyn Observer,
    ledger: &'a CheckpointWriter<'a>,
    name: String,
    /// The last state of each estimation; empty where the start values could not be used.
    states: Vec<Vec<u8>>,
    /// Estimations begun.
    begun: usize,
    /// Whether states are wanted though nothing is kept.
    remember: bool,
}

impl<'a> CheckpointObserver<'a> {
    /// Goes on from `states`; keeps under `name`.
    pub(crate) fn new(
        observer: &'a mut dyn Observer,
        ledger: &'a CheckpointWriter<'a>,
        name: String,
        states: Vec<Vec<u8>>,
    ) -> Self {
        Self { observer, ledger, name, states, begun: 0, remember: false }
    }

    /// This observer, for [`Self::into_states`].
    pub(crate) fn remembering(self) -> Self {
        Self { remember: true, ..self }
    }

    pub(crate) fn into_states(self) -> Vec<Vec<u8>> {
        self.states
    }

    /// Whether estimations follow that were made before: what ends the work now did not end it then.
    fn is_replaying(&self) -> bool {
        self.begun < self.states.len()
    }
}

impl Observer for CheckpointObserver<'_> {
    fn iteration(&mut self, iteration: &Iteration) -> ControlFlow<()> {
        let flow = self.observer.iteration(iteration);
        if self.is_replaying() { ControlFlow::Continue(()) } else { flow }
    }

    fn begin(&mut self, names: &dyn Fn() -> Vec<UnknownName>) {
        self.observer.begin(names);
    }

    fn ended(&mut self, iterations: usize) {
        self.observer.ended(iterations);
    }

    fn doing(&mut self, what: &str) {
        self.observer.doing(what);
    }

    fn stopped(&mut self) -> Option<Stop> {
        if self.is_replaying() { None } else { self.observer.stopped() }
    }

    fn values(&mut self, values: &[f64]) {
        self.observer.values(values);
    }

    fn resume(&mut self) -> Option<Vec<u8>> {
        let state = self.states.get(self.begun).filter(|s| !s.is_empty()).cloned();
        self.begun += 1;
        state
    }

    fn state(&mut self, bytes: &dyn Fn() -> Vec<u8>) {
        if !(self.remember || self.ledger.is_open()) {
            return;
        }
        let Some(now) = self.begun.checked_sub(1).filter(|_| !self.is_replaying()) else { return };
        self.states.resize(now, Vec::new());
        self.states.push(bytes());
        self.ledger.put(&self.name, None, &self.states);
    }
}
