//! What may be missing from a model: effects, where they fit, and the user's own text with one of them in it.
//!
//! **In** a text of effects ([`Catalogue::read`]), a model with its text ([`Subject`]), answers to what only data know
//! ([`Scales`]). **Out** [`Candidate`]s, and [`Extension`]s: edited text, its tree, its new parameters with null values
//! and grids. **Never** data, files or simulation, and never a text printed anew: edits touch what they change.
//! **Start** at [`Catalogue::places`] and [`Candidate::apply`]; `soundness` checks an effect, `conditions.rs` says
//! where it fits, `rewrite` what it changes, `edit.rs` where that stands in the text, `null.rs` whether it vanishes.

mod candidate;
mod catalogue;
mod conditions;
mod dimension;
mod edit;
pub mod forced;
mod null;
mod rewrite;
mod scales;
mod soundness;
mod subject;
#[cfg(test)]
mod tests;
mod turnover;

pub use crate::candidate::{Extension, NewParam};
pub use crate::conditions::{Effect, Kind};
pub use candidate::{Candidate, Choice, Crowded, Places};
pub use catalogue::{Catalogue, STANDARD};
pub use fdm_grammar::syntax::Field;
pub use null::Null;
pub use scales::{Beginning, Nominal, Scales};
pub use subject::{Subject, Untried};
