//! Behind the frequency domain: initial states and biases in the time domain, with what was found held.

use super::fit::SpectralFit;
use super::offsets::with_offsets;
use crate::estimate::estimate::{Estimate, ParameterEstimate};
use crate::estimate::problem::Options;
use crate::estimate::progress::Observer;
use crate::estimate::road::fit::{Fit, FitOptions, fit};
use crate::estimate::road::fit_error::FitError;
use crate::model::Model;
use crate::record::Run;

/// The fit of initial states, biases and the parameters that the frequency domain has not seen (`unseen`).
///
/// # Errors
/// [`FitError`], as any fit in the time domain.
pub(in crate::estimate) fn in_time(
    model: &Model,
    found: &Estimate,
    unseen: &[String],
    runs: &[Run],
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    let params = &model.definition().params;
    // what belongs to a run may be known of another one only
    let value = |name: &str| found.parameters.iter().find(|e| e.name == name).map(|e| e.value);
    let values: Vec<f64> = params.iter().map(|p| value(&p.quantity.name).unwrap_or(p.value)).collect();
    let seen: Vec<bool> = params.iter().map(|p| !unseen.contains(&p.quantity.name)).collect();
    let model = with_offsets(model, &values, &seen);
    let options = FitOptions { options: Options { colour: false, ..Options::default() }, ..FitOptions::default() };
    fit(&model, runs, &options, observer)
}

/// Parameters as the frequency domain found them, or as the time domain did afterwards where they are `unseen` before.
pub(in crate::estimate) fn found_later(
    parameters: &[ParameterEstimate],
    finish: Option<&Fit>,
    unseen: &[String],
) -> Vec<ParameterEstimate> {
    let later = |p: &ParameterEstimate| {
        let later = finish.filter(|_| unseen.contains(&p.name))?;
        later.estimate.parameter(&p.name, p.run.as_deref()).cloned()
    };
    parameters.iter().map(|p| later(p).unwrap_or_else(|| p.clone())).collect()
}

impl SpectralFit {
    /// What the estimates predict of runs that took no part, with initial states and biases of their own.
    ///
    /// # Errors
    /// [`FitError`], as any fit in the time domain.
    pub fn predict(&self, runs: &[Run], observer: &mut dyn Observer) -> Result<Fit, FitError> {
        in_time(&self.model, &self.estimate, &self.unseen, runs, observer)
    }
}
