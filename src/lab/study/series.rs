//! All repeats: at work on every core, kept as they end, so that an interruption loses none.
//!
//! Every repeat draws from a stream of its own, so that its numbers depend on its place alone: not on threads, on the order in which
//! repeats end, or on how often the series was interrupted.
//!
//! Why there is nothing to repeat.

use fdm_estimate::{CheckpointStore, FitError, Work};
use fdm_results::documents::study::Repeat;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The name under which all repeats are kept, by number.
pub const REPEATS: &str = "repeats";
/// The form in which repeats are kept, for those who say what their bits depend on: 2 since requirements are among them.
pub const FORM: u8 = 2;
/// Least time between two states that are kept.
const PAUSE: Duration = Duration::from_secs(1);

/// Repeats 0 to `count`, by `once` (none when it was interrupted), which `came` is told, by number; those that the work has kept are
/// not made again. What is missing in the end was interrupted.
pub fn series(
    count: usize,
    work: &Work<'_>,
    came: &(dyn Fn(u64, &Repeat) + Sync),
    once: &(dyn Fn(u64) -> Option<Repeat> + Sync),
) -> Vec<Option<Repeat>> {
    let shelf = Shelf::open(count, work.store());
    let missing = shelf.missing();
    shelf.show(came);
    work.parts_ended(count - missing.len());
    missing.into_iter().par_bridge().for_each(|k| {
        if work.goes_on()
            && let Some(repeat) = once(k)
        {
            came(k, &repeat);
            work.parts_ended(shelf.put(k, repeat));
        }
    });
    shelf.close()
}

/// Repeats that have ended.
struct Shelf<'k> {
    keeper: Option<&'k dyn CheckpointStore>,
    state: Mutex<State>,
    count: usize,
}

struct State {
    /// By number; those beyond the count belong to a longer series that was kept before.
    repeats: BTreeMap<u64, Repeat>,
    done: usize,
    fresh: bool,
    next: Instant,
}

impl<'k> Shelf<'k> {
    fn open(count: usize, keeper: Option<&'k dyn CheckpointStore>) -> Self {
        // what cannot be read is computed anew, and the keeper tells
        let bytes = keeper.and_then(|k| k.find(REPEATS).ok().flatten());
        let repeats: BTreeMap<u64, Repeat> = bytes.and_then(|b| postcard::from_bytes(&b).ok()).unwrap_or_default();
        let done = repeats.range(..count as u64).count();
        let state = Mutex::new(State { repeats, done, fresh: false, next: Instant::now() + PAUSE });
        Self { keeper, state, count }
    }

    fn missing(&self) -> Vec<u64> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        (0..self.count as u64).filter(|k| !state.repeats.contains_key(k)).collect()
    }

    /// Those that were kept before.
    fn show(&self, came: &dyn Fn(u64, &Repeat)) {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.repeats.range(..self.count as u64).for_each(|(k, repeat)| came(*k, repeat));
    }

    /// Keeps a repeat; says how many have ended.
    fn put(&self, k: u64, repeat: Repeat) -> usize {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.repeats.insert(k, repeat);
        state.done += 1;
        state.fresh = true;
        if Instant::now() >= state.next {
            self.keep(&mut state);
        }
        state.done
    }

    fn keep(&self, state: &mut State) {
        let begun = Instant::now();
        if let Some(keeper) = self.keeper
            && state.fresh
            && let Ok(bytes) = postcard::to_allocvec(&state.repeats)
        {
            // a keeper that fails tells by itself
            let _ = keeper.keep(REPEATS, &bytes);
            state.fresh = false;
        }
        // how much longer the work is than the keeping of it
        state.next = begun + PAUSE.max(20 * begun.elapsed());
    }

    fn close(self) -> Vec<Option<Repeat>> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        self.keep(&mut state);
        (0..self.count as u64).map(|k| state.repeats.remove(&k)).collect()
    }
}

/// Why a fit cannot be repeated.
#[derive(Debug, Clone, PartialEq)]
pub enum StudyError {
    /// It could not begin.
    Fit(FitError),
    /// It did not end at a minimum.
    Astray {
        /// How it ended.
        reason: String,
    },
    /// There is no noise to draw.
    NoNoise,
    /// The colour of the residuals is not known.
    NoColour {
        /// Why.
        reason: String,
    },
    /// Nothing was estimated.
    NothingEstimated,
    /// A parameter has no profile.
    NoProfile {
        /// As typed.
        parameter: String,
        /// Why.
        reason: String,
    },
}

impl StudyError {
    /// Whether numbers went wrong, not what was given.
    pub fn is_of_numbers(&self) -> bool {
        matches!(self, Self::Astray { .. })
    }
}

impl fmt::Display for StudyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fit(e) => e.fmt(f),
            Self::Astray { reason } => {
                write!(f, "the fit itself does not end at a minimum ({reason}); there is nothing to repeat")
            }
            Self::NoNoise => f.write_str(
                "the residuals vanish or leave no degree of freedom, so there is no noise to draw; say what it is with --noise OUTPUT=DEVIATION",
            ),
            Self::NoColour { reason } => {
                write!(f, "the colour of the residuals is not known ({reason}); use --noise-colour white, ar1 or pink")
            }
            Self::NoProfile { parameter, reason } => write!(f, "`{parameter}` has no profile: {reason}"),
            Self::NothingEstimated => f.write_str("no parameter is free; there is nothing to study"),
        }
    }
}

impl std::error::Error for StudyError {}

impl From<FitError> for StudyError {
    fn from(e: FitError) -> Self {
        Self::Fit(e)
    }
}
