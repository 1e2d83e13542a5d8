//! A model that holds another: whether its further parameters gain more than chance would.

use super::candidate::Candidate;
use fdm_estimate::Status;
use fdm_numeric::statistics::f_tail;
use serde::{Deserialize, Serialize};

/// Two results of which the richer seems to hold the poorer: it estimates every parameter that the other estimates, and more.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Nesting {
    /// Name of the poorer result.
    pub poorer: String,
    /// Name of the richer result.
    pub richer: String,
    /// Number of further parameters.
    pub further: usize,
    /// Twice the difference of the costs; below zero when the richer fit missed the minimum that the poorer found.
    pub likelihood_ratio: f64,
    /// The F statistic for that, over the inflation by coloured residuals.
    pub f: f64,
    /// Its degrees of freedom: further parameters, and independent samples less parameters.
    pub degrees: (f64, f64),
    /// Probability of a larger one, were the further parameters at the values that the poorer model gives them.
    pub p_value: f64,
}

/// All pairs, the richer behind the poorer. Models are not asked whether they are nested, only the names of what they estimate.
pub(super) fn nestings(candidates: &[Candidate], inflation: Option<f64>) -> Vec<Nesting> {
    let comparable: Vec<&Candidate> = candidates.iter().filter(|c| c.criteria.is_some()).collect();
    let mut found = Vec::new();
    for poorer in &comparable {
        for richer in &comparable {
            found.extend(nesting(poorer, richer, inflation.unwrap_or(1.0)));
        }
    }
    found
}

fn estimated(candidate: &Candidate) -> impl Iterator<Item = (&str, Option<&str>)> {
    let free = candidate.parameters.iter().filter(|p| p.status == Status::Estimated);
    free.map(|p| (p.name.as_str(), p.run.as_deref()))
}

fn nesting(poorer: &Candidate, richer: &Candidate, inflation: f64) -> Option<Nesting> {
    let known: Vec<_> = estimated(richer).collect();
    if richer.unknowns <= poorer.unknowns || !estimated(poorer).all(|p| known.contains(&p)) {
        return None;
    }
    let further = richer.unknowns - poorer.unknowns;
    let likelihood_ratio = 2.0 * (poorer.cost? - richer.cost?);
    let samples = richer.samples as f64;
    let left = (samples / inflation - richer.unknowns as f64).max(1.0);
    // of one output with estimated noise, exp(ratio/N) is the ratio of the sums of squares, and F is that of regression
    let gained = (likelihood_ratio / samples).exp_m1() * (samples - richer.unknowns as f64).max(1.0);
    let f = gained.max(0.0) / further as f64 / inflation;
    let p_value = f_tail(f, [further as f64, left])?;
    let (poorer, richer) = (poorer.name.clone(), richer.name.clone());
    Some(Nesting { poorer, richer, further, likelihood_ratio, f, degrees: (further as f64, left), p_value })
}
