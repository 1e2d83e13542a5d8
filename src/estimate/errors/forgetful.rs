//! Noise of deviation 1 that forgets: `Rvv(t) = (1 - w) exp(-|t|/T)`, and a white part w. As a process of one state it is filtered
//! exactly at any times, even or not (Kalman 1960): its Cholesky factor L and the determinant in one pass.

use std::f64::consts::LN_2;

/// Least variance of an innovation: samples at one moment of noise without a white part tell the same twice.
const LEAST: f64 = 1e-9;

/// What is believed of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Forgetful {
    /// T in units of the clock; 0 for white noise.
    pub(super) constant: f64,
    /// The part of the variance that is white.
    pub(super) white: f64,
    /// What it forgets by.
    pub(super) clock: Clock,
}

/// What passes between two samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clock {
    /// Time.
    Time,
    /// The number of samples: what drifts from one analysis to the next, whenever they are made.
    Count,
}

/// The filter at each sample.
struct Gain {
    /// What is left of the state since the sample before.
    kept: f64,
    /// Gain of the state.
    gain: f64,
    /// Deviation of the innovation.
    deviation: f64,
}

impl Forgetful {
    pub(super) const WHITE: Self = Self { constant: 0.0, white: 1.0, clock: Clock::Time };

    /// Correlation of two samples that are `apart`.
    pub(super) fn correlation(&self, apart: f64) -> f64 {
        match apart == 0.0 {
            true => 1.0,
            false => (1.0 - self.white) * self.kept(apart),
        }
    }

    fn kept(&self, apart: f64) -> f64 {
        // below 2^-50 nothing is left in a number
        if self.constant * 50.0 * LN_2 > apart { (-apart / self.constant).exp() } else { 0.0 }
    }

    fn gains(&self, moments: &[f64]) -> Vec<Gain> {
        let slow = 1.0 - self.white;
        let (mut variance, mut before) = (slow, f64::NEG_INFINITY);
        let gain = |t: &f64| {
            let kept = self.kept(t - before);
            before = *t;
            variance = kept * kept * variance + (1.0 - kept * kept) * slow;
            let innovation = (variance + self.white).max(LEAST);
            let gain = variance / innovation;
            variance -= gain * variance;
            Gain { kept, gain, deviation: innovation.sqrt() }
        };
        moments.iter().map(gain).collect()
    }

    /// Makes independent numbers of deviation 1 of columns that have this noise: `L^-1 rows` in place (a row of `width` for each
    /// moment of the clock); returns the logarithm of the determinant of `L L'`.
    pub(super) fn whiten(&self, moments: &[f64], rows: &mut [f64], width: usize) -> f64 {
        let mut state = vec![0.0; width];
        let mut logarithm = 0.0;
        for (g, row) in self.gains(moments).iter().zip(rows.chunks_exact_mut(width)) {
            logarithm += 2.0 * g.deviation.ln();
            for (x, value) in state.iter_mut().zip(row) {
                *x *= g.kept;
                let innovation = *value - *x;
                *x += g.gain * innovation;
                *value = innovation / g.deviation;
            }
        }
        logarithm
    }

    /// What independent numbers of deviation 1 do through this noise: `L' rows` in place.
    pub(super) fn transpose(&self, moments: &[f64], rows: &mut [f64], width: usize) {
        let mut influence = vec![0.0; width];
        for (g, row) in self.gains(moments).iter().zip(rows.chunks_exact_mut(width)).rev() {
            for (x, value) in influence.iter_mut().zip(row) {
                // x: what the state after this sample does to all later ones
                let own = *value;
                *value = g.deviation * (own + g.gain * *x);
                *x = g.kept * (own + *x);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Cholesky, DMatrix};

    #[test]
    fn factors_are_those_of_the_covariance() {
        let moments: [f64; 7] = [0.0, 0.5, 0.6, 2.0, 2.1, 7.0, 7.5];
        let n = moments.len();
        let columns: Vec<f64> = (0..2 * n).map(|k| (0.7 * k as f64).sin() + 0.1 * k as f64).collect();
        for noise in [
            Forgetful::WHITE,
            Forgetful { constant: 1.3, white: 0.0, clock: Clock::Time },
            Forgetful { constant: 0.4, white: 0.3, clock: Clock::Time },
            Forgetful { constant: 50.0, white: 0.6, clock: Clock::Time },
        ] {
            let covariance = DMatrix::from_fn(n, n, |i, j| noise.correlation((moments[i] - moments[j]).abs()));
            let factor = Cholesky::new(covariance.clone()).expect("regular").l();
            let dense = DMatrix::from_row_slice(n, 2, &columns);
            let (mut white, mut back) = (columns.clone(), columns.clone());
            let logarithm = noise.whiten(&moments, &mut white, 2);
            assert!((logarithm - covariance.determinant().ln()).abs() < 1e-9, "{noise:?}: {logarithm}");
            noise.transpose(&moments, &mut back, 2);
            let want = [factor.clone().try_inverse().expect("regular") * &dense, factor.transpose() * &dense];
            for (got, want) in [white, back].iter().zip(&want) {
                let got = DMatrix::from_row_slice(n, 2, got);
                assert!((&got - want).amax() < 1e-9 * want.amax(), "{noise:?}: {got} {want}");
            }
        }
    }
}
