//! Estimation: the parameters with which a model matches measured runs best, and how well they are known.
//!
//! **In** a model and runs, or a [`Problem`]: parameters, runs with their [`Response`] and measurement. **Out** an [`Estimate`]:
//! values, standard errors, noise covariance, residuals, and how the iteration ended. **Never** reads files or prints.
//! **Start** at [`identify()`], one entry for every method and domain; [`fit()`] is output error in the time domain.
//!
//! The road of a fit: problem data (`problem`, `unknowns`, `noise`) -> `iteration` (residuals and sensitivities as a cost
//! for the bounded Gauss-Newton of `fdm_numeric`) -> `uncertainty` (errors, what is not determined) -> `solve` (a
//! problem's [`Estimate`]) -> `output_error` (one fit from given start values), `filter_error`, `equation_error`,
//! `spectra`, `frequency_responses` -> `recovery` (continuation, substitution, shooting, many starts) -> `time_domain` ->
//! `identify`. These are no layers: options and results of the methods are known to each other, so that folders import in
//! both directions.

mod affine;
mod beginnings;
mod best_iterate;
mod changes;
mod combinations;
mod degenerate;
mod derived;
mod doubted_initials;
pub mod equation_error;
mod estimate;
mod few_samples;
mod filter_error;
mod frequency_responses;
mod held;
mod hidden_states;
mod identify;
mod information;
mod initial;
mod input_interpolation;
mod interpolation;
mod iteration;
mod lost_unknowns;
mod method;
mod noise;
mod observer;
mod output_error;
mod problem;
mod recovery;
mod residual_vector;
pub mod residuals;
mod smoothness;
mod solve;
#[cfg(test)]
mod specimen;
mod spectra;
mod stated_initials;
mod table_nodes;
mod termination;
#[cfg(test)]
mod tests;
mod time_domain;
mod uncertainty;
mod unknowns;

pub use crate::residuals::OutputFit;
pub use crate::residuals::autoregression::{AutoRegression, LevinsonDurbin};
pub use beginnings::{fit_from_beginnings, initial_values};
pub use best_iterate::{BestIterate, BestOptions, Criterion, best_iterate};
pub use changes::{ChangeError, Changes};
pub use combinations::{COLUMNS, option_names, takes_option};
pub use degenerate::Degeneracy;
pub use derived::{DerivedName, DerivedQuantities};
pub use estimate::{BiasCorrection, Estimate, ParameterEstimate, RunFit, Smoothing, Status, Symmetric};
pub use fdm_numeric::least_squares::Fallback;
pub use few_samples::FewSamples;
pub use filter_error::{FilterError, FilterFit, fit_filter};
pub use frequency_responses::{
    PairFit, ResponseError, ResponseFit, ResponseOptions, Sensitivity, fit_responses, responses_of_fit,
};
pub use identify::{Identified, IdentifyError, identify};
pub use information::{Information, Silence};
pub use initial::initial_guess;
pub use input_interpolation::{EstimateMove, InputInterpolation};
pub use iteration::normal_equations::{NormalEquations, NotFinite};
pub use method::{Domain, Method, Optimizer, SmoothBy, StartValues};
pub use noise::Noise;
pub use observer::{CheckpointStore, Iteration, Observer, StartSummary, Stop, UnknownName};
pub use output_error::defect::FitDefect;
pub use output_error::error::{FitError, StrategyError};
pub use output_error::fit::{
    Continuity, Fit, LengthFit, NoiseOfSamples, Recovery, RecoveryStrategy, Reweighting, Variation, Weight,
};
pub use output_error::integration_fault::IntegrationFault;
pub use output_error::loss::Loss;
pub use output_error::options::{Continuation, FitOptions, FrequencyOptions, MultiStart, SharedSteps, Shooting};
pub use output_error::single::{changed, starts};
pub use problem::{Coefficients, KnownNoise, Options, Problem, ProblemError, ProblemRun, Response};
pub use recovery::confidence::{LengthSensitivity, by_confidence};
pub use recovery::free_response::is_lost_at_start;
pub use recovery::multi_start::StartSearch;
pub use residual_vector::ResidualVector;

pub use doubted_initials::{DoubtedInitial, DoubtedInitials, MovedParameter};
pub use solve::{estimate, estimate_from};
pub use spectra::{
    BinResponse, Nonlinear, RunSpectrum, SpectralBins, SpectralError, SpectralFit, SpectralOptions, StartingValue,
    Unanswered, UnobservableMode, fit_spectra,
};
pub use table_nodes::{NodeEstimate, TableAxis, TableEstimate, Unvisited, unvisited};
pub use termination::{Reason, Termination};
pub use time_domain::{examined, fit, fit_from, fit_kept, start_search};
pub use uncertainty::curvature::Curvature;
pub use uncertainty::identifiability::Direction;
pub use uncertainty::parameters::quantile;
pub use uncertainty::sandwich::{NoiseColour, Uncorrected};
pub use uncertainty::sensitivity_rows::LONG_RUN;
pub use uncertainty::spectral_colour::SpectralColour;
