//! What neither fit nor candidates explain, bin by bin in units of the noise found: single values that noise does not make,
//! and what outputs have in common.

use super::basis::{Basis, OutputPart};
use super::saturated::{Noise, with_ends};
use crate::noise::{LogSpectrum, correlation_factor};
use fdm_numeric::fourier::CosineTransform;
use fdm_numeric::parallel;
use fdm_numeric::statistics::chi_squared_tail;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::FRAC_1_SQRT_2;

/// Deviations beyond which a bin or a sample is cut back.
const LIMIT: f64 = 5.0;
/// Ratio of the frequencies at which neighbouring bands of a correlation begin, and fewest bins of one.
const OCTAVE: f64 = 2.0;
const FEWEST: usize = 24;
/// Chance, over all pairs, below which a correlation of two outputs is taken for one.
const SIGNIFICANT: f64 = 1e-3;

/// Times that outliers are looked for.
const CLIPS: usize = 3;

/// A bin or a sample of the residual that noise does not make; it was cut back to five deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outlier {
    /// The run.
    pub run: usize,
    /// The output.
    pub channel: usize,
    /// Where.
    pub place: OutlierPlace,
    /// Its size in deviations of the noise.
    pub size: f64,
}

/// Where an outlier is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OutlierPlace {
    /// At a sample of the run.
    Sample(usize),
    /// At a frequency, in cycles per unit of time.
    Frequency(f64),
}

/// The rest of every part.
pub(super) struct Standardised {
    /// Deviation of the noise at each bin.
    deviation: Vec<Vec<f64>>,
    /// The residual without what fit and candidates explain, in deviations.
    bins: Vec<DVector<f64>>,
    /// Bins of what was taken out, orthonormal in all parts together.
    taken: Vec<DMatrix<f64>>,
}

impl Standardised {
    /// Of runs that are not turned.
    pub(super) fn new(shared: &Basis, noise: &Noise) -> Self {
        let (basis, multiples) = &noise.taken;
        let of = |part: &OutputPart| {
            let deviation = |f: &f64| noise.spectra[part.channel].at(f.ln()).sqrt();
            let deviation: Vec<f64> = part.frequency.iter().map(deviation).collect();
            let mut bins = &part.residual - &part.basis * multiples;
            let mut taken = &part.basis * basis;
            for mut column in taken.column_iter_mut().chain([bins.column_mut(0)]) {
                column.iter_mut().zip(&deviation).for_each(|(v, s)| *v /= s);
            }
            (deviation, bins, taken)
        };
        let (mut deviation, mut bins, mut taken) = (Vec::new(), Vec::new(), Vec::new());
        for (own, rest, signals) in parallel::map(shared.parts.iter(), of) {
            deviation.push(own);
            bins.push(rest);
            taken.push(signals);
        }
        Self { deviation, bins, taken }
    }

    /// Cuts back what noise does not make, and says what that was.
    pub(super) fn clip(&self, shared: &mut Basis) -> Vec<Outlier> {
        let mut outliers = Vec::new();
        for ((part, deviation), bins) in shared.parts.iter_mut().zip(&self.deviation).zip(&self.bins) {
            let (n, dropped) = (part.samples.len(), part.samples.len() - bins.len());
            let mut report = |place, size| {
                outliers.push(Outlier { run: part.run, channel: part.channel, place, size });
            };
            // bins first: one of them would be at all samples
            let mut clean = vec![0.0; n];
            for (k, bin) in bins.iter().enumerate() {
                // a mean is no outlier, and makes none of the samples: nothing beside it says how large it may be
                if k == 0 && part.has_mean() {
                    continue;
                }
                let kept = bin.clamp(-LIMIT, LIMIT);
                if kept != *bin {
                    part.residual[k] += (kept - bin) * deviation[k];
                    report(OutlierPlace::Frequency(part.frequency[k]), *bin);
                }
                clean[dropped + k] = kept;
            }
            if !part.sampled {
                continue;
            }
            let scale = (2.0 / n as f64).sqrt();
            let mut cosines = CosineTransform::new(n);
            cosines.backward(&mut clean);
            let mut excess = vec![0.0; n];
            for (k, sample) in clean.iter().enumerate() {
                let sample = sample * scale;
                if sample.abs() > LIMIT {
                    excess[k] = sample - sample.clamp(-LIMIT, LIMIT);
                    report(OutlierPlace::Sample(part.samples[k]), sample);
                }
            }
            if excess.iter().any(|e| *e != 0.0) {
                cosines.forward(&mut excess);
                excess[0] *= FRAC_1_SQRT_2;
                for (k, deviation) in deviation.iter().enumerate() {
                    part.residual[k] -= excess[dropped + k] * scale * deviation;
                }
            }
        }
        outliers
    }

    /// Combinations of outputs whose noises are independent, where those of the outputs are not; none where they are.
    ///
    /// All are in units of the noise found, so that their spectra are near 1. The correlation is that of bins at the same
    /// frequency: what two outputs share in phase.
    pub(super) fn decorrelated(&self, shared: &Basis) -> Option<Basis> {
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

    /// Bins of a band and correlations between all outputs in it, as they would be without a projection.
    fn correlation(&self, shared: &Basis, runs: &[Vec<usize>], edges: &[f64], band: usize) -> (usize, DMatrix<f64>) {
        let mut sums = DMatrix::zeros(shared.channels, shared.channels);
        let mut count = 0;
        for run in runs {
            let first = &shared.parts[run[0]];
            let rows = rows(&first.frequency, edges, band);
            // without the means, which no noise need have made
            let rows = rows.start.max(usize::from(first.has_mean()))..rows.end;
            count += rows.len();
            for (a, first) in run.iter().enumerate() {
                for (b, second) in run.iter().enumerate().take(a) {
                    let part = |k: usize| self.bins[k].rows(rows.start, rows.len());
                    let taken = |k: usize| self.taken[k].rows(rows.start, rows.len());
                    sums[(a, b)] += part(*first).dot(&part(*second)) + taken(*first).dot(&taken(*second));
                }
            }
        }
        (count, sums)
    }
}

/// Runs in which all outputs have the same bins, by the places of their parts.
fn aligned(shared: &Basis) -> Vec<Vec<usize>> {
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
    let significant = |pair: &&(usize, usize)| {
        let sum: f64 = told.iter().map(|(count, sums)| sums[**pair].powi(2) / *count as f64).sum();
        chi_squared_tail(sum, told.len() as f64).is_some_and(|p| p < SIGNIFICANT / pairs.len() as f64)
    };
    let pairs: Vec<(usize, usize)> = pairs.iter().filter(significant).copied().collect();
    if pairs.is_empty() {
        return None;
    }
    let of = |band: usize| {
        // neighbours steady what few bins tell
        let near = &bands[band.saturating_sub(1)..bands.len().min(band + 2)];
        let count: usize = near.iter().map(|b| b.0).sum();
        let mut correlation = DMatrix::identity(channels, channels);
        for (a, b) in &pairs {
            let sum: f64 = near.iter().map(|n| n.1[(*a, *b)]).sum();
            let value = (sum / count.max(1) as f64).clamp(-0.98, 0.98);
            (correlation[(*a, *b)], correlation[(*b, *a)]) = (value, value);
        }
        correlation_factor(correlation).unwrap_or_else(|| DMatrix::identity(channels, channels))
    };
    Some((0..bands.len()).map(of).collect())
}

/// Solves L y = x over the outputs of a run, for all signals in a band.
fn mix(parts: &mut [OutputPart], run: &[usize], edges: &[f64], band: usize, factor: &DMatrix<f64>) {
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

/// A residual without outliers, and its noise.
pub(super) struct Saturated {
    pub(super) shared: Basis,
    pub(super) noise: Noise,
    pub(super) outliers: Vec<Outlier>,
    pub(super) rest: Standardised,
}

impl Saturated {
    pub(super) fn new(mut shared: Basis) -> Self {
        let mut noise = Noise::new(&shared);
        if let Some(grown) = with_ends(&shared, &noise.spectra) {
            shared = grown;
            shared.spectra = noise.spectra;
            noise = Noise::new(&shared);
        }
        let mut rest = Standardised::new(&shared, &noise);
        let mut outliers: Vec<Outlier> = Vec::new();
        for _ in 0..CLIPS {
            let found = rest.clip(&mut shared);
            if found.is_empty() {
                break;
            }
            // what is cut back again has been told, and was larger
            let known = |o: &Outlier| (o.run, o.channel, o.place);
            let new: Vec<Outlier> =
                found.into_iter().filter(|new| outliers.iter().all(|old| known(old) != known(new))).collect();
            outliers.extend(new);
            shared.spectra = noise.spectra;
            noise = Noise::new(&shared);
            rest = Standardised::new(&shared, &noise);
        }
        Self { shared, noise, outliers, rest }
    }
}
