//! Which autoregression describes the colour of residuals: its order is what they can tell.

use super::autocovariance::Lagged;
use super::autoregression::AutoRegression;
use super::ladder::Ladder;

/// Highest order: the longest lag whose correlation is used.
const MOST_ORDER: usize = 60;
/// Samples for each lag.
const SAMPLES_PER_LAG: usize = 8;
/// Price of a coefficient of coloured noise, in n log(variance); docs/statistics.md tells how it was chosen.
const PRICE: f64 = 0.7;

/// Highest order of an autoregression that so many samples can tell.
pub(crate) fn most_order(samples: usize) -> usize {
    (samples / SAMPLES_PER_LAG).min(MOST_ORDER)
}

/// The autoregression for autocovariances that so many samples gave: none at all (white noise) unless Schwarz's criterion
/// wants one, and then of a higher order than Schwarz and Akaike would choose, since what is too short is biased and what
/// is too long only uncertain.
pub(crate) fn choose(autocovariances: &[f64], samples: usize) -> AutoRegression {
    let ladder = Ladder::of(autocovariances);
    match ladder.best(samples, (samples.max(2) as f64).ln()) {
        0 => AutoRegression::white(autocovariances.first().copied().unwrap_or(0.0).max(0.0)),
        _ => ladder.model(ladder.best(samples, PRICE)),
    }
}

/// The colour of one series (NaN where there is no value) by itself.
pub(crate) fn of_series(series: &[f64]) -> AutoRegression {
    let present = series.iter().filter(|v| !v.is_nan()).count();
    let lagged = Lagged::of(series, most_order(present));
    let length = series.len().max(1) as f64;
    // tapered as the sums of a series without gaps are, so that they belong to a stationary process
    let means = lagged.means().enumerate().map(|(k, mean)| mean * (1.0 - k as f64 / length));
    choose(&means.collect::<Vec<_>>(), present)
}

#[cfg(test)]
mod tests {
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
