//! Why a model has no response at the frequencies of a spectrum, in the names of the model.

use crate::frequency::FrequencyError;
use crate::linear::{Structure, TrimError};
use fdm_grammar::graph::Signal;
use fdm_grammar::model::Model;
use std::fmt;

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
    /// The same with names in place of positions.
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
    use crate::linear::LinearModel;

    #[test]
    fn positions_become_names() {
        let text = "model m { input u; state x, z; param a = -1, tau = 0.2;
            der(x) = a*x + delay(u, tau); der(z) = x - z; output z_m = z + u; }";
        let model = crate::Model::from_text("m.fdm", text).expect("a model");
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
