//! What the fit has eaten: directions and residual with the fitted sensitivities projected out, in the metric of a noise.

use super::cells::{Cell, Cells, Drawn};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Combinations of fitted columns (of unit norm) with less than this of the largest energy are not determined.
const UNDETERMINED: f64 = 1e-12;
/// Combinations of directions with less than this share of the largest energy are left in the residual.
const WEAK: f64 = 2e-4;
/// Most combinations of directions that are taken out of the residual.
const MOST: usize = 40;

/// Directions and residual beside what was fitted, all weighed by one noise.
#[derive(Debug, Clone)]
pub(super) struct Projected {
    /// G: products of the projected directions (m by m).
    pub(super) gram: DMatrix<f64>,
    /// z: products of the projected directions with the residual (m).
    pub(super) score: DVector<f64>,
    /// What fitted columns make up for in each direction (p by m).
    pub(super) compensation: DMatrix<f64>,
    /// Combinations of fitted columns that are orthonormal in the metric of the noise (p by k).
    orthonormal: DMatrix<f64>,
    /// Products of the fitted columns with the residual (p).
    fitted: DVector<f64>,
}

/// Sums over all cells, weighed by 1/S: X'X and X'r.
pub(super) fn weighed(cells: &Cells, density: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
    let size = cells.fitted + cells.directions;
    let (mut squares, mut residual) = (DMatrix::zeros(size, size), DVector::zeros(size));
    for (cell, density) in cells.list.iter().zip(density) {
        if let Some(products) = &cell.signals {
            squares.zip_apply(&products.squares, |sum, value| *sum += value / density);
            residual.axpy(1.0 / density, &products.residual, 1.0);
        }
    }
    (squares, residual)
}

impl Projected {
    /// Projects with the noise's density in every cell.
    pub(super) fn new(cells: &Cells, density: &[f64]) -> Self {
        let (squares, residual) = weighed(cells, density);
        let (p, m) = (cells.fitted, cells.directions);
        let orthonormal = orthonormal(&squares.view((0, 0), (p, p)).into_owned());
        let cross = squares.view((0, p), (p, m));
        let compensation = &orthonormal * orthonormal.tr_mul(&cross);
        let fitted = residual.rows(0, p).into_owned();
        let gram = squares.view((p, p), (m, m)) - cross.tr_mul(&compensation);
        let score = residual.rows(p, m) - compensation.tr_mul(&fitted);
        Self { gram: (&gram + gram.transpose()) * 0.5, score, compensation, orthonormal, fitted }
    }

    /// The combinations of all columns that are taken out of the residual before its noise is judged: orthonormal,
    /// fitted columns first ((p+m) by k), and how much of each the residual holds (k).
    pub(super) fn saturated(&self) -> (DMatrix<f64>, DVector<f64>) {
        let (p, m) = self.compensation.shape();
        let own = self.orthonormal.ncols();
        let strong = strongest(&self.gram);
        let mut basis = DMatrix::zeros(p + m, own + strong.len());
        basis.view_mut((0, 0), (p, own)).copy_from(&self.orthonormal);
        for (k, column) in strong.iter().enumerate() {
            let at = own + k;
            basis.view_mut((p, at), (m, 1)).copy_from(column);
            basis.view_mut((0, at), (p, 1)).copy_from(&(-(&self.compensation * column)));
        }
        let mut held = DVector::zeros(basis.ncols());
        for (k, value) in held.iter_mut().enumerate() {
            // what is left of the residual beside the fitted columns has nothing of them
            *value = if k < own {
                basis.view((0, k), (p, 1)).dot(&self.fitted)
            } else {
                basis.view((p, k), (m, 1)).dot(&self.score)
            };
        }
        (basis, held)
    }
}

/// Combinations of directions, normalised in the metric of G, strongest first.
fn strongest(gram: &DMatrix<f64>) -> Vec<DVector<f64>> {
    let scale = gram.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
    let unit = DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let eigen = SymmetricEigen::new(unit);
    let mut order: Vec<usize> = (0..gram.nrows()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let largest = order.first().map_or(0.0, |k| eigen.eigenvalues[*k]);
    order.truncate(MOST);
    order.retain(|k| eigen.eigenvalues[*k] > WEAK * largest && eigen.eigenvalues[*k] > 0.0);
    let combination = |k: &usize| eigen.eigenvectors.column(*k).component_mul(&scale) / eigen.eigenvalues[*k].sqrt();
    order.iter().map(combination).collect()
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

/// Leverage of an orthonormal basis in a cell: the share of its noise that the basis takes out.
pub(super) fn leverage(cell: &Cell, density: f64, basis: &DMatrix<f64>) -> f64 {
    cell.signals.as_ref().map_or(0.0, |products| (&products.squares * basis).component_mul(basis).sum() / density)
}

/// Sum of squares of a residual in a cell (its own sum, and its products with the cell's signals) without these multiples
/// of the signals.
pub(super) fn left_over(cell: &Cell, squares: f64, products: Option<&DVector<f64>>, multiples: &DVector<f64>) -> f64 {
    let (Some(signals), Some(products)) = (&cell.signals, products) else { return squares };
    let taken = (&signals.squares * multiples).dot(multiples);
    (squares - 2.0 * products.dot(multiples) + taken).max(0.0)
}

/// Products of the projected directions with a drawn residual and with themselves, under a noise.
pub(super) fn beside(cells: &Cells, drawn: &[Drawn], density: &[f64]) -> (DVector<f64>, DVector<f64>) {
    let (p, m) = (cells.fitted, cells.directions);
    let mut fitted = DMatrix::zeros(p, p + m);
    let (mut own, mut residual) = (DVector::zeros(m), DVector::zeros(p + m));
    for ((cell, drawn), density) in cells.list.iter().zip(drawn).zip(density) {
        let (Some(signals), Some(products)) = (&cell.signals, &drawn.products) else { continue };
        fitted.zip_apply(&signals.squares.rows(0, p), |sum, value| *sum += value / density);
        residual.axpy(1.0 / density, products, 1.0);
        for k in 0..m {
            own[k] += signals.squares[(p + k, p + k)] / density;
        }
    }
    let orthonormal = orthonormal(&fitted.columns(0, p).into_owned());
    let cross = orthonormal.tr_mul(&fitted.columns(p, m));
    let eaten = orthonormal.tr_mul(&residual.rows(0, p));
    let score = residual.rows(p, m) - cross.tr_mul(&eaten);
    for (k, own) in own.iter_mut().enumerate() {
        *own -= cross.column(k).norm_squared();
    }
    (score, own)
}
