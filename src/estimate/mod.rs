//! Estimation: the parameters with which a model matches measured runs best, and how well they are known.
//!
//! **In** a [`Problem`]: parameters, runs with their [`Response`] and measurement. **Out** an [`Estimate`]: values,
//! standard errors, noise covariance, residuals, and how the iteration ended. **Never** simulates by itself, reads
//! files or prints. **Start** at [`fit()`], the road from a model and its runs, and [`estimate()`]; its road is in `solve.rs`:
//!
//! `evaluation` (all runs) -> `information` (sums over samples) -> `noise` (weights, cost) -> `quadratic` (all unknowns)
//! -> `step` (within bounds) -> `trial` (accept or damp) -> `correction` (converged?) -> `conclusion` -> `coloured`
//! (errors under coloured noise) -> `statistics` -> `estimate`.

mod affine;
#[cfg(test)]
mod approach;
mod attempt;
#[cfg(test)]
mod belief;
mod bend;
mod changes;
mod cholesky;
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
mod footing;
mod information;
mod initial;
mod keeper;
mod ledger;
mod lengths;
mod noise;
mod noise_colour;
mod normal;
mod plain;
mod priors;
mod problem;
mod products;
mod progress;
mod projection;
mod quadratic;
mod rescue;
mod restart;
#[cfg(test)]
mod resumption;
mod reweighting;
mod search;
mod secant;
mod segments;
mod settling;
mod shooting;
mod snapshot;
mod solve;
#[cfg(test)]
mod specimen;
mod spread;
mod stages;
mod start;
mod starts;
mod stationarity;
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
pub use fit::{Fit, FitOptions, changed, examined, fit, fit_kept};
pub use fit_error::FitError;
pub use footing::Footing;
pub use initial::initial_guess;
pub use keeper::Keeper;
pub use lengths::LengthFit;
pub use noise::Noise;
pub use noise_colour::{NoiseColour, Uncorrected};
pub use normal::{NormalEquations, NotFinite};
pub use problem::{Options, Problem, ProblemError, ProblemRun, Response};
pub use progress::{Iteration, Observer};
pub use rescue::{Remedy, Rescue};
pub use restart::Aid;
pub use reweighting::{Reweighting, Variation, Weight};
pub use search::Method;
pub use settling::{Settling, by_confidence};
pub use shooting::{Continuity, Shooting};
pub use solve::{estimate, estimate_from};
pub use start::starts;
pub use starts::{MultiStart, StartSummary};
pub use strategy_error::StrategyError;
pub use termination::{Reason, Termination};
pub use trouble::Trouble;
