//! Lines gathered into cells, one for each output and narrow band: inside a cell the noise has the level of the cell and a
//! shape that is known, so that every weighting by a spectrum is a sum over cells, and no line is needed again.

use super::calibration::Normal;
use super::noise::LogSpectrum;
use super::shared::{Part, Shared};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;

/// Ratio of the frequencies at which neighbouring bands begin.
const WIDTH: f64 = 1.25;
/// Fewest lines of a band, of the longest run.
const FEWEST: usize = 4;
/// What is left of a cell's products when they are factored, as a share of the largest.
const NEGLIGIBLE: f64 = 1e-12;

/// One output in one band.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    /// The output.
    pub(super) channel: usize,
    /// Mean logarithm of the frequencies.
    pub(super) log_frequency: f64,
    /// Number of lines.
    pub(super) count: usize,
    /// R with R'R the products of the shared columns (rank by r).
    pub(super) factor: DMatrix<f64>,
    /// Products of the shared columns with the residual (r).
    pub(super) products: DVector<f64>,
    /// Sum of squares of the residual.
    pub(super) residual: f64,
    /// Parts and lines.
    rows: Vec<(usize, Range<usize>)>,
}

/// A cell's lines of a residual that was drawn.
#[derive(Debug, Clone)]
pub(super) struct Drawn {
    /// Where the shared columns reach: coordinates along R.
    pub(super) along: DVector<f64>,
    /// Sum of squares of everything else.
    pub(super) beside: f64,
}

/// All cells of all runs.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    /// Outputs outermost, bands rising.
    pub(super) list: Vec<Cell>,
    /// Outputs q.
    pub(super) channels: usize,
}

impl Cells {
    /// Gathers lines; `shape` are spectra by which the level changes inside a cell.
    pub(super) fn new(shared: &Shared, shape: Option<&[LogSpectrum]>) -> Self {
        let edges = edges(&shared.parts);
        let places: Vec<(usize, usize)> =
            (0..shared.channels).flat_map(|c| (0..edges.len()).map(move |band| (c, band))).collect();
        let one = |(channel, band): (usize, usize)| {
            let high = edges.get(band + 1).copied().unwrap_or(f64::INFINITY);
            Cell::of(shared, channel, edges[band]..high, shape.map(|s| &s[channel]))
        };
        let list = places.into_par_iter().filter_map(one).collect();
        Self { list, channels: shared.channels }
    }

    /// Products with a residual that has changed.
    pub(super) fn renew(&mut self, shared: &Shared, shape: &[LogSpectrum]) {
        for cell in &mut self.list {
            let (columns, residual) = cell.gather(shared, Some(&shape[cell.channel]));
            (cell.products, cell.residual) = (columns.tr_mul(&residual), residual.norm_squared());
        }
    }

    /// Residuals of noise alone: standard normal numbers times the deviation of each cell.
    pub(super) fn noise(&self, deviation: impl Fn(&Cell) -> f64, normal: &mut Normal) -> Vec<Drawn> {
        let draw = |cell: &Cell| {
            let deviation = deviation(cell);
            let rank = cell.factor.nrows();
            let along = DVector::from_fn(rank, |_, _| deviation * normal.next());
            Drawn { along, beside: deviation * deviation * normal.square_sum(cell.count - rank) }
        };
        self.list.iter().map(draw).collect()
    }
}

impl Cell {
    fn of(shared: &Shared, channel: usize, band: Range<f64>, shape: Option<&LogSpectrum>) -> Option<Self> {
        let within = |(k, part): (usize, &Part)| {
            let first = part.frequency.partition_point(|f| *f < band.start);
            let rows = first..part.frequency.partition_point(|f| *f < band.end);
            (part.channel == channel && !rows.is_empty()).then_some((k, rows))
        };
        let rows: Vec<_> = shared.parts.iter().enumerate().filter_map(within).collect();
        let count: usize = rows.iter().map(|(_, rows)| rows.len()).sum();
        let logs = rows.iter().flat_map(|(k, rows)| &shared.parts[*k].frequency[rows.clone()]).map(|f| f.ln());
        let log_frequency = logs.sum::<f64>() / count as f64;
        let (factor, products) = (DMatrix::zeros(0, 0), DVector::zeros(0));
        let mut cell = Self { channel, log_frequency, count, factor, products, residual: 0.0, rows };
        if count == 0 {
            return None;
        }
        let (columns, residual) = cell.gather(shared, shape);
        (cell.products, cell.residual) = (columns.tr_mul(&residual), residual.norm_squared());
        cell.factor = if count > columns.ncols() { factored(columns.transpose() * columns) } else { compact(columns) };
        Some(cell)
    }

    /// Shared columns and residual, brought to the cell's level.
    fn gather(&self, shared: &Shared, shape: Option<&LogSpectrum>) -> (DMatrix<f64>, DVector<f64>) {
        let (mut columns, mut residual) = (DMatrix::zeros(self.count, shared.width()), DVector::zeros(self.count));
        let mut row = 0;
        for (k, rows) in &self.rows {
            let part = &shared.parts[*k];
            columns.rows_mut(row, rows.len()).copy_from(&part.basis.rows(rows.start, rows.len()));
            residual.rows_mut(row, rows.len()).copy_from(&part.residual.rows(rows.start, rows.len()));
            if let Some(shape) = shape {
                let level = shape.at(self.log_frequency);
                let factors: Vec<f64> =
                    part.frequency[rows.clone()].iter().map(|f| (level / shape.at(f.ln())).sqrt()).collect();
                for mut column in columns.column_iter_mut() {
                    column.rows_mut(row, rows.len()).iter_mut().zip(&factors).for_each(|(v, f)| *v *= f);
                }
                residual.rows_mut(row, rows.len()).iter_mut().zip(&factors).for_each(|(v, f)| *v *= f);
            }
            row += rows.len();
        }
        (columns, residual)
    }
}

/// Where bands begin: every band holds lines enough of the longest run.
fn edges(parts: &[Part]) -> Vec<f64> {
    let Some(longest) = parts.iter().max_by_key(|l| l.frequency.len()) else { return Vec::new() };
    let mut edges = vec![0.0];
    let mut first = 0;
    for (k, f) in longest.frequency.iter().enumerate() {
        let far = *f >= longest.frequency[first] * WIDTH && k - first >= FEWEST;
        if far && longest.frequency.len() - k >= FEWEST {
            edges.push(*f);
            first = k;
        }
    }
    edges
}

/// Fewer lines than columns: the lines themselves, unless fewer directions than lines carry them.
fn compact(columns: DMatrix<f64>) -> DMatrix<f64> {
    if columns.norm_squared() > 0.0 { columns } else { DMatrix::zeros(0, columns.ncols()) }
}

/// R of as few rows as carry the products R'R (Cholesky with pivots, ended where nothing is left).
fn factored(mut products: DMatrix<f64>) -> DMatrix<f64> {
    let size = products.nrows();
    let largest = products.diagonal().max();
    let mut rows: Vec<DVector<f64>> = Vec::new();
    while rows.len() < size {
        let (pivot, left) = products.diagonal().argmax();
        if left <= NEGLIGIBLE * largest || left <= 0.0 {
            break;
        }
        let row = products.column(pivot) / left.sqrt();
        products.ger(-1.0, &row, &row, 1.0);
        products[(pivot, pivot)] = 0.0;
        rows.push(row);
    }
    DMatrix::from_fn(rows.len(), size, |i, j| rows[i][j])
}
