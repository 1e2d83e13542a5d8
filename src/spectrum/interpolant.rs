//! What a signal is between its samples, and its transform then.
//!
//! The sum over samples is the integral over the record by the midpoint rule. What a simulation integrates is not the samples but
//! what lies between them, and that has an exact transform: the sum times a factor, and something for the two half intervals at the ends.

use num_complex::Complex64;

/// What the transforms of a run are transforms of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolant {
    /// What the time domain integrates: inputs held or linear between samples, by their exact transform; outputs smooth, by the sum and the
    /// first term of Euler and Maclaurin at the ends. The same linear model has the same response in both domains, up to (w dt)^4/240
    /// (inputs linear) or, for rates that held inputs drive directly, (w dt)^2/12.
    #[default]
    AsIntegrated,
    /// Every channel linear between its samples, with exact ends (the rule of a low-order interpolant; Morelli 1997).
    Linear,
    /// The samples themselves: plain sums for every channel (Marchand and Fu 1985).
    Samples,
}

/// The kind of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Course {
    Sampled,
    Held,
    Linear,
    Smooth,
}

/// Two samples on both sides of an end: of the left end those before and at the first sample that is transformed, of the right one the last
/// that is transformed and the one behind it.
pub(super) type Sides = [[f64; 2]; 2];

impl Course {
    /// What the mean over the record is more than the mean of the samples, times their number.
    pub(super) fn excess(self, [left, right]: Sides) -> f64 {
        match self {
            Self::Sampled => 0.0,
            Self::Held => 0.5 * (left[0] - right[0]),
            Self::Linear => 0.125 * (left[0] - left[1] + right[1] - right[0]),
            Self::Smooth => ((right[1] - right[0]) - (left[1] - left[0])) / 24.0,
        }
    }

    /// What the transform of the samples far from ends is multiplied with to be that of what lies between them.
    pub(super) fn factor(self, theta: f64) -> Complex64 {
        let half = 0.5 * theta;
        let sinc = if half == 0.0 { 1.0 } else { half.sin() / half };
        match self {
            Self::Sampled | Self::Smooth => Complex64::ONE,
            Self::Held => Complex64::cis(-half) * sinc,
            Self::Linear => Complex64::from(sinc * sinc),
        }
    }

    /// Values half an interval outside.
    pub(super) fn ends(self, [left, right]: Sides) -> [f64; 2] {
        match self {
            Self::Held => [left[0], right[0]],
            _ => [0.5 * (left[0] + left[1]), 0.5 * (right[0] + right[1])],
        }
    }
}

/// The turns that corrections at one frequency are made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    /// `w dt`.
    theta: f64,
    /// `exp(-j w dt (N - 1))`.
    last: Complex64,
    /// Integral of `-s exp(-j theta s)` from -1/2 to 0: the sample before, on its way into the record.
    before: Complex64,
    /// Integral of `(1 + s) exp(-j theta s)` from -1 to -1/2: what the factor takes of the first sample outside of the record.
    outside: Complex64,
    /// Integral of `exp(-j theta s)` from 0 to 1/2.
    half: Complex64,
}

impl Correction {
    pub(super) fn new(theta: f64, last: Complex64) -> Self {
        let before = integral(-0.5, |s| Complex64::cis(-theta * s) * -s);
        let outside = integral(-1.0, |s| Complex64::cis(-theta * s) * (1.0 + s));
        let half = integral(0.0, |s| Complex64::cis(-theta * s));
        Self { theta, last, before, outside, half }
    }

    /// The transform of what lies between the samples from their sum, in intervals.
    pub(super) fn apply(&self, course: Course, sum: Complex64, [left, right]: Sides) -> Complex64 {
        let whole = Complex64::cis(-0.5 * self.theta);
        let factor = course.factor(self.theta);
        match course {
            Course::Sampled => sum,
            Course::Held => {
                // the last sample reaches half an interval beyond the record, the one before the first half an interval into it
                factor * sum + self.half * whole.conj() * left[0] - self.half * whole * self.last * right[0]
            }
            Course::Linear => {
                let at = |samples: [f64; 2], before: Complex64, outside: Complex64| {
                    samples[0] * before - samples[1] * outside
                };
                factor * sum
                    + at(left, self.before, self.outside)
                    + self.last * at([right[1], right[0]], self.before.conj(), self.outside.conj())
            }
            Course::Smooth => {
                // Euler and Maclaurin: (1/24) of the slope of x exp(-j w t) at the right end less that at the left one
                let slope = |[a, b]: [f64; 2]| Complex64::new(b - a, -self.theta * 0.5 * (a + b));
                sum + (slope(right) * whole * self.last - slope(left) * whole.conj()) / 24.0
            }
        }
    }
}

/// Integral over half an interval from `start` on, by Gauss's eight points: exact to rounding up to Nyquist.
fn integral(start: f64, f: impl Fn(f64) -> Complex64) -> Complex64 {
    const POINTS: [(f64, f64); 4] = [
        (0.183_434_642_495_649_8, 0.362_683_783_378_362),
        (0.525_532_409_916_329, 0.313_706_645_877_887_3),
        (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
        (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
    ];
    let middle = start + 0.25;
    POINTS.iter().map(|(x, weight)| (f(middle - 0.25 * x) + f(middle + 0.25 * x)) * (0.25 * weight)).sum()
}
