//! The one entry for every method and domain: output error in time or on spectra, filter error, equation error, frequency
//! responses.

use crate::estimation::estimate::Estimate;
use crate::methods::combinations::ignored;
use crate::methods::equation_error::{Regression, RegressionError, regress};
use crate::methods::filter_error::{FilterError, FilterFit, fit_filter};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::FitOptions;
use crate::methods::output_error::single::changed;
use crate::methods::responses::{ResponseError, ResponseFit, fit_responses};
use crate::methods::spectra::{SpectralError, SpectralFit, fit_spectra};
use crate::methods::time_domain::fit;
use crate::problem::method::{Domain, Method};
use crate::problem::noise::Noise;
use crate::work::Work;
use fdm_system::model::Model;
use fdm_system::record::Run;

/// What a method finds.
#[derive(Debug, Clone)]
pub enum Identified {
    /// Output error in the time domain.
    OutputError(Box<Fit>),
    /// Output error on spectra.
    Spectra(Box<SpectralFit>),
    /// Filter error.
    FilterError(Box<FilterFit>),
    /// Frequency responses.
    FrequencyResponse(Box<ResponseFit>),
    /// Equation error, in either domain.
    EquationError {
        /// The model with the changes that were asked for.
        model: Box<Model>,
        /// What was found.
        regression: Box<Regression>,
    },
}

impl Identified {
    /// The estimate, but for equation error, which has a table of its own.
    pub fn estimate(&self) -> Option<&Estimate> {
        match self {
            Self::OutputError(fit) => Some(&fit.estimate),
            Self::Spectra(fit) => Some(&fit.estimate),
            Self::FilterError(found) => Some(&found.fit.estimate),
            Self::FrequencyResponse(fit) => Some(&fit.estimate),
            Self::EquationError { .. } => None,
        }
    }

    /// The model with the changes that were asked for.
    pub fn model(&self) -> &Model {
        match self {
            Self::OutputError(fit) => &fit.model,
            Self::Spectra(fit) => &fit.model,
            Self::FilterError(found) => &found.fit.model,
            Self::FrequencyResponse(fit) => &fit.model,
            Self::EquationError { model, .. } => model,
        }
    }

    /// The fit in the time domain, whose residuals are those of a simulation; results of the frequency domain are simulated where that is
    /// possible.
    pub fn in_time(&self) -> Option<&Fit> {
        match self {
            Self::OutputError(fit) => Some(fit),
            Self::FilterError(found) => Some(&found.fit),
            Self::Spectra(fit) => fit.finish.as_ref(),
            Self::FrequencyResponse(fit) => fit.finish.as_ref(),
            Self::EquationError { .. } => None,
        }
    }

    /// Whether all of so many starts have ended.
    pub fn is_complete(&self, starts: usize) -> bool {
        !matches!(self, Self::OutputError(fit) if !fit.starts.is_empty() && fit.starts.len() != starts)
    }

    /// Whether the iteration converged, the data determine every free parameter, and the integration does not falsify them; of equation
    /// error whether any parameter is determined.
    pub fn is_good(&self) -> bool {
        match self {
            Self::OutputError(fit) => fit.is_good(),
            Self::FilterError(found) => found.fit.is_good(),
            Self::Spectra(fit) => fit.is_good(),
            Self::FrequencyResponse(fit) => fit.is_good(),
            Self::EquationError { regression, .. } => !regression.is_undetermined(),
        }
    }

    /// What a good result predicts of runs that were not fitted, where `noise` is measurement noise in the time domain; none of a result that
    /// is not good, and of equation error.
    ///
    /// # Errors
    /// [`FitError`]
    pub fn predict(&self, runs: &[Run], noise: Noise, work: &Work<'_>) -> Result<Option<Fit>, FitError> {
        let converged = self.estimate().is_some_and(|e| e.termination.is_good());
        match self {
            Self::OutputError(fit) if converged => fit.predict(runs, noise, work).map(Some),
            Self::FilterError(found) if converged => found.fit.predict(runs, noise, work).map(Some),
            Self::Spectra(fit) if converged => fit.predict(runs, work).map(Some),
            Self::FrequencyResponse(fit) if fit.is_good() => fit.predict(runs, work).map(Some),
            _ => Ok(None),
        }
    }
}

/// Why nothing was identified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "each variant is the error of its method")]
pub enum IdentifyError {
    #[error(transparent)]
    Fit(#[from] FitError),
    #[error(transparent)]
    Filter(#[from] FilterError),
    #[error(transparent)]
    Regression(#[from] RegressionError),
    #[error(transparent)]
    Spectra(#[from] SpectralError),
    #[error(transparent)]
    Responses(#[from] ResponseError),
    /// A method that does not work on data of this domain.
    #[error("{method} does not work in the {domain} domain")]
    Domain { method: Method, domain: Domain },
}

/// Identifies a model's parameters from runs by the method, domain and optimizer in the options: all that `fdm fit` does, but
/// reading and printing. Output error in the time domain keeps its state where the work does, and goes on from what is there.
///
/// # Errors
/// [`IdentifyError`]; an iteration that ran and went wrong is an [`Estimate`] with its [`Termination`](crate::Termination).
pub fn identify(
    model: &Model,
    runs: &[Run],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Identified, IdentifyError> {
    let FitOptions { method, domain, .. } = *options;
    if let Some(ignored) = ignored(options, method, domain) {
        return Err(IdentifyError::Fit(FitError::Strategy(ignored)));
    }
    match (method, domain) {
        (Method::OutputError, Domain::Time) => Ok(Identified::OutputError(Box::new(fit(model, runs, options, work)?))),
        (Method::OutputError, Domain::Frequency) => {
            Ok(Identified::Spectra(Box::new(fit_spectra(model, runs, &options.of_spectra(), work)?)))
        }
        (Method::FilterError, Domain::Time) => {
            Ok(Identified::FilterError(Box::new(fit_filter(model, runs, options, work)?)))
        }
        (Method::FrequencyResponse, Domain::Frequency) => {
            Ok(Identified::FrequencyResponse(Box::new(fit_responses(model, runs, &options.of_responses(), work)?)))
        }
        (Method::EquationError, _) => {
            let model = changed(model, &options.changes)?;
            let regression = Box::new(regress(&model, runs, &options.of_regression())?);
            Ok(Identified::EquationError { model: Box::new(model), regression })
        }
        _ => Err(IdentifyError::Domain { method, domain }),
    }
}
