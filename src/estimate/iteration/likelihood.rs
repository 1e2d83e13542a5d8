//! The likelihood of the outputs as a cost for Gauss-Newton: residuals and sensitivities of all runs, noise, priors.

use super::evaluation::{Evaluator, RunFailure, Want};
use super::priors::{PriorRow, Priors};
use super::sums::{Group, Sums};
use crate::problem::noise::{Likelihood, Weights};
use crate::problem::unknowns::Unknowns;
use fdm_numeric::least_squares::{GaussNewton, Options as StepOptions, Problem, Space};
use fdm_numeric::quadratic::Quadratic;

/// Gauss-Newton steps for a likelihood.
pub(crate) type LikelihoodSteps<'c, 'e, 'a> = GaussNewton<'e, LikelihoodCost<'c, 'e, 'a>>;

/// Minus the logarithm of the likelihood of the measured outputs, priors included.
pub(crate) struct LikelihoodCost<'c, 'e, 'a> {
    pub(crate) evaluator: Evaluator<'e, 'a>,
    pub(crate) unknowns: &'e Unknowns,
    pub(crate) likelihood: &'c Likelihood,
    pub(crate) priors: &'c Priors,
}

impl LikelihoodCost<'_, '_, '_> {
    /// Cost and weights of the last evaluation, which was at `values`.
    fn weigh(&self, values: &[f64]) -> Weights {
        let mut weights = self.likelihood.weights(&self.evaluator.moments);
        let prior = self.priors.cost(&self.unknowns.parameters(values));
        let surcharge = self.evaluator.surcharge.unwrap_or(0.0);
        weights.cost += prior + surcharge;
        weights.beside = surcharge;
        weights.rounding += 4.0 * f64::EPSILON * surcharge.abs();
        weights.rounding += 4.0 * f64::EPSILON * prior;
        weights
    }

    /// The quadratic of the last linearisation with a factor for each group of sums.
    pub(crate) fn gather_with(
        &self,
        values: &[f64],
        factors: &[f64],
        priors: impl Iterator<Item = PriorRow>,
        quadratic: &mut Quadratic,
    ) {
        gather(quadratic, (self.unknowns, values), self.evaluator.sums(), factors, priors);
    }
}

impl Problem for LikelihoodCost<'_, '_, '_> {
    type Failure = RunFailure;
    type Weights = Weights;

    fn cost(&self, weights: &Weights) -> f64 {
        weights.cost
    }

    fn rounding(&self, weights: &Weights) -> f64 {
        weights.rounding
    }

    fn scatter(&self, weights: &Weights) -> f64 {
        weights.scatter
    }

    fn relative_noise(&self, weights: &Weights) -> f64 {
        self.likelihood.relative_noise(weights)
    }

    fn evaluate(&mut self, values: &[f64]) -> Result<Weights, RunFailure> {
        self.evaluator.evaluate(values, Want::Response)?;
        Ok(self.weigh(values))
    }

    fn linearise(&mut self, values: &[f64], known: Option<Weights>) -> Result<Weights, RunFailure> {
        if values.is_empty() {
            return self.evaluate(values);
        }
        if !self.likelihood.is_full() {
            self.evaluator.evaluate(values, Want::Sensitivities(None))?;
            return Ok(self.weigh(values));
        }
        // outputs are mixed by a covariance that only the residuals of all runs tell
        let weights = match known {
            Some(weights) => weights,
            None => self.evaluate(values)?,
        };
        self.evaluator.evaluate(values, Want::Sensitivities(Some(&weights.whitener)))?;
        Ok(weights)
    }

    fn gather(&mut self, values: &[f64], weights: &Weights, quadratic: &mut Quadratic) {
        let priors = self.priors.rows(&self.unknowns.parameters(values)).collect::<Vec<_>>().into_iter();
        self.gather_with(values, &self.likelihood.factors(weights), priors, quadratic);
    }

    fn keep(&mut self) {
        self.evaluator.keep();
    }

    fn is_weighed_first(&self) -> bool {
        self.likelihood.is_full()
    }

    fn make_precise(&mut self) -> bool {
        self.evaluator.make_precise();
        true
    }

    fn second_derivative(
        &mut self,
        values: &[f64],
        ahead: &[f64],
        step: &[f64],
        weights: &Weights,
        slope: &mut [f64],
    ) -> Option<bool> {
        // rows that are no derivatives of the outputs bend by something else
        self.evaluator.surcharge.is_none().then_some(())?;
        Some(self.evaluator.bend(values, ahead, step, &weights.inverse(), slope).is_ok())
    }

    fn scaled(&self, unknown: usize, value: f64, factor: f64) -> f64 {
        self.unknowns.scaled(unknown, value, factor)
    }

    fn evaluations(&self) -> (usize, usize) {
        (self.evaluator.evaluations, self.evaluator.simulations)
    }

    fn set_evaluations(&mut self, evaluations: (usize, usize)) {
        (self.evaluator.evaluations, self.evaluator.simulations) = evaluations;
    }
}

/// Where the unknowns may be.
pub(crate) fn space(unknowns: &Unknowns) -> Space<'_> {
    let Unknowns { start, lower, upper, affine, .. } = unknowns;
    Space { start, lower, upper, affine, reach: &[] }
}

/// What logarithms were searched for goes on as parameters, where the search ended: errors are those of the parameters.
pub(crate) fn of_parameters<'c, 'e, 'a>(
    steps: LikelihoodSteps<'c, 'e, 'a>,
    unknowns: &'e Unknowns,
    options: StepOptions,
) -> LikelihoodSteps<'c, 'e, 'a> {
    let values = steps.problem.unknowns.parameters(&steps.values);
    let GaussNewton { problem: mut cost, weights, history, .. } = steps;
    cost.unknowns = unknowns;
    cost.evaluator.set_unknowns(unknowns);
    let mut steps = GaussNewton::new(cost, space(unknowns), options);
    (steps.values, steps.weights, steps.history) = (values, weights, history);
    steps
}

/// Gathers the sums of all runs, in their order, each group times its factor, and what was known before.
fn gather<'s>(
    quadratic: &mut Quadratic,
    (unknowns, values): (&Unknowns, &[f64]),
    runs: impl Iterator<Item = &'s Sums>,
    factors: &[f64],
    priors: impl Iterator<Item = PriorRow>,
) {
    quadratic.begin(unknowns.len());
    let slopes = unknowns.slopes(values);
    let (mut rows, mut work) = (Vec::new(), Vec::new());
    for (run, sums) in runs.enumerate() {
        for (group, factor) in sums.groups.iter().zip(factors) {
            if sums.precise {
                spread(unknowns, run, group, *factor, quadratic.width(), &mut rows);
                quadratic.add_rows(&mut rows, &mut work);
            } else {
                add_products(quadratic, unknowns, run, group, factor * factor);
            }
        }
    }
    if !slopes.is_empty() {
        quadratic.stretch(&slopes);
    }
    for row in priors {
        let sloped = |(j, entry): &(usize, f64)| (*j, slopes.get(*j).map_or(*entry, |slope| entry * slope));
        quadratic.add_row_of(row.entries().iter().map(sloped), row.residual, &mut rows, &mut work);
    }
    quadratic.end();
}

/// Adds one group of products; with rising columns the unknowns rise too, so the upper triangle stays one.
fn add_products(quadratic: &mut Quadratic, unknowns: &Unknowns, run: usize, group: &Group, weight: f64) {
    let (size, (hessian, rhs)) = (unknowns.len(), quadratic.products());
    for (column, others, products, with_residual) in group.rows() {
        let at = unknowns.position(run, column);
        let hessian = &mut hessian[at * size..][..size];
        for (other, product) in others.iter().zip(products) {
            hessian[unknowns.position(run, *other as usize)] += weight * product;
        }
        rhs[at] += weight * with_residual;
    }
}

/// The rows of one group's triangle times a factor, in the columns of all unknowns.
fn spread(unknowns: &Unknowns, run: usize, group: &Group, factor: f64, width: usize, rows: &mut Vec<f64>) {
    let columns = group.columns.iter().map(|c| unknowns.position(run, *c as usize));
    let places: Vec<usize> = columns.chain([width - 1]).collect();
    rows.clear();
    rows.resize(places.len() * width, 0.0);
    for (k, (row, from)) in rows.chunks_mut(width).zip(group.values.chunks(group.width.max(1))).enumerate() {
        places[k..].iter().zip(&from[k..]).for_each(|(at, value)| row[*at] = factor * value);
    }
}
