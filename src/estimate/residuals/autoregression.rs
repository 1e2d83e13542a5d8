//! The colour of a series as an autoregression: from its autocovariances by the recursion of Levinson and Durbin (Durbin 1960), of an order that a criterion
//! chooses, and its use as a filter over rows.

use super::autocovariance::Lagged;
use fdm_numeric::lanes::{Simd, WithSimd, dispatch};

/// `v(i) = sum of a(k) v(i - k), k = 1.., + e(i)` with white e.
#[derive(Debug, Clone, PartialEq)]
pub struct AutoRegression {
    /// a(1), a(2), ...
    pub coefficients: Vec<f64>,
    /// Variance of e.
    pub variance: f64,
    /// Autocovariances of v at lags 0 to the order, which the model has exactly.
    autocovariances: Vec<f64>,
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
        if self.coefficients.is_empty() {
            return;
        }
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

/// Prediction errors below this part of the variance are rounding: the series is predictable.
const PREDICTABLE: f64 = 1e-10;

/// The models of order 0, 1, ... that have the given autocovariances, as far as they belong to a stationary process.
pub struct LevinsonDurbin<'r> {
    autocovariances: &'r [f64],
    /// The last coefficient of the models of order 1, 2, ...
    reflections: Vec<f64>,
    /// Variances of the innovations for order 0, 1, ...
    variances: Vec<f64>,
    /// Their logarithms, which the choice of an order asks for many times.
    logarithms: Vec<f64>,
}

impl<'r> LevinsonDurbin<'r> {
    /// Climbs as high as the autocovariances at lags 0, 1, ... allow.
    pub fn of(autocovariances: &'r [f64]) -> Self {
        let total = autocovariances.first().copied().filter(|v| *v > 0.0 && v.is_finite());
        let variances = vec![total.unwrap_or(0.0)];
        let mut models = Self { autocovariances, reflections: Vec::new(), logarithms: Vec::new(), variances };
        let Some(total) = total else { return models.with_logarithms() };
        let (mut a, mut variance): (Vec<f64>, f64) = (Vec::with_capacity(autocovariances.len()), total);
        for order in 1..autocovariances.len() {
            let predicted = against(&a, &autocovariances[1..order]);
            let reflection = (autocovariances[order] - predicted) / variance;
            variance *= 1.0 - reflection * reflection;
            if !(reflection.abs() < 1.0 && variance > PREDICTABLE * total) {
                break;
            }
            climb(&mut a, reflection);
            models.reflections.push(reflection);
            models.variances.push(variance);
        }
        models.with_logarithms()
    }

    fn with_logarithms(mut self) -> Self {
        self.logarithms = self.variances.iter().map(|v| v.ln()).collect();
        self
    }

    /// The highest order.
    pub(crate) fn highest(&self) -> usize {
        self.reflections.len()
    }

    /// The order that a criterion likes best: n log(variance) plus `penalty` for each coefficient.
    pub(crate) fn best(&self, samples: usize, penalty: f64) -> usize {
        let criterion = |order: &usize| samples as f64 * self.logarithms[*order] + penalty * *order as f64;
        (0..=self.highest()).min_by(|a, b| criterion(a).total_cmp(&criterion(b))).unwrap_or(0)
    }

    /// The model of an order, at most the highest.
    pub fn model(&self, order: usize) -> AutoRegression {
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

/// The sum of products of the first of one with the last of the other, and so on; both are of one length.
fn against(a: &[f64], r: &[f64]) -> f64 {
    let ((a, rest), (first, r)) = (a.as_chunks::<4>(), r.as_rchunks::<4>());
    // four sums, so that none waits for the one before
    let mut sums = [0.0; 4];
    for (a, r) in a.iter().zip(r.iter().rev()) {
        (0..4).for_each(|l| sums[l] += a[l] * r[3 - l]);
    }
    let rest: f64 = rest.iter().zip(first.iter().rev()).map(|(a, r)| a * r).sum();
    (sums[0] + sums[2]) + (sums[1] + sums[3]) + rest
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

/// Highest order: the longest lag whose correlation is used.
const MOST_ORDER: usize = 60;
/// Samples for each lag.
const SAMPLES_PER_LAG: usize = 8;
/// Penalty per coefficient of coloured noise, in n log(variance); docs/notebook/decisions.md says how it was chosen.
const PENALTY: f64 = 0.7;

/// Highest order of an autoregression that so many samples determine.
pub(crate) fn most_order(samples: usize) -> usize {
    (samples / SAMPLES_PER_LAG).min(MOST_ORDER)
}

/// The autoregression for autocovariances that so many samples gave: none at all (white noise) unless Schwarz's criterion
/// wants one, and then of a higher order than Schwarz and Akaike would choose, since what is too short is biased and what
/// is too long only uncertain.
pub(crate) fn choose(autocovariances: &[f64], samples: usize) -> AutoRegression {
    let models = LevinsonDurbin::of(autocovariances);
    match models.best(samples, (samples.max(2) as f64).ln()) {
        0 => AutoRegression::white(autocovariances.first().copied().unwrap_or(0.0).max(0.0)),
        _ => models.model(models.best(samples, PENALTY)),
    }
}

/// The colour of one series (NaN where there is no value) by itself.
pub(crate) fn of_series(series: &[f64]) -> AutoRegression {
    let (autocovariances, present) = tapered(series);
    choose(&autocovariances, present)
}

/// The colour of one series by Schwarz's criterion alone: rather too short than uncertain, where the series is a
/// statistic and a model of it is all that is wanted.
pub(crate) fn short_of_series(series: &[f64]) -> AutoRegression {
    let (autocovariances, present) = tapered(series);
    let models = LevinsonDurbin::of(&autocovariances);
    models.model(models.best(present, (present.max(2) as f64).ln()))
}

/// The autocovariances of a series, and how many values it has.
fn tapered(series: &[f64]) -> (Vec<f64>, usize) {
    let present = series.iter().filter(|v| !v.is_nan()).count();
    let lagged = Lagged::of(series, most_order(present));
    let length = series.len().max(1) as f64;
    // tapered as the sums of a series without gaps are, so that they belong to a stationary process
    let means = lagged.means().enumerate().map(|(k, mean)| mean * (1.0 - k as f64 / length));
    (means.collect(), present)
}

/// From which side a recurrence runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    Forward,
    Backward,
}

/// Adds to each row the rows before it (behind it, when run backward), weighed by the coefficients, the nearest by the first.
/// Rows have `width` numbers, a multiple of 8.
pub(super) fn recur(coefficients: &[f64], rows: &mut [f64], width: usize, direction: Direction) {
    if width > 0 && !coefficients.is_empty() {
        dispatch(Recurrence { coefficients, rows, width, direction });
    }
}

struct Recurrence<'a> {
    coefficients: &'a [f64],
    rows: &'a mut [f64],
    width: usize,
    direction: Direction,
}

impl WithSimd for Recurrence<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let across = self.width / S::F64_LANES;
        let mut vector = 0;
        while vector < across {
            let tile = (across - vector).min(4);
            match tile {
                1 => self.tile::<S, 1>(simd, vector),
                2 => self.tile::<S, 2>(simd, vector),
                3 => self.tile::<S, 3>(simd, vector),
                _ => self.tile::<S, 4>(simd, vector),
            }
            vector += tile;
        }
    }
}

impl Recurrence<'_> {
    /// All rows of C vectors. The far rows are added first, since the nearest one has only just been computed.
    #[inline(always)]
    fn tile<S: Simd, const C: usize>(&mut self, simd: S, vector: usize) {
        let across = self.width / S::F64_LANES;
        let rows = S::as_mut_simd_f64s(self.rows).0;
        let count = rows.len() / across;
        for step in 0..count {
            let row = if self.direction == Direction::Forward { step } else { count - 1 - step };
            let (mut even, mut odd) = ([simd.splat_f64s(0.0); C], [simd.splat_f64s(0.0); C]);
            let reach = self.coefficients.len().min(step);
            for (k, a) in self.coefficients[..reach].iter().enumerate().rev() {
                let from = if self.direction == Direction::Forward { row - 1 - k } else { row + 1 + k };
                let Some(from) = rows[from * across + vector..].first_chunk::<C>() else { return };
                let (a, sums) = (simd.splat_f64s(*a), if k % 2 == 0 { &mut even } else { &mut odd });
                for c in 0..C {
                    sums[c] = simd.mul_add_f64s(a, from[c], sums[c]);
                }
            }
            let Some(to) = rows[row * across + vector..].first_chunk_mut::<C>() else { return };
            for c in 0..C {
                to[c] = simd.add_f64s(to[c], simd.add_f64s(odd[c], even[c]));
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
        LevinsonDurbin::of(&r).model(2)
    }

    #[test]
    fn autocovariances_give_the_coefficients_and_the_order() {
        let model = resonant();
        assert!((model.coefficients[0] - 1.2).abs() < 1e-14 && (model.coefficients[1] + 0.6).abs() < 1e-14);
        let r = model.autocovariances(10);
        let models = LevinsonDurbin::of(&r);
        assert_eq!((models.highest(), models.best(1000, 2.0)), (10, 2));
        assert!(models.model(10).coefficients[2..].iter().all(|a| a.abs() < 1e-14));
        // no stationary process has a correlation above one
        assert_eq!(LevinsonDurbin::of(&[1.0, 0.5, 2.0]).highest(), 1);
        assert_eq!(LevinsonDurbin::of(&[0.0, 0.0]).model(0), AutoRegression::white(0.0));
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

#[cfg(test)]
mod order_tests {
    use super::*;

    #[test]
    fn alternating_values_are_coloured_and_a_gap_does_not_hide_it() {
        let mut series: Vec<f64> =
            (0..400).map(|k| if k % 2 == 0 { 1.0 } else { -1.0 } + 0.3 * f64::from(k * k % 17 - 8)).collect();
        series[100..150].fill(f64::NAN);
        let model = of_series(&series);
        assert!(!model.coefficients.is_empty() && model.variance.is_finite(), "{model:?}");
        assert_eq!(choose(&[2.0, 0.01, -0.02, 0.0], 400), AutoRegression::white(2.0));
        assert_eq!(of_series(&[f64::NAN; 5]), AutoRegression::white(0.0));
    }
}
