//! Estimation: the parameters with which a model matches measured runs best, and how well they are known.
//!
//! **In** a model and runs, or a [`Problem`]: parameters, runs with their [`Response`] and measurement. **Out** an [`Estimate`]:
//! values, standard errors, noise covariance, residuals, and how the iteration ended. **Never** reads files or prints.
//! **Start** at [`identify()`], one entry for every method and domain; [`fit()`] is output error in the time domain.
//!
//! The road of a fit: `problem` (data, unknowns, noise, responses) -> `work` (when it ends, who follows it, where its state is kept) ->
//! `iteration` (residuals and sensitivities as a cost for the bounded Gauss-Newton of `fdm_numeric`) -> `uncertainty` (errors, what
//! is not determined) -> `estimation` (a problem's [`Estimate`]) -> `methods` (output error, filter error, equation error, spectra,
//! frequency responses). Folders import from those before them alone; `residuals`, which know nothing of models, stand first. Three
//! know each other: a fit by output error (`methods`) may need `recovery` (continuation, substitution, shooting, many starts) and is
//! `examined` (what it says of itself).

mod estimation;
mod examined;
mod iteration;
pub mod methods;
mod problem;
mod recovery;
pub mod residuals;
#[cfg(test)]
mod specimen;
#[cfg(test)]
mod tests;
mod uncertainty;
mod work;

pub use crate::estimation::{BiasCorrection, Estimate, ParameterEstimate, RunFit, Smoothing, Status, Symmetric};
pub use crate::examined::unexplained::FewSamples;
pub use crate::iteration::evaluation::{NormalEquations, NotFinite};
pub use crate::methods::output_error::error::FitDefect;
pub use crate::methods::output_error::fit::IntegrationFault;
pub use crate::methods::output_error::options::Attempt;
pub use crate::methods::{Identified, IdentifyError, METHODS, equation_error, identify, option_names, takes_option};
pub use crate::problem::noise::Degeneracy;
pub use crate::problem::unknowns::{ChangeError, Changes, DerivedName, DerivedQuantities};
pub use crate::recovery::segmented_response::is_lost_at_start;
pub use crate::residuals::OutputFit;
pub use crate::residuals::autoregression::{AutoRegression, LevinsonDurbin};
pub use examined::input_interpolation::{EstimateMove, InputInterpolation};
pub use fdm_numeric::halt::{Halt, Stop};
pub use fdm_numeric::least_squares::{Fallback, Iteration};
pub use methods::equation_error::best_iterate::{BestIterate, BestOptions, Criterion, best_iterate};
pub use methods::filter_error::{FilterError, FilterFit, fit_filter};
pub use methods::output_error::error::{FitError, StrategyError};
pub use methods::output_error::fit::{
    Continuity, Fit, LengthFit, NoiseOfSamples, Recovery, RecoveryStrategy, Reweighting, Variation, Weight,
};
pub use methods::output_error::initial_conditions::{fit_from_initial_conditions, initial_values};
pub use methods::output_error::loss::Loss;
pub use methods::output_error::options::{
    Continuation, FitOptions, FrequencyOptions, MultiStart, SharedSteps, Shooting,
};
pub use methods::output_error::residual_vector::ResidualVector;
pub use methods::output_error::single::{changed, starts};
pub use methods::responses::{
    PairFit, ResponseError, ResponseFit, ResponseOptions, Sensitivity, fit_responses, responses_of_fit,
};
pub use problem::initial::initial_guess;
pub use problem::method::{Domain, Method, Optimizer, SmoothBy, StartValues};
pub use problem::noise::Noise;
pub use problem::response::{
    CoefficientResponse, Coefficients, KnownNoise, KnownNoiseResponse, PlanarResponse, Response, RunResponse,
    StandardisedResponse, TimeResponse,
};
pub use problem::{Options, Problem, ProblemError, ProblemRun};
pub use recovery::confidence::{LengthSensitivity, by_confidence};
pub use recovery::multi_start::StartSearch;
pub use uncertainty::information::{Information, NoInformation, SampleInformation};

pub use crate::estimation::smoothness::{NodeEstimate, TableAxis, TableEstimate, Unvisited, unvisited};
pub use crate::work::{Reason, Termination};
pub use estimation::solve::{estimate, estimate_from};
pub use examined::doubted_initials::{DoubtedInitial, DoubtedInitials, MovedParameter};
pub use examined::unexplained::Unexplained;
pub use methods::spectra::{
    BinResponse, Nonlinear, RunSpectrum, SpectralBins, SpectralError, SpectralFit, SpectralOptions, StartingValue,
    Unanswered, UnobservableMode, fit_spectra, with_initials,
};
pub use methods::time_domain::{fit, fit_from, start_search};
pub use problem::unknowns::UnknownName;
pub use uncertainty::curvature::Curvature;
pub use uncertainty::identifiability::Direction;
pub use uncertainty::parameters::quantile;
pub use uncertainty::sandwich::{NoiseColour, Uncorrected};
pub use uncertainty::sensitivity_rows::LONG_RUN;
pub use uncertainty::spectral_colour::SpectralColour;
pub use work::{CheckpointStore, Observer, StartSummary, Work};
