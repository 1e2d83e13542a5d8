//! The iteration: from start values to the minimum of the cost.
//!
//! **In** a problem and a vector of values. **Out** residuals, sensitivities and their sums, as a cost for the one Gauss-Newton
//! iteration ([`fdm_numeric::least_squares`]). **Never** knows models, files or statistics. **Start** at [`likelihood`].

pub(super) mod evaluation;
pub(super) mod likelihood;
pub(super) mod optimizers;
pub(super) mod priors;
pub(super) mod products;
pub(super) mod sums;
#[cfg(test)]
mod tests;
