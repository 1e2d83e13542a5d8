//! Output error in the time domain from one vector of start values.
//!
//! **In** a model, runs, start values, options. **Out** a [`fit::Fit`]. **Start** at [`single`].

mod censored;
pub(crate) mod cross_validation;
pub(crate) mod error;
pub(crate) mod fit;
pub(crate) mod initial_conditions;
pub(crate) mod loss;
pub(crate) mod noise_model;
pub(crate) mod options;
pub(crate) mod residual_vector;
pub(crate) mod robust;
pub(crate) mod single;
mod standardised;
#[cfg(test)]
mod tests;
