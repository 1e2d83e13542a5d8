//! Why there is nothing to repeat.

use fdm_estimate::FitError;
use std::fmt;

/// Why a fit cannot be repeated.
#[derive(Debug, Clone, PartialEq)]
pub enum StudyError {
    /// It could not begin.
    Fit(FitError),
    /// It did not end at a minimum.
    Astray {
        /// How it ended.
        reason: String,
    },
    /// There is no noise to draw.
    NoNoise,
    /// The colour of the residuals is not known.
    NoColour {
        /// Why.
        reason: String,
    },
    /// Nothing was estimated.
    NothingEstimated,
    /// A parameter has no profile.
    NoProfile {
        /// As typed.
        parameter: String,
        /// Why.
        reason: String,
    },
}

impl StudyError {
    /// Whether numbers went wrong, not what was given.
    pub fn is_of_numbers(&self) -> bool {
        matches!(self, Self::Astray { .. })
    }
}

impl fmt::Display for StudyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fit(e) => e.fmt(f),
            Self::Astray { reason } => {
                write!(f, "the fit itself does not end at a minimum ({reason}); there is nothing to repeat")
            }
            Self::NoNoise => f.write_str(
                "the residuals vanish or leave no degree of freedom, so there is no noise to draw; say what it is with --noise OUTPUT=DEVIATION",
            ),
            Self::NoColour { reason } => {
                write!(f, "the colour of the residuals is not known ({reason}); use --noise-colour white, ar1 or pink")
            }
            Self::NoProfile { parameter, reason } => write!(f, "`{parameter}` has no profile: {reason}"),
            Self::NothingEstimated => f.write_str("no parameter is free; there is nothing to study"),
        }
    }
}

impl std::error::Error for StudyError {}

impl From<FitError> for StudyError {
    fn from(e: FitError) -> Self {
        Self::Fit(e)
    }
}
