//! How a run is to be integrated, and how it was.

use clap::{Args, ValueEnum};
use fdm::simulate::{Accuracy, Scheme};
use std::num::NonZeroUsize;

/// What a user may choose about the integration.
#[derive(Debug, Args)]
#[command(next_help_heading = "Integration")]
pub(crate) struct Integration {
    /// Equal steps between samples, instead of as many as accuracy needs
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(crate) steps: Option<NonZeroUsize>,
    /// How to integrate: `auto` takes the stiff method (Radau) where the explicit one would cost more
    #[arg(long, value_name = "METHOD", value_enum, default_value_t)]
    integrator: Integrator,
}

impl Integration {
    /// The method that was asked for.
    pub(crate) fn scheme(&self) -> Option<Scheme> {
        self.integrator.scheme()
    }

    /// The number of steps that was asked for.
    pub(crate) fn per_interval(&self) -> Option<usize> {
        self.steps.map(NonZeroUsize::get)
    }

    /// The options that were given.
    pub(crate) fn given(&self) -> impl Iterator<Item = &'static str> {
        let given = [("--steps", self.steps.is_some()), ("--integrator", self.scheme().is_some())];
        given.into_iter().filter(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Whether both are left to accuracy and speed.
    pub(crate) fn is_open(&self) -> bool {
        self.steps.is_none() && self.scheme().is_none()
    }
}

/// What `--integrator` takes.
#[derive(Debug, Clone, Copy, Default, ValueEnum)]
enum Integrator {
    /// Whatever reaches the accuracy with less work
    #[default]
    Auto,
    /// Classical Runge-Kutta, explicit
    RungeKutta,
    /// Radau IIA of order 5, implicit, for stiff models
    Radau,
}

impl Integrator {
    fn scheme(self) -> Option<Scheme> {
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
