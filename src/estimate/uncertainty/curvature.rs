//! Whether an interval that is even about an estimate holds: the profile of the likelihood at its ends (Bates and Watts 1988, chapter 6).
//!
//! With a parameter held at an end of its interval and all others at their best values there, twice the gain of the likelihood is the square of the end's
//! distance in standard errors, were the response linear. What it is instead says with which probability the true value lies inside, and where the ends
//! would be. The others are refitted by one Gauss-Newton step from where the information says they follow. Two parameters are looked at: the one whose error
//! its partners inflate most, and the one that is known worst beside its value.

use super::cramer_rao::CramerRao;
use crate::iteration::likelihood::LikelihoodSteps;
use crate::uncertainty::parameters::quantile;
use fdm_numeric::elementary::exp;
use fdm_numeric::least_squares::Problem as _;
use fdm_numeric::quadratic::Quadratic;
use fdm_numeric::statistics::normal_cdf;
use serde::{Deserialize, Serialize};

/// Probability below which an interval that is called one of 95 % is said to hold less often: what coverage studies take for 95 % begins there.
const HOLDS: f64 = 0.93;
/// Part of a parameter in an undetermined direction above which it is not determined.
const PART: f64 = 1e-4;
/// Standard errors to which a profile is followed, in those of the interval.
const FURTHEST: f64 = 2.5;
/// Steps on the way there.
const STEPS: usize = 500;

/// An interval about an estimate that does not hold in 95 of 100 cases.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Curvature {
    /// The parameter.
    pub parameter: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Probability with which the interval by the Cramer-Rao error holds the true value.
    pub holds: f64,
    /// Ends of the interval by the profile of the likelihood; none where it does not end within five standard errors.
    pub interval: [Option<f64>; 2],
}

/// The interval of an unknown that the profile of the likelihood contradicts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Curved {
    pub(crate) unknown: usize,
    pub(crate) holds: f64,
    pub(crate) interval: [Option<f64>; 2],
}

/// The intervals that do not hold, of the two parameters that are most likely not to. `logarithmic` says which unknowns have intervals that are even in
/// their logarithm. Takes four responses with sensitivities at most.
pub(crate) fn curved(
    steps: &mut LikelihoodSteps<'_, '_, '_>,
    bound: &CramerRao,
    logarithmic: impl Fn(usize) -> bool,
) -> Vec<Curved> {
    if bound.noise.is_none() {
        return Vec::new();
    }
    let mut found = Vec::new();
    for place in looked_at(&steps.values, bound) {
        let unknown = bound.inverse.chosen[place];
        let line = Line { place, logarithmic: logarithmic(unknown) };
        let end = quantile(None);
        let [low, high] = [-end, end].map(|t| line.distance(steps, bound, t));
        let holds = normal_cdf(high.unwrap_or(end)) - normal_cdf(-low.unwrap_or(end));
        if holds < HOLDS {
            let (low, high) = (low.unwrap_or(end), high.unwrap_or(end));
            let ends = ends(low, high, end);
            let at = |t: f64| line.value(&steps.values, bound, t);
            found.push(Curved { unknown, holds, interval: [ends[0].map(at), ends[1].map(at)] });
        }
    }
    found
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

/// How all unknowns go with one.
struct Line {
    place: usize,
    logarithmic: bool,
}

impl Line {
    /// The parameter, so many standard errors from its estimate.
    fn value(&self, values: &[f64], bound: &CramerRao, t: f64) -> f64 {
        let (n, j) = (bound.inverse.chosen.len(), bound.inverse.chosen[self.place]);
        let error = bound.inverse.values[self.place * n + self.place].sqrt() / bound.scale[j];
        match self.logarithmic && values[j] > 0.0 {
            true => values[j] * exp(t * error / values[j]),
            false => values[j] + t * error,
        }
    }

    /// The root of twice what the likelihood loses there, all others at their best values; infinite where there is no response, none beyond a bound.
    fn distance(&self, steps: &mut LikelihoodSteps<'_, '_, '_>, bound: &CramerRao, t: f64) -> Option<f64> {
        let inverse = &bound.inverse;
        let (n, own) = (inverse.chosen.len(), inverse.chosen[self.place]);
        let row = &inverse.values[self.place * n..][..n];
        let unknowns = steps.problem.unknowns;
        let inside = |j: usize, v: f64| unknowns.lower[j] < v && v < unknowns.upper[j];
        let mut there = steps.values.clone();
        for (covariance, j) in row.iter().zip(&inverse.chosen).filter(|(_, j)| bound.inside[**j]) {
            let moved = there[*j] + t * covariance / row[self.place].sqrt() / bound.scale[*j];
            there[*j] = moved.max(unknowns.lower[*j]).min(unknowns.upper[*j]);
        }
        there[own] = self.value(&steps.values, bound, t);
        if !inside(own, there[own]) {
            return None;
        }
        let base = steps.cost();
        let Ok(weights) = steps.problem.linearise(&there, None) else { return Some(f64::INFINITY) };
        let cost = steps.problem.cost(&weights);
        let mut quadratic = Quadratic::default();
        steps.problem.gather(&there, &weights, &mut quadratic);
        if !cost.is_finite() || !quadratic.is_finite() {
            return Some(f64::INFINITY);
        }
        let others = inverse.chosen.iter().copied().filter(|j| *j != own && inside(*j, there[*j]));
        let others: Vec<usize> = others.filter(|j| quadratic.scale[*j] > 0.0).collect();
        let mut step = vec![0.0; there.len()];
        // a parameter alone has nothing to follow it
        let gained = if !others.is_empty() && quadratic.solve(&others, 0.0, &mut step) {
            quadratic.reduction(&step).max(0.0)
        } else {
            0.0
        };
        Some((2.0 * (cost - gained - base).max(0.0)).sqrt())
    }
}

/// Where the distance is that of the interval, in standard errors: a cubic of slope 1 at the estimate through both ends, which lie at `low` and `high`.
fn ends(low: f64, high: f64, end: f64) -> [Option<f64>; 2] {
    if !(low.is_finite() && high.is_finite()) {
        return [None, None];
    }
    let (square, cube) = ((high - low) / (2.0 * end * end), (0.5 * (high + low) - end) / (end * end * end));
    let distance = |t: f64| t + square * t * t + cube * t * t * t;
    let side = |sign: f64| {
        let at = |k: usize| sign * FURTHEST * end * k as f64 / STEPS as f64;
        (1..=STEPS).map(at).find(|t| sign * distance(*t) >= end)
    };
    [side(-1.0), side(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_where_the_distance_is_that_of_the_interval() {
        let near = |found: Option<f64>, want: f64| found.is_some_and(|t| (t - want).abs() < 0.02);
        let straight = ends(2.0, 2.0, 2.0);
        assert!(near(straight[0], -2.0) && near(straight[1], 2.0), "{straight:?}");
        // t - 0.15 t^2 is -2.6 at -2 and 1.4 at 2, and never 2
        let bent = ends(2.6, 1.4, 2.0);
        assert!(near(bent[0], (1.0 - 2.2_f64.sqrt()) / 0.3) && bent[1].is_none(), "{bent:?}");
    }
}
