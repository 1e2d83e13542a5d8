//! Why a nonlinear term can not be computed from records.

use crate::model::reading::Unsettled;
use std::fmt;

/// A term in the way.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Obstacle {
    /// It holds a state that no output shows.
    Unshown {
        /// The term as it stands in the text.
        term: String,
        /// `der(x)` or the name of an output.
        equation: String,
        /// The state.
        state: String,
        /// The output that would show it if less were to be estimated.
        unsettled: Option<Unsettled>,
    },
    /// It holds a parameter that is to be estimated, in a way that is not a factor.
    Unknown {
        /// The term as it stands in the text.
        term: String,
        /// `der(x)` or the name of an output.
        equation: String,
        /// The parameters.
        parameters: Vec<String>,
    },
    /// It holds signals at different times, and a delay between them is to be estimated.
    Apart {
        /// The term as it stands in the text.
        term: String,
        /// `der(x)` or the name of an output.
        equation: String,
        /// The parameters in the delays.
        parameters: Vec<String>,
    },
}

/// The terms that can not be carried in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NotCarried {
    /// One for each term and reason.
    pub obstacles: Vec<Obstacle>,
}

fn quoted(names: &[String]) -> String {
    names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", ")
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unshown { term, equation, unsettled: Some(unsettled), .. } => write!(
                f,
                "the term `{term}` of `{equation}` is not linear and can not be computed from records: {unsettled}: fix \
                 that, show the state by an output of its own, or linearise the model"
            ),
            Self::Unshown { term, equation, state, unsettled: None } => write!(
                f,
                "the term `{term}` of `{equation}` is not linear and no output shows the state `{state}` in it, so that it \
                 can not be computed from records: measure it (`output {state}_m = {state};`), or linearise the model"
            ),
            Self::Unknown { term, equation, parameters } => write!(
                f,
                "the term `{term}` of `{equation}` is not linear and can not be computed from records while {} \
                 inside it is to be estimated: fix it, or linearise the model",
                quoted(parameters)
            ),
            Self::Apart { term, equation, parameters } => write!(
                f,
                "the term `{term}` of `{equation}` is not linear and takes signals at different times, while the delay by \
                 {} is to be estimated: fix it, or delay the whole term",
                quoted(parameters)
            ),
        }
    }
}

impl fmt::Display for NotCarried {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<String> = self.obstacles.iter().map(ToString::to_string).collect();
        f.write_str(&lines.join("\n"))
    }
}

impl std::error::Error for NotCarried {}
