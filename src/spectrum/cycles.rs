//! Frequencies as cycles per sample with twice the digits of a number, so that a phase is right after a million samples.

use fdm_grammar::math;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Cycles per sample, the sum of two numbers (Dekker 1971): at sample k the phase is `k` times this, of which only the part beyond
/// whole cycles counts. A plain number would leave an error of k times its last digit there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cycles {
    high: f64,
    low: f64,
}

impl Cycles {
    /// A frequency in cycles per unit of time, `first + step * count`, seen at samples `dt` apart.
    pub(super) fn of(first: f64, step: f64, count: usize, dt: f64) -> Self {
        let (product, rest) = exact_product(step, count as f64);
        let (sum, error) = exact_sum(first, product);
        let frequency = Self { high: sum, low: error + rest };
        frequency.times(dt)
    }

    /// `bin` cycles in `samples` samples.
    pub(super) fn of_bin(bin: usize, samples: usize) -> Self {
        let (bin, samples) = (bin as f64, samples as f64);
        let high = bin / samples;
        let (product, rest) = exact_product(high, samples);
        Self { high, low: ((bin - product) - rest) / samples }
    }

    /// To the nearest number.
    pub(super) fn value(self) -> f64 {
        self.high + self.low
    }

    pub(super) fn times(self, factor: f64) -> Self {
        let (high, low) = exact_product(self.high, factor);
        let (high, low) = exact_sum(high, low + self.low * factor);
        Self { high, low }
    }

    pub(super) fn minus(self, other: Self) -> Self {
        let (high, low) = exact_sum(self.high, -other.high);
        let (high, low) = exact_sum(high, low + (self.low - other.low));
        Self { high, low }
    }

    /// `exp(-j 2 pi cycles k)`, right to rounding for whole k up to 2^53.
    pub(super) fn turned(self, k: f64) -> Complex64 {
        let (high, rest) = exact_product(self.high, k);
        let part = (high - high.round()) + (rest + self.low * k);
        let phase = TAU * (part - part.round());
        Complex64::new(math::cos(phase), -math::sin(phase))
    }
}

/// `a b` and what rounding took from it; halves of 26 digits multiply without rounding.
fn exact_product(a: f64, b: f64) -> (f64, f64) {
    let halves = |x: f64| {
        let far = 134_217_729.0 * x;
        let high = far - (far - x);
        (high, x - high)
    };
    let product = a * b;
    let ((a1, a2), (b1, b2)) = (halves(a), halves(b));
    (product, ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2)
}

/// `a + b` and what rounding took from it.
fn exact_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let seen = sum - a;
    (sum, (a - (sum - seen)) + (b - seen))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_stay_right_over_a_long_record() {
        // 1/3 and 3/7 cycles per sample return after whole periods, however late
        for (bin, samples) in [(1, 3), (3, 7), (31, 97), (12_345, 99_991)] {
            let cycles = Cycles::of_bin(bin, samples);
            for turns in [1.0, 1e3, 1e7, 1e9] {
                let late = cycles.turned(turns * samples as f64);
                assert!((late - 1.0).norm() < 1e-15, "{bin}/{samples} after {turns}: {late}");
                let next = cycles.turned(turns * samples as f64 + 1.0);
                let phase = TAU * bin as f64 / samples as f64;
                assert!((next - Complex64::new(phase.cos(), -phase.sin())).norm() < 1e-15 * 4.0);
            }
        }
    }

    #[test]
    fn a_frequency_of_a_band_is_the_sum_of_what_it_is_made_of() {
        // 0.5 + 0.25 * 10 = 3 cycles per unit of time, 8 samples per unit
        assert_eq!(Cycles::of(0.5, 0.25, 10, 0.125), Cycles { high: 0.375, low: 0.0 });
        let tenth = Cycles::of(0.1, 0.1, 9, 1.0);
        // ten times the number nearest to 0.1, not the number nearest to 1
        assert_eq!(tenth.high, 1.0);
        assert!((tenth.low - 5.551_115_123_125_783e-17).abs() < 1e-30);
        assert_eq!(tenth.minus(tenth).value(), 0.0);
    }
}
