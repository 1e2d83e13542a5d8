//! What neither fit nor candidates explain, line by line in units of the noise found: single values that noise does not make,
//! and what outputs have in common.

use super::noise::LogSpectrum;
use super::saturated::Noise;
use super::shared::{Part, Shared};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use rustdct::DctPlanner;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Deviations beyond which a line or a sample is cut back.
const LIMIT: f64 = 5.0;
/// Ratio of the frequencies at which neighbouring bands of a correlation begin, and fewest lines of one.
const OCTAVE: f64 = 2.0;
const FEWEST: usize = 24;
/// Chance, over all pairs, below which a correlation of two outputs is taken for one.
const SIGNIFICANT: f64 = 1e-3;

/// A line or a sample of the residual that noise does not make; it was cut back to five deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlier {
    /// The run.
    pub run: usize,
    /// The output.
    pub channel: usize,
    /// Where.
    pub place: Place,
    /// Its size in deviations of the noise.
    pub size: f64,
}

/// Where an outlier is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// At a sample of the run.
    Sample(usize),
    /// At a frequency, in cycles per unit of time.
    Frequency(f64),
}

/// The rest of every part.
pub(super) struct Rest {
    /// Deviation of the noise at each line.
    deviation: Vec<Vec<f64>>,
    /// The residual without what fit and candidates explain, in deviations.
    lines: Vec<DVector<f64>>,
    /// Lines of what was taken out, orthonormal in all parts together.
    taken: Vec<DMatrix<f64>>,
}

impl Rest {
    /// Of runs that are not turned.
    pub(super) fn new(shared: &Shared, noise: &Noise) -> Self {
        let (basis, multiples) = &noise.taken;
        let of = |part: &Part| {
            let deviation = |f: &f64| noise.spectra[part.channel].at(f.ln()).sqrt();
            let deviation: Vec<f64> = part.frequency.iter().map(deviation).collect();
            let mut lines = &part.residual - &part.basis * multiples;
            let mut taken = &part.basis * basis;
            for mut column in taken.column_iter_mut().chain([lines.column_mut(0)]) {
                column.iter_mut().zip(&deviation).for_each(|(v, s)| *v /= s);
            }
            (deviation, lines, taken)
        };
        let (mut deviation, mut lines, mut taken) = (Vec::new(), Vec::new(), Vec::new());
        for (own, rest, signals) in shared.parts.par_iter().map(of).collect::<Vec<_>>() {
            deviation.push(own);
            lines.push(rest);
            taken.push(signals);
        }
        Self { deviation, lines, taken }
    }

    /// Cuts back what noise does not make, and says what that was.
    pub(super) fn clip(&self, shared: &mut Shared) -> Vec<Outlier> {
        let mut planner = DctPlanner::new();
        let mut outliers = Vec::new();
        for ((part, deviation), lines) in shared.parts.iter_mut().zip(&self.deviation).zip(&self.lines) {
            let (n, dropped) = (part.samples.len(), part.samples.len() - lines.len());
            let mut report = |place, size| {
                outliers.push(Outlier { run: part.run, channel: part.channel, place, size });
            };
            // lines first: one of them would be at all samples
            let mut clean = vec![0.0; n];
            for (k, line) in lines.iter().enumerate() {
                let kept = line.clamp(-LIMIT, LIMIT);
                if kept != *line {
                    part.residual[k] += (kept - line) * deviation[k];
                    report(Place::Frequency(part.frequency[k]), *line);
                }
                clean[dropped + k] = kept;
            }
            if !part.sampled {
                continue;
            }
            let scale = (2.0 / n as f64).sqrt();
            planner.plan_dct3(n).process_dct3(&mut clean);
            let mut excess = vec![0.0; n];
            for (k, sample) in clean.iter().enumerate() {
                let sample = sample * scale;
                if sample.abs() > LIMIT {
                    excess[k] = sample - sample.clamp(-LIMIT, LIMIT);
                    report(Place::Sample(part.samples[k]), sample);
                }
            }
            if excess.iter().any(|e| *e != 0.0) {
                planner.plan_dct2(n).process_dct2(&mut excess);
                for (k, deviation) in deviation.iter().enumerate() {
                    part.residual[k] -= excess[dropped + k] * scale * deviation;
                }
            }
        }
        outliers
    }

    /// Combinations of outputs whose noises are independent, where those of the outputs are not; none where they are.
    ///
    /// All are in units of the noise found, so that their spectra are near 1. The correlation is that of lines at the same
    /// frequency: what two outputs share in phase.
    pub(super) fn decorrelated(&self, shared: &Shared) -> Option<Shared> {
        let runs = aligned(shared);
        let longest = runs.iter().max_by_key(|r| shared.parts[r[0]].frequency.len())?;
        let edges = edges(&shared.parts[longest[0]].frequency);
        let bands: Vec<(usize, DMatrix<f64>)> =
            (0..edges.len()).map(|band| self.correlation(shared, &runs, &edges, band)).collect();
        let factors = factors(&bands, shared.channels)?;
        let mut mixed = shared.clone();
        mixed.spectra.fill(LogSpectrum::flat(1.0));
        for (part, deviation) in mixed.parts.iter_mut().zip(&self.deviation) {
            for mut column in part.basis.column_iter_mut().chain([part.residual.column_mut(0)]) {
                column.iter_mut().zip(deviation).for_each(|(v, s)| *v /= s);
            }
        }
        for run in &runs {
            for (band, factor) in factors.iter().enumerate() {
                mix(&mut mixed.parts, run, &edges, band, factor);
            }
        }
        Some(mixed)
    }

    /// Lines of a band and correlations between all outputs in it, as they would be without a projection.
    fn correlation(&self, shared: &Shared, runs: &[Vec<usize>], edges: &[f64], band: usize) -> (usize, DMatrix<f64>) {
        let mut sums = DMatrix::zeros(shared.channels, shared.channels);
        let mut count = 0;
        for run in runs {
            let rows = rows(&shared.parts[run[0]].frequency, edges, band);
            count += rows.len();
            for (a, first) in run.iter().enumerate() {
                for (b, second) in run.iter().enumerate().take(a) {
                    let part = |k: usize| self.lines[k].rows(rows.start, rows.len());
                    let taken = |k: usize| self.taken[k].rows(rows.start, rows.len());
                    sums[(a, b)] += part(*first).dot(&part(*second)) + taken(*first).dot(&taken(*second));
                }
            }
        }
        (count, sums)
    }
}

/// Runs in which all outputs have the same lines, by the places of their parts.
fn aligned(shared: &Shared) -> Vec<Vec<usize>> {
    let mut runs: Vec<usize> = shared.parts.iter().map(|p| p.run).collect();
    runs.dedup();
    let of = |run: usize| {
        let own: Vec<usize> = (0..shared.parts.len()).filter(|k| shared.parts[*k].run == run).collect();
        let same = own.iter().all(|k| shared.parts[*k].samples == shared.parts[own[0]].samples);
        (same && own.len() == shared.channels && shared.channels > 1).then_some(own)
    };
    runs.into_iter().filter_map(of).collect()
}

fn edges(frequency: &[f64]) -> Vec<f64> {
    let mut edges = vec![0.0];
    let mut first = 0;
    for (k, f) in frequency.iter().enumerate() {
        if *f >= frequency[first] * OCTAVE && k - first >= FEWEST && frequency.len() - k >= FEWEST {
            edges.push(*f);
            first = k;
        }
    }
    edges
}

fn rows(frequency: &[f64], edges: &[f64], band: usize) -> std::ops::Range<usize> {
    let high = edges.get(band + 1).copied().unwrap_or(f64::INFINITY);
    frequency.partition_point(|f| *f < edges[band])..frequency.partition_point(|f| *f < high)
}

/// L of the correlation L L' of every band, from sums of products; none where no two outputs are correlated.
fn factors(bands: &[(usize, DMatrix<f64>)], channels: usize) -> Option<Vec<DMatrix<f64>>> {
    let pairs: Vec<(usize, usize)> = (0..channels).flat_map(|a| (0..a).map(move |b| (a, b))).collect();
    let told: Vec<&(usize, DMatrix<f64>)> = bands.iter().filter(|b| b.0 > 0).collect();
    let law = ChiSquared::new(told.len() as f64).ok()?;
    let significant = |pair: &&(usize, usize)| {
        let sum: f64 = told.iter().map(|(count, sums)| sums[**pair].powi(2) / *count as f64).sum();
        law.sf(sum) < SIGNIFICANT / pairs.len() as f64
    };
    let pairs: Vec<(usize, usize)> = pairs.iter().filter(significant).copied().collect();
    if pairs.is_empty() {
        return None;
    }
    let of = |band: usize| {
        // neighbours steady what few lines tell
        let near = &bands[band.saturating_sub(1)..bands.len().min(band + 2)];
        let count: usize = near.iter().map(|b| b.0).sum();
        let mut correlation = DMatrix::identity(channels, channels);
        for (a, b) in &pairs {
            let sum: f64 = near.iter().map(|n| n.1[(*a, *b)]).sum();
            let value = (sum / count.max(1) as f64).clamp(-0.98, 0.98);
            (correlation[(*a, *b)], correlation[(*b, *a)]) = (value, value);
        }
        positive(correlation)
    };
    Some((0..bands.len()).map(of).collect())
}

/// Cholesky factor; correlations are made smaller until there is one.
fn positive(mut correlation: DMatrix<f64>) -> DMatrix<f64> {
    let size = correlation.nrows();
    for _ in 0..100 {
        let margin = &correlation - DMatrix::identity(size, size) * 0.01;
        if margin.cholesky().is_some() {
            break;
        }
        correlation *= 0.95;
        correlation.fill_diagonal(1.0);
    }
    correlation.cholesky().map_or_else(|| DMatrix::identity(size, size), |c| c.unpack())
}

/// Solves L y = x over the outputs of a run, for all signals in a band.
fn mix(parts: &mut [Part], run: &[usize], edges: &[f64], band: usize, factor: &DMatrix<f64>) {
    let rows = rows(&parts[run[0]].frequency, edges, band);
    let (start, count) = (rows.start, rows.len());
    for a in 0..run.len() {
        for b in 0..a {
            let weight = factor[(a, b)];
            if weight != 0.0 {
                let basis = parts[run[b]].basis.rows(start, count).into_owned();
                let residual = parts[run[b]].residual.rows(start, count).into_owned();
                let part = &mut parts[run[a]];
                part.basis.rows_mut(start, count).zip_apply(&basis, |v, other| *v -= weight * other);
                part.residual.rows_mut(start, count).axpy(-weight, &residual, 1.0);
            }
        }
        let part = &mut parts[run[a]];
        let scale = 1.0 / factor[(a, a)];
        part.basis.rows_mut(start, count).scale_mut(scale);
        part.residual.rows_mut(start, count).scale_mut(scale);
    }
}
