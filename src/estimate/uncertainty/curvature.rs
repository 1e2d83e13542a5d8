//! Whether an interval that is even about an estimate holds: the profile of the likelihood at its ends (Bates and Watts 1988, chapter 6).
//!
//! With a parameter held at an end of its interval and all others at their best values there, twice the gain of the likelihood is the square of the end's
//! distance in standard errors, were the response linear. What it is instead says with which probability the true value lies inside; where that is not the
//! promised one the profile is followed to its own ends. Where errors are corrected for the colour of the residuals, distances are counted in corrected
//! errors: the likelihood, which takes the noise for white, rises too quickly by the square of the correction. The others are refitted by a few Gauss-Newton
//! steps from where the information says they follow. Two parameters are looked at: the one whose error its partners inflate most, and the one that is
//! known worst beside its value.

use super::cramer_rao::CramerRao;
use super::identifiability::PART;
use super::sandwich::Corrected;
use crate::iteration::likelihood::LikelihoodCost;
use crate::uncertainty::parameters::quantile;
use crate::work::Work;
use fdm_numeric::elementary::{exp, log};
use fdm_numeric::least_squares::Problem as _;
use fdm_numeric::quadratic::Quadratic;
use fdm_numeric::statistics::{Student, normal_tail};
use serde::{Deserialize, Serialize};

/// Probability below which an interval that is called one of 95 % is said to hold less often: what coverage studies take for 95 % begins there.
const HOLDS: f64 = 0.93;
/// Part of the way to an interval's end at which the likelihood ends it already, below which the interval says too little.
const HALF_WAY: f64 = 0.5;
/// Intervals by which a profile is followed beyond its interval, at most: twenty standard errors of known noise.
const FURTHEST: f64 = 10.0;
/// How near to the wanted distance an end is taken, as part of it.
const NEAR: f64 = 0.02;
/// Gauss-Newton steps of the others at one value, and the gain of the likelihood, in nats, below which there is no further one: a hundredth of what an
/// interval of 95 % allows (half the square of 1.96).
const ROUNDS: usize = 3;
const SMALL: f64 = 0.02;
/// Damping where what the others do is not determined without the one that is held, as part of their scaled information.
const DAMPING: f64 = 1e-8;

/// An interval about an estimate that does not hold in 95 of 100 cases, or reaches much further than that needs.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Curvature {
    /// The parameter.
    pub parameter: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Probability with which the interval by the error that is to be trusted holds the true value.
    pub holds: f64,
    /// Ends of the interval by the profile of the likelihood, a bound where that comes first; none where it does not end within twenty standard errors.
    pub interval: [Option<f64>; 2],
}

impl Curvature {
    /// Whether the interval by the error misses the true value too often; it reaches too far otherwise.
    pub fn is_narrow(&self) -> bool {
        self.holds < HOLDS
    }
}

/// The interval of an unknown that the profile of the likelihood contradicts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Curved {
    pub(crate) unknown: usize,
    pub(crate) holds: f64,
    pub(crate) interval: [Option<f64>; 2],
}

/// The likelihood about its maximum, and what is known of the errors there.
pub(crate) struct Neighbourhood<'s, 'c, 'e, 'a> {
    pub(crate) cost: LikelihoodCost<'c, 'e, 'a>,
    /// All unknowns at the maximum.
    pub(crate) values: &'s [f64],
    /// The cost there.
    pub(crate) least: f64,
    pub(crate) bound: &'s CramerRao,
    /// Errors that allow for the colour of the residuals; none where they are not corrected.
    pub(crate) corrected: Option<&'s Corrected>,
}

/// How all unknowns go with one.
struct Line {
    place: usize,
    unknown: usize,
    logarithmic: bool,
    /// Its error to be trusted, and that over the Cramer-Rao error.
    error: f64,
    factor: f64,
    freedom: Option<f64>,
}

/// What one Gauss-Newton step of the others would gain.
struct Refit {
    cost: f64,
    gained: f64,
    /// Unknowns and by how much they move.
    step: Vec<(usize, f64)>,
}

/// One end of the interval by the error, as seen from the estimate.
struct Side {
    /// Below -1, above 1.
    sign: f64,
    /// Errors to the end of the interval, or to the bound where that comes first.
    at: f64,
    /// Errors to the bound.
    bound: f64,
    /// What the likelihood makes of the way to `at`, in errors.
    distance: f64,
}

impl Neighbourhood<'_, '_, '_, '_> {
    /// The intervals that do not hold, or say too little, of the two parameters that are most likely to have such. `logarithmic` says which unknowns have
    /// intervals that are even in their logarithm. Takes four responses where there is none, two of
    /// them with sensitivities.
    pub(crate) fn curved(&mut self, logarithmic: impl Fn(usize) -> bool, work: &Work<'_>) -> Vec<Curved> {
        if self.bound.noise.is_none() {
            return Vec::new();
        }
        let lines: Vec<Line> =
            looked_at(self.values, self.bound).into_iter().map(|k| self.line(k, &logarithmic)).collect();
        let mut found = Vec::new();
        for line in lines.iter().filter(|line| line.error.is_finite() && line.error > 0.0) {
            if !work.goes_on() {
                break;
            }
            found.extend(self.curved_along(line));
        }
        found
    }

    fn line(&self, place: usize, logarithmic: &impl Fn(usize) -> bool) -> Line {
        let (inverse, n) = (&self.bound.inverse, self.bound.inverse.chosen.len());
        let unknown = inverse.chosen[place];
        let diagonal = place * n + place;
        let variance = self.corrected.map_or(inverse.values[diagonal], |c| c.values[diagonal]);
        let freedom = self.corrected.and_then(|c| c.freedom.get(place)).copied().filter(|f| f.is_finite());
        Line {
            place,
            unknown,
            logarithmic: logarithmic(unknown) && self.values[unknown] > 0.0,
            error: variance.sqrt() / self.bound.scale[unknown],
            factor: (variance / inverse.values[diagonal]).sqrt(),
            freedom,
        }
    }

    /// Whether the interval of a parameter holds more or less often than it says.
    fn curved_along(&mut self, line: &Line) -> Option<Curved> {
        let end = quantile(line.freedom);
        let mut sides = [-1.0, 1.0].map(|sign| self.side(line, sign, end));
        if self.is_plain(line, &sides, end) {
            return None;
        }
        for side in &mut sides {
            side.distance = self.distance(line, side, side.at);
        }
        let holds = 1.0 - sides.iter().map(|side| line.missed(side, side.distance)).sum::<f64>();
        if holds >= HOLDS && sides.iter().all(|side| side.distance * HALF_WAY <= end) {
            return None;
        }
        let ends = sides.each_ref().map(|side| self.end(line, side, end));
        let early = |(end, side): (&Option<f64>, &Side)| end.is_some_and(|t| t < HALF_WAY * side.at);
        let value = |(end, side): (&Option<f64>, &Side)| end.map(|t| line.value(self.values, side, t));
        let told = holds < HOLDS || ends.iter().zip(&sides).any(early);
        let [low, high] = [0, 1].map(|k| value((&ends[k], &sides[k])));
        told.then_some(Curved { unknown: line.unknown, holds, interval: [low, high] })
    }

    fn side(&self, line: &Line, sign: f64, end: f64) -> Side {
        let unknowns = self.cost.unknowns;
        let bound = if sign < 0.0 { unknowns.lower[line.unknown] } else { unknowns.upper[line.unknown] };
        let bound = line.errors_to(self.values[line.unknown], bound);
        Side { sign, at: end.min(bound), bound, distance: 0.0 }
    }

    /// Whether the interval holds by far: both ends by their responses, at one of them with sensitivities. What refitting the others gains there is of the
    /// third order of the likelihood and as much on both sides; twice of it is allowed for.
    fn is_plain(&mut self, line: &Line, sides: &[Side; 2], end: f64) -> bool {
        let [below, above] = sides;
        let (there, opposite) = (self.followed(line, above, above.at), self.followed(line, below, below.at));
        let Some(Refit { cost, gained, .. }) = self.refit(line, &there) else { return false };
        let Ok(weights) = self.cost.evaluate(&opposite) else { return false };
        let costs = [self.cost.cost(&weights), cost];
        let distances = |gained: f64| costs.map(|cost| self.errors_of(cost - gained - self.least) / line.factor);
        let missed: f64 = sides.iter().zip(distances(2.0 * gained)).map(|(side, d)| line.missed(side, d)).sum();
        1.0 - missed >= HOLDS && distances(0.0).iter().all(|d| d * HALF_WAY <= end)
    }

    /// How many errors away the likelihood ends the interval; none where that is too far.
    fn end(&mut self, line: &Line, side: &Side, end: f64) -> Option<f64> {
        let farthest = side.bound.min(FURTHEST * end);
        let (mut below, mut above) = ((0.0, 0.0), None);
        let (mut at, mut distance) = (side.at, side.distance);
        // most values of a parameter on the way to an end
        for round in 0..10 {
            if (distance - end).abs() <= NEAR * end {
                return Some(at);
            } else if distance < end {
                if at >= farthest {
                    return (side.bound <= farthest).then_some(side.bound);
                }
                below = (at, distance);
            } else {
                above = Some((at, distance));
            }
            at = match above {
                // by secants, and by halves where these stay on one side
                Some((far, d)) if round % 2 == 0 && d.is_finite() => {
                    below.0 + (far - below.0) * ((end - below.1) / (d - below.1)).clamp(0.05, 0.95)
                }
                Some((far, _)) => 0.5 * (below.0 + far),
                None => (at * (end / distance).clamp(1.2, 2.0)).min(farthest),
            };
            distance = self.distance(line, side, at);
        }
        above.map(|(far, _)| 0.5 * (below.0 + far))
    }

    /// The root of twice what the likelihood loses so many errors from the estimate, all others at their best values, in errors; infinite where there is no
    /// response.
    fn distance(&mut self, line: &Line, side: &Side, at: f64) -> f64 {
        let unknowns = self.cost.unknowns;
        let mut there = self.followed(line, side, at);
        let mut best = f64::INFINITY;
        for _ in 0..ROUNDS {
            let Some(Refit { cost, gained, step }) = self.refit(line, &there) else { break };
            if gained <= SMALL {
                best = best.min(cost - gained);
                break;
            }
            best = best.min(cost);
            for (j, step) in step {
                there[j] = (there[j] + step).clamp(unknowns.lower[j], unknowns.upper[j]);
            }
        }
        self.errors_of(best - self.least) / line.factor
    }

    /// One Gauss-Newton step of all unknowns but one; none where there is no response.
    fn refit(&mut self, line: &Line, there: &[f64]) -> Option<Refit> {
        let unknowns = self.cost.unknowns;
        let weights = self.cost.linearise(there, None).ok()?;
        let cost = self.cost.cost(&weights);
        let mut quadratic = Quadratic::default();
        self.cost.gather(there, &weights, &mut quadratic);
        if !cost.is_finite() || !quadratic.is_finite() {
            return None;
        }
        let inside = |j: &usize| unknowns.lower[*j] < there[*j] && there[*j] < unknowns.upper[*j];
        let others = self.bound.inverse.chosen.iter().copied().filter(|j| *j != line.unknown && inside(j));
        let others: Vec<usize> = others.filter(|j| quadratic.scale[*j] > 0.0).collect();
        let mut step = vec![0.0; there.len()];
        // a parameter alone has nothing to follow it
        let moves = !others.is_empty()
            && (quadratic.solve(&others, 0.0, &mut step) || quadratic.solve(&others, DAMPING, &mut step));
        let gained = if moves { quadratic.reduction(&step).max(0.0) } else { 0.0 };
        Some(Refit { cost, gained, step: others.into_iter().map(|j| (j, step[j] / quadratic.scale[j])).collect() })
    }

    /// All unknowns with one so many errors from its estimate, the others where the information says that they follow.
    fn followed(&self, line: &Line, side: &Side, at: f64) -> Vec<f64> {
        let (inverse, unknowns) = (&self.bound.inverse, self.cost.unknowns);
        let n = inverse.chosen.len();
        let row = &inverse.values[line.place * n..][..n];
        let mut there = self.values.to_vec();
        for (covariance, j) in row.iter().zip(&inverse.chosen).filter(|(_, j)| self.bound.inside[**j]) {
            let errors = side.sign * at * line.factor * covariance / row[line.place].sqrt();
            there[*j] = (there[*j] + errors / self.bound.scale[*j]).clamp(unknowns.lower[*j], unknowns.upper[*j]);
        }
        there[line.unknown] = line.value(self.values, side, at);
        there
    }

    /// Cramer-Rao errors that such a rise of the cost is worth. Where noise is estimated the cost rises by its logarithm, `N/2 log(1 + t^2/(N - p))`.
    fn errors_of(&self, rise: f64) -> f64 {
        let rise = rise.max(0.0);
        let samples: Option<f64> = self.bound.samples.iter().copied().sum();
        let inverse = &self.bound.inverse;
        let taken = (inverse.chosen.len() - inverse.null.len()) as f64;
        match samples.filter(|samples| *samples > taken) {
            Some(samples) => ((samples - taken) * (exp(2.0 * rise / samples) - 1.0)).sqrt(),
            None => (2.0 * rise).sqrt(),
        }
    }
}

impl Line {
    /// Probability that the true value lies beyond an end that is so many errors away: none beyond a bound.
    fn missed(&self, side: &Side, distance: f64) -> f64 {
        if side.at >= side.bound {
            return 0.0;
        }
        match self.freedom.and_then(|f| Student::new(f.max(1.0))) {
            Some(law) => law.tail(distance),
            None => normal_tail(distance),
        }
    }

    /// The parameter so many errors from its estimate.
    fn value(&self, values: &[f64], side: &Side, at: f64) -> f64 {
        let (value, moved) = (values[self.unknown], side.sign * at * self.error);
        if self.logarithmic { value * exp(moved / value) } else { value + moved }
    }

    /// How many errors another value is from the estimate.
    fn errors_to(&self, value: f64, other: f64) -> f64 {
        let apart = if self.logarithmic { value * log(other / value) } else { other - value };
        (apart / self.error).abs()
    }
}

/// Places of the parameter with the most inflated error, and of the one with the largest error beside its value.
fn looked_at(values: &[f64], bound: &CramerRao) -> Vec<usize> {
    let inverse = &bound.inverse;
    let n = inverse.chosen.len();
    let determined = |k: &usize| {
        bound.inside[inverse.chosen[*k]]
            && inverse.values[*k * n + *k] > 0.0
            && inverse.null.iter().all(|v| v[*k].abs() <= PART)
    };
    let inflated = |k: usize| inverse.values[k * n + k];
    let relative = |k: usize| {
        let j = inverse.chosen[k];
        inverse.values[k * n + k].sqrt() / bound.scale[j] / values[j].abs()
    };
    let most = |size: &dyn Fn(usize) -> f64| {
        let all = (0..n).filter(determined).map(|k| (k, size(k))).filter(|(_, s)| s.is_finite());
        all.reduce(|a, b| if b.1 > a.1 { b } else { a }).map(|(k, _)| k)
    };
    let mut places: Vec<usize> = [most(&inflated), most(&relative)].into_iter().flatten().collect();
    places.dedup();
    places
}
