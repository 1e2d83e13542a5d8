//! Sums over the samples of one run: products of the rows [J v], or their triangle.
//!
//! Rows are gathered in blocks, with the residual as one more lane, so that one sweep gives J'J, J'v and v'v. The
//! update runs over contiguous lanes in the processor's widest registers; lanes do not mix and every product is
//! fused with its sum, so that every width gives the same bits.

use super::triangle;
use pulp::{Simd, WithSimd};

/// Lanes of the longest vector that the loops are laid out for.
const LANES: usize = 8;
/// Rows of a block.
const ROWS: usize = 16;

/// The sums of one run, one group for every output (full noise: one group for all, of whitened rows), so that
/// weights can be applied afterwards.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    /// Columns of the Jacobian.
    pub(super) columns: usize,
    /// Row length: the columns and the residual, rounded up.
    pub(super) width: usize,
    /// Whether the groups are triangles instead of products.
    pub(super) precise: bool,
    /// Groups of (columns + 1) by width; only the upper triangle is meant.
    values: Vec<f64>,
    block: Vec<f64>,
    work: Vec<f64>,
    filled: usize,
}

impl Sums {
    pub(super) fn new(columns: usize, groups: usize) -> Self {
        let width = (columns + 1).next_multiple_of(LANES);
        let (values, block) = (vec![0.0; groups * (columns + 1) * width], vec![0.0; ROWS * width]);
        Self { columns, width, precise: false, values, block, work: Vec::new(), filled: 0 }
    }

    /// One group, (columns + 1) by width.
    pub(super) fn group(&self, group: usize) -> &[f64] {
        let size = (self.columns + 1) * self.width;
        &self.values[group * size..(group + 1) * size]
    }

    /// Sums up a run. `whitener` (q by q) mixes the outputs of a sample into one group.
    pub(super) fn sum(&mut self, at: &Linearised<'_>, whitener: Option<&[f64]>) {
        self.values.fill(0.0);
        let q = at.outputs;
        match whitener {
            None => {
                for output in 0..q {
                    for k in (output..at.y.len()).step_by(q).filter(|k| !at.measured[*k].is_nan()) {
                        self.add_row(output, |row, columns| at.copy(k, row, columns));
                    }
                    self.flush(output);
                }
            }
            Some(w) => {
                for sample in (0..at.y.len()).step_by(q).filter(|k| !at.measured[*k].is_nan()) {
                    for mix in w.chunks(q) {
                        self.add_row(0, |row, columns| {
                            row.fill(0.0);
                            mix.iter().enumerate().for_each(|(o, f)| at.add(sample + o, *f, row, columns));
                        });
                    }
                }
                self.flush(0);
            }
        }
    }

    fn add_row(&mut self, group: usize, fill: impl FnOnce(&mut [f64], usize)) {
        let row = &mut self.block[self.filled * self.width..(self.filled + 1) * self.width];
        fill(row, self.columns);
        self.filled += 1;
        if self.filled == ROWS {
            self.flush(group);
        }
    }

    /// Works off the rows gathered so far.
    fn flush(&mut self, group: usize) {
        let (size, order) = ((self.columns + 1) * self.width, self.columns + 1);
        let sums = &mut self.values[group * size..(group + 1) * size];
        if self.precise {
            triangle::reduce(sums, order, &mut self.block[..self.filled * self.width], self.width, &mut self.work);
        } else if self.filled > 0 {
            self.block[self.filled * self.width..].fill(0.0);
            pulp::Arch::new().dispatch(Products { block: &self.block, width: self.width, order, sums });
        }
        self.filled = 0;
    }
}

/// A run's response with its Jacobian at one point.
pub(super) struct Linearised<'a> {
    /// q.
    pub(super) outputs: usize,
    /// N by q.
    pub(super) measured: &'a [f64],
    /// N by q.
    pub(super) y: &'a [f64],
    /// N q by stride.
    pub(super) jacobian: &'a [f64],
    /// Row length of the Jacobian.
    pub(super) stride: usize,
}

impl Linearised<'_> {
    /// Writes the row [J v] of cell k.
    #[inline(always)]
    fn copy(&self, k: usize, row: &mut [f64], columns: usize) {
        let jacobian = &self.jacobian[k * self.stride..][..self.stride];
        // whole vectors, without a call; lanes behind the columns are zero
        for (r, j) in row.as_chunks_mut::<LANES>().0.iter_mut().zip(jacobian.as_chunks::<LANES>().0) {
            *r = *j;
        }
        row[columns..].fill(0.0);
        row[columns] = self.measured[k] - self.y[k];
    }

    /// Adds `factor` times the row [J v] of cell k.
    #[inline(always)]
    fn add(&self, k: usize, factor: f64, row: &mut [f64], columns: usize) {
        let jacobian = &self.jacobian[k * self.stride..k * self.stride + columns];
        for (r, j) in row.iter_mut().zip(jacobian) {
            *r += factor * j;
        }
        row[columns] += factor * (self.measured[k] - self.y[k]);
    }
}

/// sums += block' block, upper triangle in whole vectors. Unused rows of the block are zero.
struct Products<'a> {
    block: &'a [f64],
    width: usize,
    order: usize,
    sums: &'a mut [f64],
}

impl WithSimd for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { block, width, order, sums } = self;
        let (vectors, sums) = (S::as_simd_f64s(&block[..ROWS * width]).0, S::as_mut_simd_f64s(sums).0);
        let across = width / S::F64_LANES;
        let mut i = 0;
        while i < order {
            // two rows of sums share every vector that is loaded
            let rows = if i + 1 < order { 2 } else { 1 };
            for c in i / S::F64_LANES..across {
                let mut total = [sums[i * across + c], sums[(i + rows - 1) * across + c]];
                for k in 0..ROWS {
                    let lanes = vectors[k * across + c];
                    let factors = [block[k * width + i], block[k * width + i + 1 - (2 - rows)]];
                    total[0] = simd.mul_add_f64s(simd.splat_f64s(factors[0]), lanes, total[0]);
                    total[1] = simd.mul_add_f64s(simd.splat_f64s(factors[1]), lanes, total[1]);
                }
                sums[i * across + c] = total[0];
                sums[(i + rows - 1) * across + c] = total[rows - 1];
            }
            i += rows;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_and_triangle_agree_and_skip_empty_cells() {
        let (n, q, columns, stride) = (37, 2, 8, 8);
        let jacobian: Vec<f64> = (0..n * q * stride).map(|k| ((k * k % 97) as f64 / 97.0 - 0.5).sin()).collect();
        let y: Vec<f64> = (0..n * q).map(|k| (k as f64).cos()).collect();
        let mut measured: Vec<f64> = (0..n * q).map(|k| (k as f64).cos() + 0.1 * (k % 5) as f64).collect();
        measured[6] = f64::NAN;
        let at = Linearised { outputs: q, measured: &measured, y: &y, jacobian: &jacobian, stride };
        let mut sums = Sums::new(columns, q);
        sums.sum(&at, None);
        let products = sums.clone();
        sums.precise = true;
        sums.sum(&at, None);
        for o in 0..q {
            let cell = |k: usize, c: usize| if c < columns { jacobian[k * stride + c] } else { measured[k] - y[k] };
            for i in 0..=columns {
                for j in i..=columns {
                    let cells = (o..n * q).step_by(q).filter(|k| *k != 6);
                    let want: f64 = cells.map(|k| cell(k, i) * cell(k, j)).sum();
                    let product = products.group(o)[i * products.width + j];
                    let t = sums.group(o);
                    let triangle: f64 = (0..=i).map(|r| t[r * sums.width + i] * t[r * sums.width + j]).sum();
                    assert!((product - want).abs() < 1e-12 && (triangle - want).abs() < 1e-12, "{o} {i} {j}");
                }
            }
        }
    }
}
