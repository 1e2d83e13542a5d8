//! Eigenvalues of a real matrix with right and left eigenvectors: balancing, Schur form, inverse iteration.
//!
//! Systems of a Hessenberg matrix shifted by a complex number: what inverse iteration solves again and again.

use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{DMatrix, DVector, Schur};
use num_complex::Complex64;

/// A root of a characteristic equation with its vectors: M(s) x = 0, y* M(s) = 0.
#[derive(Debug, Clone)]
pub struct Root {
    /// The root.
    pub s: Complex64,
    /// The right vector.
    pub x: Vec<Complex64>,
    /// The left vector.
    pub y: Vec<Complex64>,
    /// Whether it is apart from all others, so that it has derivatives.
    pub simple: bool,
}

/// The matrix balanced, and by what its rows were scaled; none where entries are too large.
fn balanced(a: &DMatrix<f64>) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let mut balanced = a.clone();
    // entries from here on have no squares, by which balancing would never end
    let held = a.iter().all(|v| v.abs() < 1e150);
    held.then(|| {
        let scale = balance_parlett_reinsch(&mut balanced);
        (balanced, scale)
    })
}

fn schur(mut a: DMatrix<f64>) -> Option<Schur<f64, nalgebra::Dyn>> {
    let scale = a.iter().fold(0.0_f64, |s, v| s.max(v.abs()));
    if !scale.is_finite() {
        return None;
    }
    // entries so small that their products underflow stop the iteration
    a.iter_mut().filter(|v| v.abs() < scale * 1e-150).for_each(|v| *v = 0.0);
    // steps of the QR algorithm for each row
    let steps = 200 * a.nrows().max(1);
    Schur::try_new(a, f64::EPSILON, steps)
}

/// All eigenvalues; none where entries are 1e150 or more, or not finite.
pub fn eigenvalues(a: &DMatrix<f64>) -> Option<Vec<Complex64>> {
    let (balanced, _) = balanced(a)?;
    Some(schur(balanced)?.complex_eigenvalues().iter().copied().collect())
}

/// All eigenvalues in the upper half plane, real ones included, with their vectors.
pub fn eigen(a: &DMatrix<f64>) -> Option<Vec<Root>> {
    let n = a.nrows();
    let (balanced, scale) = balanced(a)?;
    let schur = schur(balanced.clone())?;
    let values: Vec<Complex64> = schur.complex_eigenvalues().iter().copied().collect();
    let (q, mut t) = schur.unpack();
    // what the QR algorithm took for zero
    (2..n).for_each(|i| (0..i - 1).for_each(|j| t[(i, j)] = 0.0));
    let size = t.iter().fold(f64::MIN_POSITIVE, |s, v| s.max(v.abs()));
    let mut roots = Vec::new();
    for (k, s) in values.iter().enumerate().filter(|(_, s)| s.im >= 0.0) {
        let nearest = values.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, v)| (v - s).norm());
        let apart = nearest.fold(f64::INFINITY, f64::min);
        let factors = ShiftedHessenberg::new(&t, *s, size * f64::EPSILON);
        let start: Vec<Complex64> = (0..n).map(|k| Complex64::from(1.0 + 0.37 * ((k * 7) % 11) as f64)).collect();
        let (mut x, mut y) = (start.clone(), start);
        for _ in 0..3 {
            factors.solve(&mut x);
            unit(&mut x);
            factors.solve_adjoint(&mut y);
            unit(&mut y);
        }
        let back =
            |v: &[Complex64]| -> Vec<Complex64> { (0..n).map(|i| (0..n).map(|j| v[j] * q[(i, j)]).sum()).collect() };
        let (x, y) = (back(&x), back(&y));
        let overlap: Complex64 = x.iter().zip(&y).map(|(x, y)| y.conj() * x).sum();
        let simple = overlap.norm() > 1e-8 && apart > 1e-9 * size;
        let s = if simple { quotient(&balanced, &x, &y, overlap, *s, apart) } else { *s };
        let x = x.iter().enumerate().map(|(i, v)| v * scale[i]).collect();
        let y = y.iter().enumerate().map(|(i, v)| v / scale[i]).collect();
        roots.push(Root { s, x, y, simple });
    }
    Some(roots)
}

/// The eigenvalue that two vectors stand for, y*Ax/y*x: a digit or two better than the Schur form's.
fn quotient(
    a: &DMatrix<f64>,
    x: &[Complex64],
    y: &[Complex64],
    overlap: Complex64,
    s: Complex64,
    apart: f64,
) -> Complex64 {
    let n = x.len();
    let row = |i: usize| (0..n).map(move |j| x[j] * a[(i, j)] - if i == j { x[j] * s } else { Complex64::ZERO });
    let off: Complex64 = (0..n).map(|i| y[i].conj() * row(i).sum::<Complex64>()).sum::<Complex64>() / overlap;
    let better = s + if s.im == 0.0 { off.re.into() } else { off };
    if off.norm() < 1e-3 * apart.min(1.0 + s.norm()) { better } else { s }
}

fn unit(v: &mut [Complex64]) {
    // by the largest first: squares of what inverse iteration makes of a singular system may overflow
    let largest = v.iter().fold(0.0_f64, |a, v| a.max(v.re.abs()).max(v.im.abs()));
    if largest > 0.0 && largest.is_finite() {
        v.iter_mut().for_each(|v| *v /= largest);
        let length = v.iter().map(Complex64::norm_sqr).sum::<f64>().sqrt();
        v.iter_mut().for_each(|v| *v /= length);
    }
}

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
    fn entries_without_squares_are_refused_and_end() {
        for large in [1e150, 1e160, f64::MAX, f64::INFINITY, f64::NAN] {
            let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -large, -1.0]);
            assert!(eigenvalues(&a).is_none() && eigen(&a).is_none(), "{large}");
        }
        let a = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1e140, -1.0]);
        assert!(eigenvalues(&a).is_some_and(|all| all.iter().all(|s| (s.norm() / 1e70 - 1.0).abs() < 1e-9)));
    }
}

#[cfg(test)]
mod hessenberg_tests {
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
