//! Fallback strategies: what is done, in order, when the fit from the start values fails or is doubtful, and what decides that.
//!
//! The strategies are record-length continuation, substitution of measured states, and multiple shooting; one that was asked
//! for is followed without being judged.

use crate::methods::output_error::attempt::Attempt;
use crate::methods::output_error::defect::{FitDefect, trouble};
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::{Fit, Recovery, RecoveryStrategy};
use crate::methods::output_error::options::{Continuation, Shooting};
use crate::methods::output_error::single::single_fit;
use crate::recovery::continuation::{Length, LengthContinuation};
use crate::recovery::free_response::FreeResponse;
use crate::recovery::shooting::shoot;
use crate::recovery::substitution::Substitution;
use crate::residuals::{InputCorrelation, OutputQuality, run_quality};
use crate::work::Work;
use crate::work::termination::Termination;
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
