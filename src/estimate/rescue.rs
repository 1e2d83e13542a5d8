//! What is done when a plain correction goes astray, and what is said about it.

use super::continuation::Lengthening;
use super::fit::{Fit, FitOptions};
use super::fit_error::FitError;
use super::progress::Observer;
use super::termination::Termination;
use crate::model::Model;
use crate::record::Run;
use serde::Serialize;
use std::fmt;

/// What is wrong with an estimate.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Trouble {
    /// The iteration did not end at a minimum.
    Ended(Termination),
    /// It did, but the model matches the measurement badly there.
    PoorMatch {
        /// Mean of R^2 over the outputs of all runs.
        r2: f64,
    },
}

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

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ended(termination) => write!(f, "{termination}"),
            Self::PoorMatch { r2 } => write!(f, "converged to a poor match, mean R^2 {r2:.3}"),
        }
    }
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

/// Tries one way out after the other until one gives a sound estimate; else the best that was seen.
pub(super) fn rescue(
    model: &Model,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    (plain, trouble): (Fit, Trouble),
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    let mut best = Fit { rescue: Some(Rescue { trouble, failed: Vec::new(), by: None }), ..plain };
    let mut failed = Vec::new();
    for way in [lengthened] {
        let Some((remedy, fit)) = way(model, runs, starts, options, observer)? else { continue };
        let sound = super::attempt::trouble(&fit.estimate).is_none();
        let interrupted = fit.estimate.termination == Termination::Interrupted;
        if better(&fit, &best) {
            let before = best.rescue.take();
            best = fit;
            best.rescue = before.map(|r| Rescue { by: Some(remedy), failed: failed.clone(), ..r });
        } else {
            failed.push(remedy);
        }
        if sound || interrupted {
            break;
        }
    }
    if let Some(rescue) = best.rescue.as_mut().filter(|r| r.by.is_none()) {
        rescue.failed = failed;
    }
    Ok(best)
}

/// Whether a fit is worth more than another: it has a cost at all, and by more than rounding a lower one.
fn better(fit: &Fit, than: &Fit) -> bool {
    match (fit.estimate.cost, than.estimate.cost) {
        (Some(a), Some(b)) => a < b - 1e-9 * b.abs().max(1.0) || (!than.estimate.termination.is_good() && a <= b),
        (a, _) => a.is_some(),
    }
}

type Way = Option<(Remedy, Fit)>;

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
