//! How well one output of one run is matched, in the output's unit.

use super::json::present;
use fdm_estimate::residuals::{
    Distribution, InputCorrelation, OutputFit, OutputQuality, ResidualSpectrum, TicParts, Whiteness,
};
use fdm_system::Model;
use serde::{Deserialize, Serialize};

/// How well one output of one run is matched; what its residuals say, where they were asked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutputDocument {
    /// Its name.
    pub name: String,
    /// The run.
    pub run: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// Root mean square of the residual.
    pub rms: Option<f64>,
    /// Mean of the residual, measured minus model.
    pub mean: Option<f64>,
    /// Share of the measured variance that the model explains.
    pub r2: Option<f64>,
    /// Theil's inequality coefficient.
    pub tic: Option<f64>,
    /// Its parts.
    pub tic_parts: Option<TicParts>,
    /// Samples that were compared.
    pub compared: usize,
    /// Whether the residual is white; missing where that was not asked, null where it could not be tested.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub whiteness: Option<Option<Whiteness>>,
    /// Its spectrum; likewise.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub spectrum: Option<Option<ResidualSpectrum>>,
    /// Its distribution; likewise.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub distribution: Option<Option<Distribution>>,
    /// Its correlation with each input that moves; missing where that was not asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inputs: Option<Vec<InputCorrelation>>,
    /// Why there is no test, in words.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub untested: Option<Option<String>>,
}

impl OutputDocument {
    /// Of an output whose residuals were not asked.
    pub fn of(model: &Model, fit: &OutputFit) -> Self {
        let declared = model.definition().outputs.iter().find(|d| d.quantity.name == fit.name);
        Self {
            name: fit.name.clone(),
            run: fit.run.clone(),
            unit: declared.and_then(|d| d.quantity.unit.as_ref()).map(ToString::to_string),
            rms: fit.rms,
            mean: fit.bias,
            r2: fit.r2,
            tic: fit.tic,
            tic_parts: fit.tic_parts,
            compared: fit.compared,
            whiteness: None,
            spectrum: None,
            distribution: None,
            inputs: None,
            untested: None,
        }
    }

    /// Of outputs with what their residuals say.
    pub fn of_quality(model: &Model, quality: &[OutputQuality]) -> Vec<Self> {
        let one = |q: &OutputQuality| Self {
            whiteness: Some(q.whiteness.clone()),
            spectrum: Some(q.spectrum.clone()),
            distribution: Some(q.distribution.clone()),
            inputs: Some(q.inputs.clone()),
            untested: Some(q.untested.map(|u| u.to_string())),
            ..Self::of(model, &q.fit)
        };
        quality.iter().map(one).collect()
    }

    /// What the tests of whiteness say, where there were any.
    pub fn white(&self) -> Option<&Whiteness> {
        self.whiteness.as_ref()?.as_ref()
    }

    /// The correlations with inputs; none where they were not asked.
    pub fn inputs(&self) -> &[InputCorrelation] {
        self.inputs.as_deref().unwrap_or_default()
    }
}
