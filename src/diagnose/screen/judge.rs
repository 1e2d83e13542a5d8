//! Residual, noise and projection that belong together, and what they do to noise that is drawn.

use super::calibration::{Marginals, Normal, critical, exceedance};
use super::consistency::{Consistency, consistencies};
use super::drawing::{Drawing, Judged};
use super::noise::LogSpectrum;
use super::projection::Frame;
use super::rest::Outlier;
use super::saturated::{Noise, Saturated, densities};
use super::score::{ABSORBED, Best, Direction, Shape, Trial, best, equivalents};
use super::screening::{Candidate, Screening};
use super::shared::Shared;
use super::squared::squared;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;

/// The first draws are one of so many that are wanted.
const FIRST: usize = 4;
/// Chances by the first draws that are neither plain noise nor plainly none.
const UNCLEAR: std::ops::RangeInclusive<f64> = 1e-7..=0.25;
/// Chances by all draws between which more are made, and how many times as many.
const DOUBTFUL: std::ops::RangeInclusive<f64> = 1e-4..=0.12;
const MORE: usize = 4;
/// Family-wise chance by which an effect counts as detected.
const DETECTED_AT: f64 = 0.01;
/// Normal quantile of four fifths.
const POWER: f64 = 0.8416;
/// Draws that are weighed at once.
const BATCH: usize = 32;

/// Everything that a residual is judged by.
pub(super) struct Judge<'a> {
    /// Outputs, or independent combinations of them.
    shared: Shared,
    outliers: Vec<Outlier>,
    correlated: bool,
    /// Spectra of the outputs themselves.
    spectra: Vec<LogSpectrum>,
    directions: &'a [Direction],
    candidates: usize,
    noise: Noise,
    frame: Frame,
    /// What is taken out of a residual before its noise is judged.
    held: DMatrix<f64>,
    drawing: Drawing,
    /// Products of the axes with the residual.
    residual: DVector<f64>,
    trials: Vec<Trial>,
    marginals: Marginals,
    /// Draws differ from one residual to another, or what they have by chance would be in every judgement.
    seed: u64,
}

impl<'a> Judge<'a> {
    pub(super) fn new(shared: Shared, directions: &'a [Direction]) -> Self {
        let candidates = directions.iter().map(|d| d.candidate + 1).max().unwrap_or(0);
        let Saturated { mut shared, mut noise, outliers, rest } = Saturated::new(shared);
        let spectra = noise.spectra.clone();
        let mixed = rest.decorrelated(&shared);
        let correlated = mixed.is_some();
        if let Some(mixed) = mixed {
            shared = mixed;
            noise = Noise::new(&shared);
        }
        let frame = Frame::new(&shared, &noise.cells, &noise.density);
        let own = |k: usize| frame.directions.column(k).norm_squared();
        let usable: Vec<bool> = (0..directions.len()).map(|k| own(k) > ABSORBED * frame.energy[k]).collect();
        let mut trials = Trial::all(directions, &usable);
        let drawing = Drawing::new(&noise.cells, &frame, &trials);
        trials.par_iter_mut().for_each(|t| t.freedom = freedom(t, &noise, &drawing));
        let marginals = Marginals::new(&frame.directions, &trials, candidates);
        let residual = frame.residual(&noise.cells, &noise.density);
        let seed = residual.iter().fold(0xcbf2_9ce4_8422_2325, |hash: u64, v| {
            (hash ^ v.to_bits()).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23)
        });
        Self {
            shared,
            outliers,
            correlated,
            spectra,
            directions,
            candidates,
            noise,
            held: frame.saturated(),
            frame,
            drawing,
            residual,
            trials,
            marginals,
            seed,
        }
    }

    /// The least chance of any candidate, as minus its logarithm, from the equivalents of their statistics.
    fn best_of(&self, equivalents: impl Iterator<Item = f64>) -> f64 {
        let chance = |(k, equivalent): (usize, f64)| self.marginals.chance(k, equivalent);
        -equivalents.enumerate().map(chance).fold(1.0, f64::min).ln()
    }

    /// The same for residuals of noise alone, drawn from spectra as likely as the one that was found.
    fn draws(&self, range: Range<usize>) -> Vec<f64> {
        let starts: Vec<usize> = range.clone().step_by(BATCH).collect();
        let batch = |first: usize| self.batch(first..range.end.min(first + BATCH));
        starts.into_par_iter().map(batch).collect::<Vec<_>>().concat()
    }

    fn batch(&self, range: Range<usize>) -> Vec<f64> {
        let (noise, drawing) = (&self.noise, &self.drawing);
        let mut normals: Vec<Normal> = range.map(|k| Normal::new(self.seed.wrapping_add(k as u64))).collect();
        let deviations = |normal: &mut Normal| -> Vec<f64> {
            let spectra: Vec<LogSpectrum> = noise.spectra.iter().map(|s| s.drawn(normal)).collect();
            densities(&noise.cells, &spectra).into_iter().map(f64::sqrt).collect()
        };
        let deviations: Vec<Vec<f64>> = normals.iter_mut().map(deviations).collect();
        let drawn = drawing.drawn(&deviations, &mut normals);
        // what a fit and the saturation take out, by the noise that was found
        let products = drawing.products(&drawn, |_| &noise.density);
        let left = drawing.left_over(&drawn, &(&self.held * (self.held.transpose() * products)));
        let seems = |left: &[f64]| densities(&noise.cells, &noise.fitted(left));
        let density: Vec<Vec<f64>> = left.column_iter().map(|left| seems(left.as_slice())).collect();
        let products = drawing.products(&drawn, |k| &density[k]);
        let weights = DMatrix::from_fn(noise.density.len(), density.len(), |cell, k| 1.0 / density[k][cell]);
        let worth = |judged: &Judged<'_>| {
            let equivalents = equivalents(&self.trials, self.candidates, &judged.z, |i, j| judged.product(i, j));
            self.best_of(equivalents.into_iter())
        };
        drawing.judged(&products, &weights).iter().flatten().map(worth).collect()
    }

    /// The chance that noise makes any candidate look this good, and the draws that say so, falling: the more, the less plain
    /// the answer is.
    fn family_wise(&self, value: f64, count: usize) -> (f64, Vec<f64>) {
        let (mut drawn, mut made, mut chance) = (Vec::new(), 0, 1.0);
        let stages = [(count.div_ceil(FIRST), UNCLEAR), (count, DOUBTFUL), (MORE * count, 1.0..=0.0)];
        for (wanted, unclear) in stages {
            drawn.extend(self.draws(made..wanted));
            (made, chance) = (wanted, exceedance(&mut drawn, value));
            if !unclear.contains(&chance) {
                break;
            }
        }
        (chance, drawn)
    }

    /// The result, by so many draws.
    pub(super) fn verdict(self, draws: usize) -> Screening {
        let rest = self.residual.rows(self.frame.eaten, self.frame.directions.nrows()).into_owned();
        let gram = squared(&self.frame.directions);
        let z = self.frame.directions.tr_mul(&rest);
        let best = best(&self.trials, self.candidates, z.as_slice(), |i, j| gram[(i, j)]);
        let (family_wise, drawn) = self.family_wise(self.best_of(best.iter().map(|b| b.equivalent)), draws);
        let needed = critical(&drawn, DETECTED_AT).map(|least| (-least).exp());
        let own = |k: usize| self.frame.directions.column(k).norm_squared();
        let parameters = self.frame.errors.len() - self.shared.ends;
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
            gram,
            spectra: self.spectra,
            outliers: self.outliers,
            correlated: self.correlated,
            errors: self.frame.errors[..parameters].to_vec(),
            compensation: self.frame.compensation.rows(0, parameters).into_owned(),
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
        consistencies(&self.shared, &self.frame, &DMatrix::from_columns(&chosen), &eaten, density)
    }
}

/// By how many real numbers the noise under a trial is known: 2 / variance of its logarithm, averaged as the trial's energy.
fn freedom(trial: &Trial, noise: &Noise, drawing: &Drawing) -> f64 {
    let mut energy = vec![0.0; noise.cells.list.len()];
    for k in &trial.members {
        let own = drawing.energies(*k, &noise.density);
        let whole: f64 = own.iter().sum::<f64>() * trial.members.len() as f64;
        energy.iter_mut().zip(own).for_each(|(sum, own)| *sum += own / whole);
    }
    let variance = |channel: usize| {
        let own = noise.cells.list.iter().zip(&energy).filter(|(cell, _)| cell.channel == channel);
        let weights: Vec<(f64, f64)> = own.map(|(cell, energy)| (cell.log_frequency, *energy)).collect();
        noise.spectra[channel].uncertainty(&weights).powi(2)
    };
    2.0 / (0..noise.cells.channels).map(variance).sum::<f64>()
}
