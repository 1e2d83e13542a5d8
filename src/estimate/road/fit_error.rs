//! Why nothing was estimated.

use crate::estimate::changes::ChangeError;
use crate::estimate::problem::ProblemError;
use crate::estimate::strategy::strategy_error::StrategyError;
use crate::record::Run;
use crate::simulate::Unsuited;
use std::fmt;

/// Why nothing was estimated: every reason that was found.
#[derive(Debug, Clone, PartialEq)]
pub enum FitError {
    /// Changes that cannot be made.
    Changes(Vec<ChangeError>),
    /// A run that cannot be simulated with exact derivatives.
    Unsuited {
        /// Name of the run.
        run: String,
        /// Why.
        reason: Unsuited,
    },
    /// A problem that cannot be solved.
    Problem(Vec<ProblemError>),
    /// A strategy that was asked for and cannot be followed.
    Strategy(StrategyError),
}

impl FitError {
    pub(in crate::estimate) fn unsuited(run: &Run, reason: Unsuited) -> Self {
        Self::Unsuited { run: run.name.clone(), reason }
    }
}

impl fmt::Display for FitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = |reasons: Vec<String>| reasons.join("\n");
        match self {
            Self::Changes(e) => write!(f, "{}", lines(e.iter().map(ToString::to_string).collect())),
            Self::Unsuited { run, reason } => write!(f, "run `{run}`: {reason}"),
            Self::Problem(e) => write!(f, "{}", lines(e.iter().map(ToString::to_string).collect())),
            Self::Strategy(e) => write!(f, "{e}"),
        }
    }
}

impl std::error::Error for FitError {}
