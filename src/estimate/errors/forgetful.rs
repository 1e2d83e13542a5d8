//! Noise of deviation 1 that forgets, and may swing while it does, beside a white part w: `Rvv(t) = (1 - w) exp(-|t|/T) cos(omega t)`, rough as what
//! has passed a lag, or smooth as what has passed an oscillator, `(1 - w) exp(-|t|/T) (cos(omega t) + sin(omega |t|)/(omega T))`. As a process of two
//! states it is filtered exactly at any times, even or not (Kalman 1960): its Cholesky factor L and the determinant in one pass.

use std::f64::consts::LN_2;

/// Least variance of an innovation: samples at one moment of noise without a white part tell the same twice.
const LEAST: f64 = 1e-9;

/// What is believed of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Forgetful {
    /// T in units of the clock; 0 for white noise.
    pub(super) constant: f64,
    /// Angle by which it turns in a unit of the clock.
    pub(super) turning: f64,
    /// Whether it has a rate of change.
    pub(super) smooth: bool,
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
    /// What the states before have become (2 by 2).
    kept: [f64; 4],
    /// Gain of both states.
    gain: [f64; 2],
    /// Deviation of the innovation.
    deviation: f64,
}

impl Forgetful {
    pub(super) const WHITE: Self = Self { constant: 0.0, turning: 0.0, smooth: false, white: 1.0, clock: Clock::Time };

    /// Correlation of two samples that are `apart`.
    pub(super) fn correlation(&self, apart: f64) -> f64 {
        match apart == 0.0 {
            true => 1.0,
            false => (1.0 - self.white) * self.kept(apart)[0],
        }
    }

    /// What states of variance 1 become in a time: what is seen, and what it does next.
    fn kept(&self, apart: f64) -> [f64; 4] {
        // below 2^-50 nothing is left in a number
        if self.constant * 50.0 * LN_2 <= apart {
            return [0.0; 4];
        }
        let (angle, past) = (self.turning * apart, apart / self.constant);
        let size = (-past).exp();
        let (sine, cosine) = (size * angle.sin(), size * angle.cos());
        if !self.smooth {
            return [cosine, -sine, sine, cosine];
        }
        // sin(omega t) / (omega T), also where nothing turns
        let lag = if angle > 0.0 { sine * past / angle } else { size * past };
        let swing = lag * self.constant * (self.turning.powi(2) + self.constant.powi(-2)).sqrt();
        [cosine + lag, swing, -swing, cosine - lag]
    }

    fn gains(&self, moments: &[f64]) -> Vec<Gain> {
        let slow = 1.0 - self.white;
        // covariance of the states: both variances, and between them what they have in common
        let ([mut p, mut r], mut q, mut before) = ([slow; 2], 0.0, f64::NEG_INFINITY);
        let gain = |t: &f64| {
            let kept = self.kept(t - before);
            let [a, b, c, d] = kept;
            before = *t;
            // what is lost of the variance comes in anew
            (p, q, r) = (
                a * a * p + 2.0 * a * b * q + b * b * r + slow * (1.0 - a * a - b * b),
                a * c * p + (a * d + b * c) * q + b * d * r - slow * (a * c + b * d),
                c * c * p + 2.0 * c * d * q + d * d * r + slow * (1.0 - c * c - d * d),
            );
            let innovation = (p + self.white).max(LEAST);
            let gain = [p / innovation, q / innovation];
            (p, q, r) = (p - gain[0] * p, q - gain[0] * q, r - gain[1] * q);
            Gain { kept, gain, deviation: innovation.sqrt() }
        };
        moments.iter().map(gain).collect()
    }

    /// Makes independent numbers of deviation 1 of columns that have this noise: `L^-1 rows` in place (a row of `width` for each
    /// moment of the clock); returns the logarithm of the determinant of `L L'`.
    pub(super) fn whiten(&self, moments: &[f64], rows: &mut [f64], width: usize) -> f64 {
        let (mut seen, mut unseen) = (vec![0.0; width], vec![0.0; width]);
        let mut logarithm = 0.0;
        for (Gain { kept: [a, b, c, d], gain, deviation }, row) in
            self.gains(moments).iter().zip(rows.chunks_exact_mut(width))
        {
            logarithm += 2.0 * deviation.ln();
            for ((x, y), value) in seen.iter_mut().zip(&mut unseen).zip(row) {
                (*x, *y) = (a * *x + b * *y, c * *x + d * *y);
                let innovation = *value - *x;
                *x += gain[0] * innovation;
                *y += gain[1] * innovation;
                *value = innovation / deviation;
            }
        }
        logarithm
    }

    /// What independent numbers of deviation 1 do through this noise: `L' rows` in place.
    pub(super) fn transpose(&self, moments: &[f64], rows: &mut [f64], width: usize) {
        // what the states after a sample do to all later ones
        let (mut seen, mut unseen) = (vec![0.0; width], vec![0.0; width]);
        let gains = self.gains(moments);
        for (Gain { kept: [a, b, c, d], gain, deviation }, row) in gains.iter().zip(rows.chunks_exact_mut(width)).rev()
        {
            for ((x, y), value) in seen.iter_mut().zip(&mut unseen).zip(row) {
                let own = *value;
                *value = deviation * (own + gain[0] * *x + gain[1] * *y);
                *x += own;
                (*x, *y) = (a * *x + c * *y, b * *x + d * *y);
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
        let noise =
            |constant, turning, white| Forgetful { constant, turning, smooth: false, white, clock: Clock::Time };
        for noise in [
            Forgetful::WHITE,
            noise(1.3, 0.0, 0.0),
            noise(0.4, 0.0, 0.3),
            noise(50.0, 0.0, 0.6),
            noise(3.0, 2.0, 0.0),
            noise(0.7, 9.0, 0.3),
            Forgetful { smooth: true, ..noise(1.3, 0.0, 0.0) },
            Forgetful { smooth: true, ..noise(3.0, 2.0, 0.1) },
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
