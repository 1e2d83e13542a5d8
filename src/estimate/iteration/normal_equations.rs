//! The normal equations of a problem at given values: what one Gauss-Newton step is made of, for whoever iterates differently.

use super::evaluation::{Evaluator, Want};
use crate::problem::Problem;
use crate::problem::unknowns::Unknowns;

/// J'R^-1 J and J'R^-1 v of all runs, for known noise; the Jacobian itself is never stored.
pub struct NormalEquations<'e, 'a> {
    evaluator: Evaluator<'e, 'a>,
    /// 1 over the variance of each output.
    weights: Vec<f64>,
    information: Vec<f64>,
    gradient: Vec<f64>,
    squares: f64,
}

/// A run that has no finite response, or no finite sensitivities, at the given values.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("run {} is not finite at these values", run + 1)]
pub struct NotFinite {
    /// Index of the run.
    pub run: usize,
}

impl<'e, 'a> NormalEquations<'e, 'a> {
    /// Prepares; `deviations` are the standard deviations of the outputs' noise (q).
    pub fn new(problem: &'e mut Problem<'a>, deviations: &[f64]) -> Self {
        let unknowns = Unknowns::new(problem);
        let size = unknowns.len();
        Self {
            evaluator: Evaluator::owning(problem, unknowns),
            weights: deviations.iter().map(|s| 1.0 / (s * s)).collect(),
            information: vec![0.0; size * size],
            gradient: vec![0.0; size],
            squares: 0.0,
        }
    }

    /// Evaluates at `values`: shared free parameters in the model's order, then for every run its own (P).
    ///
    /// # Errors
    /// [`NotFinite`] for the first run that fails.
    pub fn evaluate(&mut self, values: &[f64]) -> Result<(), NotFinite> {
        self.evaluator.evaluate(values, Want::Sensitivities(None)).map_err(|f| NotFinite { run: f.run })?;
        self.information.fill(0.0);
        self.gradient.fill(0.0);
        self.squares = 0.0;
        let (unknowns, size) = (self.evaluator.unknowns(), self.gradient.len());
        for (run, sums) in self.evaluator.sums().enumerate() {
            for (group, weight) in sums.groups.iter().zip(&self.weights) {
                for (column, others, products, with_residual) in group.rows() {
                    let i = unknowns.position(run, column);
                    let information = &mut self.information[i * size..][..size];
                    for (other, product) in others.iter().zip(products) {
                        information[unknowns.position(run, *other as usize)] += weight * product;
                    }
                    self.gradient[i] += weight * with_residual;
                }
                self.squares += weight * group.square();
            }
        }
        for i in 0..size {
            for j in 0..i {
                self.information[i * size + j] = self.information[j * size + i];
            }
        }
        Ok(())
    }

    /// v'R^-1 v at `values`, by a simulation without sensitivities; those of the last evaluation stay.
    ///
    /// # Errors
    /// [`NotFinite`] for the first run that fails.
    pub fn squares_at(&mut self, values: &[f64]) -> Result<f64, NotFinite> {
        self.evaluator.evaluate(values, Want::Response).map_err(|f| NotFinite { run: f.run })?;
        let q = self.weights.len();
        Ok(self.weights.iter().enumerate().map(|(o, weight)| weight * self.evaluator.moments[o * q + o]).sum())
    }

    /// J'R^-1 J (P by P), of the last evaluation.
    pub fn information(&self) -> &[f64] {
        &self.information
    }

    /// J'R^-1 v with the residuals v = measured - response (P).
    pub fn gradient(&self) -> &[f64] {
        &self.gradient
    }

    /// v'R^-1 v.
    pub fn squares(&self) -> f64 {
        self.squares
    }
}
