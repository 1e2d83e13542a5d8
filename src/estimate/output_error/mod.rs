//! Output error in the time domain from one vector of start values.
//!
//! **In** a model, runs, start values, options. **Out** a [`fit::Fit`]. **Start** at [`single`].

pub(super) mod attempt;
pub(super) mod cross_validation;
pub(super) mod defect;
pub(super) mod error;
pub(super) mod fit;
pub(super) mod integration_fault;
pub(super) mod loss;
pub(super) mod noise_model;
pub(super) mod options;
pub(super) mod robust;
pub(super) mod single;
mod standardised;
#[cfg(test)]
mod tests;
