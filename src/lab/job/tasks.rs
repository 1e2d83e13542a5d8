//! Tasks of a command: what they are called, how one is done, and how their results become what the command looks for.
//!
//! What work keeps, in memory: states to go on from, and results of tasks that were done elsewhere.

use crate::study::{Profiler, REPEATS, Repeat, Side};
use fdm_estimate::{CheckpointStore, Halt, StartSearch};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// How a command is cut into tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Into the starts of a fit.
    Starts,
    /// Into the repeats of a study.
    Repeats,
    /// Into the sides of profiles.
    Sides,
    /// Not at all: the command is one task.
    Whole,
}

/// The name under which the result of a whole command is kept.
const WHOLE: &str = "result";

impl Kind {
    /// What one task is called.
    pub fn task(self) -> &'static str {
        match self {
            Self::Starts => "start",
            Self::Repeats => "repeat",
            Self::Sides => "side of a profile",
            Self::Whole => "result",
        }
    }

    /// Results of tasks, by number, as the command looks for what it has done before; `names` are those of the tasks, where they have some.
    ///
    /// # Errors
    /// A sentence, where a result cannot be read.
    pub fn kept(self, names: &[String], results: &BTreeMap<u64, Vec<u8>>) -> Result<BTreeMap<String, Vec<u8>>, String> {
        let unreadable = |k: &u64| format!("the result of {} {} cannot be read", self.task(), k + 1);
        if self == Self::Repeats {
            let mut repeats: BTreeMap<u64, Repeat> = BTreeMap::new();
            for (k, bytes) in results {
                repeats.insert(*k, postcard::from_bytes(bytes).map_err(|_| unreadable(k))?);
            }
            let bytes = postcard::to_allocvec(&repeats).map_err(|e| e.to_string())?;
            return Ok(BTreeMap::from([(REPEATS.to_string(), bytes)]));
        }
        let name = |k: &u64| match self {
            Self::Starts => Ok(StartSearch::name(*k as usize + 1)),
            Self::Sides => names.get(*k as usize).cloned().ok_or_else(|| unreadable(k)),
            Self::Whole | Self::Repeats => Ok(WHOLE.to_string()),
        };
        results.iter().map(|(k, bytes)| Ok((name(k)?, bytes.clone()))).collect()
    }

    /// The result of a whole command among what is kept.
    pub fn whole(kept: &dyn CheckpointStore) -> Option<Vec<u8>> {
        kept.find(WHOLE).ok().flatten()
    }
}

/// A command that is cut into tasks and ready to do any of them: whoever does a task gets the same bytes.
pub trait Tasks: Sync {
    /// How it is cut.
    fn kind(&self) -> Kind;

    /// How many tasks there are.
    fn count(&self) -> u64;

    /// The names of the tasks, where they have others than their numbers.
    fn names(&self) -> Vec<String> {
        Vec::new()
    }

    /// Does the task with this number, from 0, until it is to end. None where it was interrupted.
    ///
    /// # Errors
    /// A sentence, where the task cannot be done at all.
    fn once(&self, task: u64, halt: &Halt) -> Result<Option<Vec<u8>>, String>;
}

/// The starts of a fit.
pub struct Starts(pub StartSearch);

impl Tasks for Starts {
    fn kind(&self) -> Kind {
        Kind::Starts
    }

    fn count(&self) -> u64 {
        self.0.count() as u64
    }

    fn once(&self, task: u64, halt: &Halt) -> Result<Option<Vec<u8>>, String> {
        Ok(self.0.once(task as usize + 1, halt))
    }
}

/// So many repeats of a fit or an experiment.
pub struct Repeats<'o> {
    /// Makes one, as [`series`](crate::study::series) asks for it.
    pub once: &'o (dyn Fn(u64, &Halt) -> Option<Repeat> + Sync),
    /// How many.
    pub count: u64,
}

impl Tasks for Repeats<'_> {
    fn kind(&self) -> Kind {
        Kind::Repeats
    }

    fn count(&self) -> u64 {
        self.count
    }

    fn once(&self, task: u64, halt: &Halt) -> Result<Option<Vec<u8>>, String> {
        let repeat = (self.once)(task, halt);
        repeat.map(|repeat| postcard::to_allocvec(&repeat).map_err(|e| e.to_string())).transpose()
    }
}

/// Both sides of the profiles of these parameters.
pub struct Sides<'p> {
    /// The fit.
    pub profiler: &'p Profiler<'p>,
    /// The parameters.
    pub parameters: Vec<String>,
}

impl Tasks for Sides<'_> {
    fn kind(&self) -> Kind {
        Kind::Sides
    }

    fn count(&self) -> u64 {
        2 * self.parameters.len() as u64
    }

    fn names(&self) -> Vec<String> {
        self.parameters.iter().flat_map(|name| Side::BOTH.map(|side| side.of(name))).collect()
    }

    fn once(&self, task: u64, _: &Halt) -> Result<Option<Vec<u8>>, String> {
        let name = &self.parameters[task as usize / 2];
        self.profiler.side_of(name, Side::BOTH[task as usize % 2]).map_err(|e| e.to_string())
    }
}

/// Does tasks on all threads, and hands each result on as it comes; the first failure ends the work.
///
/// # Errors
/// That of the first task that cannot be done.
pub fn work_off(
    tasks: &dyn Tasks,
    numbers: &[u64],
    halt: &Halt,
    came: &(dyn Fn(u64, Vec<u8>) + Sync),
) -> Result<(), String> {
    numbers.par_iter().with_max_len(1).try_for_each(|number| {
        if !halt.goes_on() {
            return Ok(());
        }
        if let Some(result) = tasks.once(*number, halt)? {
            came(*number, result);
        }
        Ok(())
    })
}

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
