//! What is kept of a fit while it runs, and when: as often as costs little time.

use super::starts::StartSummary;
use crate::estimate::keeper::Keeper;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// States are not kept more often than this.
const LEAST: Duration = Duration::from_millis(50);
/// Time that passes before the next keeping, relative to what the last took: 5 percent of the time at most.
const SHARE: u32 = 20;

/// What is kept under one name: the states of all estimations of an attempt so far, and what came out when it has ended.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(in crate::estimate) struct Kept {
    pub(in crate::estimate) summary: Option<StartSummary>,
    pub(in crate::estimate) states: Vec<Vec<u8>>,
}

/// Hands states to a keeper, the newest of each name, not more often than is cheap. When it does so depends on the clock;
/// what comes out of the fit does not, because every state leads to the same end.
pub(in crate::estimate) struct Ledger<'k> {
    keeper: Option<&'k dyn Keeper>,
    pending: Mutex<Pending>,
}

struct Pending {
    states: BTreeMap<String, Vec<u8>>,
    due: Instant,
}

impl<'k> Ledger<'k> {
    pub(in crate::estimate) fn new(keeper: Option<&'k dyn Keeper>) -> Self {
        Self { keeper, pending: Mutex::new(Pending { states: BTreeMap::new(), due: Instant::now() }) }
    }

    /// Whether anything is kept at all.
    pub(in crate::estimate) fn is_open(&self) -> bool {
        self.keeper.is_some()
    }

    /// What was kept under a name. What cannot be read is computed anew, which gives the same.
    pub(in crate::estimate) fn find(&self, name: &str) -> Kept {
        let found = self.keeper.and_then(|k| k.find(name).ok().flatten());
        found.and_then(|bytes| postcard::from_bytes(&bytes).ok()).unwrap_or_default()
    }

    /// Keeps this now, or soon.
    pub(in crate::estimate) fn put(&self, name: &str, summary: Option<&StartSummary>, states: &[Vec<u8>]) {
        let Some(keeper) = self.keeper else { return };
        // as the fields of `Kept` are written, without a copy
        let Ok(bytes) = postcard::to_stdvec(&(summary, states)) else { return };
        let mut pending = self.lock();
        pending.states.insert(name.to_string(), bytes);
        if Instant::now() >= pending.due {
            pending.write(keeper);
        }
    }

    /// Keeps what has not been kept yet.
    pub(in crate::estimate) fn flush(&self) {
        if let Some(keeper) = self.keeper {
            self.lock().write(keeper);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Pending> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pending {
    fn write(&mut self, keeper: &dyn Keeper) {
        let begun = Instant::now();
        // what cannot be kept now is tried again later; the keeper tells the user
        self.states.retain(|name, state| keeper.keep(name, state).is_err());
        self.due = Instant::now() + LEAST.max(SHARE * begun.elapsed());
    }
}
