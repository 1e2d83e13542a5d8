//! Ways to the estimates when the plain correction goes astray, and ways to see how far they can be trusted.
//!
//! **In** a model, runs, and where a plain correction ended. **Out** better ends, estimates by length and by weights.
//! **Never** hides what was tried. **Start** at [`rescue`].

pub(super) mod continuation;
pub(super) mod lengths;
pub(super) mod rescue;
pub(super) mod reweighting;
pub(super) mod segments;
pub(super) mod settling;
pub(super) mod shooting;
pub(super) mod strategy_error;
pub(super) mod substitution;
pub(super) mod trouble;
pub(super) mod uncut;
