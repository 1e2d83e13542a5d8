//! The Cramer-Rao bound at the final estimates: inverse of Fisher's information `S' R^-1 S`, its rank, and the noise with a correction for the degrees of
//! freedom that fitting took (Maine and Iliff, NASA RP-1168, 1986).
//!
//! Leverage: how much of each output's samples the estimates follow. The sum over an output's samples, the trace of its part of the hat
//! matrix, is the number of parameters that it determines; its samples less that are what is left to tell its noise.

use crate::iteration::likelihood::LikelihoodSteps;
use crate::iteration::sums::{Group, Sums};
use crate::problem::noise::Weights;
use crate::problem::unknowns::Unknowns;
use crate::uncertainty::bounds::{Held, opened};
use fdm_numeric::least_squares::ACCURATE;
use fdm_numeric::quadratic::Inverse;

/// The bound, in scaled unknowns.
#[derive(Debug, Clone)]
pub(crate) struct CramerRao {
    /// Column norms of all unknowns; 0 without influence.
    pub(crate) scale: Vec<f64>,
    /// Whether each unknown is strictly within its bounds.
    pub(crate) inside: Vec<bool>,
    /// Covariance in scaled unknowns, and what is not determined; those in `held` as if they had no bounds.
    pub(crate) inverse: Inverse,
    /// Parameters at their bounds about which the data say as much as about all others.
    pub(crate) held: Vec<Held>,
    /// Noise corrected for degrees of freedom; none when there are none left.
    pub(crate) noise: Option<Weights>,
    /// For each output its independent compared samples where its noise is estimated; none where it is known.
    pub(crate) samples: Vec<Option<f64>>,
    /// Of each output (q) the sum of the leverages of its samples; empty where they are not those of samples.
    pub(crate) leverages: Vec<f64>,
    /// Scale and inverse without the priors, when there are any: what the data do not determine by themselves.
    pub(crate) without_priors: Option<(Vec<f64>, Inverse)>,
}

/// Information and noise at the final estimates; none when there is nothing to be reported.
pub(crate) fn conclude(steps: &mut LikelihoodSteps<'_, '_, '_>) -> Option<CramerRao> {
    let values = steps.values.clone();
    if values.is_empty() {
        return None;
    }
    if !steps.fresh {
        steps.linearise(&values, Some(steps.weights.clone())).ok()?;
        steps.settle();
    }
    if steps.inverse.condition > ACCURATE || !steps.problem.priors.is_empty() {
        steps.refine();
    }
    steps.gather();
    if !steps.quadratic.is_finite() {
        return None;
    }
    let unknowns = steps.problem.unknowns;
    let bounds = unknowns.lower.iter().zip(&unknowns.upper);
    let inside: Vec<bool> = values.iter().zip(bounds).map(|(v, (lo, hi))| lo < v && v < hi).collect();
    let chosen: Vec<usize> = (0..values.len()).filter(|j| inside[*j] && steps.quadratic.scale[*j] > 0.0).collect();
    let moved = chosen.len();
    let mut inverse = steps.quadratic.invert(chosen, Inverse::default())?;
    let known = known_before(steps, &inverse);
    let likelihood = steps.problem.likelihood;
    let noise = likelihood.corrected(&steps.weights, (moved - inverse.null.len()) as f64 - known);
    let mut factors = likelihood.factors(&steps.weights);
    if let Some(noise) = &noise {
        factors = if likelihood.is_full() {
            vec![(steps.weights.covariance[0] / noise.covariance[0]).sqrt()]
        } else {
            likelihood.factors(noise)
        };
        steps.problem.gather_with(&values, &factors, steps.problem.priors.rows(&values), &mut steps.quadratic);
        inverse = steps.quadratic.invert(inverse.chosen.clone(), inverse)?;
    }
    let leverages = leverages(steps, &factors, (&steps.quadratic.scale, &inverse));
    let bounds = unknowns.lower.iter().zip(&unknowns.upper).enumerate();
    let at: Vec<(usize, f64, f64)> = bounds
        .filter(|(j, (lower, upper))| !inside[*j] && lower < upper)
        .map(|(j, (lower, upper))| (j, if values[j] <= *lower { 1.0 } else { -1.0 }, upper - lower))
        .collect();
    let (inverse, held) = opened(&mut steps.quadratic, inverse, &at);
    let scale = steps.quadratic.scale.clone();
    let without_priors = by_data_alone(steps, &inside);
    let samples = likelihood.samples_of_outputs();
    Some(CramerRao { scale, inside, inverse, held, noise, samples, leverages, without_priors })
}

/// How many unknowns the priors determine rather than the data: the trace of prior information times covariance.
fn known_before(steps: &LikelihoodSteps<'_, '_, '_>, inverse: &Inverse) -> f64 {
    let covariance = |i, j| inverse.covariance(&steps.quadratic.scale, (i, j));
    steps.problem.priors.rows(&steps.values).map(|row| row.variance(covariance).min(1.0)).sum()
}

/// Scale and inverse as they would be without priors; none when there are no priors.
fn by_data_alone(steps: &mut LikelihoodSteps<'_, '_, '_>, inside: &[bool]) -> Option<(Vec<f64>, Inverse)> {
    if steps.problem.priors.is_empty() {
        return None;
    }
    let factors = steps.problem.likelihood.factors(&steps.weights);
    steps.problem.gather_with(&steps.values, &factors, std::iter::empty(), &mut steps.quadratic);
    let moved = |j: &usize| inside[*j] && steps.quadratic.scale[*j] > 0.0;
    let chosen: Vec<usize> = (0..inside.len()).filter(moved).collect();
    let inverse = steps.quadratic.invert(chosen, Inverse::default())?;
    Some((steps.quadratic.scale.clone(), inverse))
}

/// The sum of the leverages of each output (q), by the sums of the last linearisation. `factors` weigh the outputs, `inverse` with `scale` is the
/// covariance by these weights. With noise that mixes outputs every one of them has the same share.
pub(crate) fn leverages(
    steps: &LikelihoodSteps<'_, '_, '_>,
    factors: &[f64],
    (scale, inverse): (&[f64], &Inverse),
) -> Vec<f64> {
    let cost = &steps.problem;
    let slopes = cost.unknowns.slopes(&steps.values);
    let mut found = vec![0.0; factors.len()];
    for (run, sums) in cost.evaluator.sums().enumerate() {
        for ((group, factor), found) in sums.groups.iter().zip(factors).zip(&mut found) {
            *found += factor * factor * trace(sums, group, (run, cost.unknowns, &slopes), (scale, inverse));
        }
    }
    let outputs = cost.likelihood.counts.len();
    if cost.likelihood.is_full() { vec![found[0] / outputs as f64; outputs] } else { found }
}

/// The trace of the products of one group times the covariance.
fn trace(
    sums: &Sums,
    group: &Group,
    (run, unknowns, slopes): (usize, &Unknowns, &[f64]),
    (scale, inverse): (&[f64], &Inverse),
) -> f64 {
    let places: Vec<usize> = group.columns.iter().map(|c| unknowns.position(run, *c as usize)).collect();
    let slope = |j: usize| slopes.get(j).copied().unwrap_or(1.0);
    let covariance = |a: usize, b: usize| {
        let (i, j) = (places[a], places[b]);
        inverse.covariance(scale, (i, j)) * slope(i) * slope(j)
    };
    let n = places.len();
    let twice = |a: usize, b: usize| if a == b { 1.0 } else { 2.0 };
    if !sums.precise {
        let row = |(a, products): (usize, &[f64])| -> f64 {
            products.iter().zip(a..).map(|(product, b)| twice(a, b) * product * covariance(a, b)).sum()
        };
        return group.rows().map(|(_, _, products, _)| products).enumerate().map(row).sum();
    }
    // rows of a triangle R with R'R the products
    let row = |(k, row): (usize, &[f64])| -> f64 {
        let pairs = (k..n).flat_map(|a| (a..n).map(move |b| (a, b)));
        pairs.map(|(a, b)| twice(a, b) * row[a] * row[b] * covariance(a, b)).sum()
    };
    group.values.chunks(group.width.max(1)).take(n).enumerate().map(row).sum()
}
