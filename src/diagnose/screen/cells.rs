//! Lines gathered into cells, one for each output and narrow band, in which the noise is taken as white: with the products of
//! all signals in each cell, every weighting by a spectrum is a sum over cells, and no line is needed again.

use super::calibration::Normal;
use super::lines::{Lines, Record};
use nalgebra::{DMatrix, DVector};
use rustdct::DctPlanner;

/// Ratio of the frequencies at which neighbouring bands begin.
const WIDTH: f64 = 1.25;
/// Fewest lines of a band, of the longest run.
const FEWEST: usize = 4;
/// A cell in which every signal has less than this share of its energy says nothing but how strong the noise is there.
const EMPTY: f64 = 1e-9;

/// One output in one band.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    /// The output.
    pub(super) channel: usize,
    /// Mean logarithm of the frequencies.
    pub(super) log_frequency: f64,
    /// Number of lines.
    pub(super) count: usize,
    /// Products of fitted sensitivities and directions with each other; none where they have no energy.
    pub(super) signals: Option<Products>,
    /// Sum of squares of the residual.
    pub(super) residual: f64,
}

/// Products inside a cell.
#[derive(Debug, Clone)]
pub(super) struct Products {
    /// X'X of the columns X: fitted, then directions.
    pub(super) squares: DMatrix<f64>,
    /// X'r
    pub(super) residual: DVector<f64>,
    /// X itself, for draws of noise (lines by columns).
    pub(super) lines: DMatrix<f64>,
}

/// A cell's lines of a residual that was drawn.
#[derive(Debug, Clone)]
pub(super) struct Drawn {
    /// X'r; none where the cell has no signals.
    pub(super) products: Option<DVector<f64>>,
    /// Sum of squares.
    pub(super) squares: f64,
}

/// All cells of all runs.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    /// Outputs outermost, bands rising.
    pub(super) list: Vec<Cell>,
    /// Fitted columns p.
    pub(super) fitted: usize,
    /// Direction columns m.
    pub(super) directions: usize,
    /// Outputs q.
    pub(super) channels: usize,
}

impl Cells {
    /// Gathers the lines of all runs; the first `dropped` lines of each are left out.
    ///
    /// Runs must have more samples than that.
    pub(super) fn new(records: &[Record], channels: usize, dropped: usize) -> Self {
        let (fitted, directions) = records.first().map_or((0, 0), |r| (r.fitted.len(), r.directions.len()));
        let mut planner = DctPlanner::new();
        let lines: Vec<Lines> = records.iter().flat_map(|r| Lines::of(r, channels, dropped, &mut planner)).collect();
        let edges = edges(&lines);
        let energy = energies(&lines);
        let mut list = Vec::with_capacity(channels * edges.len());
        for channel in 0..channels {
            for band in 0..edges.len() {
                let (low, high) = (edges[band], edges.get(band + 1).copied().unwrap_or(f64::INFINITY));
                let own = lines.iter().filter(|l| l.channel == channel);
                let parts: Vec<_> = own
                    .map(|l| {
                        let rows =
                            l.frequency.partition_point(|f| *f < low)..l.frequency.partition_point(|f| *f < high);
                        (l, rows)
                    })
                    .filter(|(_, rows)| !rows.is_empty())
                    .collect();
                list.extend(cell(channel, &parts, fitted + directions, &energy));
            }
        }
        Self { list, fitted, directions, channels }
    }

    /// Residuals of noise alone: standard normal numbers times the deviation of each cell.
    pub(super) fn noise(&self, deviation: impl Fn(&Cell) -> f64, normal: &mut Normal) -> Vec<Drawn> {
        let draw = |cell: &Cell| {
            let deviation = deviation(cell);
            match &cell.signals {
                Some(signals) => {
                    let lines = DVector::from_fn(cell.count, |_, _| deviation * normal.next());
                    Drawn { squares: lines.norm_squared(), products: Some(signals.lines.tr_mul(&lines)) }
                }
                None => Drawn { squares: deviation * deviation * normal.square_sum(cell.count), products: None },
            }
        };
        self.list.iter().map(draw).collect()
    }
}

/// Where bands begin: every band holds lines enough of the longest run.
fn edges(lines: &[Lines]) -> Vec<f64> {
    let Some(longest) = lines.iter().max_by_key(|l| l.frequency.len()) else { return Vec::new() };
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

/// Sum of squares of every column over all lines.
fn energies(lines: &[Lines]) -> Vec<f64> {
    let mut energies = Vec::new();
    for line in lines {
        energies.resize(line.columns.ncols(), 0.0);
        for (energy, column) in energies.iter_mut().zip(line.columns.column_iter()) {
            *energy += column.norm_squared();
        }
    }
    energies
}

fn cell(channel: usize, parts: &[(&Lines, std::ops::Range<usize>)], columns: usize, energy: &[f64]) -> Option<Cell> {
    let count: usize = parts.iter().map(|(_, rows)| rows.len()).sum();
    if count == 0 {
        return None;
    }
    let mut all = DMatrix::zeros(count, columns + 1);
    let (mut row, mut log) = (0, 0.0);
    for (lines, rows) in parts {
        all.rows_mut(row, rows.len()).copy_from(&lines.columns.rows(rows.start, rows.len()));
        log += lines.frequency[rows.clone()].iter().map(|f| f.ln()).sum::<f64>();
        row += rows.len();
    }
    let residual = all.column(columns).norm_squared();
    let seen = (0..columns).any(|c| all.column(c).norm_squared() > EMPTY * energy[c]);
    let signals = seen.then(|| {
        let lines = all.columns(0, columns).into_owned();
        Products { squares: lines.tr_mul(&lines), residual: lines.tr_mul(&all.column(columns)), lines }
    });
    Some(Cell { channel, log_frequency: log / count as f64, count, signals, residual })
}
