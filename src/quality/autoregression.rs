//! The colour of noise as an autoregression: fitted to autocovariances, and used as a filter.

/// `v(i) = sum of a(k) v(i - k), k = 1.., + e(i)` with white e.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct AutoRegression {
    /// a(1), a(2), ...
    pub(crate) coefficients: Vec<f64>,
    /// Variance of e.
    pub(crate) variance: f64,
    /// Autocovariances of v at lags 0 to the order, which the model has exactly.
    autocovariances: Vec<f64>,
}

/// Prediction errors below this part of the variance are rounding: the series is predictable.
const PREDICTABLE: f64 = 1e-10;

impl AutoRegression {
    /// White noise.
    pub(crate) fn white(variance: f64) -> Self {
        Self { coefficients: Vec::new(), variance, autocovariances: vec![variance] }
    }

    /// The models of order 0, 1, ... that have the given autocovariances (Levinson and Durbin); it ends early where they
    /// belong to no stationary process.
    pub(crate) fn ladder(autocovariances: &[f64]) -> Vec<Self> {
        let Some(total) = autocovariances.first().copied().filter(|v| *v > 0.0 && v.is_finite()) else {
            return vec![Self::white(0.0)];
        };
        let mut ladder = vec![Self::white(total)];
        let (mut a, mut variance): (Vec<f64>, f64) = (Vec::new(), total);
        for order in 1..autocovariances.len() {
            let predicted: f64 = a.iter().zip(autocovariances[1..order].iter().rev()).map(|(a, r)| a * r).sum();
            let reflection = (autocovariances[order] - predicted) / variance;
            variance *= 1.0 - reflection * reflection;
            if !(reflection.abs() < 1.0 && variance > PREDICTABLE * total) {
                break;
            }
            let turned: Vec<f64> = a.iter().rev().copied().collect();
            a.iter_mut().zip(turned).for_each(|(a, b)| *a -= reflection * b);
            a.push(reflection);
            let autocovariances = autocovariances[..=order].to_vec();
            ladder.push(Self { coefficients: a.clone(), variance, autocovariances });
        }
        ladder
    }

    /// The model of the order that a criterion likes best: n log(variance) plus `price` for each coefficient.
    pub(crate) fn best(ladder: &[Self], samples: usize, price: f64) -> Option<&Self> {
        let criterion = |m: &Self| samples as f64 * m.variance.ln() + price * m.coefficients.len() as f64;
        ladder.iter().min_by(|a, b| criterion(a).total_cmp(&criterion(b)))
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
    /// the rows s of `width` numbers, behind as many empty ones as innovations before the first place matter; b replaces
    /// them.
    pub(crate) fn backward(&self, rows: &mut [f64], width: usize) {
        let count = rows.len() / width.max(1);
        for i in (0..count).rev() {
            let (head, later) = rows.split_at_mut((i + 1) * width);
            let row = &mut head[i * width..];
            for (a, next) in self.coefficients.iter().zip(later.chunks(width)) {
                row.iter_mut().zip(next).for_each(|(b, n)| *b += a * n);
            }
        }
    }

    /// Rows g with `g(i) = b(i) + sum of a(k) g(i - k)`; with the variance as factor they are the autocovariance matrix times
    /// what [`Self::backward`] was given.
    pub(crate) fn forward(&self, rows: &mut [f64], width: usize) {
        let count = rows.len() / width.max(1);
        for i in 0..count {
            let (earlier, tail) = rows.split_at_mut(i * width);
            let row = &mut tail[..width];
            for (a, before) in self.coefficients.iter().zip(earlier.rchunks(width)) {
                row.iter_mut().zip(before).for_each(|(g, b)| *g += a * b);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// v(i) = 1.2 v(i-1) - 0.6 v(i-2) + e(i)
    fn resonant() -> AutoRegression {
        let (a, b) = (1.2, -0.6);
        let r1 = a / (1.0 - b);
        let r = [1.0, r1, a * r1 + b, a * (a * r1 + b) + b * r1];
        AutoRegression::ladder(&r).swap_remove(2)
    }

    #[test]
    fn autocovariances_give_the_coefficients_and_the_order() {
        let model = resonant();
        assert!((model.coefficients[0] - 1.2).abs() < 1e-14 && (model.coefficients[1] + 0.6).abs() < 1e-14);
        let ladder = AutoRegression::ladder(&model.autocovariances(10));
        assert_eq!(ladder.len(), 11);
        assert!(ladder[10].coefficients[2..].iter().all(|a| a.abs() < 1e-14));
        assert_eq!(AutoRegression::best(&ladder, 1000, 2.0).map(|m| m.coefficients.len()), Some(2));
        // no stationary process has a correlation above one
        assert_eq!(AutoRegression::ladder(&[1.0, 0.5, 2.0]).len(), 2);
        assert_eq!(AutoRegression::ladder(&[0.0, 0.0]), [AutoRegression::white(0.0)]);
    }

    #[test]
    fn both_filters_are_the_autocovariance_matrix() {
        let model = resonant();
        let (n, width) = (40, 2);
        let s: Vec<f64> = (0..n * width).map(|k| (k as f64 * 0.37).sin()).collect();
        let memory = model.memory(1000);
        assert!(memory > 10 && memory < 60, "{memory}");
        let mut rows = vec![0.0; 4 * memory * width];
        rows.extend(&s);
        model.backward(&mut rows, width);
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
