//! Products of columns with each other, A'A, without those that are there already.

use nalgebra::{DMatrix, DMatrixView};

/// Columns of which all products are made at once.
const FEW: usize = 64;

/// A'A.
pub(super) fn squared(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let mut products = DMatrix::zeros(columns.ncols(), columns.ncols());
    fill(&mut products, columns.as_view(), 0);
    products.fill_upper_triangle_with_lower_triangle();
    products
}

/// The lower half for these columns, of which the first is number `first`.
fn fill(products: &mut DMatrix<f64>, columns: DMatrixView<'_, f64>, first: usize) {
    let count = columns.ncols();
    if count <= FEW {
        products.view_mut((first, first), (count, count)).copy_from(&(columns.transpose() * columns));
        return;
    }
    let half = count / 2;
    let (low, high) = (columns.columns(0, half), columns.columns(half, count - half));
    products.view_mut((first + half, first), (count - half, half)).copy_from(&(high.transpose() * low));
    fill(products, low, first);
    fill(products, high, first + half);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_the_whole() {
        let columns = DMatrix::from_fn(37, 150, |i, j| ((i * 7 + j * j) % 23) as f64 - 11.0);
        assert_eq!(squared(&columns), columns.transpose() * &columns);
    }
}
