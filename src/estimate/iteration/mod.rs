//! The iteration: from start values to the minimum of the cost.
//!
//! **In** a problem and a vector of values. **Out** the values at the minimum, the quadratic there, and how it ended.
//! **Never** knows models, files or statistics. **Start** at [`correction`].

pub(super) mod affine;
#[cfg(test)]
mod approach;
pub(super) mod bend;
pub(super) mod cholesky;
pub(super) mod correction;
pub(super) mod evaluation;
pub(super) mod information;
pub(super) mod normal;
pub(super) mod plane_products;
pub(super) mod priors;
pub(super) mod products;
pub(super) mod projection;
pub(super) mod quadratic;
pub(super) mod restart;
#[cfg(test)]
mod resumption;
pub(super) mod search;
pub(super) mod secant;
pub(super) mod snapshot;
pub(super) mod stationarity;
pub(super) mod step;
pub(super) mod trial;
pub(super) mod triangle;
