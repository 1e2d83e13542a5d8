//! What is known of numbers alone: no models, no records. Every package above may use it.
//!
//! Each foreign crate of numbers is named in one file: `pulp` in [`lanes`], `rustfft`, `realfft` and `rustdct` in
//! [`fourier`], `statrs` in [`statistics`], `rand` and `rand_chacha` in [`random`], `libm` in [`elementary`].

pub mod active_set;
pub mod dense;
pub mod eigen;
pub mod elementary;
pub mod fourier;
pub mod halt;
pub mod lanes;
pub mod least_squares;
pub mod parallel;
pub mod quadratic;
pub mod random;
pub mod statistics;
