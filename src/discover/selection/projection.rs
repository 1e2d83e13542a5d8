//! Directions beside what is fitted, in the metric of one noise: what each predicts, and how alike two of them are.

use super::directions::TrialPoint;
use super::predictor::Predictor;
use super::whitening::{CommonNoise, Whitener};
use crate::bins::Record;
use fdm_system::record::Run;

/// Columns with less than this of their energy left beside others are made of them.
const UNDETERMINED: f64 = 1e-10;

/// The residual beside what is fitted.
pub(super) struct Projection {
    /// Orthonormal columns of what is fitted.
    basis: Vec<Vec<f64>>,
    /// The fitted column behind each of them: which, its multiples of those before, its norm beside them.
    made: Vec<(usize, Vec<f64>, f64)>,
    /// Number of fitted columns.
    fitted: usize,
    /// The residual without them.
    residual: Vec<f64>,
    lenses: Vec<std::sync::Mutex<Whitener>>,
}

/// What a signal adds beside what is fitted.
pub(super) struct Projected {
    /// What is left of it.
    pub(super) direction: Vec<f64>,
    /// The multiples of the fitted columns that make up for the rest; 0 for those that are made of others.
    pub(super) compensation: Vec<f64>,
}

impl Projection {
    pub(super) fn new(
        records: &[Record],
        runs: &[Run],
        predictors: &[Predictor],
        outputs: usize,
        noise: &CommonNoise,
    ) -> Self {
        let whitener =
            |(run, predictor): (&Run, &Predictor)| std::sync::Mutex::new(predictor.whitener(run, outputs, noise));
        let lenses: Vec<_> = runs.iter().zip(predictors).map(whitener).collect();
        let residual: Vec<&[f64]> = records.iter().map(|r| &r.residual[..]).collect();
        let residual = together(&lenses, &residual);
        let fitted = records.first().map_or(0, |r| r.fitted.len());
        let mut projection = Self { basis: Vec::new(), made: Vec::new(), fitted, residual, lenses };
        for c in 0..fitted {
            let zeros: Vec<Vec<f64>> = records.iter().map(|r| vec![0.0; r.residual.len()]).collect();
            let parts = records.iter().zip(&zeros).map(|(r, zero)| r.fitted[c].as_ref().unwrap_or(zero).as_slice());
            let column = together(&projection.lenses, &parts.collect::<Vec<_>>());
            projection.take(c, column);
        }
        projection.residual = projection.left(projection.residual.clone()).0;
        projection
    }

    /// A signal (one part for each run) beside what is fitted.
    pub(super) fn added(&self, parts: &[&[f64]]) -> Projected {
        let (direction, mut along) = self.left(together(&self.lenses, parts));
        let mut compensation = vec![0.0; self.fitted];
        for (k, (column, multiples, norm)) in self.made.iter().enumerate().rev() {
            let amount = along[k] / norm;
            compensation[*column] = amount;
            along.iter_mut().zip(multiples).for_each(|(a, m)| *a -= amount * m);
        }
        Projected { direction, compensation }
    }

    /// The product of a projected direction with the residual.
    pub(super) fn along(&self, direction: &[f64]) -> f64 {
        dot(direction, &self.residual)
    }

    /// What a model has explained that leaves this much (one part for each run) of the residual, beside what is fitted.
    pub(super) fn explained(&self, left: &[&[f64]]) -> Vec<f64> {
        let left = self.added(left).direction;
        self.residual.iter().zip(&left).map(|(r, l)| r - l).collect()
    }

    /// Twice the gain that a projected direction predicts, and the multiple of it that does.
    pub(super) fn predicted_gain(&self, direction: &[f64], point: &TrialPoint) -> (f64, f64) {
        let (z, g) = (dot(direction, &self.residual), dot(direction, direction));
        if g <= 0.0 {
            return (0.0, 1.0);
        }
        let amount = point.multiple(z / g);
        (2.0 * amount * z - amount * amount * g, amount)
    }

    /// Variance of a linear function of what is fitted, by its gradient along the first fitted columns; nothing is added by columns
    /// that are made of others.
    pub(super) fn variance(&self, gradient: &[f64]) -> f64 {
        let mut along: Vec<f64> = Vec::with_capacity(self.made.len());
        for (column, multiples, norm) in &self.made {
            let own = gradient.get(*column).copied().unwrap_or(0.0);
            along.push((own - dot(multiples, &along)) / norm);
        }
        dot(&along, &along)
    }

    /// What is left of a column, and its products with the basis.
    fn left(&self, mut column: Vec<f64>) -> (Vec<f64>, Vec<f64>) {
        let mut along = vec![0.0; self.basis.len()];
        // twice is enough (Kahan & Parlett)
        for _ in 0..2 {
            for (own, along) in self.basis.iter().zip(&mut along) {
                let part = dot(own, &column);
                column.iter_mut().zip(own).for_each(|(c, o)| *c -= part * o);
                *along += part;
            }
        }
        (column, along)
    }

    /// Adds a fitted column to the basis, unless it is made of others.
    fn take(&mut self, c: usize, column: Vec<f64>) {
        let whole = dot(&column, &column);
        let (mut left, along) = self.left(column);
        let size = dot(&left, &left);
        if whole <= 0.0 || size <= UNDETERMINED * whole {
            return;
        }
        left.iter_mut().for_each(|v| *v /= size.sqrt());
        self.basis.push(left);
        self.made.push((c, along, size.sqrt()));
    }
}

/// Cosine of the angle between two directions.
pub(super) fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let size = (dot(a, a) * dot(b, b)).sqrt();
    if size > 0.0 { dot(a, b) / size } else { 0.0 }
}

/// Sums that are made side by side: one alone waits for itself at every sample.
const SIDE: usize = 8;

/// Product of two columns.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; SIDE];
    let count = a.len().min(b.len());
    let ((first, ends), (second, others)) = (a[..count].as_chunks::<SIDE>(), b[..count].as_chunks::<SIDE>());
    for (a, b) in first.iter().zip(second) {
        for k in 0..SIDE {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = ends.iter().zip(others).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

/// The parts of all runs through their whitener, one behind the other.
fn together(lenses: &[std::sync::Mutex<Whitener>], parts: &[&[f64]]) -> Vec<f64> {
    let residuals = |(whitener, part): (&std::sync::Mutex<Whitener>, &&[f64])| {
        whitener.lock().unwrap_or_else(std::sync::PoisonError::into_inner).whitened(part)
    };
    lenses.iter().zip(parts).flat_map(residuals).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn errors_of_what_is_fitted_spread_to_what_is_made_of_it() {
        let column =
            |k: usize| -> Vec<f64> { (0..9).map(|i| ((i * (k + 2)) as f64 * 0.7).cos() + 0.3 * k as f64).collect() };
        let mut projection = Projection { basis: vec![], made: vec![], fitted: 4, residual: vec![], lenses: vec![] };
        // the third is made of the others: nothing is known of it, and nothing is added
        let twice: Vec<f64> = column(0).iter().zip(column(1)).map(|(a, b)| 2.0 * a - b).collect();
        [column(0), column(1), twice, column(2)].into_iter().enumerate().for_each(|(c, own)| projection.take(c, own));
        let free = DMatrix::from_fn(9, 3, |i, k| column(k)[i]);
        let covariance = (free.transpose() * &free).try_inverse().expect("three columns");
        let gradient = DVector::from_vec(vec![0.4, -1.1, 2.0]);
        let expected = (gradient.transpose() * covariance * &gradient)[0];
        assert!((projection.variance(&[0.4, -1.1, 7.0, 2.0]) / expected - 1.0).abs() < 1e-9);
        assert_eq!(projection.variance(&[0.4, -1.1]), projection.variance(&[0.4, -1.1, 0.0, 0.0]));
    }
}
