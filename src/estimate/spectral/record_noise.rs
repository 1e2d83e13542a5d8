//! The noise of a record that moves the model: how large it is, and how much of it the next sample has.
//!
//! What moves is slow, so that the uppermost quarter of a record's frequencies holds noise only. Beside it, how strong the noise is where the model is fitted
//! (or how large it is in all, where that is known) tells how neighbours share it: noise is taken for a first autoregression, white where the uppermost
//! frequencies hold as much as the others. A record with steps, or with gaps, does not tell; its noise is white.

use crate::spectrum::Window;
use crate::spectrum::fft::RealFft;
use fdm_grammar::math;
use num_complex::Complex64;
use rand::Rng;
use statrs::distribution::{ContinuousCDF, Normal};
use std::f64::consts::{LN_2, PI};

/// Fewest samples that tell a colour.
const FEWEST: usize = 32;
/// Most that a sample has of its neighbour's noise: a sensor's filter takes the uppermost frequencies away, which is no sign of noise in the lowest.
const MOST_KEPT: f64 = 0.98;
/// Places in the uppermost quarter at which a density is averaged.
const PLACES: usize = 16;
/// Halvings of what is kept.
const HALVINGS: usize = 40;

/// A first autoregression in its stationary state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RecordNoise {
    /// Of a sample.
    pub(super) deviation: f64,
    /// Correlation of neighbours, 0 for white noise.
    pub(super) kept: f64,
}

impl RecordNoise {
    /// Of a sensor whose deviation is known, and the power of its record in the uppermost frequencies.
    pub(super) fn of_deviation(deviation: f64, top: Option<f64>) -> Self {
        let wanted = top.map_or(1.0, |top| top / (deviation * deviation));
        Self { deviation, kept: kept(|kept| upper(kept) > wanted) }
    }

    /// Of noise that is as strong as white noise of variance `level` at these angles per sample, on the average.
    pub(super) fn of_level(level: f64, angles: &[f64], top: Option<f64>) -> Self {
        let wanted = top.map_or(1.0, |top| level / top);
        let here = |kept: f64| angles.iter().map(|w| density(kept, *w)).sum::<f64>() / angles.len().max(1) as f64;
        let kept = kept(|kept| here(kept) < wanted * upper(kept));
        Self { deviation: (level / here(kept)).sqrt(), kept }
    }

    /// Adds what is drawn to the samples of a record.
    pub(super) fn add<'v>(&self, samples: impl Iterator<Item = &'v mut f64>, chance: &mut impl Rng) {
        let law = Normal::standard();
        // not at the ends of the interval, where the normal law ends nowhere
        let mut fresh = || law.inverse_cdf(chance.random::<f64>().clamp(1e-12, 1.0 - 1e-12));
        let (mut state, new) = (fresh(), (1.0 - self.kept * self.kept).sqrt());
        for value in samples {
            *value += self.deviation * state;
            state = self.kept * state + new * fresh();
        }
    }
}

/// Power of a record in the uppermost quarter of its frequencies, as the variance of white noise with as much: by the middle one, so that single
/// lines (a rotor's) do not count. None of a record that is short or has gaps.
pub(super) fn top(record: impl ExactSizeIterator<Item = f64> + Clone) -> Option<f64> {
    let n = record.len();
    if n < FEWEST || !record.clone().all(f64::is_finite) {
        return None;
    }
    let mean = record.clone().sum::<f64>() / n as f64;
    let weights = Window::Hann.weights(n);
    let energy: f64 = weights.iter().map(|w| w * w).sum();
    let bins = 3 * n / 8..n / 2;
    let mut own = vec![Complex64::ZERO; bins.len()];
    RealFft::new(n).transform(record.zip(&weights).map(|(v, w)| (v - mean) * w), bins, &mut own);
    let mut powers: Vec<f64> = own.iter().map(|x| x.norm_sqr() / energy).collect();
    powers.sort_by(f64::total_cmp);
    // the median of an exponential law is ln 2 of its mean
    Some(powers[powers.len() / 2] / LN_2).filter(|p| *p > 0.0)
}

/// Density of such noise of variance 1 at an angle per sample, 1 for white noise.
fn density(kept: f64, angle: f64) -> f64 {
    (1.0 - kept * kept) / (1.0 - 2.0 * kept * math::cos(angle) + kept * kept)
}

/// Its mean over the uppermost quarter.
fn upper(kept: f64) -> f64 {
    let angle = |k: usize| PI * (0.75 + 0.25 * (k as f64 + 0.5) / PLACES as f64);
    (0..PLACES).map(|k| density(kept, angle(k))).sum::<f64>() / PLACES as f64
}

/// The least that is not too little.
fn kept(too_little: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, MOST_KEPT);
    if !too_little(low) {
        return low;
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if too_little(middle) { low = middle } else { high = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn record(deviation: f64, kept: f64, seed: u64) -> Vec<f64> {
        let motion = |k: usize| (0.02 * k as f64).sin() + 0.5 * (0.05 * k as f64 + 1.0).sin();
        let mut record: Vec<f64> = (0..6000).map(motion).collect();
        RecordNoise { deviation, kept }.add(record.iter_mut(), &mut ChaCha8Rng::seed_from_u64(seed));
        record
    }

    #[test]
    fn a_records_upper_frequencies_tell_the_colour_of_its_noise() {
        for (seed, truth) in [(1, 0.0), (2, 0.5), (3, 0.9), (4, 0.95)] {
            let noisy = record(0.03, truth, seed);
            let top = top(noisy.iter().copied());
            let known = RecordNoise::of_deviation(0.03, top);
            assert!((known.kept - truth).abs() < 0.1 * (1.0 - truth) + 0.03, "{truth}: {known:?}");
            // by what it is at low frequencies
            let angles = [0.05, 0.1, 0.2];
            let level = angles.iter().map(|w| density(truth, *w)).sum::<f64>() / 3.0 * 0.03 * 0.03;
            let found = RecordNoise::of_level(level, &angles, top);
            assert!((found.deviation / 0.03 - 1.0).abs() < 0.3 && (found.kept - truth).abs() < 0.1, "{found:?}");
        }
    }

    #[test]
    fn noise_is_white_where_the_record_does_not_tell() {
        let noisy = &record(0.03, 0.9, 5)[..1000];
        assert_eq!(top(noisy[..20].iter().copied()), None);
        assert_eq!(top(noisy.iter().map(|v| if *v > 1.4 { f64::NAN } else { *v })), None);
        assert_eq!(top([1.0; 100].into_iter()), None);
        assert_eq!(RecordNoise::of_deviation(0.1, None), RecordNoise { deviation: 0.1, kept: 0.0 });
        assert_eq!(RecordNoise::of_level(0.04, &[0.1], None), RecordNoise { deviation: 0.2, kept: 0.0 });
        // steps are in all frequencies: more than the noise could have there
        let stepped: Vec<f64> = (0..400)
            .map(|k| f64::from(u8::from([40, 130, 213, 255].iter().filter(|at| k > **at).count() % 2 == 1)))
            .collect();
        assert_eq!(RecordNoise::of_deviation(0.01, top(stepped.iter().copied())).kept, 0.0);
    }
}
