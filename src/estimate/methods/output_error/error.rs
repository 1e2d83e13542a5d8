//! Why nothing was estimated.

use crate::problem::ProblemError;
use crate::problem::changes::ChangeError;
use crate::problem::method::{Domain, Method};
use fdm_system::record::Run;
use fdm_system::simulate::Unsuited;
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
    /// A standard deviation of an output that is not above zero with the start values.
    Deviation {
        /// The output.
        output: String,
        /// The expression of its deviation.
        expression: String,
        /// Name of the run.
        run: String,
        /// Time of the first such sample.
        time: f64,
        /// What the expression is there.
        value: f64,
    },
    /// A problem that cannot be solved.
    Problem(Vec<ProblemError>),
    /// A strategy that was asked for and cannot be followed.
    Strategy(StrategyError),
    /// Options of another method or domain, which [`identify`](crate::identify()) is for.
    Method {
        /// The method.
        method: Method,
        /// The domain.
        domain: Domain,
    },
}

impl FitError {
    pub(crate) fn unsuited(run: &Run, reason: Unsuited) -> Self {
        Self::Unsuited { run: run.name.clone(), reason }
    }
}

impl fmt::Display for FitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = |reasons: Vec<String>| reasons.join("\n");
        match self {
            Self::Changes(e) => write!(f, "{}", lines(e.iter().map(ToString::to_string).collect())),
            Self::Unsuited { run, reason } => write!(f, "run `{run}`: {reason}"),
            Self::Deviation { output, expression, run, time, value } => write!(
                f,
                "run `{run}`: the noise of `{output}`, `{expression}`, is {value} at time {time} with the start values, and a standard \
                 deviation is above zero; begin with other values (--set){}",
                // the absolute value of zero helps nobody
                if *value < 0.0 { format!(", or write abs({expression})") } else { String::new() }
            ),
            Self::Problem(e) => write!(f, "{}", lines(e.iter().map(ToString::to_string).collect())),
            Self::Strategy(e) => write!(f, "{e}"),
            Self::Method { method, domain } => {
                write!(f, "`fit` estimates by output error in the time domain, not by {method} in the {domain} domain")
            }
        }
    }
}

impl std::error::Error for FitError {}

/// Why a strategy that was asked for cannot be followed.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "the message below each variant says what its fields are")]
pub enum StrategyError {
    UnknownState { name: String, nearest: Option<String> },
    NothingMeasured,
    InitialConditions { run: String, length: f64, samples: usize },
    NotMeasured { reason: String },
    NotASegmentLength { length: f64 },
    NoStates,
    Delays,
    TooManySegments { cells: usize, most: usize },
    Loss { value: f64 },
    LossOfNoiseModel,
    LossOfFullNoise,
    ConfidenceOfOwnNoise,
    NoiseModel { method: Method, domain: Domain },
    Censored { method: Method, domain: Domain },
    CensoredNoise { output: String },
    OptionOfMethod { option: &'static str, method: Method, domain: Domain },
    SmoothByOneRun,
    SmoothByValidation { method: Method, domain: Domain },
    SmoothWeights { given: usize, wanted: usize },
}

impl fmt::Display for StrategyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnknownState { name, nearest: Some(hint) } => {
                write!(f, "the model has no state `{name}` to substitute; did you mean `{hint}`?")
            }
            Self::UnknownState { name, nearest: None } => write!(f, "the model has no state `{name}` to substitute"),
            Self::NothingMeasured => write!(f, "no output shows a state: there is no record to substitute for one"),
            Self::InitialConditions { run, length, samples: samples @ (0 | 1) } => write!(
                f,
                "run `{run}` has {samples} sample{} in its first {length}, and initial values want two at least; give a longer time (--initial-from)",
                if *samples == 1 { "" } else { "s" }
            ),
            Self::InitialConditions { run, length, .. } => write!(
                f,
                "run `{run}` has no measured output in its first {length}: nothing there says what its initial values are"
            ),
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
            Self::Loss { value } => {
                write!(
                    f,
                    "Huber's loss has a number from 0.01 to 100, and Student's law 1 to 1e6 degrees of freedom; {value} was given"
                )
            }
            Self::LossOfNoiseModel => write!(
                f,
                "the model says how large the noise of each sample is, and the loss takes it for one size in each output; \
                 take the noise of one size (--noise diagonal) or squares (--loss squares)"
            ),
            Self::LossOfFullNoise => write!(
                f,
                "a loss other than squares is of each output by itself; leave out --noise full, or take squares (--loss squares)"
            ),
            Self::ConfidenceOfOwnNoise => write!(
                f,
                "shorter records and other weights (--confidence, --weights) are of squares and noise of one size; \
                 take these (--noise diagonal, --loss squares), or leave the questions out"
            ),
            Self::NoiseModel { method, domain } => write!(
                f,
                "noise that is an expression (`noise y = ...;`) is estimated by output error in the time domain, not by {method} in the {domain} domain; \
                 --noise diagonal takes one size for each output instead"
            ),
            Self::Censored { method, domain } => write!(
                f,
                "samples below a limit are compared by output error in the time domain, not by {method} in the {domain} domain; \
                 take --method output-error --domain time, or leave them out (--below-limit missing)"
            ),
            Self::CensoredNoise { output } => write!(
                f,
                "`{output}` has samples below a limit, and the probability of these wants a deviation of its noise that is known or a param: \
                 write `param sigma = ...; noise {output} = sigma;`, give a number (--noise {output}=0.1), or leave them out (--below-limit missing)"
            ),
            Self::OptionOfMethod { option: "--loss", method, domain } => write!(
                f,
                "losses other than squares are of output error in the time domain, not of {method} in the {domain} domain; take --loss squares"
            ),
            Self::OptionOfMethod { option, method, domain } => write!(
                f,
                "{option} has no part in {method} in the {domain} domain, and would be ignored: leave it out, or take another method"
            ),
            Self::SmoothByOneRun => write!(
                f,
                "--smooth-by validation leaves runs out and predicts them, and there is one run; give more, or take --smooth-by likelihood"
            ),
            Self::SmoothByValidation { method, domain } => write!(
                f,
                "--smooth-by validation is of output error in the time domain, not of {method} in the {domain} domain; take --smooth-by likelihood"
            ),
            Self::SmoothWeights { given, wanted } => write!(
                f,
                "--smooth-by gives {given} weights, and the smooth tables of this model have {wanted} axes; give one for each axis, above 0"
            ),
            Self::TooManySegments { cells, most } => write!(
                f,
                "so many segments want a table of {cells} sensitivities, more than {most}; take fewer or longer ones"
            ),
        }
    }
}

impl std::error::Error for StrategyError {}
