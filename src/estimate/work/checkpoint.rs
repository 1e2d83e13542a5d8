//! Checkpoints of a fit: the last state of each of its estimations, kept as often as costs little time. A fit that is repeated
//! with them goes through the estimations that had ended at once, and goes on in the last.

use super::StartSummary;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

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

/// States are not kept more often than this.
const LEAST: Duration = Duration::from_millis(50);

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
        // time that passes before the next keeping, relative to what the last took: 5 percent of the time at most
        self.due = Instant::now() + LEAST.max(20 * begun.elapsed());
    }
}

/// The states of the estimations of one attempt: kept, and handed out again to the same attempt.
pub(crate) struct EstimationStates<'a> {
    writer: &'a CheckpointWriter<'a>,
    name: String,
    /// Whether states are wanted though nothing is kept.
    remember: bool,
    series: Mutex<Series>,
}

struct Series {
    /// The last state of each estimation; empty where the start values could not be used.
    states: Vec<Vec<u8>>,
    /// Estimations begun.
    begun: usize,
}

impl Series {
    fn is_replaying(&self) -> bool {
        self.begun < self.states.len()
    }
}

impl<'a> EstimationStates<'a> {
    /// Goes on from `states`; keeps under `name`.
    pub(crate) fn new(writer: &'a CheckpointWriter<'a>, name: String, states: Vec<Vec<u8>>) -> Self {
        Self { writer, name, remember: false, series: Mutex::new(Series { states, begun: 0 }) }
    }

    /// These, for [`Self::into_states`].
    pub(crate) fn remembering(self) -> Self {
        Self { remember: true, ..self }
    }

    pub(crate) fn into_states(self) -> Vec<Vec<u8>> {
        self.series.into_inner().unwrap_or_else(PoisonError::into_inner).states
    }

    /// Whether estimations follow that were made before.
    pub(super) fn is_replaying(&self) -> bool {
        self.lock().is_replaying()
    }

    /// The state that the next estimation is to go on from.
    pub(super) fn resume(&self) -> Option<Vec<u8>> {
        let mut series = self.lock();
        series.begun += 1;
        series.states.get(series.begun - 1).filter(|s| !s.is_empty()).cloned()
    }

    /// Keeps the state of the estimation at work.
    pub(super) fn put(&self, bytes: &dyn Fn() -> Vec<u8>) {
        if !(self.remember || self.writer.is_open()) {
            return;
        }
        let mut series = self.lock();
        let Some(now) = series.begun.checked_sub(1).filter(|_| !series.is_replaying()) else { return };
        series.states.resize(now, Vec::new());
        series.states.push(bytes());
        self.writer.put(&self.name, None, &series.states);
    }

    fn lock(&self) -> MutexGuard<'_, Series> {
        self.series.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
