//! Estimates from records of different length.

use crate::estimate::estimate::{ParameterEstimate, Status};
use crate::estimate::problem::Options;
use crate::estimate::progress::Observer;
use crate::estimate::road::attempt::again;
use crate::estimate::road::fit::{Fit, FitOptions};
use crate::estimate::road::fit_error::FitError;
use crate::estimate::road::start::after;
use crate::estimate::termination::Termination;
use crate::record::Run;
use serde::Serialize;

/// How much of every run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::estimate) enum Length {
    /// This part of each.
    Share(f64),
    /// Up to this time since each began.
    Time(f64),
}

impl Length {
    /// The runs up to this length, two samples at least.
    pub(in crate::estimate) fn cut(self, runs: &[Run]) -> Vec<Run> {
        let one = |run: &Run| {
            let end = match self {
                Self::Share(share) => share * run.time.last().copied().unwrap_or(0.0),
                Self::Time(time) => time,
            };
            // a sample that stands at the end but for rounding belongs to it
            let samples = run.time.partition_point(|t| *t <= end * (1.0 + 1e-12));
            run.part(0..samples.max(2).min(run.len()))
        };
        runs.iter().map(one).collect()
    }
}

/// Estimates from records of one length.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LengthFit {
    /// Time that the longest run lasts, in the model's time unit.
    pub length: f64,
    /// Samples of all runs.
    pub samples: usize,
    /// How the iteration ended.
    pub termination: Termination,
    /// The parameters as in [`Estimate::parameters`](crate::estimate::Estimate::parameters), those that are not estimated left out.
    pub parameters: Vec<ParameterEstimate>,
}

impl LengthFit {
    pub(in crate::estimate) fn new(runs: &[Run], fit: &Fit) -> Self {
        let ends = runs.iter().filter_map(|r| r.time.last());
        let open = |p: &&ParameterEstimate| !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied);
        Self {
            length: ends.copied().fold(0.0, f64::max),
            samples: runs.iter().map(Run::len).sum(),
            termination: fit.estimate.termination.clone(),
            parameters: fit.estimate.parameters.iter().filter(open).cloned().collect(),
        }
    }
}

/// Lengths that are fitted to see how the parameters settle.
const LENGTHS: usize = 10;

/// Fits a finished fit's model to shorter and shorter parts of its runs, each from the estimates of the one before; the
/// shortest comes first in what is given back. What is too short to determine anything is left out.
pub(in crate::estimate) fn shortened(
    fit: &Fit,
    runs: &[Run],
    starts: &[Vec<f64>],
    options: &FitOptions,
    observer: &mut dyn Observer,
) -> Result<Vec<LengthFit>, FitError> {
    let mut found = vec![LengthFit::new(runs, fit)];
    let mut starts = after(&fit.model, runs, &fit.estimate, starts);
    let inner = Options { colour: false, ..options.options.clone() };
    let options = &FitOptions { options: inner, ..options.clone() };
    for k in (1..LENGTHS).rev() {
        let parts = Length::Share(k as f64 / LENGTHS as f64).cut(runs);
        let cells = parts.iter().flat_map(|r| &r.measured).filter(|z| !z.is_nan()).count();
        if cells <= found[0].parameters.len() {
            break;
        }
        let shorter = again(fit, &parts, &starts, options, observer)?;
        if shorter.estimate.termination == Termination::Interrupted || shorter.estimate.cost.is_none() {
            break;
        }
        found.push(LengthFit::new(&parts, &shorter));
        // a part that went wrong is no start for a shorter one
        if shorter.estimate.is_good() {
            starts = after(&fit.model, &parts, &shorter.estimate, &starts);
        }
    }
    found.reverse();
    Ok(found)
}
