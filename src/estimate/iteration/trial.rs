//! Trying one correction: a full Gauss-Newton step first, so that well-behaved problems converge quadratically; when it
//! is refused, damped steps (Levenberg, Marquardt) that are bent along the curve of the response.

use super::bend::AHEAD;
use super::correction::Correction;
use super::evaluation::Want;
use super::step::constrained;
use crate::estimate::noise::Weights;

/// First damping after a full step was refused; columns have unit norm.
pub(in crate::estimate) const DAMPING: f64 = 1e-3;
/// Damping that is as good as none.
const UNDAMPED: f64 = 1e-12;
/// Damping at which a correction cannot be told from none.
const HOPELESS: f64 = 1e15;
/// Largest believable bend of a step, relative to the step.
const BELIEF: f64 = 0.75;
/// Part of what a shortened step promises that it must gain to be taken.
const WORTH: f64 = 0.25;
/// Part of what it promises that a long step must gain which lands on a bound: one that gains less went by a slope that does not hold so
/// far, and what stands on a bound seldom leaves it again.
const LANDING: f64 = 0.75;
/// How often a refused full step is halved before it is damped.
const HALVINGS: usize = 2;
/// Trials in a row after which damping rises faster, and steps are so short that they need no bending.
const PATIENCE: usize = 12;

/// An accepted correction.
pub(in crate::estimate) struct Accepted {
    /// Its largest part, in standard errors.
    pub(in crate::estimate) step: f64,
    /// Its damping.
    pub(in crate::estimate) damping: f64,
    /// How many were refused before it.
    pub(in crate::estimate) refused: usize,
    /// Which part of it was taken.
    pub(in crate::estimate) part: f64,
}

impl Correction<'_, '_, '_> {
    /// Tries corrections with rising damping until one is accepted; none when there is no hope left. A gain that is
    /// `unmeasurable` in the cost is tried once, undamped, and taken on trust.
    pub(in crate::estimate) fn correct(&mut self, unmeasurable: bool) -> Option<Accepted> {
        if unmeasurable {
            self.damping = 0.0;
        }
        for refused in 0.. {
            if self.damping > HOPELESS || (unmeasurable && refused > 0) {
                return None;
            }
            if !self.propose(refused) {
                continue;
            }
            if !self.set_trial() {
                return None;
            }
            let (promise, damping) = (self.quadratic.reduction(&self.step), self.damping);
            let step = self.largest_in_errors();
            if let Some(gain) = self.attempt(unmeasurable, refused == 0) {
                self.projecting &= damping > 0.0 || refused > 0;
                self.damp_less(gain / promise, unmeasurable);
                return Some(Accepted { step, damping, refused, part: 1.0 });
            }
            if self.damping == 0.0 && self.secant.is_active() {
                self.straighten();
                continue;
            }
            if refused == 0
                && !unmeasurable
                && let Some(part) = self.shorten(promise)
            {
                return Some(Accepted { step: part * step, damping, refused: 1, part });
            }
            if !unmeasurable && !self.projecting && self.can_project() {
                if let Some(accepted) = self.begin_projection(refused + 1) {
                    return Some(accepted);
                }
                if self.projecting {
                    continue;
                }
            }
            self.damp_more(if refused < PATIENCE { 2.0 } else { 8.0 });
        }
        None
    }

    /// Far from the minimum takes a part of the full step that was refused, where it gains what its length promises: the direction is good then,
    /// and one response is cheaper than to find another. Gives the part.
    fn shorten(&mut self, promise: f64) -> Option<f64> {
        let far = promise > 1.0 && self.largest_in_errors() > 1.0;
        if self.damping > 0.0 || self.options.gain != 1.0 || self.projecting || !far {
            return None;
        }
        let (full, whole) = (self.step.clone(), self.weights.cost);
        let mut part = 1.0;
        for _ in 0..HALVINGS {
            part *= 0.5;
            self.step.iter_mut().zip(&full).for_each(|(s, f)| *s = part * f);
            // what a quadratic cost would gain
            let least = WORTH * promise * part * (2.0 - part);
            if !self.set_trial() {
                break;
            }
            self.fresh = false;
            let evaluated = self.evaluator.evaluate(&self.trial, Want::Response).is_ok();
            if evaluated && whole - self.weigh(&self.trial).cost >= least && self.attempt(false, true).is_some() {
                return Some(part);
            }
        }
        self.step = full;
        None
    }

    /// Computes the step under the current damping; false when it cannot be believed and damping was raised.
    fn propose(&mut self, refused: usize) -> bool {
        if self.damping == 0.0 {
            return true;
        }
        let bent = refused < PATIENCE;
        let bend = if self.projecting {
            self.projected_step(bent)
        } else if !constrained(&self.quadratic, &self.room, self.damping, &mut self.step) {
            self.damp_more(2.0);
            return false;
        } else if bent {
            self.bend()
        } else {
            0.0
        };
        let believed = bend <= BELIEF;
        if !believed {
            self.damp_more(if bend.is_nan() { 8.0 } else { (bend / BELIEF).clamp(2.0, 8.0) });
        }
        believed
    }

    /// Bends the damped step along the curve of the response; gives the bend relative to the step.
    fn bend(&mut self) -> f64 {
        let Some(slope) = self.slope_of_bend() else { return f64::INFINITY };
        self.room.bend(&self.quadratic, self.damping, &slope, &mut self.step)
    }

    /// The second derivative of the response along the step, as a (scaled) slope of the cost.
    pub(in crate::estimate) fn slope_of_bend(&mut self) -> Option<Vec<f64>> {
        let step = self.unscaled(&self.step);
        let mut ahead: Vec<f64> = self.values.iter().zip(&step).map(|(v, s)| v + AHEAD * s).collect();
        self.fresh = false;
        if self.projecting && !self.follow_in_trial(&mut ahead) {
            return None;
        }
        let mut slope = vec![0.0; step.len()];
        let inverse_noise = self.weights.inverse();
        self.evaluator.bend(&self.values, &ahead, &step, &inverse_noise, &mut slope).ok()?;
        Some(self.unscaled(&slope))
    }

    fn unscaled(&self, scaled: &[f64]) -> Vec<f64> {
        let parts = scaled.iter().zip(&self.quadratic.scale);
        parts.map(|(v, d)| if *d > 0.0 { v / d } else { 0.0 }).collect()
    }

    /// Applies the scaled step, times the gain, to the current estimates; what reaches a bound stands on it to the bit; false when nothing changes.
    pub(in crate::estimate) fn set_trial(&mut self) -> bool {
        let gain = self.options.gain;
        for (j, s) in self.step.iter_mut().enumerate() {
            let scale = self.quadratic.scale[j];
            let (lower, upper) = (self.unknowns.lower[j], self.unknowns.upper[j]);
            self.trial[j] = if *s < 0.0 && *s <= self.room.down[j] {
                lower
            } else if *s > 0.0 && *s >= self.room.up[j] {
                upper
            } else if scale > 0.0 {
                *s *= gain;
                (self.values[j] + *s / scale).max(lower).min(upper)
            } else {
                self.values[j]
            };
        }
        self.trial != self.values
    }

    /// Evaluates the trial; when it is better it becomes the current point, and what it gained is returned. The first
    /// trial is usually accepted and gets its sensitivities at once, later ones must show their cost first.
    pub(in crate::estimate) fn attempt(&mut self, unmeasurable: bool, bold: bool) -> Option<f64> {
        let mut trial = std::mem::take(&mut self.trial);
        if self.projecting && !unmeasurable && !self.follow_in_trial(&mut trial) {
            self.trial = trial;
            return None;
        }
        let accepted = self.compare(&trial, unmeasurable, bold && !self.likelihood.is_full());
        let Some(weights) = accepted else {
            self.trial = trial;
            return None;
        };
        let gain = self.weights.cost - weights.cost;
        self.evaluator.keep();
        self.weights = weights;
        self.trial = std::mem::replace(&mut self.values, trial);
        self.settle();
        Some(gain)
    }

    fn compare(&mut self, trial: &[f64], unmeasurable: bool, bold: bool) -> Option<Weights> {
        let allowed = if unmeasurable { self.weights.cost + self.weights.rounding } else { self.weights.cost };
        let allowed = allowed - if unmeasurable { 0.0 } else { self.least_gain(trial) };
        let better = |w: &Weights| w.cost < allowed || (unmeasurable && w.cost == allowed);
        if bold {
            return self.linearise(trial, None).ok().filter(better);
        }
        self.fresh = false;
        self.evaluator.evaluate(trial, Want::Response).ok()?;
        let weights = self.weigh(trial);
        if !better(&weights) {
            return None;
        }
        self.linearise(trial, Some(weights)).ok()
    }

    /// What a trial must gain at least.
    fn least_gain(&self, trial: &[f64]) -> f64 {
        let (lower, upper) = (&self.unknowns.lower, &self.unknowns.upper);
        let lands = |j: usize| trial[j] != self.values[j] && (trial[j] == lower[j] || trial[j] == upper[j]);
        if !(0..trial.len()).any(lands) || self.largest_in_errors() <= 1.0 {
            return 0.0;
        }
        let promise = self.quadratic.reduction(&self.step);
        if promise > 1.0 && promise.is_finite() { LANDING * promise } else { 0.0 }
    }

    fn damp_more(&mut self, factor: f64) {
        self.damping = if self.damping > 0.0 { self.damping * factor } else { self.level };
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

    /// Makes the last, tiny correction; its sensitivities are those of the point before.
    pub(in crate::estimate) fn finish(&mut self) {
        if !self.set_trial() || self.evaluator.evaluate(&self.trial, Want::Response).is_err() {
            return;
        }
        let weights = self.weigh(&self.trial);
        if weights.cost <= self.weights.cost + self.weights.rounding {
            self.evaluator.keep();
            std::mem::swap(&mut self.values, &mut self.trial);
            self.weights = weights;
        }
    }
}
