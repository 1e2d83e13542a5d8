//! What is assumed about measurement noise, and the likelihood that follows from it.
//!
//! With estimated covariance the cost is the concentrated one: R is a function of the residuals, so that cost and
//! weights agree at every point and no separate relaxation is needed. A residual that vanishes (noise-free data) would
//! make the weights infinite; variances are therefore floored at (1e-14 of the output's own magnitude)^2, below which the
//! cost continues along its tangent. Estimates do not depend on the floor, and their standard errors then stand for it.
//!
//! Likelihoods without a maximum: a variance that is estimated from samples which the model passes through, and a deviation that passes zero. The
//! logarithm of such a number has no least value, so that the place where an iteration ends says nothing.
//!
//! The reciprocal of a variance that was estimated with f degrees of freedom is, on the average, f/(f - 2) times that of the true one: the inverse of a
//! chi-squared number has the mean 1/(f - 2). It is the weight of an output beside the others (Carroll and Cline, Biometrika 75, 1988, of least squares with
//! such weights): with two degrees of freedom or fewer it has no mean, and the more an output is followed the fewer it has. With a covariance of q outputs
//! the law is the inverse of Wishart's, and 2 becomes q + 1 (Press, Applied multivariate analysis, 1982).

use fdm_grammar::model::Output;
use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};
use std::fmt;

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

/// Why a likelihood has no maximum that could be reported.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Degeneracy {
    /// The noise of these outputs is estimated, and they leave two degrees of freedom or fewer for it.
    Variance {
        /// The outputs.
        outputs: Vec<String>,
        /// Their compared samples.
        samples: usize,
        /// Samples less the sum of their leverages.
        freedom: f64,
    },
    /// The standard deviation that is stated for an output passes zero within a run.
    Deviation {
        /// The output.
        output: String,
        /// What is stated.
        expression: String,
        /// The run.
        run: String,
        /// Time since the run began, in the model's time unit.
        time: f64,
    },
    /// Elsewhere the likelihood is greater than at its maximum here, and the more so the better the model passes through the samples of an output.
    Elsewhere {
        /// The output.
        output: String,
        /// Its compared samples.
        samples: usize,
        /// By how much the logarithm of the likelihood was greater where the search for that place ended.
        gain: f64,
    },
}

/// What gives a likelihood its maximum back where a variance collapses.
const CURE: &str = "state the noise (--noise OUTPUT=DEVIATION), or give all outputs one relative deviation \
                    (`param rel = 0.1 in [0.001, 1]; noise OUTPUT = FLOOR + rel*abs(OUTPUT);` for each)";

impl fmt::Display for Degeneracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Variance { outputs, samples, freedom } => {
                let names: Vec<String> = outputs.iter().map(|o| format!("`{o}`")).collect();
                let names = names.join(", ");
                write!(
                    f,
                    "the likelihood has no maximum: the model passes through the {samples} samples of {names}, which leave {:.1} degrees of freedom \
                     for a noise of its own, and its weight grows without end; {CURE}",
                    freedom.max(0.0)
                )
            }
            Self::Elsewhere { output, samples, gain } => write!(
                f,
                "the likelihood has no maximum: other values lead the model through the {samples} samples of `{output}` (log-likelihood +{gain:.1}), and \
                 which of both is found depends on the start; {CURE}"
            ),
            Self::Deviation { output, expression, run, time } => write!(
                f,
                "run `{run}`: the stated deviation of `{output}`, {expression}, passes zero at time {time:.4}: a sample there would be exact, and the \
                 likelihood has no maximum; add a floor (`noise {output} = FLOOR + {expression};`)"
            ),
        }
    }
}

/// Degrees of freedom of an estimated variance up to which its reciprocal has no mean.
const NO_MEAN: f64 = 2.0;

/// Of a direction, when degrees of freedom are counted in whole ones.
const HALF: f64 = 0.5;

/// The outputs among `names` whose estimated noise no sample tells; `leverages` (q) are the sums of their leverages. `alone` says that nothing else is
/// compared and nothing is known beforehand: then their weight decides nothing.
pub(crate) fn collapsed(names: &[String], likelihood: &Likelihood, leverages: &[f64], alone: bool) -> Vec<Degeneracy> {
    if alone || leverages.len() != likelihood.counts.len() {
        return Vec::new();
    }
    let compared = likelihood.counts.iter().filter(|n| **n > 0).count() as f64;
    let least = if likelihood.is_full() { compared + 1.0 } else { NO_MEAN };
    let samples = likelihood.samples_of_outputs();
    let few = |o: &usize| {
        let left = samples[*o].map(|samples| samples - leverages[*o]);
        likelihood.counts[*o] > 0 && left.is_some_and(|left| is_too_few(left, leverages[*o], least))
    };
    let told = |o: usize| Degeneracy::Variance {
        outputs: vec![names[o].clone()],
        samples: likelihood.counts[o],
        freedom: samples[o].unwrap_or(0.0) - leverages[o],
    };
    (0..leverages.len()).filter(few).map(told).collect()
}

/// Whether so many degrees of freedom tell no noise that weighs on an estimate: `followed` parameters follow these samples.
pub(crate) fn is_too_few(freedom: f64, followed: f64, least: f64) -> bool {
    // a leverage is known to rounding, and what follows an output in less than half of a direction follows others in the rest
    followed >= 1.0 - 1e-6 && freedom < least + HALF
}

/// [`is_too_few`] of one variance.
pub(crate) fn tells_no_variance(freedom: f64, followed: f64) -> bool {
    is_too_few(freedom, followed, NO_MEAN)
}

/// Where a deviation passes zero: `(left, right)` of its least values, by the lines through two values on either side. `values` are at even times, a
/// sixteenth of a sample apart, so that the lines hold.
pub(crate) fn passes_zero(values: &[f64]) -> Option<usize> {
    let touches = |v: &[f64]| {
        let [a, b, least, c, d] = *v else { return false };
        let dips = least <= b && least <= c && b < a && c < d;
        if !(dips && v.iter().all(|s| s.is_finite())) {
            return false;
        }
        // where the lines through a, b and through d, c meet
        let (left, right) = (a - b, d - c);
        let part = ((b - c + 2.0 * right) / (left + right)).clamp(0.0, 2.0);
        b - left * part <= ZERO * (b + c)
    };
    values.windows(5).position(touches).map(|first| first + 2)
}

/// Part of its neighbours, a sixteenth of a sample apart, below which a deviation is none: a smaller floor than that is crossed between two samples.
const ZERO: f64 = 0.05;

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

#[cfg(test)]
mod degenerate_tests {
    use super::*;
    use crate::problem::noise::Noise;

    #[test]
    fn a_variance_of_two_degrees_of_freedom_is_none_where_it_weighs_beside_others() {
        let names = ["a".to_string(), "b".to_string()];
        let z = [1.0; 12];
        let told = |noise: Noise, leverages: [f64; 2], alone: bool| {
            let likelihood = Likelihood::new(&noise, 2, [&z[..]].into_iter(), 1.0);
            collapsed(&names, &likelihood, &leverages, alone).len()
        };
        assert_eq!(told(Noise::Diagonal, [2.0, 4.0], false), 1, "six samples of b, of which four are followed");
        assert_eq!(told(Noise::Diagonal, [2.0, 3.9], false), 1, "a direction that is followed but for a tenth");
        assert_eq!(told(Noise::Diagonal, [2.0, 3.4], false), 0);
        assert_eq!(told(Noise::Diagonal, [2.0, 4.0], true), 0, "a single weight decides nothing");
        assert_eq!(told(Noise::Given(vec![None, Some(0.1)]), [2.0, 6.0], false), 0, "a known noise is known");
        assert_eq!(told(Noise::Full, [3.0, 3.0], false), 2, "Wishart's law wants one more for each output");
        assert_eq!(told(Noise::Full, [2.4, 2.4], false), 0);
    }

    #[test]
    fn a_deviation_that_passes_zero_is_told_from_one_with_a_floor() {
        let at =
            |s: &dyn Fn(f64) -> f64| passes_zero(&(0..40).map(|k| s(0.05 * f64::from(k) - 1.02)).collect::<Vec<_>>());
        assert_eq!(at(&|x| 0.1 * x.abs()), Some(20));
        assert_eq!(at(&|x| (x + 0.3 * x * x).abs()), Some(20));
        assert_eq!(at(&|x| x * x), Some(20));
        for floor in [0.02, 0.2, 1.0] {
            assert_eq!(at(&|x| floor + 0.8 * x.abs()), None, "{floor}");
        }
        assert_eq!(at(&|x| (0.2 + x * x).sqrt()), None);
        assert_eq!(at(&|x| (-3.0 * x).exp()), None);
    }
}
