//! The noise of an output: a mixture of spectra with its level integrated out.
//!
//! A spectrum is a shape times a level c. For powers `P_b` of `n_b` bins in each band b and a log-uniform level, the likelihood of a shape s
//! is `log Gamma(n/2) - n/2 log(sum_b P_b / (2 s_b)) - 1/2 sum_b n_b log s_b - n/2 log(2 pi)`, `n = sum_b n_b`. The log of the sum over all
//! shapes, each with its prior, is the evidence of the output; the mean of 1/S over them are the weights of the next fit.
//!
//! Beside the families stand *rough* spectra, in which each band departs from its shape by an inverse-gamma factor: what no shape explains,
//! and so the noise of a bad model.

use crate::evidence::bands::BandCounts;
use crate::evidence::gram::dot;
use fdm_numeric::lanes::widest;
use fdm_numeric::statistics::log_gamma;
use std::f64::consts::PI;

/// Prior shares of the families. Most sensors are white; wandering noise over the whole record is hardly noise.
const WHITE: f64 = 0.35;
const GAUSS_MARKOV: f64 = 0.25;
const POWER: f64 = 0.20;
const RESONANCE: f64 = 0.19;
const WANDERING: f64 = 0.01;
/// Prior share of rough spectra beside all these.
const ROUGH: f64 = 0.05;
/// Shape of their inverse-gamma factor: each band within a factor of about 1.7 of its shape.
pub(crate) const ROUGHNESS: f64 = 4.0;
/// Power that every bin has at least, as a part of the mean one (80 dB): no sensor is good over a wider range. Without it a record that was smoothed
/// counts where it is silent, a million times too much.
const RESOLVED: f64 = 1e-8;
/// Newton's steps to the likeliest level of a rough spectrum, the longest of them (in the logarithm of the level), and one that is near enough.
const LEVEL_STEPS: usize = 20;
const LONGEST: f64 = 2.0;
const AT_LEVEL: f64 = 1e-3;
/// Shares of a coloured part against white noise; of first-order Gauss-Markov noise at zero frequency, of a power at one radian a sample.
const MARKOV_SHARES: [f64; 6] = [1.0 - 1e-9, 0.999, 0.99, 0.95, 0.8, 0.5];
const POWER_SHARES: [f64; 6] = [1.0 - 1e-9, 0.8, 0.5, 0.2, 0.05, 0.01];
/// Exponents of a power of the frequency: from shot-like noise to slow drift, and those that wander.
const EXPONENTS: [f64; 4] = [0.5, 0.8, 1.0, 1.3];
const WANDERING_EXPONENTS: [f64; 3] = [1.6, 2.0, 3.0];
/// Corners of first-order noise from the fourth bin to this angular frequency a sample, and how many.
const CORNERS: (f64, usize) = (2.2, 12);
/// Resonances: up to this angular frequency a sample, how many, their dampings, and white noise beside their peak of one.
const RESONANCES: (f64, usize) = (2.6, 40);
const DAMPINGS: [f64; 4] = [0.02, 0.05, 0.12, 0.3];
const BESIDE: [f64; 3] = [0.0, 0.1, 1.0];

/// Noise of one output before anything is seen: shapes of its spectrum with their prior.
#[derive(Debug, Clone)]
pub(crate) struct NoisePrior {
    /// Bins in each band, and in all.
    bins: Vec<f64>,
    total: f64,
    /// 1/s of each shape (K rows of B).
    inverse: Vec<f64>,
    /// What does not depend on the powers: `log Gamma(n/2) - 1/2 sum n log s + log prior` (K).
    constant: Vec<f64>,
    /// Rough spectra: shapes (R rows of B), and what does not depend on the powers (for level 1).
    rough: Vec<f64>,
    rough_constant: f64,
    /// `ROUGHNESS + n_b/2` of each band.
    rough_powers: Vec<f64>,
}

/// Noise of one output after the powers are seen.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Noise {
    /// Log evidence of the powers.
    pub(crate) evidence: f64,
    /// Mean of 1/S in each band (B).
    pub(crate) weights: Vec<f64>,
}

/// What is computed with, kept between calls.
#[derive(Debug, Clone, Default)]
pub(crate) struct NoiseScratch {
    powers: Vec<f64>,
    likelihood: Vec<f64>,
    quotient: Vec<f64>,
    rough: Vec<RoughLevel>,
}

/// A rough spectrum at its likeliest level.
#[derive(Debug, Clone, Copy)]
struct RoughLevel {
    /// That level.
    level: f64,
    /// Log likelihood, the level integrated out (Laplace).
    log: f64,
}

/// Numbers from `low` to `high` in equal ratios.
fn geometric(low: f64, high: f64, count: usize) -> impl Iterator<Item = f64> {
    let ratio = (high / low).ln() / (count.max(2) - 1) as f64;
    (0..count).map(move |k| low * (ratio * k as f64).exp())
}

/// Shapes of the families, each with its prior share.
struct Families<'a> {
    /// Angular frequency of each band, radians a sample, and that of the first bin.
    omega: &'a [f64],
    first: f64,
}

impl Families<'_> {
    fn shape(&self, of: impl Fn(f64) -> f64) -> Vec<f64> {
        self.omega.iter().map(|w| of(*w)).collect()
    }

    fn gauss_markov(&self, corners: impl Iterator<Item = f64>) -> Vec<Vec<f64>> {
        let one = |corner: f64| {
            MARKOV_SHARES.map(|share| {
                let at = |w: f64| share / (1.0 + ((w / 2.0).sin() / (corner / 2.0).sin()).powi(2)) + (1.0 - share);
                self.shape(at)
            })
        };
        corners.flat_map(one).collect()
    }

    fn powers(&self, exponents: &[f64]) -> Vec<Vec<f64>> {
        let one = |exponent: &f64| POWER_SHARES.map(|share| self.shape(|w| share * w.powf(-exponent) + (1.0 - share)));
        exponents.iter().flat_map(one).collect()
    }

    fn resonances(&self, lowest: f64) -> Vec<Vec<f64>> {
        let mut shapes = Vec::new();
        for centre in geometric(lowest, RESONANCES.0, RESONANCES.1) {
            for damping in DAMPINGS {
                let peak = |w: f64| {
                    let x = ((w / 2.0).sin() / (centre / 2.0).sin()).powi(2);
                    1.0 / ((1.0 - x).powi(2) + 4.0 * damping * damping * x)
                };
                shapes.extend(BESIDE.map(|white| self.shape(|w| peak(w) + white)));
            }
        }
        shapes
    }

    /// All families: shapes and prior share.
    fn all(&self) -> [(f64, Vec<Vec<f64>>); 5] {
        let mut wandering = self.gauss_markov(geometric(0.5 * self.first, 2.5 * self.first, 3));
        wandering.extend(self.powers(&WANDERING_EXPONENTS));
        let lowest = (4.0 * self.first).max(0.01);
        [
            (WHITE, vec![self.shape(|_| 1.0)]),
            (GAUSS_MARKOV, self.gauss_markov(geometric((4.0 * self.first).max(1e-4), CORNERS.0, CORNERS.1))),
            (POWER, self.powers(&EXPONENTS)),
            (RESONANCE, self.resonances(lowest)),
            (WANDERING, wandering),
        ]
    }
}

/// A shape of geometric mean one.
fn normalised(mut shape: Vec<f64>) -> Vec<f64> {
    let mean = shape.iter().map(|s| s.ln()).sum::<f64>() / shape.len() as f64;
    shape.iter_mut().for_each(|s| *s /= mean.exp());
    shape
}

impl NoisePrior {
    /// Of an output with so many bins in each band; `longest` is the number of bins of the longest record.
    pub(crate) fn new(counts: &BandCounts, longest: usize) -> Self {
        let first = PI / longest as f64;
        let omega: Vec<f64> = counts.frequency.iter().map(|f| (f * first).min(PI)).collect();
        let families = Families { omega: &omega, first }.all();
        let pick = |family: &[Vec<f64>], at: &[usize]| at.iter().map(|k| family[*k].clone()).collect::<Vec<_>>();
        let (markov, powers) = (&families[1].1, &families[2].1);
        // the same kinds of spectra, one of a few: white, Gauss-Markov at six corners, three powers
        let rough: Vec<Vec<f64>> =
            [vec![vec![1.0; omega.len()]], pick(markov, &[2, 14, 26, 38, 50, 62]), pick(powers, &[8, 14, 20])].concat();
        let (total, bins) = (counts.total(), &counts.bins);
        let level = log_gamma(total / 2.0) - total / 2.0 * (2.0 * PI).ln();
        let (mut inverse, mut constant) = (Vec::new(), Vec::new());
        for (share, shapes) in families {
            let prior = ((1.0 - ROUGH) * share / shapes.len() as f64).ln();
            for shape in shapes.into_iter().map(normalised) {
                let logs: f64 = shape.iter().zip(bins).map(|(s, n)| n * s.ln()).sum();
                constant.push(level - 0.5 * logs + prior);
                inverse.extend(shape.iter().map(|s| 1.0 / s));
            }
        }
        let rough_powers: Vec<f64> = bins.iter().map(|n| ROUGHNESS + n / 2.0).collect();
        let used = || rough_powers.iter().zip(bins).filter(|(_, n)| **n > 0.0);
        let gammas: f64 = used().map(|(power, _)| log_gamma(*power) - log_gamma(ROUGHNESS)).sum();
        let prior = (ROUGH / rough.len() as f64).ln();
        Self {
            rough_constant: gammas + prior - total / 2.0 * (2.0 * PI).ln(),
            rough: rough.into_iter().flat_map(normalised).map(|s| ROUGHNESS * s).collect(),
            rough_powers,
            bins: bins.clone(),
            total,
            inverse,
            constant,
        }
    }

    /// The noise that leaves these powers (sums of squares in each band).
    pub(crate) fn given(&self, powers: &[f64], scratch: &mut NoiseScratch, noise: &mut Noise) {
        let (bands, half) = (self.bins.len(), self.total / 2.0);
        let NoiseScratch { powers: own, likelihood, quotient, rough } = scratch;
        let floor = RESOLVED * powers.iter().sum::<f64>() / self.total;
        own.clear();
        own.extend(powers.iter().zip(&self.bins).map(|(power, bins)| (power + floor * bins).max(f64::MIN_POSITIVE)));
        let powers = &own[..];
        quotient.clear();
        widest(
            #[inline(always)]
            || quotient.extend(self.inverse.chunks_exact(bands).map(|inverse| 0.5 * dot(inverse, powers))),
        );
        likelihood.clear();
        likelihood.extend(self.constant.iter().zip(&*quotient).map(|(constant, q)| constant - half * q.ln()));
        let (best, greatest) = maximum(likelihood);
        let level = quotient[best] / half;
        rough.clear();
        rough.extend(self.rough.chunks_exact(bands).map(|shape| self.rough_level(shape, level, powers)));
        let most = rough.iter().map(|r| r.log).fold(greatest, f64::max);
        let sum: f64 = likelihood.iter().copied().chain(rough.iter().map(|r| r.log)).map(|l| (l - most).exp()).sum();
        noise.evidence = most + sum.ln();
        noise.weights.clear();
        noise.weights.resize(bands, 0.0);
        for ((l, q), inverse) in likelihood.iter().zip(&*quotient).zip(self.inverse.chunks_exact(bands)) {
            let share = (l - most).exp() / sum;
            // what no sum would show
            if share > 1e-12 {
                let mean = share * half / q;
                noise.weights.iter_mut().zip(inverse).for_each(|(w, i)| *w += mean * i);
            }
        }
        for (shape, RoughLevel { level, log }) in self.rough.chunks_exact(bands).zip(&*rough) {
            let share = (log - most).exp() / sum;
            let bands = shape.iter().zip(&self.rough_powers).zip(powers);
            for (w, ((s, a), p)) in noise.weights.iter_mut().zip(bands) {
                *w += share * a / (level * s + 0.5 * p);
            }
        }
    }

    /// The likelihood of powers by a rough spectrum: each band's own level is integrated out, `sum_b R log x_b - a_b log(x_b + P_b/2)` is left,
    /// `x_b` the level times the shape, R the roughness, `a_b = R + n_b/2`. It is concave in the logarithm of the level.
    fn rough_level(&self, shape: &[f64], begin: f64, powers: &[f64]) -> RoughLevel {
        let (mut level, mut curvature) = (begin, 0.0);
        for _ in 0..LEVEL_STEPS {
            let mut slope = 0.0;
            curvature = 0.0;
            for ((s, a), p) in shape.iter().zip(&self.rough_powers).zip(powers) {
                let (x, rest) = (level * s, 0.5 * p);
                let share = x / (x + rest);
                slope += ROUGHNESS - a * share;
                curvature += a * share * (1.0 - share);
            }
            let step = (slope / curvature.max(f64::MIN_POSITIVE)).clamp(-LONGEST, LONGEST);
            level *= step.exp();
            if step.abs() < AT_LEVEL {
                break;
            }
        }
        let mut log = self.rough_constant + 0.5 * (2.0 * PI / curvature.max(f64::MIN_POSITIVE)).ln();
        for ((s, a), p) in shape.iter().zip(&self.rough_powers).zip(powers) {
            let x = level * s;
            log += ROUGHNESS * x.ln() - a * (x + 0.5 * p).ln();
        }
        RoughLevel { level, log }
    }
}

/// The greatest value and where it is.
fn maximum(values: &[f64]) -> (usize, f64) {
    let greater = |best: (usize, f64), (k, v): (usize, &f64)| if *v > best.1 { (k, *v) } else { best };
    values.iter().enumerate().fold((0, f64::NEG_INFINITY), greater)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::evidence::bands::Bands;
    use fdm_numeric::random::Stream;

    fn prior(bins: usize) -> (Bands, NoisePrior) {
        let bands = Bands::new(bins);
        let counts = BandCounts::of(&bands, (0..bins).map(|k| k as f64));
        let prior = NoisePrior::new(&counts, bins);
        (bands, prior)
    }

    fn given(prior: &NoisePrior, powers: &[f64]) -> Noise {
        let mut noise = Noise::default();
        prior.given(powers, &mut NoiseScratch::default(), &mut noise);
        noise
    }

    /// Powers in bands of noise with this spectrum.
    fn drawn(bands: &Bands, bins: usize, spectrum: impl Fn(f64) -> f64, seed: u64) -> Vec<f64> {
        let mut stream = Stream::seeded(seed);
        let mut powers = vec![0.0; bands.count()];
        for k in 0..bins {
            powers[bands.of(k as f64)] += spectrum(k as f64) * stream.normal().powi(2);
        }
        powers
    }

    #[test]
    fn weights_are_those_of_the_noise() {
        let bins = 2000;
        let (bands, prior) = prior(bins);
        let slow = |k: f64| 9.0 / (1.0 + (k / 40.0).powi(2)) + 0.09;
        for (spectrum, most) in [(&(|_| 4.0) as &dyn Fn(f64) -> f64, 1.15), (&slow, 1.5)] {
            let noise = given(&prior, &drawn(&bands, bins, spectrum, 7));
            let counts = BandCounts::of(&bands, (0..bins).map(|k| k as f64));
            for b in 0..bands.count() {
                let ratio = noise.weights[b] * spectrum(counts.frequency[b]);
                assert!(ratio > 1.0 / most && ratio < most, "band {b}: {ratio}");
            }
        }
    }

    #[test]
    fn the_level_does_not_matter_but_for_units() {
        let (bands, prior) = prior(500);
        let powers = drawn(&bands, 500, |k| 1.0 / (1.0 + k), 3);
        let scaled: Vec<f64> = powers.iter().map(|p| 1e6 * p).collect();
        let (a, b) = (given(&prior, &powers), given(&prior, &scaled));
        // the density of 500 values in a thousandth of their unit
        assert!((a.evidence - b.evidence - 250.0 * 1e6_f64.ln()).abs() < 1e-6, "{} {}", a.evidence, b.evidence);
        assert!(a.weights.iter().zip(&b.weights).all(|(a, b)| (a / b / 1e6 - 1.0).abs() < 1e-9));
    }

    #[test]
    fn silence_of_a_smoothed_record_counts_no_more_than_80_decibels() {
        let (bands, prior) = prior(1000);
        let powers = drawn(&bands, 1000, |k| if k < 100.0 { 1.0 } else { 1e-14 }, 5);
        let noise = given(&prior, &powers);
        let level = 1000.0 / powers.iter().sum::<f64>();
        let most = noise.weights.iter().fold(0.0_f64, |most, w| most.max(w / level));
        assert!((1e6..3e8).contains(&most), "{most:e}");
    }

    #[test]
    fn white_noise_is_likeliest_white() {
        // a spectrum of this shape must not cost more than the families that it stands beside
        let (bands, prior) = prior(1000);
        for seed in 0..5 {
            let powers = drawn(&bands, 1000, |_| 1.0, 100 + seed);
            let known: f64 = -0.5 * powers.iter().sum::<f64>() - 500.0 * (2.0 * PI).ln();
            let lost = known - given(&prior, &powers).evidence;
            // a level within a thousand bins costs half the logarithm of its information, a family its share
            assert!((0.0..8.0).contains(&lost), "{lost}");
        }
    }
}
