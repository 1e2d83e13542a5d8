//! Behind the frequency domain: initial states and biases in the time domain, with what was found held.

use super::fit::SpectralFit;
use super::offsets::with_offsets;
use crate::estimate::problem::Options;
use crate::estimate::progress::Observer;
use crate::estimate::road::fit::{Fit, FitOptions, fit};
use crate::estimate::road::fit_error::FitError;
use crate::record::Run;

/// The fit of initial states, biases and parameters that spectra do not show.
///
/// # Errors
/// [`FitError`], as any fit in the time domain.
pub(super) fn finish(
    found: &SpectralFit,
    runs: &[Run],
    seen: &[bool],
    observer: &mut dyn Observer,
) -> Result<Fit, FitError> {
    let params = &found.model.definition().params;
    let first = runs.first().map(|r| r.name.as_str());
    let value = |k: usize| {
        let run = if params[k].per_run { first } else { None };
        found.estimate.parameter(&params[k].quantity.name, run).map_or(params[k].value, |p| p.value)
    };
    let values: Vec<f64> = (0..params.len()).map(value).collect();
    let model = with_offsets(&found.model, &values, seen);
    let options = FitOptions { options: Options { colour: false, ..Options::default() }, ..FitOptions::default() };
    fit(&model, runs, &options, observer)
}

impl SpectralFit {
    /// The same for runs that took no part: what the estimates predict, with initial states and biases of their own.
    ///
    /// # Errors
    /// [`FitError`], as any fit in the time domain.
    pub fn predict(&self, runs: &[Run], observer: &mut dyn Observer) -> Result<Fit, FitError> {
        let seen: Vec<bool> =
            self.model.definition().params.iter().map(|p| !self.unseen.contains(&p.quantity.name)).collect();
        finish(self, runs, &seen, observer)
    }
}
