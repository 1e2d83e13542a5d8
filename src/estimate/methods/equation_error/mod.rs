//! Equation error: each equation as a linear regression of the measured rate of its state on measured signals (Klein and Morelli 2006).
//!
//! **In** a [`Model`](fdm_system::Model) and its runs. **Out** [`Regression`]: for every group of equations that share parameters an
//! [`EquationErrorFit`] with principal-component solutions; refusals with their reasons; [`structure()`] searches for a structure, [`recursive()`] follows the
//! parameters along the record, with forgetting, and a [`RecursiveEstimator`] is what a vehicle needs to do that in flight. Nothing is simulated, and what is not linear in its parameters is refused. **Start** at [`regress`]:
//! `equations` (from the text) -> `regressors` (rates and columns in time or frequency) -> `regression` -> `principal_components`.

pub(crate) mod best_iterate;
mod differentiation;
mod equations;
mod error;
mod estimator;
mod fit;
mod options;
mod preprocessing;
mod principal_components;
mod recursive;
mod regression;
mod regressors;
mod structure;
#[cfg(test)]
mod tests;

pub use error::{Refusal, RegressionError};
pub use estimator::{EstimatorEquation, ParameterGroup, RecursiveConstants, RecursiveEstimator};
pub use fit::{
    Along, ChannelNoise, Course, Dependence, EquationErrorFit, EquationQuality, Regressed, Regression, by_cutoff,
    by_length, regress,
};
pub use options::{Components, Detrend, Domain, RegressionOptions, Smoothing};
pub use preprocessing::Preprocessing;
pub use principal_components::{Chosen, Component};
pub use recursive::{Iterate, RecursiveEstimates, RecursiveOptions, RecursiveParameter, recursive};
pub use structure::{Limits, Search, SelectedTerm, Step, Stepwise, Structure, orthogonal, stepwise, structure};
