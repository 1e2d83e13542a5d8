//! How the equations are integrated between samples.

use std::fmt;

/// How a run is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scheme {
    /// The classical Runge-Kutta method of order 4, explicit.
    #[default]
    RungeKutta,
    /// Three-stage Radau IIA of order 5, implicit: for stiff models.
    Radau,
}

impl Scheme {
    /// Order of convergence.
    pub fn order(self) -> u32 {
        match self {
            Self::RungeKutta => 4,
            Self::Radau => 5,
        }
    }

    /// One over the part of the error that halving all steps removes.
    pub(super) fn part_removed_by_halving(self) -> f64 {
        let power = f64::from(1_u32 << self.order());
        power / (power - 1.0)
    }
}

impl fmt::Display for Scheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::RungeKutta => "Runge-Kutta",
            Self::Radau => "Radau IIA",
        })
    }
}
