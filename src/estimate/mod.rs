//! Estimation: the parameters with which a model matches measured runs best, and how well they are known.
//!
//! **In** a [`Problem`]: parameters, runs with their [`Response`] and measurement. **Out** an [`Estimate`]: values,
//! standard errors, noise covariance, residuals, and how the iteration ended. **Never** simulates by itself, reads
//! files or prints. **Start** at [`fit()`], the road from a model and its runs, and [`estimate()`]; its road is in `solve.rs`:
//!
//! `evaluation` (all runs) -> `information` (sums over samples) -> `noise` (weights, cost) -> `quadratic` (all unknowns)
//! -> `step` (within bounds) -> `trial` (accept or damp) -> `correction` (converged?) -> `conclusion` -> `statistics` ->
//! `estimate`.

mod bend;
#[cfg(test)]
mod certified;
mod changes;
mod conclusion;
mod correction;
mod derived;
mod direction;
#[expect(clippy::module_inception, reason = "the result is called what the room makes")]
mod estimate;
mod evaluation;
mod fit;
mod information;
mod initial;
mod keeper;
mod noise;
mod output_fit;
mod problem;
mod products;
mod progress;
mod quadratic;
mod solve;
#[cfg(test)]
mod specimen;
mod statistics;
mod step;
mod termination;
#[cfg(test)]
mod tests;
mod trial;
mod triangle;
mod unknowns;

pub use changes::{ChangeError, Changes};
pub use derived::{DerivedName, DerivedQuantities};
pub use direction::Direction;
pub use estimate::{Estimate, ParameterEstimate, RunFit, Status, Symmetric};
pub use fit::{Fit, FitError, FitOptions, fit};
pub use initial::initial_guess;
pub use keeper::Keeper;
pub use noise::Noise;
pub use output_fit::OutputFit;
pub use problem::{Options, Problem, ProblemError, ProblemRun, Response};
pub use progress::{Iteration, Observer};
pub use solve::estimate;
pub use termination::{Reason, Termination};
