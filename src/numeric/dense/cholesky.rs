//! Cholesky factors of symmetric matrices, row-major.
//!
//! The factor is kept as the upper triangle U of U'U, so that all inner loops run along rows. Sums are taken in the order of a
//! textbook's dot products, several of them side by side. Large matrices are worked off in blocks that stay in the cache, which changes no
//! order and no bit.

use crate::lanes::dispatch;

/// Rows of a factor that are found together: what stands above is read once for all of them.
const BLOCK: usize = 16;
/// Columns of an inverse that are found together.
const STRIP: usize = 64;
/// Order from which the widest registers are worth choosing.
const WIDE: usize = 64;

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

    /// The same in the memory of this one, which is of no use when the matrix is not positive definite: false then.
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
        if n < WIDE { factorise(upper, n, sums) } else { dispatch(|| factorise(upper, n, sums)) }
    }

    /// Replaces b by the solution of U'U x = b.
    pub fn solve(&self, x: &mut [f64]) {
        let n = self.size;
        for i in 0..n {
            let sum: f64 = (0..i).map(|k| self.upper[k * n + i] * x[k]).sum();
            x[i] = (x[i] - sum) / self.upper[i * n + i];
        }
        for i in (0..n).rev() {
            let row = &self.upper[i * n..][..n];
            let sum: f64 = row[i + 1..].iter().zip(&x[i + 1..]).map(|(u, x)| u * x).sum();
            x[i] = (x[i] - sum) / row[i];
        }
    }

    /// Writes the inverse (n by n) to `inverse`; all columns are solved for at once.
    pub fn invert(&mut self, inverse: &mut Vec<f64>) {
        let Self { size: n, upper, sums } = self;
        let n = *n;
        inverse.clear();
        inverse.resize(n * n, 0.0);
        sums.resize((BLOCK * n).max(n * n.min(STRIP)), 0.0);
        for first in (0..n).step_by(STRIP) {
            let columns = (first, (first + STRIP).min(n));
            if n < WIDE {
                invert_columns(upper, n, columns, inverse, sums);
            } else {
                dispatch(|| invert_columns(upper, n, columns, inverse, sums));
            }
        }
        for i in 0..n {
            for j in 0..i {
                let mean = 0.5 * (inverse[i * n + j] + inverse[j * n + i]);
                (inverse[i * n + j], inverse[j * n + i]) = (mean, mean);
            }
        }
    }
}

/// `to += factor from`.
#[inline(always)]
fn add(factor: f64, from: &[f64], to: &mut [f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
}

/// Makes U of the upper triangle of a matrix; false when it is not positive definite.
#[inline(always)]
fn factorise(upper: &mut [f64], n: usize, sums: &mut [f64]) -> bool {
    for first in (0..n).step_by(BLOCK) {
        let last = (first + BLOCK).min(n);
        let (above, block) = upper.split_at_mut(first * n);
        sums.fill(0.0);
        for row in above.chunks_exact(n) {
            for j in first..last {
                add(row[j], &row[j..], &mut sums[(j - first) * n + j..(j - first + 1) * n]);
            }
        }
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

/// Writes some columns of the inverse of U'U, which are zero before.
#[inline(always)]
fn invert_columns(upper: &[f64], n: usize, (first, last): (usize, usize), inverse: &mut [f64], sums: &mut [f64]) {
    let width = last - first;
    sums[..n * width].fill(0.0);
    for i in first..n {
        // columns from i + 1 on begin below
        let known = width.min(i + 1 - first);
        let (done, rest) = sums.split_at_mut((i + 1) * width);
        let row = &mut inverse[i * n + first..][..known];
        if known == i + 1 - first {
            row[known - 1] = 1.0;
        }
        let pivot = upper[i * n + i];
        row.iter_mut().zip(&done[i * width..]).for_each(|(x, sum)| *x = (*x - sum) / pivot);
        for (factor, sums) in upper[i * n + i + 1..(i + 1) * n].iter().zip(rest.chunks_exact_mut(width)) {
            add(*factor, row, &mut sums[..known]);
        }
    }
    let sums = &mut sums[..width];
    for i in (0..n).rev() {
        let (before, below) = inverse.split_at_mut((i + 1) * n);
        sums.fill(0.0);
        for (factor, other) in upper[i * n + i + 1..(i + 1) * n].iter().zip(below.chunks_exact(n)) {
            add(*factor, &other[first..last], sums);
        }
        let pivot = upper[i * n + i];
        before[i * n + first..i * n + last].iter_mut().zip(&*sums).for_each(|(x, sum)| *x = (*x - sum) / pivot);
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
                let sum = (i + 1..n).fold(0.0, |sum, k| sum + u[i * n + k] * x[k * n + c]);
                x[i * n + c] = (x[i * n + c] - sum) / u[i * n + i];
            }
        }
        let mean = |k: usize| match (k / n, k % n) {
            (i, j) if i == j => x[k],
            (i, j) => 0.5 * (x[i.max(j) * n + i.min(j)] + x[i.min(j) * n + i.max(j)]),
        };
        (u, (0..n * n).map(mean).collect())
    }

    #[test]
    fn blocks_change_no_bit() {
        for n in [1, 2, 5, 16, 17, 63, 64, 65, 130, 201] {
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
