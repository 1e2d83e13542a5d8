//! The colour of noise as an autoregression: its autocovariances, and its use as a filter.

use super::recurrence::{Direction, recur};

/// `v(i) = sum of a(k) v(i - k), k = 1.., + e(i)` with white e.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct AutoRegression {
    /// a(1), a(2), ...
    pub(crate) coefficients: Vec<f64>,
    /// Variance of e.
    pub(crate) variance: f64,
    /// Autocovariances of v at lags 0 to the order, which the model has exactly.
    pub(super) autocovariances: Vec<f64>,
}

impl AutoRegression {
    /// White noise.
    pub(crate) fn white(variance: f64) -> Self {
        Self { coefficients: Vec::new(), variance, autocovariances: vec![variance] }
    }

    /// Autocovariances at lags 0 to `most`.
    pub(crate) fn autocovariances(&self, most: usize) -> Vec<f64> {
        let mut r = self.autocovariances.clone();
        r.truncate(most + 1);
        for k in r.len()..=most {
            let next = self.coefficients.iter().zip(r[..k].iter().rev()).map(|(a, r)| a * r).sum();
            r.push(next);
        }
        r
    }

    /// What n times the variance of a mean of n values comes to, for large n: the spectrum at frequency zero.
    pub(crate) fn long_run_variance(&self) -> f64 {
        self.variance / (1.0 - self.coefficients.iter().sum::<f64>()).powi(2)
    }

    /// The innovations e of a series; NaN where a value, or one that it follows from, is missing.
    pub(crate) fn innovations(&self, series: &[f64]) -> Vec<f64> {
        /// What stays in the nearest cache.
        const BLOCK: usize = 1024;
        let order = self.coefficients.len().min(series.len());
        let mut innovations = vec![f64::NAN; order];
        innovations.extend(&series[order..]);
        for (block, to) in innovations[order..].chunks_mut(BLOCK).enumerate() {
            for (k, a) in self.coefficients.iter().enumerate() {
                let from = &series[block * BLOCK + order - 1 - k..][..to.len()];
                to.iter_mut().zip(from).for_each(|(e, v)| *e -= a * v);
            }
        }
        innovations
    }

    /// How many places before the first one the innovations still matter: until their influence has fallen to one part
    /// in a thousand of its largest, at most `most`.
    pub(crate) fn memory(&self, most: usize) -> usize {
        let order = self.coefficients.len();
        let (mut response, mut last, mut largest) = (vec![1.0], 0, 1.0_f64);
        for k in 1..=most {
            let near = self.coefficients.iter().zip(response.iter().rev());
            let next: f64 = near.map(|(a, h)| a * h).sum();
            response.push(next);
            largest = largest.max(next.abs());
            if next.abs() > 1e-3 * largest {
                last = k;
            }
            if k > last + 4 * order + 8 {
                break;
            }
        }
        last + order
    }

    /// Rows b with `b(i) = s(i) + sum of a(k) b(i + k)`: what each innovation does to the sum of `s(i)' v(i)`. `rows` holds
    /// the rows s of `width` numbers (a multiple of 8), behind as many empty ones as innovations before the first place
    /// matter; b replaces them.
    pub(crate) fn backward(&self, rows: &mut [f64], width: usize) {
        recur(&self.coefficients, rows, width, Direction::Backward);
    }

    /// Rows g with `g(i) = b(i) + sum of a(k) g(i - k)`; with the variance as factor they are the autocovariance matrix times
    /// what [`Self::backward`] was given.
    pub(crate) fn forward(&self, rows: &mut [f64], width: usize) {
        recur(&self.coefficients, rows, width, Direction::Forward);
    }

    /// As [`Self::backward`], for one series.
    pub(crate) fn backward_series(&self, series: &mut [f64]) {
        for i in (0..series.len()).rev() {
            let (head, later) = series.split_at_mut(i + 1);
            let reach = self.coefficients.len().min(later.len());
            let (a, later) = (self.coefficients[..reach].as_chunks::<4>(), later[..reach].as_chunks::<4>());
            let mut sums = [0.0; 4];
            for (a, b) in a.0.iter().zip(later.0) {
                (0..4).for_each(|l| sums[l] += a[l] * b[l]);
            }
            let rest: f64 = a.1.iter().zip(later.1).map(|(a, b)| a * b).sum();
            head[i] += (sums[0] + sums[2]) + (sums[1] + sums[3]) + rest;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::ladder::Ladder;

    /// v(i) = 1.2 v(i-1) - 0.6 v(i-2) + e(i)
    fn resonant() -> AutoRegression {
        let (a, b) = (1.2, -0.6);
        let r1 = a / (1.0 - b);
        let r = [1.0, r1, a * r1 + b, a * (a * r1 + b) + b * r1];
        Ladder::of(&r).model(2)
    }

    #[test]
    fn autocovariances_give_the_coefficients_and_the_order() {
        let model = resonant();
        assert!((model.coefficients[0] - 1.2).abs() < 1e-14 && (model.coefficients[1] + 0.6).abs() < 1e-14);
        let r = model.autocovariances(10);
        let ladder = Ladder::of(&r);
        assert_eq!((ladder.highest(), ladder.best(1000, 2.0)), (10, 2));
        assert!(ladder.model(10).coefficients[2..].iter().all(|a| a.abs() < 1e-14));
        // no stationary process has a correlation above one
        assert_eq!(Ladder::of(&[1.0, 0.5, 2.0]).highest(), 1);
        assert_eq!(Ladder::of(&[0.0, 0.0]).model(0), AutoRegression::white(0.0));
    }

    #[test]
    fn innovations_are_what_the_past_does_not_tell() {
        let model = resonant();
        let series: Vec<f64> = (0..3000).map(|k| (f64::from(k) * 0.37).sin()).collect();
        let found = model.innovations(&series);
        assert!(found[0].is_nan() && found[1].is_nan() && found.len() == 3000);
        for i in 2..3000 {
            assert!((found[i] - (series[i] - 1.2 * series[i - 1] + 0.6 * series[i - 2])).abs() < 1e-13);
        }
        assert!(model.innovations(&[1.0])[0].is_nan());
    }

    #[test]
    fn both_filters_are_the_autocovariance_matrix() {
        let model = resonant();
        let (n, width) = (40, 24);
        let s: Vec<f64> = (0..n * width).map(|k| (k as f64 * 0.37).sin()).collect();
        let memory = model.memory(1000);
        assert!(memory > 10 && memory < 60, "{memory}");
        let mut rows = vec![0.0; 4 * memory * width];
        rows.extend(&s);
        let mut one: Vec<f64> = rows.iter().skip(5).step_by(width).copied().collect();
        model.backward_series(&mut one);
        model.backward(&mut rows, width);
        let same = one.iter().zip(rows.iter().skip(5).step_by(width)).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(same, "one series alone");
        model.forward(&mut rows, width);
        let r = model.autocovariances(n);
        for i in 0..n {
            for c in 0..width {
                let want: f64 = (0..n).map(|j| r[i.abs_diff(j)] * s[j * width + c]).sum();
                let got = model.variance * rows[(4 * memory + i) * width + c];
                assert!((got - want).abs() < 1e-9, "{i} {c}: {got} {want}");
            }
        }
    }
}
