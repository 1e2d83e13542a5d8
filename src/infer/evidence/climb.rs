//! The way to the greatest evidence of a hypothesis: Gauss-Newton steps by its own noise, and by white noise before, where that hides the way.

use crate::evidence::question::Evidence;

/// Gauss-Newton steps, and the promised gain (nats) at which none is worth making.
const STEPS: usize = 12;
pub(crate) const SETTLED: f64 = 0.025;
/// Promised gain (nats of white noise) at which a plain fit is near enough.
const PLAINLY: f64 = 0.5;
/// Parts of a step that are tried, and the promised gain up to which the first that helps is taken.
const PARTS: [f64; 4] = [1.0, 0.5, 0.2, 0.05];
const NEAR: f64 = 2.0;

/// What is judged: its evidence as it stands, and beside what a step would gain.
pub(crate) trait Judgement {
    fn evidence(&self) -> &Evidence;
    fn log(&self) -> f64;
}

/// Hypotheses that can be judged and moved.
pub(crate) trait Climb {
    type Point: Clone;
    type Judged: Judgement;

    /// The evidence of a point, its noise begun at these weights; none where it has no response.
    fn judge(&self, point: &Self::Point, weights: Option<&[f64]>) -> Option<Self::Judged>;

    /// The step of a plain fit, each output's errors alike at all frequencies, with its weights.
    fn plain_step(&self, point: &Self::Point) -> Option<Evidence>;

    /// A part of the step that evidence proposes, within bounds.
    fn moved(&self, point: &Self::Point, evidence: &Evidence, part: f64) -> Self::Point;

    /// Weighted squares of what a point leaves; infinite where it has no response.
    fn weighted(&self, point: &Self::Point, weights: &[f64]) -> f64;

    fn goes_on(&self) -> bool;

    /// The part of a step that leaves least, or the first that helps where little is promised; none where no part helps.
    fn stepped(&self, point: &Self::Point, evidence: &Evidence) -> Option<Self::Point> {
        let before = self.weighted(point, &evidence.weights);
        let mut best: Option<(f64, Self::Point)> = None;
        for part in PARTS {
            let trial = self.moved(point, evidence, part);
            let cost = self.weighted(&trial, &evidence.weights);
            let least = best.as_ref().map_or(f64::INFINITY, |(least, _)| *least);
            if cost > least && least < before {
                break;
            }
            if cost < least {
                best = Some((cost, trial));
            }
            if evidence.gain < NEAR && cost < before {
                break;
            }
        }
        best.filter(|(cost, _)| *cost < before).map(|(_, next)| next)
    }

    /// A point after a few steps of a plain fit: where a phase is off by periods, or the fit was led astray, the noise that is found beside it hides the way.
    fn plainly(&self, mut point: Self::Point) -> Option<Self::Point> {
        for _ in 0..STEPS {
            if !self.goes_on() {
                break;
            }
            let step = self.plain_step(&point)?;
            match self.stepped(&point, &step).filter(|_| step.gain >= PLAINLY) {
                Some(next) => point = next,
                None => break,
            }
        }
        Some(point)
    }

    /// A point fitted by its own noise, with the greatest evidence on the way; none where it has no response.
    fn climbed(&self, mut point: Self::Point, weights: Option<&[f64]>) -> Option<(Self::Point, Self::Judged)> {
        let mut judged = self.judge(&point, weights)?;
        let mut best: Option<(Self::Point, Self::Judged)> = None;
        for _ in 0..STEPS {
            if judged.evidence().gain < SETTLED || !self.goes_on() {
                break;
            }
            let Some(next) = self.stepped(&point, judged.evidence()) else { break };
            let Some(found) = self.judge(&next, Some(&judged.evidence().weights)) else { break };
            if best.as_ref().is_none_or(|(_, b)| judged.log() > b.log()) {
                best = Some((point, judged));
            }
            (point, judged) = (next, found);
        }
        match best {
            Some(best) if best.1.log() > judged.log() => Some(best),
            _ => Some((point, judged)),
        }
    }
}
