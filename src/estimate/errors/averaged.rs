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

/// Most that noise may be larger, as a variance, than what is left of it: fitting took four fifths of the deviation.
const MOST_GROWTH: f64 = 25.0;
/// Lags for which correlations are told.
const LAGS: usize = 6;

/// How the outputs may have their beliefs.
struct Hypothesis {
    /// Whether all outputs share one.
    together: bool,
    /// For each output how likely each belief is.
    weights: Vec<Vec<f64>>,
    /// For each output and belief the variance of its noise over what it is where it is white.
    growth: Vec<Vec<f64>>,
    /// Logarithm of how likely what was found is.
    evidence: f64,
}

/// The average over all beliefs about all outputs of all members.
pub(super) struct Average {
    beliefs: Vec<Forgetful>,
    /// For each output its samples, and the degrees of freedom of its scale.
    samples: Vec<(f64, f64)>,
    /// For each output and belief `S' R^-1 L C L' R^-1 S` (n by n).
    middles: Vec<Vec<DMatrix<f64>>>,
    /// Each with its share.
    hypotheses: Vec<(f64, Hypothesis)>,
    pub(super) interval: f64,
}

impl Average {
    /// `inverse_noise` is that of the fit, `covariance` that of the noise (q by q), `others` the information of other runs and of
    /// priors (n by n). None where numbers are not finite.
    pub(super) fn new(
        members: &[Member<'_>],
        inverse_noise: &[f64],
        covariance: &DMatrix<f64>,
        others: DMatrix<f64>,
    ) -> Option<Self> {
        let (q, n) = (members[0].rows.rows.len(), others.nrows());
        let interval = interval(members);
        let (beliefs, shares) = beliefs(members, interval);
        let combinations = Combinations::new(inverse_noise, covariance);
        let outputs: Vec<Vec<Part>> = (0..q).map(|k| combinations.parts(members, k)).collect();
        let samples: Vec<f64> = outputs.iter().map(|parts| parts.iter().map(|p| p.samples() as f64).sum()).collect();
        let tables: Vec<Vec<(Normal, DMatrix<f64>)>> =
            outputs.iter().map(|parts| beliefs.par_iter().map(|b| normal(parts, members, b, n)).collect()).collect();
        // at the estimates all together pull nowhere: the others against these
        let mut pull = DVector::zeros(n);
        if others.amax() > 0.0 {
            tables.iter().for_each(|t| pull -= &t[0].0.vector);
        }
        let (normals, middles) = tables.into_iter().map(|t| t.into_iter().unzip()).unzip();
        let restricted = Restricted { samples: samples.clone(), normals, others, pull };
        let white = restricted.likely(&vec![0; q])?;
        let mut all = vec![together(&restricted, &shares, &white)?];
        if q > 1 {
            all.push(apart(&restricted, &shares, &white)?);
        }
        let highest = all.iter().map(|h| h.evidence).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = all.iter().map(|h| (h.evidence - highest).exp()).sum();
        let hypotheses = all.into_iter().map(|h| ((h.evidence - highest).exp() / sum, h)).collect();
        let samples = samples.into_iter().zip(white.freedom).collect();
        Some(Self { beliefs, samples, middles, hypotheses, interval })
    }

    /// The mean of `S' R^-1 Rvv R^-1 S` (n by n).
    pub(super) fn middle(&self) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(self.middles[0][0].nrows(), self.middles[0][0].ncols());
        for (share, h) in &self.hypotheses {
            for (k, middles) in self.middles.iter().enumerate() {
                for (b, middle) in middles.iter().enumerate() {
                    sum += middle * (share * h.weights[k][b] * h.growth[k][b]);
                }
            }
        }
        sum
    }

    /// Variance of each chosen unknown and its degrees of freedom (n), with the Cramer-Rao covariance of the fit (n by n) on both sides
    /// and beside it the middle of the others (n by n); none where numbers are not finite.
    pub(super) fn variances(&self, inverse: &DMatrix<f64>, others: &DMatrix<f64>) -> Option<Vec<(f64, f64)>> {
        let around = |middle: &DMatrix<f64>| -> Vec<f64> {
            let half = middle * inverse;
            inverse.column_iter().zip(half.column_iter()).map(|(a, b)| a.dot(&b).max(0.0)).collect()
        };
        // output, belief, unknown
        let own: Vec<Vec<Vec<f64>>> = self.middles.iter().map(|m| m.par_iter().map(around).collect()).collect();
        let others = around(others);
        let one = |j: usize| {
            let mut mixture = Mixture::none();
            for (share, h) in &self.hypotheses {
                let size = |k: usize, b: usize| h.growth[k][b] * own[k][b][j];
                let beliefs = |k: usize| h.weights[k].iter().copied().enumerate();
                let possible = if h.together {
                    let whole = |b: usize| others[j] + (0..own.len()).map(|k| size(k, b)).sum::<f64>();
                    Mixture::of(beliefs(0).map(|(b, weight)| (weight, whole(b))))
                } else {
                    let of = |k: usize| Mixture::of(beliefs(k).map(|(b, weight)| (weight, size(k, b))));
                    (0..own.len()).fold(Mixture::known(others[j]), |sum, k| sum.plus(&of(k)))
                };
                mixture.or(&possible, *share);
            }
            // the scale of the noise is known by so many samples
            let all = others[j] + own.iter().map(|o| o[0][j]).sum::<f64>();
            let spread = own.iter().zip(&self.samples).map(|(o, (_, freedom))| (o[0][j] / all).powi(2) / freedom);
            mixture.student(1.0 / spread.sum::<f64>())
        };
        (0..others.len()).into_par_iter().map(one).collect()
    }

    /// Whether any sample of an output is compared.
    pub(super) fn compares(&self, output: usize) -> bool {
        self.samples[output].0 > 0.0
    }

    /// The variance of an output's noise over the one that the fit found.
    pub(super) fn scale(&self, output: usize) -> f64 {
        let mean = |h: &Hypothesis| h.weights[output].iter().zip(&h.growth[output]).map(|(w, g)| w * g).sum::<f64>();
        self.hypotheses.iter().map(|(share, h)| share * mean(h)).sum()
    }

    /// Correlations of an output's noise at lags 0, 1, .. intervals; none where it is most likely white.
    pub(super) fn correlations(&self, output: usize) -> Option<Vec<f64>> {
        let weight = |b: usize| self.hypotheses.iter().map(|(share, h)| share * h.weights[output][b]).sum::<f64>();
        let weights: Vec<f64> = (1..self.beliefs.len()).map(weight).collect();
        let coloured: f64 = weights.iter().sum();
        let at = |lag: usize| {
            let own = |(b, w): (&Forgetful, &f64)| {
                let apart = if b.clock == Clock::Time { lag as f64 * self.interval } else { lag as f64 };
                w * b.correlation(apart)
            };
            self.beliefs[1..].iter().zip(&weights).map(own).sum::<f64>() / coloured
        };
        (coloured > 0.5).then(|| (0..=LAGS).map(at).collect())
    }
}

/// All outputs share one belief.
fn together(restricted: &Restricted, shares: &[f64], white: &Likely) -> Option<Hypothesis> {
    let q = restricted.samples.len();
    let likely: Vec<Likely> = (0..=shares.len()).map(|b| restricted.likely(&vec![b; q])).collect::<Option<_>>()?;
    let (weights, evidence) = weigh(&before(shares, 1), &likely);
    let growth = (0..q).map(|k| likely.iter().map(|l| growth(l, white, k)).collect()).collect();
    Some(Hypothesis { together: true, weights: vec![weights; q], growth, evidence })
}

/// Each output has a belief of its own, weighed beside the likeliest of the others.
fn apart(restricted: &Restricted, shares: &[f64], white: &Likely) -> Option<Hypothesis> {
    let q = restricted.samples.len();
    let before = before(shares, q);
    let table = |best: &[usize], k: usize| -> Option<Vec<Likely>> {
        let of = |b: usize| {
            let mut beliefs = best.to_vec();
            beliefs[k] = b;
            restricted.likely(&beliefs)
        };
        (0..before.len()).map(of).collect()
    };
    let likeliest = |table: Vec<Likely>| {
        let worth = |b: &usize| table[*b].logarithm + before[*b];
        (0..table.len()).max_by(|a, b| worth(a).total_cmp(&worth(b))).unwrap_or(0)
    };
    let best: Vec<usize> = (0..q).map(|k| table(&vec![0; q], k).map(likeliest)).collect::<Option<_>>()?;
    let base = restricted.likely(&best)?.logarithm;
    let mut hypothesis = Hypothesis { together: false, weights: Vec::new(), growth: Vec::new(), evidence: base };
    for k in 0..q {
        let table = table(&best, k)?;
        let (weights, evidence) = weigh(&before, &table);
        hypothesis.evidence += evidence - base;
        hypothesis.weights.push(weights);
        hypothesis.growth.push(table.iter().map(|l| growth(l, white, k)).collect());
    }
    Some(hypothesis)
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
