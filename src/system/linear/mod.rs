//! The linear model that the frequency domain sees: `x' = A x + B v`, `y = C x + D v`, where v are inputs and delayed signals.
//!
//! Of a [`Model`](crate::Model), linear or linearised about its trim: the structural nonzeros of A, B, C, D with their exact derivatives
//! by every parameter ([`Structure`], [`Values`]), and modes. Start at [`LinearModel`] and [`Modes`].

mod coefficients;
mod modes;
#[cfg(test)]
mod tests;
mod trim;

pub use coefficients::{LinearModel, Obtained, Recorded, Slope, Structure, TauSlope, Term, Trim, Values};
pub use modes::{Mode, ModeErrors, Modes, ModesError};
pub use trim::TrimError;
