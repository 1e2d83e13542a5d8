//! Bins gathered into bands, one for each output and narrow band: inside a band the noise has the level of the band and a
//! shape that is known, so that every weighting by a spectrum is a sum over bands, and no bin is needed again. Beside a resonance bands are narrow:
//! a level for all of it would be too low at its top, where an effect that rings there would then gain by noise.

use super::basis::{Basis, OutputPart, gram};
use super::saturated::PROMINENT;
use crate::noise::LogSpectrum;
use fdm_numeric::parallel;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Ratio of the frequencies at which neighbouring bands begin.
const WIDTH: f64 = 1.12;
/// Fewest bins of a band, of the longest run; the lowest ones stand alone, since under noise of long memory each has its level.
const FEWEST: usize = 4;
/// Ratio of the frequencies at which bands near a resonance begin, and how near that is, in log f.
const NARROW: f64 = 1.03;
const NEAR: f64 = 0.3;
/// What is left of a band's products when they are factored, in units of the noise: shared columns have about unit energy in
/// all bands together.
const NEGLIGIBLE: f64 = 1e-7;

/// One output in one band.
#[derive(Debug, Clone)]
pub(super) struct Band {
    /// The output.
    pub(super) channel: usize,
    /// Of differences between runs that repeat each other.
    pub(super) reference: bool,
    /// Mean logarithm of the frequencies.
    pub(super) log_frequency: f64,
    /// Number of bins.
    pub(super) count: usize,
    /// R' with R'R the products of the shared columns (r by as few as carry them, or by bins).
    pub(super) root: DMatrix<f64>,
    /// Products of the shared columns with the residual (r).
    pub(super) products: DVector<f64>,
    /// Sum of squares of the residual.
    pub(super) residual: f64,
    /// Parts and bins.
    rows: Vec<(usize, Range<usize>)>,
}

/// All bands of all runs.
#[derive(Debug, Clone)]
pub(super) struct Bands {
    /// Outputs outermost, bands rising.
    pub(super) list: Vec<Band>,
    /// Outputs q.
    pub(super) channels: usize,
    /// Whether some are narrow, near a resonance.
    pub(super) narrow: bool,
}

impl Bands {
    /// Bins of all bands.
    pub(super) fn bins(&self) -> usize {
        self.list.iter().map(|band| band.count).sum()
    }

    /// Gathers bins; `shape` are spectra by which the level changes inside a band. They are those of noise where bands are to be narrow near
    /// their peaks: what a residual holds beside noise may have peaks of its own.
    pub(super) fn new(shared: &Basis, shape: &[LogSpectrum], of_noise: bool) -> Self {
        let peaks: Vec<f64> = shape.iter().filter(|_| of_noise).filter_map(|s| s.peak(PROMINENT)).collect();
        let edges = edges(&shared.parts, &peaks);
        let places: Vec<(usize, usize, bool)> = (0..shared.channels)
            .flat_map(|c| (0..edges.len()).flat_map(move |band| [(c, band, false), (c, band, true)]))
            .collect();
        let one = |(channel, band, reference): (usize, usize, bool)| {
            let high = edges.get(band + 1).copied().unwrap_or(f64::INFINITY);
            Band::of(shared, (channel, reference), edges[band]..high, &shape[channel])
        };
        let list = parallel::filter_map(places, one);
        Self { list, channels: shared.channels, narrow: !peaks.is_empty() }
    }
}

impl Band {
    fn of(shared: &Basis, (channel, reference): (usize, bool), band: Range<f64>, shape: &LogSpectrum) -> Option<Self> {
        let within = |(k, part): (usize, &OutputPart)| {
            let first = part.frequency.partition_point(|f| *f < band.start);
            let rows = first..part.frequency.partition_point(|f| *f < band.end);
            (part.channel == channel && part.reference == reference && !rows.is_empty()).then_some((k, rows))
        };
        let rows: Vec<_> = shared.parts.iter().enumerate().filter_map(within).collect();
        let count: usize = rows.iter().map(|(_, rows)| rows.len()).sum();
        let logs = rows.iter().flat_map(|(k, rows)| &shared.parts[*k].frequency[rows.clone()]).map(|f| f.ln());
        let log_frequency = logs.sum::<f64>() / count as f64;
        let (root, products) = (DMatrix::zeros(0, 0), DVector::zeros(0));
        let mut band = Self { channel, reference, log_frequency, count, root, products, residual: 0.0, rows };
        if count == 0 {
            return None;
        }
        let (columns, residual) = band.gather(shared, shape);
        (band.products, band.residual) = (columns.tr_mul(&residual), residual.norm_squared());
        band.root = root_of(&columns, NEGLIGIBLE * shape.at(band.log_frequency));
        Some(band)
    }

    /// Basis columns and residual, brought to the band's level.
    fn gather(&self, shared: &Basis, shape: &LogSpectrum) -> (DMatrix<f64>, DVector<f64>) {
        let (mut columns, mut residual) = (DMatrix::zeros(self.count, shared.width()), DVector::zeros(self.count));
        let level = shape.at(self.log_frequency);
        let mut row = 0;
        for (k, rows) in &self.rows {
            let part = &shared.parts[*k];
            let factors: Vec<f64> =
                part.frequency[rows.clone()].iter().map(|f| (level / shape.at(f.ln())).sqrt()).collect();
            let take = |from: &[f64], to: &mut [f64]| {
                let pairs = from[rows.clone()].iter().zip(&factors);
                to[row..row + rows.len()].iter_mut().zip(pairs).for_each(|(to, (from, factor))| *to = from * factor);
            };
            let (bins, size) = (part.basis.nrows(), self.count);
            let from = part.basis.as_slice().chunks_exact(bins);
            from.zip(columns.as_mut_slice().chunks_exact_mut(size)).for_each(|(from, to)| take(from, to));
            take(part.residual.as_slice(), residual.as_mut_slice());
            row += rows.len();
        }
        (columns, residual)
    }
}

/// Where bands begin: every band holds bins enough of the longest run, but near peaks (log f).
fn edges(parts: &[OutputPart], peaks: &[f64]) -> Vec<f64> {
    let Some(longest) = parts.iter().max_by_key(|l| l.frequency.len()) else { return Vec::new() };
    let near = |f: f64| peaks.iter().any(|peak| (f.ln() - peak).abs() < NEAR);
    let mut edges = vec![0.0];
    let mut first = 0;
    for (k, f) in longest.frequency.iter().enumerate() {
        let from = longest.frequency[first];
        let far = match (near(from), near(*f)) {
            (true, _) => k > first && *f >= from * NARROW,
            (false, true) => k > first,
            (false, false) => *f >= from * WIDTH && k - first >= FEWEST.min(1 + first / FEWEST),
        };
        if far && longest.frequency.len() - k >= FEWEST {
            edges.push(*f);
            first = k;
        }
    }
    edges
}

/// Columns from which on a band of no more bins than columns keeps its bins: of 1,145 columns in 30,000 bins of 216 bands, pivots left
/// 28,754 rows.
const MANY: usize = 256;

/// R' of as few columns as carry the products R'R of a band's columns (Cholesky with pivots, ended where no more than this is left).
fn root_of(columns: &DMatrix<f64>, negligible: f64) -> DMatrix<f64> {
    let (bins, size) = columns.shape();
    if size >= MANY && bins <= size {
        return columns.transpose();
    }
    let products = gram(columns);
    let mut left: Vec<f64> = products.diagonal().iter().copied().collect();
    let mut found: Vec<DVector<f64>> = Vec::new();
    while found.len() < size.min(bins) {
        let Some(pivot) = (0..size).max_by(|a, b| left[*a].total_cmp(&left[*b])) else { break };
        if left[pivot].is_nan() || left[pivot] <= negligible {
            break;
        }
        let mut own = products.column(pivot).into_owned();
        found.iter().for_each(|known| own.axpy(-known[pivot], known, 1.0));
        own /= left[pivot].sqrt();
        left.iter_mut().zip(own.iter()).for_each(|(left, value)| *left = (*left - value * value).max(0.0));
        left[pivot] = 0.0;
        found.push(own);
    }
    if found.is_empty() { DMatrix::zeros(size, 0) } else { DMatrix::from_columns(&found) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roots_carry_the_products_of_few_columns_and_of_many() {
        let bins = 40;
        // twelve waves in all columns, and next to nothing beside them
        let wave = |i: usize, k: usize| (i as f64 * (0.05 + 0.21 * k as f64) + k as f64).sin();
        let weight = |k: usize, j: usize| ((j * (k + 3) + k) as f64 * 0.37).cos();
        for (size, ranks) in [(MANY - 1, 12..20), (MANY, bins..bins + 1), (30, 12..20)] {
            let columns = DMatrix::from_fn(bins, size, |i, j| {
                (0..12).map(|k| wave(i, k) * weight(k, j)).sum::<f64>() + 1e-6 * wave(i, 13 + j % 7)
            });
            let root = root_of(&columns, 1e-7);
            assert!(ranks.contains(&root.ncols()), "{}", root.ncols());
            let (own, all) = (&root * root.transpose(), columns.transpose() * &columns);
            assert!((&own - &all).amax() < 1e-6 * all.amax(), "{}", (&own - &all).amax());
        }
    }
}
