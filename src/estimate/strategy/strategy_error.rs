//! Why a strategy that was asked for cannot be followed.

use std::fmt;

/// Why a strategy that was asked for cannot be followed.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "the message below each variant says what its fields are")]
pub enum StrategyError {
    UnknownState { name: String, nearest: Option<String> },
    NothingMeasured,
    NotMeasured { reason: String },
    NotASegmentLength { length: f64 },
    NoStates,
    Delays,
    TooManySegments { cells: usize, most: usize },
}

impl fmt::Display for StrategyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownState { name, nearest: Some(hint) } => {
                write!(f, "the model has no state `{name}` to substitute; did you mean `{hint}`?")
            }
            Self::UnknownState { name, nearest: None } => write!(f, "the model has no state `{name}` to substitute"),
            Self::NothingMeasured => write!(f, "no output shows a state: there is no record to substitute for one"),
            Self::NotMeasured { reason } => write!(f, "{reason}"),
            Self::NotASegmentLength { length } => {
                write!(f, "segments of length {length} are not possible; a length is a number above 0")
            }
            Self::NoStates => write!(f, "the model has no states, so that there is nothing to shoot from"),
            Self::Delays => write!(
                f,
                "multiple shooting is not possible with delays: a segment would begin with a past that it does not know; \
                 lengthen the record instead (--continuation)"
            ),
            Self::TooManySegments { cells, most } => write!(
                f,
                "so many segments want a table of {cells} sensitivities, more than {most}; take fewer or longer ones"
            ),
        }
    }
}

impl std::error::Error for StrategyError {}
