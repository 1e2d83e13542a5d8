//! Why a filter cannot be run over a model.

use crate::methods::output_error::error::FitError;
use std::fmt;

/// Why nothing was estimated.
#[derive(Debug, Clone, PartialEq)]
pub enum FilterError {
    /// As for any fit.
    Fit(FitError),
    /// No equation carries noise: the filter would never correct a state.
    NoProcessNoise,
    /// The past of a state would have to be part of what is filtered.
    DelayedState {
        /// Name of the state.
        state: String,
    },
    /// The covariance of the measurement noise is diagonal.
    FullNoise,
    /// The smoothness of tables is chosen by output error alone.
    SmoothTable {
        /// Name of the table.
        table: String,
    },
    /// A filter knows of no states that stop.
    Limit {
        /// Name of the state.
        state: String,
    },
    /// A filter knows of no events.
    Events,
    /// An intensity moves by parts of itself, and 0 has none.
    StartsAtZero {
        /// Name of the parameter.
        parameter: String,
    },
}

impl fmt::Display for FilterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fit(e) => write!(f, "{e}"),
            Self::NoProcessNoise => write!(
                f,
                "the model says nowhere that noise enters its equations: `param q = 0.1; noise der(x) = q;` lets white noise of intensity q \
                 into the equation of x and estimates q; without such noise `--method output-error` is the right one"
            ),
            Self::DelayedState { state } => write!(
                f,
                "the state `{state}` is delayed: its past would have to be filtered too; delay the measurement in the record, or \
                 put `measured(.)` in its place (delayed inputs are no obstacle)"
            ),
            Self::FullNoise => write!(
                f,
                "--noise full has no part in the filter-error method: the noise of the outputs is independent there, and what they have \
                 in common is noise of the equations"
            ),
            Self::SmoothTable { table } => write!(
                f,
                "`smooth {table}` has no part in the filter-error method; fit it with `--method output-error`, fix its nodes at what was found, \
                 and leave the statement out"
            ),
            Self::Limit { state } => write!(
                f,
                "the state `{state}` has a limit, which the filter-error method does not know; fit with `--method output-error`, or \
                 write `limit {state} in [...] smooth ...;`"
            ),
            Self::Events => f.write_str(
                "the model has events (`when`), which the filter-error method does not know; fit with `--method output-error`",
            ),
            Self::StartsAtZero { parameter } => write!(
                f,
                "`{parameter}` is the intensity of a noise and starts at 0, from where no way leads up; start it above 0 \
                 (`--set {parameter}=...`), or fix it"
            ),
        }
    }
}

impl std::error::Error for FilterError {}

impl From<FitError> for FilterError {
    fn from(error: FitError) -> Self {
        Self::Fit(error)
    }
}
