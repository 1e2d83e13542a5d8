//! The one entry for every method and domain: output error in time or on spectra, filter error, equation error, frequency
//! responses.

use crate::estimation::estimate::Estimate;
use crate::methods::combinations::ignored;
use crate::methods::equation_error::{self, Regression, RegressionError, RegressionOptions, regress};
use crate::methods::filter_error::{FilterError, FilterFit, fit_filter};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::FitOptions;
use crate::methods::output_error::single::changed;
use crate::methods::responses::{ResponseError, ResponseFit, fit_responses};
use crate::methods::spectra::{SpectralError, SpectralFit, fit_spectra};
use crate::methods::time_domain::fit;
use crate::problem::method::{Domain, Method};
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
    EquationError(Box<Regression>),
}

impl Identified {
    /// The estimate, but for equation error, which has a table of its own.
    pub fn estimate(&self) -> Option<&Estimate> {
        match self {
            Self::OutputError(fit) => Some(&fit.estimate),
            Self::Spectra(fit) => Some(&fit.estimate),
            Self::FilterError(found) => Some(&found.fit.estimate),
            Self::FrequencyResponse(fit) => Some(&fit.estimate),
            Self::EquationError(_) => None,
        }
    }

    /// The model with the changes that were asked for; none of equation error.
    pub fn model(&self) -> Option<&Model> {
        match self {
            Self::OutputError(fit) => Some(&fit.model),
            Self::Spectra(fit) => Some(&fit.model),
            Self::FilterError(found) => Some(&found.fit.model),
            Self::FrequencyResponse(fit) => Some(&fit.model),
            Self::EquationError(_) => None,
        }
    }

    /// Whether the iteration converged and the data determine every free parameter; a regression always does.
    pub fn is_good(&self) -> bool {
        match self {
            Self::Spectra(fit) => fit.is_good(),
            Self::FrequencyResponse(fit) => fit.is_good(),
            other => other.estimate().is_none_or(Estimate::is_good),
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
            let domain = match domain {
                Domain::Time => equation_error::Domain::Time,
                Domain::Frequency => equation_error::Domain::Frequency(options.frequency.frequencies.clone()),
            };
            let how = RegressionOptions { domain, ..options.regression.clone() };
            Ok(Identified::EquationError(Box::new(regress(&model, runs, &how)?)))
        }
        _ => Err(IdentifyError::Domain { method, domain }),
    }
}
