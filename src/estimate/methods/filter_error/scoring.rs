//! The innovations' cost for Gauss-Newton: its curvature is the expected information (scoring; Maine and Iliff 1985), and what
//! that misses is learnt from the gradients along the way.
//!
//! Curvature that the expected information does not have, learned from the gradients along the way.

use super::likelihood::{Coordinates, Likelihood, Lost};
use crate::iteration::priors::Priors;
use crate::work::Termination;
use crate::work::Work;
use fdm_numeric::least_squares::{GaussNewton, Iteration, Options, Problem, Space};
use fdm_numeric::quadratic::Quadratic;
use std::collections::VecDeque;

/// Predicted gain of a full step, in units of the logarithm of the likelihood, below which none is made: the estimates are then
/// within a thousandth of their standard errors of the minimum.
const WORTH: f64 = 5e-7;
/// Damping of the first step.
const FIRST: f64 = 1e-2;
/// Keeps the information definite where the record does not determine everything; columns have unit norm.
const RIDGE: f64 = 1e-13;

/// Where the search ended.
pub(super) struct Found {
    pub(super) values: Vec<f64>,
    pub(super) cost: f64,
    pub(super) history: Vec<Iteration>,
    pub(super) termination: Termination,
}

/// From these values to the minimum.
///
/// # Errors
/// The run that cannot be filtered at the start.
pub(super) fn minimise(
    likelihood: &mut Likelihood<'_>,
    coordinates: &Coordinates,
    priors: &Priors,
    (start, iterations): (&[f64], usize),
    work: &Work<'_>,
) -> Result<Found, Lost> {
    let (start, reach) = (coordinates.inwards(start), coordinates.reach());
    let (lower, upper) = (&coordinates.lower[..], &coordinates.upper[..]);
    let space = Space { start: &start, lower, upper, affine: &[], reach: &reach };
    let options = Options { iterations, least_gain: WORTH, damping: FIRST, restarts: false, ..Options::default() };
    let problem = InnovationsCost { likelihood, coordinates, priors, memory: GradientMemory::default() };
    let mut steps = GaussNewton::new(problem, space, options);
    let end = steps.run(None, |_, _| Ok(false), &mut work.monitor(|point| coordinates.outwards(point)))?;
    work.estimation_ended(steps.history.len().saturating_sub(1));
    Ok(Found {
        values: coordinates.outwards(&steps.values),
        cost: steps.cost(),
        history: steps.history,
        termination: work.termination(end),
    })
}

/// Minus the logarithm of the likelihood of the innovations, priors included, in the coordinates of the search.
struct InnovationsCost<'s, 'a> {
    likelihood: &'s mut Likelihood<'a>,
    coordinates: &'s Coordinates,
    priors: &'s Priors,
    memory: GradientMemory,
}

impl InnovationsCost<'_, '_> {
    fn at(&mut self, point: &[f64], wanted: bool) -> Result<f64, Lost> {
        let values = self.coordinates.outwards(point);
        Ok(self.likelihood.evaluate(&values, wanted)? + self.priors.cost(&values))
    }
}

impl Problem for InnovationsCost<'_, '_> {
    type Failure = Lost;
    type Weights = f64;

    fn cost(&self, cost: &f64) -> f64 {
        *cost
    }

    fn rounding(&self, cost: &f64) -> f64 {
        1e-12 * cost.abs().max(1.0)
    }

    fn evaluate(&mut self, point: &[f64]) -> Result<f64, Lost> {
        self.at(point, false)
    }

    fn linearise(&mut self, point: &[f64], _: Option<f64>) -> Result<f64, Lost> {
        self.at(point, true)
    }

    fn gather(&mut self, point: &[f64], _: &f64, quadratic: &mut Quadratic) {
        let (values, size) = (self.coordinates.outwards(point), point.len());
        let mut descent: Vec<f64> = self.likelihood.score.gradient.iter().map(|g| -g).collect();
        let mut information = self.likelihood.score.information.clone();
        for row in self.priors.rows(&values) {
            for (i, a) in row.entries() {
                descent[*i] += a * row.residual;
                row.entries().iter().for_each(|(j, b)| information[i * size + j] += a * b);
            }
        }
        let slope: Vec<f64> = (0..size).map(|j| self.coordinates.slope(j, values[j])).collect();
        for i in 0..size {
            descent[i] *= slope[i];
            for j in 0..size {
                information[i * size + j] *= slope[i] * slope[j];
            }
        }
        let gradient: Vec<f64> = descent.iter().map(|d| -d).collect();
        self.memory.visit(point, &gradient, &information);
        self.memory.curve(&mut information);
        for i in 0..size {
            information[i * size + i] *= 1.0 + RIDGE;
        }
        quadratic.set(&information, &descent);
    }
}

/// Standard errors of a step beyond which the cost is no quadratic, and what was met before belongs elsewhere.
const NEAR: f64 = 1.0;
/// Curvature along a step below this part of what its lengths promise is rounding, or none that a minimum has.
const LEAST: f64 = 1e-8;

/// The latest steps and by how much the gradient changed along each. Where the observed information differs from the expected
/// one by more than a half of it, scoring swings about the minimum and creeps to it; with the updates of Broyden, Fletcher,
/// Goldfarb and Shanno (Nocedal and Wright, chapter 6), begun anew at every point with the information there, it converges
/// faster than linearly.
#[derive(Debug, Default)]
pub(super) struct GradientMemory {
    last: Option<(Vec<f64>, Vec<f64>)>,
    steps: VecDeque<Step>,
}

/// A step and what the gradient changed along it.
#[derive(Debug)]
struct Step {
    moved: Vec<f64>,
    change: Vec<f64>,
}

impl GradientMemory {
    /// Remembers the step to this point; `information` (P by P) tells how many standard errors long it is.
    pub(super) fn visit(&mut self, point: &[f64], gradient: &[f64], information: &[f64]) {
        let size = point.len();
        if let Some((before, slope)) = &self.last {
            let moved: Vec<f64> = point.iter().zip(before).map(|(a, b)| a - b).collect();
            let change: Vec<f64> = gradient.iter().zip(slope).map(|(a, b)| a - b).collect();
            let errors = moved.iter().enumerate().map(|(j, d)| d.abs() * information[j * size + j].sqrt());
            let along = dot(&moved, &change);
            let lengths = (dot(&moved, &moved) * dot(&change, &change)).sqrt();
            if errors.fold(0.0, f64::max) > NEAR {
                self.steps.clear();
            } else if along > LEAST * lengths && along.is_finite() {
                // steps that are remembered
                if self.steps.len() == 12 {
                    self.steps.pop_front();
                }
                self.steps.push_back(Step { moved, change });
            }
        }
        self.last = Some((point.to_vec(), gradient.to_vec()));
    }

    /// Gives the information (P by P) the curvature that was met.
    pub(super) fn curve(&self, information: &mut [f64]) {
        for Step { moved, change } in &self.steps {
            let size = moved.len();
            let own: Vec<f64> = (0..size).map(|i| dot(&information[i * size..][..size], moved)).collect();
            let (held, met) = (dot(&own, moved), dot(change, moved));
            if !(held > 0.0 && met > 0.0) {
                continue;
            }
            for i in 0..size {
                for j in 0..size {
                    information[i * size + j] += change[i] * change[j] / met - own[i] * own[j] / held;
                }
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod gradient_memory_tests {
    use super::*;

    /// So little information that no step is long.
    const SHORT: [f64; 4] = [1e-2, 0.0, 0.0, 1e-2];

    #[test]
    fn steps_of_a_quadratic_give_its_curvature() {
        let curvature = [4.0, 1.0, 1.0, 3.0];
        let gradient = |p: [f64; 2]| [4.0 * p[0] + p[1], p[0] + 3.0 * p[1]];
        let mut memory = GradientMemory::default();
        // conjugate steps: each is met exactly by the last matrix
        for point in [[1.0, 1.0], [0.0, 1.0], [0.25, 0.0]] {
            memory.visit(&point, &gradient(point), &SHORT);
        }
        let mut information = vec![1.0, 0.0, 0.0, 1.0];
        memory.curve(&mut information);
        for (found, truth) in information.iter().zip(curvature) {
            assert!((found - truth).abs() < 1e-12, "{information:?}");
        }
    }

    #[test]
    fn downward_bends_and_long_steps_are_not_believed() {
        let mut memory = GradientMemory::default();
        memory.visit(&[0.0], &[1.0], &[0.2]);
        memory.visit(&[1.0], &[0.5], &[0.2]);
        let mut information = vec![2.0];
        memory.curve(&mut information);
        assert_eq!(information, [2.0], "the gradient fell along the step");
        memory.visit(&[2.0], &[7.5], &[81.0]);
        memory.curve(&mut information);
        assert_eq!(information, [2.0], "nine standard errors tell nothing of here");
    }
}
