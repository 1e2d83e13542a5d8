//! What noise alone does to the best of many candidates.
//!
//! Two steps. If the noise's spectrum were known, scores would be normal with the covariance G of the directions: from
//! draws of it every candidate's statistic gets a chance of its own, so that a candidate with many sizes or with a strong
//! direction has no advantage over others (Westfall & Young 1993, min-P). The spectrum is not known: the least of these
//! chances is judged by what it is for residuals drawn from spectra as likely as the one that was found, with the fit
//! taken out and the spectrum estimated anew each time.

use super::score::{Trial, equivalents};
use nalgebra::DMatrix;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Draws of scores under a known spectrum.
const DRAWS: usize = 4000;
/// Batches that are drawn side by side.
const BATCHES: usize = 16;
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
    /// Between 0 and 1.
    pub(super) fn uniform(&mut self) -> f64 {
        self.random.random()
    }

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
    /// Draws residuals that are white in the coordinates of the directions.
    pub(super) fn new(directions: &DMatrix<f64>, trials: &[Trial], candidates: usize) -> Self {
        // under a known spectrum statistics need no equivalent
        let known: Vec<Trial> = trials.iter().map(|t| Trial { freedom: f64::INFINITY, ..t.clone() }).collect();
        let back = directions.transpose();
        let gram = &back * directions;
        let draw = |batch: usize| {
            let mut normal = Normal::new(batch as u64);
            let z = &back * DMatrix::from_fn(directions.nrows(), DRAWS / BATCHES, |_, _| normal.next());
            let mut lists = vec![Vec::with_capacity(DRAWS / BATCHES); candidates];
            for column in z.column_iter() {
                let best = equivalents(&known, candidates, column.as_slice(), |i, j| gram[(i, j)]);
                lists.iter_mut().zip(best).for_each(|(list, best)| list.push(best));
            }
            lists
        };
        let batches: Vec<Vec<Vec<f64>>> = (0..BATCHES).into_par_iter().map(draw).collect();
        let gathered = |candidate: usize| {
            let mut list: Vec<f64> = batches.iter().flat_map(|lists| &lists[candidate]).copied().collect();
            list.sort_by(|a, b| b.total_cmp(a));
            list
        };
        Self { sorted: (0..candidates).into_par_iter().map(gathered).collect() }
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

/// Draws above a value by which its chance is counted; below, the tail is taken as exponential.
const COUNTED: usize = 10;
/// Share of the draws that the tail begins with.
const UPPER: f64 = 0.05;

/// The chance of a value at least this large among draws; where few are beyond it, by an exponential tail through the
/// largest of them.
pub(in crate::diagnose) fn exceedance(draws: &mut [f64], value: f64) -> f64 {
    draws.sort_by(|a, b| b.total_cmp(a));
    let count = draws.len() as f64;
    let above = draws.partition_point(|d| *d >= value);
    let tail = ((UPPER * count) as usize).max(COUNTED).min(draws.len().saturating_sub(1));
    if above >= COUNTED.min(tail) {
        return (above as f64 + 1.0) / (count + 1.0);
    }
    let edge = draws[tail];
    let mean = draws[..tail].iter().map(|d| d - edge).sum::<f64>() / tail as f64;
    let share = tail as f64 / count;
    let counted = (above as f64 + 1.0) / (count + 1.0);
    if mean > 0.0 { share * (-(value - edge).max(0.0) / mean).exp() } else { counted }
}

/// The value that so small a share of the draws (sorted, falling) exceeds, by the same tail.
pub(super) fn critical(draws: &[f64], share: f64) -> Option<f64> {
    let tail = ((UPPER * draws.len() as f64) as usize).max(COUNTED).min(draws.len().saturating_sub(1));
    let edge = draws.get(tail).filter(|_| tail > 0)?;
    let mean = draws[..tail].iter().map(|d| d - edge).sum::<f64>() / tail as f64;
    Some(edge + mean * (tail as f64 / draws.len() as f64 / share).ln().max(0.0))
}
