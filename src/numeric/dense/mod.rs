//! Small dense systems of linear equations, each algorithm once.
//!
//! [`Lu`] (partial pivoting; real, complex, right-hand sides in lanes) and [`Cholesky`] are the general ones. What stands beside them are
//! other algorithms, not copies: [`ShiftedHessenberg`] eliminates `H - s` by exchanges of neighbours for inverse iteration,
//! [`GaussJordan`] decides a rank by complete pivoting, [`panels`] reduces tall
//! matrices by reflections so that rank is decided on J and not on J'J. [`multiply`] and [`Cholesky`] share their sums of products.

pub mod cholesky;
pub mod lu;
pub mod panels;

pub use crate::eigen::ShiftedHessenberg;
pub use cholesky::Cholesky;
pub use lu::{GaussJordan, Lu};
pub use panels::{multiply, multiply_add, multiply_to_symmetric};
