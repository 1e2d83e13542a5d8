//! What is assumed about measurement noise, and the likelihood that follows from it.
//!
//! With estimated covariance the cost is the concentrated one: R is a function of the residuals, so that cost and
//! weights agree at every point and no separate relaxation is needed. A residual that vanishes (noise-free data) would
//! make the weights infinite; variances are therefore floored at (1e-14 of the output's own magnitude)^2, below which the
//! cost continues along its tangent. Estimates do not depend on the floor, and their standard errors then stand for it.

use fdm_grammar::model::Output;
use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

/// What is assumed about the measurement noise; it is white and, but for `Full`, independent from output to output.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Noise {
    /// One variance for each output, estimated.
    #[default]
    Diagonal,
    /// The whole covariance, estimated. Samples must have all outputs or none.
    Full,
    /// Standard deviations that are known (q); those that are not are estimated.
    Given(Vec<Option<f64>>),
}

impl Noise {
    /// This noise, but what a model declares (`noise y = ...;`) is known where all variances were to be estimated.
    /// `Given` without a number estimates them in spite of that.
    pub fn or_declared(self, outputs: &[Output]) -> Self {
        let declared: Vec<Option<f64>> = outputs.iter().map(|o| o.noise).collect();
        match self {
            Self::Diagonal if declared.iter().any(Option::is_some) => Self::Given(declared),
            chosen => chosen,
        }
    }
}

/// Residual variance that counts as zero, relative to the square of the output's magnitude.
const FLOOR: f64 = 1e-28;

/// Residual variance that is the rounding of a simulation, relative to the same.
const EXACT: f64 = 1e-20;

/// What does not change during an estimation.
#[derive(Debug, Clone)]
pub(crate) struct Likelihood {
    noise: Noise,
    /// Root mean square of each measured output (q), never zero.
    magnitude: Vec<f64>,
    /// Compared samples of each output (q).
    pub(crate) counts: Vec<usize>,
    /// Independent part of a sample: less than 1 where samples repeat each other.
    worth: f64,
}

/// Covariance and cost that belong to given residuals.
#[derive(Debug, Clone, Default)]
pub(crate) struct Weights {
    /// Minus the logarithm of the likelihood, without the constant n/2 log 2 pi.
    pub(crate) cost: f64,
    /// What of the cost is beside the squares, where the likelihood is another; it may have any sign.
    pub(crate) beside: f64,
    /// Changes of the cost below this are rounding.
    pub(crate) rounding: f64,
    /// R, q by q.
    pub(crate) covariance: Vec<f64>,
    /// W with W'W = R^-1 times the independent part of a sample, q by q; diagonal unless the noise is full.
    pub(crate) whitener: Vec<f64>,
    /// Outputs that are matched to rounding (q).
    pub(crate) exact: Vec<bool>,
    /// Mean square of the residuals in units of the noise: 1 where that is estimated.
    pub(crate) scatter: f64,
}

impl Likelihood {
    /// Takes the measured samples, run by run (each N by q), and the independent part of a sample: the logarithm of the likelihood of samples that repeat each
    /// other is that of all of them times the part that is independent.
    pub(crate) fn new<'m>(noise: &Noise, q: usize, measured: impl Iterator<Item = &'m [f64]>, worth: f64) -> Self {
        let (mut counts, mut squares) = (vec![0usize; q], vec![0.0; q]);
        for (k, z) in measured.flat_map(|run| run.iter().enumerate()).filter(|(_, z)| !z.is_nan()) {
            counts[k % q] += 1;
            squares[k % q] += z * z;
        }
        let magnitude = |(s, n): (&f64, &usize)| (s / (*n).max(1) as f64).sqrt();
        let magnitude: Vec<f64> = squares.iter().zip(&counts).map(magnitude).collect();
        Self { noise: noise.clone(), magnitude: magnitude.iter().map(|m| nonzero(*m)).collect(), counts, worth }
    }

    /// The least cost that residuals can have: all of them zero.
    pub(crate) fn least(&self) -> f64 {
        let of = |(o, n): (usize, &usize)| {
            let known = if let Noise::Given(given) = &self.noise { given[o].map(|s| s * s) } else { None };
            0.5 * *n as f64 * known.unwrap_or(FLOOR * self.magnitude[o].powi(2)).ln()
        };
        self.worth * self.counts.iter().enumerate().filter(|(_, n)| **n > 0).map(of).sum::<f64>()
    }

    /// Whether residuals can have this cost; one that is not a finite number, or below all of them, is none.
    pub(crate) fn admits(&self, cost: f64) -> bool {
        let least = self.least();
        cost.is_finite() && cost >= least - 1e-6 * (1.0 + least.abs())
    }

    /// Whether outputs are weighted together.
    pub(crate) fn is_full(&self) -> bool {
        self.noise == Noise::Full
    }

    /// Whether the variance of an output is estimated.
    pub(crate) fn estimates(&self, output: usize) -> bool {
        !matches!(&self.noise, Noise::Given(given) if given[output].is_some())
    }

    /// Compared samples of all outputs, counted for the part that is independent.
    fn samples(&self) -> f64 {
        self.worth * self.counts.iter().sum::<usize>() as f64
    }

    /// Logarithm of the likelihood whose variable part is `cost`.
    pub(crate) fn logarithm(&self, cost: f64) -> f64 {
        -cost - 0.5 * self.samples() * std::f64::consts::TAU.ln()
    }

    /// Samples by which each output's noise is estimated; none of an output whose noise is known.
    pub(crate) fn samples_of_outputs(&self) -> Vec<Option<f64>> {
        let of = |(o, count): (usize, &usize)| self.estimates(o).then_some(self.worth * *count as f64);
        self.counts.iter().enumerate().map(of).collect()
    }

    /// Size of the noise relative to the measured outputs, as one number.
    pub(crate) fn relative_noise(&self, weights: &Weights) -> f64 {
        let q = self.counts.len();
        let measured = || (0..q).filter(|o| self.counts[*o] > 0);
        let sum: f64 = measured().map(|o| weights.covariance[o * q + o] / self.magnitude[o].powi(2)).sum();
        (sum / measured().count().max(1) as f64).sqrt()
    }

    /// Factors of the sums of each group: full noise has been mixed in already.
    pub(crate) fn factors(&self, weights: &Weights) -> Vec<f64> {
        let q = self.counts.len();
        if self.is_full() { vec![1.0] } else { (0..q).map(|o| weights.whitener[o * q + o]).collect() }
    }

    /// Weights from `moments` (q by q): sums of products of residuals, of which only `Full` reads more than the diagonal.
    pub(crate) fn weights(&self, moments: &[f64]) -> Weights {
        let mut weights = if self.is_full() { self.full(moments) } else { self.diagonal(moments) };
        if self.worth != 1.0 {
            weights.cost *= self.worth;
            weights.rounding *= self.worth;
            weights.whitener.iter_mut().for_each(|w| *w *= self.worth.sqrt());
        }
        weights.rounding += 4.0 * f64::EPSILON * weights.cost.abs();
        weights
    }

    fn diagonal(&self, moments: &[f64]) -> Weights {
        let q = self.counts.len();
        let mut weights = Weights::blank(q);
        let samples = self.counts.iter().sum::<usize>() as f64;
        weights.scatter = 0.0;
        for o in (0..q).filter(|o| self.counts[*o] > 0) {
            let (n, sum, at) = (self.counts[o] as f64, moments[o * q + o], o * q + o);
            let floor = FLOOR * self.magnitude[o].powi(2);
            let known = if let Noise::Given(given) = &self.noise { given[o].map(|s| s * s) } else { None };
            let variance = known.unwrap_or((sum / n).max(floor));
            weights.exact[o] = known.is_none() && sum / n < EXACT * self.magnitude[o].powi(2);
            weights.covariance[at] = variance;
            weights.whitener[at] = 1.0 / variance.sqrt();
            weights.cost += 0.5 * sum / variance + 0.5 * n * variance.ln();
            // an estimated variance is that of the residuals, floored or not
            weights.scatter += if known.is_some() { sum / variance } else { n } / samples;
            // each residual carries a rounding error of about one unit in the last place of the output
            weights.rounding += 4.0 * f64::EPSILON * n * (self.magnitude[o] / variance.sqrt() + 1.0);
        }
        weights
    }

    /// In outputs divided by their magnitudes: eigenvalues are floored one by one.
    fn full(&self, moments: &[f64]) -> Weights {
        let q = self.counts.len();
        let mut weights = Weights::blank(q);
        let n = self.counts[0] as f64;
        let scaled = DMatrix::from_fn(q, q, |a, b| moments[a * q + b] / (n * self.magnitude[a] * self.magnitude[b]));
        if scaled.iter().any(|v| !v.is_finite()) {
            weights.cost = f64::NAN;
            return weights;
        }
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(scaled);
        // an eigenvalue is known to rounding of the largest one only
        let floor = FLOOR.max(1e-13 * eigenvalues.max());
        for k in 0..q {
            let value = eigenvalues[k].max(floor);
            weights.cost += 0.5 * n * (eigenvalues[k].max(0.0) / value + value.ln()) + n * self.magnitude[k].ln();
            weights.rounding += 4.0 * f64::EPSILON * n * (1.0 / value.sqrt() + 1.0);
            for a in 0..q {
                weights.whitener[k * q + a] = eigenvectors[(a, k)] / (self.magnitude[a] * value.sqrt());
                for b in 0..q {
                    let part = eigenvectors[(a, k)] * value * eigenvectors[(b, k)];
                    weights.covariance[a * q + b] += part * self.magnitude[a] * self.magnitude[b];
                }
            }
        }
        for (a, exact) in weights.exact.iter_mut().enumerate() {
            *exact = moments[a * q + a] / n < EXACT * self.magnitude[a].powi(2);
        }
        weights
    }

    /// The covariance corrected for as many degrees of freedom as parameters were estimated from the data: every output
    /// gives its share, so that one factor N / (N - p) serves all (N compared samples, p unknowns; one that its prior
    /// determines in part counts in part). Known variances stay. Without degrees of freedom left there is none.
    pub(crate) fn corrected(&self, weights: &Weights, unknowns: f64) -> Option<Weights> {
        let q = self.counts.len();
        let mut corrected = weights.clone();
        if (0..q).all(|o| !self.estimates(o)) {
            return Some(corrected);
        }
        let samples = self.samples();
        let left = samples - unknowns;
        if left <= 1e-6 * samples {
            return None;
        }
        let factor = samples / left;
        for a in (0..q).filter(|a| self.estimates(*a)) {
            for b in (0..q).filter(|b| self.estimates(*b)) {
                corrected.covariance[a * q + b] *= factor;
                corrected.whitener[a * q + b] /= factor.sqrt();
            }
        }
        Some(corrected)
    }
}

impl Weights {
    fn blank(q: usize) -> Self {
        let (covariance, whitener) = (vec![0.0; q * q], vec![0.0; q * q]);
        Self { cost: 0.0, beside: 0.0, rounding: 0.0, covariance, whitener, exact: vec![false; q], scatter: 1.0 }
    }

    /// R^-1 times the independent part of a sample, q by q; zero for outputs that were never measured.
    pub(crate) fn inverse(&self) -> Vec<f64> {
        let (q, w) = (self.exact.len(), &self.whitener);
        let entry = |a: usize, b: usize| (0..q).map(|k| w[k * q + a] * w[k * q + b]).sum();
        (0..q * q).map(|k| entry(k / q, k % q)).collect()
    }
}

fn nonzero(value: f64) -> f64 {
    if value > 0.0 && value.is_finite() { value } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declared_noise_is_known_where_all_were_to_be_estimated() {
        let text = "model m { input u; param a = 1; output y = a*u, z = u; noise z = 0.5; }";
        let model = fdm_grammar::compile(&fdm_grammar::Source::new("m", text)).expect("a model").model;
        let of = |noise: Noise| noise.or_declared(&model.outputs);
        assert_eq!(of(Noise::Diagonal), Noise::Given(vec![None, Some(0.5)]));
        assert_eq!(of(Noise::Full), Noise::Full);
        assert_eq!(of(Noise::Given(vec![None; 2])), Noise::Given(vec![None; 2]), "estimated all the same");
        assert_eq!(Noise::Diagonal.or_declared(&model.outputs[..1]), Noise::Diagonal);
    }

    #[test]
    fn cost_is_the_concentrated_likelihood_and_continues_below_the_floor() {
        let z = [1.0, 1.0, -1.0, -1.0];
        let likelihood = Likelihood::new(&Noise::Diagonal, 1, [&z[..]].into_iter(), 1.0);
        let cost = |sum: f64| likelihood.weights(&[sum]).cost;
        assert!((cost(4.0 * 0.25) - (2.0 + 2.0 * 0.25f64.ln())).abs() < 1e-14);
        assert!(cost(0.0).is_finite());
        assert!(cost(0.0) < cost(1e-24) && cost(1e-24) < cost(8e-24), "monotonic through the floor");
        assert!(likelihood.weights(&[0.0]).exact[0]);
    }

    #[test]
    fn costs_below_that_of_a_perfect_match_and_no_numbers_are_impossible() {
        let z = [3.0, 0.1, -3.0, 0.1];
        for noise in [Noise::Diagonal, Noise::Full, Noise::Given(vec![Some(1e-3), None])] {
            let likelihood = Likelihood::new(&noise, 2, [&z[..]].into_iter(), 1.0);
            let cost = |moments: [f64; 4]| likelihood.weights(&moments).cost;
            assert!(likelihood.admits(cost([0.0; 4])) && likelihood.admits(cost([1e30, 0.0, 0.0, 1e30])), "{noise:?}");
            for wrong in [-4.6e18, likelihood.least() - 1.0, f64::NAN, f64::INFINITY] {
                assert!(!likelihood.admits(wrong), "{noise:?} {wrong}");
            }
        }
    }

    #[test]
    fn full_noise_of_uncorrelated_outputs_equals_diagonal_noise() {
        let z = [3.0, 0.1, -3.0, 0.1];
        let of = |noise: Noise| Likelihood::new(&noise, 2, [&z[..]].into_iter(), 1.0).weights(&[0.5, 0.0, 0.0, 2e-4]);
        let (full, diagonal) = (of(Noise::Full), of(Noise::Diagonal));
        assert!((full.cost - diagonal.cost).abs() < 1e-12);
        for (a, b) in full.covariance.iter().zip(&diagonal.covariance) {
            assert!((a - b).abs() < 1e-15);
        }
    }

    #[test]
    fn samples_that_repeat_each_other_count_for_what_they_are_worth() {
        // every sample three times, and each time worth a third
        let (z, thrice) = ([1.0, 2.0, -1.0], [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, -1.0, -1.0, -1.0]);
        let noises = [Noise::Diagonal, Noise::Full, Noise::Given(vec![Some(0.4)])];
        for noise in noises {
            let of = |z: &[f64], worth: f64| Likelihood::new(&noise, 1, std::iter::once(z), worth);
            let (once, repeated) = (of(&z, 1.0), of(&thrice, 1.0 / 3.0));
            let (a, b) = (once.weights(&[0.7]), repeated.weights(&[2.1]));
            assert!((a.cost - b.cost).abs() < 1e-13 && (a.covariance[0] - b.covariance[0]).abs() < 1e-15, "{noise:?}");
            // sums over three times as many samples
            assert!((a.inverse()[0] - 3.0 * b.inverse()[0]).abs() < 1e-13, "{noise:?}");
            let left = [(&once, &a), (&repeated, &b)].map(|(l, w)| l.corrected(w, 2.0).map(|w| w.covariance[0]));
            assert!((left[0].expect("one is left") - left[1].expect("one is left")).abs() < 1e-14, "{noise:?}");
        }
    }

    #[test]
    fn known_deviations_stay_when_degrees_of_freedom_are_taken_off() {
        let z = [1.0, 1.0, 2.0, 2.0];
        let likelihood = Likelihood::new(&Noise::Given(vec![Some(0.5), None]), 2, [&z[..]].into_iter(), 1.0);
        let weights = likelihood.weights(&[1.0, 0.0, 0.0, 1.0]);
        let corrected = likelihood.corrected(&weights, 2.0).expect("degrees of freedom are left");
        assert_eq!((corrected.covariance[0], corrected.covariance[3]), (0.25, 1.0));
        assert!(likelihood.corrected(&weights, 4.0).is_none());
    }
}
