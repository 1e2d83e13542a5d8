//! What the sensitivities at the final estimates tell: covariance, rank, noise.

use super::correction::Correction;
use super::noise::Weights;
use super::quadratic::Inverse;

/// Condition up to which inverting products leaves eight digits for the standard errors.
const ACCURATE: f64 = 1e4;

/// What the final sensitivities tell.
#[derive(Debug, Clone)]
pub(super) struct Conclusion {
    /// Column norms of all unknowns; 0 without influence.
    pub(super) scale: Vec<f64>,
    /// Whether each unknown is strictly within its bounds.
    pub(super) inside: Vec<bool>,
    /// Covariance in scaled unknowns, and what is not determined.
    pub(super) inverse: Inverse,
    /// Noise with degrees of freedom taken off; none when there are none left.
    pub(super) noise: Option<Weights>,
}

impl Correction<'_, '_, '_> {
    /// Information and noise at the final estimates; none when there is nothing to be told.
    pub(super) fn conclude(&mut self) -> Option<Conclusion> {
        let values = self.values.clone();
        if values.is_empty() {
            return None;
        }
        if !self.fresh {
            self.linearise(&values, Some(self.weights.clone())).ok()?;
            self.settle(&values);
        }
        if self.inverse.condition > ACCURATE {
            self.refine(&values);
        }
        self.gather();
        if !self.quadratic.is_finite() {
            return None;
        }
        let bounds = self.unknowns.lower.iter().zip(&self.unknowns.upper);
        let inside: Vec<bool> = values.iter().zip(bounds).map(|(v, (lo, hi))| lo < v && v < hi).collect();
        let chosen: Vec<usize> = (0..values.len()).filter(|j| inside[*j] && self.quadratic.scale[*j] > 0.0).collect();
        let mut inverse = self.quadratic.invert(&chosen)?;
        let noise = self.likelihood.corrected(&self.weights, chosen.len() - inverse.null.len());
        if let Some(noise) = &noise {
            // full noise has been mixed in already; its correction is one factor
            let factor = noise.covariance[0] / self.weights.covariance[0];
            if self.likelihood.is_full() {
                inverse.values.iter_mut().for_each(|v| *v *= factor);
            } else {
                self.quadratic.gather(self.unknowns, self.evaluator.sums(), noise, false);
                inverse = self.quadratic.invert(&chosen)?;
            }
        }
        Some(Conclusion { scale: self.quadratic.scale.clone(), inside, inverse, noise })
    }
}
