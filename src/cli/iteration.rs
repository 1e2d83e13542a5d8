//! How the iteration is to go on: its method, gain and limits.

use clap::{Args, ValueEnum};
use fdm::estimate::{Method, Noise, Options};

/// What a user may choose about the iteration.
#[derive(Debug, Args)]
#[command(next_help_heading = "Estimation")]
pub(crate) struct Choice {
    /// Most corrections
    #[arg(long, value_name = "N", default_value_t = 100, allow_negative_numbers = true)]
    iterations: usize,
    /// Largest correction, relative to the parameter, at which the estimates count as converged
    #[arg(long, value_name = "T", default_value = "1e-9", allow_negative_numbers = true)]
    tolerance: f64,
    /// Factor on every correction, above 0, at most 1; damping protects from corrections that are too long by itself
    #[arg(long, value_name = "G", default_value_t = 1.0, allow_negative_numbers = true)]
    gain: f64,
    /// How the minimum is approached; every method ends with corrections
    #[arg(long, value_name = "METHOD", value_enum, default_value_t = Approach::Correction)]
    method: Approach,
}

/// The methods as they are typed.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Approach {
    /// Damped Gauss-Newton corrections from the start
    Correction,
    /// The simplex of Nelder and Mead first: without derivatives
    NelderMead,
    /// Quasi-Newton with limited memory first
    Lbfgs,
    /// Damped corrections on spectra instead of samples in time: the frequency domain
    Fd,
    /// The same on frequency responses from sweeps, weighted by coherence
    Fr,
    /// Recursive least squares with forgetting first: of its iterates the one whose simulation errs least begins
    Rls,
    /// Filter error: a Kalman filter for noise in the equations (turbulence), which the model declares by `noise der(x) = q;`
    Fe,
}

impl Choice {
    /// Whether spectra are to be fitted instead of samples in time.
    pub(crate) fn is_spectral(&self) -> bool {
        matches!(self.method, Approach::Fd)
    }

    /// Whether frequency responses are to be fitted.
    pub(crate) fn is_of_responses(&self) -> bool {
        matches!(self.method, Approach::Fr)
    }

    /// Whether the errors of a Kalman filter's predictions are to be fitted.
    pub(crate) fn is_of_a_filter(&self) -> bool {
        matches!(self.method, Approach::Fe)
    }

    /// Whether recursive least squares find the start values.
    pub(crate) fn is_recursive(&self) -> bool {
        matches!(self.method, Approach::Rls)
    }

    /// The gain, where it was changed.
    pub(crate) fn is_gained(&self) -> bool {
        self.gain != 1.0
    }

    /// The options of an estimation with this noise.
    pub(crate) fn options(&self, noise: Noise) -> Options {
        let method = match self.method {
            Approach::Correction | Approach::Fd | Approach::Fr | Approach::Fe | Approach::Rls => Method::Correction,
            Approach::NelderMead => Method::NelderMead,
            Approach::Lbfgs => Method::Lbfgs,
        };
        Options {
            noise,
            iterations: self.iterations,
            tolerance: self.tolerance,
            gain: self.gain,
            method,
            ..Options::default()
        }
    }
}
