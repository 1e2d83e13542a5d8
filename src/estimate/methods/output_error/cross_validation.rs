//! Weights of smooth tables by validation: how well fits of some runs predict the others.

use super::error::FitError;
use super::options::FitOptions;
use super::options::{Attempt, after};
use super::single::single_fit;
use crate::problem::Options;
use crate::problem::method::SmoothBy;
use crate::residuals::compared;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;

/// Decimal logarithms of the factors on the likeliest weights that are compared.
const FACTORS: [f64; 9] = [-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0];

/// The likeliest weights times the factor with which fits predict left-out runs best. Their initial states and biases are
/// those of the fit of all runs. None where no table is smooth or there is no fit; what is wrong then, the fit itself tells.
///
/// # Errors
/// As for [`single_fit`].
pub(crate) fn weights_by_validation(attempt: &Attempt<'_>) -> Result<Option<Vec<f64>>, FitError> {
    let Attempt { model, runs, options, work, .. } = *attempt;
    let by = |smooth_by: SmoothBy| {
        let options_of = Options { smooth_by, colour: false, ..options.options.clone() };
        FitOptions { options: options_of, ..options.clone() }
    };
    let all = single_fit(&Attempt { options: &by(SmoothBy::Likelihood), ..*attempt })?;
    let likeliest: Vec<f64> = all.estimate.smoothing.iter().flat_map(|s| s.weights.iter().copied()).collect();
    let Some(noise) = all.estimate.noise.as_ref().filter(|_| !likeliest.is_empty()) else { return Ok(None) };
    let known = attempt.reached(&all.estimate);
    // parts into which the runs are cut, at most
    let parts = runs.len().min(5);
    let mut best = (f64::INFINITY, likeliest.clone());
    for factor in FACTORS.map(|power| 10f64.powf(power)) {
        let weights: Vec<f64> = likeliest.iter().map(|w| w * factor).collect();
        let mut cost = 0.0;
        for part in 0..parts {
            work.doing("smoothness of tables by validation");
            if !work.goes_on() {
                return Ok(Some(best.1));
            }
            let stays = |k: &usize| k % parts != part;
            let train: Vec<Run> = (0..runs.len()).filter(stays).map(|k| runs[k].clone()).collect();
            let begin: Vec<Vec<f64>> = (0..runs.len()).filter(stays).map(|k| known[k].clone()).collect();
            let by_weights = by(SmoothBy::Weights(weights.clone()));
            let fit = single_fit(&Attempt { runs: &train, starts: &begin, options: &by_weights, ..*attempt })?;
            for k in (0..runs.len()).filter(|k| !stays(k)) {
                let theta = &after(model, &runs[k..=k], &fit.estimate, &known[k..=k])[0];
                let Some(accuracy) = all.integration.get(k) else { continue };
                let simulator = Simulator::new(model.dynamics(), &runs[k], accuracy.steps.clone());
                let mut y = vec![0.0; runs[k].measured.len()];
                let simulated = simulator.map_err(|e| FitError::unsuited(&runs[k], e))?.simulate(theta, &mut y);
                cost +=
                    simulated.map_or(f64::INFINITY, |()| misfit(&runs[k].measured, &y, |o| noise.at(o, o), noise.size));
            }
        }
        if cost < best.0 {
            best = (cost, weights);
        }
    }
    Ok(Some(best.1))
}

/// Half the squares of the residuals over the variances of the outputs' noise.
fn misfit(measured: &[f64], y: &[f64], variance: impl Fn(usize) -> f64, outputs: usize) -> f64 {
    let square = |(k, residual): (usize, f64)| {
        let variance = variance(k % outputs);
        (variance > 0.0).then(|| 0.5 * residual.powi(2) / variance)
    };
    compared(measured, y).filter_map(square).sum()
}
