//! Small dense systems of linear equations, each algorithm once.
//!
//! [`Lu`] (partial pivoting; real, complex, right-hand sides in lanes) and [`Cholesky`] are the general ones. What stands beside them are
//! other algorithms, not copies: [`ShiftedHessenberg`] eliminates `H - s` by exchanges of neighbours for inverse iteration,
//! [`GaussJordan`] decides a rank by complete pivoting, [`Pentadiagonal`] has two diagonals beside the main one, [`triangle`] reduces
//! tall matrices by reflections so that rank is decided on J and not on J'J. [`multiply`] and [`Cholesky`] share their sums of products.

mod banded;
pub mod cholesky;
mod gauss_jordan;
mod hessenberg;
pub mod lu;
mod panels;
pub mod triangle;

pub use banded::{Factor, Pentadiagonal};
pub use cholesky::Cholesky;
pub use gauss_jordan::GaussJordan;
pub use hessenberg::ShiftedHessenberg;
pub use lu::Lu;
pub use panels::{multiply, multiply_add, multiply_to_symmetric};
