//! Residuals in bands of frequency: a fault is judged beside noise, and model error, with a spectrum of its own.
//!
//! The cosine transform of a series is nearly uncorrelated whatever its spectrum, and has no jump from the last sample to the first (Ahmed,
//! Natarajan and Rao 1974). So the likelihood is Whittle's, with one variance for each band: what a model lacks slowly raises few bands, and a
//! fault that takes it away gains in those alone.

use fdm_numeric::fourier::CosineTransform;
use std::f64::consts::PI;

/// Octaves from the Nyquist frequency downwards; the last one reaches down to the mean.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bands {
    /// Sum of squares of the coefficients of each band, scaled so that all together are the sum of squares of the series.
    squares: Vec<f64>,
    /// Coefficients of each band.
    counts: Vec<f64>,
}

impl Bands {
    /// For series of so many samples at most: the last octave has four coefficients at least.
    pub(crate) fn new(samples: usize) -> Self {
        let octaves = (samples / 4).checked_ilog2().unwrap_or(0) as usize + 1;
        Self { squares: vec![0.0; octaves], counts: vec![0.0; octaves] }
    }

    /// Adds a series, whose gaps are left out already. `noise` is the part of white noise that is left at an angle per sample, which was no
    /// merit of what left it.
    pub(crate) fn add(&mut self, series: &mut [f64], noise: impl Fn(f64) -> f64) {
        let n = series.len();
        if n == 0 {
            return;
        }
        CosineTransform::new(n).forward(series);
        let last = self.squares.len() - 1;
        for (k, x) in series.iter().enumerate() {
            let octave = (n.checked_div(k).map_or(last, |ratio| ratio.ilog2() as usize)).min(last);
            let scale = if k == 0 { 1.0 } else { 2.0 } / n as f64;
            self.squares[octave] += scale * x * x / noise(PI * k as f64 / n as f64);
            self.counts[octave] += 1.0;
        }
    }

    /// Beside the same bands of what was measured, about its mean and with this variance: a column that takes the place of another one is judged
    /// by what is left of itself.
    pub(crate) fn relative_to(mut self, measured: &Self, variance: f64) -> Self {
        /// Of a deviation: responses are computed to this part, and what is smaller says nothing.
        const ACCURACY: f64 = 1e-5;
        let least = ACCURACY * ACCURACY * variance;
        let power = |b: &Self, k: usize| (b.squares[k] / b.counts[k]).max(least);
        for k in 0..self.squares.len() {
            self.squares[k] = self.counts[k] * power(&self, k) / power(measured, k);
        }
        self
    }

    /// Gain in log-likelihood over another fit of the same samples, in nats.
    pub(crate) fn gain_over(&self, other: &Self) -> f64 {
        let power = |b: &Self, k: usize| b.squares[k] / b.counts[k];
        let gain = |k: usize| 0.5 * self.counts[k].min(other.counts[k]) * (power(other, k) / power(self, k)).ln();
        (0..self.squares.len()).map(gain).filter(|g| g.is_finite()).sum()
    }
}

/// Part of the variance of noise at an angle per sample that linear interpolation leaves; `between` is the mean of `f (1 - f)` over the parts `f`
/// of intervals.
pub(crate) fn interpolated(between: f64, angle: f64) -> f64 {
    // at the Nyquist frequency halfway between samples nothing is left
    const LEAST: f64 = 1e-3;
    (1.0 - 2.0 * between * (1.0 - angle.cos())).max(LEAST)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_hold_all_of_a_series_and_octaves_of_it() {
        let mut bands = Bands::new(64);
        let series: Vec<f64> = (0..64).map(|k| (PI * 40.0 * (f64::from(k) + 0.5) / 64.0).cos()).collect();
        bands.add(&mut series.clone(), |_| 1.0);
        let whole: f64 = series.iter().map(|v| v * v).sum();
        assert!((bands.squares.iter().sum::<f64>() - whole).abs() < 1e-9 * whole);
        assert!(bands.squares[0] > 0.999 * whole, "{bands:?}");
        assert_eq!(bands.counts, [31.0, 16.0, 8.0, 4.0, 5.0]);
    }
}
