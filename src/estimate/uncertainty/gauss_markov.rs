//! Gauss-Markov noise of deviation 1 beside a white part w: `Rvv(t) = (1 - w) exp(-|t|/T) cos(omega t)`, or smooth, as what has passed an oscillator,
//! `(1 - w) exp(-|t|/T) (cos(omega t) + sin(omega |t|)/(omega T))`. As a process of two states it is filtered exactly at any times, even or not (Kalman
//! 1960): its Cholesky factor L and the determinant in one pass.

use std::f64::consts::LN_2;

/// Least variance of an innovation: two samples at one moment of noise without a white part are the same.
pub(super) const LEAST: f64 = 1e-9;

/// First- or second-order Gauss-Markov noise with a white part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GaussMarkov {
    /// Correlation time T in units of the clock; 0 for white noise.
    pub(super) time_constant: f64,
    /// Angular frequency omega, in radians per unit of the clock.
    pub(super) angular: f64,
    /// Whether its realisations have a derivative.
    pub(super) smooth: bool,
    /// The part of the variance that is white.
    pub(super) white: f64,
    /// What its correlation decays over.
    pub(super) clock: Clock,
}

/// What the correlation of two samples decays over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Clock {
    /// Time.
    Time,
    /// The number of samples: what drifts from one analysis to the next, whenever they are made.
    Samples,
}

/// The filter at each sample.
struct Gain {
    /// Transition of the two states from the sample before (2 by 2).
    transition: [f64; 4],
    /// Gain of both states.
    gain: [f64; 2],
    /// Deviation of the innovation.
    deviation: f64,
}

impl GaussMarkov {
    pub(super) const WHITE: Self =
        Self { time_constant: 0.0, angular: 0.0, smooth: false, white: 1.0, clock: Clock::Time };

    /// Correlation of two samples that are `apart`.
    pub(super) fn correlation(&self, apart: f64) -> f64 {
        match apart == 0.0 {
            true => 1.0,
            false => (1.0 - self.white) * self.transition(apart)[0],
        }
    }

    /// Transition of states of variance 1 over a time: the noise, and its quadrature or its rate.
    fn transition(&self, apart: f64) -> [f64; 4] {
        // below 2^-50 nothing is left in a number
        if self.time_constant * 50.0 * LN_2 <= apart {
            return [0.0; 4];
        }
        let (angle, past) = (self.angular * apart, apart / self.time_constant);
        let size = (-past).exp();
        let (sine, cosine) = (size * angle.sin(), size * angle.cos());
        if !self.smooth {
            return [cosine, -sine, sine, cosine];
        }
        // sin(omega t) / (omega T), also where nothing turns
        let lag = if angle > 0.0 { sine * past / angle } else { size * past };
        let swing = lag * self.time_constant * (self.angular.powi(2) + self.time_constant.powi(-2)).sqrt();
        [cosine + lag, swing, -swing, cosine - lag]
    }

    fn gains(&self, moments: &[f64]) -> Vec<Gain> {
        let slow = 1.0 - self.white;
        // covariance of the states: both variances, and between them what they have in common
        let ([mut p, mut r], mut q, mut before) = ([slow; 2], 0.0, f64::NEG_INFINITY);
        let gain = |t: &f64| {
            let transition = self.transition(t - before);
            let [a, b, c, d] = transition;
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
            Gain { transition, gain, deviation: innovation.sqrt() }
        };
        moments.iter().map(gain).collect()
    }

    /// Makes independent numbers of deviation 1 of columns that have this noise: `L^-1 rows` in place (a row of `width` for each
    /// moment of the clock); returns the logarithm of the determinant of `L L'`.
    pub(super) fn whiten(&self, moments: &[f64], rows: &mut [f64], width: usize) -> f64 {
        let (mut seen, mut unseen) = (vec![0.0; width], vec![0.0; width]);
        let mut logarithm = 0.0;
        for (Gain { transition: [a, b, c, d], gain, deviation }, row) in
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
        for (Gain { transition: [a, b, c, d], gain, deviation }, row) in
            gains.iter().zip(rows.chunks_exact_mut(width)).rev()
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

/// From one number to the other in equal factors that are at most `step`.
pub(super) fn spaced(from: f64, to: f64, step: f64) -> impl Iterator<Item = f64> {
    let to = to.max(from);
    let steps = ((to / from).ln() / step.ln()).ceil().max(1.0);
    (0..=steps as usize).map(move |k| from * (to / from).powf(k as f64 / steps))
}
