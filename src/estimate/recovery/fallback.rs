//! Fallback strategies: what is done, in order, when the fit from the start values fails or is doubtful, and what decides that.
//!
//! The strategies are record-length continuation, substitution of measured states, and multiple shooting; one that was asked
//! for is followed without being judged.

use crate::output_error::defect::{FitDefect, trouble};
use crate::output_error::error::FitError;
use crate::output_error::fit::{Fit, Recovery, RecoveryStrategy};
use crate::output_error::options::{Continuation, FitOptions, Shooting};
use crate::output_error::single::single_fit;
use crate::recovery::continuation::{Length, LengthContinuation};
use crate::recovery::free_response::FreeResponse;
use crate::recovery::shooting::shoot;
use crate::recovery::substitution::Substitution;
use crate::residuals::{InputCorrelation, OutputQuality, run_quality};
use crate::termination::Termination;
use crate::work::Work;
use fdm_system::model::Model;
use fdm_system::record::Run;

/// Estimates from `starts` (all parameters of each run, see [`starts`](crate::starts)); `model` has the changes in
/// `options` already.
///
/// # Errors
/// [`FitError`]; an attempt that ran and went wrong is a [`Fit`] whose estimate says so.
pub(crate) fn attempt(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Fit, FitError> {
    let unasked = options.shooting.is_none() && options.substitute.is_empty();
    if unasked
        && options.continuation == Continuation::Auto
        && let Some(lost) = FreeResponse::at_start(model, runs, starts).filter(|found| found.is_lost(runs, None))
        && let Some(fit) = from_short_records(model, runs, starts, options, &lost, work)?
    {
        return Ok(fit);
    }
    let fit = as_asked(model, runs, starts, options, work)?;
    let found = trouble(&fit.estimate).filter(|_| options.continuation == Continuation::Auto);
    let found =
        found.filter(|found| !(matches!(found, FitDefect::PoorMatch { .. }) && leaves_noise(model, runs, &fit)));
    match found.filter(|_| work.stopped().is_none()) {
        Some(trouble) => fallback(model, runs, starts, options, (fit, trouble), work),
        None => Ok(fit),
    }
}

/// Lengthening records where the whole one cannot be followed from the start values. None where no estimate comes of it that is sound, or shows
/// why there is none.
fn from_short_records(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    lost: &FreeResponse,
    work: &Work<'_>,
) -> Result<Option<Fit>, FitError> {
    let found = FitDefect::Unstable { growth: lost.growth() };
    let Some((remedy, fit)) = by_continuation(model, runs, starts, options, work)? else { return Ok(None) };
    if is_unstable(&fit) {
        return held_in_place(model, runs, starts, options, (fit, found, vec![remedy]), work).map(Some);
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
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    (fit, found, mut failed): (Fit, FitDefect, Vec<RecoveryStrategy>),
    work: &Work<'_>,
) -> Result<Fit, FitError> {
    if let Some((remedy, cut)) = by_shooting(model, runs, starts, options, work)? {
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
fn as_asked(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Fit, FitError> {
    if options.substitute.is_empty() {
        return from_here(model, runs, starts, options, work);
    }
    let substitution = Substitution::new(model, runs, &options.substitute).map_err(FitError::Strategy)?;
    let (first, starts) = substitution.first_fit(starts, options, work)?;
    let fit = match work.stop_after(&first.estimate.termination) {
        Some(stop) => single_fit(model, runs, &starts, options, &Work::ended(stop))?,
        None => from_here(model, runs, &starts, options, work)?,
    };
    Ok(Fit { substituted: substitution.states, ..fit })
}

/// The full model by shooting, by lengthening the record, or plainly.
fn from_here(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Fit, FitError> {
    if let Some(shooting) = options.shooting {
        return shoot(model, runs, starts, (shooting, options), work);
    }
    match options.continuation.lengths() {
        Some(lengths) => LengthContinuation { model, runs, options, stages: Vec::new() }.along(&lengths, starts, work),
        None => single_fit(model, runs, starts, options, work),
    }
}

/// The model of a finished fit once more, to other runs or with other weights, from values near its estimates: in segments
/// when there was no other way, else plainly.
pub(crate) fn refit(
    fit: &Fit,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Fit, FitError> {
    match &fit.shooting {
        Some(cut) if !cut.polished => {
            shoot(&fit.model, runs, starts, (Shooting::Segments(cut.segments), options), work)
        }
        _ => single_fit(&fit.model, runs, starts, options, work),
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
pub(crate) fn fallback(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    (plain, found): (Fit, FitDefect),
    work: &Work<'_>,
) -> Result<Fit, FitError> {
    let doubtful = matches!(found, FitDefect::SmoothResiduals { .. });
    let (mut best, mut by, mut tried) = (plain, None, Vec::new());
    // a second opinion is cheaper than a fallback strategy
    let ways: &[Try] = &[by_second_opinion, by_continuation, by_substitution, by_shooting];
    let mut ended = None;
    for way in &ways[usize::from(!doubtful)..] {
        let tried_now = way(model, runs, starts, options, work)?;
        ended = match &tried_now {
            Some((_, fit)) => work.stop_after(&fit.estimate.termination),
            None => work.stopped(),
        };
        let Some((remedy, fit)) = tried_now else {
            if ended.is_some() {
                break;
            }
            continue;
        };
        if is_unstable(&fit) {
            tried.push(remedy);
            return held_in_place(model, runs, starts, options, (fit, found, tried), work);
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
type Try = fn(&Model, &[Run], &[Vec<f64>], &FitOptions, &Work<'_>) -> Result<Way, FitError>;

fn by_second_opinion(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Way, FitError> {
    let mut lengthening = LengthContinuation { model, runs, options, stages: Vec::new() };
    let fit = lengthening.along(&OPINION.map(Length::Share), starts, work)?;
    Ok(Some((RecoveryStrategy::Continuation, fit)))
}

fn by_continuation(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Way, FitError> {
    let mut lengthening = LengthContinuation { model, runs, options, stages: Vec::new() };
    Ok(lengthening.adaptive(starts, work)?.map(|fit| (RecoveryStrategy::Continuation, fit)))
}

fn by_substitution(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Way, FitError> {
    let Some(substitution) = Substitution::all(model, runs) else { return Ok(None) };
    let (first, starts) = substitution.first_fit(starts, options, work)?;
    let fit = match work.stop_after(&first.estimate.termination) {
        Some(stop) => single_fit(model, runs, &starts, options, &Work::ended(stop))?,
        None => single_fit(model, runs, &starts, options, work)?,
    };
    Ok(Some((RecoveryStrategy::Substitution { states: substitution.states }, fit)))
}

fn by_shooting(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    work: &Work<'_>,
) -> Result<Way, FitError> {
    let Some(segments) = fitting(model, runs) else { return Ok(None) };
    let fit = shoot(model, runs, starts, (Shooting::Segments(segments), options), work)?;
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
