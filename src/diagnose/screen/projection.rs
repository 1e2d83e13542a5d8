//! What the fit has eaten: coordinates in which the noise found is white, the fitted signals first and everything else
//! beside them.

use super::cells::{Cell, Cells, Drawn};
use super::shared::Shared;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Combinations of columns (of unit norm) with less than this of the largest energy are not determined.
const UNDETERMINED: f64 = 1e-12;
/// Combinations of directions with less than this share of the largest energy are left in the residual.
const WEAK: f64 = 2e-4;
/// Most combinations of directions that are taken out of the residual.
const MOST: usize = 40;

/// Coordinates of all signals in the metric of a noise.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    /// Coordinates by shared columns (r by d): orthonormal in the metric, the first `eaten` span what is fitted.
    pub(super) axes: DMatrix<f64>,
    /// Number of the first ones.
    pub(super) eaten: usize,
    /// Directions beside what is fitted (d - eaten by m).
    pub(super) directions: DMatrix<f64>,
    /// Energy of every direction with what is fitted still in it.
    pub(super) energy: Vec<f64>,
    /// What fitted columns make up for in each direction (p by m).
    pub(super) compensation: DMatrix<f64>,
    /// Standard errors of the fitted columns' multiples.
    pub(super) errors: Vec<f64>,
}

/// Sum over all cells of the products of shared columns, weighed by 1/S.
fn metric(cells: &Cells, density: &[f64], width: usize) -> DMatrix<f64> {
    let rows = cells.list.iter().map(|c| c.factor.nrows()).sum();
    let mut all = DMatrix::zeros(rows, width);
    let mut row = 0;
    for (cell, density) in cells.list.iter().zip(density) {
        let own = cell.factor.nrows();
        all.rows_mut(row, own).copy_from(&(&cell.factor / density.sqrt()));
        row += own;
    }
    all.transpose() * &all
}

impl Frame {
    /// With the noise's density in every cell.
    pub(super) fn new(shared: &Shared, cells: &Cells, density: &[f64]) -> Self {
        let eigen = SymmetricEigen::new(metric(cells, density, shared.width()));
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let own: Vec<usize> = (0..shared.width()).filter(|k| eigen.eigenvalues[*k] > 1e-14 * largest).collect();
        let root = |k: usize| eigen.eigenvalues[own[k]].sqrt();
        let vector = |i: usize, k: usize| eigen.eigenvectors[(i, own[k])];
        let white = DMatrix::from_fn(shared.width(), own.len(), |i, k| vector(i, k) / root(k));
        let back = DMatrix::from_fn(own.len(), shared.width(), |k, i| vector(i, k) * root(k));
        let (fitted, directions) = (&back * &shared.fitted, back * &shared.directions);
        let combine = orthonormal(&(fitted.transpose() * &fitted));
        let eaten = fitted * &combine;
        let rest = beside(&eaten);
        let along = eaten.transpose() * &directions;
        let mut axes = DMatrix::zeros(shared.width(), eaten.ncols() + rest.ncols());
        axes.columns_mut(0, eaten.ncols()).copy_from(&(&white * &eaten));
        axes.columns_mut(eaten.ncols(), rest.ncols()).copy_from(&(white * &rest));
        Self {
            axes,
            eaten: eaten.ncols(),
            energy: directions.column_iter().map(|d| d.norm_squared()).collect(),
            directions: rest.transpose() * directions,
            compensation: &combine * along,
            errors: combine.row_iter().map(|row| row.norm()).collect(),
        }
    }

    /// Products of the axes with the residual.
    pub(super) fn residual(&self, cells: &Cells, density: &[f64]) -> DVector<f64> {
        let mut sum = DVector::zeros(self.axes.nrows());
        for (cell, density) in cells.list.iter().zip(density) {
            sum.axpy(1.0 / density, &cell.products, 1.0);
        }
        self.axes.tr_mul(&sum)
    }

    /// The combinations of all signals that are taken out of the residual before its noise is judged: orthonormal, what is
    /// fitted first (d by k).
    pub(super) fn saturated(&self) -> DMatrix<f64> {
        let strong = strongest(&self.directions);
        let mut basis = DMatrix::zeros(self.axes.ncols(), self.eaten + strong.len());
        basis.view_mut((0, 0), (self.eaten, self.eaten)).fill_with_identity();
        for (k, column) in strong.iter().enumerate() {
            basis.view_mut((self.eaten, self.eaten + k), (column.len(), 1)).copy_from(column);
        }
        basis
    }
}

/// Directions of the most energy among these of unit norm, orthonormal.
fn strongest(directions: &DMatrix<f64>) -> Vec<DVector<f64>> {
    let mut unit = directions.clone();
    for mut column in unit.column_iter_mut() {
        let norm = column.norm();
        column *= if norm > 0.0 { 1.0 / norm } else { 0.0 };
    }
    let eigen = SymmetricEigen::new(&unit * unit.transpose());
    let mut order: Vec<usize> = (0..unit.nrows()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let largest = order.first().map_or(0.0, |k| eigen.eigenvalues[*k]);
    order.truncate(MOST);
    order.retain(|k| eigen.eigenvalues[*k] > WEAK * largest && eigen.eigenvalues[*k] > 0.0);
    order.iter().map(|k| eigen.eigenvectors.column(*k).into_owned()).collect()
}

/// Combinations of columns, orthonormal by these products; those that nothing determines are left out.
fn orthonormal(products: &DMatrix<f64>) -> DMatrix<f64> {
    let scale = products.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
    let size = products.nrows();
    let unit = DMatrix::from_fn(size, size, |i, j| products[(i, j)] * scale[i] * scale[j]);
    let eigen = SymmetricEigen::new(unit);
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let own: Vec<usize> = (0..size).filter(|k| eigen.eigenvalues[*k] > UNDETERMINED * largest).collect();
    let entry = |i: usize, k: usize| scale[i] * eigen.eigenvectors[(i, own[k])] / eigen.eigenvalues[own[k]].sqrt();
    DMatrix::from_fn(size, own.len(), entry)
}

/// Orthonormal columns that fill the space beside these.
fn beside(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let size = columns.nrows();
    let eigen = SymmetricEigen::new(columns * columns.transpose());
    let mut order: Vec<usize> = (0..size).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let rest = size.saturating_sub(columns.ncols());
    DMatrix::from_fn(size, rest, |i, k| eigen.eigenvectors[(i, order[k])])
}

/// Leverage of orthonormal combinations (of shared columns) in a cell: how many of its lines they take out.
pub(super) fn leverage(cell: &Cell, density: f64, basis: &DMatrix<f64>) -> f64 {
    (&cell.factor * basis).norm_squared() / density
}

/// Sum of squares of the residual in a cell without these multiples of the shared columns.
pub(super) fn left_over(cell: &Cell, multiples: &DVector<f64>) -> f64 {
    let taken = (&cell.factor * multiples).norm_squared();
    (cell.residual - 2.0 * cell.products.dot(multiples) + taken).max(0.0)
}

/// Cells in coordinates of a frame, for residuals that are drawn.
#[derive(Debug, Clone)]
pub(super) struct Drawing {
    /// R of each cell (rank by d).
    factors: Vec<DMatrix<f64>>,
    /// Upper triangles of R'R, a column for each cell.
    squares: DMatrix<f64>,
    dimension: usize,
    eaten: usize,
}

impl Drawing {
    pub(super) fn new(cells: &Cells, frame: &Frame) -> Self {
        let dimension = frame.axes.ncols();
        let factors: Vec<DMatrix<f64>> = cells.list.iter().map(|c| &c.factor * &frame.axes).collect();
        let mut squares = DMatrix::zeros(dimension * (dimension + 1) / 2, factors.len());
        for (factor, mut column) in factors.iter().zip(squares.column_iter_mut()) {
            let full = factor.transpose() * factor;
            let mut at = 0;
            for j in 0..dimension {
                column.rows_mut(at, j + 1).copy_from(&full.view((0, j), (j + 1, 1)));
                at += j + 1;
            }
        }
        Self { factors, squares, dimension, eaten: frame.eaten }
    }

    /// Products of the axes with a drawn residual, weighed by 1/S.
    pub(super) fn products(&self, drawn: &[Drawn], density: &[f64]) -> DVector<f64> {
        let mut sum = DVector::zeros(self.dimension);
        for ((factor, own), density) in self.factors.iter().zip(drawn).zip(density) {
            sum.gemv_tr(1.0 / density, factor, &own.along, 1.0);
        }
        sum
    }

    /// Sum of squares of a drawn residual in a cell without these multiples of the axes.
    pub(super) fn left_over(&self, cell: usize, drawn: &Drawn, multiples: &DVector<f64>) -> f64 {
        let mut along = drawn.along.clone();
        along.gemv(-1.0, &self.factors[cell], multiples, 1.0);
        along.norm_squared() + drawn.beside
    }

    /// Metrics by 1/S, a column for each column of weights (packed).
    pub(super) fn metrics(&self, weights: &DMatrix<f64>) -> DMatrix<f64> {
        &self.squares * weights
    }

    /// What is left beside the eaten coordinates in a packed metric: of the metric, and of products in it.
    pub(super) fn projected(&self, packed: &[f64], products: &DVector<f64>) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let (d, k) = (self.dimension, self.eaten);
        let mut full = DMatrix::zeros(d, d);
        let mut at = 0;
        for j in 0..d {
            for i in 0..=j {
                full[(i, j)] = packed[at];
                full[(j, i)] = packed[at];
                at += 1;
            }
        }
        let eaten = full.view((0, 0), (k, k)).into_owned().cholesky()?;
        let cross = full.view((0, k), (k, d - k)).into_owned();
        let solved = eaten.solve(&cross);
        let own = full.view((k, k), (d - k, d - k)) - cross.transpose() * &solved;
        let score = products.rows(k, d - k) - solved.tr_mul(&products.rows(0, k));
        Some((own, score))
    }
}
