//! Leverage: how much of each output's samples the estimates follow. The sum over an output's samples, the trace of its part of the hat
//! matrix, is the number of parameters that it determines; its samples less that are what is left to tell its noise.

use crate::iteration::likelihood::LikelihoodSteps;
use crate::iteration::sums::{Group, Sums};
use crate::problem::unknowns::Unknowns;
use fdm_numeric::quadratic::Inverse;

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
