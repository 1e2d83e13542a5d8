//! The spectrum of residuals beside that of white noise with their variance: where in frequency something is left.

use crate::spectrum::fft::RealFft;
use num_complex::Complex64;
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Bands of the whole range, about evenly spaced on a logarithmic axis.
const BANDS: f64 = 48.0;
/// Fewest frequencies of the record in a band.
const FEWEST: usize = 3;
/// Probability on each side of the limits.
const TAIL: f64 = 0.025;

/// Mean power densities in bands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResidualSpectrum {
    /// Middle of each band (K) in cycles per unit of time, rising.
    pub frequency: Vec<f64>,
    /// Density in it (K) over that of white noise with the variance of these residuals.
    pub density: Vec<f64>,
    /// Limits (K) within which 95 % of these densities lie for white noise.
    pub low: Vec<f64>,
    /// The upper ones.
    pub high: Vec<f64>,
    /// Bands beyond their limits; one of twenty is to be expected.
    pub outside: usize,
}

impl ResidualSpectrum {
    /// Of residuals about their mean on an even grid with this interval, NaN where there is none; none when there are too few.
    pub(super) fn new(series: &[f64], interval: f64) -> Option<Self> {
        let present = series.iter().filter(|v| !v.is_nan());
        let power: f64 = present.map(|v| v * v).sum();
        // the last one of an even number of samples has half the freedom of the others
        let last = series.len().saturating_sub(1) / 2;
        if last < 2 * FEWEST || !(power > 0.0 && power.is_finite()) {
            return None;
        }
        let mut bins = vec![Complex64::ZERO; last];
        // the Fourier sum of what is there: gaps add nothing
        let filled = series.iter().map(|v| if v.is_nan() { 0.0 } else { *v });
        RealFft::new(series.len()).transform(filled, 1..last + 1, &mut bins);
        let (mut found, ratio) = (Self::empty(), (last as f64).powf(1.0 / BANDS));
        let mut from = 1;
        while from <= last {
            let wanted = ((from as f64 * ratio) as usize).max(from + FEWEST);
            // what would be left over belongs to the last band
            let to = if wanted + FEWEST > last + 1 { last + 1 } else { wanted };
            let own = &bins[from - 1..to - 1];
            let density = own.iter().map(|x| x.norm_sqr()).sum::<f64>() / (own.len() as f64 * power);
            let middle = (from as f64 * (to - 1) as f64).sqrt();
            found.push(middle / (series.len() as f64 * interval), density, own.len());
            from = to;
        }
        Some(found)
    }

    fn empty() -> Self {
        Self { frequency: Vec::new(), density: Vec::new(), low: Vec::new(), high: Vec::new(), outside: 0 }
    }

    fn push(&mut self, frequency: f64, density: f64, count: usize) {
        let freedom = 2.0 * count as f64;
        let limit = |p: f64| ChiSquared::new(freedom).map_or(f64::NAN, |d| d.inverse_cdf(p) / freedom);
        let (low, high) = (limit(TAIL), limit(1.0 - TAIL));
        self.frequency.push(frequency);
        self.density.push(density);
        self.low.push(low);
        self.high.push(high);
        self.outside += usize::from(density < low || density > high);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::autocovariance::centred;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{RngCore, SeedableRng};

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let uniform = |random: &mut ChaCha8Rng| (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        (0..n).map(|_| (0..12).map(|_| uniform(&mut random)).sum::<f64>() - 6.0).collect()
    }

    #[test]
    fn white_noise_stays_within_its_limits_and_a_line_does_not() {
        let (mut beyond, mut all) = (0, 0);
        for seed in 0..40 {
            let found = ResidualSpectrum::new(&centred(noise(1001, seed)), 0.1).unwrap();
            assert!(found.frequency.windows(2).all(|w| w[0] < w[1]) && found.frequency.last().unwrap() < &5.0);
            (beyond, all) = (beyond + found.outside, all + found.density.len());
        }
        let share = beyond as f64 / all as f64;
        assert!((0.03..0.07).contains(&share), "{share} of {all} bands");

        let line = |k: usize| 2.0 * (std::f64::consts::TAU * 0.7 * 0.1 * k as f64).sin();
        let series: Vec<f64> = noise(1000, 1).iter().enumerate().map(|(k, v)| v + line(k)).collect();
        let found = ResidualSpectrum::new(&centred(series), 0.1).unwrap();
        let peak = (0..found.density.len()).max_by(|a, b| found.density[*a].total_cmp(&found.density[*b])).unwrap();
        assert!((found.frequency[peak] - 0.7).abs() < 0.05 && found.density[peak] > 5.0 * found.high[peak]);
    }

    #[test]
    fn limits_are_those_of_chi_squared_and_densities_average_to_one() {
        let mut found = ResidualSpectrum::empty();
        found.push(1.0, 1.0, 1);
        // with two degrees of freedom the distribution is the exponential one
        assert!((found.low[0] + 0.975_f64.ln()).abs() < 1e-6 && (found.high[0] + 0.025_f64.ln()).abs() < 1e-6);
        // a seventh of the samples is missing
        let mut series = noise(7000, 3);
        series.iter_mut().step_by(7).for_each(|v| *v = f64::NAN);
        let found = ResidualSpectrum::new(&centred(series), 1.0).unwrap();
        let high = &found.density[found.density.len() / 2..];
        let mean = high.iter().sum::<f64>() / high.len() as f64;
        assert!((mean - 1.0).abs() < 0.05, "{mean}");
        assert_eq!(ResidualSpectrum::new(&[1.0, -1.0, 1.0], 1.0), None);
        assert_eq!(ResidualSpectrum::new(&[0.0; 40], 1.0), None);
    }
}
