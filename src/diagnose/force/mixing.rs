//! Noise that outputs share: combinations of outputs whose noises are independent.
//!
//! What sensors have in common (a shared supply, a structure that shakes them) must not be taken for a force in front of them. No model
//! says anything of the uppermost lines: a correlation there is one of the noises, and is taken to hold in all lines.

use super::sheet::Sheet;
use super::spectra::Spectra;
use nalgebra::DMatrix;

/// The share of lines, at the upper end, in which a correlation is looked for, and their fewest number.
const UPPER: f64 = 0.4;
const FEWEST: usize = 60;
/// Standard errors beyond which a correlation is one: among the pairs of eight outputs, by chance once in ten thousand.
const CLEAR: f64 = 4.5;
/// Largest correlation.
const LARGEST: f64 = 0.98;

/// What turns the outputs of a run into independent ones: x over the noise's deviation, then L^-1 x, with L L' the correlation.
#[derive(Debug, Clone)]
pub(super) struct Mixing {
    /// Lines by outputs.
    deviation: DMatrix<f64>,
    factor: DMatrix<f64>,
}

impl Mixing {
    /// For each run; none where no two outputs are correlated.
    pub(super) fn of(sheets: &[Sheet], noise: &Spectra) -> Option<Vec<Self>> {
        let q = sheets[0].channels();
        let mut sums: DMatrix<f64> = DMatrix::zeros(q, q);
        let mut count = 0;
        let mut deviations = Vec::with_capacity(sheets.len());
        for sheet in sheets {
            let (lines, density) = (sheet.frequency.len(), noise.density(sheet));
            let deviation = DMatrix::from_fn(lines, q, |line, c| density.channel(c)[line].sqrt());
            let upper = lines - (UPPER * lines as f64) as usize;
            let white = sheet.residual.component_div(&deviation);
            let told = white.rows(upper, lines - upper);
            sums += told.tr_mul(&told);
            count += lines - upper;
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
        let factor = positive(correlation).filter(|_| found)?;
        Some(deviations.into_iter().map(|deviation| Self { deviation, factor: factor.clone() }).collect())
    }

    /// Turns the first lines of all outputs, in their place.
    pub(super) fn apply(&self, outputs: &mut [Vec<f64>]) {
        for a in 0..outputs.len() {
            let (before, own) = outputs.split_at_mut(a);
            for (line, value) in own[0].iter_mut().enumerate() {
                *value /= self.deviation[(line, a)];
                for (b, other) in before.iter().enumerate() {
                    *value -= self.factor[(a, b)] * other[line];
                }
                *value /= self.factor[(a, a)];
            }
        }
    }

    /// Logarithm of the volume by which it shrinks all lines.
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

/// Cholesky factor; correlations are made smaller until there is one.
fn positive(mut correlation: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = correlation.nrows();
    for _ in 0..100 {
        if (&correlation - DMatrix::identity(size, size) * 0.01).cholesky().is_some() {
            break;
        }
        correlation *= 0.95;
        correlation.fill_diagonal(1.0);
    }
    correlation.cholesky().map(|c| c.unpack())
}
