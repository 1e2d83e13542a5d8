//! Residuals of noise alone, many at once: drawn cell by cell, with the fit taken out, and their products with all that is
//! tried, in the metric of whatever noise each of them seems to have.

use super::calibration::Normal;
use super::cells::Cells;
use super::projection::Frame;
use super::score::Trial;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;

/// Cells in coordinates of a frame.
#[derive(Debug, Clone)]
pub(super) struct Drawing {
    /// R of all cells, one below the other (rows by d).
    factors: DMatrix<f64>,
    /// Each cell's rows, and its lines beside them.
    rows: Vec<(Range<usize>, usize)>,
    /// Products in each cell, a column for each: of eaten coordinates (upper triangle), of these with directions, and of pairs.
    products: DMatrix<f64>,
    /// Pairs of directions of which products are needed: each with itself, then members of one trial.
    pairs: Pairs,
    /// Directions beside what is eaten (d - eaten by m).
    directions: DMatrix<f64>,
    eaten: usize,
}

/// Where the products of two directions are.
#[derive(Debug, Clone)]
struct Pairs {
    list: Vec<(usize, usize)>,
    /// For each direction its partners with a higher number, and where they are.
    partners: Vec<Vec<(usize, usize)>>,
}

/// Residuals that were drawn.
pub(super) struct Drawn {
    /// Along the rows of the factors, a column for each residual.
    along: DMatrix<f64>,
    /// Sums of squares of everything else (cells by residuals).
    beside: DMatrix<f64>,
}

/// One residual beside the eaten coordinates, by one noise.
pub(super) struct Judged<'a> {
    /// Products with the directions.
    pub(super) z: Vec<f64>,
    /// L^-1 times the products of eaten coordinates with directions.
    eaten: DMatrix<f64>,
    /// Products of pairs.
    pairs: Vec<f64>,
    known: &'a Pairs,
}

impl Pairs {
    fn new(trials: &[Trial], directions: usize) -> Self {
        let mut list: Vec<(usize, usize)> = (0..directions).map(|k| (k, k)).collect();
        let mut partners = vec![Vec::new(); directions];
        for members in trials.iter().map(|t| &t.members) {
            for (n, a) in members.iter().enumerate() {
                for b in &members[..n] {
                    let (low, high) = (*a.min(b), *a.max(b));
                    partners[low].push((high, list.len()));
                    list.push((low, high));
                }
            }
        }
        Self { list, partners }
    }

    fn place(&self, i: usize, j: usize) -> Option<usize> {
        let (low, high) = (i.min(j), i.max(j));
        if i == j { Some(i) } else { self.partners[low].iter().find(|p| p.0 == high).map(|p| p.1) }
    }
}

impl Drawing {
    pub(super) fn new(cells: &Cells, frame: &Frame, trials: &[Trial]) -> Self {
        let (dimension, eaten, m) = (frame.axes.ncols(), frame.eaten, frame.directions.ncols());
        let pairs = Pairs::new(trials, m);
        let mut columns: Vec<usize> = trials.iter().flat_map(|t| t.members.iter().copied()).collect();
        columns.sort_unstable();
        columns.dedup();
        let of = |cell: &super::cells::Cell| {
            let factor = &cell.factor * &frame.axes;
            let own = factor.columns(0, eaten);
            let seen = factor.columns(eaten, dimension - eaten) * frame.directions.select_columns(&columns);
            let mut products = Vec::with_capacity(eaten * (eaten + 1) / 2 + eaten * m + pairs.list.len());
            let squares = own.transpose() * own;
            (0..eaten).for_each(|j| products.extend(squares.view((0, j), (j + 1, 1)).iter()));
            let cross = own.transpose() * &seen;
            let place = |k: usize| columns.binary_search(&k).ok();
            for k in 0..m {
                match place(k) {
                    Some(k) => products.extend(cross.column(k).iter()),
                    None => products.extend(std::iter::repeat_n(0.0, eaten)),
                }
            }
            let product = |(i, j): &(usize, usize)| match (place(*i), place(*j)) {
                (Some(i), Some(j)) => seen.column(i).dot(&seen.column(j)),
                _ => 0.0,
            };
            products.extend(pairs.list.iter().map(product));
            (factor, products)
        };
        let each: Vec<(DMatrix<f64>, Vec<f64>)> = cells.list.par_iter().map(of).collect();
        let size = each.first().map_or(0, |e| e.1.len());
        let mut products = DMatrix::zeros(size, each.len());
        let mut factors = DMatrix::zeros(each.iter().map(|e| e.0.nrows()).sum(), dimension);
        let (mut rows, mut first) = (Vec::with_capacity(each.len()), 0);
        for ((k, (factor, own)), cell) in each.iter().enumerate().zip(&cells.list) {
            products.column_mut(k).copy_from_slice(own);
            factors.rows_mut(first, factor.nrows()).copy_from(factor);
            rows.push((first..first + factor.nrows(), cell.count - factor.nrows()));
            first += factor.nrows();
        }
        Self { factors, rows, products, pairs, directions: frame.directions.clone(), eaten }
    }

    /// Energy of a direction in each cell, in units of its noise.
    pub(super) fn energies(&self, direction: usize, density: &[f64]) -> Vec<f64> {
        let place = self.products.nrows() - self.pairs.list.len() + direction;
        self.products.row(place).iter().zip(density).map(|(own, density)| own / density).collect()
    }

    /// Standard normal residuals times deviations (of each cell, for each residual).
    pub(super) fn drawn(&self, deviations: &[Vec<f64>], normals: &mut [Normal]) -> Drawn {
        let mut along = DMatrix::zeros(self.factors.nrows(), normals.len());
        let mut beside = DMatrix::zeros(self.rows.len(), normals.len());
        for (k, normal) in normals.iter_mut().enumerate() {
            let mut column = along.column_mut(k);
            for (cell, (rows, others)) in self.rows.iter().enumerate() {
                let deviation = deviations[k][cell];
                rows.clone().for_each(|row| column[row] = deviation * normal.next());
                beside[(cell, k)] = deviation * deviation * normal.square_sum(*others);
            }
        }
        Drawn { along, beside }
    }

    /// Products of the axes with residuals, weighed by 1/S (cells; of each residual).
    pub(super) fn products<'a>(&self, drawn: &Drawn, density: impl Fn(usize) -> &'a [f64]) -> DMatrix<f64> {
        let mut weighed = drawn.along.clone();
        for (k, mut column) in weighed.column_iter_mut().enumerate() {
            for ((rows, _), density) in self.rows.iter().zip(density(k)) {
                rows.clone().for_each(|row| column[row] /= density);
            }
        }
        self.factors.transpose() * weighed
    }

    /// Sums of squares of residuals in all cells without these multiples of the axes.
    pub(super) fn left_over(&self, drawn: &Drawn, multiples: &DMatrix<f64>) -> DMatrix<f64> {
        let along = &drawn.along - &self.factors * multiples;
        let of = |cell: usize, k: usize| {
            let rows = &self.rows[cell].0;
            along.view((rows.start, k), (rows.len(), 1)).norm_squared() + drawn.beside[(cell, k)]
        };
        DMatrix::from_fn(self.rows.len(), drawn.beside.ncols(), of)
    }

    /// Each residual by its own noise: from products of the axes with it, and weights 1/S (cells by residuals).
    pub(super) fn judged(&self, products: &DMatrix<f64>, weights: &DMatrix<f64>) -> Vec<Option<Judged<'_>>> {
        let (eaten, m) = (self.eaten, self.directions.ncols());
        let beside = self.directions.transpose() * products.rows(eaten, self.directions.nrows());
        let all = &self.products * weights;
        let one = |k: usize| {
            let own = all.column(k);
            let own = own.as_slice();
            let mut at = 0;
            let mut metric = DMatrix::zeros(eaten, eaten);
            for j in 0..eaten {
                for i in 0..=j {
                    metric[(j, i)] = own[at];
                    at += 1;
                }
            }
            let factor = metric.cholesky()?.unpack();
            let mut cross = DMatrix::from_column_slice(eaten, m, &own[at..at + eaten * m]);
            factor.solve_lower_triangular_mut(&mut cross);
            let mut taken: DVector<f64> = products.view((0, k), (eaten, 1)).column(0).into_owned();
            factor.solve_lower_triangular_mut(&mut taken);
            let z = (0..m).map(|d| beside[(d, k)] - cross.column(d).dot(&taken)).collect();
            Some(Judged { z, eaten: cross, pairs: own[at + eaten * m..].to_vec(), known: &self.pairs })
        };
        (0..weights.ncols()).map(one).collect()
    }
}

impl Judged<'_> {
    /// The product of two directions of one trial beside the eaten coordinates.
    pub(super) fn product(&self, i: usize, j: usize) -> f64 {
        let whole = self.known.place(i, j).map_or(0.0, |place| self.pairs[place]);
        whole - self.eaten.column(i).dot(&self.eaten.column(j))
    }
}
