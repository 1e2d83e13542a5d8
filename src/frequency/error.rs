//! Why there is no solution at a frequency.

/// What keeps a model from having a response in the frequency domain.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrequencyError {
    /// A pole of the model stands on the imaginary axis at one of the frequencies.
    #[error(
        "run `{run}`: the model has an undamped mode exactly at {omega} rad per unit of time ({} cycles), where its response \
         has no finite value; move the frequencies or begin with other values",
        omega / std::f64::consts::TAU
    )]
    Singular {
        /// Name of the run.
        run: String,
        /// Position of the frequency.
        frequency: usize,
        /// The angular frequency.
        omega: f64,
    },
    /// A coefficient of the linear model is not a finite number.
    #[error("the coefficient of signal {} in equation {} is not a finite number", signal + 1, row + 1)]
    Coefficient {
        /// The equation, as in [`Term`](crate::linear::Term).
        row: usize,
        /// The signal.
        signal: usize,
    },
    /// The derivative of a coefficient is not a finite number.
    #[error("the derivative of the coefficient of signal {} in equation {} by parameter {} is not a finite number",
        signal + 1, row + 1, param + 1)]
    Slope {
        /// The equation.
        row: usize,
        /// The signal.
        signal: usize,
        /// The parameter.
        param: usize,
    },
    /// A delay, or its derivative, is not a finite number.
    #[error("delay {} is not a finite number", delayed + 1)]
    Delay {
        /// Position in [`Structure::delayed`](crate::linear::Structure::delayed).
        delayed: usize,
    },
    /// An end term of a state is not a finite number.
    #[error("an end term of state {} is not a finite number", state + 1)]
    End {
        /// The state.
        state: usize,
    },
    /// Frequencies must be finite, above zero and rising.
    #[error("run `{run}`: frequency {} is {omega}; frequencies must be finite, above zero and rising", frequency + 1)]
    Frequency {
        /// Name of the run.
        run: String,
        /// Its position.
        frequency: usize,
        /// Its value.
        omega: f64,
    },
    /// A spectrum that does not belong to the model.
    #[error("run `{run}`: there are {found} numbers for the {what}, the model and the frequencies need {wanted}")]
    Shape {
        /// Name of the run.
        run: String,
        /// What the numbers are.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many are needed.
        wanted: usize,
    },
    /// An input is not known at a frequency.
    #[error("run `{run}`: input {} is not a finite number at {omega} rad per unit of time", input + 1)]
    Input {
        /// Name of the run.
        run: String,
        /// The input.
        input: usize,
        /// The angular frequency.
        omega: f64,
    },
}
