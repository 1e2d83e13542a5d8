//! What all signals have in common: sensitivities and directions are smooth and alike, so that a few columns carry them all
//! and every sum over lines is made once, for these columns.
//!
//! Columns are chosen among the signals themselves, by pivots: the fitted ones first, then always the direction of which the
//! most is missing. Which they are is decided on a sketch of the lines, in the metric of the residual's own spectrum.

use super::lines::Lines;
use super::noise::{Left, LogSpectrum};
use super::sketch::Sketch;
use super::squared::squared;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Of what a direction has beside the fitted columns, this share of its energy need not be carried.
const LOST: f64 = 1e-5;
/// Fitted columns with less than this share of their energy beside the others are made of them.
const MADE: f64 = 1e-12;
/// The same for directions beside the fitted columns.
const NOTHING: f64 = 1e-9;
/// Lines by which a part tells one point of the residual's spectrum.
const BAND: usize = 8;

/// One output of one run (or of a difference between runs) in the shared columns.
#[derive(Debug, Clone)]
pub(super) struct Part {
    /// The run.
    pub(super) run: usize,
    /// The output.
    pub(super) channel: usize,
    /// Samples that were transformed, by their places in the run.
    pub(super) samples: Vec<usize>,
    /// Whether its lines can be turned back into samples.
    pub(super) sampled: bool,
    /// Frequencies of the lines.
    pub(super) frequency: Vec<f64>,
    /// Shared columns, lines by r.
    pub(super) basis: DMatrix<f64>,
    /// The residual.
    pub(super) residual: DVector<f64>,
    /// A difference between runs that repeat each other: noise alone.
    pub(super) reference: bool,
}

/// All runs in shared columns.
#[derive(Debug, Clone)]
pub(super) struct Shared {
    /// Outputs of runs.
    pub(super) parts: Vec<Part>,
    /// Signals by shared columns: r by p fitted.
    pub(super) fitted: DMatrix<f64>,
    /// r by m directions.
    pub(super) directions: DMatrix<f64>,
    /// The same, of unit norm.
    pub(super) unit: DMatrix<f64>,
    /// Fitted columns at the end that are not those of parameters.
    pub(super) ends: usize,
    /// Spectrum of each output's residual, whatever is in it.
    pub(super) spectra: Vec<LogSpectrum>,
    /// Outputs q.
    pub(super) channels: usize,
}

impl Shared {
    /// Finds the columns; of those signals the first p are fitted.
    pub(super) fn new(lines: Vec<Lines>, channels: usize, p: usize) -> Self {
        let spectra: Vec<LogSpectrum> = (0..channels).map(|channel| rough(&lines, channel)).collect();
        let gram = products(&lines, &spectra);
        let (pivots, rows) = chosen(&gram, p);
        let own = rows.select_columns(&pivots);
        let size = pivots.len();
        let combine =
            own.solve_upper_triangular(&DMatrix::identity(size, size)).unwrap_or_else(|| DMatrix::zeros(size, size));
        let part = |l: Lines| Part {
            run: l.run,
            channel: l.channel,
            samples: l.samples,
            sampled: l.sampled,
            frequency: l.frequency,
            basis: l.columns.select_columns(&pivots) * &combine,
            residual: l.residual,
            reference: false,
        };
        let parts = lines.into_par_iter().map(part).collect();
        let directions = rows.columns(p, rows.ncols() - p).into_owned();
        let mut unit = directions.clone();
        for mut column in unit.column_iter_mut() {
            column.try_normalize_mut(0.0);
        }
        Self { parts, fitted: rows.columns(0, p).into_owned(), directions, unit, ends: 0, spectra, channels }
    }

    /// Shared columns r.
    pub(super) fn width(&self) -> usize {
        self.directions.nrows()
    }
}

/// The spectrum of an output's residual.
fn rough(lines: &[Lines], channel: usize) -> LogSpectrum {
    let mut left = Vec::new();
    for part in lines.iter().filter(|l| l.channel == channel) {
        let mut first = 0;
        while first < part.frequency.len() {
            let end = (first + BAND.max(first / 4)).min(part.frequency.len());
            let count = (end - first) as f64;
            let log_frequency = part.frequency[first..end].iter().map(|f| f.ln()).sum::<f64>() / count;
            let power = part.residual.rows(first, end - first).norm_squared() / count;
            left.push(Left { log_frequency, power, freedom: count });
            first = end;
        }
    }
    LogSpectrum::fit(&left, 1.0)
}

/// Products of all signals with each other, about, weighed by these spectra.
fn products(lines: &[Lines], spectra: &[LogSpectrum]) -> DMatrix<f64> {
    let of = |(k, part): (usize, &Lines)| {
        let weight = |f: f64| spectra[part.channel].at(f.ln()).sqrt().recip();
        squared(&Sketch::new(&part.frequency, weight, k as u64).of(&part.columns))
    };
    let each: Vec<DMatrix<f64>> = lines.par_iter().enumerate().map(of).collect();
    let mut each = each.into_iter();
    let first = each.next().unwrap_or_else(|| DMatrix::zeros(0, 0));
    each.fold(first, |sum, own| sum + own)
}

/// Signals that carry all others, and rows R (of as many) with R'R the products: Cholesky with pivots.
fn chosen(gram: &DMatrix<f64>, p: usize) -> (Vec<usize>, DMatrix<f64>) {
    let count = gram.nrows();
    let energy: Vec<f64> = gram.diagonal().iter().copied().collect();
    let (mut left, mut beside) = (energy.clone(), energy.clone());
    let (mut pivots, mut rows): (Vec<usize>, Vec<DVector<f64>>) = (Vec::new(), Vec::new());
    for range in [0..p, p..count] {
        if range.start == p {
            beside.copy_from_slice(&left);
        }
        loop {
            let share = |k: &usize| match *k < p {
                true => left[*k] / energy[*k] / MADE,
                false if beside[*k] <= NOTHING * energy[*k] => 0.0,
                false => left[*k] / beside[*k] / LOST,
            };
            let largest = range.clone().filter(|k| energy[*k] > 0.0).max_by(|a, b| share(a).total_cmp(&share(b)));
            let Some(pivot) = largest.filter(|k| share(k) > 1.0) else { break };
            let mut row = gram.column(pivot).into_owned();
            rows.iter().for_each(|known| row.axpy(-known[pivot], known, 1.0));
            row /= left[pivot].sqrt();
            for (left, value) in left.iter_mut().zip(row.iter()) {
                *left = (*left - value * value).max(0.0);
            }
            pivots.iter().for_each(|known| row[*known] = 0.0);
            left[pivot] = 0.0;
            pivots.push(pivot);
            rows.push(row);
        }
    }
    let mut all = DMatrix::zeros(rows.len(), count);
    all.row_iter_mut().zip(&rows).for_each(|(mut own, row)| own.tr_copy_from(row));
    (pivots, all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::screen::calibration::Normal;

    #[test]
    fn few_columns_carry_all_signals() {
        // 60 directions of ten waves each, with a little of their own, beside four fitted ones of which one is made of others
        let mut normal = Normal::new(1);
        let count = 400;
        let waves = DMatrix::from_fn(count, 12, |i, k| fdm_grammar::math::sin(i as f64 * (0.01 + 0.05 * k as f64)));
        let mut columns = DMatrix::from_fn(count, 64, |_, _| 1e-4 * normal.next());
        for (k, mut column) in columns.column_iter_mut().enumerate() {
            let weights = DVector::from_fn(12, |i, _| if k < 4 || i < 10 { normal.next() } else { 0.0 });
            column += &waves * weights;
        }
        let made = columns.column(0) - columns.column(2);
        columns.set_column(3, &made);
        let whole = columns.clone();
        let line = Lines {
            run: 0,
            sampled: true,
            channel: 0,
            samples: (0..count).collect(),
            frequency: (1..=count).map(|k| k as f64).collect(),
            columns,
            residual: DVector::from_fn(count, |_, _| normal.next()),
        };
        let shared = Shared::new(vec![line], 1, 4);
        assert!((12..20).contains(&shared.width()), "{}", shared.width());
        let fitted = &shared.parts[0].basis * &shared.fitted - whole.columns(0, 4);
        assert!(fitted.norm() < 1e-8 * whole.columns(0, 4).norm());
        let lost = &shared.parts[0].basis * &shared.directions - whole.columns(4, 60);
        for k in 0..60 {
            assert!(lost.column(k).norm_squared() < 1e-4 * whole.column(4 + k).norm_squared());
        }
    }
}
