//! The minimum of the innovations' cost by scoring: Newton's method with the expected information and the curvature
//! that the gradients met, damped where it does not descend.

use super::bends::Bends;
use super::coordinates::Coordinates;
use super::likelihood::{Likelihood, Lost};
use crate::estimate::iteration::cholesky::Cholesky;
use crate::estimate::iteration::priors::Priors;
use crate::estimate::progress::{Iteration, Observer};
use crate::estimate::termination::{Reason, Termination};

/// What is looked for, and how.
pub(super) struct Search<'s, 'a> {
    pub(super) likelihood: &'s mut Likelihood<'a>,
    pub(super) coordinates: Coordinates,
    /// Unknowns with what was known of them before.
    pub(super) priors: Priors,
    pub(super) iterations: usize,
}

/// Where the search ended.
pub(super) struct Found {
    pub(super) values: Vec<f64>,
    pub(super) cost: f64,
    pub(super) history: Vec<Iteration>,
    pub(super) termination: Termination,
}

/// What a correction must promise, in units of the logarithm of the likelihood, to be worth another one: the estimates are then within
/// a thousandth of their standard errors of the minimum.
const WORTH: f64 = 5e-7;
/// Damping of the first correction, relative to the information, least and most.
const FIRST: f64 = 1e-2;
const LEAST: f64 = 1e-6;
const MOST: f64 = 1e10;

impl Search<'_, '_> {
    /// From these values to the minimum.
    ///
    /// # Errors
    /// The run that cannot be filtered at the start.
    pub(super) fn run(mut self, start: &[f64], observer: &mut dyn Observer) -> Result<Found, Lost> {
        let mut point = self.coordinates.inwards(start);
        let mut cost = self.at(&point, true)?;
        let mut history = vec![Iteration { number: 0, cost, change: 0.0, damping: 0.0, step: 0.0, refused: 0 }];
        let (mut damping, mut number, mut bends) = (FIRST, 0, Bends::default());
        observer.values(&self.coordinates.outwards(&point));
        let mut interrupted = observer.iteration(&history[0]).is_break();
        let termination = loop {
            if interrupted {
                break Termination::Interrupted;
            }
            let (gradient, information) = self.slopes(&point);
            bends.meet(&point, &gradient, history.last().map_or(0.0, |i| i.step));
            let Some(next) = self.descend(&point, cost, (&gradient, &information), &bends, &mut damping) else {
                break Termination::NoProgress;
            };
            let Descent::Step { step, cost: lower, refused, damped } = next else {
                let reason = if point.is_empty() { Reason::NothingToEstimate } else { Reason::SmallCorrection };
                break Termination::Converged(reason);
            };
            number += 1;
            point.iter_mut().zip(&step).for_each(|(u, d)| *u += d);
            let size = point.len();
            let moved = step.iter().enumerate().map(|(j, d)| d.abs() * information[j * size + j].sqrt());
            let moved = moved.fold(0.0, f64::max);
            let iteration =
                Iteration { number, cost: lower, change: lower - cost, damping: damped, step: moved, refused };
            cost = lower;
            history.push(iteration);
            observer.values(&self.coordinates.outwards(&point));
            interrupted = observer.iteration(&iteration).is_break();
            self.at(&point, true)?;
            if number >= self.iterations && !interrupted {
                break Termination::IterationLimit;
            }
        };
        Ok(Found { values: self.coordinates.outwards(&point), cost, history, termination })
    }

    fn at(&mut self, point: &[f64], wanted: bool) -> Result<f64, Lost> {
        let values = self.coordinates.outwards(point);
        Ok(self.likelihood.evaluate(&values, wanted)? + self.priors.cost(&values))
    }

    /// Gradient and information in the coordinates, priors included.
    fn slopes(&self, point: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let values = self.coordinates.outwards(point);
        let size = point.len();
        let mut gradient = self.likelihood.score.gradient.clone();
        let mut information = self.likelihood.score.information.clone();
        for row in self.priors.rows(&values) {
            gradient[row.unknown] -= row.weight * row.residual;
            information[row.unknown * size + row.unknown] += row.weight * row.weight;
        }
        let slope: Vec<f64> = (0..size).map(|j| self.coordinates.slope(j, values[j])).collect();
        for i in 0..size {
            gradient[i] *= slope[i];
            for j in 0..size {
                information[i * size + j] *= slope[i] * slope[j];
            }
        }
        (gradient, information)
    }

    /// The next step that lowers the cost; none when there is none although one is promised.
    fn descend(
        &mut self,
        point: &[f64],
        cost: f64,
        (gradient, information): (&[f64], &[f64]),
        bends: &Bends,
        damping: &mut f64,
    ) -> Option<Descent> {
        let size = point.len();
        let rounding = 1e-12 * cost.abs().max(1.0);
        let promise = |step: &[f64], information: &[f64]| {
            let slope: f64 = gradient.iter().zip(step).map(|(g, d)| g * d).sum();
            let bend = |i: usize| step[i] * (0..size).map(|j| information[i * size + j] * step[j]).sum::<f64>();
            -slope - 0.5 * (0..size).map(bend).sum::<f64>()
        };
        // what is left to go is judged by the full step of scoring, which nothing that was met before can shorten
        let full = self.step(point, gradient, information, 0.0);
        if full.as_ref().is_some_and(|step| promise(step, information) < WORTH.max(rounding)) {
            return Some(Descent::Arrived);
        }
        let mut information = information.to_vec();
        bends.bend(&mut information);
        let mut refused = 0;
        while *damping <= MOST {
            let damped = if *damping < LEAST { 0.0 } else { *damping };
            let step = self.step(point, gradient, &information, damped);
            if let Some(step) = step {
                let gain = promise(&step, &information);
                let there: Vec<f64> = point.iter().zip(&step).map(|(u, d)| u + d).collect();
                if let Ok(lower) = self.at(&there, false)
                    && lower < cost - 1e-4 * gain
                {
                    // a step that keeps its promise earns longer ones
                    *damping *= if cost - lower > 0.5 * gain { 0.1 } else { 1.0 };
                    return Some(Descent::Step { step, cost: lower, refused, damped });
                }
                if gain < rounding {
                    return Some(Descent::Arrived);
                }
            }
            refused += 1;
            *damping = (8.0 * *damping).max(1e-3);
        }
        None
    }

    /// The minimum of the damped quadratic inside the bounds: who meets one stays there, and the others make the best of it.
    fn step(&self, point: &[f64], gradient: &[f64], information: &[f64], damping: f64) -> Option<Vec<f64>> {
        let size = point.len();
        let scale: Vec<f64> = (0..size).map(|j| information[j * size + j].sqrt()).collect();
        let mut step = vec![0.0; size];
        let held = |j: usize| scale[j] == 0.0 || self.coordinates.is_held(j, point[j], gradient[j]);
        let mut free: Vec<usize> = (0..size).filter(|j| !held(*j)).collect();
        while !free.is_empty() {
            let n = free.len();
            let entry = |(a, b): (&usize, &usize)| {
                let value = information[a * size + b] / (scale[*a] * scale[*b]);
                if a == b { value + damping.max(1e-13) } else { value }
            };
            let matrix: Vec<f64> = free.iter().flat_map(|a| free.iter().map(move |b| (a, b))).map(entry).collect();
            let factor = Cholesky::new(matrix, n)?;
            let others: Vec<usize> = (0..size).filter(|j| step[*j] != 0.0 && !free.contains(j)).collect();
            let pull = |a: &usize| others.iter().map(|j| information[a * size + j] * step[*j]).sum::<f64>();
            let mut wanted: Vec<f64> = free.iter().map(|a| -(gradient[*a] + pull(a)) / scale[*a]).collect();
            factor.solve(&mut wanted);
            let clipped: Vec<f64> =
                free.iter().zip(&wanted).map(|(a, w)| self.coordinates.clip(*a, point[*a], w / scale[*a])).collect();
            let met = |k: usize| clipped[k] != wanted[k] / scale[free[k]];
            for (a, step_of) in free.iter().zip(&clipped) {
                step[*a] = *step_of;
            }
            if (0..n).all(|k| !met(k)) {
                break;
            }
            free = (0..n).filter(|k| !met(*k)).map(|k| free[k]).collect();
            free.iter().for_each(|a| step[*a] = 0.0);
        }
        step.iter().all(|d| d.is_finite()).then_some(step)
    }
}

/// One correction, or none that is worth while.
enum Descent {
    Arrived,
    Step { step: Vec<f64>, cost: f64, refused: usize, damped: f64 },
}
