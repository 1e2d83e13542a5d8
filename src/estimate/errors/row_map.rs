//! A small matrix applied to long lists of rows, in the processor's widest registers.

use pulp::{Simd, WithSimd};

/// Adds to each row of `to` the row of `from` times a matrix (width by width, width a multiple of 8).
pub(super) fn add_mapped(from: &[f64], matrix: &[f64], width: usize, to: &mut [f64]) {
    pulp::Arch::new().dispatch(Mapping { from, matrix, width, to });
}

struct Mapping<'a> {
    from: &'a [f64],
    matrix: &'a [f64],
    width: usize,
    to: &'a mut [f64],
}

impl WithSimd for Mapping<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let across = self.width / S::F64_LANES;
        let mut vector = 0;
        while vector < across {
            let tile = (across - vector).min(4);
            match tile {
                1 => self.tile::<S, 1>(simd, vector),
                2 => self.tile::<S, 2>(simd, vector),
                3 => self.tile::<S, 3>(simd, vector),
                _ => self.tile::<S, 4>(simd, vector),
            }
            vector += tile;
        }
    }
}

impl Mapping<'_> {
    /// C vectors of all rows.
    #[inline(always)]
    fn tile<S: Simd, const C: usize>(&mut self, simd: S, vector: usize) {
        let across = self.width / S::F64_LANES;
        let (matrix, to) = (S::as_simd_f64s(self.matrix).0, S::as_mut_simd_f64s(self.to).0);
        for (from, to) in self.from.chunks_exact(self.width).zip(to.chunks_exact_mut(across)) {
            let Some(to) = to[vector..].first_chunk_mut::<C>() else { return };
            let mut sums = *to;
            for (factor, row) in from.iter().zip(matrix.chunks_exact(across)) {
                let Some(row) = row[vector..].first_chunk::<C>() else { return };
                let factor = simd.splat_f64s(*factor);
                for c in 0..C {
                    sums[c] = simd.mul_add_f64s(factor, row[c], sums[c]);
                }
            }
            *to = sums;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_multiplied_from_the_right_and_added() {
        for width in [8, 24, 40] {
            let numbers = |n: usize| (0..n).map(|k| (k as f64 * 0.7).sin()).collect::<Vec<_>>();
            let (from, matrix, mut to) = (numbers(5 * width), numbers(width * width), vec![1.0; 5 * width]);
            add_mapped(&from, &matrix, width, &mut to);
            for (k, to) in to.iter().enumerate() {
                let (i, j) = (k / width, k % width);
                let want = 1.0 + (0..width).map(|l| from[i * width + l] * matrix[l * width + j]).sum::<f64>();
                assert!((to - want).abs() < 1e-12);
            }
        }
    }
}
