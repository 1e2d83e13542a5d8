//! How a run is to be integrated, and how it was.

use clap::ValueEnum;
use fdm::simulate::{Accuracy, Scheme};

/// What `--integrator` takes.
#[derive(Debug, Clone, Copy, Default, ValueEnum)]
pub(crate) enum Integrator {
    /// Whatever reaches the accuracy with less work
    #[default]
    Auto,
    /// Classical Runge-Kutta, explicit
    RungeKutta,
    /// Radau IIA of order 5, implicit, for stiff models
    Radau,
}

impl Integrator {
    /// The method that was asked for.
    pub(crate) fn scheme(self) -> Option<Scheme> {
        match self {
            Self::Auto => None,
            Self::RungeKutta => Some(Scheme::RungeKutta),
            Self::Radau => Some(Scheme::Radau),
        }
    }
}

/// Method, steps and what they are worth, in words; `chosen` when the method was not the user's choice.
pub(crate) fn integration(accuracy: &Accuracy, chosen: bool) -> String {
    let stiff = if chosen && accuracy.steps.scheme() == Scheme::Radau { " (stiff)" } else { "" };
    let error = match accuracy.error {
        // the exact recursion has none
        error if error.is_nan() || error == 0.0 => String::new(),
        error if error.is_infinite() => ", integration error not finite".into(),
        error => format!(", integration error {error:.0e} of the range"),
    };
    format!("{}{stiff}{error}", accuracy.steps)
}
