//! Cholesky factors of symmetric matrices, row-major.
//!
//! The factor is kept as the upper triangle U of U'U, so that all inner loops run along rows. Sums are taken in the order of a
//! textbook's dot products (backward substitution: from the last row up), several of them side by side. Large matrices are worked off
//! in blocks that stay in the cache, which changes no order and no bit.

use super::panels::{THREADED, Terms, WIDE, add};
use crate::lanes::widest;
use rayon::prelude::*;

/// Rows of a factor that are found together: what stands above is read once for all of them.
const BLOCK: usize = 16;
/// Columns of an inverse that are found together.
const STRIP: usize = 64;

/// The factor of a positive definite matrix.
#[derive(Debug, Clone, Default)]
pub struct Cholesky {
    size: usize,
    /// U, rows by columns; what is below the diagonal is not meant.
    upper: Vec<f64>,
    sums: Vec<f64>,
}

impl Cholesky {
    /// The factor of a matrix (n by n, its upper triangle); none when it is not positive definite.
    pub fn new(matrix: Vec<f64>, n: usize) -> Option<Self> {
        let mut factor = Self { size: n, upper: matrix, sums: Vec::new() };
        factor.decompose().then_some(factor)
    }

    /// The factor of another matrix in the memory of this one, which is of no use when the matrix is not positive
    /// definite: false then.
    pub fn renew(&mut self, matrix: &[f64], n: usize) -> bool {
        self.size = n;
        self.upper.clear();
        self.upper.extend_from_slice(matrix);
        self.decompose()
    }

    fn decompose(&mut self) -> bool {
        let Self { size: n, upper, sums } = self;
        let n = *n;
        sums.resize(BLOCK * n, 0.0);
        if n < WIDE {
            return factorise(upper, n, sums);
        }
        widest(
            #[inline(always)]
            || factorise(upper, n, sums),
        )
    }

    /// Replaces b by the solution of U'x = b.
    pub fn forward(&self, x: &mut [f64]) {
        let n = self.size;
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| self.upper[k * n + i] * x[k]).sum();
            x[i] = (x[i] - sum) / self.upper[i * n + i];
        }
    }

    /// Replaces b by the solution of U'U x = b.
    pub fn solve(&self, x: &mut [f64]) {
        let n = self.size;
        self.forward(x);
        for i in (0..n).rev() {
            let row = &self.upper[i * n..][..n];
            let sum: f64 = row[i + 1..].iter().zip(&x[i + 1..]).map(|(u, x)| u * x).sum();
            x[i] = (x[i] - sum) / row[i];
        }
    }

    /// Half the logarithm of the determinant of the matrix.
    pub fn log_root(&self) -> f64 {
        (0..self.size).map(|i| self.upper[i * self.size + i].ln()).sum()
    }

    /// Writes the inverse (n by n) to `inverse`: its lower triangle is found by columns, the upper one copied.
    pub fn invert(&mut self, inverse: &mut Vec<f64>) {
        let Self { size: n, upper, sums } = self;
        let n = *n;
        inverse.clear();
        inverse.resize(n * n, 0.0);
        sums.resize((BLOCK * n).max(n * n), 0.0);
        // strip by strip, each with its columns beside each other
        let strip = |(number, strip): (usize, &mut [f64])| {
            let first = number * STRIP;
            let width = STRIP.min(n - first);
            if n < WIDE {
                invert_columns(upper, n, first, width, strip);
            } else {
                widest(
                    #[inline(always)]
                    || invert_columns(upper, n, first, width, strip),
                );
            }
        };
        if n < THREADED {
            sums[..n * n].chunks_mut((STRIP * n).max(1)).enumerate().for_each(strip);
        } else {
            sums[..n * n].par_chunks_mut(STRIP * n).enumerate().for_each(strip);
        }
        for (number, strip) in sums[..n * n].chunks((STRIP * n).max(1)).enumerate() {
            let first = number * STRIP;
            let width = STRIP.min(n - first);
            for i in first..n {
                for j in first..(first + width).min(i + 1) {
                    let value = strip[i * width + j - first];
                    (inverse[i * n + j], inverse[j * n + i]) = (value, value);
                }
            }
        }
        if n >= THREADED {
            // as large as the inverse, and cheap beside it
            *sums = Vec::new();
        }
    }
}

/// Makes U of the upper triangle of a matrix; false when it is not positive definite.
#[inline(always)]
fn factorise(upper: &mut [f64], n: usize, sums: &mut [f64]) -> bool {
    for first in (0..n).step_by(BLOCK) {
        let last = (first + BLOCK).min(n);
        let (above, block) = upper.split_at_mut(first * n);
        sums.fill(0.0);
        let above = Terms {
            factor: |r: usize, k: usize| above[k * n + first + r],
            from: |k: usize| &above[k * n..(k + 1) * n],
            count: first,
        };
        above.add_to(&mut sums[..(last - first) * n], n, first);
        for j in first..last {
            let (done, rest) = block.split_at_mut((j - first) * n);
            let sums = &mut sums[(j - first) * n + j..(j - first + 1) * n];
            done.chunks_exact(n).for_each(|row| add(row[j], &row[j..], sums));
            let row = &mut rest[j..n];
            row.iter_mut().zip(&*sums).for_each(|(u, sum)| *u -= sum);
            let square = row[0];
            if square.is_nan() || square <= 0.0 {
                return false;
            }
            let pivot = square.sqrt();
            row[0] = pivot;
            row[1..].iter_mut().for_each(|u| *u /= pivot);
        }
    }
    true
}

/// Writes columns of the inverse of U'U from the row `first` on, where the first of them has its diagonal; `x` (n by width) holds zeros
/// above.
#[inline(always)]
fn invert_columns(upper: &[f64], n: usize, first: usize, width: usize, x: &mut [f64]) {
    let mut sums = [0.0; BLOCK * STRIP];
    x.fill(0.0);
    for top in (first..n).step_by(BLOCK) {
        let bottom = (top + BLOCK).min(n);
        let (done, rest) = x.split_at_mut(top * width);
        let sums = &mut sums[..(bottom - top) * width];
        sums.fill(0.0);
        let above = Terms {
            factor: |r: usize, k: usize| upper[(first + k) * n + top + r],
            from: |k: usize| &done[(first + k) * width..(first + k + 1) * width],
            count: top - first,
        };
        above.add_to(sums, width, 0);
        for i in top..bottom {
            let (near, row) = rest.split_at_mut((i - top) * width);
            let (row, sums) = (&mut row[..width], &mut sums[(i - top) * width..(i - top + 1) * width]);
            let near = near.chunks_exact(width).enumerate();
            near.for_each(|(k, other)| add(upper[(top + k) * n + i], other, sums));
            if i - first < width {
                row[i - first] = 1.0;
            }
            let pivot = upper[i * n + i];
            row.iter_mut().zip(&*sums).for_each(|(x, sum)| *x = (*x - sum) / pivot);
        }
    }
    for top in (first..n).step_by(BLOCK).rev() {
        let bottom = (top + BLOCK).min(n);
        let (before, done) = x.split_at_mut(bottom * width);
        let sums = &mut sums[..(bottom - top) * width];
        sums.fill(0.0);
        // from the last row up
        let below = Terms {
            factor: |r: usize, k: usize| upper[(top + r) * n + n - 1 - k],
            from: |k: usize| &done[(n - 1 - k - bottom) * width..(n - k - bottom) * width],
            count: n - bottom,
        };
        below.add_to(sums, width, 0);
        for i in (top..bottom).rev() {
            let (row, near) = before[i * width..].split_at_mut(width);
            let sums = &mut sums[(i - top) * width..(i - top + 1) * width];
            for (k, other) in near.chunks_exact(width).enumerate().rev() {
                add(upper[i * n + i + 1 + k], other, sums);
            }
            let pivot = upper[i * n + i];
            row.iter_mut().zip(&*sums).for_each(|(x, sum)| *x = (*x - sum) / pivot);
        }
    }
}

/// Largest sum of magnitudes of a row.
pub fn norm(matrix: &[f64], n: usize) -> f64 {
    matrix.chunks(n).map(|row| row.iter().map(|v| v.abs()).sum()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Factor and inverse as a textbook has them, sum by sum.
    fn textbook(matrix: &[f64], n: usize) -> (Vec<f64>, Vec<f64>) {
        let mut u = matrix.to_vec();
        for j in 0..n {
            for i in j..n {
                let sum = (0..j).fold(0.0, |sum, k| sum + u[k * n + j] * u[k * n + i]);
                u[j * n + i] -= sum;
            }
            u[j * n + j] = u[j * n + j].sqrt();
            for i in j + 1..n {
                u[j * n + i] /= u[j * n + j];
            }
        }
        let mut x = vec![0.0; n * n];
        for c in 0..n {
            for i in c..n {
                let sum = (c..i).fold(0.0, |sum, k| sum + u[k * n + i] * x[k * n + c]);
                x[i * n + c] = ((if i == c { 1.0 } else { 0.0 }) - sum) / u[i * n + i];
            }
            for i in (0..n).rev() {
                let sum = (i + 1..n).rev().fold(0.0, |sum, k| sum + u[i * n + k] * x[k * n + c]);
                x[i * n + c] = (x[i * n + c] - sum) / u[i * n + i];
            }
        }
        let lower = |k: usize| x[(k / n).max(k % n) * n + (k / n).min(k % n)];
        (u, (0..n * n).map(lower).collect())
    }

    #[test]
    fn blocks_change_no_bit() {
        for n in [1, 2, 5, 16, 17, 63, 64, 65, 130, 201, 300] {
            let entry =
                |i: usize, j: usize| (((i + j) * 7 + i * j) % 23) as f64 * 0.04 + if i == j { n as f64 } else { 0.0 };
            let matrix: Vec<f64> = (0..n * n).map(|k| entry(k / n, k % n)).collect();
            let (upper, wanted) = textbook(&matrix, n);
            let mut factor = Cholesky::new(matrix, n).expect("positive definite");
            let mut inverse = Vec::new();
            factor.invert(&mut inverse);
            for i in 0..n {
                let bits = |row: &[f64]| row.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                assert_eq!(
                    bits(&factor.upper[i * n + i..(i + 1) * n]),
                    bits(&upper[i * n + i..(i + 1) * n]),
                    "{n} {i}"
                );
                assert_eq!(bits(&inverse[i * n..(i + 1) * n]), bits(&wanted[i * n..(i + 1) * n]), "{n} {i}");
            }
        }
    }

    #[test]
    fn factors_solve_and_invert() {
        for n in 1..9 {
            let entry =
                |i: usize, j: usize| ((i * 7 + j * 7 + i * j) % 5) as f64 * 0.2 + if i == j { 4.0 } else { 0.0 };
            let matrix: Vec<f64> = (0..n * n).map(|k| entry(k / n, k % n)).collect();
            let mut factor = Cholesky::new(matrix.clone(), n).expect("positive definite");
            let mut inverse = vec![f64::NAN; 3];
            factor.invert(&mut inverse);
            for i in 0..n {
                let mut column: Vec<f64> = (0..n).map(|j| matrix[j * n + i]).collect();
                factor.solve(&mut column);
                for j in 0..n {
                    let unit = if i == j { 1.0 } else { 0.0 };
                    let product: f64 = (0..n).map(|k| inverse[i * n + k] * matrix[k * n + j]).sum();
                    assert!((column[j] - unit).abs() < 1e-14 && (product - unit).abs() < 1e-14, "{n} {i} {j}");
                }
            }
        }
        assert!(Cholesky::new(vec![1.0, 2.0, 2.0, 1.0], 2).is_none());
        assert!(Cholesky::new(vec![f64::NAN], 1).is_none());
    }
}
