//! Residual, noise and projection that belong together, and what they do to noise that is drawn.

use super::calibration::{Marginals, Normal, exceedance};
use super::cells::{Cell, Cells};
use super::consistency::{Consistency, consistencies};
use super::noise::{Left, LogSpectrum};
use super::projection::{Drawing, Frame, left_over, leverage};
use super::score::{ABSORBED, Best, Direction, Shape, Trial, best};
use super::screening::{Candidate, Screening};
use super::shared::Shared;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;

/// Rounds of noise from residuals and projection by noise, before and after the shape inside cells is known.
const ROUNDS: [usize; 2] = [2, 2];
/// Lines of a cell below which it is taken to be fitted away.
const LEAST_FREEDOM: f64 = 0.2;
/// Chances between which more draws are made, and how many times as many.
const DOUBTFUL: std::ops::RangeInclusive<f64> = 1e-4..=0.12;
const MORE: usize = 4;
/// Family-wise chance by which an effect counts as detected.
const DETECTED_AT: f64 = 0.01;
/// Normal quantile of four fifths.
const POWER: f64 = 0.8416;
/// Draws that are weighed at once.
const BATCH: usize = 32;

/// The noise that was found.
#[derive(Debug, Clone)]
pub(super) struct Noise {
    pub(super) cells: Cells,
    pub(super) spectra: Vec<LogSpectrum>,
    /// S of each cell.
    pub(super) density: Vec<f64>,
    /// What the projection leaves of each cell's lines.
    pub(super) freedom: Vec<f64>,
    /// Mean square of each output's residual.
    level: Vec<f64>,
}

impl Noise {
    pub(super) fn new(shared: &Shared) -> Self {
        let cells = Cells::new(shared, None);
        let level = levels(&cells);
        let spectra: Vec<LogSpectrum> = level.iter().map(|l| LogSpectrum::flat(*l)).collect();
        let density = densities(&cells, &spectra);
        let mut noise = Self { cells, spectra, density, freedom: Vec::new(), level };
        noise.settle(shared, ROUNDS[0]);
        noise.cells = Cells::new(shared, Some(&noise.spectra));
        noise.settle(shared, ROUNDS[1]);
        noise
    }

    fn settle(&mut self, shared: &Shared, rounds: usize) {
        for _ in 0..rounds {
            let frame = Frame::new(shared, &self.cells, &self.density);
            let held = frame.saturated();
            let basis = &frame.axes * &held;
            let multiples = &basis * held.tr_mul(&frame.residual(&self.cells, &self.density));
            let left: Vec<f64> = self.cells.list.iter().map(|cell| left_over(cell, &multiples)).collect();
            let own = self.cells.list.iter().zip(&self.density);
            self.freedom = own.map(|(c, s)| (c.count as f64 - leverage(c, *s, &basis)).max(0.0)).collect();
            self.spectra = self.fitted(&left);
            self.density = densities(&self.cells, &self.spectra);
        }
    }

    /// Spectra by what is left of a residual in each cell.
    fn fitted(&self, left: &[f64]) -> Vec<LogSpectrum> {
        let of = |channel: usize| {
            let own = self.cells.list.iter().zip(left).zip(&self.freedom);
            // a cell that was fitted away says nothing about its noise
            let told = own.filter(|((cell, _), freedom)| cell.channel == channel && **freedom > LEAST_FREEDOM);
            let left: Vec<Left> = told
                .map(|((cell, left), freedom)| Left {
                    log_frequency: cell.log_frequency,
                    power: left / freedom,
                    freedom: *freedom,
                })
                .collect();
            LogSpectrum::fit(&left, self.level[channel])
        };
        (0..self.cells.channels).map(of).collect()
    }
}

/// The mean square of each output's residual.
fn levels(cells: &Cells) -> Vec<f64> {
    let mut sums = vec![(0.0, 0); cells.channels];
    for cell in &cells.list {
        sums[cell.channel].0 += cell.residual;
        sums[cell.channel].1 += cell.count;
    }
    sums.iter().map(|(sum, count)| if *count > 0 { sum / *count as f64 } else { 0.0 }).collect()
}

fn densities(cells: &Cells, spectra: &[LogSpectrum]) -> Vec<f64> {
    cells.list.iter().map(|cell| spectra[cell.channel].at(cell.log_frequency)).collect()
}

/// Everything that a residual is judged by.
pub(super) struct Judge<'a> {
    shared: &'a Shared,
    directions: &'a [Direction],
    candidates: usize,
    noise: Noise,
    frame: Frame,
    /// Products of the axes with the residual.
    residual: DVector<f64>,
    trials: Vec<Trial>,
    usable: Vec<bool>,
    marginals: Marginals,
    /// Draws differ from one residual to another, or what they have by chance would be in every judgement.
    seed: u64,
}

impl<'a> Judge<'a> {
    pub(super) fn new(shared: &'a Shared, directions: &'a [Direction]) -> Self {
        let candidates = directions.iter().map(|d| d.candidate + 1).max().unwrap_or(0);
        let noise = Noise::new(shared);
        let frame = Frame::new(shared, &noise.cells, &noise.density);
        let own = |k: usize| frame.directions.column(k).norm_squared();
        let usable: Vec<bool> = (0..directions.len()).map(|k| own(k) > ABSORBED * frame.energy[k]).collect();
        let mut trials = Trial::all(directions, &usable);
        trials.par_iter_mut().for_each(|t| t.freedom = freedom(t, &noise, &frame));
        let marginals = Marginals::new(&frame.directions, &trials, candidates);
        let residual = frame.residual(&noise.cells, &noise.density);
        let seed = residual.iter().fold(0xcbf2_9ce4_8422_2325, |hash: u64, v| {
            (hash ^ v.to_bits()).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23)
        });
        Self { shared, directions, candidates, noise, frame, residual, trials, usable, marginals, seed }
    }

    /// The least chance of any candidate, as minus its logarithm.
    fn best_of(&self, best: &[Best]) -> f64 {
        let chance = |(k, best): (usize, &Best)| self.marginals.chance(k, best.equivalent);
        -best.iter().enumerate().map(chance).fold(1.0, f64::min).ln()
    }

    /// The same for residuals of noise alone, drawn from spectra as likely as the one that was found.
    fn draws(&self, range: Range<usize>) -> Vec<f64> {
        let drawing = Drawing::new(&self.noise.cells, &self.frame);
        let held = self.frame.saturated();
        let batch = |first: usize| {
            let one = |seed: usize| self.draw(seed as u64, &drawing, &held);
            let drawn: Vec<_> = (first..range.end.min(first + BATCH)).map(one).collect();
            let weights = DMatrix::from_fn(self.noise.density.len(), drawn.len(), |c, k| 1.0 / drawn[k].1[c]);
            let metrics = drawing.metrics(&weights);
            let judged = |(k, (products, _)): (usize, &(DVector<f64>, Vec<f64>))| {
                let (metric, score) = drawing.projected(metrics.column(k).as_slice(), products)?;
                let directions = &self.frame.directions;
                Some(self.best_of(&best(&self.trials, self.candidates, directions, Some(&metric), &score)))
            };
            drawn.iter().enumerate().filter_map(judged).collect::<Vec<f64>>()
        };
        let starts: Vec<usize> = range.clone().step_by(BATCH).collect();
        starts.into_par_iter().map(batch).collect::<Vec<_>>().concat()
    }

    /// Products of the axes with a drawn residual, and the noise that it seems to have.
    fn draw(&self, seed: u64, drawing: &Drawing, held: &DMatrix<f64>) -> (DVector<f64>, Vec<f64>) {
        let mut normal = Normal::new(self.seed.wrapping_add(seed));
        let spectra: Vec<LogSpectrum> = self.noise.spectra.iter().map(|s| s.drawn(&mut normal)).collect();
        let deviation = |cell: &Cell| spectra[cell.channel].at(cell.log_frequency).sqrt();
        let drawn = self.noise.cells.noise(deviation, &mut normal);
        // what a fit and the saturation take out, by the noise that was found
        let multiples = held * held.tr_mul(&drawing.products(&drawn, &self.noise.density));
        let left: Vec<f64> = drawn.iter().enumerate().map(|(k, own)| drawing.left_over(k, own, &multiples)).collect();
        let density = densities(&self.noise.cells, &self.noise.fitted(&left));
        (drawing.products(&drawn, &density), density)
    }

    /// The chance that noise makes any candidate look this good, and the draws that say so; where it is neither plain noise nor
    /// plainly none, more draws are made.
    fn family_wise(&self, value: f64, count: usize) -> (f64, Vec<f64>) {
        let mut drawn = self.draws(0..count);
        let mut chance = exceedance(&mut drawn, value);
        if DOUBTFUL.contains(&chance) {
            drawn.extend(self.draws(count..MORE * count));
            chance = exceedance(&mut drawn, value);
        }
        (chance, drawn)
    }

    /// The result, by so many draws.
    pub(super) fn verdict(self, draws: usize) -> Screening {
        let rest = self.residual.rows(self.frame.eaten, self.frame.directions.nrows()).into_owned();
        let best = best(&self.trials, self.candidates, &self.frame.directions, None, &rest);
        let (family_wise, drawn) = self.family_wise(self.best_of(&best), draws);
        let needed = critical(&drawn, DETECTED_AT).map(|least| (-least).exp());
        let own = |k: usize| self.frame.directions.column(k).norm_squared();
        let mut consistency = self.consistency(&best).into_iter();
        let consistency: Vec<Option<Consistency>> =
            best.iter().map(|b| b.trial.and_then(|_| consistency.next().flatten())).collect();
        let candidate = |(k, best): (usize, &Best)| {
            let direction = best.trial.map(|t| self.trials[t].members[0]);
            Candidate {
                direction,
                statistic: best.score.statistic,
                amount: best.score.amounts.first().copied().unwrap_or(0.0),
                chance: self.marginals.chance(k, best.equivalent),
                distinct: direction.map_or(0.0, |d| own(d) / self.frame.energy[d]),
                lead: best.equivalent - self.marginals.quantile(k, 0.01),
                detectable: needed.and_then(|chance| self.detectable(k, self.marginals.quantile(k, chance))),
            }
        };
        let candidates: Vec<Candidate> = best.iter().enumerate().map(candidate).collect();
        let mut ranking: Vec<usize> = (0..candidates.len()).collect();
        ranking.sort_by(|a, b| candidates[*b].lead.total_cmp(&candidates[*a].lead));
        let amounts = |best: &Best| {
            let members = best.trial.map_or(&[][..], |t| &self.trials[t].members);
            members.iter().copied().zip(best.score.amounts.iter().copied()).collect()
        };
        Screening {
            amounts: best.iter().map(amounts).collect(),
            consistency,
            candidates,
            ranking,
            family_wise,
            gram: self.frame.directions.tr_mul(&self.frame.directions),
            spectra: self.noise.spectra,
            errors: self.frame.errors,
            compensation: self.frame.compensation,
        }
    }

    /// The smallest size that would have been seen four times of five, for a statistic that is seen.
    fn detectable(&self, candidate: usize, statistic: f64) -> Option<f64> {
        let of = |trial: &Trial| {
            // where the noise is known by few numbers, more is needed than under a known one
            let nu = trial.freedom;
            let needed = if nu > 1e6 {
                statistic
            } else {
                nu * ((statistic / nu) * ((8.0 * nu + 3.0) / (8.0 * nu + 1.0)).powi(2)).exp_m1()
            };
            let least = trial.members.iter().map(|k| {
                let direction = self.frame.directions.column(*k).norm();
                (needed.sqrt() + POWER) / direction
            });
            let amount = least.fold(f64::INFINITY, f64::min);
            let amount = match trial.shape {
                Shape::Finite => amount.max(0.5),
                _ => amount,
            };
            let size = self.directions[trial.members[0]].size.abs();
            match trial.shape {
                Shape::Finite | Shape::Smallest if amount > 2.0 => None,
                _ => (amount * size).is_finite().then_some(amount * size),
            }
        };
        let sizes = self.trials.iter().filter(|t| t.candidate == candidate).filter_map(of);
        sizes.min_by(f64::total_cmp)
    }

    /// Run by run, for those candidates that have a trial.
    fn consistency(&self, best: &[Best]) -> Vec<Option<Consistency>> {
        let chosen: Vec<DVector<f64>> = best
            .iter()
            .filter_map(|b| {
                let members = &self.trials[b.trial?].members;
                let parts = members.iter().zip(&b.score.amounts);
                let own = |k: usize| self.frame.directions.column(k).into_owned();
                Some(match members[..] {
                    [k] => own(k),
                    // of several parameters at once: the combination that was found
                    _ => parts.fold(own(members[0]) * 0.0, |sum, (k, amount)| sum + own(*k) * *amount),
                })
            })
            .collect();
        if chosen.is_empty() {
            return Vec::new();
        }
        let eaten = self.residual.rows(0, self.frame.eaten).into_owned();
        let density = |channel: usize, f: f64| self.noise.spectra[channel].at(f.ln());
        consistencies(self.shared, &self.frame, &DMatrix::from_columns(&chosen), &eaten, density)
    }
}

/// What so many of the draws exceed.
fn critical(drawn: &[f64], share: f64) -> Option<f64> {
    // sorted, falling
    drawn.get((share * drawn.len() as f64) as usize).copied()
}

/// By how many real numbers the noise under a trial is known: 2 / variance of its logarithm, averaged as the trial's energy.
fn freedom(trial: &Trial, noise: &Noise, frame: &Frame) -> f64 {
    let axes = frame.axes.columns(frame.eaten, frame.directions.nrows());
    let mut energy = vec![0.0; noise.cells.list.len()];
    for k in &trial.members {
        let direction = frame.directions.column(*k);
        let multiples = axes * direction / direction.norm();
        for ((sum, cell), density) in energy.iter_mut().zip(&noise.cells.list).zip(&noise.density) {
            *sum += (&cell.factor * &multiples).norm_squared() / density / trial.members.len() as f64;
        }
    }
    let variance = |channel: usize| {
        let own = noise.cells.list.iter().zip(&energy).filter(|(cell, _)| cell.channel == channel);
        let weights: Vec<(f64, f64)> = own.map(|(cell, energy)| (cell.log_frequency, *energy)).collect();
        noise.spectra[channel].uncertainty(&weights).powi(2)
    };
    2.0 / (0..noise.cells.channels).map(variance).sum::<f64>()
}
