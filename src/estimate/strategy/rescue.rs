//! What is done when a plain correction goes astray, and what is said about it.

use super::continuation::Lengthening;
use super::lengths::Length;
use super::shooting::{Shooting, shoot};
use super::substitution::Substitution;
use super::trouble::{Trouble, trouble};
use crate::estimate::progress::Observer;
use crate::estimate::road::fit::{Fit, FitOptions};
use crate::estimate::road::fit_error::FitError;
use crate::estimate::road::plain::plain;
use crate::estimate::termination::Termination;
use crate::model::Model;
use crate::record::Run;
use serde::Serialize;
use std::fmt;

/// A way out.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Remedy {
    /// The record was lengthened step by step.
    Continuation,
    /// Measured records first took the place of these states in the equations.
    Substitution {
        /// The states.
        states: Vec<String>,
    },
    /// The record was cut into so many segments for each run.
    Shooting {
        /// Segments of the longest run.
        segments: usize,
    },
}

/// What was done to reach an estimate that the start values alone would not have given, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rescue {
    /// What was wrong with the plain correction.
    pub trouble: Trouble,
    /// What was tried, in this order, without a better result.
    pub failed: Vec<Remedy>,
    /// What gave the result; none when nothing did better than the plain correction.
    pub by: Option<Remedy>,
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Continuation => write!(f, "fitting a short record first and lengthening it"),
            Self::Substitution { states } => {
                write!(f, "fitting first with the measured {} in the equations", states.join(", "))
            }
            Self::Shooting { segments } => write!(f, "multiple shooting with {segments} segments"),
        }
    }
}

impl fmt::Display for Rescue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the plain correction from the start values failed ({}); ", self.trouble)?;
        let failed: Vec<String> = self.failed.iter().map(ToString::to_string).collect();
        match &self.by {
            Some(remedy) => write!(f, "reached by {remedy}")?,
            None if failed.is_empty() => write!(f, "there was nothing else to try")?,
            None => write!(f, "no better: {}", failed.join("; "))?,
        }
        if self.by.is_some() && !failed.is_empty() {
            write!(f, ", after these had failed: {}", failed.join("; "))?;
        }
        Ok(())
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
pub(in crate::estimate) fn rescue(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    (plain, found): (Fit, Trouble),
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    let doubtful = matches!(found, Trouble::SmoothResiduals { .. });
    let (mut best, mut by, mut tried) = (plain, None, Vec::new());
    // a second opinion is cheaper than a rescue
    let ways: &[Try] = &[by_halves, lengthened, substituted, in_segments];
    for way in &ways[usize::from(!doubtful)..] {
        let Some((remedy, fit)) = way(model, runs, starts, options, observer)? else { continue };
        let left = trouble(&fit.estimate);
        let confirmed = matches!(left, Some(Trouble::SmoothResiduals { .. })) && agree(&fit, &best);
        if confirmed && doubtful && by.is_none() {
            return Ok(best);
        }
        if better(&fit, &best) {
            (best, by) = (fit, Some(remedy.clone()));
        }
        if !tried.contains(&remedy) {
            tried.push(remedy);
        }
        if confirmed || left.is_none() {
            break;
        }
    }
    let failed = tried.into_iter().filter(|t| by.as_ref() != Some(t)).collect();
    Ok(Fit { rescue: Some(Rescue { trouble: found, failed, by }), ..best })
}

/// Whether a fit is worth more than another: it has a cost at all, and by more than rounding a lower one.
fn better(fit: &Fit, than: &Fit) -> bool {
    match (fit.estimate.cost, than.estimate.cost) {
        (Some(a), Some(b)) => a < b - 1e-9 * b.abs().max(1.0) || (!than.estimate.termination.is_good() && a <= b),
        (a, _) => a.is_some(),
    }
}

/// Whether two fits ended at the same minimum.
fn agree(a: &Fit, b: &Fit) -> bool {
    let (Some(x), Some(y)) = (a.estimate.cost, b.estimate.cost) else { return false };
    b.estimate.termination.is_good() && (x - y).abs() <= SAME.max(1e-9 * y.abs())
}

type Way = Option<(Remedy, Fit)>;
type Try = fn(&Model, &[Run], &[Vec<f64>], &FitOptions, &mut dyn Observer) -> Result<Way, FitError>;

fn by_halves(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Way, FitError> {
    let mut lengthening = Lengthening { model, runs, options, stages: Vec::new() };
    let fit = lengthening.along(&OPINION.map(Length::Share), starts, observer)?;
    Ok(Some((Remedy::Continuation, fit)))
}

fn lengthened(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Way, FitError> {
    let mut lengthening = Lengthening { model, runs, options, stages: Vec::new() };
    Ok(lengthening.adaptive(starts, observer)?.map(|fit| (Remedy::Continuation, fit)))
}

fn substituted(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Way, FitError> {
    let Some(substitution) = Substitution::all(model, runs) else { return Ok(None) };
    let (first, starts) = substitution.first_fit(starts, options, observer)?;
    let fit = match first.estimate.termination {
        Termination::Interrupted => Fit { model: model.clone(), ..first },
        _ => plain(model, runs, &starts, options, observer)?,
    };
    Ok(Some((Remedy::Substitution { states: substitution.states }, fit)))
}

fn in_segments(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Way, FitError> {
    let Some(segments) = fitting(model, runs) else { return Ok(None) };
    let fit = shoot(model, runs, starts, (Shooting::Segments(segments), options), observer)?;
    let segments = fit.shooting.as_ref().map_or(segments, |s| s.segments);
    Ok(Some((Remedy::Shooting { segments }, fit)))
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
