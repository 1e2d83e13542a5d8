//! What estimates would be if records that stand in the equations had no noise.
//!
//! Noise of a record goes with itself into the sensitivities and into the residuals, so that estimates are drawn (towards zero, where a coefficient stands
//! before a noisy record). As much noise again would draw them again: each draw d, and its mirror image -d, changes the sensitivities by dS and the
//! residuals by de, and what a fit would answer is `(S + dS)' W (S + dS)` solved for `(S + dS)' W (e + de)`. What once and twice as much would do in the mean is
//! extrapolated by a parabola to no noise, `3 x(0) - 3 x(1) + x(2)` (SIMEX, Cook and Stefanski 1994). Mirror images leave nothing of what is of first order, so
//! that few draws tell it.

use crate::estimate::iteration::quadratic::Inverse;
use crate::estimate::problem::NoiseShift;
use nalgebra::{Cholesky, DMatrix, DVector};

/// What one draw does to the normal equations of the chosen unknowns.
pub(super) struct Again {
    /// `S' W de` (n).
    pub(super) score: Vec<f64>,
    /// `dS' W e` (n).
    tilt: Vec<f64>,
    /// `dS' W de` (n).
    pull: Vec<f64>,
    /// `S' W dS` (n by n).
    cross: Vec<f64>,
    /// `dS' W dS` (n by n).
    added: Vec<f64>,
}

impl Again {
    pub(super) fn new(n: usize) -> Self {
        let (vector, matrix) = (vec![0.0; n], vec![0.0; n * n]);
        Self { score: vector.clone(), tilt: vector.clone(), pull: vector, cross: matrix.clone(), added: matrix }
    }

    /// Adds what it does in one run, whose columns stand at these places and have these norms.
    pub(super) fn add(&mut self, shift: &NoiseShift, places: &[Option<usize>], scale: &[f64]) {
        let n = self.pull.len();
        let chosen = |(c, place): (usize, &Option<usize>)| place.map(|place| (c, place, scale[c]));
        let columns: Vec<(usize, usize, f64)> = places.iter().enumerate().filter_map(chosen).collect();
        for (c, i, norm) in &columns {
            self.tilt[*i] += shift.tilt[*c] / norm;
            self.pull[*i] += shift.pull[*c] / norm;
            for (d, j, other) in &columns {
                let (from, to) = (c * places.len() + d, i * n + j);
                self.cross[to] += shift.cross[from] / (norm * other);
                self.added[to] += shift.added[from] / (norm * other);
            }
        }
    }
}

/// The way to estimates without noise in the equations.
pub(super) struct Undone {
    /// The step of each chosen unknown (n).
    pub(super) step: Vec<f64>,
    /// What stands in the place of the inverse information in their covariance (n by n).
    pub(super) inverse: Vec<f64>,
}

impl Undone {
    /// From the draws of each record, of which the noise is such a part of what was drawn. None where something is not determined.
    pub(super) fn of<'d, D>(inverse: &Inverse, records: impl Iterator<Item = (f64, D)>) -> Option<Self>
    where
        D: ExactSizeIterator<Item = &'d Again>,
    {
        let n = inverse.chosen.len();
        let known = DMatrix::from_row_slice(n, n, &inverse.values);
        let information = Cholesky::new(known.clone()).filter(|_| inverse.null.is_empty())?.inverse();
        let (mut step, mut turned) = (DVector::zeros(n), DMatrix::zeros(n, n));
        for (part, draws) in records {
            let count = draws.len() as f64;
            for again in draws.filter(|again| again.added.iter().any(|v| *v != 0.0)) {
                let matrix = |values: &[f64]| DMatrix::from_row_slice(n, n, values);
                let (cross, added) = (matrix(&again.cross), matrix(&again.added));
                let first = DVector::from_column_slice(&again.score) + DVector::from_column_slice(&again.tilt);
                let second = DVector::from_column_slice(&again.pull);
                for (times, sign) in [(1.0, 1.0), (1.0, -1.0), (2.0, 1.0), (2.0, -1.0)] {
                    let power: f64 = part * times;
                    let size = sign * power.sqrt();
                    let normal = &information + size * (&cross + cross.transpose()) + power * &added;
                    let answer = Cholesky::new(0.5 * (&normal + normal.transpose()))?;
                    // of 3 x(0) - 3 x(1) + x(2), half by each sign
                    let weight = 0.5 * if times == 1.0 { -3.0 } else { 1.0 } / count;
                    step += weight * answer.solve(&(size * &first + power * &second));
                    // residuals change by -dS x
                    turned -= weight * answer.solve(&(size * &cross + power * &added));
                }
            }
        }
        let grown = turned * &known;
        // symmetric but for chance
        let inverse = &known + 0.5 * (&grown + grown.transpose());
        let finite = inverse.iter().chain(step.iter()).all(|v| v.is_finite());
        finite.then(|| Self { step: step.as_slice().to_vec(), inverse: inverse.as_slice().to_vec() })
    }
}
