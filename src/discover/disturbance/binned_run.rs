//! Runs as bins: the orthonormal cosine transform of residuals, fitted sensitivities and responses to disturbances, output by output.
//!
//! Noise that outputs share: combinations of outputs whose noises are independent.
//!
//! What sensors have in common (a shared supply, a structure that shakes them) must not be taken for a disturbance in front of them. No model
//! says anything of the uppermost bins: a correlation there is one of the noises, and is taken to hold in all bins.

use super::place::{DisturbanceError, FittedRun};
use crate::bins::{Cosines, DROPPED};
use nalgebra::{DMatrix, SymmetricEigen};

/// Fewest samples of a run.
const LEAST: usize = 32;
/// Combinations of fitted columns (of unit norm) with less than this of the largest energy are not determined.
const UNDETERMINED: f64 = 1e-10;
/// Columns whose energy behind the first bins is less than this share are constants.
const CONSTANT: f64 = 1e-9;
/// Below this share of its energy a column's bins are rounding.
const ROUNDING: f64 = 1e-20;
/// Share of the energy of the fitted sensitivities that lies below the frequency up to which disturbances are looked for.
const BAND: f64 = 0.95;

/// One run.
#[derive(Debug, Clone)]
pub(super) struct BinnedRun {
    pub(super) samples: usize,
    /// Time between samples.
    pub(super) interval: f64,
    /// Frequencies of the bins L, in cycles per unit of time.
    pub(super) frequency: Vec<f64>,
    /// Residual (L by q).
    pub(super) residual: DMatrix<f64>,
    /// Fitted sensitivities of each output (L by p).
    pub(super) fitted: Vec<DMatrix<f64>>,
    /// What every sample is multiplied by (N by q): 0 where nothing was measured, else 1 over the relative deviation of its noise.
    weight: Vec<f64>,
    /// Whether the noise of some output is not even. Signals are then centred, as a constant would not be in the first bins alone.
    uneven: bool,
    /// What its outputs were turned by.
    mixing: Option<Mixing>,
}

impl BinnedRun {
    fn new(fitted_run: FittedRun<'_>, q: usize) -> Self {
        let record = fitted_run.record;
        let samples = record.residual.len() / q;
        let bins = samples - DROPPED;
        let mut cosines = Cosines::new(samples);
        let deviation = |at: usize| record.deviations.as_ref().map_or(1.0, |own| own[at]);
        let seen = |(at, r): (usize, &f64)| if r.is_nan() { 0.0 } else { 1.0 / deviation(at) };
        let weight: Vec<f64> = record.residual.iter().enumerate().map(seen).collect();
        let uneven = record.deviations.is_some();
        let mut residual = DMatrix::zeros(bins, q);
        let mut fitted = vec![DMatrix::zeros(bins, record.fitted.len()); q];
        for (channel, fitted) in fitted.iter_mut().enumerate() {
            let own = |values: &[f64]| weighed(&weight, uneven, (channel, q), |k| values[k * q + channel]);
            cosines.bins(own(&record.residual).into_iter(), residual.column_mut(channel).as_mut_slice());
            for (k, column) in record.fitted.iter().enumerate() {
                if let Some(column) = column {
                    let (values, mut bins) = (own(column), fitted.column_mut(k));
                    let energy: f64 = values.iter().map(|v| v * v).sum();
                    cosines.bins(values.into_iter(), bins.as_mut_slice());
                    // the rounding of a constant is not a signal
                    if bins.norm_squared() < ROUNDING * energy {
                        bins.fill(0.0);
                    }
                }
            }
        }
        let interval = record.interval;
        let frequency = (DROPPED..samples).map(|k| k as f64 / (2.0 * samples as f64 * interval)).collect();
        Self { samples, interval, frequency, residual, fitted, weight, uneven, mixing: None }
    }

    /// Number of outputs q.
    pub(super) fn channels(&self) -> usize {
        self.fitted.len()
    }

    /// Number of bins below a frequency.
    pub(super) fn below(&self, frequency: f64) -> usize {
        self.frequency.partition_point(|f| *f <= frequency)
    }

    /// Number of bins that a response holds whose band ends at a frequency. Over uneven noise that is all of them: weights have kinks, and what is
    /// a combination of fitted sensitivities must be one in all of their bins.
    pub(super) fn reached(&self, frequency: f64) -> usize {
        if self.uneven { self.frequency.len() } else { self.below(frequency) }
    }

    /// The low bins of what a signal (N) in the record of one output does to all of them.
    pub(super) fn sensed(&self, cosines: &mut Cosines, signal: &[f64], channel: usize, low: usize) -> Vec<Vec<f64>> {
        let q = self.channels();
        let mut columns = vec![vec![0.0; low]; q];
        let own = weighed(&self.weight, self.uneven, (channel, q), |k| signal[k]);
        cosines.bins(own.into_iter(), &mut columns[channel]);
        self.turn(columns)
    }

    /// The low bins of a response (N by q), as a column for each output.
    pub(super) fn response(&self, cosines: &mut Cosines, response: &[f64], low: usize) -> Vec<Vec<f64>> {
        let q = self.channels();
        let columns = (0..q).map(|channel| {
            let mut bins = vec![0.0; low];
            let own = weighed(&self.weight, self.uneven, (channel, q), |k| response[k * q + channel]);
            cosines.bins(own.into_iter(), &mut bins);
            bins
        });
        let columns = columns.collect();
        self.turn(columns)
    }

    fn turn(&self, mut columns: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if let Some(mixing) = &self.mixing {
            mixing.apply(&mut columns);
        }
        columns
    }

    /// This run with outputs turned into combinations of them.
    pub(super) fn turned(&self, mixing: Mixing) -> Self {
        let (q, p) = (self.channels(), self.fitted[0].ncols());
        let mut turned = Self { mixing: Some(mixing), ..self.clone() };
        let columns = |of: &dyn Fn(usize) -> Vec<f64>| turned.turn((0..q).map(of).collect());
        let residual = columns(&|c| self.residual.column(c).iter().copied().collect());
        let fitted: Vec<Vec<Vec<f64>>> =
            (0..p).map(|k| columns(&|c| self.fitted[c].column(k).iter().copied().collect())).collect();
        for (c, residual) in residual.iter().enumerate() {
            turned.residual.column_mut(c).copy_from_slice(residual);
            for (k, column) in fitted.iter().enumerate() {
                turned.fitted[c].column_mut(k).copy_from_slice(&column[c]);
            }
        }
        turned
    }
}

/// Samples of one output by the weights of its noise. Centred they are beside a constant, by the same weights: what a plain mean leaves of it
/// would have the shape of the weights, a function of the signal, and be taken for a law.
fn weighed(weight: &[f64], centred: bool, (channel, q): (usize, usize), value: impl Fn(usize) -> f64) -> Vec<f64> {
    let own = || weight.iter().skip(channel).step_by(q).enumerate();
    let mean = if centred {
        let present = own().filter(|(_, w)| **w > 0.0);
        let (sum, squares) =
            present.fold((0.0, 0.0), |(sum, squares), (k, w)| (sum + w * w * value(k), squares + w * w));
        if squares > 0.0 { sum / squares } else { 0.0 }
    } else {
        0.0
    };
    own().map(|(k, w)| if *w > 0.0 { (value(k) - mean) * w } else { 0.0 }).collect()
}

/// All runs as bins, their fitted sensitivities as orthogonal combinations.
pub(super) fn binned_runs(fitted_runs: &[FittedRun<'_>], q: usize) -> Result<Vec<BinnedRun>, DisturbanceError> {
    if fitted_runs.is_empty() || q == 0 {
        return Err(DisturbanceError::Nothing);
    }
    let samples = |p: &FittedRun<'_>| p.record.residual.len() / q;
    let short = fitted_runs.iter().map(samples).enumerate().find(|(_, n)| *n < LEAST);
    if let Some((run, samples)) = short {
        return Err(DisturbanceError::TooShort { run, samples, least: LEAST });
    }
    let mut binned_runs: Vec<BinnedRun> = fitted_runs.iter().map(|p| BinnedRun::new(*p, q)).collect();
    let (fitted, bins) =
        (fitted_runs[0].record.fitted.len(), binned_runs.iter().map(|s| q * s.frequency.len()).sum::<usize>());
    if 2 * fitted > bins {
        return Err(DisturbanceError::TooMany { fitted, bins });
    }
    orthogonal(&mut binned_runs);
    Ok(binned_runs)
}

/// Replaces the fitted columns by combinations that are orthogonal when every output counts by the size of its residual.
fn orthogonal(binned_runs: &mut [BinnedRun]) {
    let (q, p) = (binned_runs[0].channels(), binned_runs[0].fitted[0].ncols());
    let power: Vec<f64> =
        (0..q).map(|c| binned_runs.iter().map(|s| s.residual.column(c).norm_squared()).sum::<f64>()).collect();
    let mut products = DMatrix::zeros(p, p);
    for binned in binned_runs.iter() {
        for (columns, power) in binned.fitted.iter().zip(&power) {
            if *power > 0.0 {
                products += columns.tr_mul(columns) / *power;
            }
        }
    }
    // numbers that overflow are not determined by anything
    products.apply(|v| *v = if v.is_finite() { *v } else { 0.0 });
    if p == 0 {
        return;
    }
    let scale = products.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
    let unit = DMatrix::from_fn(p, p, |i, j| products[(i, j)] * scale[i] * scale[j]);
    let eigen = SymmetricEigen::new(unit);
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let kept: Vec<usize> = (0..p).filter(|k| eigen.eigenvalues[*k] > UNDETERMINED * largest).collect();
    let combine = DMatrix::from_fn(p, kept.len(), |i, k| {
        scale[i] * eigen.eigenvectors[(i, kept[k])] / eigen.eigenvalues[kept[k]].sqrt()
    });
    for columns in binned_runs.iter_mut().flat_map(|s| &mut s.fitted) {
        *columns = &*columns * &combine;
    }
}

/// The frequency below which nearly all that the fitted parameters can change lies.
pub(super) fn band(fitted_runs: &[FittedRun<'_>], binned_runs: &[BinnedRun], q: usize) -> f64 {
    let mut energies: Vec<(f64, f64)> = Vec::new();
    for (fitted_run, binned) in fitted_runs.iter().zip(binned_runs) {
        let mut cosines = Cosines::new(binned.samples);
        let mut bins = vec![0.0; binned.frequency.len()];
        for column in fitted_run.record.fitted.iter().flatten() {
            for channel in 0..q {
                let own = || column.iter().skip(channel).step_by(q).copied();
                cosines.bins(own(), &mut bins);
                let energy: f64 = bins.iter().map(|l| l * l).sum();
                if energy > CONSTANT * own().map(|v| v * v).sum::<f64>() {
                    energies.extend(binned.frequency.iter().zip(&bins).map(|(f, l)| (*f, l * l / energy)));
                }
            }
        }
    }
    let highest = binned_runs.iter().filter_map(|s| s.frequency.last()).copied().fold(0.0, f64::max);
    energies.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = energies.iter().map(|(_, e)| e).sum();
    let mut sum = 0.0;
    let found = energies.iter().find(|(_, e)| {
        sum += e;
        sum > BAND * total
    });
    found.map_or(highest / 10.0, |(f, _)| *f)
}

/// What turns the outputs of a run into independent ones: x over the noise's deviation, then L^-1 x, with L L' the correlation.
#[derive(Debug, Clone)]
pub(super) struct Mixing {
    /// Bins by outputs.
    deviation: DMatrix<f64>,
    factor: DMatrix<f64>,
}

impl Mixing {
    pub(super) fn new(deviation: DMatrix<f64>, factor: DMatrix<f64>) -> Self {
        Self { deviation, factor }
    }

    /// Turns the first bins of all outputs, in their place.
    pub(super) fn apply(&self, outputs: &mut [Vec<f64>]) {
        for a in 0..outputs.len() {
            let (before, own) = outputs.split_at_mut(a);
            for (bin, value) in own[0].iter_mut().enumerate() {
                *value /= self.deviation[(bin, a)];
                for (b, other) in before.iter().enumerate() {
                    *value -= self.factor[(a, b)] * other[bin];
                }
                *value /= self.factor[(a, a)];
            }
        }
    }

    /// Logarithm of the volume by which it shrinks all bins.
    pub(super) fn log_volume(&self) -> f64 {
        let scales: f64 = self.factor.diagonal().iter().map(|v| v.ln()).sum();
        self.deviation.iter().map(|d| d.ln()).sum::<f64>() + scales * self.deviation.nrows() as f64
    }

    /// Numbers that were found for it.
    pub(super) fn size(&self) -> usize {
        let q = self.factor.nrows();
        q * q.saturating_sub(1) / 2
    }
}
