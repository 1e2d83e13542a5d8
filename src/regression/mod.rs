//! Equation error: each equation as a linear regression of the measured rate of its state on measured signals.
//!
//! **In** a [`Model`](crate::Model) and its runs. **Out** [`Regression`]: for every group of equations that share parameters an
//! [`EquationErrorFit`] with principal-component solutions; refusals with their reasons; [`stepwise`] searches for a structure.
//! [`recursive`] follows the parameters along the record, with forgetting. **Never** simulates, and never iterates on parameters: what is not linear in them is refused. **Start** at [`regress`]:
//! `equations` (from the text) -> `signals` (rates by `local` or `sine`) -> `rows` (time or frequency) -> `solution`.

mod candidates;
mod coloured;
mod components;
mod dependence;
mod detrend;
mod equations;
mod fit;
mod group;
mod local;
mod options;
mod preprocessing;
mod recursive;
mod refusal;
mod rows;
mod signals;
mod sine;
mod solution;
mod stepwise;
#[cfg(test)]
mod tests;

pub use candidates::{Structure, structure};
pub use components::{Chosen, Component};
pub use dependence::{Dependence, by_cutoff, by_length};
pub use fit::{ChannelNoise, EquationErrorFit, EquationQuality, Regressed, Regression, regress};
pub use options::{Components, Detrend, Domain, RegressionOptions, Smoothing};
pub use preprocessing::Preprocessing;
pub use recursive::{Iterate, Recursion, RecursiveOptions, RecursiveParameter, recursive};
pub use refusal::{Refusal, RegressionError};
pub use stepwise::{Limits, SelectedTerm, Step, Stepwise, stepwise};
