//! Why nothing was estimated from spectra, and why a model has no response at their frequencies: every reason in a sentence, in the names of the model.

use crate::methods::output_error::error::{FitError, StrategyError};
use crate::problem::ProblemError;
use crate::problem::unknowns::ChangeError;
use fdm_grammar::carried::NotCarried;
use fdm_grammar::graph::Signal;
use fdm_grammar::model::Model;
use fdm_system::frequency::FrequencyError;
use fdm_system::linear::{Structure, TrimError};
use fdm_system::record::Incomplete;
use fdm_system::spectrum::SpectrumError;
use std::fmt;

/// Why nothing was estimated from spectra.
#[derive(Debug, Clone, PartialEq)]
pub enum SpectralError {
    /// There is no run.
    NoRuns,
    /// Changes that cannot be made.
    Changes(Vec<ChangeError>),
    /// Something that only another method can follow.
    Strategy(StrategyError),
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
        /// Frequencies of all runs together; those that are closer than one cycle in the record count for their independent part.
        frequencies: usize,
        /// Outputs.
        outputs: usize,
    },
    /// An input that does not move, though its coefficients are to be found.
    NoPower {
        /// The input.
        input: String,
        /// What only it determines.
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
    /// Events are not in a linear model.
    Events,
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
    pub(crate) fn of(error: FitError) -> Self {
        match error {
            FitError::Changes(e) => Self::Changes(e),
            FitError::Strategy(e) => Self::Strategy(e),
            _ => Self::NoRuns,
        }
    }
}

impl fmt::Display for SpectralError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines = |reasons: Vec<String>| reasons.join("\n");
        match self {
            Self::NoRuns => f.write_str("there is no run to compare the model with"),
            Self::Strategy(e) => write!(f, "{e}"),
            Self::Changes(e) => f.write_str(&lines(e.iter().map(ToString::to_string).collect())),
            Self::Spectrum { run, reason } => write!(f, "run `{run}`: {reason}"),
            Self::Incomplete(e) => e.fmt(f),
            Self::Trim(e) => e.fmt(f),
            Self::NotCarried(e) => e.fmt(f),
            Self::Unanswered(e) => e.fmt(f),
            Self::Events => f.write_str("the model has events (`when`), which the frequency domain does not know; fit it in the time domain"),
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

/// Why a response could not be computed.
#[derive(Debug, Clone, PartialEq)]
pub enum Unanswered {
    /// The trim was lost on the way.
    Trim(TrimError),
    /// No response at a frequency.
    Frequency(FrequencyError),
    /// A coefficient that is not a finite number.
    Coefficient {
        /// What it is the coefficient of.
        signal: String,
        /// The equation: `der(x)`, or an output.
        equation: String,
    },
    /// The derivative of a coefficient that is not a finite number.
    Slope {
        /// What it is the coefficient of.
        signal: String,
        /// The equation.
        equation: String,
        /// By this parameter.
        parameter: String,
    },
    /// A delay, or its derivative, that is not a finite number.
    Delay {
        /// What is delayed.
        signal: String,
    },
    /// An end term that is not a finite number.
    End {
        /// Of this state.
        state: String,
    },
    /// An input that is not known at a frequency.
    Input {
        /// The run.
        run: String,
        /// The input.
        input: String,
        /// The frequency, in cycles per unit of time.
        frequency: f64,
    },
}

impl fmt::Display for Unanswered {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Trim(e) => e.fmt(f),
            Self::Frequency(e) => e.fmt(f),
            Self::Coefficient { signal, equation } => {
                write!(f, "the coefficient of `{signal}` in `{equation}` is not a finite number")
            }
            Self::Slope { signal, equation, parameter } => write!(
                f,
                "the derivative by `{parameter}` of the coefficient of `{signal}` in `{equation}` is not a finite number"
            ),
            Self::Delay { signal } => write!(f, "the delay of `{signal}` is not a finite number"),
            Self::End { state } => write!(f, "an end value of `{state}` is not a finite number"),
            Self::Input { run, input, frequency } => {
                write!(
                    f,
                    "run `{run}`: the input `{input}` is not a finite number at {frequency} cycles per unit of time"
                )
            }
        }
    }
}

impl std::error::Error for Unanswered {}

impl Unanswered {
    /// This error with names in place of positions.
    pub(super) fn named(self, model: &Model, structure: &Structure) -> Self {
        let Self::Frequency(error) = self else { return self };
        let plain = |signal: Signal| match signal {
            Signal::State(j) => model.states[j as usize].quantity.name.clone(),
            Signal::Input(j) => model.inputs[j as usize].quantity.name.clone(),
        };
        let delayed = |d: usize| plain(structure.delayed[d]);
        let (n, m) = (structure.states, structure.inputs);
        let signal = |k: usize| match k {
            _ if k < n => plain(Signal::State(k as u32)),
            _ if k < n + m => plain(Signal::Input((k - n) as u32)),
            _ => format!("delay({})", delayed(k - n - m)),
        };
        let equation = |row: usize| match row.checked_sub(n) {
            None => format!("der({})", model.states[row].quantity.name),
            Some(o) => model.outputs[o].quantity.name.clone(),
        };
        match error {
            FrequencyError::Coefficient { row, signal: k } => {
                Self::Coefficient { signal: signal(k), equation: equation(row) }
            }
            FrequencyError::Slope { row, signal: k, param } => Self::Slope {
                signal: signal(k),
                equation: equation(row),
                parameter: model.params[param].quantity.name.clone(),
            },
            FrequencyError::Delay { delayed: d } => Self::Delay { signal: delayed(d) },
            FrequencyError::End { state } => Self::End { state: plain(Signal::State(state as u32)) },
            FrequencyError::Input { run, input, omega } => {
                Self::Input { run, input: plain(Signal::Input(input as u32)), frequency: omega / std::f64::consts::TAU }
            }
            other => Self::Frequency(other),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_system::linear::LinearModel;

    #[test]
    fn positions_become_names() {
        let text = "model m { input u; state x, z; param a = -1, tau = 0.2;
            der(x) = a*x + delay(u, tau); der(z) = x - z; output z_m = z + u; }";
        let model = fdm_system::Model::from_text("m.fdm", text).expect("a model");
        let linear = LinearModel::new(&model).expect("linear");
        let told = |error| Unanswered::Frequency(error).named(model.definition(), linear.structure()).to_string();
        let coefficient = |row, signal| told(FrequencyError::Coefficient { row, signal });
        assert_eq!(coefficient(0, 3), "the coefficient of `delay(u)` in `der(x)` is not a finite number");
        assert_eq!(coefficient(2, 2), "the coefficient of `u` in `z_m` is not a finite number");
        let slope = told(FrequencyError::Slope { row: 0, signal: 0, param: 0 });
        assert_eq!(slope, "the derivative by `a` of the coefficient of `x` in `der(x)` is not a finite number");
        assert_eq!(told(FrequencyError::Delay { delayed: 0 }), "the delay of `u` is not a finite number");
        assert_eq!(told(FrequencyError::End { state: 1 }), "an end value of `z` is not a finite number");
        let input = FrequencyError::Input { run: "r".into(), input: 0, omega: std::f64::consts::TAU };
        assert_eq!(told(input), "run `r`: the input `u` is not a finite number at 1 cycles per unit of time");
    }
}
