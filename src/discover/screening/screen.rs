//! The screening of all candidates: noise, scores, chances.
//!
//! Residual, noise and projection that belong together, and what they do to noise that is drawn.

use super::basis::{Basis, gram};
use super::consistency::{Consistency, consistencies};
use super::null_distribution::{DrawnScores, Extraction, Marginals, NullDraws, critical, exceedance};
use super::projection::Frame;
use super::saturated::{Noise, densities, likeliest};
use super::score::{ABSORBED, Best, Direction, Shape, Trial, best, equivalents};
use super::standardised::{Outlier, Saturated};
use crate::bins::{OutputBins, Record};
use crate::noise::LogSpectrum;
use fdm_numeric::parallel;
use fdm_numeric::random::Stream;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::ops::Range;

/// Fewest samples of a run: below them no spectrum can be had.
const LEAST: usize = 8;

/// Why runs cannot be screened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ScreeningError {
    /// Nothing to screen.
    #[error("there is no run, no output or no direction to screen")]
    Nothing,
    /// Too few samples.
    #[error("run {run} has {samples} samples; {least} are needed to tell noise from an effect")]
    TooShort {
        /// Index of the run.
        run: usize,
        /// Its samples.
        samples: usize,
        /// The least number.
        least: usize,
    },
    /// A signal that is not a number, or does not have the length of the residual.
    #[error("run {run}: a residual, sensitivity or direction is not finite where something was measured")]
    NotFinite {
        /// Index of the run.
        run: usize,
    },
    /// All residuals are zero.
    #[error("the model reproduces every measurement exactly: nothing is wrong, and there is no noise to judge by")]
    NothingWrong,
    /// More is fitted than there are bins.
    #[error("{fitted} values were fitted to {bins} frequency bins: nothing is left to judge by")]
    TooMany {
        /// Fitted values.
        fitted: usize,
        /// OutputBins.
        bins: usize,
    },
}

/// How candidates are screened.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ScreeningOptions {
    /// Bins that are left out at the low end of every output of every run; none, as the mean and the slowest bins are evidence too.
    pub dropped: usize,
    /// Draws of residuals by which the best candidate is judged.
    pub draws: usize,
}

impl Default for ScreeningOptions {
    fn default() -> Self {
        Self { dropped: 0, draws: 400 }
    }
}

/// What screening says of one candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Its best direction, by index; none where the fitted parameters make up for all of them.
    pub direction: Option<usize>,
    /// Twice its predicted gain in log-likelihood.
    pub statistic: f64,
    /// The multiple of that direction's size that predicts it.
    pub amount: f64,
    /// The chance that noise of the spectrum found gives this candidate as much.
    pub chance: f64,
    /// What is left of its best direction beside the fitted parameters, as a share of its energy: near 0 it cannot be told
    /// from them.
    pub distinct: f64,
    /// The statistic beyond what noise gives it once in a hundred times: by this candidates are ranked.
    pub lead: f64,
    /// The smallest size that would have been seen, at a family-wise chance of 1 %, four times of five; none where no size
    /// that was tried would, or where no draws were made.
    pub detectable: Option<f64>,
}

impl Candidate {
    /// Its predicted gain in log-likelihood.
    pub fn gain(&self) -> f64 {
        self.statistic / 2.0
    }
}

/// The result of screening.
#[derive(Debug, Clone)]
pub struct Screening {
    /// Every candidate, in the order of the directions.
    pub candidates: Vec<Candidate>,
    /// Candidates by rank, the likeliest first.
    pub ranking: Vec<usize>,
    /// The chance that noise alone makes any candidate look as good as the best one does.
    pub family_wise: f64,
    /// Spectrum of each output's noise.
    pub spectra: Vec<LogSpectrum>,
    /// OutputBins and samples that were cut back because noise does not make them.
    pub outliers: Vec<Outlier>,
    /// Whether noise that outputs share was found, and was taken into account.
    pub correlated: bool,
    /// G: products of the projected directions.
    pub gram: DMatrix<f64>,
    /// What the fitted parameters were moved by, for one unit of each direction (p by m).
    pub compensation: DMatrix<f64>,
    /// Standard errors of the fitted parameters under this noise (p).
    pub errors: Vec<f64>,
    /// The directions that each candidate's statistic is of and their multiples: several where parameters are joined.
    pub amounts: Vec<Vec<(usize, f64)>>,
    /// Whether each candidate's effect is of the same size in all runs; none with one run.
    pub consistency: Vec<Option<Consistency>>,
}

impl Screening {
    /// How far the fitted parameters have been moved by the absence of a candidate's effect, in standard errors (p): what they
    /// are too large by.
    pub fn bias(&self, candidate: usize) -> Vec<f64> {
        let moved = |j: usize| -> f64 {
            self.amounts[candidate].iter().map(|(k, amount)| self.compensation[(j, *k)] * amount).sum()
        };
        let bias = |j: usize| if self.errors[j] > 0.0 { moved(j) / self.errors[j] } else { 0.0 };
        (0..self.errors.len()).map(bias).collect()
    }

    /// Cosine of the angle between what two candidates add, beside what was fitted, as each predicts the most: near 1 or -1
    /// these runs cannot tell them apart, and of a gain by one the other has the square of this as a share.
    pub fn cosine(&self, a: usize, b: usize) -> f64 {
        let product = |a: usize, b: usize| -> f64 {
            let pairs = self.amounts[a].iter().flat_map(|i| self.amounts[b].iter().map(move |j| (i, j)));
            pairs.map(|((i, x), (j, y))| x * y * self.gram[(*i, *j)]).sum()
        };
        let sizes = product(a, a) * product(b, b);
        if sizes > 0.0 { (product(a, b) / sizes.sqrt()).clamp(-1.0, 1.0) } else { 0.0 }
    }
}

/// Screens directions against the residuals of a fit.
///
/// # Errors
/// [`ScreeningError`]
pub fn screen(
    records: &[Record],
    channels: usize,
    directions: &[Direction],
    options: &ScreeningOptions,
) -> Result<Screening, ScreeningError> {
    screened(records, None, channels, directions, options)
}

/// Screens signals that are bins of some transform already, in which noise is independent from bin to bin:
/// `frequencies` has the frequency of every row of each run, rising. None of them is left out.
///
/// # Errors
/// [`ScreeningError`]; what it calls samples are bins.
pub fn screen_bins(
    records: &[Record],
    frequencies: &[Vec<f64>],
    channels: usize,
    directions: &[Direction],
    options: &ScreeningOptions,
) -> Result<Screening, ScreeningError> {
    screened(records, Some(frequencies), channels, directions, options)
}

fn screened(
    records: &[Record],
    frequencies: Option<&[Vec<f64>]>,
    channels: usize,
    directions: &[Direction],
    options: &ScreeningOptions,
) -> Result<Screening, ScreeningError> {
    if directions.is_empty() {
        return Err(ScreeningError::Nothing);
    }
    let shared = gathered(records, frequencies, channels, options)?;
    let judge = Judge::new(shared, directions);
    Ok(judge.verdict(options.draws))
}

/// The spectrum of each output's noise alone: what the fit and the directions of the records, if they have any, together leave of the
/// residuals.
///
/// # Errors
/// [`ScreeningError`]
pub fn spectra(
    records: &[Record],
    channels: usize,
    options: &ScreeningOptions,
) -> Result<Vec<LogSpectrum>, ScreeningError> {
    Ok(Saturated::new(gathered(records, None, channels, options)?).noise.spectra)
}

/// Spectrum of each output's noise from signals that are bins of some transform already.
///
/// # Errors
/// [`ScreeningError`]; what it calls samples are bins.
pub fn spectra_of_bins(
    records: &[Record],
    frequencies: &[Vec<f64>],
    channels: usize,
    options: &ScreeningOptions,
) -> Result<Vec<LogSpectrum>, ScreeningError> {
    Ok(Saturated::new(gathered(records, Some(frequencies), channels, options)?).noise.spectra)
}

fn gathered(
    records: &[Record],
    frequencies: Option<&[Vec<f64>]>,
    channels: usize,
    options: &ScreeningOptions,
) -> Result<Basis, ScreeningError> {
    if records.is_empty() || channels == 0 {
        return Err(ScreeningError::Nothing);
    }
    let least = if frequencies.is_some() { LEAST } else { LEAST.max(2 * options.dropped) };
    let samples = |r: &Record| (0..channels).map(|c| r.measured(channels, c).len()).max().unwrap_or(0);
    if let Some((run, samples)) = records.iter().map(samples).enumerate().find(|(_, n)| *n < least) {
        return Err(ScreeningError::TooShort { run, samples, least });
    }
    if let Some(run) = records.iter().position(|r| !is_finite(r, channels)) {
        return Err(ScreeningError::NotFinite { run });
    }
    let mut bins = match frequencies {
        Some(frequencies) => OutputBins::given(records, frequencies, channels, least),
        None => OutputBins::of(records, channels, options.dropped, least),
    };
    let fitted = records[0].fitted.len();
    let count: usize = bins.iter().map(|l| l.frequency.len()).sum();
    if 2 * fitted > count {
        return Err(ScreeningError::TooMany { fitted, bins: count });
    }
    let right: Vec<bool> = (0..channels)
        .map(|c| bins.iter().filter(|l| l.channel == c).all(|l| l.residual.norm_squared() == 0.0))
        .collect();
    bins.retain(|l| !right[l.channel]);
    if bins.is_empty() {
        return Err(ScreeningError::NothingWrong);
    }
    Ok(Basis::new(bins, channels, fitted))
}

/// Whether every signal is a number wherever something was measured, and has the residual's length.
fn is_finite(record: &Record, channels: usize) -> bool {
    let fits = |signal: &[f64]| {
        let mut pairs = signal.iter().zip(&record.residual);
        signal.len() == record.residual.len() && pairs.all(|(value, residual)| residual.is_nan() || value.is_finite())
    };
    record.interval > 0.0
        && record.interval.is_finite()
        && fits(&record.residual)
        && record.fitted.iter().flatten().all(|s| fits(s))
        && (0..record.directions.len()).all(|k| fits(&record.direction(k, channels)))
}

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
    shared: Basis,
    outliers: Vec<Outlier>,
    correlated: bool,
    /// Spectra of the outputs themselves.
    spectra: Vec<LogSpectrum>,
    directions: &'a [Direction],
    candidates: usize,
    noise: Noise,
    frame: Frame,
    /// What is taken out of a residual before its noise is judged.
    extraction: Extraction,
    drawing: NullDraws,
    /// Products of the axes with the residual.
    residual: DVector<f64>,
    trials: Vec<Trial>,
    marginals: Marginals,
    /// Draws differ from one residual to another, or what they have by chance would be in every judgement.
    seed: u64,
}

impl<'a> Judge<'a> {
    pub(super) fn new(shared: Basis, directions: &'a [Direction]) -> Self {
        let candidates = directions.iter().map(|d| d.candidate + 1).max().unwrap_or(0);
        let Saturated { mut shared, mut noise, outliers, rest } = Saturated::new(shared);
        let spectra = noise.spectra.clone();
        let mixed = rest.decorrelated(&shared);
        let correlated = mixed.is_some();
        if let Some(mixed) = mixed {
            shared = mixed;
            noise = Noise::new(&shared);
        }
        let frame = Frame::new(&shared, &noise.bands, &noise.density);
        let own = |k: usize| frame.directions.column(k).norm_squared();
        let usable: Vec<bool> = (0..directions.len()).map(|k| own(k) > ABSORBED * frame.energy[k]).collect();
        let mut trials = Trial::all(directions, &usable);
        let drawing = NullDraws::new(&noise.bands, &frame, &trials);
        parallel::each(trials.iter_mut(), |t| t.freedom = freedom(t, &noise, &drawing));
        let marginals = Marginals::new(&frame.directions, &trials, candidates);
        let residual = frame.residual(&noise.bands, &noise.density);
        let plain = likeliest(&noise.bands, &noise.spectra);
        let extraction = Extraction::new(&noise.bands, &Frame::new(&shared, &noise.bands, &plain), plain);
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
            extraction,
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

    /// The least chance of any candidate, as minus its logarithm, for each of these residuals of noise alone, drawn from
    /// spectra as likely as the one that was found.
    fn draws(&self, range: Range<usize>) -> Vec<f64> {
        let starts: Vec<usize> = range.clone().step_by(BATCH).collect();
        let batch = |first: usize| self.batch(first..range.end.min(first + BATCH));
        parallel::map(starts, batch).concat()
    }

    fn batch(&self, range: Range<usize>) -> Vec<f64> {
        let (noise, drawing) = (&self.noise, &self.drawing);
        let mut normals: Vec<Stream> = range.map(|k| Stream::seeded(self.seed.wrapping_add(k as u64))).collect();
        let deviations = |normal: &mut Stream| -> Vec<f64> {
            let spectra: Vec<LogSpectrum> = noise.spectra.iter().map(|s| s.drawn(normal)).collect();
            densities(&noise.bands, &spectra).into_iter().map(f64::sqrt).collect()
        };
        let deviations: Vec<Vec<f64>> = normals.iter_mut().map(deviations).collect();
        let drawn = drawing.drawn(&deviations, &mut normals);
        let left = self.extraction.left(&drawn, drawing);
        let seems =
            |left: &[f64], freedom: &[f64]| densities(&noise.bands, &noise.fitted(left, freedom, Some(&noise.spectra)));
        let density: Vec<Vec<f64>> = left
            .squares
            .column_iter()
            .zip(&left.freedom)
            .map(|(left, freedom)| seems(left.as_slice(), freedom))
            .collect();
        let products = drawing.products(&drawn, |k| &density[k]);
        let weights = DMatrix::from_fn(noise.density.len(), density.len(), |band, k| 1.0 / density[k][band]);
        let worth = |judged: &DrawnScores<'_>| {
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
        let rest = self.residual.rows(self.frame.absorbed, self.frame.directions.nrows()).into_owned();
        let gram = gram(&self.frame.directions);
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
        let absorbed = self.residual.rows(0, self.frame.absorbed).into_owned();
        let density = |channel: usize, f: f64| self.noise.spectra[channel].at(f.ln());
        consistencies(&self.shared, &self.frame, &DMatrix::from_columns(&chosen), &absorbed, density)
    }
}

/// By how many real numbers the noise under a trial is known: 2 / variance of its logarithm, averaged as the trial's energy.
fn freedom(trial: &Trial, noise: &Noise, drawing: &NullDraws) -> f64 {
    let mut energy = vec![0.0; noise.bands.list.len()];
    for k in &trial.members {
        let own = drawing.energies(*k, &noise.density);
        let whole: f64 = own.iter().sum::<f64>() * trial.members.len() as f64;
        energy.iter_mut().zip(own).for_each(|(sum, own)| *sum += own / whole);
    }
    let variance = |channel: usize| {
        let own = noise.bands.list.iter().zip(&energy).filter(|(band, _)| band.channel == channel);
        let weights: Vec<(f64, f64)> = own.map(|(band, energy)| (band.log_frequency, *energy)).collect();
        noise.spectra[channel].uncertainty(&weights).powi(2)
    };
    2.0 / (0..noise.bands.channels).map(variance).sum::<f64>()
}
