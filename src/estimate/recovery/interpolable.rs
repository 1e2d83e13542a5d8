//! Outputs that the model can pass through: beside a variance of its own for each the likelihood then has no maximum, whatever was found.
//!
//! An iteration may end where every output keeps a noise though the likelihood grows without end elsewhere; which of the two is entered depends on the start.
//! Values in general position are met only by as many unknowns as there are values, so that nothing is asked of longer records. Otherwise the deviation of an
//! output is lowered by decades, which is a walk along the profile of the likelihood, and the noise is set free again where the walk has led. What is found
//! there counts where it is likelier.

use crate::estimation::estimate::{Estimate, Status};
use crate::methods::output_error::attempt::Attempt;
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::{FitOptions, SharedSteps};
use crate::methods::output_error::single::single_fit;
use crate::problem::Options;
use crate::problem::degenerate::Degeneracy;
use crate::problem::noise::Noise;
use crate::recovery::multi_start::is_likelier;

/// Decades of a deviation. Each gains 2.3 of the logarithm of the likelihood for every sample that is met (ln 10), so that three tell which way the profile
/// goes, and are far from rounding.
const DECADES: i32 = 3;

/// The fit, unless the likelihood is greater elsewhere: then one that begins there, or why there is no maximum.
///
/// # Errors
/// [`FitError`], as any fit.
pub(crate) fn unless_interpolable(fit: Fit, attempt: &Attempt<'_>) -> Result<Fit, FitError> {
    let attempt = &Attempt { model: &fit.model, ..*attempt };
    let outputs = interpolable(&fit, attempt.options);
    let Some(cost) = fit.estimate.cost.filter(|_| !outputs.is_empty()) else { return Ok(fit) };
    attempt.work.doing("looking for outputs that the model can pass through");
    let walk = Walk::new(&fit, attempt);
    let mut best: Option<(usize, Fit)> = None;
    for output in outputs {
        let least = best.as_ref().and_then(|(_, found)| found.estimate.cost).unwrap_or(cost);
        best = walk.along(output, least)?.map(|found| (output, found)).or(best);
    }
    let Some((output, found)) = best else { return Ok(fit) };
    if has_maximum(&found.estimate) {
        let from = attempt.reached(&found.estimate);
        let better = single_fit(&Attempt { starts: &from, ..*attempt })?;
        if better.is_better_than(&fit) {
            return Ok(Fit { fallback: fit.fallback, substituted: fit.substituted, ..better });
        }
    }
    let gain = found.estimate.cost.map_or(0.0, |least| cost - least);
    let samples = compared(&fit, output);
    let output = fit.model.definition().outputs[output].quantity.name.clone();
    let mut fit = fit;
    fit.estimate.degenerate = vec![Degeneracy::Elsewhere { output, samples, gain }];
    Ok(fit)
}

/// Whether an estimate is at a maximum of the likelihood.
fn has_maximum(estimate: &Estimate) -> bool {
    estimate.termination.is_good() && estimate.degenerate.is_empty() && estimate.noise_free.is_empty()
}

/// The outputs whose noise is estimated from no more samples than there are unknowns, where their weight decides anything: an output that determines not even
/// one unknown may have any.
fn interpolable(fit: &Fit, options: &FitOptions) -> Vec<usize> {
    let estimate = &fit.estimate;
    // nodes of smooth tables follow each other: they are fewer unknowns than they are many
    let plain = fit.loss.is_squares() && fit.noise_of_samples.is_empty() && estimate.smoothing.is_empty();
    let whole = fit.shooting.as_ref().is_none_or(|s| s.polished);
    let wanted = options.options.iterations > 0 && !options.bare;
    if !(wanted && plain && whole && has_maximum(estimate)) {
        return Vec::new();
    }
    let moved = |status: Status| !matches!(status, Status::Fixed | Status::Derived | Status::Tied);
    let unknowns = estimate.parameters.iter().filter(|p| moved(p.status)).count();
    let known = fit.model.definition().params.iter().any(|p| !p.fixed && p.prior.is_some());
    let counts: Vec<usize> = (0..fit.model.layout().outputs).map(|o| compared(fit, o)).collect();
    let alone = !known && counts.iter().filter(|n| **n > 0).count() < 2;
    let estimated = |o: usize| match &options.options.noise {
        Noise::Diagonal => true,
        Noise::Full => false,
        Noise::Given(given) => given[o].is_none(),
    };
    let followed = |o: usize| estimate.leverages.get(o).is_some_and(|followed| *followed >= 1.0);
    let asked = |o: &usize| (1..=unknowns).contains(&counts[*o]) && estimated(*o) && followed(*o);
    (0..counts.len()).filter(|o| !alone && asked(o)).collect()
}

/// Compared samples of an output in all runs.
fn compared(fit: &Fit, output: usize) -> usize {
    let q = fit.model.layout().outputs;
    fit.estimate.outputs.iter().skip(output).step_by(q).map(|o| o.compared).sum()
}

/// Root mean square of the residuals of an output in all runs.
fn deviation(estimate: &Estimate, output: usize, q: usize) -> f64 {
    let own = || estimate.outputs.iter().skip(output).step_by(q).filter_map(|o| Some((o.rms?, o.compared as f64)));
    let (squares, samples) = own().fold((0.0, 0.0), |(s, n), (rms, of)| (s + rms * rms * of, n + of));
    (squares / f64::max(samples, 1.0)).sqrt()
}

/// Fits along the profile of an output's deviation.
struct Walk<'w> {
    fit: &'w Fit,
    attempt: &'w Attempt<'w>,
    options: FitOptions,
}

impl<'w> Walk<'w> {
    fn new(fit: &'w Fit, attempt: &'w Attempt<'w>) -> Self {
        let options = attempt.options;
        let inner = Options { colour: false, ..options.options.clone() };
        let shared_steps = SharedSteps::of(fit.integration.clone()).provisional();
        let options = FitOptions { options: inner, shared_steps, bare: true, ..options.clone() };
        Self { fit, attempt, options }
    }

    /// The likeliest fit with free noise that is likelier than `least` says, from places that this output determines; none where there is none.
    fn along(&self, output: usize, least: f64) -> Result<Option<Fit>, FitError> {
        let q = self.fit.model.layout().outputs;
        let (mut from, mut least, mut best) = (self.attempt.reached(&self.fit.estimate), least, None);
        let mut deviation_now = deviation(&self.fit.estimate, output, q);
        for _ in 0..DECADES {
            deviation_now /= 10.0;
            if !self.attempt.work.goes_on() || deviation_now <= 0.0 {
                break;
            }
            let held = self.fitted(&from, Some((output, deviation_now)))?;
            if held.estimate.cost.is_none() {
                break;
            }
            from = Attempt { starts: &from, ..*self.attempt }.reached(&held.estimate);
            let free = self.fitted(&from, None)?;
            if let Some(cost) = free.estimate.cost.filter(|cost| is_likelier(*cost, least)) {
                (least, best) = (cost, Some(free));
            }
            // residuals that are nearer to the deviation before will not follow a smaller one either
            if deviation(&held.estimate, output, q) > deviation_now * 10f64.sqrt() {
                break;
            }
        }
        Ok(best)
    }

    /// A fit with the deviation of one output held, or with the noise that was asked for.
    fn fitted(&self, from: &[Vec<f64>], held: Option<(usize, f64)>) -> Result<Fit, FitError> {
        let mut options = self.options.clone();
        if let Some((output, deviation)) = held {
            let mut given = match &options.options.noise {
                Noise::Given(given) => given.clone(),
                _ => vec![None; self.fit.model.layout().outputs],
            };
            given[output] = Some(deviation);
            options.options.noise = Noise::Given(given);
        }
        let work = &self.attempt.work.quiet();
        single_fit(&Attempt { starts: from, options: &options, work, ..*self.attempt })
    }
}
