//! sums += rows' rows for tall blocks of rows, in the processor's widest registers.

use pulp::{Simd, WithSimd};

/// Adds to `sums` (order by width, the upper triangle and what whole vectors carry along) the products of `count` rows,
/// of which every one begins `stride` numbers behind the one before. Sums grow row by row, so that blocks may be cut anywhere.
pub(in crate::estimate) fn accumulate(
    rows: &[f64],
    stride: usize,
    count: usize,
    width: usize,
    order: usize,
    sums: &mut [f64],
) {
    pulp::Arch::new().dispatch(Products { rows, stride, count, width, order, sums });
}

struct Products<'a> {
    rows: &'a [f64],
    stride: usize,
    count: usize,
    width: usize,
    order: usize,
    sums: &'a mut [f64],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut i = 0;
        while i < self.order {
            let rows = (self.order - i).min(if S::F64_LANES >= 8 { 8 } else { 4 });
            let mut vector = i / S::F64_LANES;
            while vector < self.width / S::F64_LANES {
                vector += self.tile(simd, (i, rows), vector);
            }
            i += rows;
        }
    }
}

impl Products<'_> {
    /// One tile of the sums, held in registers over all rows; gives how many vectors it was wide.
    #[inline(always)]
    fn tile<S: Simd>(&mut self, simd: S, (i, rows): (usize, usize), vector: usize) -> usize {
        let across = (self.width / S::F64_LANES - vector).min(3);
        match across {
            1 => self.rows::<S, 1>(simd, (i, rows), vector),
            2 => self.rows::<S, 2>(simd, (i, rows), vector),
            _ => self.rows::<S, 3>(simd, (i, rows), vector),
        }
        across
    }

    #[inline(always)]
    fn rows<S: Simd, const C: usize>(&mut self, simd: S, (i, rows): (usize, usize), vector: usize) {
        match rows {
            1 => self.sweep::<S, 1, C>(simd, i, vector),
            2 => self.sweep::<S, 2, C>(simd, i, vector),
            3 => self.sweep::<S, 3, C>(simd, i, vector),
            4 => self.sweep::<S, 4, C>(simd, i, vector),
            5 => self.sweep::<S, 5, C>(simd, i, vector),
            6 => self.sweep::<S, 6, C>(simd, i, vector),
            7 => self.sweep::<S, 7, C>(simd, i, vector),
            _ => self.sweep::<S, 8, C>(simd, i, vector),
        }
    }

    /// R rows and C vectors of the sums over all rows of the block.
    #[inline(always)]
    fn sweep<S: Simd, const R: usize, const C: usize>(&mut self, simd: S, i: usize, vector: usize) {
        let (width, lanes) = (self.width, S::F64_LANES);
        let mut total = [[simd.splat_f64s(0.0); C]; R];
        for (r, total) in total.iter_mut().enumerate() {
            let row = S::as_simd_f64s(&self.sums[(i + r) * width..][..width]).0;
            total.copy_from_slice(&row[vector..vector + C]);
        }
        for k in 0..self.count {
            let row = &self.rows[k * self.stride..][..width];
            let Some(factors) = row[i..].first_chunk::<R>() else { return };
            let Some(right) = S::as_simd_f64s(&row[vector * lanes..]).0.first_chunk::<C>() else { return };
            for r in 0..R {
                let factor = simd.splat_f64s(factors[r]);
                for c in 0..C {
                    total[r][c] = simd.mul_add_f64s(factor, right[c], total[r][c]);
                }
            }
        }
        for (r, total) in total.iter().enumerate() {
            let row = S::as_mut_simd_f64s(&mut self.sums[(i + r) * width..][..width]).0;
            row[vector..vector + C].copy_from_slice(total);
        }
    }
}
