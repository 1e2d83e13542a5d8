//! What the fit has absorbed: coordinates in which the noise found is white, the fitted signals first and everything else
//! beside them.

use super::bands::{Band, Bands};
use super::basis::{Basis, Products, gram};
use super::pursuit::Pursuit;
use super::score::ABSORBED;
use fdm_numeric::random::Stream;
use nalgebra::{DMatrix, DMatrixView, DVector, QR, SymmetricEigen};
use rayon::prelude::*;

/// Combinations of columns (of unit norm) with less than this of the largest energy are not determined.
const UNDETERMINED: f64 = 1e-12;
/// Combinations of directions with less than this share of the largest energy are left in the residual.
const WEAK: f64 = 2e-4;
/// Most combinations of directions that are taken out of the residual, and rounds in which these are found.
const MOST: usize = 40;
const POWERS: usize = 6;
/// What of a direction (of unit norm) may be missing in them, and most directions that are taken out besides.
const MISSING: f64 = 0.3;
const OTHERS: usize = 16;

/// Coordinates of all signals in the metric of a noise.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    /// Coordinates by shared columns (r by d): orthonormal in the metric, the first `absorbed` span what is fitted.
    pub(super) axes: DMatrix<f64>,
    /// Number of the first ones.
    pub(super) absorbed: usize,
    /// Directions beside what is fitted (d - absorbed by m).
    pub(super) directions: DMatrix<f64>,
    /// Energy of every direction with what is fitted still in it.
    pub(super) energy: Vec<f64>,
    /// What fitted columns make up for in each direction (p by m).
    pub(super) compensation: DMatrix<f64>,
    /// Standard errors of the fitted columns' multiples.
    pub(super) errors: Vec<f64>,
}

/// Rows of bands that are multiplied at once.
const ROWS: usize = 1024;

/// Sum over all bands of the products of shared columns, weighed by 1/S.
fn metric(bands: &Bands, density: &[f64], width: usize) -> DMatrix<f64> {
    let mut products = Products::new(width);
    let mut rows: Vec<f64> = Vec::new();
    for (k, (band, density)) in bands.list.iter().zip(density).enumerate() {
        let scale = density.sqrt().recip();
        rows.extend(band.root.iter().map(|value| scale * value));
        if rows.len() >= ROWS * width || k + 1 == bands.list.len() {
            products.add(DMatrixView::from_slice(&rows, width, rows.len() / width.max(1)));
            rows.clear();
        }
    }
    products.whole()
}

/// Columns that are worked on side by side.
const SIDE_BY_SIDE: usize = 64;

/// Does the same to all columns, some at a time.
fn on_columns(matrix: &mut DMatrix<f64>, work: impl Fn(&mut DMatrix<f64>) + Sync) {
    let rows = matrix.nrows();
    matrix.as_mut_slice().par_chunks_mut(SIDE_BY_SIDE * rows.max(1)).for_each(|some| {
        let mut own = DMatrix::from_column_slice(rows, some.len() / rows, some);
        work(&mut own);
        some.copy_from_slice(own.as_slice());
    });
}

impl Frame {
    /// With the noise's density in every band.
    pub(super) fn new(shared: &Basis, bands: &Bands, density: &[f64]) -> Self {
        let factor = root(metric(bands, density, shared.width()));
        // products of matrices go by blocks, those by a transposed one column by column
        let back = factor.transpose();
        let (fitted, mut directions) = (&back * &shared.fitted, shared.directions.clone());
        on_columns(&mut directions, |some| *some = &back * &*some);
        let combine = orthonormal(&gram(&fitted));
        let absorbed = combine.ncols();
        // all of Q: the first columns span what is fitted, the others the space beside it
        let turn = QR::new(fitted * &combine);
        let energy = directions.column_iter().map(|d| d.norm_squared()).collect();
        on_columns(&mut directions, |some| turn.q_tr_mul(some));
        let mut axes = DMatrix::identity(shared.width(), shared.width());
        on_columns(&mut axes, |some| turn.q_tr_mul(some));
        let mut axes = axes.transpose();
        on_columns(&mut axes, |some| _ = factor.tr_solve_lower_triangular_mut(some));
        let along = directions.rows(0, absorbed).into_owned();
        Self {
            axes,
            absorbed,
            energy,
            directions: directions.rows(absorbed, shared.width() - absorbed).into_owned(),
            compensation: &combine * along,
            errors: combine.row_iter().map(|row| row.norm()).collect(),
        }
    }

    /// Products of the axes with the residual.
    pub(super) fn residual(&self, bands: &Bands, density: &[f64]) -> DVector<f64> {
        let mut sum = DVector::zeros(self.axes.nrows());
        for (band, density) in bands.list.iter().zip(density) {
            sum.axpy(1.0 / density, &band.products, 1.0);
        }
        self.axes.tr_mul(&sum)
    }

    /// What all signals together explain, whether the residual follows them or not: combinations that are orthonormal, what is fitted first
    /// (d by k); of what is beside it no more than there is room for among so many `bins`.
    pub(super) fn saturated(&self, bins: usize) -> DMatrix<f64> {
        let strong = strongest(&self.directions);
        self.beside_fit(&strong.columns(0, strong.ncols().min(self.room(bins))).into_owned())
    }

    /// What a residual follows of the directions.
    pub(super) fn pursuit(&self, bins: usize) -> Pursuit {
        let usable = |k: &usize| self.directions.column(*k).norm_squared() > ABSORBED * self.energy[*k];
        let usable: Vec<usize> = (0..self.directions.ncols()).filter(usable).collect();
        Pursuit::new(self.directions.select_columns(&usable), self.room(bins).min(MOST + OTHERS))
    }

    /// What is fitted, and beside it these combinations (d - absorbed by k).
    pub(super) fn beside_fit(&self, own: &DMatrix<f64>) -> DMatrix<f64> {
        let mut basis = DMatrix::zeros(self.axes.ncols(), self.absorbed + own.ncols());
        basis.view_mut((0, 0), (self.absorbed, self.absorbed)).fill_with_identity();
        basis.view_mut((self.absorbed, self.absorbed), own.shape()).copy_from(own);
        basis
    }

    /// Of so many bins at most half of what the fit leaves, so that short records keep something to judge by.
    fn room(&self, bins: usize) -> usize {
        bins.saturating_sub(self.absorbed) / 2
    }
}

/// What most of the energy of these directions (of unit norm) lies in, orthonormal: the strongest combinations, in which an effect that
/// is really there will largely lie; beside them what is missing most, so that a direction like no other (a drift) is not left out for
/// the sake of many that are alike.
fn strongest(directions: &DMatrix<f64>) -> DMatrix<f64> {
    let mut unit = directions.clone();
    for mut column in unit.column_iter_mut() {
        column.try_normalize_mut(0.0);
    }
    let combinations = combinations(&unit);
    let mut basis: Vec<DVector<f64>> = combinations.column_iter().map(|column| column.into_owned()).collect();
    let back = unit.transpose();
    let seen = &back * &combinations;
    let mut left: Vec<f64> =
        (0..unit.ncols()).map(|k| unit.column(k).norm_squared() - seen.row(k).norm_squared()).collect();
    for _ in 0..OTHERS.min(unit.nrows() - basis.len()) {
        let largest = (0..left.len()).max_by(|a, b| left[*a].total_cmp(&left[*b]));
        let Some(pivot) = largest.filter(|k| left[*k] > MISSING) else { break };
        let mut own = unit.column(pivot).into_owned();
        // twice is enough (Kahan & Parlett)
        for _ in 0..2 {
            basis.iter().for_each(|known| own.axpy(-known.dot(&own), known, 1.0));
        }
        own.normalize_mut();
        let seen = &back * &own;
        left.iter_mut().zip(seen.iter()).for_each(|(left, seen)| *left -= seen * seen);
        left[pivot] = 0.0;
        basis.push(own);
    }
    if basis.is_empty() { DMatrix::zeros(unit.nrows(), 0) } else { DMatrix::from_columns(&basis) }
}

/// The combinations of most energy, orthonormal (iteration of a subspace: they need not be the very strongest).
fn combinations(unit: &DMatrix<f64>) -> DMatrix<f64> {
    let size = unit.nrows();
    if size == 0 || unit.ncols() == 0 {
        return DMatrix::zeros(size, 0);
    }
    let mut normal = Stream::seeded(0);
    let mut subspace = DMatrix::from_fn(size, size.min(MOST + MOST / 2), |_, _| normal.normal_of_pair());
    let back = unit.transpose();
    for _ in 0..POWERS {
        subspace = QR::new(unit * (&back * subspace)).q();
    }
    let seen = &back * &subspace;
    let eigen = SymmetricEigen::new(gram(&seen));
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let largest = order.first().map_or(0.0, |k| eigen.eigenvalues[*k]);
    order.truncate(MOST);
    order.retain(|k| eigen.eigenvalues[*k] > WEAK * largest && eigen.eigenvalues[*k] > 0.0);
    subspace * DMatrix::from_fn(eigen.eigenvalues.len(), order.len(), |i, k| eigen.eigenvectors[(i, order[k])])
}

/// L with L L' of a metric; what has no weight gets a little.
fn root(mut metric: DMatrix<f64>) -> DMatrix<f64> {
    let least = 1e-13 * metric.trace() / metric.nrows().max(1) as f64;
    let mut add = 0.0;
    loop {
        let mut held = metric.clone();
        (0..held.nrows()).for_each(|k| held[(k, k)] += add);
        if let Some(factor) = held.cholesky() {
            return factor.unpack();
        }
        add = if add > 0.0 { add * 100.0 } else { least };
        if !(add.is_finite() && add < 1e6 * metric.trace()) {
            metric = DMatrix::identity(metric.nrows(), metric.ncols());
            add = 0.0;
        }
    }
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

/// Leverage of orthonormal combinations (k by shared columns) in a band: how many of its bins they take out.
pub(super) fn leverage(band: &Band, density: f64, combinations: &DMatrix<f64>) -> f64 {
    (combinations * &band.root).norm_squared() / density
}

/// Sum of squares of the residual in a band without these multiples of the shared columns.
pub(super) fn remainder(band: &Band, multiples: &DVector<f64>) -> f64 {
    let taken = band.root.tr_mul(multiples).norm_squared();
    (band.residual - 2.0 * band.products.dot(multiples) + taken).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_like_no_other_is_taken_out() {
        // four hundred of two parts each, of which the weak ones are together stronger than the last one
        let mut directions = DMatrix::zeros(60, 401);
        for k in 0..400 {
            directions[(k % 20, k)] = 1.0;
            directions[(20 + (7 * k + k / 20) % 25, k)] = 0.3;
        }
        directions[(50, 400)] = 5.0;
        let basis = strongest(&directions);
        assert!((basis.transpose() * &basis - DMatrix::identity(basis.ncols(), basis.ncols())).amax() < 1e-9);
        assert!(basis.ncols() <= MOST + OTHERS && basis.row(50).norm() > 0.999);
        for column in directions.column_iter() {
            assert!((column - &basis * basis.tr_mul(&column)).norm() < 0.4 * column.norm());
        }
    }
}
