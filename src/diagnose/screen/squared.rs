//! Products of columns with each other, A'A, without those that are there already.

use nalgebra::DMatrix;
use rayon::prelude::*;

/// Columns of which all products are made at once.
const FEW: usize = 64;

/// A'A.
pub(super) fn squared(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let size = columns.ncols();
    let below = |first: usize| {
        let (own, rest) = (columns.columns(first, FEW.min(size - first)), columns.columns(first, size - first));
        rest.transpose() * own
    };
    let firsts: Vec<usize> = (0..size).step_by(FEW).collect();
    let blocks: Vec<DMatrix<f64>> = firsts.par_iter().map(|first| below(*first)).collect();
    let mut products = DMatrix::zeros(size, size);
    for (first, block) in firsts.into_iter().zip(&blocks) {
        products.view_mut((first, first), block.shape()).copy_from(block);
    }
    products.fill_upper_triangle_with_lower_triangle();
    products
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_the_whole() {
        let columns = DMatrix::from_fn(37, 150, |i, j| ((i * 7 + j * j) % 23) as f64 - 11.0);
        assert_eq!(squared(&columns), columns.transpose() * &columns);
    }
}
