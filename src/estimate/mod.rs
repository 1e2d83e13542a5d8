//! Estimation: the parameters with which a model matches measured runs best, and how well they are known.
//!
//! **In** a [`Problem`]: parameters, runs with their [`Response`] and measurement. **Out** an [`Estimate`]: values,
//! standard errors, noise covariance, residuals, and how the iteration ended. **Never** simulates by itself, reads
//! files or prints. **Start** at [`fit()`], the road from a model and its runs, and [`estimate()`]; its road is in `solve.rs`:
//!
//! `evaluation` (all runs) -> `information` (sums over samples) -> `noise` (weights, cost) -> `quadratic` (all unknowns)
//! -> `step` (within bounds) -> `trial` (accept or damp) -> `correction` (converged?) -> `conclusion` -> `coloured`
//! (errors under coloured noise) -> `statistics` -> `estimate`.

mod attempt;
#[cfg(test)]
mod belief;
mod bend;
#[cfg(test)]
mod certified;
mod changes;
mod coloured;
mod coloured_rows;
#[cfg(test)]
mod coloured_tests;
mod conclusion;
mod continuation;
mod correction;
mod derived;
mod direction;
#[expect(clippy::module_inception, reason = "the result is called what the room makes")]
mod estimate;
mod evaluation;
mod fit;
mod fit_error;
mod information;
mod initial;
mod keeper;
mod lengths;
mod noise;
mod noise_colour;
mod plain;
mod priors;
mod problem;
mod progress;
mod quadratic;
mod rescue;
#[cfg(test)]
mod resumption;
mod reweighting;
mod segments;
mod settling;
mod shooting;
mod snapshot;
mod solve;
#[cfg(test)]
mod specimen;
mod start;
mod statistics;
mod step;
mod strategy_error;
mod substitution;
mod termination;
#[cfg(test)]
mod tests;
mod trial;
mod triangle;
mod trouble;
mod uncut;
mod unknowns;

pub use crate::quality::OutputFit;
pub use attempt::attempt;
pub use changes::{ChangeError, Changes};
pub use continuation::Continuation;
pub use derived::{DerivedName, DerivedQuantities};
pub use direction::Direction;
pub use estimate::{Estimate, ParameterEstimate, RunFit, Status, Symmetric};
pub use fit::{Fit, FitOptions, changed, examined, fit};
pub use fit_error::FitError;
pub use initial::initial_guess;
pub use keeper::Keeper;
pub use lengths::LengthFit;
pub use noise::Noise;
pub use noise_colour::{NoiseColour, Uncorrected};
pub use problem::{Options, Problem, ProblemError, ProblemRun, Response};
pub use progress::{Iteration, Observer};
pub use rescue::{Remedy, Rescue};
pub use reweighting::{Reweighting, Variation, Weight};
pub use settling::{Settling, by_confidence};
pub use shooting::{Continuity, Shooting};
pub use solve::{estimate, estimate_from};
pub use start::starts;
pub use strategy_error::StrategyError;
pub use termination::{Reason, Termination};
pub use trouble::Trouble;
