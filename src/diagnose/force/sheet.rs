//! Runs as lines: the orthonormal cosine transform of residuals, fitted sensitivities and responses to forces, output by output.

use super::mixing::Mixing;
use super::place::{ForceError, Passage};
use nalgebra::{DMatrix, SymmetricEigen};
use rustdct::{DctPlanner, TransformType2And3};
use std::sync::Arc;

/// Lines that are left out at the low end: the mean, and the slowest drift of noise with a long memory.
pub(super) const DROPPED: usize = 4;
/// Fewest samples of a run.
const LEAST: usize = 32;
/// Combinations of fitted columns (of unit norm) with less than this of the largest energy are not determined.
const UNDETERMINED: f64 = 1e-10;
/// Columns whose energy behind the first lines is less than this share are constants.
const CONSTANT: f64 = 1e-9;
/// Below this share of its energy a column's lines are rounding.
const ROUNDING: f64 = 1e-20;
/// Share of the energy of the fitted sensitivities that lies below the frequency up to which forces are looked for.
const BAND: f64 = 0.95;

/// Cosine transform of one length, without its first lines.
pub(super) struct Cosines {
    transform: Arc<dyn TransformType2And3<f64>>,
    buffer: Vec<f64>,
}

impl Cosines {
    pub(super) fn new(samples: usize) -> Self {
        Self { transform: DctPlanner::new().plan_dct2(samples), buffer: vec![0.0; samples] }
    }

    /// The first lines behind those that are dropped, of values that are zero where nothing was measured.
    pub(super) fn lines(&mut self, values: impl Iterator<Item = f64>, into: &mut [f64]) {
        let n = self.buffer.len();
        self.buffer.iter_mut().zip(values).for_each(|(b, v)| *b = v);
        self.transform.process_dct2(&mut self.buffer);
        let scale = (2.0 / n as f64).sqrt();
        into.iter_mut().zip(&self.buffer[DROPPED..]).for_each(|(line, value)| *line = value * scale);
    }
}

/// One run.
#[derive(Debug, Clone)]
pub(super) struct Sheet {
    pub(super) samples: usize,
    /// Time between samples.
    pub(super) interval: f64,
    /// Frequencies of the lines L, in cycles per unit of time.
    pub(super) frequency: Vec<f64>,
    /// Residual (L by q).
    pub(super) residual: DMatrix<f64>,
    /// Fitted sensitivities of each output (L by p).
    pub(super) fitted: Vec<DMatrix<f64>>,
    /// What was measured (N by q).
    seen: Vec<bool>,
    /// What its outputs were turned by.
    mixing: Option<Mixing>,
}

impl Sheet {
    fn new(passage: Passage<'_>, q: usize) -> Self {
        let record = passage.record;
        let samples = record.residual.len() / q;
        let lines = samples - DROPPED;
        let mut cosines = Cosines::new(samples);
        let seen: Vec<bool> = record.residual.iter().map(|r| !r.is_nan()).collect();
        let mut residual = DMatrix::zeros(lines, q);
        let mut fitted = vec![DMatrix::zeros(lines, record.fitted.len()); q];
        for (channel, fitted) in fitted.iter_mut().enumerate() {
            let own = |values: &[f64]| -> Vec<f64> {
                let cells = (channel..samples * q).step_by(q);
                cells.map(|at| if seen[at] { values[at] } else { 0.0 }).collect()
            };
            cosines.lines(own(&record.residual).into_iter(), residual.column_mut(channel).as_mut_slice());
            for (k, column) in record.fitted.iter().enumerate() {
                if let Some(column) = column {
                    let (values, mut lines) = (own(column), fitted.column_mut(k));
                    let energy: f64 = values.iter().map(|v| v * v).sum();
                    cosines.lines(values.into_iter(), lines.as_mut_slice());
                    // the rounding of a constant is not a signal
                    if lines.norm_squared() < ROUNDING * energy {
                        lines.fill(0.0);
                    }
                }
            }
        }
        let interval = record.interval;
        let frequency = (DROPPED..samples).map(|k| k as f64 / (2.0 * samples as f64 * interval)).collect();
        Self { samples, interval, frequency, residual, fitted, seen, mixing: None }
    }

    /// Number of outputs q.
    pub(super) fn channels(&self) -> usize {
        self.fitted.len()
    }

    /// Number of lines below a frequency.
    pub(super) fn below(&self, frequency: f64) -> usize {
        self.frequency.partition_point(|f| *f <= frequency)
    }

    /// The low lines of what a signal (N) in the record of one output does to all of them.
    pub(super) fn sensed(&self, cosines: &mut Cosines, signal: &[f64], channel: usize, low: usize) -> Vec<Vec<f64>> {
        let q = self.channels();
        let mut columns = vec![vec![0.0; low]; q];
        let seen = self.seen.iter().skip(channel).step_by(q);
        cosines.lines(signal.iter().zip(seen).map(|(v, seen)| if *seen { *v } else { 0.0 }), &mut columns[channel]);
        self.turn(columns)
    }

    /// The low lines of a response (N by q), as a column for each output.
    pub(super) fn response(&self, cosines: &mut Cosines, response: &[f64], low: usize) -> Vec<Vec<f64>> {
        let q = self.channels();
        let columns = (0..q).map(|channel| {
            let mut lines = vec![0.0; low];
            let cells = (channel..self.samples * q).step_by(q);
            cosines.lines(cells.map(|at| if self.seen[at] { response[at] } else { 0.0 }), &mut lines);
            lines
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

    /// The same with outputs turned into combinations of them.
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

/// All runs as lines, their fitted sensitivities as orthogonal combinations.
pub(super) fn sheets(passages: &[Passage<'_>], q: usize) -> Result<Vec<Sheet>, ForceError> {
    if passages.is_empty() || q == 0 {
        return Err(ForceError::Nothing);
    }
    let samples = |p: &Passage<'_>| p.record.residual.len() / q;
    let short = passages.iter().map(samples).enumerate().find(|(_, n)| *n < LEAST);
    if let Some((run, samples)) = short {
        return Err(ForceError::TooShort { run, samples, least: LEAST });
    }
    let mut sheets: Vec<Sheet> = passages.iter().map(|p| Sheet::new(*p, q)).collect();
    let (fitted, lines) =
        (passages[0].record.fitted.len(), sheets.iter().map(|s| q * s.frequency.len()).sum::<usize>());
    if 2 * fitted > lines {
        return Err(ForceError::TooMany { fitted, lines });
    }
    orthogonal(&mut sheets);
    Ok(sheets)
}

/// Replaces the fitted columns by combinations that are orthogonal when every output counts by the size of its residual.
fn orthogonal(sheets: &mut [Sheet]) {
    let (q, p) = (sheets[0].channels(), sheets[0].fitted[0].ncols());
    let power: Vec<f64> =
        (0..q).map(|c| sheets.iter().map(|s| s.residual.column(c).norm_squared()).sum::<f64>()).collect();
    let mut products = DMatrix::zeros(p, p);
    for sheet in sheets.iter() {
        for (columns, power) in sheet.fitted.iter().zip(&power) {
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
    for columns in sheets.iter_mut().flat_map(|s| &mut s.fitted) {
        *columns = &*columns * &combine;
    }
}

/// The frequency below which nearly all that the fitted parameters can change lies.
pub(super) fn band(passages: &[Passage<'_>], sheets: &[Sheet], q: usize) -> f64 {
    let mut energies: Vec<(f64, f64)> = Vec::new();
    for (passage, sheet) in passages.iter().zip(sheets) {
        let mut cosines = Cosines::new(sheet.samples);
        let mut lines = vec![0.0; sheet.frequency.len()];
        for column in passage.record.fitted.iter().flatten() {
            for channel in 0..q {
                let own = || column.iter().skip(channel).step_by(q).copied();
                cosines.lines(own(), &mut lines);
                let energy: f64 = lines.iter().map(|l| l * l).sum();
                if energy > CONSTANT * own().map(|v| v * v).sum::<f64>() {
                    energies.extend(sheet.frequency.iter().zip(&lines).map(|(f, l)| (*f, l * l / energy)));
                }
            }
        }
    }
    let highest = sheets.iter().filter_map(|s| s.frequency.last()).copied().fold(0.0, f64::max);
    energies.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = energies.iter().map(|(_, e)| e).sum();
    let mut sum = 0.0;
    let found = energies.iter().find(|(_, e)| {
        sum += e;
        sum > BAND * total
    });
    found.map_or(highest / 10.0, |(f, _)| *f)
}
