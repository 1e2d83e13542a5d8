//! Estimation: the parameters with which a model matches measured runs best, and how well they are known.
//!
//! **In** a [`Problem`]: parameters, runs with their [`Response`] and measurement. **Out** an [`Estimate`]: values,
//! standard errors, noise covariance, residuals, and how the iteration ended. **Never** simulates by itself, reads
//! files or prints. **Start** at [`fit()`], the road from a model and its runs, and [`estimate()`]; its road is in `solve.rs`:
//!
//! `evaluation` (all runs) -> `information` (sums over samples) -> `noise` (weights, cost) -> `quadratic` (all unknowns)
//! -> `step` (within bounds) -> `trial` (accept or damp) -> `correction` (converged?) -> `conclusion` -> `coloured`
//! (errors under coloured noise) -> `statistics` -> `estimate`.
//!
//! Seven sub-rooms: `iteration` (values to the minimum), `errors` (what is known there), `road` (start values to a fit, one
//! start or many), `strategy` (other ways when the plain one goes astray, and confidence), `spectral` (spectra instead of samples in time),
//! `responses` (frequency responses from sweeps) and `filter` (filter error: noise that enters the equations).

mod changes;
mod errors;
#[expect(clippy::module_inception, reason = "the result is called what the room makes")]
mod estimate;
mod filter;
mod information;
mod initial;
mod iteration;
mod keeper;
mod noise;
mod problem;
mod progress;
mod recursive;
mod responses;
mod road;
mod solve;
#[cfg(test)]
mod specimen;
mod spectral;
mod strategy;
mod termination;
#[cfg(test)]
mod tests;
mod unknowns;

pub use crate::quality::OutputFit;
pub use changes::{ChangeError, Changes};
pub use errors::derived::{DerivedName, DerivedQuantities};
pub use errors::direction::Direction;
pub use errors::noise_colour::{NoiseColour, Uncorrected};
pub use estimate::{Drawn, Estimate, ParameterEstimate, RunFit, Status, Symmetric, quantile};
pub use filter::{FilterError, FilterFit, fit_filter};
pub use information::{Information, Silence};
pub use initial::initial_guess;
pub use iteration::normal::{NormalEquations, NotFinite};
pub use iteration::restart::Aid;
pub use iteration::search::Method;
pub use keeper::Keeper;
pub use noise::Noise;
pub use problem::{Coefficients, KnownNoise, Options, Problem, ProblemError, ProblemRun, Response};
pub use progress::{Iteration, Observer, UnknownName};
pub use recursive::{BestIterate, BestOptions, Criterion, best_iterate};
pub use responses::{PairFit, ResponseError, ResponseFit, ResponseOptions, Sensitivity, fit_responses};
pub use road::attempt::attempt;
pub use road::fit::{Fit, FitOptions, changed, examined, fit, fit_kept};
pub use road::fit_error::FitError;
pub use road::footing::Footing;
pub use road::start::starts;
pub use road::starts::{MultiStart, StartSummary};
pub use solve::{estimate, estimate_from};
pub use spectral::{
    FirstValue, HiddenMode, LineResponse, Nonlinear, RunSpectrum, SpectralError, SpectralFit, SpectralLines,
    SpectralOptions, Unanswered, fit_spectra,
};
pub use strategy::continuation::Continuation;
pub use strategy::lengths::LengthFit;
pub use strategy::rescue::{Remedy, Rescue};
pub use strategy::reweighting::{Reweighting, Variation, Weight};
pub use strategy::settling::{Settling, by_confidence};
pub use strategy::shooting::{Continuity, Shooting};
pub use strategy::strategy_error::StrategyError;
pub use strategy::trouble::Trouble;
pub use termination::{Reason, Termination};
