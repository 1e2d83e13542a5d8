//! Autoregressions of rising order with given autocovariances (Levinson and Durbin), and the order that a criterion wants.

use super::autoregression::AutoRegression;

/// Prediction errors below this part of the variance are rounding: the series is predictable.
const PREDICTABLE: f64 = 1e-10;

/// The models of order 0, 1, ... that have the given autocovariances, as far as they belong to a stationary process.
pub(crate) struct Ladder<'r> {
    autocovariances: &'r [f64],
    /// The last coefficient of the models of order 1, 2, ...
    reflections: Vec<f64>,
    /// Variances of the innovations for order 0, 1, ...
    variances: Vec<f64>,
}

impl<'r> Ladder<'r> {
    /// Climbs as high as the autocovariances at lags 0, 1, ... allow.
    pub(crate) fn of(autocovariances: &'r [f64]) -> Self {
        let total = autocovariances.first().copied().filter(|v| *v > 0.0 && v.is_finite());
        let mut ladder = Self { autocovariances, reflections: Vec::new(), variances: vec![total.unwrap_or(0.0)] };
        let Some(total) = total else { return ladder };
        let (mut a, mut variance): (Vec<f64>, f64) = (Vec::with_capacity(autocovariances.len()), total);
        for order in 1..autocovariances.len() {
            let predicted: f64 = a.iter().zip(autocovariances[1..order].iter().rev()).map(|(a, r)| a * r).sum();
            let reflection = (autocovariances[order] - predicted) / variance;
            variance *= 1.0 - reflection * reflection;
            if !(reflection.abs() < 1.0 && variance > PREDICTABLE * total) {
                break;
            }
            climb(&mut a, reflection);
            ladder.reflections.push(reflection);
            ladder.variances.push(variance);
        }
        ladder
    }

    /// The highest order.
    pub(crate) fn highest(&self) -> usize {
        self.reflections.len()
    }

    /// The order that a criterion likes best: n log(variance) plus `price` for each coefficient.
    pub(crate) fn best(&self, samples: usize, price: f64) -> usize {
        let criterion = |order: &usize| samples as f64 * self.variances[*order].ln() + price * *order as f64;
        (0..=self.highest()).min_by(|a, b| criterion(a).total_cmp(&criterion(b))).unwrap_or(0)
    }

    /// The model of an order, at most the highest.
    pub(crate) fn model(&self, order: usize) -> AutoRegression {
        let order = order.min(self.highest());
        if order == 0 {
            return AutoRegression::white(self.variances[0]);
        }
        let mut coefficients = Vec::with_capacity(order);
        self.reflections[..order].iter().for_each(|r| climb(&mut coefficients, *r));
        let autocovariances = self.autocovariances[..=order].to_vec();
        AutoRegression { coefficients, variance: self.variances[order], autocovariances }
    }
}

/// From the coefficients of one order to those of the next.
fn climb(a: &mut Vec<f64>, reflection: f64) {
    let n = a.len();
    for k in 0..n.div_ceil(2) {
        let (first, last) = (a[k], a[n - 1 - k]);
        a[k] = first - reflection * last;
        a[n - 1 - k] = last - reflection * first;
    }
    a.push(reflection);
}
