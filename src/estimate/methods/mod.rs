//! The methods of estimation, each with its options, fit and error, and the one door to all of them.
//!
//! **In** a model, runs, options. **Out** what the method finds. **Start** at [`identify()`](crate::identify()); which options have a part in which method is
//! said in `combinations`.
//!
//! Which options have a part in which method: what the library ignores it refuses, in the words of the command.
//!
//! The one entry for every method and domain: output error in time or on spectra, filter error, equation error, frequency
//! responses.

use crate::estimation::Estimate;
use crate::problem::Options;
use crate::problem::method::{Domain, Method, Optimizer, SmoothBy};
use crate::problem::noise::Noise;
use crate::work::Work;
use equation_error::{Regression, RegressionError, regress};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Scheme;
use filter_error::{FilterError, FilterFit, fit_filter};
use output_error::error::{FitError, StrategyError};
use output_error::fit::Fit;
use output_error::options::{Continuation, FitOptions, FrequencyOptions};
use output_error::single::changed;
use responses::{ResponseError, ResponseFit, fit_responses};
use spectra::{SpectralError, SpectralFit, fit_spectra};
use time_domain::fit;

pub mod equation_error;
pub(crate) mod filter_error;
pub(crate) mod output_error;
pub(crate) mod responses;
pub(crate) mod spectra;
pub(crate) mod time_domain;

/// Methods in the domains where they work, the usual ones first.
pub const METHODS: [(Method, Domain); 6] = [
    (Method::OutputError, Domain::Time),
    (Method::OutputError, Domain::Frequency),
    (Method::FilterError, Domain::Time),
    (Method::EquationError, Domain::Time),
    (Method::EquationError, Domain::Frequency),
    (Method::FrequencyResponse, Domain::Frequency),
];

const Y: bool = true;
const N: bool = false;

/// An option as the command spells it, the columns in which it has a part, and whether it was given: is other than usual.
type Row = (&'static str, [bool; 6], fn(&FitOptions) -> bool);

/// Output error in time and frequency, filter error, equation error in time and frequency, frequency responses.
const OPTIONS: [Row; 25] = [
    ("--optimizer gauss-newton", [Y, Y, Y, Y, Y, Y], |_| false),
    ("--optimizer nelder-mead", [Y, Y, N, N, N, Y], |o| o.options.optimizer == Optimizer::NelderMead),
    ("--optimizer lbfgs", [Y, Y, N, N, N, Y], |o| o.options.optimizer == Optimizer::Lbfgs),
    ("--loss", [Y, N, N, N, N, N], |o| !o.loss.is_squares()),
    ("--iterations", [Y, Y, Y, N, N, Y], |o| o.options.total.is_some()),
    ("--tolerance", [Y, Y, N, N, N, Y], |o| o.options.tolerance != Options::default().tolerance),
    ("--gain", [Y, Y, N, N, N, Y], |o| o.options.gain != Options::default().gain),
    ("--smooth-by", [Y, Y, N, N, N, N], |o| o.options.smooth_by != SmoothBy::default()),
    ("--starts", [Y, N, N, N, N, N], |o| o.starts.count > 1),
    ("--continuation", [Y, N, N, N, N, N], |o| {
        matches!(o.continuation, Continuation::Shares(_) | Continuation::Times(_))
    }),
    ("--substitute", [Y, N, N, N, N, N], |o| !o.substitute.is_empty()),
    ("--shooting", [Y, N, N, N, N, N], |o| o.shooting.is_some()),
    ("--confidence", [Y, N, N, N, N, N], |o| o.confidence),
    ("--weights", [Y, N, N, N, N, N], |o| o.reweight),
    ("--steps", [Y, N, Y, N, N, N], |o| o.per_interval.is_some()),
    ("--integration-accuracy", [Y, N, N, N, N, N], |o| o.accuracy.is_some()),
    ("--integrator runge-kutta", [Y, N, Y, N, N, N], |o| o.scheme == Some(Scheme::RungeKutta)),
    ("--integrator radau", [Y, N, N, N, N, N], |o| o.scheme == Some(Scheme::Radau)),
    ("--band", [N, Y, N, N, Y, Y], |o| o.frequency.frequencies != FrequencyOptions::default().frequencies),
    ("--end-points", [N, Y, N, N, N, N], |o| o.frequency.ends != FrequencyOptions::default().ends),
    ("--nonlinear", [N, Y, N, N, N, N], |o| o.frequency.nonlinear != FrequencyOptions::default().nonlinear),
    ("--input-noise", [N, Y, N, N, N, N], |o| !o.frequency.input_noise.is_empty()),
    ("--segments", [N, N, N, N, N, Y], |o| !o.frequency.segments.is_empty()),
    ("--pair", [N, N, N, N, N, Y], |o| !o.frequency.pairs.is_empty()),
    ("--coherence", [N, N, N, N, N, Y], |o| o.frequency.coherence != FrequencyOptions::default().coherence),
];

/// Whether an option, as the command spells it, has a part in a method on data of a domain; none of options that no method has, and where the
/// method does not work there.
pub fn takes_option(option: &str, method: Method, domain: Domain) -> Option<bool> {
    let column = METHODS.iter().position(|own| *own == (method, domain))?;
    OPTIONS.iter().find(|(name, ..)| *name == option).map(|(_, columns, _)| columns[column])
}

/// The options that [`takes_option`] knows, as the command spells them.
pub fn option_names() -> impl Iterator<Item = &'static str> {
    OPTIONS.iter().map(|(name, ..)| *name)
}

/// The first option that was given and would be ignored.
pub(crate) fn ignored(options: &FitOptions, method: Method, domain: Domain) -> Option<StrategyError> {
    if !options.censored.is_empty() && (method, domain) != METHODS[0] {
        return Some(StrategyError::Censored { method, domain });
    }
    let column = METHODS.iter().position(|own| *own == (method, domain))?;
    let (option, ..) = OPTIONS.iter().find(|(_, columns, given)| !columns[column] && given(options))?;
    Some(StrategyError::OptionOfMethod { option, method, domain })
}

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

#[cfg(test)]
mod combinations_tests {
    use super::*;
    use crate::methods::output_error::options::{MultiStart, Shooting};

    #[test]
    fn what_would_be_ignored_is_named() {
        let filter = |options: FitOptions| ignored(&options, Method::FilterError, Domain::Time);
        assert_eq!(filter(FitOptions::default()), None);
        assert_eq!(filter(FitOptions { continuation: Continuation::Never, bare: true, ..FitOptions::default() }), None);
        let starts = MultiStart { count: 4, ..MultiStart::default() };
        let gain = Options { gain: 0.5, ..Options::default() };
        for (options, name) in [
            (FitOptions { starts, ..FitOptions::default() }, "--starts"),
            (FitOptions { options: gain, ..FitOptions::default() }, "--gain"),
            (FitOptions { shooting: Some(Shooting::Segments(3)), ..FitOptions::default() }, "--shooting"),
            (FitOptions { accuracy: Some(1e-6), ..FitOptions::default() }, "--integration-accuracy"),
        ] {
            let said = filter(options.clone()).expect("ignored").to_string();
            assert!(said.starts_with(name) && said.contains("filter error"), "{said}");
            assert_eq!(ignored(&options, Method::OutputError, Domain::Time), None, "{name}");
        }
    }
}
