//! Fallback strategies: what is done, in order, when the fit from the start values fails or is doubtful, and what decides that.
//!
//! The strategies are record-length continuation, substitution of measured states, and multiple shooting; one that was asked
//! for is followed without being judged.
//!
//! What follows a fit by squares and noise of one size: the noise that the model states, or the loss that was asked for.
//!
//! Outputs that the model can pass through: beside a variance of its own for each the likelihood then has no maximum, whatever was found.
//!
//! An iteration may end where every output keeps a noise though the likelihood grows without end elsewhere; which of the two is entered depends on the start.
//! Values in general position are met only by as many unknowns as there are values, so that nothing is asked of longer records. Otherwise the deviation of an
//! output is lowered by decades, which is a walk along the profile of the likelihood, and the noise is set free again where the walk has led. What is found
//! there counts where it is likelier.

use super::continuation::Substitution;
use super::multi_start::is_likelier;
use super::segmented_response::FreeResponse;
use crate::estimation::{Estimate, Status};
use crate::methods::output_error::error::{FitDefect, FitError, trouble};
use crate::methods::output_error::fit::{Fit, Recovery, RecoveryStrategy};
use crate::methods::output_error::noise_model::{deviations, fit_noise_model};
use crate::methods::output_error::options::{Attempt, Continuation, FitOptions, SharedSteps, Shooting};
use crate::methods::output_error::robust::fit_robust;
use crate::methods::output_error::single::single_fit;
use crate::problem::Options;
use crate::problem::noise::{Degeneracy, Noise};
use crate::recovery::continuation::{Length, LengthContinuation};
use crate::recovery::shooting::shoot;
use crate::residuals::{InputCorrelation, OutputQuality, run_quality};
use crate::work::{Termination, Work};
use fdm_system::model::Model;
use fdm_system::record::Run;

/// Estimates from the start values, by the strategies that were asked for or that trouble calls for.
///
/// # Errors
/// [`FitError`]; an attempt that ran and went wrong is a [`Fit`] whose estimate says so.
pub(crate) fn attempt(attempt: &Attempt<'_>) -> Result<Fit, FitError> {
    let Attempt { model, runs, starts, options, work } = *attempt;
    let unasked = options.shooting.is_none() && options.substitute.is_empty();
    if unasked
        && options.continuation == Continuation::Auto
        && let Some(lost) = FreeResponse::at_start(model, runs, starts).filter(|found| found.is_lost(runs, None))
        && let Some(fit) = from_short_records(attempt, &lost)?
    {
        return Ok(fit);
    }
    let fit = as_asked(attempt)?;
    let found = trouble(&fit.estimate).filter(|_| options.continuation == Continuation::Auto);
    let found =
        found.filter(|found| !(matches!(found, FitDefect::PoorMatch { .. }) && leaves_noise(model, runs, &fit)));
    match found.filter(|_| work.goes_on()) {
        Some(trouble) => fallback(attempt, (fit, trouble)),
        None => Ok(fit),
    }
}

/// Lengthening records where the whole one cannot be followed from the start values. None where no estimate comes of it that is sound, or shows
/// why there is none.
fn from_short_records(attempt: &Attempt<'_>, lost: &FreeResponse) -> Result<Option<Fit>, FitError> {
    let found = FitDefect::Unstable { growth: lost.growth() };
    let Some((remedy, fit)) = by_continuation(attempt)? else { return Ok(None) };
    if is_unstable(&fit) {
        return held_in_place(attempt, (fit, found, vec![remedy])).map(Some);
    }
    let sound = trouble(&fit.estimate).is_none();
    Ok(sound.then(|| Fit { fallback: Some(Recovery { trouble: found, failed: Vec::new(), by: Some(remedy) }), ..fit }))
}

fn is_unstable(fit: &Fit) -> bool {
    matches!(fit.estimate.termination, Termination::Unstable { .. })
}

/// The end of a fit whose response is surely lost over the whole record, after some failed strategies: segments hold it in place where the model
/// can be cut.
fn held_in_place(
    attempt: &Attempt<'_>,
    (fit, found, mut failed): (Fit, FitDefect, Vec<RecoveryStrategy>),
) -> Result<Fit, FitError> {
    if let Some((remedy, cut)) = by_shooting(attempt)? {
        if trouble(&cut.estimate).is_none() {
            return Ok(Fit { fallback: Some(Recovery { trouble: found, failed, by: Some(remedy) }), ..cut });
        }
        failed.push(remedy);
    }
    Ok(Fit { fallback: Some(Recovery { trouble: found, failed, by: None }), ..fit })
}

/// Compared samples that tell noise from what a wrong minimum leaves.
const ENOUGH: usize = 50;
/// Probability of chance below which residuals are no noise.
const NO_NOISE: f64 = 0.01;

/// Whether all that a poor match leaves is white and follows no input: noise that is larger than the response, which no other minimum explains.
fn leaves_noise(model: &Model, runs: &[Run], fit: &Fit) -> bool {
    let of = |run: &Run| fit.estimate.runs.iter().find(|r| r.run == run.name);
    let mut quality = runs.iter().filter_map(|run| Some(run_quality(model, run, &of(run)?.response))).flatten();
    let is_noise = |q: OutputQuality| {
        let white = q.whiteness.is_some_and(|w| w.p_value > NO_NOISE);
        q.fit.compared == 0
            || q.fit.compared >= ENOUGH && white && !q.inputs.iter().any(InputCorrelation::is_significant)
    };
    fit.estimate.termination.is_good() && quality.all(is_noise)
}

/// By the strategies that were asked for, plainly when there are none.
fn as_asked(attempt: &Attempt<'_>) -> Result<Fit, FitError> {
    if attempt.options.substitute.is_empty() {
        return from_here(attempt);
    }
    let substitution =
        Substitution::new(attempt.model, attempt.runs, &attempt.options.substitute).map_err(FitError::Strategy)?;
    let (first, starts) = substitution.first_fit(attempt)?;
    let full = Attempt { starts: &starts, ..*attempt };
    let fit = match attempt.work.stop_after(&first.estimate.termination) {
        Some(stop) => single_fit(&Attempt { work: &Work::ended(stop), ..full })?,
        None => from_here(&full)?,
    };
    Ok(Fit { substituted: substitution.states, ..fit })
}

/// The full model by shooting, by lengthening the record, or plainly.
fn from_here(attempt: &Attempt<'_>) -> Result<Fit, FitError> {
    if let Some(shooting) = attempt.options.shooting {
        return shoot(attempt, shooting);
    }
    match attempt.options.continuation.lengths() {
        Some(lengths) => LengthContinuation::new(attempt).along(&lengths),
        None => single_fit(attempt),
    }
}

/// The model of a finished fit once more, to other runs or with other weights, from values near its estimates: in segments
/// when there was no other way, else plainly.
pub(crate) fn refit(fit: &Fit, attempt: &Attempt<'_>) -> Result<Fit, FitError> {
    let attempt = &Attempt { model: &fit.model, ..*attempt };
    match &fit.shooting {
        Some(cut) if !cut.polished => shoot(attempt, Shooting::Segments(cut.segments)),
        _ => single_fit(attempt),
    }
}

/// Shares of the record that are fitted first for a second opinion.
const OPINION: [f64; 2] = [0.25, 0.5];
/// Costs that differ by less are those of one minimum.
const SAME: f64 = 0.01;

/// Tries one way out after the other until one gives a sound estimate; else the best that was seen.
///
/// Smooth residuals alone are no proof of a wrong minimum, slow noise leaves them too: a minimum to which a second way from
/// the same start leads as well is taken for the right one.
pub(crate) fn fallback(attempt: &Attempt<'_>, (plain, found): (Fit, FitDefect)) -> Result<Fit, FitError> {
    let doubtful = matches!(found, FitDefect::SmoothResiduals { .. });
    let (mut best, mut by, mut tried) = (plain, None, Vec::new());
    // a second opinion is cheaper than a fallback strategy
    let ways: &[Try] = &[by_second_opinion, by_continuation, by_substitution, by_shooting];
    let mut ended = None;
    for way in &ways[usize::from(!doubtful)..] {
        let tried_now = way(attempt)?;
        ended = match &tried_now {
            Some((_, fit)) => attempt.work.stop_after(&fit.estimate.termination),
            None => attempt.work.stopped(),
        };
        let Some((remedy, fit)) = tried_now else {
            if ended.is_some() {
                break;
            }
            continue;
        };
        if is_unstable(&fit) {
            tried.push(remedy);
            return held_in_place(attempt, (fit, found, tried));
        }
        let left = trouble(&fit.estimate);
        let confirmed = matches!(left, Some(FitDefect::SmoothResiduals { .. })) && agree(&fit, &best);
        if confirmed && doubtful && by.is_none() {
            return Ok(best);
        }
        if fit.is_better_than(&best) {
            (best, by) = (fit, Some(remedy.clone()));
        }
        if !tried.contains(&remedy) {
            tried.push(remedy);
        }
        if confirmed || left.is_none() || ended.is_some() {
            break;
        }
    }
    // what was found to be wrong has not been looked into to the end
    if let Some(stop) = ended
        && trouble(&best.estimate).is_some()
    {
        best.estimate.termination = stop.into();
    }
    let failed = tried.into_iter().filter(|t| by.as_ref() != Some(t)).collect();
    Ok(Fit { fallback: Some(Recovery { trouble: found, failed, by }), ..best })
}

/// Whether two fits ended at the same minimum.
fn agree(a: &Fit, b: &Fit) -> bool {
    let (Some(x), Some(y)) = (a.estimate.cost, b.estimate.cost) else { return false };
    b.estimate.termination.is_good() && (x - y).abs() <= SAME.max(1e-9 * y.abs())
}

type Way = Option<(RecoveryStrategy, Fit)>;
type Try = fn(&Attempt<'_>) -> Result<Way, FitError>;

fn by_second_opinion(attempt: &Attempt<'_>) -> Result<Way, FitError> {
    let fit = LengthContinuation::new(attempt).along(&OPINION.map(Length::Share))?;
    Ok(Some((RecoveryStrategy::Continuation, fit)))
}

fn by_continuation(attempt: &Attempt<'_>) -> Result<Way, FitError> {
    Ok(LengthContinuation::new(attempt).adaptive()?.map(|fit| (RecoveryStrategy::Continuation, fit)))
}

fn by_substitution(attempt: &Attempt<'_>) -> Result<Way, FitError> {
    let Some(substitution) = Substitution::all(attempt.model, attempt.runs) else { return Ok(None) };
    let (first, starts) = substitution.first_fit(attempt)?;
    let full = Attempt { starts: &starts, ..*attempt };
    let fit = match attempt.work.stop_after(&first.estimate.termination) {
        Some(stop) => single_fit(&Attempt { work: &Work::ended(stop), ..full })?,
        None => single_fit(&full)?,
    };
    Ok(Some((RecoveryStrategy::Substitution { states: substitution.states }, fit)))
}

fn by_shooting(attempt: &Attempt<'_>) -> Result<Way, FitError> {
    let Some(segments) = fitting(attempt.model, attempt.runs) else { return Ok(None) };
    let fit = shoot(attempt, Shooting::Segments(segments))?;
    let segments = fit.shooting.as_ref().map_or(segments, |s| s.segments);
    Ok(Some((RecoveryStrategy::Shooting { segments }, fit)))
}

/// Segments with a few cells for each state in them, but not too many; none when the model cannot be cut.
fn fitting(model: &Model, runs: &[Run]) -> Option<usize> {
    const CELLS: usize = 4;
    const MOST: usize = 20;
    let layout = model.layout();
    let cells = |run: &Run| run.measured.iter().filter(|z| !z.is_nan()).count();
    let least = runs.iter().map(cells).min()?;
    let segments = (least / (CELLS * layout.states.max(1))).min(MOST);
    (segments > 1 && layout.states > 0 && layout.delayed.is_empty()).then_some(segments)
}

/// Goes on from `first`, which was fitted by squares from the same starts. Stated noise is tried from where that ended and from the starts
/// themselves, or from `reached` alone where it has been tried from both before.
///
/// # Errors
/// [`FitError`], as any fit.
pub(crate) fn completed(attempt: &Attempt<'_>, reached: Option<&[Vec<f64>]>, first: Fit) -> Result<Fit, FitError> {
    let Attempt { model, starts, options, .. } = *attempt;
    let end = &first.estimate.termination;
    let Some(deviations) = deviations(model, &options.options.noise, &options.censored).filter(|_| !end.is_stopped())
    else {
        // without iterations the start values are judged
        let only_judged = options.options.iterations == 0 && matches!(end, Termination::IterationLimit);
        return match options.loss.is_squares() || !end.is_good() && !only_judged {
            true => Ok(first),
            false => fit_robust(&Attempt { model: &without_noise(model), ..*attempt }, first),
        };
    };
    let mut places: Vec<Vec<Vec<f64>>> = Vec::new();
    match reached {
        Some(reached) => places.push(reached.to_vec()),
        None => {
            let ended = attempt.reached(&first.estimate);
            places.extend(first.estimate.cost.map(|_| ended).filter(|ended| ended != starts));
            places.push(starts.to_vec());
        }
    }
    fit_noise_model(&Attempt { model: &without_process_noise(model), ..*attempt }, &places, (first, &deviations))
}

/// The model with the parameters of noises held: they move no response, so that squares of residuals say nothing of them.
pub(crate) fn without_noise(model: &Model) -> Model {
    held(model, model.definition().only_in_noise())
}

/// The model with those held that stand in the equations' noise alone: output error says nothing of them.
fn without_process_noise(model: &Model) -> Model {
    let definition = model.definition();
    let output = definition.only_in_output_noise();
    held(model, definition.only_in_noise().iter().zip(output).map(|(noise, output)| *noise && !output).collect())
}

fn held(model: &Model, only: Vec<bool>) -> Model {
    if !only.contains(&true) {
        return model.clone();
    }
    let mut params = model.definition().params.clone();
    params.iter_mut().zip(only).filter(|(_, only)| *only).for_each(|(p, _)| p.fixed = true);
    model.with_params(params)
}

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
