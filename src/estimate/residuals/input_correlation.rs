//! Whether residuals correlate with an input: then something that the input does is missing in the model.

use super::autocovariance::{add_lagged_products, inner};
use super::autoregression::AutoRegression;
use super::whiteness::normal_beyond;
use serde::{Deserialize, Serialize};

/// Lags on either side.
const LAGS: usize = 50;
/// Part of the record up to which an input may act.
const REACH: usize = 10;
/// Part of the input's power that has to meet residuals at a lag.
const LEAST_PART: f64 = 0.2;
/// Correlations count below this p-value.
const SIGNIFICANT: f64 = 0.01;

/// Correlation of the residuals of one output with one input, lag by lag.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct InputCorrelation {
    /// Name of the input.
    pub input: String,
    /// Time by which the residual follows the input; negative where it leads.
    pub lags: Vec<f64>,
    /// Correlation at each lag.
    pub correlation: Vec<f64>,
    /// Two standard deviations of each for residuals of the same colour that have nothing to do with this input.
    pub bounds: Vec<f64>,
    /// Lags beyond their bound.
    pub outside: usize,
    /// The lag that is furthest beyond what chance explains.
    pub largest_lag: f64,
    /// The correlation there.
    pub largest: f64,
    /// Probability of one as large at any of the lags by chance (Bonferroni's bound).
    pub p_value: f64,
}

impl InputCorrelation {
    /// Whether chance does not explain the largest correlation (at one percent).
    pub fn is_significant(&self) -> bool {
        self.p_value < SIGNIFICANT
    }

    /// Correlates residuals (about their mean, NaN where there is none) of known colour with an input, both on one even grid;
    /// none when the input does not move.
    ///
    /// The input is known, so the bounds are those of the sum of `u(i - lag) v(i)` under the autocovariance of v: its
    /// innovations, one by one, through the autoregression run backward over the input.
    pub(super) fn new(
        name: &str,
        residuals: &[f64],
        input: &[f64],
        colour: &AutoRegression,
        interval: f64,
    ) -> Option<Self> {
        let filled = filled(residuals);
        let input = moving(input)?;
        let n = filled.len();
        let furthest = (n / REACH).max(1);
        let step = furthest.div_ceil(LAGS).max(1);
        let places = (furthest / step) as i64;
        let norm = (square(&filled) * square(&input)).sqrt();
        let spread = spread(residuals, &input, colour) / norm;
        // what of the input meets a residual at each lag
        let met: Vec<f64> = residuals.iter().map(|v| if v.is_nan() { 0.0 } else { 1.0 }).collect();
        let power: Vec<f64> = input.iter().map(|u| u * u).collect();
        let [mut before, mut behind] = [vec![0.0; places as usize + 1], vec![0.0; places as usize + 1]];
        add_lagged_products(&power, &met, step, &mut before);
        add_lagged_products(&met, &power, step, &mut behind);
        let whole = before[0];
        let mut found = Self::empty(name);
        let mut largest_ratio = -1.0;
        let [mut following, mut leading] = [vec![0.0; places as usize + 1], vec![0.0; places as usize + 1]];
        add_lagged_products(&input, &filled, step, &mut following);
        add_lagged_products(&filled, &input, step, &mut leading);
        for place in -places..=places {
            let lag = place * step as i64;
            let r = if place >= 0 { &following } else { &leading }[place.unsigned_abs() as usize] / norm;
            let part = if place >= 0 { &before } else { &behind }[place.unsigned_abs() as usize] / whole;
            if part.is_nan() || part < LEAST_PART {
                continue;
            }
            let deviation = spread * part.sqrt();
            let time = lag as f64 * interval;
            if r.abs() / deviation > largest_ratio {
                (largest_ratio, found.largest_lag, found.largest) = (r.abs() / deviation, time, r);
            }
            found.outside += usize::from(r.abs() > 2.0 * deviation);
            found.lags.push(time);
            found.correlation.push(r);
            found.bounds.push(2.0 * deviation);
        }
        if !(spread > 0.0 && largest_ratio.is_finite()) {
            return None;
        }
        found.p_value = (normal_beyond(largest_ratio) * found.lags.len() as f64).min(1.0);
        Some(found)
    }

    fn empty(name: &str) -> Self {
        let none = Vec::new;
        let (lags, correlation, bounds) = (none(), none(), none());
        Self { input: name.into(), lags, correlation, bounds, outside: 0, largest_lag: 0.0, largest: 0.0, p_value: 1.0 }
    }
}

/// Standard deviation of the sum of `u(i) v(i)` over the places where v is present.
fn spread(residuals: &[f64], input: &[f64], colour: &AutoRegression) -> f64 {
    let memory = colour.memory(residuals.len());
    let mut rows = vec![0.0; memory];
    rows.extend(residuals.iter().zip(input).map(|(v, u)| if v.is_nan() { 0.0 } else { *u }));
    colour.backward_series(&mut rows);
    (colour.variance * square(&rows)).sqrt()
}

/// Zeros for what is missing.
fn filled(series: &[f64]) -> Vec<f64> {
    series.iter().map(|v| if v.is_nan() { 0.0 } else { *v }).collect()
}

/// The input about its mean, zero where it is not known; none when it does not move.
fn moving(input: &[f64]) -> Option<Vec<f64>> {
    let known = || input.iter().filter(|u| u.is_finite());
    let count = known().count().max(1) as f64;
    let mean = known().sum::<f64>() / count;
    let size = known().fold(0.0_f64, |m, u| m.max(u.abs()));
    let moved: Vec<f64> = input.iter().map(|u| if u.is_finite() { u - mean } else { 0.0 }).collect();
    (square(&moved) > count * (4.0 * f64::EPSILON * size).powi(2)).then_some(moved)
}

fn square(values: &[f64]) -> f64 {
    inner(values, values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::residuals::autoregression;
    use fdm_numeric::random::Normal;

    /// An input of slow steps, as pilots fly them.
    fn steps(n: usize) -> Vec<f64> {
        (0..n).map(|k| f64::from(u8::from(k / 40 % 3 == 1)) - f64::from(u8::from(k / 40 % 3 == 2))).collect()
    }

    /// Noise of a colour: v(i) = keep v(i-1) + e(i).
    fn coloured(n: usize, keep: f64, seed: u64) -> Vec<f64> {
        let (mut normal, mut v) = (Normal(seed), 0.0);
        (0..n + 100).map(|_| (v, v = keep * v + normal.next()).0).skip(100).collect()
    }

    #[test]
    fn coloured_residuals_that_have_nothing_to_do_with_the_input_pass() {
        // with bounds for white residuals nearly all of these would be significant
        let (mut significant, mut outside, mut lags) = (0, 0, 0);
        for seed in 0..200 {
            let v = coloured(600, 0.9, 1 + seed * 104_729);
            let found =
                InputCorrelation::new("u", &v, &steps(600), &autoregression::of_series(&v), 0.1).expect("moves");
            significant += usize::from(found.is_significant());
            (outside, lags) = (outside + found.outside, lags + found.lags.len());
        }
        let share = outside as f64 / lags as f64;
        assert!(significant <= 6, "{significant} of 200 at one percent");
        assert!((0.02..0.09).contains(&share), "{share} beyond two sigma");
    }

    #[test]
    fn what_the_input_does_too_late_is_found_at_its_lag() {
        let u = steps(600);
        let mut v = coloured(600, 0.5, 5);
        (12..600).for_each(|k| v[k] += u[k - 12]);
        let found = InputCorrelation::new("u", &v, &u, &autoregression::of_series(&v), 0.1).expect("moves");
        assert!(found.is_significant() && (found.largest_lag - 1.2).abs() < 0.25, "{}", found.largest_lag);
        assert!(found.largest > 0.3);
        assert_eq!(InputCorrelation::new("u", &v, &[3.0; 600], &autoregression::of_series(&v), 0.1), None);
    }
}
