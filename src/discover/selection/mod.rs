//! Forward selection of what is missing from a model: candidates are simulated, screened, fitted jointly, compared, and written into
//! the text.
//!
//! **In** a model, training and validation runs, a catalogue of effects. **Out** a [`Diagnosis`](crate::Diagnosis). **Never**
//! compares models each by a noise of its own, and never names a cause by screening alone. **Start** at [`diagnose`]. Its order is
//! `runs` (samples on a grid) -> `initial_fit` -> `fitted_model` (responses by a `predictor`, in time or in frequency bins) ->
//! `extended_model` (an effect in the text) -> `directions` (what it adds to the responses) -> `forward_step` (all of them
//! screened) -> `shortlist` -> `candidate_model` (fitted jointly by one noise: `whitening`, `projection`, `fitting`, `newton`) ->
//! `comparison` -> `significance` -> `acceptance` -> `look_ahead` (with which to go on) -> `elimination` -> `front` (plain errors by number of effects:
//! `written_model`) -> `assessment`, `law_curve` (a law without a name, as a table in the text), `coefficient_table` (a coefficient as one:
//! `coefficient_text`).

mod acceptance;
mod all_samples;
mod assessment;
mod best_subsets;
mod candidate_model;
mod coefficient_table;
mod coefficient_text;
mod comparison;
mod conclusion;
mod directions;
mod elimination;
mod error;
mod extended_model;
mod feedback;
mod fitted_model;
mod fitting;
mod forced_tiles;
mod forward_selection;
mod forward_step;
mod free_motion;
mod front;
mod infer;
mod initial_fit;
mod law_curve;
mod look_ahead;
mod newton;
mod predictor;
mod projection;
mod runs;
mod shortlist;
mod significance;
#[cfg(test)]
mod tests;
mod whitening;
mod written_model;

pub use error::DiagnosisError;
pub use forward_selection::diagnose;
pub use runs::{DiagnosisOptions, Domain};
