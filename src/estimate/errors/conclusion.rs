//! What the sensitivities at the final estimates tell: covariance, rank, noise.

use crate::estimate::iteration::correction::Correction;
use crate::estimate::iteration::priors::PriorRow;
use crate::estimate::iteration::quadratic::Inverse;
use crate::estimate::noise::Weights;

/// Condition up to which inverting products leaves eight digits for the standard errors.
pub(in crate::estimate) const ACCURATE: f64 = 1e4;

/// What the final sensitivities tell.
#[derive(Debug, Clone)]
pub(in crate::estimate) struct Conclusion {
    /// Column norms of all unknowns; 0 without influence.
    pub(in crate::estimate) scale: Vec<f64>,
    /// Whether each unknown is strictly within its bounds.
    pub(in crate::estimate) inside: Vec<bool>,
    /// Covariance in scaled unknowns, and what is not determined.
    pub(in crate::estimate) inverse: Inverse,
    /// Noise with degrees of freedom taken off; none when there are none left.
    pub(in crate::estimate) noise: Option<Weights>,
    /// For each output its compared cells, as many as they are worth, where its noise is estimated; none where it is known.
    pub(in crate::estimate) cells: Vec<Option<f64>>,
    /// Scale and inverse without the priors, when there are any: what the data do not determine by themselves.
    pub(in crate::estimate) without_priors: Option<(Vec<f64>, Inverse)>,
}

impl Correction<'_, '_, '_> {
    /// Information and noise at the final estimates; none when there is nothing to be told.
    pub(in crate::estimate) fn conclude(&mut self) -> Option<Conclusion> {
        let values = self.values.clone();
        if values.is_empty() {
            return None;
        }
        if !self.fresh {
            self.linearise(&values, Some(self.weights.clone())).ok()?;
            self.settle();
        }
        if self.inverse.condition > ACCURATE || !self.priors.is_empty() {
            self.refine();
        }
        self.gather();
        if !self.quadratic.is_finite() {
            return None;
        }
        let bounds = self.unknowns.lower.iter().zip(&self.unknowns.upper);
        let inside: Vec<bool> = values.iter().zip(bounds).map(|(v, (lo, hi))| lo < v && v < hi).collect();
        let chosen: Vec<usize> = (0..values.len()).filter(|j| inside[*j] && self.quadratic.scale[*j] > 0.0).collect();
        let moved = chosen.len();
        let mut inverse = self.quadratic.invert(chosen, Inverse::default())?;
        let known = self.known_before(&inverse);
        let noise = self.likelihood.corrected(&self.weights, (moved - inverse.null.len()) as f64 - known);
        if let Some(noise) = &noise {
            let factors = if self.likelihood.is_full() {
                vec![(self.weights.covariance[0] / noise.covariance[0]).sqrt()]
            } else {
                self.likelihood.factors(noise)
            };
            let priors = self.priors.rows(&values);
            self.quadratic.gather(self.unknowns, self.evaluator.sums(), &factors, priors);
            inverse = self.quadratic.invert(inverse.chosen.clone(), inverse)?;
        }
        let scale = self.quadratic.scale.clone();
        let without_priors = self.by_data_alone(&inside);
        let cells = self.likelihood.cells_of_outputs();
        Some(Conclusion { scale, inside, inverse, noise, cells, without_priors })
    }

    /// How many unknowns the priors determine rather than the data: the trace of prior information times covariance.
    fn known_before(&self, inverse: &Inverse) -> f64 {
        let n = inverse.chosen.len();
        let share = |row: PriorRow| {
            let k = inverse.chosen.iter().position(|j| *j == row.unknown)?;
            let scaled = row.weight / self.quadratic.scale[row.unknown];
            Some((scaled * scaled * inverse.values[k * n + k]).min(1.0))
        };
        self.priors.rows(&self.values).filter_map(share).sum()
    }

    /// Scale and inverse as they would be without priors; none when there are no priors.
    fn by_data_alone(&mut self, inside: &[bool]) -> Option<(Vec<f64>, Inverse)> {
        if self.priors.is_empty() {
            return None;
        }
        let factors = self.likelihood.factors(&self.weights);
        self.quadratic.gather(self.unknowns, self.evaluator.sums(), &factors, std::iter::empty());
        let moved = |j: &usize| inside[*j] && self.quadratic.scale[*j] > 0.0;
        let chosen: Vec<usize> = (0..inside.len()).filter(moved).collect();
        let inverse = self.quadratic.invert(chosen, Inverse::default())?;
        Some((self.quadratic.scale.clone(), inverse))
    }
}
