//! The road of a fit: start values, steps, iteration, a second look at the steps; one start or many.
//!
//! **In** a model, runs and options. **Out** a [`fit::Fit`]. **Never** prints or touches files: a keeper does.
//! **Start** at [`fit`].

pub(super) mod attempt;
pub(super) mod fit;
pub(super) mod fit_error;
pub(super) mod footing;
pub(super) mod ledger;
pub(super) mod plain;
mod prediction;
pub(super) mod spread;
pub(super) mod stages;
pub(super) mod start;
pub(super) mod starts;
