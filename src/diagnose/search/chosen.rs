//! Which candidates are worth a fit.
//!
//! Screening knows what a small step promises. Where much is missing the fitted parameters have moved far to make up for it, and a
//! backlash that gains a hundred nats may promise five: those that come next are then looked at by a correction or two of a joint fit.

use super::beside::Beside;
use super::metric::Metric;
use super::refit::Fitting;
use super::round::{PRICE, Round};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Part of the best promised gain from which a candidate is fitted in any case.
const REACH: f64 = 0.6;
/// Promise, less the price, from which others are glanced at; how many, and how many of these are fitted.
const LARGE: f64 = 5.0;
const GLANCED: usize = 16;
const BEST: usize = 4;

impl Round<'_> {
    /// Candidates to be fitted, between so many; all that can be where everything is asked for.
    pub(super) fn chosen(
        &self,
        count: RangeInclusive<usize>,
        (beside, metric, base): (&Beside, &Metric, &Fitting),
    ) -> Vec<usize> {
        let mut chosen = self.promising(&count);
        if *count.start() >= self.traces.len() {
            return chosen;
        }
        let mut ranked = self.ranked_by_promise(beside);
        let best = ranked.first().map_or(0.0, |(promise, _)| *promise);
        ranked.retain(|(_, t)| !chosen.contains(t));
        if best > LARGE {
            ranked.truncate(GLANCED);
            let glance = |(_, t): &(f64, usize)| Some((self.glance(*t, beside, metric, base)? - self.price(*t), *t));
            ranked = ranked.par_iter().filter_map(glance).collect();
            sort(&mut ranked);
        }
        chosen.extend(ranked.into_iter().take(BEST).map(|(_, t)| t));
        chosen
    }

    /// All candidates by what they promise in a metric, less their price.
    pub(super) fn ranked_by_promise(&self, beside: &Beside) -> Vec<(f64, usize)> {
        let promise = |t: usize| (self.promises(t, beside).first().map_or(0.0, |p| p.gain) - self.price(t), t);
        let mut ranked: Vec<(f64, usize)> = (0..self.traces.len()).into_par_iter().map(promise).collect();
        sort(&mut ranked);
        ranked
    }

    /// What a candidate's parameters cost.
    pub(super) fn price(&self, t: usize) -> f64 {
        PRICE * self.traces[t].attached.cost() as f64
    }

    /// The best by lead, and all whose promise is within reach of the best.
    fn promising(&self, count: &RangeInclusive<usize>) -> Vec<usize> {
        let candidates = &self.screening.candidates;
        let usable = |t: &&usize| candidates[**t].direction.is_some() && candidates[**t].statistic > 0.0;
        let ranked: Vec<usize> = self.screening.ranking.iter().filter(usable).copied().collect();
        let best = ranked.iter().map(|t| candidates[*t].statistic).fold(0.0, f64::max);
        let near = |(k, t): (usize, usize)| (k < *count.start() || candidates[t].statistic > REACH * best).then_some(t);
        ranked.into_iter().enumerate().filter_map(near).take(*count.end()).collect()
    }
}

/// The largest first.
fn sort(ranked: &mut [(f64, usize)]) {
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
}
