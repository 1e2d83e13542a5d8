//! Sums of products in the processor's widest registers: rows' rows for tall blocks of rows, and products of planes, every
//! column of a block of frequencies with every other, held in registers tile by tile.
//!
//! Sums of planes have eight lanes whatever the width of the registers, and are added up at the end of a run in one order.

use fdm_numeric::lanes::{Simd, WithSimd, dispatch};
use fdm_system::simulate::Planes;
use rayon::prelude::*;

/// Adds to `sums` (order by width, the upper triangle and what whole vectors carry along) the products of `count` rows,
/// of which every one begins `stride` numbers behind the one before. Sums grow row by row, so that blocks may be cut anywhere.
pub(crate) fn accumulate(rows: &[f64], stride: usize, count: usize, width: usize, order: usize, sums: &mut [f64]) {
    if order < WIDE {
        return dispatch(Products { rows, stride, count, width, first: 0, last: order, sums });
    }
    // a band of the sums stays in the cache while the rows pass by, some at a time
    sums.par_chunks_mut(BAND * width).enumerate().for_each(|(band, sums)| {
        let (first, last) = (band * BAND, ((band + 1) * BAND).min(order));
        for at in (0..count).step_by(BAND).take_while(|_| first < last) {
            let (rows, count) = (&rows[at * stride..], BAND.min(count - at));
            dispatch(Products { rows, stride, count, width, first, last, sums });
        }
    });
}

/// Order from which sums are worked off in bands, and by threads.
pub(crate) const WIDE: usize = 256;
/// Rows of a band, and rows that pass by together.
const BAND: usize = 64;

struct Products<'a> {
    rows: &'a [f64],
    stride: usize,
    count: usize,
    width: usize,
    /// The rows of the sums that are meant.
    first: usize,
    last: usize,
    /// These rows, by width.
    sums: &'a mut [f64],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut i = self.first;
        while i < self.last {
            let rows = (self.last - i).min(if S::F64_LANES >= 8 { 8 } else { 4 });
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
            let row = S::as_simd_f64s(&self.sums[(i - self.first + r) * width..][..width]).0;
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
            let row = S::as_mut_simd_f64s(&mut self.sums[(i - self.first + r) * width..][..width]).0;
            row[vector..vector + C].copy_from_slice(total);
        }
    }
}

/// Lanes of a sum.
pub(crate) const LANES: usize = 8;
const HALF: usize = Planes::HALF;
const LENGTH: usize = Planes::LENGTH;

/// Sums of products of the planes of one output, of each plane with itself and those behind it.
#[derive(Debug, Clone, Default)]
pub(crate) struct PlaneSums {
    /// Number of planes, the residuals included.
    order: usize,
    /// Order by order by lanes; the upper triangle counts.
    lanes: Vec<f64>,
}

impl PlaneSums {
    /// Begins a run with planes of this number.
    pub(crate) fn begin(&mut self, order: usize) {
        self.order = order;
        self.lanes.resize(order * order * LANES, 0.0);
    }

    /// Adds the products of planes (order by [`Planes::LENGTH`]) of which the first `count` real and imaginary parts are
    /// there, a multiple of 8; the first block of a run begins the sums.
    pub(crate) fn add(&mut self, planes: &[f64], count: usize, first: bool) {
        let Self { order, lanes } = self;
        dispatch(PlaneProducts { planes, count, first, order: *order, sums: lanes });
    }

    /// The sum of products of two planes, i at most j.
    pub(crate) fn sum(&self, i: usize, j: usize) -> f64 {
        let at = (i * self.order + j) * LANES;
        let Some(l) = self.lanes[at..].first_chunk::<LANES>() else { return 0.0 };
        ((l[0] + l[4]) + (l[2] + l[6])) + ((l[1] + l[5]) + (l[3] + l[7]))
    }
}

struct PlaneProducts<'a> {
    planes: &'a [f64],
    count: usize,
    first: bool,
    order: usize,
    sums: &'a mut [f64],
}

impl WithSimd for PlaneProducts<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        // sixteen sums in registers where there are thirty-two of these, else eight
        let height = if S::F64_LANES >= 8 { 4 } else { 2 };
        let mut i = 0;
        while i < self.order {
            let rows = (self.order - i).min(height);
            let mut j = i;
            while j < self.order {
                let across = (self.order - j).min(4);
                self.rows(simd, (i, rows), (j, across));
                j += across;
            }
            i += rows;
        }
    }
}

impl PlaneProducts<'_> {
    #[inline(always)]
    fn rows<S: Simd>(&mut self, simd: S, (i, rows): (usize, usize), j: (usize, usize)) {
        match rows {
            1 => self.columns::<S, 1>(simd, i, j),
            2 => self.columns::<S, 2>(simd, i, j),
            3 => self.columns::<S, 3>(simd, i, j),
            _ => self.columns::<S, 4>(simd, i, j),
        }
    }

    #[inline(always)]
    fn columns<S: Simd, const R: usize>(&mut self, simd: S, i: usize, (j, across): (usize, usize)) {
        match across {
            1 => self.tile::<S, R, 1>(simd, i, j),
            2 => self.tile::<S, R, 2>(simd, i, j),
            3 => self.tile::<S, R, 3>(simd, i, j),
            _ => self.tile::<S, R, 4>(simd, i, j),
        }
    }

    /// R planes times C planes, one vector of the eight lanes after the other.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "iterators over tiles of fixed size are not unrolled into registers")]
    fn tile<S: Simd, const R: usize, const C: usize>(&mut self, simd: S, i: usize, j: usize) {
        let parts = LANES / S::F64_LANES;
        let (vectors, count) = (HALF / S::F64_LANES, self.count / S::F64_LANES);
        let planes = S::as_simd_f64s(self.planes).0;
        let sums = S::as_mut_simd_f64s(self.sums).0;
        let plane = |k: usize| &planes[k * (LENGTH / S::F64_LANES)..][..LENGTH / S::F64_LANES];
        let mut down = [plane(i); R];
        let mut right = [plane(j); C];
        for r in 0..R {
            down[r] = plane(i + r);
        }
        for c in 0..C {
            right[c] = plane(j + c);
        }
        for part in 0..parts {
            let mut total = [[simd.splat_f64s(0.0); C]; R];
            if !self.first {
                for r in 0..R {
                    for c in 0..C {
                        total[r][c] = sums[((i + r) * self.order + j + c) * parts + part];
                    }
                }
            }
            for half in 0..2 {
                let mut v = half * vectors + part;
                while v < half * vectors + count {
                    let mut b = [simd.splat_f64s(0.0); C];
                    for c in 0..C {
                        b[c] = right[c][v];
                    }
                    for r in 0..R {
                        let a = down[r][v];
                        for c in 0..C {
                            total[r][c] = simd.mul_add_f64s(a, b[c], total[r][c]);
                        }
                    }
                    v += parts;
                }
            }
            for r in 0..R {
                for c in 0..C {
                    sums[((i + r) * self.order + j + c) * parts + part] = total[r][c];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_every_pair_over_several_blocks() {
        for order in 1..=14 {
            let mut sums = PlaneSums::default();
            sums.begin(order);
            // what was there before does not count
            sums.lanes.fill(f64::NAN);
            let value =
                |block: usize, k: usize, at: usize| ((block * 7919 + k * 104_729 + at * 31) % 997) as f64 / 997.0 - 0.4;
            let counts = [64, 64, 24];
            for (block, count) in counts.into_iter().enumerate() {
                let mut planes = vec![f64::NAN; order * LENGTH];
                for (k, plane) in planes.chunks_exact_mut(LENGTH).enumerate() {
                    (0..count).for_each(|at| plane[at] = value(block, k, at));
                    (0..count).for_each(|at| plane[HALF + at] = value(block, k, HALF + at));
                }
                sums.add(&planes, count, block == 0);
            }
            for i in 0..order {
                for j in i..order {
                    let block = |(b, n): (usize, &usize)| -> f64 {
                        let product = |at: usize| value(b, i, at) * value(b, j, at);
                        (0..*n).map(|at| product(at) + product(HALF + at)).sum()
                    };
                    let wanted: f64 = counts.iter().enumerate().map(block).sum();
                    assert!((sums.sum(i, j) - wanted).abs() < 1e-12, "{order} {i} {j}");
                }
            }
        }
    }
}
