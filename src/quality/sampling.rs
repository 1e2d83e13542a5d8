//! Why residuals cannot be tested, the even grid that tests want among it.

pub(crate) use crate::record::even_grid::EvenGrid as Sampling;
use crate::record::even_grid::NotEven;
use serde::Serialize;
use std::fmt;

/// Why residuals could not be tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Untested {
    /// Samples are not at equal intervals (even with gaps), so that there are no common lags.
    UnevenSampling,
    /// Too few samples are compared.
    TooFewSamples,
    /// The residuals do not vary.
    NoResidual,
}

impl fmt::Display for Untested {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::UnevenSampling => "the samples are not at equal intervals",
            Self::TooFewSamples => "too few samples are compared",
            Self::NoResidual => "the residuals do not vary",
        })
    }
}

impl From<NotEven> for Untested {
    fn from(reason: NotEven) -> Self {
        match reason {
            NotEven::Uneven => Self::UnevenSampling,
            NotEven::TooFew => Self::TooFewSamples,
        }
    }
}
