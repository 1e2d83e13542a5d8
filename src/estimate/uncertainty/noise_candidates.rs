//! The noise models that short runs are judged by, each with its prior probability: white; first-order and smooth Gauss-Markov noise, noise that oscillates
//! ([`super::noise_candidates`]); and 1/f noise ([`super::flicker`]).
//!
//! Gauss-Markov noise of deviation 1 beside a white part w: `Rvv(t) = (1 - w) exp(-|t|/T) cos(omega t)`, or smooth, as what has passed an oscillator,
//! `(1 - w) exp(-|t|/T) (cos(omega t) + sin(omega |t|)/(omega T))`. As a process of two states it is filtered exactly at any times, even or not (Kalman
//! 1960): its Cholesky factor L and the determinant in one pass.

use super::flicker::Flicker;
use super::sensitivity_rows::SensitivityRows;
use std::f64::consts::{LN_2, TAU};

/// What the noise of a short run may be.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum NoiseModel {
    /// White, of one correlation time, or oscillating.
    GaussMarkov(GaussMarkov),
    /// Of all correlation times.
    Flicker(Flicker),
}

impl NoiseModel {
    /// What its correlation decays over.
    pub(super) fn clock(&self) -> Clock {
        match self {
            Self::GaussMarkov(noise) => noise.clock,
            Self::Flicker(noise) => noise.clock,
        }
    }

    /// Correlation of two samples that are `apart`, in units of the clock.
    pub(super) fn correlation(&self, apart: f64) -> f64 {
        match self {
            Self::GaussMarkov(noise) => noise.correlation(apart),
            Self::Flicker(noise) => noise.correlation(apart),
        }
    }

    /// `L^-1 rows` in place (a row of `width` for each moment of the clock), L the Cholesky factor of its correlations; returns the logarithm of the
    /// determinant of `L L'`.
    pub(super) fn whiten(&self, moments: &[f64], rows: &mut [f64], width: usize) -> f64 {
        match self {
            Self::GaussMarkov(noise) => noise.whiten(moments, rows, width),
            Self::Flicker(noise) => noise.whiten(moments, rows, width),
        }
    }

    /// `L' rows` in place.
    pub(super) fn transpose(&self, moments: &[f64], rows: &mut [f64], width: usize) {
        match self {
            Self::GaussMarkov(noise) => noise.transpose(moments, rows, width),
            Self::Flicker(noise) => noise.transpose(moments, rows, width),
        }
    }
}

/// Prior probability that all noise is white.
const WHITE: f64 = 0.6;
/// What is left of it: for first-order noise, for its smooth kind, for second-order noise that oscillates, and for 1/f noise. Which kind an instrument has
/// nobody knows beforehand: none of the rough ones is less likely than half another, and what is smooth is rare.
const SHARES: [f64; 4] = [0.4, 0.1, 0.3, 0.2];
/// White parts of first-order and 1/f noise, and of all others.
const PARTS: [f64; 3] = [0.0, 0.3, 0.6];
const OTHER_PARTS: [f64; 2] = [0.0, 0.4];
/// Angles that oscillating noise turns through in its correlation time.
const TURNS: [f64; 3] = [2.0, 6.0, 20.0];
/// Factor from one period to the next, at most.
const PERIOD_STEP: f64 = 1.4;
/// Shortest correlation time, in intervals.
const SHORTEST: f64 = 0.4;
/// Longest, in lengths of the longest record; smooth noise correlates over more than twice its time, and longer ones are trends.
const LONGEST: f64 = 2.0;
const LONGEST_SMOOTH: f64 = 0.25;
/// Longest correlation time of 1/f noise, in the same: what is slower is an offset within the record, which its size takes up.
const LONGEST_FLICKER: f64 = 4.0;
/// Shortest correlation time of 1/f noise, in intervals: from there on it is white.
const SHORTEST_FLICKER: f64 = 0.5;
/// Longest period, in the same: what swings once within a short record is what its parameters imitate best.
const LONGEST_PERIOD: f64 = 1.0;
/// Factor from one time to the next, at most.
const STEP: f64 = 1.7;

/// The median of all intervals.
pub(super) fn median_interval(runs: &[&SensitivityRows]) -> f64 {
    let steps = |run: &&SensitivityRows| run.moments.windows(2).map(|t| t[1] - t[0]).collect::<Vec<f64>>();
    let mut all: Vec<f64> = runs.iter().flat_map(steps).collect();
    let middle = all.len() / 2;
    let interval = if all.is_empty() { 0.0 } else { *all.select_nth_unstable_by(middle, f64::total_cmp).1 };
    if interval > 0.0 { interval } else { 1.0 }
}

/// All noise models, white noise the first, and the share of each of the others in the prior probability that the noise is not white.
pub(super) fn candidates(runs: &[&SensitivityRows], interval: f64) -> (Vec<NoiseModel>, Vec<f64>) {
    let span = |run: &&SensitivityRows| run.moments.last().unwrap_or(&0.0) - run.moments.first().unwrap_or(&0.0);
    let length = runs.iter().map(span).fold(interval, f64::max);
    let count = runs.iter().map(|run| run.moments.len()).max().unwrap_or(2) as f64;
    let uneven = runs.iter().any(|run| !run.even);
    let clocks = [(Clock::Time, interval, length), (Clock::Samples, 1.0, count)];
    let (mut rough, mut smooth, mut oscillating, mut flickering) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (clock, interval, length) in clocks.into_iter().take(1 + usize::from(uneven)) {
        for time_constant in spaced(SHORTEST * interval, LONGEST * length, STEP) {
            let noise = |smooth, white| GaussMarkov { time_constant, angular: 0.0, smooth, white, clock };
            rough.extend(PARTS.map(|white| noise(false, white)));
            if time_constant < LONGEST_SMOOTH * length {
                smooth.extend(OTHER_PARTS.map(|white| noise(true, white)));
            }
        }
        let times = [SHORTEST_FLICKER * interval, LONGEST_FLICKER * length];
        flickering.extend(PARTS.map(|white| NoiseModel::Flicker(Flicker::new(times, white, clock))));
    }
    for angular in spaced(2.0 * interval, LONGEST_PERIOD * length, PERIOD_STEP).map(|period| TAU / period) {
        // what turns longest is a line, rough or smooth
        let kinds = TURNS.into_iter().flat_map(|t| [(t, false), (t, true)]).take(2 * TURNS.len() - 1);
        for (turns, smooth) in kinds {
            let time_constant = turns / angular;
            let noise = |white| GaussMarkov { time_constant, angular, smooth, white, clock: Clock::Time };
            oscillating.extend(OTHER_PARTS.map(noise));
        }
    }
    let [rough, smooth, oscillating] =
        [rough, smooth, oscillating].map(|kind| kind.into_iter().map(NoiseModel::GaussMarkov).collect::<Vec<_>>());
    let (mut all, mut shares) = (vec![NoiseModel::GaussMarkov(GaussMarkov::WHITE)], Vec::new());
    for (models, share) in [rough, smooth, oscillating, flickering].into_iter().zip(SHARES) {
        shares.extend(models.iter().map(|_| share / models.len() as f64));
        all.extend(models);
    }
    (all, shares)
}

/// Logarithm of the prior probability of each model, where so many outputs have each its own.
pub(super) fn log_prior(shares: &[f64], outputs: usize) -> Vec<f64> {
    let white = WHITE.powf(1.0 / outputs as f64);
    std::iter::once(white.ln()).chain(shares.iter().map(|share| ((1.0 - white) * share).ln())).collect()
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Cholesky, DMatrix};

    #[test]
    fn factors_are_those_of_the_covariance() {
        let moments: [f64; 7] = [0.0, 0.5, 0.6, 2.0, 2.1, 7.0, 7.5];
        let n = moments.len();
        let columns: Vec<f64> = (0..2 * n).map(|k| (0.7 * k as f64).sin() + 0.1 * k as f64).collect();
        let noise = |time_constant, angular, white| GaussMarkov {
            time_constant,
            angular,
            smooth: false,
            white,
            clock: Clock::Time,
        };
        let gauss_markov = [
            GaussMarkov::WHITE,
            noise(1.3, 0.0, 0.0),
            noise(0.4, 0.0, 0.3),
            noise(50.0, 0.0, 0.6),
            noise(3.0, 2.0, 0.0),
            noise(0.7, 9.0, 0.3),
            GaussMarkov { smooth: true, ..noise(1.3, 0.0, 0.0) },
            GaussMarkov { smooth: true, ..noise(3.0, 2.0, 0.1) },
        ];
        let flicker = [0.0, 0.4].map(|white| NoiseModel::Flicker(Flicker::new([0.2, 30.0], white, Clock::Time)));
        for noise in gauss_markov.map(NoiseModel::GaussMarkov).into_iter().chain(flicker) {
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
