//! What Gauss-Newton leaves out of the second derivative of the cost, learnt from how the gradient changes.
//!
//! Where residuals are large and the response is curved, Gauss-Newton converges linearly, however near it is. The
//! missing part S of the Hessian is then updated from step to step (Dennis, Gay and Welsch 1981), and the steps
//! with it converge faster than linearly.

use crate::quadratic::Quadratic;
use serde::{Deserialize, Serialize};

/// The missing part of the Hessian and the point where it was learnt last; everything in the units of the parameters.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Secant {
    /// S, P by P; empty as long as Gauss-Newton is fast enough by itself.
    pub matrix: Vec<f64>,
    /// The last estimates and the gradient of the cost there; empty when there are none to compare with.
    values: Vec<f64>,
    gradient: Vec<f64>,
}

impl Secant {
    /// Whether steps take it into account.
    pub fn is_active(&self) -> bool {
        !self.matrix.is_empty()
    }

    /// Forgets what was learnt.
    pub fn clear(&mut self) {
        self.matrix.clear();
    }

    /// Compares the gradient at `values` with the last one; `learn` says whether S is to change (or to begin).
    pub fn visit(&mut self, values: &[f64], quadratic: &Quadratic, learn: bool) {
        let parts = quadratic.rhs.iter().zip(&quadratic.scale).map(|(r, s)| -r * s);
        if learn && self.values.len() == values.len() {
            let gradient: Vec<f64> = parts.clone().collect();
            let step: Vec<f64> = values.iter().zip(&self.values).map(|(a, b)| a - b).collect();
            let change: Vec<f64> = gradient.iter().zip(&self.gradient).map(|(a, b)| a - b).collect();
            self.matrix.resize(values.len() * values.len(), 0.0);
            self.update(&step, &change, &quadratic.times(&step));
        }
        self.gradient.clear();
        self.gradient.extend(parts);
        self.values.clear();
        self.values.extend_from_slice(values);
    }

    /// Makes S map `step` to what the `change` of the gradient has beyond `explained`, by the smallest symmetric
    /// update in a norm that suits the change (Dennis, Gay and Welsch 1981, equation 4.5); before that S shrinks to the size that was seen.
    fn update(&mut self, step: &[f64], change: &[f64], explained: &[f64]) {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let missing: Vec<f64> = change.iter().zip(explained).map(|(c, e)| c - e).collect();
        let along = dot(change, step);
        if along.is_nan() || along <= 0.0 {
            return self.clear();
        }
        let n = step.len();
        let known: Vec<f64> = self.matrix.chunks(n).map(|row| dot(row, step)).collect();
        let (size, seen) = (dot(step, &known).abs(), dot(step, &missing).abs());
        let shrink = if size > seen { seen / size } else { 1.0 };
        let rest: Vec<f64> = missing.iter().zip(&known).map(|(m, k)| m - shrink * k).collect();
        let twice = dot(&rest, step) / (along * along);
        for (i, row) in self.matrix.chunks_mut(n).enumerate() {
            for (j, s) in row.iter_mut().enumerate() {
                let sum = rest[i] * change[j] + change[i] * rest[j];
                *s = shrink * *s + sum / along - twice * change[i] * change[j];
            }
        }
        if self.matrix.iter().any(|v| !v.is_finite()) {
            self.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_update_is_symmetric_and_explains_the_last_change() {
        let mut secant = Secant { matrix: vec![0.3, 0.1, 0.1, -0.2], ..Secant::default() };
        let (step, change, explained) = ([0.4, -0.7], [1.1, -0.9], [0.8, -1.3]);
        secant.update(&step, &change, &explained);
        let s = &secant.matrix;
        assert!((s[1] - s[2]).abs() < 1e-15);
        for i in 0..2 {
            let mapped = s[2 * i] * step[0] + s[2 * i + 1] * step[1];
            assert!((mapped - (change[i] - explained[i])).abs() < 1e-14, "{i}");
        }
        secant.update(&step, &[-1.1, 0.9], &explained);
        assert!(!secant.is_active(), "a gradient that falls along the step is no minimum's");
    }
}
