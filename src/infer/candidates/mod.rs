//! Candidates in a model: the model at its fit, an effect in its text, what it adds to the responses, and the text as it is written.

pub(crate) mod coefficient_text;
pub(crate) mod directions;
mod error;
pub(crate) mod extended_model;
pub(crate) mod fitted_model;
pub(crate) mod forced_response;
pub(crate) mod forced_tiles;
pub(crate) mod initial_fit;
pub(crate) mod place;
pub(crate) mod predictor;
pub(crate) mod runs;
pub(crate) mod written_model;

pub use error::DiagnosisError;
pub use place::{Place, PlaceKind};
pub use runs::{DiagnosisOptions, Domain};
