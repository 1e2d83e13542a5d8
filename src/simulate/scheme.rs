//! How the equations are integrated between samples.

use serde::{Deserialize, Serialize};
use std::fmt;

/// How a run is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// The classical Runge-Kutta method of order 4, explicit.
    #[default]
    RungeKutta,
    /// The exact solution of a linear model from node to node, as a recursion. A delayed input enters each step by its first
    /// three moments, so that several steps between samples can be worthwhile.
    Recursion {
        /// Subsystems that do not influence each other.
        subsystems: usize,
    },
    /// Three-stage Radau IIA of order 5, implicit: for stiff models.
    Radau,
}

impl Scheme {
    /// Order of convergence; that of a recursion is about its delayed inputs, all else is exact.
    pub fn order(self) -> u32 {
        match self {
            Self::RungeKutta | Self::Recursion { .. } => 4,
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
        match self {
            Self::RungeKutta => write!(f, "Runge-Kutta"),
            Self::Radau => write!(f, "Radau IIA"),
            Self::Recursion { subsystems: 1 } => write!(f, "exact recursion (linear model)"),
            Self::Recursion { subsystems } => {
                write!(f, "exact recursion (linear model, {subsystems} subsystems)")
            }
        }
    }
}
