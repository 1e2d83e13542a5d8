//! Models over all samples of records of which a search compares a part: what is told of them, and the fit of what is recommended.

use super::fitted_model::FittedModel;
use super::initial_fit::{Thoroughness, plain_fit};
use super::runs::{DiagnosisOptions, Runs};
use super::written_model::{WrittenModel, at_values, written_model};
use fdm_estimate::Work;
use fdm_system::record::Run;

/// The runs as they were given, and the model as it was given fitted to them.
pub(super) struct AllSamples<'a> {
    pub(super) runs: Runs<'a>,
    pub(super) first: FittedModel,
    options: &'a DiagnosisOptions,
    work: &'a Work<'a>,
}

impl<'a> AllSamples<'a> {
    /// From the fit to a part of the samples; none where the model has no response over all of them.
    pub(super) fn new(
        first: &FittedModel,
        runs: Runs<'a>,
        (options, work): (&'a DiagnosisOptions, &'a Work<'a>),
    ) -> Option<Self> {
        let at = FittedModel::new(first.model.clone(), runs, first.theta.clone()).ok()?;
        let fitted = plain_fit(&at, &at.theta, runs, (options, work), Thoroughness::Once);
        Some(Self { runs, first: fitted.unwrap_or(at), options, work })
    }

    /// What a written model does with all samples, at its values.
    ///
    /// # Errors
    /// That it has no response, in words.
    pub(super) fn told_of(&self, written: &WrittenModel) -> Result<WrittenModel, String> {
        let FittedModel { model, theta, .. } = &written.fitted;
        let current = FittedModel::new(model.clone(), self.runs, theta.clone()).map_err(|e| e.to_string())?;
        let found = at_values(&current, theta, &self.first.response, self.runs);
        found.ok_or_else(|| "the written model cannot be simulated over all samples".into())
    }

    /// A written model fitted to all samples of the training runs, from its values.
    ///
    /// # Errors
    /// Why there is no such fit, in words.
    pub(super) fn fitted_to(&self, written: &WrittenModel) -> Result<WrittenModel, String> {
        let FittedModel { model, theta, .. } = &written.fitted;
        let current = FittedModel::new(model.clone(), self.runs, theta.clone()).map_err(|e| e.to_string())?;
        let asked = (self.runs, self.options, self.work);
        written_model(&current, theta, &self.first.response, asked, Thoroughness::Once)
    }

    /// Of signals over all samples (N by q for each run) those at the times of other runs.
    pub(super) fn at_times_of(&self, some: &[Run], signals: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let of = |((whole, part), signal): ((&Run, &Run), &Vec<f64>)| {
            let q = whole.output_gaps.len();
            let row = |t: &f64| whole.time.partition_point(|own| own < t).min(whole.len().saturating_sub(1));
            part.time.iter().flat_map(|t| &signal[row(t) * q..][..q]).copied().collect()
        };
        self.runs.all.iter().zip(some).zip(signals).map(of).collect()
    }
}
