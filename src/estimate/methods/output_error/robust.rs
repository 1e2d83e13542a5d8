//! Fits by a robust loss, by pseudo-values.
//!
//! With `psi` the derivative of the loss, c its mean slope and s the scale of an output, the squares of `y + s psi((z - y)/s)/c - response` have their minimum
//! where the loss has it (Huber 1981, section 7.8); the variance of these residuals over the squared sensitivities is that of the estimates (Huber 1981, section
//! 7.6). So each round is a fit of squares to pseudo-values, and the last one has errors that hold whatever the law of the noise, its colour corrected for.
//! While the rounds move far, c is the steepest slope: then no round leads uphill.

use super::error::{FitError, StrategyError};
use super::fit::Fit;
use super::loss::Loss;
use super::options::Attempt;
use super::options::FitOptions;
use crate::estimation::solve::estimate;
use crate::estimation::{Estimate, ParameterEstimate, RunFit, matches};
use crate::problem::noise::Noise;
use crate::problem::{Options, Problem};
use crate::work::Termination;
use fdm_system::record::Run;
use fdm_system::simulate::Steps;
use std::f64::consts::TAU;

/// Most rounds.
const ROUNDS: usize = 60;
/// Step in standard errors that ends the rounds.
const SETTLED: f64 = 1e-6;
/// The one below which the rounds no longer move far.
const NEAR: f64 = 0.3;
/// Median of the absolute values of a standard normal deviate.
const MEDIAN: f64 = 0.674_489_750_196_081_7;

/// A fit by the loss that was asked for, from the estimates of `first`.
///
/// # Errors
/// [`FitError`], as any fit; a loss that cannot be followed.
pub(crate) fn fit_robust(attempt: &Attempt<'_>, first: Fit) -> Result<Fit, FitError> {
    let Attempt { model, runs, options, .. } = *attempt;
    let loss = options.loss;
    let q = model.definition().outputs.len();
    let mut fit = Fit { loss, ..first };
    let known = |o: usize| match &options.options.noise {
        Noise::Given(given) => given[o],
        _ => None,
    };
    let mut scales: Vec<f64> =
        (0..q).map(|o| known(o).unwrap_or_else(|| median(&residuals(&fit.estimate, o, q)))).collect();
    let mut near = false;
    for round in 0..ROUNDS {
        let last = round + 1 == ROUNDS;
        for (o, scale) in scales.iter_mut().enumerate().filter(|(o, _)| known(*o).is_none()) {
            let left = residuals(&fit.estimate, o, q);
            *scale = (0..20).fold(*scale, |scale, _| loss.scale(&left, scale));
        }
        let slopes: Vec<f64> = (0..q).map(|o| slope(loss, &residuals(&fit.estimate, o, q), scales[o], near)).collect();
        let pseudo = |run: &RunFit| pseudo_values(loss, run, (&scales, &slopes), q);
        let values: Vec<Vec<f64>> = fit.estimate.runs.iter().map(pseudo).collect();
        let fitting = Fitting { from: Attempt { starts: &attempt.reached(&fit.estimate), ..*attempt }, fit: &fit };
        let plain = Options { noise: Noise::Diagonal, colour: false, ..options.options.clone() };
        let mut found = fitting.estimate(&values, &plain)?;
        if !found.termination.is_good() {
            fit.estimate = with_own(found, runs, (loss, &scales), q);
            return Ok(fit);
        }
        let moved = moved(&fit.estimate, &found);
        let settled = near && moved < SETTLED;
        if settled || last {
            // once more with everything that is told of a result
            let full = Options { noise: Noise::Diagonal, ..options.options.clone() };
            found = fitting.estimate(&values, &full)?;
            if !settled {
                found.termination = Termination::IterationLimit;
            }
        }
        fit.estimate = with_own(found, runs, (loss, &scales), q);
        if settled {
            break;
        }
        near = moved < NEAR;
    }
    Ok(fit)
}

/// What is wrong with a loss beside other choices, if anything.
pub(crate) fn mistake(options: &FitOptions, noise_is_modelled: bool) -> Option<StrategyError> {
    match options.loss {
        _ if (options.confidence || options.reweight) && (noise_is_modelled || !options.loss.is_squares()) => {
            Some(StrategyError::ConfidenceOfOwnNoise)
        }
        Loss::Squares => None,
        _ if noise_is_modelled => Some(StrategyError::LossOfNoiseModel),
        _ if options.options.noise == Noise::Full => Some(StrategyError::LossOfFullNoise),
        loss => loss.mistake(),
    }
}

struct Fitting<'f> {
    from: Attempt<'f>,
    fit: &'f Fit,
}

impl Fitting<'_> {
    /// Squares of pseudo-values (N by q for each run).
    fn estimate(&self, values: &[Vec<f64>], options: &Options) -> Result<Estimate, FitError> {
        let steps: Vec<Steps> = self.fit.integration.iter().map(|a| a.steps.clone()).collect();
        let mut problem = Problem { bare: false, ..self.from.problem(&steps)? };
        problem.runs.iter_mut().zip(values).for_each(|(run, values)| run.measured.clone_from(values));
        estimate(&mut problem, options, self.from.work).map_err(FitError::Problem)
    }
}

/// The estimate with the residuals of what was measured; its cost is that of the loss.
fn with_own(found: Estimate, runs: &[Run], (loss, scales): (Loss, &[f64]), q: usize) -> Estimate {
    let names: Vec<String> = found.outputs.iter().take(q).map(|output| output.name.clone()).collect();
    let measured = runs.iter().map(|run| (run.name.as_str(), &run.measured[..]));
    let (outputs, own) = matches(&names, measured, found.runs.iter().map(|fit| fit.response.clone()).collect());
    let (mut cost, mut count) = (0.0, 0.0);
    for fit in &own {
        for (k, v) in fit.residuals.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
            cost += loss.cost(v / scales[k % q]) + scales[k % q].ln() + loss.constant();
            count += 1.0;
        }
    }
    // Huber's loss is that of no law
    let is_law = matches!(loss, Loss::Student(_));
    let log_likelihood = found.log_likelihood.filter(|_| is_law).map(|_| -cost - 0.5 * count * TAU.ln());
    Estimate { outputs, runs: own, cost: found.cost.map(|_| cost), log_likelihood, ..found }
}

/// Residuals of an output in all runs, those that there are.
fn residuals(estimate: &Estimate, output: usize, q: usize) -> Vec<f64> {
    let of = |run: &RunFit| run.residuals.iter().skip(output).step_by(q).copied().collect::<Vec<f64>>();
    estimate.runs.iter().flat_map(of).filter(|v| !v.is_nan()).collect()
}

/// The deviation of normal noise with this median size.
fn median(residuals: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().map(|v| v.abs()).collect();
    if sizes.is_empty() {
        return 1.0;
    }
    let middle = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    let largest = residuals.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let deviation = median / MEDIAN;
    // half of the residuals may vanish
    if deviation > 1e-6 * largest { deviation } else { largest.max(f64::MIN_POSITIVE) }
}

fn slope(loss: Loss, residuals: &[f64], scale: f64, near: bool) -> f64 {
    let mean = residuals.iter().map(|v| loss.slope(v / scale)).sum::<f64>() / residuals.len().max(1) as f64;
    // where the mean slope is small, residuals are far from what the loss is for
    if near && mean > 0.1 { mean } else { loss.steepest() }
}

fn pseudo_values(loss: Loss, run: &RunFit, (scales, slopes): (&[f64], &[f64]), q: usize) -> Vec<f64> {
    let value = |(k, (y, v)): (usize, (&f64, &f64))| {
        let (scale, slope) = (scales[k % q], slopes[k % q]);
        if v.is_nan() { f64::NAN } else { y + scale * loss.influence(v / scale) / slope }
    };
    run.response.iter().zip(&run.residuals).enumerate().map(value).collect()
}

/// The largest step of a parameter, in its standard errors.
fn moved(before: &Estimate, after: &Estimate) -> f64 {
    let step = |(a, b): (&ParameterEstimate, &ParameterEstimate)| {
        let error = b.standard_error.filter(|e| *e > 0.0)?;
        Some((b.value - a.value).abs() / error)
    };
    before.parameters.iter().zip(&after.parameters).filter_map(step).fold(0.0, f64::max)
}
