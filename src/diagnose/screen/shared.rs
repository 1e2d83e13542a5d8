//! What all signals have in common: sensitivities and directions are smooth and alike, so that a few columns carry them all
//! and every sum over lines is made once, for these columns.

use super::lines::Lines;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rayon::prelude::*;

/// Directions of unit norm are carried but for about this share of their energy.
const LOST: f64 = 1e-8;
/// Fitted columns count so many times as much: what a fit has taken out must be taken out here too.
const FITTED: f64 = 100.0;

/// One output of one run (or of a difference between runs) in the shared columns.
#[derive(Debug, Clone)]
pub(super) struct Part {
    /// The run.
    pub(super) run: usize,
    /// The output.
    pub(super) channel: usize,
    /// Samples that were transformed, by their places in the run.
    pub(super) samples: Vec<usize>,
    /// Whether its lines can be turned back into samples.
    pub(super) sampled: bool,
    /// Frequencies of the lines.
    pub(super) frequency: Vec<f64>,
    /// Shared columns, lines by r.
    pub(super) basis: DMatrix<f64>,
    /// The residual.
    pub(super) residual: DVector<f64>,
    /// A difference between runs that repeat each other: noise alone.
    pub(super) reference: bool,
}

/// All runs in shared columns.
#[derive(Debug, Clone)]
pub(super) struct Shared {
    /// Outputs of runs.
    pub(super) parts: Vec<Part>,
    /// Signals by shared columns: r by p fitted.
    pub(super) fitted: DMatrix<f64>,
    /// r by m directions.
    pub(super) directions: DMatrix<f64>,
    /// The same, of unit norm.
    pub(super) unit: DMatrix<f64>,
    /// Outputs q.
    pub(super) channels: usize,
}

impl Shared {
    /// Finds the columns; of those signals the first p are fitted.
    pub(super) fn new(lines: Vec<Lines>, channels: usize, p: usize) -> Self {
        let count = lines.first().map_or(0, |l| l.columns.ncols());
        let weight = weights(&lines, channels);
        let squares = |l: &Lines| l.columns.transpose() * &l.columns * weight[l.channel];
        let each: Vec<DMatrix<f64>> = lines.par_iter().map(squares).collect();
        let mut gram = DMatrix::zeros(count, count);
        each.iter().for_each(|own| gram += own);
        let mut scale = gram.diagonal().map(|v| if v > 0.0 { v.sqrt() } else { 0.0 });
        scale.rows_mut(0, p).unscale_mut(FITTED);
        let inverse = scale.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
        let eigen = SymmetricEigen::new(DMatrix::from_fn(count, count, |i, j| gram[(i, j)] * inverse[i] * inverse[j]));
        let kept: Vec<usize> = (0..count).filter(|k| eigen.eigenvalues[*k] > LOST).collect();
        let root = |k: usize| eigen.eigenvalues[kept[k]].sqrt();
        let combine =
            DMatrix::from_fn(count, kept.len(), |i, k| inverse[i] * eigen.eigenvectors[(i, kept[k])] / root(k));
        let carried = DMatrix::from_fn(kept.len(), count, |k, i| scale[i] * eigen.eigenvectors[(i, kept[k])] * root(k));
        let part = |l: Lines| Part {
            run: l.run,
            channel: l.channel,
            samples: l.samples,
            sampled: l.sampled,
            frequency: l.frequency,
            basis: l.columns * &combine,
            residual: l.residual,
            reference: false,
        };
        let parts = lines.into_par_iter().map(part).collect();
        let directions = carried.columns(p, count - p).into_owned();
        let mut unit = directions.clone();
        for mut column in unit.column_iter_mut() {
            column.try_normalize_mut(0.0);
        }
        Self { parts, fitted: carried.columns(0, p).into_owned(), directions, unit, channels }
    }

    /// Shared columns r.
    pub(super) fn width(&self) -> usize {
        self.directions.nrows()
    }
}

/// One over the mean square of each output's residual.
fn weights(lines: &[Lines], channels: usize) -> Vec<f64> {
    let of = |channel: usize| {
        let own = || lines.iter().filter(|l| l.channel == channel);
        let sum: f64 = own().map(|l| l.residual.norm_squared()).sum();
        let count: usize = own().map(|l| l.residual.len()).sum();
        if sum > 0.0 { count as f64 / sum } else { 0.0 }
    };
    (0..channels).map(of).collect()
}
