//! Sums of lagged products of a series with gaps.

use super::lagged::add_lagged_products;

/// Products of a series with itself, lag by lag, over the pairs that are present.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lagged {
    /// Sum of `v(i) v(i+k)` for k = 0, 1, ...
    pub(crate) sums: Vec<f64>,
    /// Pairs in each sum.
    pub(crate) pairs: Vec<usize>,
}

impl Lagged {
    /// No pair yet, for lags 0 to `most`.
    pub(crate) fn none(most: usize) -> Self {
        Self { sums: vec![0.0; most + 1], pairs: vec![0; most + 1] }
    }

    /// Adds a series; NaN where there is no value.
    pub(crate) fn add(&mut self, series: &[f64]) {
        let present: Vec<bool> = series.iter().map(|v| !v.is_nan()).collect();
        let filled: Vec<f64> = series.iter().map(|v| if v.is_nan() { 0.0 } else { *v }).collect();
        let whole = present.iter().all(|p| *p);
        add_lagged_products(&filled, &filled, 1, &mut self.sums);
        for k in 0..self.sums.len().min(series.len()) {
            self.pairs[k] += match whole {
                true => series.len() - k,
                false => present.iter().zip(&present[k..]).filter(|(a, b)| **a && **b).count(),
            };
        }
    }

    /// The sums of one series.
    pub(crate) fn of(series: &[f64], most: usize) -> Self {
        let mut lagged = Self::none(most.min(series.len().saturating_sub(1)));
        lagged.add(series);
        lagged
    }

    /// Mean products for lags 0, 1, ...; zero where there is no pair.
    pub(crate) fn means(&self) -> impl Iterator<Item = f64> {
        self.sums.iter().zip(&self.pairs).map(|(sum, pairs)| sum / (*pairs).max(1) as f64)
    }

    /// Autocorrelations for lags 1, 2, ...: sums relative to that of lag 0.
    pub(crate) fn correlations(&self) -> impl Iterator<Item = f64> {
        self.sums[1..].iter().map(|s| s / self.sums[0])
    }
}

/// The values without their mean; NaN stays.
pub(crate) fn centred(mut series: Vec<f64>) -> Vec<f64> {
    let present = || series.iter().filter(|v| !v.is_nan());
    let mean = present().sum::<f64>() / present().count().max(1) as f64;
    series.iter_mut().for_each(|v| *v -= mean);
    series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_across_a_gap_count_and_missing_values_do_not() {
        let lagged = Lagged::of(&[1.0, 2.0, f64::NAN, 3.0], 5);
        assert_eq!(lagged, Lagged { sums: vec![14.0, 2.0, 6.0, 3.0], pairs: vec![3, 1, 1, 1] });
        assert_eq!(centred(vec![1.0, f64::NAN, 3.0])[2], 1.0);
    }
}
