//! How the equations are integrated between samples.

use serde::{Deserialize, Serialize};

/// How a run is integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scheme {
    /// The classical Runge-Kutta method with a whole number of equal steps between neighbouring samples.
    #[default]
    RungeKutta,
    /// The exact solution of a linear model from node to node, as a recursion. A delayed input enters each step by its first
    /// three moments, so that several steps between samples can be worthwhile.
    Recursion {
        /// Subsystems that do not influence each other.
        subsystems: usize,
    },
}
