//! Hands on.

mod c;

pub use c::Gamma;
