//! What work keeps, in memory: states to go on from, and results of tasks that were done elsewhere.

use fdm_estimate::CheckpointStore;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Byte strings under names.
#[derive(Debug, Default)]
pub struct Memory(Mutex<BTreeMap<String, Vec<u8>>>);

impl Memory {
    /// With these in it.
    pub fn with(kept: BTreeMap<String, Vec<u8>>) -> Self {
        Self(Mutex::new(kept))
    }

    /// All that is in it.
    pub fn all(&self) -> BTreeMap<String, Vec<u8>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl CheckpointStore for Memory {
    fn keep(&self, name: &str, state: &[u8]) -> Result<(), String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(name.to_string(), state.to_vec());
        Ok(())
    }

    fn find(&self, name: &str) -> Result<Option<Vec<u8>>, String> {
        Ok(self.0.lock().unwrap_or_else(PoisonError::into_inner).get(name).cloned())
    }
}
