//! The search for what is missing from a model: candidates are simulated, screened, refitted, judged, and written into the text.
//!
//! **In** a model, runs to learn from and runs that are held out, a catalogue of effects. **Out** a
//! [`Diagnosis`](super::diagnosis::Diagnosis). **Never** compares models each by a noise of its own, and never names a cause by screening
//! alone. **Start** at [`search`] in `search.rs`; its road is `evenly` (samples on a grid) -> `stage` (a model at its fit, by the `way`
//! of the `domain`) -> `measured` (what effects ask of the data) -> `trace` (an effect's directions; `transfer` in the frequency domain) ->
//! `round` (all of them screened) -> `contest`, `contender` (the best fitted jointly, by one noise: `metric`, `whitened`, `refit`,
//! `newton`) -> `confirmed`, `held_test` (the chance) -> `judgement` (scores, groups) -> `beginning` (with which to go on) -> `elimination`,
//! `revision`, `one_law` (what several of them may be together) -> `gains`.

mod attached;
mod beginning;
mod beside;
mod chosen;
mod confirmed;
mod contender;
mod contest;
mod detection;
mod domain;
mod elimination;
mod evenly;
mod evidence;
mod experiment;
mod first;
mod following;
mod gains;
mod held_noise;
mod held_test;
mod judgement;
mod measured;
mod metric;
mod newton;
mod one_law;
mod options;
mod own_motion;
mod own_noise;
mod refit;
mod revision;
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
mod whole;

pub use domain::Domain;
pub use options::{SearchOptions, Watcher};
pub use search::search;
pub use search_error::SearchError;
