//! The linear model that the frequency domain sees: `x' = A x + B v`, `y = C x + D v`, where v are inputs and delayed signals.
//!
//! **In** a [`Model`](crate::Model), linear or linearised about its trim. **Out** the structural nonzeros of A, B, C, D with their exact
//! derivatives by every parameter ([`Structure`], [`Values`]); modes. **Never** records. **Start** at [`LinearModel`] and [`Modes`].

mod characteristic;
mod coefficients;
mod eigen;
mod elimination;
mod hessenberg;
mod modes;
mod retarded;
mod structure;
#[cfg(test)]
mod tests;
mod trim;

pub use coefficients::{LinearModel, Obtained, Trim};
pub(crate) use hessenberg::ShiftedHessenberg;
pub use modes::{Mode, ModeErrors, Modes, ModesError};
pub use structure::{Slope, Structure, TauSlope, Term, Values};
pub use trim::TrimError;
