//! Estimates that depend on how much of the data is used deserve little confidence: tables over the cut-off frequency and over the
//! length of the records.

use super::fit::{EquationErrorFit, Regressed, regress};
use super::options::{Domain, RegressionOptions, Smoothing};
use super::refusal::RegressionError;
use crate::Model;
use crate::record::Run;
use crate::spectrum::Frequencies;
use serde::Serialize;

/// All parameters at one cut-off or length.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Dependence {
    /// Highest frequency (cycles per unit of time), or part of each record.
    pub at: f64,
    /// The parameters; none when these data do not serve, which `reason` says.
    pub parameters: Vec<Regressed>,
    /// Why there are none.
    pub reason: Option<String>,
}

impl Dependence {
    fn new(at: f64, found: Result<Vec<EquationErrorFit>, RegressionError>) -> Self {
        match found {
            Ok(fits) => {
                let parameters = fits.into_iter().flat_map(|f| f.parameters).collect();
                Self { at, parameters, reason: None }
            }
            Err(error) => Self { at, parameters: Vec::new(), reason: Some(error.to_string()) },
        }
    }
}

/// The regression with each of the highest frequencies: the band's upper end, or in the time domain the cut-off of the smoothing.
pub fn by_cutoff(model: &Model, runs: &[Run], options: &RegressionOptions, cutoffs: &[f64]) -> Vec<Dependence> {
    let one = |cutoff: &f64| {
        let mut options = options.clone();
        match &mut options.domain {
            Domain::Time => options.smoothing = Smoothing::Fixed { cutoff: *cutoff },
            Domain::Frequency(Frequencies::Grid { highest, .. }) => *highest = Some(*cutoff),
            Domain::Frequency(Frequencies::Band { highest, .. }) => *highest = *cutoff,
            Domain::Frequency(Frequencies::List(list)) => list.retain(|f| f <= cutoff),
        }
        Dependence::new(*cutoff, regress(model, runs, &options).map(|r| r.fits))
    };
    cutoffs.iter().map(one).collect()
}

/// The regression with the first part of each record; `parts` in (0, 1].
pub fn by_length(model: &Model, runs: &[Run], options: &RegressionOptions, parts: &[f64]) -> Vec<Dependence> {
    let one = |part: &f64| {
        let first = |run: &Run| {
            let samples = (part.clamp(0.0, 1.0) * run.len() as f64).round() as usize;
            run.part(0..samples.clamp(1.min(run.len()), run.len()))
        };
        let shorter: Vec<Run> = runs.iter().map(first).collect();
        Dependence::new(*part, regress(model, &shorter, options).map(|r| r.fits))
    };
    parts.iter().map(one).collect()
}
