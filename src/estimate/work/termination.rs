//! How an estimation ended.

use fdm_numeric::halt::Stop;
pub use fdm_numeric::least_squares::Reason;
use fdm_numeric::least_squares::Summary;
use fdm_system::simulate::EventFault;
use serde::{Deserialize, Serialize};
use std::fmt;

/// How an estimation ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Termination {
    /// At a minimum of the cost.
    Converged(Reason),
    /// All iterations were used.
    IterationLimit,
    /// No step lowers the cost, though the slope says that one should: a kink in the model, or partials that do
    /// not fit it.
    NoProgress,
    /// The simulation at the start values diverged; nothing was estimated.
    Diverged {
        /// The run.
        run: String,
        /// Time since the run began, in the model's time unit.
        time: f64,
        /// Index of the state, when it can be told.
        state: Option<usize>,
        /// The sample (from 0) that was not reached.
        sample: usize,
        /// Not the numbers but an event ended the run.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        event: Option<EventFault>,
    },
    /// In the frequency domain: there is no response at the start values; nothing was estimated.
    Unanswered {
        /// The run.
        run: String,
    },
    /// An output at the start values, or its partial by a parameter, is not finite; nothing was estimated.
    NotFinite {
        /// The run.
        run: String,
        /// The output.
        output: String,
        /// The sample, from 0.
        sample: usize,
        /// Its frequency in cycles per unit of time, in the frequency domain.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        frequency: Option<f64>,
        /// The parameter, when the output itself is finite.
        parameter: Option<String>,
    },
    /// Somebody asked for the end.
    Interrupted,
    /// The time that was given is over.
    TimeLimit,
    /// The cost that was reached is none: not a finite number, or below that of a perfect match.
    Impossible,
    /// The free response grows beyond all that could follow it, while the outputs stay in place: the values are those of a shorter record.
    Unstable {
        /// E-folds over the longest run.
        growth: f64,
        /// What that lasts, in the model's time unit.
        length: f64,
        /// A state of the mode that grows.
        state: String,
        /// The unit of time.
        unit: String,
    },
}

impl Termination {
    /// Whether the estimates are at a minimum.
    pub fn is_good(&self) -> bool {
        matches!(self, Self::Converged(_))
    }

    /// Whether the work was ended from outside before it was done.
    pub fn is_stopped(&self) -> bool {
        matches!(self, Self::Interrupted | Self::TimeLimit)
    }
}

impl From<Stop> for Termination {
    fn from(stop: Stop) -> Self {
        match stop {
            Stop::Interrupt => Self::Interrupted,
            Stop::TimeLimit => Self::TimeLimit,
            Stop::Iterations => Self::IterationLimit,
        }
    }
}

impl From<Summary> for Termination {
    fn from(summary: Summary) -> Self {
        match summary {
            Summary::Converged(reason) => Self::Converged(reason),
            Summary::IterationLimit => Self::IterationLimit,
            Summary::NoProgress => Self::NoProgress,
            Summary::Interrupted => Self::Interrupted,
        }
    }
}

impl fmt::Display for Termination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Converged(Reason::SmallStep) => write!(f, "converged"),
            Self::Converged(Reason::Rounding) => write!(f, "converged to rounding"),
            Self::Converged(Reason::Stationary) => write!(f, "converged: no step lowers the cost any more"),
            Self::Converged(Reason::AllHeld) => {
                write!(f, "every free parameter is held: it is at a bound, or has no influence on what was compared")
            }
            Self::Converged(Reason::NothingToEstimate) => {
                write!(f, "no parameter is free: the model was compared only")
            }
            Self::IterationLimit => write!(f, "not converged: all iterations were used"),
            Self::NoProgress => {
                write!(f, "not converged: no step lowers the cost, though its slope is not zero here")
            }
            Self::Diverged { run, time, event: Some(event), .. } => {
                write!(f, "run `{run}` ends at time {time} already at the start values: {event}")
            }
            Self::Diverged { run, time, .. } => {
                write!(f, "run `{run}` diverges at time {time} already at the start values")
            }
            Self::Unanswered { run } => write!(
                f,
                "run `{run}`: the model has no response in the frequency domain at the start values; begin with other values (`--set NAME=VALUE`)"
            ),
            Self::NotFinite { run, output, sample, frequency, parameter } => {
                let place = match frequency {
                    Some(f) => format!("at {f} cycles per unit of time"),
                    None => format!("sample {}", sample + 1),
                };
                let what = match parameter {
                    Some(parameter) => format!("the partial of output `{output}` by `{parameter}`"),
                    None => format!("output `{output}`"),
                };
                write!(f, "run `{run}`, {place}: {what} is not a finite number at the start values")
            }
            Self::Unstable { growth, length, state, unit } => write!(
                f,
                "unstable as a free response over {length} {unit} (growth e^{growth:.0}), though the outputs stay in place: use `--method filter-error` (add `noise der({state}) = s;` and `param s`) or `--domain frequency`"
            ),
            Self::Interrupted => write!(f, "interrupted"),
            Self::TimeLimit => write!(f, "stopped by the time limit"),
            Self::Impossible => write!(
                f,
                "no result: the cost that was reached is lost in rounding or not a finite number; begin with other values, or \
                 with fewer fallback strategies"
            ),
        }
    }
}
