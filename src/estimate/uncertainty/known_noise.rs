//! Standard errors where the noise of every number is known from another source than the residuals, correlations among them.

use super::sandwich::{Corrected, Ended, Sandwich, Uncorrected};
use crate::problem::response::{KnownNoise, RunResponse};
use crate::problem::unknowns::Unknowns;
use crate::problem::{Problem, ProblemRun};

/// Corrects the covariance of a bound at `values`; of all runs the noise is known, and all have one output.
///
/// # Errors
/// [`Uncorrected`] when that is not possible.
pub(super) fn corrected_known(problem: &mut Problem<'_>, ended: &Ended<'_>) -> Result<Corrected, Uncorrected> {
    let Ended { sandwich, noise, values, .. } = *ended;
    let Sandwich { unknowns, bound } = sandwich;
    let (mut middles, mut sizes) = (Vec::new(), (0.0, 0.0, 0));
    for (r, run) in problem.runs.iter_mut().enumerate() {
        let theta = unknowns.assembled(r, values);
        let weight = |scale: f64| if scale > 0.0 { 1.0 / (scale * noise.covariance[0]) } else { 0.0 };
        let weights: Vec<f64> = sandwich.scale(r).into_iter().map(weight).collect();
        middles.push(middle(run, unknowns, &theta, &weights, &mut sizes)?);
    }
    let (found, expected, count) = sizes;
    let freedom = (count as f64 - bound.inverse.chosen.len() as f64).max(1.0) / count as f64;
    let growth = (found / (expected * freedom)).max(1.0);
    middles.iter_mut().flatten().for_each(|v| *v *= growth);
    let covariance = sandwich.covariance(&middles, &ended.prior());
    if covariance.iter().all(|v| v.is_finite()) { Ok(Corrected::of(covariance)) } else { Err(Uncorrected::NotFinite) }
}

/// `sum_ij s_i Rvv(i, j) s_j'` of one run, its columns multiplied by their weights (square). Adds up the squares of residuals and deviations, and
/// their number.
fn middle(
    run: &mut ProblemRun<'_>,
    unknowns: &Unknowns,
    theta: &[f64],
    weights: &[f64],
    sizes: &mut (f64, f64, usize),
) -> Result<Vec<f64>, Uncorrected> {
    let RunResponse::KnownNoise(response) = &mut run.response else { return Err(Uncorrected::NotFinite) };
    let width = weights.len();
    let mut rows = vec![0.0; response.samples() * width];
    let measured = &run.measured;
    let streamed = response.sensitivities(theta, &unknowns.columns, &mut |block| {
        for sample in 0..block.samples() {
            sizes.0 += block.residual(measured, sample, 0).powi(2);
            let row = &mut rows[(block.first + sample) * width..][..width];
            for (c, value) in block.layout.outputs[0].columns.iter().zip(block.row(sample, 0)) {
                row[*c as usize] = value * weights[*c as usize];
            }
        }
    });
    streamed.map_err(|_| Uncorrected::NotFinite)?;
    let KnownNoise { deviations, correlations } = response.noise();
    sizes.1 += deviations.iter().map(|d| d * d).sum::<f64>();
    sizes.2 += deviations.len();
    let mut middle = vec![0.0; width * width];
    let mut add = |i: usize, j: usize, covariance: f64| {
        let (left, right) = (&rows[i * width..][..width], &rows[j * width..][..width]);
        for (to, left) in middle.chunks_exact_mut(width).zip(left) {
            to.iter_mut().zip(right).for_each(|(to, right)| *to += covariance * left * right);
        }
    };
    deviations.iter().enumerate().for_each(|(i, d)| add(i, i, d * d));
    for (i, j, correlation) in correlations {
        let (i, j) = (*i as usize, *j as usize);
        let covariance = correlation * deviations[i] * deviations[j];
        add(i, j, covariance);
        add(j, i, covariance);
    }
    Ok(middle)
}
