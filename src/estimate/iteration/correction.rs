//! The iteration: damped Gauss-Newton corrections within bounds until none is worth making.
//!
//! Convergence is judged here; how a correction is tried, damped and accepted is in `trial.rs`, what the last one tells
//! in `conclusion.rs`.

use super::evaluation::{Evaluator, RunFailure, Want};
use super::priors::Priors;
use super::projection::Projected;
use super::quadratic::{Inverse, Quadratic};
use super::restart::Attempts;
use super::secant::Secant;
use super::snapshot::Snapshot;
use super::step::{Room, constrained};
use super::trial::{self, Accepted};
use crate::estimate::noise::{Likelihood, Weights};
use crate::estimate::problem::Options;
use crate::estimate::progress::{Iteration, Observer};
use crate::estimate::termination::{Reason, Termination};
use crate::estimate::unknowns::Unknowns;

/// Beyond this condition of the scaled Jacobian its products are too coarse and triangles are summed instead.
const PRODUCTS: f64 = 1e6;

/// Rate of convergence above which Gauss-Newton is called slow.
const SLOW: f64 = 0.1;
/// Promise (of the logarithm of the likelihood) below which rates tell about the minimum, not about the way to it.
const NEAR: f64 = 1.0;
/// Part of the tolerance that may be left to go after the last correction.
const REST: f64 = 1e-2;

/// The state of an iteration.
pub(in crate::estimate) struct Correction<'c, 'e, 'a> {
    pub(in crate::estimate) evaluator: Evaluator<'e, 'a>,
    pub(in crate::estimate) unknowns: &'e Unknowns,
    pub(in crate::estimate) likelihood: &'c Likelihood,
    pub(in crate::estimate) priors: &'c Priors,
    pub(in crate::estimate) options: &'c Options,
    /// The current estimates.
    pub(in crate::estimate) values: Vec<f64>,
    /// Noise and cost there.
    pub(in crate::estimate) weights: Weights,
    pub(in crate::estimate) quadratic: Quadratic,
    pub(in crate::estimate) inverse: Inverse,
    pub(in crate::estimate) room: Room,
    pub(in crate::estimate) step: Vec<f64>,
    pub(in crate::estimate) trial: Vec<f64>,
    pub(in crate::estimate) damping: f64,
    /// The last damping above 0: where to go back to when a full step fails.
    pub(in crate::estimate) level: f64,
    pub(in crate::estimate) precise: bool,
    /// What the correction before promised, when the cost could not measure it; infinite otherwise.
    pub(in crate::estimate) last: f64,
    /// What Gauss-Newton promised before the last correction: infinite at the start, NaN after a damped one.
    pub(in crate::estimate) promised: f64,
    pub(in crate::estimate) secant: Secant,
    pub(in crate::estimate) attempts: Attempts,
    /// Iterations of another method before the corrections; none as long as it has not ended.
    pub(in crate::estimate) searched: Option<usize>,
    /// Whether affine unknowns follow the others.
    pub(in crate::estimate) projecting: bool,
    /// What is left to iterate then, at the current estimates.
    pub(in crate::estimate) projected: Option<Projected>,
    /// Whether the evaluator's sums belong to the current estimates.
    pub(in crate::estimate) fresh: bool,
    pub(in crate::estimate) history: Vec<Iteration>,
}

impl<'c, 'e, 'a> Correction<'c, 'e, 'a> {
    pub(in crate::estimate) fn new(
        evaluator: Evaluator<'e, 'a>,
        unknowns: &'e Unknowns,
        likelihood: &'c Likelihood,
        priors: &'c Priors,
        options: &'c Options,
    ) -> Self {
        let q = likelihood.counts.len();
        Self {
            evaluator,
            unknowns,
            likelihood,
            priors,
            options,
            values: unknowns.start.clone(),
            weights: likelihood.weights(&vec![0.0; q * q]),
            quadratic: Quadratic::default(),
            inverse: Inverse::default(),
            room: Room::default(),
            step: Vec::new(),
            trial: unknowns.start.clone(),
            damping: 0.0,
            level: trial::DAMPING,
            precise: false,
            last: f64::INFINITY,
            promised: f64::INFINITY,
            secant: Secant::default(),
            attempts: Attempts::default(),
            searched: None,
            projecting: false,
            projected: None,
            fresh: false,
            history: Vec::new(),
        }
    }

    /// Corrects the start values, or goes on from a state that was kept, until the end.
    ///
    /// # Errors
    /// The run that cannot be simulated at the start values.
    pub(in crate::estimate) fn run(
        &mut self,
        resume: Option<Snapshot>,
        observer: &mut dyn Observer,
    ) -> Result<Termination, RunFailure> {
        let interrupted = match resume {
            Some(snapshot) => self.restore(snapshot).map(|()| false)?,
            None => {
                self.start()?;
                self.record_start(observer)
            }
        };
        if self.values.is_empty() {
            return Ok(Termination::Converged(Reason::NothingToEstimate));
        }
        if interrupted || (self.searched.is_none() && self.search(observer)?) {
            return Ok(Termination::Interrupted);
        }
        loop {
            let end = self.iterate(observer);
            if let Some(end) = self.judge(end, observer)? {
                return Ok(end);
            }
        }
    }

    /// Corrects the current estimates until one attempt is over.
    fn iterate(&mut self, observer: &mut dyn Observer) -> Termination {
        loop {
            if !self.quadratic.is_finite() {
                return Termination::NoProgress;
            }
            let solved = self.full_step();
            if self.inverse.chosen.is_empty() {
                return Termination::Converged(Reason::AllHeld);
            }
            let straight = if solved { self.quadratic.reduction(&self.step) } else { f64::INFINITY };
            let rate = (straight / self.promised).max(0.0).sqrt();
            if solved {
                self.learn(rate);
            }
            let promise = if solved { self.quadratic.reduction(&self.step) } else { f64::INFINITY };
            if solved && self.is_close(rate) {
                self.finish();
                return Termination::Converged(Reason::SmallCorrection);
            }
            // while corrections shrink they are made, though the cost cannot measure them any more
            let unmeasurable = promise <= self.weights.rounding;
            if unmeasurable && promise >= self.last {
                return Termination::Converged(Reason::Rounding);
            }
            self.last = if unmeasurable { promise } else { f64::INFINITY };
            if self.corrections() >= self.options.iterations {
                return Termination::IterationLimit;
            }
            let before = self.weights.cost;
            let Some(accepted) = self.correct(unmeasurable) else {
                return if unmeasurable { Termination::Converged(Reason::Rounding) } else { self.stuck() };
            };
            self.promised = if accepted.damping == 0.0 && accepted.part == 1.0 { straight } else { f64::NAN };
            if self.record(observer, before, accepted) {
                return Termination::Interrupted;
            }
        }
    }

    pub(in crate::estimate) fn start(&mut self) -> Result<(), RunFailure> {
        let values = self.values.clone();
        self.weights = self.linearise(&values, None)?;
        self.evaluator.keep();
        self.settle();
        Ok(())
    }

    /// Evaluates response and sensitivities; returns cost and weights there.
    pub(in crate::estimate) fn linearise(
        &mut self,
        values: &[f64],
        known: Option<Weights>,
    ) -> Result<Weights, RunFailure> {
        self.fresh = false;
        if values.is_empty() {
            self.evaluator.evaluate(values, Want::Response)?;
            return Ok(self.weigh(values));
        }
        if !self.likelihood.is_full() {
            self.evaluator.evaluate(values, Want::Sensitivities(None))?;
            return Ok(self.weigh(values));
        }
        // outputs are mixed by a covariance that only the residuals of all runs tell
        let weights = match known {
            Some(weights) => weights,
            None => {
                self.evaluator.evaluate(values, Want::Response)?;
                self.weigh(values)
            }
        };
        self.evaluator.evaluate(values, Want::Sensitivities(Some(&weights.whitener)))?;
        Ok(weights)
    }

    /// Cost and weights of the last evaluation, which was at `values`.
    pub(in crate::estimate) fn weigh(&self, values: &[f64]) -> Weights {
        let mut weights = self.likelihood.weights(&self.evaluator.moments);
        let prior = self.priors.cost(values);
        weights.cost += prior;
        weights.rounding += 4.0 * f64::EPSILON * prior;
        weights
    }

    /// Corrections made so far.
    pub(in crate::estimate) fn corrections(&self) -> usize {
        self.history.len().saturating_sub(1 + self.searched.unwrap_or(0))
    }

    /// The gradient of the cost at `values`, which has just been linearised; none when it is not finite.
    pub(in crate::estimate) fn gradient(&mut self, values: &[f64], weights: &Weights) -> Option<Vec<f64>> {
        let factors = self.likelihood.factors(weights);
        self.quadratic.gather(self.unknowns, self.evaluator.sums(), &factors, self.priors.rows(values));
        let parts = self.quadratic.rhs.iter().zip(&self.quadratic.scale);
        self.quadratic.is_finite().then(|| parts.map(|(r, s)| -r * s).collect())
    }

    /// The quadratic at the current estimates, from products or, when they are too coarse, from triangles.
    pub(in crate::estimate) fn settle(&mut self) {
        self.fresh = true;
        self.gather();
        if self.inverse.condition > PRODUCTS {
            self.refine();
        }
    }

    /// Evaluates again, summing triangles from now on. The model has just been evaluated at these values; should it
    /// fail now, the coarse quadratic stays.
    pub(in crate::estimate) fn refine(&mut self) {
        if std::mem::replace(&mut self.precise, true) {
            return;
        }
        self.evaluator.make_precise();
        let values = self.values.clone();
        if self.linearise(&values, Some(self.weights.clone())).is_ok() {
            self.fresh = true;
            self.gather();
        }
    }

    pub(in crate::estimate) fn gather(&mut self) {
        self.projected = None;
        let factors = self.likelihood.factors(&self.weights);
        self.quadratic.gather(self.unknowns, self.evaluator.sums(), &factors, self.priors.rows(&self.values));
        let (lower, upper) = (&self.unknowns.lower, &self.unknowns.upper);
        self.room.measure(&self.values, lower, upper, &self.quadratic.scale);
        let movable = self.room.movable(&self.quadratic);
        let spent = std::mem::take(&mut self.inverse);
        self.inverse = self.quadratic.invert(movable, spent).unwrap_or_else(|| Inverse {
            chosen: self.room.movable(&self.quadratic),
            condition: f64::INFINITY,
            ..Inverse::default()
        });
    }

    /// The undamped correction; false when it cannot be told.
    pub(in crate::estimate) fn full_step(&mut self) -> bool {
        let solved = constrained(&self.quadratic, &self.room, 0.0, &mut self.step) && self.keeps_promise();
        if !solved && self.damping == 0.0 {
            self.damping = self.level;
        }
        solved
    }

    /// Learns the curvature that Gauss-Newton misses once it is slow, and takes it into account.
    fn learn(&mut self, rate: f64) {
        // noise that was stated far too large would make every place look near
        let near = self.quadratic.reduction(&self.step) <= NEAR * self.weights.scatter.min(1.0);
        let learn = near && (rate > SLOW || (self.secant.is_active() && !rate.is_nan()));
        self.secant.visit(&self.values, &self.quadratic, learn);
        if self.secant.is_active() {
            self.quadratic.curve(&self.secant.matrix);
            if !self.full_step() {
                self.straighten();
            }
        }
    }

    /// Goes back to the step of Gauss-Newton.
    pub(in crate::estimate) fn straighten(&mut self) {
        self.secant.clear();
        self.quadratic.curve(&[]);
        self.full_step();
    }

    /// Whether no correction is worth making after the one that is promised: it is small, and by the rate at which
    /// corrections shrink all that would follow are smaller still.
    fn is_close(&self, rate: f64) -> bool {
        let size = self.relative_step();
        let rate = if rate.is_nan() { 0.5 } else { rate.min(0.99) };
        size <= self.options.tolerance && size * rate / (1.0 - rate) <= REST * self.options.tolerance
    }

    /// Largest part of the step, relative to the parameter or its standard error, whichever is greater.
    fn relative_step(&self) -> f64 {
        self.parts().map(|(j, s, error)| s / self.values[j].abs().max(error)).fold(0.0, f64::max)
    }

    /// Largest part of the step in standard errors.
    pub(in crate::estimate) fn largest_in_errors(&self) -> f64 {
        self.parts().map(|(_, s, error)| s / error).filter(|r| r.is_finite()).fold(0.0, f64::max)
    }

    /// Unknown, size of the step and standard error of everything that moves.
    fn parts(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        let n = self.inverse.chosen.len();
        self.inverse.chosen.iter().enumerate().filter_map(move |(k, j)| {
            let scale = self.quadratic.scale[*j];
            let error = self.inverse.values.get(k * n + k).map_or(0.0, |v| v.max(0.0).sqrt() / scale);
            (self.step[*j] != 0.0).then(|| (*j, (self.step[*j] / scale).abs(), error))
        })
    }

    fn stuck(&mut self) -> Termination {
        self.straighten();
        let promise = self.quadratic.reduction(&self.step);
        if promise <= 1e-6 && self.largest_in_errors() <= 1e-3 {
            return Termination::Converged(Reason::Stationary);
        }
        // noise-free data: what is left is the rounding of the simulation, which no standard error measures
        let matched = self.likelihood.relative_noise(&self.weights) <= 1e-9 && self.relative_step() <= 1e-6;
        if matched { Termination::Converged(Reason::Rounding) } else { Termination::NoProgress }
    }

    pub(in crate::estimate) fn record_start(&mut self, observer: &mut dyn Observer) -> bool {
        let start = Accepted { step: 0.0, damping: 0.0, refused: 0, part: 1.0 };
        self.record(observer, self.weights.cost, start)
    }

    /// Adds to the history; true when the observer asks for the end.
    fn record(&mut self, observer: &mut dyn Observer, before: f64, accepted: Accepted) -> bool {
        let (number, cost) = (self.history.len(), self.weights.cost);
        let Accepted { step, damping, refused, .. } = accepted;
        let iteration = Iteration { number, cost, change: cost - before, damping, step, refused };
        self.history.push(iteration);
        observer.state(&|| self.snapshot());
        observer.values(&self.values);
        observer.iteration(&iteration).is_break()
    }
}
