//! Systems of a Hessenberg matrix shifted by a complex number: what inverse iteration solves again and again.

use nalgebra::DMatrix;
use num_complex::Complex64;

/// The factors of `H - s`, by elimination with exchanges of neighbouring rows.
#[derive(Debug, Clone, Default)]
pub struct ShiftedHessenberg {
    n: usize,
    /// Upper triangle, row by row.
    upper: Vec<Complex64>,
    /// What row k + 1 lost of row k.
    factors: Vec<Complex64>,
    /// Whether rows k and k + 1 were exchanged first.
    exchanged: Vec<bool>,
}

impl ShiftedHessenberg {
    /// Factors; a pivot that vanishes is replaced by `small`, as inverse iteration wants it.
    pub fn new(h: &DMatrix<f64>, s: Complex64, small: f64) -> Self {
        let mut factors = Self::default();
        factors.factor(h, s, small);
        factors
    }

    /// Factors anew, in the same memory; a pivot smaller than `small` is replaced by it. Whether there was one.
    pub fn factor(&mut self, h: &DMatrix<f64>, s: Complex64, small: f64) -> bool {
        let Self { n: size, upper, factors, exchanged } = self;
        let n = h.nrows();
        *size = n;
        upper.clear();
        for i in 0..n {
            upper.extend((0..n).map(|j| if i == j { h[(i, j)] - s } else { Complex64::from(h[(i, j)]) }));
        }
        factors.clear();
        factors.resize(n, Complex64::ZERO);
        exchanged.clear();
        exchanged.resize(n, false);
        let mut vanished = false;
        for k in 0..n {
            if k + 1 < n {
                let (above, below) = upper.split_at_mut((k + 1) * n);
                let (row, next) = (&mut above[k * n..], &mut below[..n]);
                if next[k].norm() > row[k].norm() {
                    row[k..].swap_with_slice(&mut next[k..]);
                    exchanged[k] = true;
                }
            }
            if upper[k * n + k].norm() < small {
                upper[k * n + k] = small.into();
                vanished = true;
            }
            if k + 1 < n {
                let (above, below) = upper.split_at_mut((k + 1) * n);
                let (row, next) = (&above[k * n..], &mut below[..n]);
                factors[k] = next[k] / row[k];
                if factors[k] != Complex64::ZERO {
                    (k..n).for_each(|j| next[j] -= factors[k] * row[j]);
                }
            }
        }
        vanished
    }

    /// Solves `(H - s) x = b` in place.
    pub fn solve(&self, b: &mut [Complex64]) {
        for k in 0..self.n.saturating_sub(1) {
            if self.exchanged[k] {
                b.swap(k, k + 1);
            }
            let lost = self.factors[k] * b[k];
            b[k + 1] -= lost;
        }
        for k in (0..self.n).rev() {
            let row = &self.upper[k * self.n..][..self.n];
            let sum: Complex64 = (k + 1..self.n).map(|j| row[j] * b[j]).sum();
            b[k] = (b[k] - sum) / row[k];
        }
    }

    /// Solves `(H - s)* y = b` in place, * the conjugate transpose.
    pub fn solve_adjoint(&self, b: &mut [Complex64]) {
        for k in 0..self.n {
            b[k] /= self.upper[k * self.n + k].conj();
            let value = b[k];
            let row = &self.upper[k * self.n..][..self.n];
            (k + 1..self.n).for_each(|j| b[j] -= row[j].conj() * value);
        }
        for k in (0..self.n.saturating_sub(1)).rev() {
            let lost = self.factors[k].conj() * b[k + 1];
            b[k] -= lost;
            if self.exchanged[k] {
                b.swap(k, k + 1);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_systems_are_solved() {
        let h = DMatrix::from_row_slice(
            4,
            4,
            &[
                0.1, 2.0, -1.0, 0.5, //
                3.0, 0.2, 0.7, 1.0, //
                0.0, 0.0, -1.0, 2.0, //
                0.0, 0.0, -4.0, 0.3,
            ],
        );
        let s = Complex64::new(0.3, 1.1);
        let factors = ShiftedHessenberg::new(&h, s, 1e-300);
        let b: Vec<Complex64> = (0..4).map(|k| Complex64::new(1.0 + k as f64, -0.5 * k as f64)).collect();
        let entry = |i: usize, j: usize| if i == j { h[(i, j)] - s } else { h[(i, j)].into() };
        let (mut x, mut y) = (b.clone(), b.clone());
        factors.solve(&mut x);
        factors.solve_adjoint(&mut y);
        for (i, b) in b.iter().enumerate() {
            let direct: Complex64 = (0..4).map(|j| entry(i, j) * x[j]).sum();
            let adjoint: Complex64 = (0..4).map(|j| entry(j, i).conj() * y[j]).sum();
            assert!((direct - b).norm() < 1e-13 && (adjoint - b).norm() < 1e-13, "{i}: {direct} {adjoint}");
        }
    }
}
