//! The characteristic equation `M(s) x = 0`, `M(s) = s - A - sum of A_d exp(-s tau_d)`, of a linear model.

use super::structure::{Structure, Values};
use fdm_grammar::graph::Signal;
use nalgebra::DMatrix;
use num_complex::Complex64;

/// A delayed state in the equations of the states.
#[derive(Debug, Clone)]
pub(super) struct Late {
    /// Position among the delayed signals.
    pub(super) delayed: usize,
    /// The delay.
    pub(super) tau: f64,
    /// The state.
    pub(super) state: usize,
    /// (equation, coefficient).
    pub(super) column: Vec<(usize, f64)>,
}

/// A and A_d of a linear model at one vector of parameters.
#[derive(Debug, Clone)]
pub(super) struct Characteristic {
    pub(super) a: DMatrix<f64>,
    pub(super) late: Vec<Late>,
}

impl Characteristic {
    pub(super) fn new(structure: &Structure, values: &Values) -> Self {
        let n = structure.states;
        let mut a = DMatrix::zeros(n, n);
        let states = structure.delayed.iter().enumerate().filter_map(|(d, signal)| match signal {
            Signal::State(k) => Some(Late { delayed: d, tau: values.tau[d], state: *k as usize, column: Vec::new() }),
            Signal::Input(_) => None,
        });
        let mut late: Vec<Late> = states.collect();
        for (term, value) in structure.terms.iter().zip(&values.terms) {
            let (row, signal) = (term.row as usize, term.signal as usize);
            if row >= n {
                break;
            }
            let delayed = signal.checked_sub(n + structure.inputs);
            if signal < n {
                a[(row, signal)] = *value;
            } else if let Some(l) = late.iter_mut().find(|l| Some(l.delayed) == delayed) {
                l.column.push((row, *value));
            }
        }
        late.retain(|l| !l.column.is_empty());
        Self { a, late }
    }

    /// Whether there are infinitely many roots.
    pub(super) fn is_retarded(&self) -> bool {
        self.late.iter().any(|l| l.tau > 0.0)
    }

    /// M(s).
    pub(super) fn at(&self, s: Complex64) -> DMatrix<Complex64> {
        let n = self.a.nrows();
        let mut m = DMatrix::from_fn(n, n, |i, j| Complex64::from(-self.a[(i, j)]));
        (0..n).for_each(|i| m[(i, i)] += s);
        for l in &self.late {
            let factor = (-s * l.tau).exp();
            l.column.iter().for_each(|(row, value)| m[(*row, l.state)] -= factor * *value);
        }
        m
    }

    /// y* M(s) x.
    pub(super) fn form(&self, s: Complex64, x: &[Complex64], y: &[Complex64]) -> Complex64 {
        let n = x.len();
        let mut sum = Complex64::ZERO;
        for i in 0..n {
            let row: Complex64 = (0..n).map(|j| x[j] * self.a[(i, j)]).sum();
            sum += y[i].conj() * (s * x[i] - row);
        }
        for l in &self.late {
            let factor = (-s * l.tau).exp() * x[l.state];
            l.column.iter().for_each(|(row, value)| sum -= y[*row].conj() * factor * *value);
        }
        sum
    }

    /// y* M'(s) x.
    pub(super) fn slope(&self, s: Complex64, x: &[Complex64], y: &[Complex64]) -> Complex64 {
        let mut sum: Complex64 = x.iter().zip(y).map(|(x, y)| y.conj() * x).sum();
        for l in &self.late {
            let factor = (-s * l.tau).exp() * x[l.state] * l.tau;
            l.column.iter().for_each(|(row, value)| sum += y[*row].conj() * factor * *value);
        }
        sum
    }

    /// The derivatives of a simple root by all parameters (p): `s_theta = -(y* M_theta x)/(y* M' x)`.
    pub(super) fn root_slopes(
        &self,
        structure: &Structure,
        values: &Values,
        s: Complex64,
        x: &[Complex64],
        y: &[Complex64],
    ) -> Vec<Complex64> {
        let (n, scale) = (structure.states, self.slope(s, x, y));
        let mut slopes = vec![Complex64::ZERO; structure.params];
        for (slope, value) in structure.slopes.iter().zip(&values.slopes) {
            let term = structure.terms[slope.term as usize];
            let (row, signal) = (term.row as usize, term.signal as usize);
            if row >= n {
                break;
            }
            let delayed = signal.checked_sub(n + structure.inputs);
            let seen = match self.late.iter().find(|l| Some(l.delayed) == delayed) {
                Some(l) => x[l.state] * (-s * l.tau).exp(),
                None if signal < n => x[signal],
                None => continue,
            };
            slopes[slope.param as usize] += y[row].conj() * seen * *value / scale;
        }
        for (slope, value) in structure.tau_slopes.iter().zip(&values.tau_slopes) {
            for l in self.late.iter().filter(|l| l.delayed == slope.delayed as usize) {
                let factor = -s * (-s * l.tau).exp() * x[l.state] * *value / scale;
                let column = l.column.iter().map(|(row, a)| y[*row].conj() * factor * *a);
                slopes[slope.param as usize] += column.sum::<Complex64>();
            }
        }
        slopes
    }
}
