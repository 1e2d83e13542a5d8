//! Why nothing was estimated from spectra: every reason in a sentence.

use super::unanswered::Unanswered;
use crate::estimate::changes::ChangeError;
use crate::estimate::problem::ProblemError;
use crate::estimate::road::fit_error::FitError;
use crate::linear::TrimError;
use crate::record::Incomplete;
use crate::spectrum::SpectrumError;
use fdm_grammar::carried::NotCarried;
use std::fmt;

/// Why nothing was estimated from spectra.
#[derive(Debug, Clone, PartialEq)]
pub enum SpectralError {
    /// There is no run.
    NoRuns,
    /// Changes that cannot be made.
    Changes(Vec<ChangeError>),
    /// A run without a spectrum.
    Spectrum {
        /// Name of the run.
        run: String,
        /// Why.
        reason: SpectrumError,
    },
    /// A run that does not fit the model.
    Incomplete(Incomplete),
    /// The model has no trim to be linearised at.
    Trim(TrimError),
    /// The model's nonlinear terms cannot be computed from records.
    NotCarried(NotCarried),
    /// The model has no response in the frequency domain.
    Unanswered(Unanswered),
    /// More unknowns than numbers.
    TooFewFrequencies {
        /// Unknowns, end values included.
        unknowns: usize,
        /// Of these, end values.
        ends: usize,
        /// Frequencies of all runs together; those that are closer than one cycle in the record count for what they are worth.
        frequencies: usize,
        /// Outputs.
        outputs: usize,
    },
    /// An input that does not move, though its coefficients are to be found.
    NoPower {
        /// The input.
        input: String,
        /// What only it tells.
        parameters: Vec<String>,
        /// The band, in cycles per unit of time.
        band: (f64, f64),
    },
    /// Noise of an input that the model does not have.
    UnknownInput {
        /// What was named.
        name: String,
        /// What may have been meant.
        nearest: Option<String>,
    },
    /// A deviation that is none.
    NotADeviation {
        /// The input.
        input: String,
        /// What was given.
        deviation: f64,
    },
    /// Forcing by explicit time is not in a linear model.
    UsesTime,
    /// Nothing moves by itself.
    NoStates,
    /// A delay that no record shows.
    LongDelay {
        /// The delay.
        delay: f64,
        /// Length of the longest run.
        duration: f64,
    },
    /// Measured outputs that are combinations of each other, of which a full covariance was asked for.
    DependentOutputs {
        /// The outputs.
        outputs: Vec<String>,
    },
    /// A problem that cannot be solved.
    Problem(Vec<ProblemError>),
}

/// A number as a sentence gives it: six digits.
fn rounded(v: f64) -> f64 {
    format!("{v:.5e}").parse().unwrap_or(v)
}

impl SpectralError {
    /// What changes of a model can fail with.
    pub(in crate::estimate) fn of(error: FitError) -> Self {
        match error {
            FitError::Changes(e) => Self::Changes(e),
            _ => Self::NoRuns,
        }
    }
}

impl fmt::Display for SpectralError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = |reasons: Vec<String>| reasons.join("\n");
        match self {
            Self::NoRuns => f.write_str("there is no run to compare the model with"),
            Self::Changes(e) => f.write_str(&lines(e.iter().map(ToString::to_string).collect())),
            Self::Spectrum { run, reason } => write!(f, "run `{run}`: {reason}"),
            Self::Incomplete(e) => e.fmt(f),
            Self::Trim(e) => e.fmt(f),
            Self::NotCarried(e) => e.fmt(f),
            Self::Unanswered(e) => e.fmt(f),
            Self::TooFewFrequencies { unknowns, ends, frequencies, outputs } => {
                let of_ends = if *ends > 0 { format!(" ({ends} of them end values)") } else { String::new() };
                write!(
                    f,
                    "{frequencies} frequenc{} of {outputs} output{} are {} numbers, too few for {unknowns} unknowns{of_ends}; widen the \
                     band (`--band`), use longer or more runs, or fix parameters (`--fix NAME`)",
                    if *frequencies == 1 { "y" } else { "ies" },
                    if *outputs == 1 { "" } else { "s" },
                    2 * frequencies * outputs
                )
            }
            Self::NoPower { input, parameters, band } => {
                let quoted: Vec<String> = parameters.iter().map(|p| format!("`{p}`")).collect();
                write!(
                    f,
                    "the input `{input}` has no power between {} and {} cycles per unit of time in any run, so that {} cannot be found; \
                     choose a band in which it moves, add a run that moves it, or fix {}",
                    rounded(band.0),
                    rounded(band.1),
                    quoted.join(", "),
                    if quoted.len() == 1 { "it" } else { "them" }
                )
            }
            Self::UnknownInput { name, nearest } => {
                let hint = nearest.as_ref().map_or(String::new(), |hint| format!("; did you mean `{hint}`?"));
                write!(f, "the model has no input `{name}`, whose noise was given{hint}")
            }
            Self::NotADeviation { input, deviation } => write!(
                f,
                "the noise of the input `{input}` has the standard deviation {deviation}; expected a finite number that is not below 0"
            ),
            Self::UsesTime => f.write_str(
                "the model uses the time `t`, and forcing by explicit time has no part in a linear model of states and inputs; make it an input that is \
                 recorded, or estimate in the time domain",
            ),
            Self::NoStates => f.write_str(
                "the model has no states, and so no response that depends on the frequency but by delays; estimate in the time domain",
            ),
            Self::LongDelay { delay, duration } => write!(
                f,
                "a delay is {delay} at the start values, and the longest record {duration}: nothing that was delayed is in it; begin with a shorter \
                 delay (`--set NAME=VALUE`)"
            ),
            Self::DependentOutputs { outputs } => write!(
                f,
                "the measured outputs {} are combinations of each other at all frequencies, so that the covariance S of their residuals is \
                 singular; leave one of them out of the model, or say --noise diagonal",
                outputs.iter().map(|o| format!("`{o}`")).collect::<Vec<_>>().join(", ")
            ),
            Self::Problem(e) => f.write_str(&lines(e.iter().map(ToString::to_string).collect())),
        }
    }
}

impl std::error::Error for SpectralError {}
