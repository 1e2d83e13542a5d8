//! (j w - A)^-1 at many frequencies for a full A: one reduction to a Hessenberg matrix for all of them, n^2 operations for each
//! (Laub 1981).

use super::wiring::{Source, Wiring};
use crate::linear::{ShiftedHessenberg, Values};
use nalgebra::DMatrix;
use nalgebra::linalg::{Hessenberg, balancing};
use num_complex::Complex64;

/// Coefficients beyond this are left to the elimination, whose rows and columns are scaled.
const LARGEST: f64 = 1e150;

/// `A = T H T^-1` with H a Hessenberg matrix: balanced, then turned.
#[derive(Debug, Clone, Default)]
pub(super) struct Reduction {
    n: usize,
    h: DMatrix<f64>,
    /// T and its inverse, row by row.
    to: Vec<f64>,
    from: Vec<f64>,
    /// Size of H, and rounding of j w - H.
    norm: f64,
    small: f64,
    shifted: ShiftedHessenberg,
    work: Vec<Complex64>,
}

impl Reduction {
    /// Reduces A; nothing where states are delayed in the equations, since A depends on the frequency then.
    pub(super) fn of(wiring: &Wiring, values: &Values) -> Option<Self> {
        let n = wiring.structure.states;
        let mut a = DMatrix::zeros(n, n);
        for (term, value) in wiring.structure.terms.iter().zip(&values.terms).filter(|(t, _)| (t.row as usize) < n) {
            match wiring.source(term) {
                Source::State(j) => a[(term.row as usize, j)] = *value,
                source if wiring.state(source).is_some() => return None,
                _ => {}
            }
        }
        if n < 2 || a.iter().any(|v| v.abs() > LARGEST) {
            return None;
        }
        let scale = balancing::balance_parlett_reinsch(&mut a);
        let (q, h) = Hessenberg::new(a).unpack();
        let entries = || (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let to = entries().map(|(i, j)| scale[i] * q[(i, j)]).collect();
        let from = entries().map(|(i, j)| q[(j, i)] / scale[j]).collect();
        let norm = h.norm();
        Some(Self {
            n,
            h,
            to,
            from,
            norm,
            small: 0.0,
            shifted: ShiftedHessenberg::default(),
            work: vec![Complex64::ZERO; n],
        })
    }

    /// Factors j w - A; false where it is so close to singular, for the size of H, that only scaled elimination can tell.
    pub(super) fn factor(&mut self, omega: f64) -> bool {
        let small = 1e3 * f64::EPSILON * (self.norm + omega);
        self.small = 10.0 * f64::EPSILON * (self.norm + omega);
        !self.shifted.factor(&self.h, Complex64::new(0.0, omega), small)
    }

    /// x of (j w - A) x = b, in place; false where it is so large that nothing of it is right.
    pub(super) fn solve(&mut self, x: &mut [Complex64]) -> bool {
        let Self { n, to, from, shifted, work, small, .. } = self;
        multiply(from, x, work, *n);
        let before = largest(work);
        work.iter_mut().for_each(|v| *v = -*v);
        shifted.solve(work);
        multiply(to, work, x, *n);
        largest(work) * *small <= before
    }

    /// w of w (j w - A) = c, in place, as [`Self::solve`].
    pub(super) fn solve_left(&mut self, w: &mut [Complex64]) -> bool {
        let Self { n, to, from, shifted, work, small, .. } = self;
        multiply_left(w, to, work, *n);
        let before = largest(work);
        work.iter_mut().for_each(|v| *v = -v.conj());
        shifted.solve_adjoint(work);
        work.iter_mut().for_each(|v| *v = v.conj());
        multiply_left(work, from, w, *n);
        largest(work) * *small <= before
    }
}

fn largest(x: &[Complex64]) -> f64 {
    x.iter().fold(0.0, |largest, v| largest.max(v.re.abs()).max(v.im.abs()))
}

fn multiply(matrix: &[f64], x: &[Complex64], y: &mut [Complex64], n: usize) {
    for (y, row) in y.iter_mut().zip(matrix.chunks_exact(n)) {
        *y = row.iter().zip(x).fold(Complex64::ZERO, |sum, (a, x)| sum + x * a);
    }
}

fn multiply_left(x: &[Complex64], matrix: &[f64], y: &mut [Complex64], n: usize) {
    y.fill(Complex64::ZERO);
    for (x, row) in x.iter().zip(matrix.chunks_exact(n)) {
        y.iter_mut().zip(row).for_each(|(y, a)| *y += x * a);
    }
}
