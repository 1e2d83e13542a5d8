//! The innovations' cost for Gauss-Newton: its curvature is the expected information (scoring; Maine and Iliff 1985), and what
//! that misses is learnt from the gradients along the way.

use super::gradient_memory::GradientMemory;
use super::likelihood::{Coordinates, Likelihood, Lost};
use crate::iteration::priors::Priors;
use crate::work::Work;
use crate::work::termination::Termination;
use fdm_numeric::least_squares::{GaussNewton, Iteration, Options, Problem, Space};
use fdm_numeric::quadratic::Quadratic;

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
