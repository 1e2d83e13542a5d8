//! The search for what is missing from a model: candidates are simulated, screened, refitted, judged, and written into the text.
//!
//! **In** a model, runs to learn from and runs that are held out, a catalogue of effects. **Out** a
//! [`Diagnosis`](super::diagnosis::Diagnosis). **Never** compares models each by a noise of its own, and never names a cause by screening
//! alone. **Start** at [`search`] in `search.rs`; its road is `evenly` (samples on a grid) -> `stage` (a model at its fit, by the `way` of the `domain`) -> `measured`
//! (what effects ask of the data) -> `trace` (an effect's directions; `transfer` in the frequency domain) -> `screen` -> `metric`, `whitened`, `refit`
//! (the best fitted jointly, by one noise) -> `judgement` (scores, groups) -> `elimination` -> `gains`.

mod attached;
mod beside;
mod detection;
mod domain;
mod elimination;
mod evenly;
mod evidence;
mod experiment;
mod gains;
mod judgement;
mod measured;
mod metric;
mod options;
mod refit;
mod round;
#[expect(clippy::module_inception, reason = "the road is called what the room does")]
mod search;
mod search_error;
mod stage;
#[cfg(test)]
mod tests;
mod trace;
mod transfer;
mod way;
mod whitened;

pub use domain::Domain;
pub use options::{SearchOptions, Watcher};
pub use search::search;
pub use search_error::SearchError;
