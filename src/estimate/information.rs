//! Sums over the samples of one run: products of the rows [J v], or their triangle.
//!
//! Rows are gathered in blocks, with the residual as one more lane, so that one sweep gives J'J, J'v and v'v. The
//! update runs over contiguous lanes and is compiled for the processor's vector width; lanes do not mix and products
//! are not fused, so that every width gives the same bits.

use super::triangle;

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
                        self.add_row(output, |row, columns| at.add(k, 1.0, row, columns));
                    }
                    self.flush(output);
                }
            }
            Some(w) => {
                for sample in (0..at.y.len()).step_by(q).filter(|k| !at.measured[*k].is_nan()) {
                    for mix in w.chunks(q) {
                        self.add_row(0, |row, columns| {
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

    /// Works off the rows gathered so far; the block is zero afterwards.
    fn flush(&mut self, group: usize) {
        let (size, order) = ((self.columns + 1) * self.width, self.columns + 1);
        let sums = &mut self.values[group * size..(group + 1) * size];
        if self.precise {
            triangle::reduce(sums, order, &mut self.block[..self.filled * self.width], self.width, &mut self.work);
        } else if self.filled > 0 {
            let (block, width) = (&self.block, self.width);
            pulp::Arch::new().dispatch(|| add_products(block, width, order, sums));
        }
        self.block.fill(0.0);
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

/// sums += block' block, upper triangle in whole lanes. Unused rows of the block are zero.
#[inline(always)]
fn add_products(block: &[f64], width: usize, order: usize, sums: &mut [f64]) {
    let block = &block[..ROWS * width];
    for (i, sums) in sums.chunks_exact_mut(width).take(order).enumerate() {
        let mut factors = [0.0; ROWS];
        for (f, row) in factors.iter_mut().zip(block.chunks_exact(width)) {
            *f = row[i];
        }
        let first = i / LANES * LANES;
        for c in (first..width).step_by(LANES) {
            let target = &mut sums[c..c + LANES];
            let mut total = [0.0; LANES];
            total.copy_from_slice(target);
            for (f, row) in factors.iter().zip(block.chunks_exact(width)) {
                let lanes = &row[c..c + LANES];
                for l in 0..LANES {
                    total[l] += f * lanes[l];
                }
            }
            target.copy_from_slice(&total);
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
