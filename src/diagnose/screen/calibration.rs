//! What noise alone does to the best of many candidates.
//!
//! Two steps. If the noise's spectrum were known, scores would be normal with the covariance G of the directions: from
//! draws of it every candidate's statistic gets a chance of its own, so that a candidate with many sizes or with a strong
//! direction has no advantage over others (Westfall & Young 1993, min-P). The spectrum is not known: the least of these
//! chances is judged by what it is for residuals drawn from spectra as likely as the one that was found, with the fit
//! taken out and the spectrum estimated anew each time.

use super::score::{Direction, best};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::f64::consts::TAU;

/// Draws of scores under a known spectrum.
const DRAWS: usize = 4000;
/// Above this quantile of the draws a statistic's chance falls like that of chi-square with two degrees of freedom.
const TAIL: f64 = 0.99;

/// Standard normal numbers, the same on every machine.
pub(in crate::diagnose) struct Normal {
    random: ChaCha8Rng,
    second: Option<f64>,
}

impl Normal {
    pub(in crate::diagnose) fn new(seed: u64) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), second: None }
    }

    /// Box and Muller.
    pub(in crate::diagnose) fn next(&mut self) -> f64 {
        if let Some(second) = self.second.take() {
            return second;
        }
        let (a, b): (f64, f64) = (self.random.random(), self.random.random());
        let (radius, angle) = ((-2.0 * (1.0 - a).ln()).sqrt(), TAU * b);
        self.second = Some(radius * fdm_grammar::math::sin(angle));
        radius * fdm_grammar::math::cos(angle)
    }
}

impl Normal {
    /// The sum of the squares of so many (Wilson & Hilferty 1931 where there are many).
    pub(super) fn square_sum(&mut self, count: usize) -> f64 {
        if count < 30 {
            return (0..count).map(|_| self.next()).map(|z| z * z).sum();
        }
        let ninth = 2.0 / (9.0 * count as f64);
        count as f64 * (1.0 - ninth + self.next() * ninth.sqrt()).powi(3)
    }
}

/// What each candidate's statistic is worth under a known spectrum.
#[derive(Debug, Clone)]
pub(super) struct Marginals {
    /// Statistics of each candidate in all draws, falling.
    sorted: Vec<Vec<f64>>,
}

impl Marginals {
    /// Draws scores z ~ N(0, G).
    pub(super) fn new(gram: &DMatrix<f64>, directions: &[Direction], candidates: usize, usable: &[bool]) -> Self {
        let (root, own) = (root(gram), gram.diagonal());
        let mut normal = Normal::new(1);
        let mut sorted = vec![Vec::with_capacity(DRAWS); candidates];
        for _ in 0..DRAWS {
            let numbers = DVector::from_fn(root.ncols(), |_, _| normal.next());
            let z = &root * numbers;
            let scored = best(directions, candidates, z.as_slice(), own.as_slice(), usable);
            for (list, (_, score)) in sorted.iter_mut().zip(scored) {
                list.push(score.statistic);
            }
        }
        sorted.iter_mut().for_each(|list| list.sort_by(|a, b| b.total_cmp(a)));
        Self { sorted }
    }

    /// The chance that noise alone gives a candidate this statistic or more.
    pub(super) fn chance(&self, candidate: usize, statistic: f64) -> f64 {
        let list = &self.sorted[candidate];
        let edge = ((1.0 - TAIL) * list.len() as f64) as usize;
        let high = list[edge];
        if statistic > high {
            return (1.0 - TAIL) * (-(statistic - high) / 2.0).exp();
        }
        let above = list.partition_point(|t| *t >= statistic);
        above.max(edge) as f64 / list.len() as f64
    }

    /// The statistic that noise alone exceeds with this chance.
    pub(super) fn quantile(&self, candidate: usize, chance: f64) -> f64 {
        let list = &self.sorted[candidate];
        let edge = ((1.0 - TAIL) * list.len() as f64) as usize;
        if chance < 1.0 - TAIL {
            return list[edge] - 2.0 * (chance / (1.0 - TAIL)).ln();
        }
        list[((chance * list.len() as f64) as usize).min(list.len() - 1)]
    }
}

/// R with R R' = G, without what G does not have.
fn root(gram: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = SymmetricEigen::new(gram.clone());
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let kept: Vec<usize> = (0..gram.nrows()).filter(|k| eigen.eigenvalues[*k] > 1e-12 * largest).collect();
    DMatrix::from_fn(gram.nrows(), kept.len(), |i, k| {
        eigen.eigenvectors[(i, kept[k])] * eigen.eigenvalues[kept[k]].sqrt()
    })
}

/// The chance of a value at least this large among draws; beyond them an exponential tail through the largest tenth.
pub(in crate::diagnose) fn exceedance(draws: &mut [f64], value: f64) -> f64 {
    draws.sort_by(|a, b| b.total_cmp(a));
    let count = draws.len() as f64;
    let above = draws.partition_point(|d| *d >= value);
    let tenth = (draws.len() / 10).max(1);
    if above >= tenth {
        return (above as f64 + 1.0) / (count + 1.0);
    }
    let edge = draws[tenth];
    let mean = draws[..tenth].iter().map(|d| d - edge).sum::<f64>() / tenth as f64;
    let share = tenth as f64 / count;
    if mean > 0.0 { share * (-(value - edge).max(0.0) / mean).exp() } else { 1.0 / (count + 1.0) }
}
