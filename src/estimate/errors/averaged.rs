//! Errors where records are short, or their times uneven: no colour of the noise can be chosen there, so all that are possible are
//! weighed by their restricted likelihood (Patterson and Thompson 1971), and errors averaged over them.
//!
//! All outputs share one colour, or each has its own; both hypotheses are weighed. Correlated outputs are taken apart first by the Cholesky
//! factor L of their covariance: what is weighed are `L^-1 e`, and each acts on the parameters by `S' R^-1 L`. What follows for a variance are
//! many values, each with its weight; the interval is that of the mixture.

use super::beliefs::{before, beliefs, interval};
use super::combination::{Combinations, Member, Part, normal};
use super::forgetful::{Clock, Forgetful};
use super::mixture::Mixture;
use super::restricted::{Likely, Normal, Restricted};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// The average over all beliefs.
pub(super) struct Averaged {
    /// Variance of each chosen unknown, the others included, and its degrees of freedom (n).
    pub(super) variances: Vec<(f64, f64)>,
    /// The mean of `S' R^-1 Rvv R^-1 S` (n by n).
    pub(super) middle: DMatrix<f64>,
    /// For each output the correlations of its noise at lags 0, 1, .. intervals; none where white noise is the most likely.
    pub(super) correlations: Vec<Option<Vec<f64>>>,
    /// For each output the variance of its noise over the one that the fit found.
    pub(super) scales: Vec<f64>,
}

/// Most that noise may be larger, as a variance, than what is left of it: fitting took four fifths of the deviation.
const MOST_GROWTH: f64 = 25.0;
/// Lags for which correlations are told.
const LAGS: usize = 6;

/// What one hypothesis says.
struct Said {
    /// Of each variance (n).
    variances: Vec<Mixture>,
    /// The mean of the middle (n by n).
    middle: DMatrix<f64>,
    /// For each output how likely each belief is.
    weights: Vec<Vec<f64>>,
    /// For each output the mean of its scale.
    scales: Vec<f64>,
    evidence: f64,
}

/// All beliefs about all outputs of all members.
pub(super) struct Beliefs {
    beliefs: Vec<Forgetful>,
    /// What each of them but the first has of the belief that the noise is not white.
    shares: Vec<f64>,
    restricted: Restricted,
    /// For each output and belief `S' R^-1 L C L' R^-1 S` (n by n).
    middles: Vec<Vec<DMatrix<f64>>>,
    pub(super) interval: f64,
}

impl Beliefs {
    /// `inverse_noise` is that of the fit, `covariance` that of the noise (q by q), `others` the information of other runs and of
    /// priors (n by n).
    pub(super) fn new(
        members: &[Member<'_>],
        inverse_noise: &[f64],
        covariance: &DMatrix<f64>,
        others: DMatrix<f64>,
    ) -> Self {
        let (q, n) = (members[0].rows.rows.len(), others.nrows());
        let interval = interval(members);
        let (beliefs, shares) = beliefs(members, interval);
        let combinations = Combinations::new(inverse_noise, covariance);
        let outputs: Vec<Vec<Part>> = (0..q).map(|k| combinations.parts(members, k)).collect();
        let samples = outputs.iter().map(|parts| parts.iter().map(|p| p.samples() as f64).sum()).collect();
        let tables: Vec<Vec<(Normal, DMatrix<f64>)>> =
            outputs.iter().map(|parts| beliefs.par_iter().map(|b| normal(parts, members, b, n)).collect()).collect();
        // at the estimates all together pull nowhere: the others against these
        let mut pull = DVector::zeros(n);
        if others.amax() > 0.0 {
            tables.iter().for_each(|t| pull -= &t[0].0.vector);
        }
        let (normals, middles) = tables.into_iter().map(|t| t.into_iter().unzip()).unzip();
        let restricted = Restricted { samples, normals, others, pull };
        Self { beliefs, shares, restricted, middles, interval }
    }

    /// The average, with the Cramer-Rao covariance of the fit (n by n) on both sides and beside it the middle of the others
    /// (n by n); none where numbers are not finite.
    pub(super) fn average(&self, inverse: &DMatrix<f64>, others: &DMatrix<f64>) -> Option<Averaged> {
        let q = self.middles.len();
        let white = self.restricted.likely(&vec![0; q])?;
        let variances = Variances::of(self, inverse, others);
        let together = self.together(&variances, &white)?;
        let hypotheses = if q > 1 { vec![self.apart(&variances, &white)?, together] } else { vec![together] };
        let highest = hypotheses.iter().map(|h| h.evidence).fold(f64::NEG_INFINITY, f64::max);
        let shares: Vec<f64> = hypotheses.iter().map(|h| (h.evidence - highest).exp()).collect();
        let all: f64 = shares.iter().sum();
        let n = inverse.nrows();
        let mut mixtures = vec![Mixture::none(); n];
        let mut middle = DMatrix::zeros(n, n);
        let mut weights = vec![vec![0.0; self.beliefs.len()]; q];
        let mut scales = vec![0.0; q];
        for (h, share) in hypotheses.iter().zip(shares.iter().map(|s| s / all)) {
            mixtures.iter_mut().zip(&h.variances).for_each(|(m, own)| m.or(own, share));
            scales.iter_mut().zip(&h.scales).for_each(|(s, own)| *s += share * own);
            middle += &h.middle * share;
            for (to, from) in weights.iter_mut().zip(&h.weights) {
                to.iter_mut().zip(from).for_each(|(t, f)| *t += share * f);
            }
        }
        // the scale of the noise is known by so many samples
        let freedom = |j: usize| {
            let own = |k: usize| variances.own[k][0][j];
            let all: f64 = (0..q).map(own).sum::<f64>() + variances.others[j];
            1.0 / (0..q).map(|k| (own(k) / all).powi(2) / white.freedom[k]).sum::<f64>()
        };
        let correlations = weights.iter().map(|w| self.correlations(w)).collect();
        let variances = mixtures.par_iter().enumerate().map(|(j, m)| m.student(freedom(j))).collect::<Option<_>>()?;
        Some(Averaged { variances, middle, correlations, scales })
    }

    /// Whether any sample of an output is compared.
    pub(super) fn compares(&self, output: usize) -> bool {
        self.restricted.samples[output] > 0.0
    }

    /// All outputs share one belief.
    fn together(&self, variances: &Variances, white: &Likely) -> Option<Said> {
        let q = self.middles.len();
        let likely: Vec<Likely> =
            (0..self.beliefs.len()).map(|b| self.restricted.likely(&vec![b; q])).collect::<Option<_>>()?;
        let (weights, evidence) = weigh(&before(&self.shares, 1), &likely);
        let growth = |b: usize, k: usize| growth(&likely[b], white, k);
        let variance = |b: usize, j: usize| {
            variances.others[j] + (0..q).map(|k| growth(b, k) * variances.own[k][b][j]).sum::<f64>()
        };
        let mixture = |j: usize| Mixture::of(weights.iter().enumerate().map(|(b, w)| (*w, variance(b, j))));
        let n = variances.others.len();
        let mut said = Said { variances: (0..n).map(mixture).collect(), ..Said::nothing(n, evidence) };
        for (b, weight) in weights.iter().enumerate() {
            (0..q).for_each(|k| said.middle += &self.middles[k][b] * (weight * growth(b, k)));
        }
        let scale = |k: usize| weights.iter().enumerate().map(|(b, w)| w * growth(b, k)).sum();
        said.scales = (0..q).map(scale).collect();
        said.weights = vec![weights; q];
        Some(said)
    }

    /// Each output has a belief of its own, weighed beside the likeliest of the others.
    fn apart(&self, variances: &Variances, white: &Likely) -> Option<Said> {
        let q = self.middles.len();
        let before = before(&self.shares, q);
        let mut best = vec![0; q];
        let mut tables: Vec<Vec<Likely>> = Vec::new();
        for round in 0..2 {
            tables.clear();
            for k in 0..q {
                let of = |b: usize| {
                    let mut beliefs = best.clone();
                    beliefs[k] = b;
                    self.restricted.likely(&beliefs)
                };
                tables.push((0..self.beliefs.len()).map(of).collect::<Option<_>>()?);
            }
            if round == 0 {
                let likeliest = |table: &Vec<Likely>| {
                    let worth = |b: usize| table[b].logarithm + before[b];
                    (0..table.len()).max_by(|a, b| worth(*a).total_cmp(&worth(*b))).unwrap_or(0)
                };
                best = tables.iter().map(likeliest).collect();
            }
        }
        let base = self.restricted.likely(&best)?.logarithm;
        let n = variances.others.len();
        let mut said = Said::nothing(n, base);
        said.variances = variances.others.iter().map(|v| Mixture::known(*v)).collect();
        for (k, table) in tables.iter().enumerate() {
            let (weights, evidence) = weigh(&before, table);
            said.evidence += evidence - base;
            let growth = |b: usize| growth(&table[b], white, k);
            for (b, weight) in weights.iter().enumerate() {
                said.middle += &self.middles[k][b] * (weight * growth(b));
            }
            let own = |j: usize| weights.iter().enumerate().map(move |(b, w)| (*w, growth(b) * variances.own[k][b][j]));
            for (j, variance) in said.variances.iter_mut().enumerate() {
                *variance = variance.plus(&Mixture::of(own(j)));
            }
            said.scales.push(weights.iter().enumerate().map(|(b, w)| w * growth(b)).sum());
            said.weights.push(weights);
        }
        Some(said)
    }

    /// Correlations of the noise at the first lags; none where it is most likely white.
    fn correlations(&self, weights: &[f64]) -> Option<Vec<f64>> {
        let coloured: f64 = weights[1..].iter().sum();
        let at = |lag: usize| {
            let own = |(b, w): (&Forgetful, &f64)| {
                let apart = if b.clock == Clock::Time { lag as f64 * self.interval } else { lag as f64 };
                w * b.correlation(apart)
            };
            self.beliefs.iter().zip(weights).skip(1).map(own).sum::<f64>() / coloured
        };
        (coloured > 0.5).then(|| (0..=LAGS).map(at).collect())
    }
}

/// How likely each belief is, and the logarithm of how likely what was found is under all of them.
fn weigh(before: &[f64], likely: &[Likely]) -> (Vec<f64>, f64) {
    let all: Vec<f64> = before.iter().zip(likely).map(|(before, l)| before + l.logarithm).collect();
    let highest = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = all.iter().map(|l| (l - highest).exp()).sum();
    (all.iter().map(|l| (l - highest).exp() / sum).collect(), highest + sum.ln())
}

/// The variance of an output's noise over what it is where it is white.
fn growth(likely: &Likely, white: &Likely, k: usize) -> f64 {
    (likely.scales[k] / white.scales[k]).min(MOST_GROWTH)
}

/// What each output adds to the variance of each unknown under each belief.
struct Variances {
    /// Output, belief, unknown.
    own: Vec<Vec<Vec<f64>>>,
    /// What the others add.
    others: Vec<f64>,
}

impl Variances {
    fn of(beliefs: &Beliefs, inverse: &DMatrix<f64>, others: &DMatrix<f64>) -> Self {
        let around = |middle: &DMatrix<f64>| -> Vec<f64> {
            let half = middle * inverse;
            inverse.column_iter().zip(half.column_iter()).map(|(a, b)| a.dot(&b).max(0.0)).collect()
        };
        let own = beliefs.middles.iter().map(|m| m.par_iter().map(around).collect()).collect();
        Self { own, others: around(others) }
    }
}

impl Said {
    fn nothing(n: usize, evidence: f64) -> Self {
        let middle = DMatrix::zeros(n, n);
        Self { variances: Vec::new(), middle, weights: Vec::new(), scales: Vec::new(), evidence }
    }
}
