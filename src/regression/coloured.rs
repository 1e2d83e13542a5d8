//! Standard errors of a regression whose residuals are coloured: `D [sum_ij x_i Rvv(i-j) x_j'] D`, D = (X'X)^-1 (Morelli and Klein,
//! "Accuracy of aerodynamic model parameters estimated from flight test data", 1997).

use crate::quality::autocovariance::Lagged;
use nalgebra::DMatrix;

/// Longest lag, in parts of the record, and at all.
const PART: usize = 5;
const MOST: usize = 2000;

/// Rows of one equation in one run: neighbours in time.
pub(super) struct Stretch<'a> {
    /// Rows by parameters, weighted.
    pub(super) columns: DMatrix<f64>,
    /// Residuals, weighted.
    pub(super) residual: &'a [f64],
}

/// Standard errors (p) from `inverse`, (X'X)^-1. Autocovariances are tapered linearly up to the longest lag, so that no variance is negative.
pub(super) fn coloured_errors(stretches: &[Stretch<'_>], inverse: &DMatrix<f64>, correction: f64) -> Vec<f64> {
    let p = inverse.nrows();
    let mut middle = DMatrix::zeros(p, p);
    for stretch in stretches {
        let n = stretch.residual.len();
        let most = (n / PART).clamp(1, MOST);
        let lagged = Lagged::of(stretch.residual, most);
        let covariance: Vec<f64> = lagged
            .sums
            .iter()
            .enumerate()
            .map(|(k, sum)| sum / n as f64 * (1.0 - k as f64 / (most + 1) as f64))
            .collect();
        middle += spread(&stretch.columns, &covariance);
    }
    let variance = inverse * middle * inverse * correction;
    (0..p).map(|j| variance[(j, j)].max(0.0).sqrt()).collect()
}

/// `sum_ij x_i r(i - j) x_j'`.
fn spread(columns: &DMatrix<f64>, covariance: &[f64]) -> DMatrix<f64> {
    let (n, p) = columns.shape();
    let mut filtered = DMatrix::zeros(n, p);
    for j in 0..p {
        let (source, mut to) = (columns.column(j), filtered.column_mut(j));
        let source = source.as_slice();
        for (k, r) in covariance.iter().enumerate().take(n) {
            for i in 0..n - k {
                to[i] += r * source[i + k];
                if k > 0 {
                    to[i + k] += r * source[i];
                }
            }
        }
    }
    columns.transpose() * filtered
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_residuals_change_nothing_and_slow_ones_weigh_more() {
        let mut normal = crate::quality::specimen::Normal(11);
        let n = 2000;
        let columns = DMatrix::from_fn(n, 1, |i, _| (0.01 * i as f64).sin() + 2.0);
        let inverse = DMatrix::from_element(1, 1, 1.0 / columns.norm_squared());
        let white: Vec<f64> = (0..n).map(|_| normal.next()).collect();
        let mut slow = vec![0.0; n];
        for i in 1..n {
            slow[i] = 0.9 * slow[i - 1] + (1.0f64 - 0.81).sqrt() * normal.next();
        }
        let error = |residual: &[f64]| {
            coloured_errors(&[Stretch { columns: columns.clone(), residual }], &inverse, 1.0)[0]
                / inverse[(0, 0)].sqrt()
        };
        // an AR(1) process of unit variance has sqrt((1 + 0.9)/(1 - 0.9)) = 4.36 times the error of a mean
        let (a, b) = (error(&white), error(&slow));
        assert!((a - 1.0).abs() < 0.35 && (b / 4.36 - 1.0).abs() < 0.35, "{a} {b}");
    }
}
