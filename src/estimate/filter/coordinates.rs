//! In which coordinates the search moves: deviations and intensities by parts of themselves, everything else as it is.

/// Coordinates of all unknowns.
pub(super) struct Coordinates {
    /// Whether an unknown moves by its logarithm.
    pub(super) logarithmic: Vec<bool>,
    lower: Vec<f64>,
    upper: Vec<f64>,
}

/// Least part of its start value that an unknown in logarithms goes down to.
const LEAST: f64 = 1e-12;

impl Coordinates {
    pub(super) fn new(logarithmic: Vec<bool>, lower: &[f64], upper: &[f64], start: &[f64]) -> Self {
        let bound = |j: usize, bound: f64| match logarithmic[j] {
            true => bound.max(LEAST * start[j]).ln(),
            false => bound,
        };
        let lower = lower.iter().enumerate().map(|(j, b)| bound(j, *b)).collect();
        let upper = upper.iter().enumerate().map(|(j, b)| bound(j, *b)).collect();
        Self { logarithmic, lower, upper }
    }

    pub(super) fn inwards(&self, values: &[f64]) -> Vec<f64> {
        values.iter().zip(&self.logarithmic).map(|(v, log)| if *log { v.ln() } else { *v }).collect()
    }

    pub(super) fn outwards(&self, points: &[f64]) -> Vec<f64> {
        points.iter().zip(&self.logarithmic).map(|(u, log)| if *log { u.exp() } else { *u }).collect()
    }

    /// Derivative of each unknown by its coordinate.
    pub(super) fn slope(&self, j: usize, value: f64) -> f64 {
        if self.logarithmic[j] { value } else { 1.0 }
    }

    /// A step as far as bounds, and belief in a quadratic of a logarithm, reach.
    pub(super) fn clip(&self, j: usize, point: f64, step: f64) -> f64 {
        const FACTOR: f64 = 1.5;
        let step = if self.logarithmic[j] { step.clamp(-FACTOR, FACTOR) } else { step };
        step.max(self.lower[j] - point).min(self.upper[j] - point)
    }

    /// Whether a step beyond a bound is wanted where the point stands on it.
    pub(super) fn is_held(&self, j: usize, point: f64, gradient: f64) -> bool {
        (point <= self.lower[j] && gradient >= 0.0) || (point >= self.upper[j] && gradient <= 0.0)
    }
}
