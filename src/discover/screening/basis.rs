//! What all signals have in common: sensitivities and directions are smooth and alike, so that a few columns carry them all
//! and every sum over bins is made once, for these columns.
//!
//! Columns are chosen among the signals themselves, by pivots: the fitted ones first, then always the direction of which the
//! most is missing. Which they are is decided on a sketch of the bins, in the metric of the residual's own spectrum.
//!
//! Fewer rows that say of signals what all bins say: in every band some sums with random signs, whose products are on
//! average those of the bins (Charikar, Chen & Farach-Colton 2002; Clarkson & Woodruff 2013).
//!
//! Products of columns with each other, A'A, without those that are there already.

use crate::bins::OutputBins;
use crate::noise::{LogSpectrum, ResidualPower};
use fdm_numeric::parallel;
use fdm_numeric::random::mixed;
use nalgebra::{DMatrix, DMatrixView, DVector};

/// Of what a direction has beside the fitted columns, this share of its energy need not be carried.
const LOST: f64 = 1e-5;
/// Fitted columns with less than this share of their energy beside the others are made of them.
const MADE: f64 = 1e-12;
/// Directions with less than this share of their energy beside the fitted columns are made of these.
const NOTHING: f64 = 1e-9;
/// OutputBins by which a part tells one point of the residual's spectrum.
const BAND: usize = 8;

/// One output of one run (or of a difference between runs) in the shared columns.
#[derive(Debug, Clone)]
pub(super) struct OutputPart {
    /// The run.
    pub(super) run: usize,
    /// The output.
    pub(super) channel: usize,
    /// Samples that were transformed, by their places in the run.
    pub(super) samples: Vec<usize>,
    /// Whether its bins can be turned back into samples.
    pub(super) sampled: bool,
    /// Frequencies of the bins.
    pub(super) frequency: Vec<f64>,
    /// Basis columns, bins by r.
    pub(super) basis: DMatrix<f64>,
    /// The residual.
    pub(super) residual: DVector<f64>,
    /// A difference between runs that repeat each other: noise alone.
    pub(super) reference: bool,
}

impl OutputPart {
    /// Whether its first bin is the mean.
    pub(super) fn has_mean(&self) -> bool {
        self.sampled && self.frequency.len() == self.samples.len()
    }
}

/// All runs in shared columns.
#[derive(Debug, Clone)]
pub(super) struct Basis {
    /// Outputs of runs.
    pub(super) parts: Vec<OutputPart>,
    /// Signals by shared columns: r by p fitted.
    pub(super) fitted: DMatrix<f64>,
    /// r by m directions.
    pub(super) directions: DMatrix<f64>,
    /// Directions of unit norm.
    pub(super) unit: DMatrix<f64>,
    /// Fitted columns at the end that are not those of parameters.
    pub(super) ends: usize,
    /// Spectrum of each output's residual, whatever is in it.
    pub(super) spectra: Vec<LogSpectrum>,
    /// Outputs q.
    pub(super) channels: usize,
}

impl Basis {
    /// Finds the columns; of those signals the first p are fitted.
    pub(super) fn new(bins: Vec<OutputBins>, channels: usize, p: usize) -> Self {
        let spectra: Vec<LogSpectrum> = (0..channels).map(|channel| rough(&bins, channel)).collect();
        let gram = products(&bins, &spectra);
        let (pivots, rows) = chosen(&gram, p);
        let own = rows.select_columns(&pivots);
        let size = pivots.len();
        let combine =
            own.solve_upper_triangular(&DMatrix::identity(size, size)).unwrap_or_else(|| DMatrix::zeros(size, size));
        let part = |l: OutputBins| OutputPart {
            run: l.run,
            channel: l.channel,
            samples: l.samples,
            sampled: l.sampled,
            frequency: l.frequency,
            basis: l.columns.select_columns(&pivots) * &combine,
            residual: l.residual,
            reference: false,
        };
        let parts = parallel::map(bins, part);
        let directions = rows.columns(p, rows.ncols() - p).into_owned();
        let mut unit = directions.clone();
        for mut column in unit.column_iter_mut() {
            column.try_normalize_mut(0.0);
        }
        Self { parts, fitted: rows.columns(0, p).into_owned(), directions, unit, ends: 0, spectra, channels }
    }

    /// Basis columns r.
    pub(super) fn width(&self) -> usize {
        self.directions.nrows()
    }
}

/// The spectrum of an output's residual.
fn rough(bins: &[OutputBins], channel: usize) -> LogSpectrum {
    let mut left = Vec::new();
    for part in bins.iter().filter(|l| l.channel == channel) {
        let mut first = 0;
        while first < part.frequency.len() {
            // the mean alone
            let end = if first == 0 && part.sampled { 1 } else { first + BAND.max(first / 4) };
            let end = end.min(part.frequency.len());
            let count = (end - first) as f64;
            let log_frequency = part.frequency[first..end].iter().map(|f| f.ln()).sum::<f64>() / count;
            let power = part.residual.rows(first, end - first).norm_squared() / count;
            left.push(ResidualPower { log_frequency, power, freedom: count });
            first = end;
        }
    }
    LogSpectrum::fit(&left, 1.0)
}

/// Products of all signals with each other, about, weighed by these spectra.
fn products(bins: &[OutputBins], spectra: &[LogSpectrum]) -> DMatrix<f64> {
    let of = |(k, part): (usize, &OutputBins)| {
        let weight = |f: f64| spectra[part.channel].at(f.ln()).sqrt().recip();
        gram(&Sketch::new(&part.frequency, weight, k as u64).of(&part.columns))
    };
    let each: Vec<DMatrix<f64>> = parallel::map(bins.iter().enumerate(), of);
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

/// Rows of a band; one of fewer bins is kept as it is.
const ROWS: usize = 32;
/// Ratio of the frequencies at which neighbouring bands begin.
const WIDTH: f64 = 1.18;

/// Where each bin goes, and with which weight.
#[derive(Debug, Clone)]
pub(super) struct Sketch {
    places: Vec<(usize, f64)>,
    rows: usize,
}

impl Sketch {
    /// Of bins at rising frequencies with these weights; `seed` tells outputs and runs apart.
    pub(super) fn new(frequency: &[f64], weight: impl Fn(f64) -> f64, seed: u64) -> Self {
        let (mut places, mut rows, mut first) = (Vec::with_capacity(frequency.len()), 0, 0);
        while first < frequency.len() {
            let wide = frequency.partition_point(|f| *f < frequency[first] * WIDTH);
            let end = wide.max(first + ROWS).min(frequency.len());
            let exact = end - first <= ROWS;
            for (k, own) in frequency.iter().enumerate().take(end).skip(first) {
                let random = mixed(seed.wrapping_mul(0x1_0000_0001).wrapping_add(k as u64));
                let sign = if exact || random & 1 == 0 { 1.0 } else { -1.0 };
                let row = if exact { k - first } else { (random >> 32) as usize % ROWS };
                places.push((rows + row, sign * weight(*own)));
            }
            rows += ROWS.min(end - first);
            first = end;
        }
        Self { places, rows }
    }

    /// The rows of signals (bins by columns).
    pub(super) fn of(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let mut rows = DMatrix::zeros(self.rows, columns.ncols());
        for (column, mut own) in columns.column_iter().zip(rows.column_iter_mut()) {
            column.iter().zip(&self.places).for_each(|(value, (row, weight))| own[*row] += value * weight);
        }
        rows
    }
}

/// Columns of which all products are made at once.
const FEW: usize = 128;

/// Products of columns with each other, A'A, where rows come one part after the other.
pub(super) struct Products {
    size: usize,
    /// Some columns each, from the diagonal down.
    blocks: Vec<DMatrix<f64>>,
}

impl Products {
    /// Of so many columns, without a row yet.
    pub(super) fn new(size: usize) -> Self {
        let block = |first: usize| DMatrix::zeros(size - first, FEW.min(size - first));
        Self { size, blocks: (0..size).step_by(FEW).map(block).collect() }
    }

    /// With some rows more, which are given as columns. (Products with a transposed view go column by column, and nalgebra 0.35 reads beyond the
    /// end of a view with other strides where a product has few rows or columns.)
    pub(super) fn add(&mut self, rows: DMatrixView<'_, f64>) {
        let size = self.size;
        parallel::each(self.blocks.iter_mut().enumerate(), |(k, block)| {
            let first = FEW * k;
            let own = rows.rows(first, block.ncols()).transpose();
            block.gemm(1.0, &rows.rows(first, size - first), &own, 1.0);
        });
    }

    /// All of them.
    pub(super) fn whole(self) -> DMatrix<f64> {
        let mut products = DMatrix::zeros(self.size, self.size);
        for (k, block) in self.blocks.iter().enumerate() {
            products.view_mut((FEW * k, FEW * k), block.shape()).copy_from(block);
        }
        products.fill_upper_triangle_with_lower_triangle();
        products
    }
}

/// A'A.
pub(super) fn gram(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut products = Products::new(columns.ncols());
    products.add(columns.transpose().as_view());
    products.whole()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    #[test]
    fn few_columns_carry_all_signals() {
        // 60 directions of ten waves each, with a little of their own, beside four fitted ones of which one is made of others
        let mut normal = Stream::seeded(1);
        let count = 400;
        let waves = DMatrix::from_fn(count, 12, |i, k| fdm_grammar::math::sin(i as f64 * (0.01 + 0.05 * k as f64)));
        let mut columns = DMatrix::from_fn(count, 64, |_, _| 1e-4 * normal.normal_of_pair());
        for (k, mut column) in columns.column_iter_mut().enumerate() {
            let weights = DVector::from_fn(12, |i, _| if k < 4 || i < 10 { normal.normal_of_pair() } else { 0.0 });
            column += &waves * weights;
        }
        let made = columns.column(0) - columns.column(2);
        columns.set_column(3, &made);
        let whole = columns.clone();
        let bin = OutputBins {
            run: 0,
            sampled: true,
            channel: 0,
            samples: (0..count).collect(),
            frequency: (1..=count).map(|k| k as f64).collect(),
            columns,
            residual: DVector::from_fn(count, |_, _| normal.normal_of_pair()),
        };
        let shared = Basis::new(vec![bin], 1, 4);
        assert!((12..20).contains(&shared.width()), "{}", shared.width());
        let fitted = &shared.parts[0].basis * &shared.fitted - whole.columns(0, 4);
        assert!(fitted.norm() < 1e-8 * whole.columns(0, 4).norm());
        let lost = &shared.parts[0].basis * &shared.directions - whole.columns(4, 60);
        for k in 0..60 {
            assert!(lost.column(k).norm_squared() < 1e-4 * whole.column(4 + k).norm_squared());
        }
    }

    #[test]
    fn products_of_rows_are_those_of_lines() {
        let count = 4000;
        let frequency: Vec<f64> = (1..=count).map(|k| k as f64).collect();
        let sketch = Sketch::new(&frequency, |f| 1.0 + 1.0 / f, 3);
        assert!(sketch.rows < count / 4);
        let phase = |i: usize, k: usize| (i as f64 * (0.7 + 0.01 * k as f64) + k as f64).sin();
        let columns = DMatrix::from_fn(count, 3, |i, k| phase(i, k) / (1.0 + i as f64 / 400.0));
        let weighed = DMatrix::from_fn(count, 3, |i, k| columns[(i, k)] * (1.0 + 1.0 / frequency[i]));
        let (near, all) = (sketch.of(&columns), weighed.transpose() * &weighed);
        let near = near.transpose() * &near;
        for i in 0..3 {
            for j in 0..3 {
                let size = (all[(i, i)] * all[(j, j)]).sqrt();
                assert!((near[(i, j)] - all[(i, j)]).abs() < 0.15 * size, "{near} {all}");
            }
        }
    }

    #[test]
    fn blocks_are_the_whole() {
        let columns = DMatrix::from_fn(37, 150, |i, j| ((i * 7 + j * j) % 23) as f64 - 11.0);
        assert_eq!(gram(&columns), columns.transpose() * &columns);
    }
}
