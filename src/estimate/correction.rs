//! The iteration: damped Gauss-Newton corrections within bounds until none is worth making.
//!
//! A full Gauss-Newton step is tried first, so that well-behaved problems converge quadratically; when it does not
//! lower the cost, damping rises as Levenberg, Marquardt and Nielsen taught and falls again after good steps.

use super::evaluation::{Evaluator, RunFailure, Want};
use super::noise::{Likelihood, Weights};
use super::problem::Options;
use super::progress::{Iteration, Observer};
use super::quadratic::{Inverse, Quadratic};
use super::step::{Room, constrained};
use super::termination::{Reason, Termination};
use super::unknowns::Unknowns;

/// Beyond this condition of the scaled Jacobian its products are too coarse and triangles are summed instead.
const PRODUCTS: f64 = 1e6;
/// Condition up to which inverting products leaves eight digits for the standard errors.
const ACCURATE: f64 = 1e4;
/// First damping after a full step failed; columns have unit norm.
const DAMPING: f64 = 1e-3;
/// Damping below which the full step is tried again.
const UNDAMPED: f64 = 1e-12;
/// Damping at which a correction cannot be told from none.
const HOPELESS: f64 = 1e15;

/// Largest bend of a step, relative to the step.
const BELIEF: f64 = 0.75;

/// The state of an iteration.
pub(super) struct Correction<'c, 'e, 'a> {
    pub(super) evaluator: Evaluator<'e, 'a>,
    pub(super) unknowns: &'e Unknowns,
    pub(super) likelihood: &'c Likelihood,
    options: &'c Options,
    /// The current estimates.
    pub(super) values: Vec<f64>,
    /// Noise and cost there.
    pub(super) weights: Weights,
    quadratic: Quadratic,
    inverse: Inverse,
    room: Room,
    step: Vec<f64>,
    trial: Vec<f64>,
    damping: f64,
    /// The last damping above 0: where to go back to when a full step fails.
    level: f64,
    precise: bool,
    /// Whether the evaluator's sums belong to the current estimates.
    pub(super) fresh: bool,
    pub(super) history: Vec<Iteration>,
}

impl<'c, 'e, 'a> Correction<'c, 'e, 'a> {
    pub(super) fn new(
        evaluator: Evaluator<'e, 'a>,
        unknowns: &'e Unknowns,
        likelihood: &'c Likelihood,
        options: &'c Options,
    ) -> Self {
        let q = likelihood.counts.len();
        Self {
            evaluator,
            unknowns,
            likelihood,
            options,
            values: unknowns.start.clone(),
            weights: likelihood.weights(&vec![0.0; q * q]),
            quadratic: Quadratic::default(),
            inverse: Inverse::default(),
            room: Room::default(),
            step: Vec::new(),
            trial: unknowns.start.clone(),
            damping: 0.0,
            level: DAMPING,
            precise: false,
            fresh: false,
            history: Vec::new(),
        }
    }

    /// Corrects the start values until the end.
    ///
    /// # Errors
    /// The run that cannot be simulated at the start values.
    pub(super) fn run(&mut self, observer: &mut dyn Observer) -> Result<Termination, RunFailure> {
        self.start()?;
        if self.values.is_empty() {
            self.record_start(observer);
            return Ok(Termination::Converged(Reason::NothingToEstimate));
        }
        if self.record_start(observer) {
            return Ok(Termination::Interrupted);
        }
        let mut last = f64::INFINITY;
        for iteration in 0.. {
            if !self.quadratic.is_finite() {
                return Ok(Termination::NoProgress);
            }
            let solved = self.full_step();
            let promise = if solved { self.quadratic.reduction(&self.step) } else { f64::INFINITY };
            if self.inverse.chosen.is_empty() {
                return Ok(Termination::Converged(Reason::AllHeld));
            }
            if solved && self.relative_step() <= self.options.tolerance {
                self.finish();
                return Ok(Termination::Converged(Reason::SmallCorrection));
            }
            // while corrections shrink they are made, though the cost cannot measure them any more
            let unmeasurable = promise <= self.weights.rounding;
            if unmeasurable && promise >= last {
                return Ok(Termination::Converged(Reason::Rounding));
            }
            last = if unmeasurable { promise } else { f64::INFINITY };
            if iteration >= self.options.iterations {
                return Ok(Termination::IterationLimit);
            }
            let before = self.weights.cost;
            let Some((step, damping, refused)) = self.correct(unmeasurable) else {
                return Ok(if unmeasurable { Termination::Converged(Reason::Rounding) } else { self.stuck() });
            };
            if self.record_step(observer, before, step, damping, refused) {
                return Ok(Termination::Interrupted);
            }
        }
        Ok(Termination::IterationLimit)
    }

    fn start(&mut self) -> Result<(), RunFailure> {
        let values = self.values.clone();
        self.weights = self.linearise(&values, None)?;
        self.evaluator.keep();
        self.settle(&values);
        Ok(())
    }

    /// Evaluates response and sensitivities; returns cost and weights there.
    fn linearise(&mut self, values: &[f64], known: Option<Weights>) -> Result<Weights, RunFailure> {
        self.fresh = false;
        if values.is_empty() {
            self.evaluator.evaluate(values, Want::Response)?;
            return Ok(self.likelihood.weights(&self.evaluator.moments));
        }
        if !self.likelihood.is_full() {
            self.evaluator.evaluate(values, Want::Sensitivities(None))?;
            return Ok(self.likelihood.weights(&self.evaluator.moments));
        }
        // outputs are mixed by a covariance that only the residuals of all runs tell
        let weights = match known {
            Some(weights) => weights,
            None => {
                self.evaluator.evaluate(values, Want::Response)?;
                self.likelihood.weights(&self.evaluator.moments)
            }
        };
        self.evaluator.evaluate(values, Want::Sensitivities(Some(&weights.whitener)))?;
        Ok(weights)
    }

    /// The quadratic at the current estimates, from products or, when they are too coarse, from triangles.
    fn settle(&mut self, values: &[f64]) {
        self.fresh = true;
        self.gather();
        if self.inverse.condition > PRODUCTS {
            self.refine(values);
        }
    }

    /// Evaluates again, summing triangles from now on. The model has just been evaluated at these values; should it
    /// fail now, the coarse quadratic stays.
    fn refine(&mut self, values: &[f64]) {
        if std::mem::replace(&mut self.precise, true) {
            return;
        }
        self.evaluator.make_precise();
        if self.linearise(values, Some(self.weights.clone())).is_ok() {
            self.fresh = true;
            self.gather();
        }
    }

    fn gather(&mut self) {
        let full = self.likelihood.is_full();
        self.quadratic.gather(self.unknowns, self.evaluator.sums(), &self.weights, full);
        let (lower, upper) = (&self.unknowns.lower, &self.unknowns.upper);
        self.room = Room::at(&self.values, lower, upper, &self.quadratic.scale);
        let movable = self.room.movable(&self.quadratic);
        let coarse = Inverse { chosen: movable.clone(), condition: f64::INFINITY, ..Inverse::default() };
        self.inverse = self.quadratic.invert(&movable).unwrap_or(coarse);
    }

    /// The undamped correction; false when it cannot be told.
    fn full_step(&mut self) -> bool {
        let solved = constrained(&self.quadratic, &self.room, 0.0, &mut self.step);
        if !solved && self.damping == 0.0 {
            self.damping = DAMPING;
        }
        solved
    }

    /// Tries corrections with rising damping until one is accepted: its largest part in standard errors, its damping,
    /// and how many were refused. None when there is no hope left.
    fn correct(&mut self, unmeasurable: bool) -> Option<(f64, f64, usize)> {
        for refused in 0.. {
            if unmeasurable && refused == 0 {
                self.damping = 0.0;
            }
            if self.damping > HOPELESS || (unmeasurable && refused > 0) {
                return None;
            }
            if self.damping > 0.0 && !constrained(&self.quadratic, &self.room, self.damping, &mut self.step) {
                self.damp_more();
                continue;
            }
            let bend = if self.damping > 0.0 { self.accelerate() } else { 0.0 };
            if !(bend <= BELIEF) {
                self.damping *= (bend / BELIEF).clamp(2.0, 8.0);
                continue;
            }
            if !self.set_trial() {
                return None;
            }
            let (promise, size, damping) =
                (self.quadratic.reduction(&self.step), self.largest_in_errors(), self.damping);
            match self.attempt(unmeasurable, refused == 0) {
                Some(gain) => {
                    self.damp_less(gain / promise, unmeasurable);
                    return Some((size, damping, refused));
                }
                None => self.damp_more(),
            }
        }
        None
    }

    /// Bends the damped step along the curve of the response (geodesic acceleration, Transtrum and Sethna 2012). Gives
    /// the bend relative to the step: a step that is bent too much is too long to be believed.
    fn accelerate(&mut self) -> f64 {
        let scale = &self.quadratic.scale;
        let physical = |s: &f64, d: &f64| if *d > 0.0 { s / d } else { 0.0 };
        let step: Vec<f64> = self.step.iter().zip(scale).map(|(s, d)| physical(s, d)).collect();
        let q = self.likelihood.counts.len();
        let w = &self.weights.whitener;
        let entry = |a: usize, b: usize| (0..q).map(|k| w[k * q + a] * w[k * q + b]).sum::<f64>();
        let inverse_noise: Vec<f64> = (0..q * q).map(|k| entry(k / q, k % q)).collect();
        let mut bend = vec![0.0; step.len()];
        if self.evaluator.bend(&self.values, &step, &inverse_noise, &mut bend).is_err() {
            return f64::INFINITY;
        }
        self.fresh = false;
        let rhs: Vec<f64> = bend.iter().zip(scale).map(|(b, d)| -physical(b, d)).collect();
        let moving: Vec<usize> = (0..step.len())
            .filter(|j| self.step[*j] > self.room.down[*j] && self.step[*j] < self.room.up[*j])
            .collect();
        let Some(bent) = self.quadratic.apply_inverse(&moving, self.damping, &rhs) else { return f64::INFINITY };
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let ratio = 2.0 * norm(&bent) / norm(&self.step);
        for (j, (s, b)) in self.step.iter_mut().zip(&bent).enumerate() {
            *s = (*s + 0.5 * b).max(self.room.down[j]).min(self.room.up[j]);
        }
        ratio
    }

    /// Applies the scaled step to the current estimates, within the bounds to the bit; false when nothing changes.
    fn set_trial(&mut self) -> bool {
        let gain = self.options.gain;
        for (j, s) in self.step.iter_mut().enumerate() {
            let scale = self.quadratic.scale[j];
            *s *= gain;
            let moved = if scale > 0.0 { self.values[j] + *s / scale } else { self.values[j] };
            let bound = if *s < 0.0 && *s == self.room.down[j] { self.unknowns.lower[j] } else { moved };
            let bound = if *s > 0.0 && *s == self.room.up[j] { self.unknowns.upper[j] } else { bound };
            self.trial[j] = bound.max(self.unknowns.lower[j]).min(self.unknowns.upper[j]);
        }
        self.trial != self.values
    }

    /// Evaluates the trial; when it is better it becomes the current point, and what it gained is returned. The first
    /// trial is usually accepted and gets its sensitivities at once, later ones must show their cost first.
    fn attempt(&mut self, unmeasurable: bool, bold: bool) -> Option<f64> {
        let trial = std::mem::take(&mut self.trial);
        let accepted = self.compare(&trial, unmeasurable, bold && !self.likelihood.is_full());
        let Some(weights) = accepted else {
            self.trial = trial;
            return None;
        };
        let gain = self.weights.cost - weights.cost;
        self.evaluator.keep();
        self.weights = weights;
        self.trial = std::mem::replace(&mut self.values, trial);
        let values = self.values.clone();
        self.settle(&values);
        Some(gain)
    }

    fn compare(&mut self, trial: &[f64], unmeasurable: bool, bold: bool) -> Option<Weights> {
        let allowed = if unmeasurable { self.weights.cost + self.weights.rounding } else { self.weights.cost };
        let better = |w: &Weights| w.cost < allowed || (unmeasurable && w.cost == allowed);
        if bold {
            return self.linearise(trial, None).ok().filter(better);
        }
        self.fresh = false;
        self.evaluator.evaluate(trial, Want::Response).ok()?;
        let weights = self.likelihood.weights(&self.evaluator.moments);
        if !better(&weights) {
            return None;
        }
        self.linearise(trial, Some(weights)).ok()
    }

    fn damp_more(&mut self) {
        self.damping = if self.damping > 0.0 { self.damping * 2.0 } else { self.level };
    }

    /// `ratio`: gain over promise. Damping falls as long as steps succeed, though they gain little: along a curved
    /// valley it is better to be refused now and then than to crawl.
    fn damp_less(&mut self, ratio: f64, unmeasurable: bool) {
        if unmeasurable {
            self.damping = 0.0;
        } else if self.damping > 0.0 {
            self.level = (self.damping * 0.2).max(UNDAMPED);
            self.damping = if ratio > 0.9 || self.level == UNDAMPED { 0.0 } else { self.level };
        }
    }

    /// Largest part of the step, relative to the parameter or its standard error, whichever is greater.
    fn relative_step(&self) -> f64 {
        self.parts().map(|(j, s, error)| s / self.values[j].abs().max(error)).fold(0.0, f64::max)
    }

    /// Largest part of the step in standard errors.
    fn largest_in_errors(&self) -> f64 {
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

    /// Makes the last, tiny correction; its sensitivities are those of the point before.
    fn finish(&mut self) {
        if !self.set_trial() || self.evaluator.evaluate(&self.trial, Want::Response).is_err() {
            return;
        }
        let weights = self.likelihood.weights(&self.evaluator.moments);
        if weights.cost <= self.weights.cost + self.weights.rounding {
            self.evaluator.keep();
            std::mem::swap(&mut self.values, &mut self.trial);
            self.weights = weights;
        }
    }

    fn stuck(&mut self) -> Termination {
        self.full_step();
        let promise = self.quadratic.reduction(&self.step);
        let negligible = promise <= 1e-6 && self.largest_in_errors() <= 1e-3;
        if negligible { Termination::Converged(Reason::Stationary) } else { Termination::NoProgress }
    }

    fn record_start(&mut self, observer: &mut dyn Observer) -> bool {
        let before = self.weights.cost;
        self.record_step(observer, before, 0.0, 0.0, 0)
    }

    fn record_step(
        &mut self,
        observer: &mut dyn Observer,
        before: f64,
        step: f64,
        damping: f64,
        refused: usize,
    ) -> bool {
        let (number, cost) = (self.history.len(), self.weights.cost);
        let iteration = Iteration { number, cost, change: cost - before, damping, step, refused };
        self.history.push(iteration);
        observer.iteration(&iteration).is_break()
    }

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
