//! Help by other starts: when the iteration ends nowhere, or where the data do not determine the unknowns any more
//! (an exponential that has died out, two rates that have become one), it begins again without projection and from scaled
//! start values. The best end counts.

use super::correction::Correction;
use super::evaluation::RunFailure;
use super::trial;
use crate::estimate::progress::Observer;
use crate::estimate::termination::{Reason, Termination};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Factors on all start values, in the order in which they are tried.
const FACTORS: [f64; 4] = [0.1, 10.0, 0.01, 100.0];
/// Costs that differ by less are those of the same end.
const SAME: f64 = 1e-6;

/// What helped the iteration on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aid {
    /// Parameters in which the response is affine followed the others (variable projection).
    Projection,
    /// The start values once more, without projection.
    WithoutProjection,
    /// All start values times a factor.
    ScaledStart(f64),
}

impl fmt::Display for Aid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Projection => write!(f, "variable projection"),
            Self::WithoutProjection => write!(f, "a second try without projection"),
            Self::ScaledStart(factor) => write!(f, "start values times {factor}"),
        }
    }
}

/// Where an attempt ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(in crate::estimate) struct End {
    values: Vec<f64>,
    cost: f64,
    /// How many directions the data do not determine there.
    lost: usize,
    termination: Termination,
}

impl End {
    fn is_good(&self) -> bool {
        self.termination.is_good() && self.lost == 0
    }

    fn is_like(&self, other: &Self) -> bool {
        self.lost == other.lost && (self.cost - other.cost).abs() <= SAME * (1.0 + other.cost.abs())
    }

    /// Determined ends before others, then the lower cost; the earlier of two alike.
    fn beats(&self, other: &Self) -> bool {
        (self.is_good() && !other.is_good())
            || (self.is_good() == other.is_good() && self.cost < other.cost && !self.is_like(other))
    }
}

/// What has been tried so far.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(in crate::estimate) struct Attempts {
    /// The best end so far.
    best: Option<End>,
    /// How many factors were used.
    factors: usize,
    /// Whether the current attempt does without projection.
    pub(in crate::estimate) unprojected: bool,
    /// Whether the current attempt was projected at any time.
    pub(in crate::estimate) projected: bool,
    /// The aids that the current attempt had.
    aids: Vec<Aid>,
    /// Those of the best end.
    best_aids: Vec<Aid>,
}

impl Correction<'_, '_, '_> {
    /// Notes that the attempt in hand projects.
    pub(in crate::estimate) fn note_projection(&mut self) {
        if !std::mem::replace(&mut self.attempts.projected, true) {
            self.attempts.aids.push(Aid::Projection);
        }
    }

    /// The aids of what is reported.
    pub(in crate::estimate) fn aids(&mut self) -> Vec<Aid> {
        std::mem::take(&mut self.attempts.aids)
    }

    /// Looks at the end of an attempt: none when another one has begun, else how the estimation ends, with the best
    /// estimates in place.
    pub(in crate::estimate) fn judge(
        &mut self,
        termination: Termination,
        observer: &mut dyn Observer,
    ) -> Result<Option<Termination>, RunFailure> {
        let interrupted = termination == Termination::Interrupted;
        let hopeless = matches!(termination, Termination::Interrupted | Termination::IterationLimit);
        let lost = self.lost();
        // a small correction has been made since the slope was known, and was solved for to make it vanish
        let unproven = matches!(termination, Termination::Converged(reason) if reason != Reason::SmallCorrection);
        let termination = if unproven && !self.is_stationary() { Termination::NoProgress } else { termination };
        let end = End { values: self.values.clone(), cost: self.weights.cost, lost, termination };
        if (end.is_good() || hopeless) && self.attempts.best.is_none() {
            return Ok(Some(end.termination));
        }
        let repeated = self.attempts.best.as_ref().is_some_and(|best| end.is_like(best));
        let over = end.is_good() || hopeless || repeated;
        if self.attempts.best.as_ref().is_none_or(|best| end.beats(best)) {
            self.attempts.best = Some(end);
            self.attempts.best_aids = self.attempts.aids.clone();
        }
        if over || self.corrections() >= self.options.iterations || !self.begin_again() {
            let best = self.settle_for_best()?;
            return Ok(Some(if interrupted { Termination::Interrupted } else { best }));
        }
        Ok(self.record_start(observer).then_some(Termination::Interrupted))
    }

    /// How many directions are not determined at the current estimates, as far as can be told.
    fn lost(&mut self) -> usize {
        let values = self.values.clone();
        if !self.fresh && self.linearise(&values, Some(self.weights.clone())).is_ok() {
            self.settle();
        }
        if self.inverse.condition > crate::estimate::errors::conclusion::ACCURATE {
            self.refine();
        }
        let inside = |j: &usize| self.unknowns.lower[*j] < values[*j] && values[*j] < self.unknowns.upper[*j];
        let idle = (0..values.len()).filter(inside).filter(|j| self.quadratic.scale[*j] == 0.0).count();
        idle + self.inverse.null.len()
    }

    /// Goes to the next start that can be simulated; false when there is none left.
    fn begin_again(&mut self) -> bool {
        loop {
            let aid = if self.attempts.projected && !self.attempts.unprojected && self.attempts.factors == 0 {
                self.attempts.unprojected = true;
                Aid::WithoutProjection
            } else {
                let Some(factor) = FACTORS.get(self.attempts.factors) else { return false };
                self.attempts.factors += 1;
                self.attempts.unprojected = false;
                Aid::ScaledStart(*factor)
            };
            self.attempts.projected = false;
            self.attempts.aids = vec![aid];
            let factor = if let Aid::ScaledStart(factor) = aid { factor } else { 1.0 };
            self.reset(factor);
            if self.start().is_ok() {
                return true;
            }
        }
    }

    fn reset(&mut self, factor: f64) {
        let bounds = self.unknowns.lower.iter().zip(&self.unknowns.upper);
        let scaled =
            self.unknowns.start.iter().zip(bounds).map(|(v, (lower, upper))| (v * factor).max(*lower).min(*upper));
        self.values = scaled.collect();
        (self.damping, self.level) = (0.0, trial::DAMPING);
        (self.last, self.promised) = (f64::INFINITY, f64::INFINITY);
        self.secant = Default::default();
        self.projecting = false;
    }

    /// Puts the best estimates back in place.
    fn settle_for_best(&mut self) -> Result<Termination, RunFailure> {
        let Some(best) = self.attempts.best.clone() else { return Ok(Termination::NoProgress) };
        self.attempts.aids = std::mem::take(&mut self.attempts.best_aids);
        if best.values != self.values {
            self.values = best.values;
            self.secant = Default::default();
            self.start()?;
        }
        Ok(best.termination)
    }
}
