//! What all questions to residuals begin with: their bins, and the noise that would explain them alone.

use super::binned_run::{BinnedRun, Mixing, band, binned_runs};
use super::likelihood::{Settled, Spectra, settle};
use super::place::{DisturbanceError, FittedRun};
use crate::noise::{PENALTY, correlation_factor};
use nalgebra::DMatrix;

/// The share of bins, at the upper end, in which a correlation is looked for, and their fewest number.
const UPPER: f64 = 0.4;
const FEWEST: usize = 60;
/// Standard errors beyond which a correlation is one: among the pairs of eight outputs, by chance once in ten thousand.
const CLEAR: f64 = 4.5;
/// Largest correlation.
const LARGEST: f64 = 0.98;

/// Bins and noise.
pub(super) struct NullModel {
    /// Outputs as they were measured, with noise alone.
    pub(super) binned_runs: Vec<BinnedRun>,
    pub(super) noise: Settled,
    /// Bins and noise of combinations of outputs that have independent noises, where those of the outputs are not.
    turned: Option<(Vec<BinnedRun>, Settled)>,
    /// What turning adds to a log-likelihood, and what it costs.
    volume: f64,
    /// The frequency below which nearly all that the fitted parameters can change lies.
    pub(super) band: f64,
}

impl NullModel {
    pub(super) fn new(fitted_runs: &[FittedRun<'_>], outputs: usize) -> Result<Self, DisturbanceError> {
        let binned_runs = binned_runs(fitted_runs, outputs)?;
        let band = band(fitted_runs, &binned_runs, outputs);
        let noise = settle(&binned_runs, None, &Spectra::floor(&binned_runs));
        let mixings = correlated(&binned_runs, &noise.spectra);
        let mut volume = 0.0;
        let turned = mixings.map(|mixings| {
            let cost = mixings.first().map_or(0.0, |m| PENALTY * m.size() as f64);
            volume = -mixings.iter().map(Mixing::log_volume).sum::<f64>() - cost;
            let turned: Vec<BinnedRun> = binned_runs.iter().zip(mixings).map(|(binned, m)| binned.turned(m)).collect();
            let noise = settle(&turned, None, &Spectra::floor(&turned));
            (turned, noise)
        });
        Ok(Self { binned_runs, noise, turned, volume, band })
    }

    /// Bins whose noises are independent, and noise alone.
    pub(super) fn independent(&self) -> (&[BinnedRun], &Settled) {
        self.turned.as_ref().map_or((&self.binned_runs, &self.noise), |(binned_runs, noise)| (binned_runs, noise))
    }

    /// A log-likelihood of independent bins as one of the bins that were measured.
    pub(super) fn measured(&self, log_likelihood: f64) -> f64 {
        log_likelihood + self.volume
    }
}

/// For each run; none where no two outputs are correlated.
fn correlated(binned_runs: &[BinnedRun], noise: &Spectra) -> Option<Vec<Mixing>> {
    let q = binned_runs[0].channels();
    let mut sums: DMatrix<f64> = DMatrix::zeros(q, q);
    let mut count = 0;
    let mut deviations = Vec::with_capacity(binned_runs.len());
    for binned in binned_runs {
        let (bins, density) = (binned.frequency.len(), noise.density(binned));
        let deviation = DMatrix::from_fn(bins, q, |bin, c| density.channel(c)[bin].sqrt());
        let upper = bins - (UPPER * bins as f64) as usize;
        let white = binned.residual.component_div(&deviation);
        let told = white.rows(upper, bins - upper);
        sums += told.tr_mul(&told);
        count += bins - upper;
        deviations.push(deviation);
    }
    if count < FEWEST {
        return None;
    }
    let mut found = false;
    let correlation = DMatrix::from_fn(q, q, |a, b| {
        let value = sums[(a, b)] / (sums[(a, a)] * sums[(b, b)]).sqrt();
        match a == b {
            true => 1.0,
            false if value.abs() * (count as f64).sqrt() > CLEAR => {
                found = true;
                value.clamp(-LARGEST, LARGEST)
            }
            // not a number where an output was not measured
            false => 0.0,
        }
    });
    let factor = correlation_factor(correlation).filter(|_| found)?;
    Some(deviations.into_iter().map(|deviation| Mixing::new(deviation, factor.clone())).collect())
}
