//! Reproducible random numbers: every stream that fdm draws from, each with a name or a seed.
//!
//! What a stream yields is part of results that users keep (studies, null distributions, simulated records). It therefore never
//! changes: the ways to a normal deviate below differ in their bits, and each stays with those who draw by it.

use crate::elementary::{cos, log, sin};
use crate::statistics::normal_quantile;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// The finaliser of SplitMix64 (Steele, Lea & Flood, OOPSLA 2014): seeds that differ in a bit differ in half of them.
pub fn mixed(seed: u64) -> u64 {
    SplitMix(seed).bits()
}

/// The counter-based generator SplitMix64: fast, and short enough for examples that generate their own noise.
#[derive(Debug, Clone)]
pub struct SplitMix(pub u64);

impl SplitMix {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 2f64.powi(-53)
    }

    /// About normal, of standard deviation 1, within +-6: the sum of twelve uniform numbers less 6. Needs no elementary function.
    pub fn sum_of_twelve(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Normal deviates from [`SplitMix`] by Box and Muller, for tests.
#[derive(Debug, Clone)]
pub struct Normal(pub u64);

#[expect(clippy::should_implement_trait, reason = "a stream has no end")]
impl Normal {
    /// The next deviate, of standard deviation 1.
    pub fn next(&mut self) -> f64 {
        let mut random = SplitMix(self.0);
        let radius = (-2.0 * (1.0 - random.uniform()).ln()).sqrt();
        let deviate = radius * (TAU * random.uniform()).cos();
        self.0 = random.0;
        deviate
    }
}

/// A stream of ChaCha with eight rounds: independent streams for every seed and every name.
#[derive(Debug, Clone)]
pub struct Stream {
    random: ChaCha8Rng,
    /// The second of a pair of deviates, see [`Self::normal_of_pair`].
    second: Option<f64>,
}

impl Stream {
    /// The stream of a seed.
    pub fn seeded(seed: u64) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), second: None }
    }

    /// The stream of a seed and of names: a record's, a channel's.
    pub fn named(seed: u64, names: &[&str]) -> Self {
        // FNV-1a, with a byte between names
        let bytes = names.iter().flat_map(|name| name.bytes().chain([0xff]));
        let hash = bytes.fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3));
        Self::seeded(hash ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15))
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.random.random()
    }

    /// A normal deviate of standard deviation 1 from two uniform numbers (Box & Muller 1958): the cosine of the pair, the sine is
    /// not used. The same bits on every machine.
    pub fn normal(&mut self) -> f64 {
        let (a, b) = (self.uniform(), self.uniform());
        (-2.0 * log(1.0 - a)).sqrt() * cos(TAU * b)
    }

    /// As [`Self::normal`], but both deviates of a pair are used, one after the other.
    pub fn normal_of_pair(&mut self) -> f64 {
        if let Some(second) = self.second.take() {
            return second;
        }
        let (a, b) = (self.uniform(), self.uniform());
        let (radius, angle) = ((-2.0 * (1.0 - a).ln()).sqrt(), TAU * b);
        self.second = Some(radius * sin(angle));
        radius * cos(angle)
    }

    /// A normal deviate of standard deviation 1 from one uniform number, by the inverse of the distribution function; within +-7.
    pub fn normal_by_inversion(&mut self) -> f64 {
        // not at the ends of the interval, where the normal law ends nowhere
        normal_quantile(self.uniform().clamp(1e-12, 1.0 - 1e-12))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and variance of 20 000 deviates.
    fn moments(mut next: impl FnMut() -> f64) -> (f64, f64) {
        let drawn: Vec<f64> = (0..20_000).map(|_| next()).collect();
        let mean = drawn.iter().sum::<f64>() / 20_000.0;
        (mean, drawn.iter().map(|z| (z - mean) * (z - mean)).sum::<f64>() / 20_000.0)
    }

    #[test]
    fn all_deviates_are_standard_normal() {
        let (mut test, mut split) = (Normal(1), SplitMix(1));
        let mut streams = [Stream::seeded(1), Stream::named(1, &["a"]), Stream::seeded(2)];
        let [a, b, c] = &mut streams;
        let all = [
            moments(|| test.next()),
            moments(|| split.sum_of_twelve()),
            moments(|| a.normal()),
            moments(|| b.normal_of_pair()),
            moments(|| c.normal_by_inversion()),
        ];
        for (mean, variance) in all {
            assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.05, "{mean} {variance}");
        }
    }

    #[test]
    fn streams_are_told_apart_by_seed_and_by_names() {
        let first = |mut stream: Stream| stream.uniform();
        assert_eq!(first(Stream::seeded(1)), first(Stream::seeded(1)));
        assert_ne!(first(Stream::named(3, &["a", "b"])), first(Stream::named(3, &["ab"])));
        assert_ne!(first(Stream::named(3, &["a"])), first(Stream::named(4, &["a"])));
    }

    /// The first numbers of every stream: results that users keep depend on them.
    #[test]
    fn streams_yield_what_they_always_did() {
        let bits = |v: f64| v.to_bits();
        let mut pair = Stream::seeded(5);
        let found = [
            mixed(0),
            bits(Normal(7).next()),
            bits(SplitMix(1).sum_of_twelve()),
            bits(Stream::named(3, &["a", "b"]).normal()),
            bits(pair.normal_of_pair()),
            bits(pair.normal_of_pair()),
            bits(Stream::seeded(5).normal_by_inversion()),
        ];
        assert_eq!(found, KNOWN);
    }

    const KNOWN: [u64; 7] = [
        0xe220_a839_7b1d_cdaf,
        0x3fef_a194_ec47_d228,
        0x3ff6_ca21_392e_2804,
        0xbff2_f7fd_33a9_fda8,
        0xbfc2_9fa8_4192_eab5,
        0xbfe4_f0e0_391d_3e58,
        0xbfea_ca0f_d378_a336,
    ];
}
