//! The log evidence of a linearised model: variational Bayes over its unknowns and the noise of every output.
//!
//! Residuals `r = J b + n` in bins, b with a flat prior or a Gaussian one about zero, n independent between bins with the spectrum of its
//! output, a mixture of shapes ([`NoisePrior`]). The posterior is taken as a Gaussian of b times a law of each noise, improved in turn:
//!
//! ```text
//! A = sum over outputs and bands of W G            W = E[1/S], G the band Gram of [r, J]
//! C = (A_JJ + P)^-1,  m = C A_Jr                    P the prior's precision
//! p = (1, -m)' G (1, -m) + tr(G_JJ C)               expected powers of the noise: the trace counts used-up degrees of freedom
//! W from p                                          the noise of each output
//! ```
//!
//! The evidence is `sum_o log p(p_o) + 1/2 log det(2 pi e C) + log prior`, a lower bound (Bishop 2006, ch. 10; MacKay 1992). What belongs to
//! one run is eliminated run by run (an arrow), so that the work grows in proportion to the runs.

use crate::evidence::factor::Factor;
use crate::evidence::gram::{Grams, RunGrams};
use crate::evidence::noise::{Noise, NoisePrior, NoiseScratch};
use std::f64::consts::PI;

/// Rounds, and the change of the evidence (nats) that is not worth another.
const ROUNDS: usize = 12;
const SETTLED: f64 = 0.02;

/// The evidence of a linearised model and what it says of its unknowns.
#[derive(Debug, Clone)]
pub(crate) struct Evidence {
    /// Log evidence in nats; priors of unknowns that are flat are left out.
    pub(crate) log: f64,
    /// Mean of the shared unknowns (q).
    pub(crate) mean: Vec<f64>,
    /// Covariance of the shared unknowns (q by q).
    pub(crate) covariance: Vec<f64>,
    /// Mean of each run's own unknowns.
    pub(crate) own: Vec<Vec<f64>>,
    /// Mean of 1/S for every output and band (row-major).
    pub(crate) weights: Vec<f64>,
    /// What the logarithm of the likelihood gains by going to the mean, under these weights.
    pub(crate) gain: f64,
}

/// What is asked.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Question<'a> {
    /// Band Grams of residual and columns.
    pub(crate) grams: &'a Grams,
    /// The noise of each output before anything is seen.
    pub(crate) noise: &'a [NoisePrior],
    /// Precision of each shared unknown about zero before anything is seen (q); 0 where the prior is flat.
    pub(crate) precision: &'a [f64],
    /// That of each unknown of every run; of those behind the list it is 0.
    pub(crate) own: &'a [f64],
}

impl Question<'_> {
    /// The evidence, begun at these weights (outputs by bands); where there are none the powers of the residual give them. None where the
    /// columns are not finite.
    pub(crate) fn answer(&self, weights: Option<&[f64]>) -> Option<Evidence> {
        self.answer_within(ROUNDS, weights)
    }

    /// Where the unknowns are likeliest under weights that stay. Nothing is asked of the noise: `log` is the volume of the posterior alone.
    pub(crate) fn step(&self, weights: &[f64]) -> Option<Evidence> {
        let mut state = Posterior::new(*self, Some(weights));
        state.solve()?;
        let volume = state.volume(0.5 * (2.0 * PI).ln());
        Some(state.ended(volume))
    }

    /// As [`Self::answer`], in so many rounds at most.
    pub(crate) fn answer_within(&self, rounds: usize, weights: Option<&[f64]>) -> Option<Evidence> {
        let mut state = Posterior::new(*self, weights);
        let mut last = f64::NEG_INFINITY;
        for _ in 0..rounds {
            state.solve()?;
            let log = state.evidence();
            if !log.is_finite() {
                return None;
            }
            let settled = (log - last).abs() < SETTLED;
            last = log;
            if settled {
                break;
            }
        }
        Some(state.ended(last))
    }
}

/// One run, its own unknowns eliminated.
#[derive(Debug, Clone, Default)]
struct Eliminated {
    /// A_oo of its own columns.
    factor: Factor,
    /// The inverse of that.
    inverse: Vec<f64>,
    /// `A_oo^-1 [A_or A_os]` by columns: 1 + shared of own.
    solved: Vec<f64>,
    /// What its own unknowns take of the residual's power under the weights.
    explained: f64,
}

impl Eliminated {
    /// Eliminates the own unknowns of a run from its matrix (own, residual, shared), and adds what is left to `schur` (1 + shared square).
    fn eliminate(&mut self, run: &RunGrams, matrix: &[f64], schur: &mut [f64]) -> Option<()> {
        let (own, width) = (run.own, run.width);
        let size = width - own;
        self.solved.clear();
        if own > 0 {
            if !self.factor.renew(matrix, own, width) {
                return None;
            }
            self.factor.invert(&mut self.inverse);
            for column in own..width {
                let from = self.solved.len();
                self.solved.extend((0..own).map(|i| matrix[i * width + column]));
                self.factor.solve(&mut self.solved[from..]);
            }
        }
        let taken = |i: usize, j: usize| -> f64 {
            let column = &self.solved[j * own..][..own];
            column.iter().enumerate().map(|(k, s)| matrix[k * width + own + i] * s).sum()
        };
        self.explained = taken(0, 0);
        for i in 0..size {
            for j in 0..size {
                schur[i * size + j] += matrix[(own + i) * width + own + j] - taken(i, j);
            }
        }
        Some(())
    }

    /// Mean of its own unknowns beside those of the shared ones.
    fn mean(&self, own: usize, shared: &[f64]) -> Vec<f64> {
        let column = |j: usize, i: usize| self.solved[j * own + i];
        let of = |i: usize| column(0, i) - shared.iter().enumerate().map(|(j, m)| column(j + 1, i) * m).sum::<f64>();
        (0..own).map(of).collect()
    }

    /// Second moments of the coefficients of a run's columns in its residual (own, residual, shared): `v v' + C`, v = (-m_o, 1, -m_s).
    fn second_moments(&self, run: &RunGrams, mean: &[f64], covariance: &[f64], moments: &mut Vec<f64>) {
        let (own, width, q) = (run.own, run.width, mean.len());
        let v: Vec<f64> =
            self.mean(own, mean).into_iter().map(|m| -m).chain([1.0]).chain(mean.iter().map(|m| -m)).collect();
        moments.clear();
        moments.extend(v.iter().flat_map(|a| v.iter().map(move |b| a * b)));
        // -K C_ss, then K C_ss K', K = A_oo^-1 A_os
        let mut cross = vec![0.0; own * q];
        for i in 0..own {
            for j in 0..q {
                cross[i * q + j] = -(0..q).map(|k| self.solved[(k + 1) * own + i] * covariance[k * q + j]).sum::<f64>();
            }
        }
        for i in 0..own {
            for j in 0..own {
                let through: f64 = (0..q).map(|k| cross[i * q + k] * self.solved[(k + 1) * own + j]).sum();
                moments[i * width + j] += self.inverse[i * own + j] - through;
            }
            for j in 0..q {
                let (row, column) = (i, own + 1 + j);
                moments[row * width + column] += cross[i * q + j];
                moments[column * width + row] += cross[i * q + j];
            }
        }
        for i in 0..q {
            for j in 0..q {
                moments[(own + 1 + i) * width + own + 1 + j] += covariance[i * q + j];
            }
        }
    }
}

/// The posterior as it is improved.
struct Posterior<'a> {
    question: Question<'a>,
    noise: Vec<Noise>,
    scratch: NoiseScratch,
    runs: Vec<Eliminated>,
    factor: Factor,
    covariance: Vec<f64>,
    mean: Vec<f64>,
    /// The right-hand side that the mean answers.
    right: Vec<f64>,
    matrix: Vec<f64>,
    schur: Vec<f64>,
}

impl<'a> Posterior<'a> {
    fn new(question: Question<'a>, weights: Option<&[f64]>) -> Self {
        let (grams, mut scratch) = (question.grams, NoiseScratch::default());
        let begun = |output: usize| {
            let mut noise = Noise::default();
            match weights {
                Some(weights) => noise.weights = weights[output * grams.bands()..][..grams.bands()].to_vec(),
                None => question.noise[output].given(&grams.residual_powers(output), &mut scratch, &mut noise),
            }
            noise
        };
        Self {
            noise: (0..grams.outputs()).map(begun).collect(),
            runs: vec![Eliminated::default(); grams.runs().len()],
            question,
            scratch,
            factor: Factor::default(),
            covariance: Vec::new(),
            mean: Vec::new(),
            right: Vec::new(),
            matrix: Vec::new(),
            schur: Vec::new(),
        }
    }

    /// Mean and covariance of the unknowns under the weights as they are.
    fn solve(&mut self) -> Option<()> {
        let grams = self.question.grams;
        let (q, size) = (grams.shared(), grams.shared() + 1);
        self.schur.clear();
        self.schur.resize(size * size, 0.0);
        let weights: Vec<f64> = self.noise.iter().flat_map(|noise| noise.weights.iter().copied()).collect();
        for (run, eliminated) in grams.runs().iter().zip(&mut self.runs) {
            run.weighted(&weights, &mut self.matrix);
            for (i, precision) in self.question.own.iter().enumerate() {
                self.matrix[i * run.width + i] += precision;
            }
            eliminated.eliminate(run, &self.matrix, &mut self.schur)?;
        }
        self.right.clear();
        self.right.extend((1..size).map(|i| self.schur[i * size]));
        self.matrix.clear();
        (1..size).for_each(|i| self.matrix.extend_from_slice(&self.schur[i * size + 1..(i + 1) * size]));
        for (j, precision) in self.question.precision.iter().enumerate() {
            self.matrix[j * q + j] += precision;
        }
        if !self.factor.renew(&self.matrix, q, q) {
            return None;
        }
        self.factor.invert(&mut self.covariance);
        self.mean.clone_from(&self.right);
        self.factor.solve(&mut self.mean);
        self.mean.iter().chain(&self.covariance).all(|v| v.is_finite()).then_some(())
    }

    /// The noise of every output at the expected powers, and the evidence.
    fn evidence(&mut self) -> f64 {
        let grams = self.question.grams;
        let (bands, q) = (grams.bands(), grams.shared());
        let mut powers = vec![0.0; grams.outputs() * bands];
        let mut log = 0.0;
        for (run, eliminated) in grams.runs().iter().zip(&self.runs) {
            eliminated.second_moments(run, &self.mean, &self.covariance, &mut self.matrix);
            run.add_powers(&self.matrix, &mut powers);
            for (i, precision) in self.question.own.iter().enumerate().filter(|(_, p)| **p > 0.0) {
                log += 0.5 * ((precision / (2.0 * PI)).ln() - precision * self.matrix[i * run.width + i]);
            }
        }
        for (output, (own, noise)) in powers.chunks_exact_mut(bands).zip(&mut self.noise).enumerate() {
            self.question.noise[output].given(own, &mut self.scratch, noise);
            log += noise.evidence;
        }
        log += self.volume(0.5 * (1.0 + (2.0 * PI).ln()));
        for (j, precision) in self.question.precision.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            let square = self.mean[j] * self.mean[j] + self.covariance[j * q + j];
            log += 0.5 * ((precision / (2.0 * PI)).ln() - precision * square);
        }
        log
    }

    /// Half of the logarithm of the covariance's determinant over all unknowns, and so much for each of them.
    fn volume(&self, each: f64) -> f64 {
        let grams = self.question.grams;
        let unknowns = grams.shared() + grams.runs().iter().map(|run| run.own).sum::<usize>();
        let roots = self.factor.log_root() + self.runs.iter().map(|run| run.factor.log_root()).sum::<f64>();
        each * unknowns as f64 - roots
    }

    fn ended(self, log: f64) -> Evidence {
        let own = |(run, eliminated): (&RunGrams, &Eliminated)| eliminated.mean(run.own, &self.mean);
        let shared: f64 = self.mean.iter().zip(&self.right).map(|(m, b)| m * b).sum();
        let alone: f64 = self.runs.iter().map(|run| run.explained).sum();
        Evidence {
            log,
            own: self.question.grams.runs().iter().zip(&self.runs).map(own).collect(),
            gain: 0.5 * (shared + alone),
            mean: self.mean,
            covariance: self.covariance,
            weights: self.noise.into_iter().flat_map(|noise| noise.weights).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::evidence::bands::{BandCounts, Bands};
    use crate::evidence::gram::segments;
    use fdm_numeric::random::Stream;

    /// Runs of white noise of deviation 1 with two shared columns and one own (a mean) each: Grams, priors, bins, and all values.
    struct Case {
        grams: Grams,
        noise: Vec<NoisePrior>,
    }

    const BINS: usize = 400;

    fn case(runs: usize, amount: f64, seed: u64) -> Case {
        let bands = Bands::new(BINS);
        let frequency: Vec<f64> = (0..BINS).map(|k| k as f64).collect();
        let counts = BandCounts::of(&bands, (0..runs).flat_map(|_| frequency.iter().copied()));
        let mut stream = Stream::seeded(seed);
        let mut grams = Grams::new(1, bands.count(), 2);
        for _ in 0..runs {
            let mut drawn = || -> Vec<f64> { (0..BINS).map(|_| stream.normal()).collect() };
            let (noise, a, b) = (drawn(), drawn(), drawn());
            let own: Vec<f64> = (0..BINS).map(|k| if k == 0 { 20.0 } else { 0.0 }).collect();
            let residual: Vec<f64> = (0..BINS).map(|k| noise[k] + amount * a[k] + own[k] * 0.3).collect();
            grams.add(1, &segments(&bands, 0, &frequency, 0), &[own, residual, a, b]);
        }
        Case { grams, noise: vec![NoisePrior::new(&counts, BINS)] }
    }

    fn asked(case: &Case, columns: &[usize], precision: &[f64]) -> Evidence {
        let grams = case.grams.chosen(columns);
        Question { grams: &grams, noise: &case.noise, precision, own: &[] }.answer(None).unwrap()
    }

    #[test]
    fn an_amount_is_found_with_its_error_and_raises_the_evidence_by_what_it_explains() {
        let case = case(3, 0.5, 11);
        let (with, without) = (asked(&case, &[0], &[0.0]), asked(&case, &[], &[]));
        let error = with.covariance[0].sqrt();
        assert!((with.mean[0] - 0.5).abs() < 4.0 * error && (error * 1200_f64.sqrt() - 1.0).abs() < 0.1, "{error}");
        assert!(with.own.iter().all(|own| (own[0] - 0.3).abs() < 0.2));
        // half of the square of the amount in its errors, but for the noise that must be found anew, and a flat prior's width
        let told = 1200.0 * 0.5 * (1.25_f64).ln() + 0.5 * (2.0 * PI * with.covariance[0]).ln();
        assert!((with.log - without.log - told).abs() < 25.0, "{} {told}", with.log - without.log);
    }

    #[test]
    fn what_belongs_to_a_run_is_eliminated_as_if_it_stood_beside_all_others() {
        let bands = Bands::new(BINS);
        let frequency: Vec<f64> = (0..BINS).map(|k| k as f64).collect();
        let counts = BandCounts::of(&bands, frequency.iter().copied());
        let noise = vec![NoisePrior::new(&counts, BINS)];
        let mut stream = Stream::seeded(5);
        let mut drawn = || -> Vec<f64> { (0..BINS).map(|_| stream.normal()).collect() };
        let (own, residual, a) = (drawn(), drawn(), drawn());
        let segments = segments(&bands, 0, &frequency, 0);
        let mut arrow = Grams::new(1, bands.count(), 1);
        arrow.add(1, &segments, &[own.clone(), residual.clone(), a.clone()]);
        let mut whole = Grams::new(1, bands.count(), 2);
        whole.add(0, &segments, &[residual, own, a]);
        let one = Question { grams: &arrow, noise: &noise, precision: &[0.0], own: &[] }.answer(None).unwrap();
        let two = Question { grams: &whole, noise: &noise, precision: &[0.0, 0.0], own: &[] }.answer(None).unwrap();
        assert!((one.log - two.log).abs() < 1e-6, "{} {}", one.log, two.log);
        assert!((one.mean[0] - two.mean[1]).abs() < 1e-9 && (one.own[0][0] - two.mean[0]).abs() < 1e-9);
        assert!((one.covariance[0] - two.covariance[3]).abs() < 1e-9 && (one.gain - two.gain).abs() < 1e-6);
    }

    #[test]
    fn a_column_that_explains_nothing_costs_its_width() {
        let case = case(2, 0.0, 23);
        let without = asked(&case, &[], &[]);
        // by a prior of unit width the evidence falls by the logarithm of width over error
        let with = asked(&case, &[1], &[1.0]);
        let error = with.covariance[0].sqrt();
        let t = with.mean[0] / error;
        let told = error.ln() + 0.5 * t * t;
        assert!((with.log - without.log - told).abs() < 0.3, "{} {told}", with.log - without.log);
    }

    #[test]
    fn a_known_noise_gives_the_exact_evidence() {
        // with so many bins the level is known: the difference of two models is that of the exact marginal likelihoods
        let case = case(3, 0.1, 31);
        let (with, without) = (asked(&case, &[0], &[4.0]), asked(&case, &[], &[]));
        // own columns are the bin of the mean alone: it is left out; what is left are the products of the residual and a column
        let products = |k: usize| -> f64 {
            let triangles = case.grams.runs().iter().flat_map(|r| r.products.chunks_exact(10));
            triangles.filter(|t| t[0] == 0.0).map(|t| t[k]).sum()
        };
        let (a, d) = (products(5), products(4));
        let exact = 0.5 * d * d / (a + 4.0) - 0.5 * ((a + 4.0) / 4.0).ln();
        assert!((with.log - without.log - exact).abs() < 0.5, "{} {exact}", with.log - without.log);
    }
}
