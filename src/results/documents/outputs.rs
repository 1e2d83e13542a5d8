//! How well one output of one run is matched, in the output's unit.

use super::json::present;
use fdm_estimate::Fit;
use fdm_estimate::residuals::{
    Distribution, InputCorrelation, NoiseVariation, OutputFit, OutputQuality, ResidualSpectrum, TicParts, Whiteness,
};
use fdm_grammar::graph::show;
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
    /// Samples of which only was compared that they lie below their limit.
    #[serde(default, skip_serializing_if = "is_none")]
    pub censored: usize,
    /// Whether the residual is white; missing where that was not asked, null where it could not be tested.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub whiteness: Option<Option<Whiteness>>,
    /// Spectrum of the residual; missing where that was not asked, null where there is none.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub spectrum: Option<Option<ResidualSpectrum>>,
    /// Distribution of the residual; missing where that was not asked, null where there is none.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub distribution: Option<Option<Distribution>>,
    /// Its correlation with each input that moves; missing where that was not asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inputs: Option<Vec<InputCorrelation>>,
    /// How its noise varies in all runs, where chance does not explain that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_variation: Option<NoiseVariation>,
    /// Its noise where the model says it in an expression.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_model: Option<NoiseModelDocument>,
    /// Why there is no test, in words.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub untested: Option<Option<String>>,
}

fn is_none(count: &usize) -> bool {
    *count == 0
}

/// The noise of an output whose deviation is an expression, in the output's unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NoiseModelDocument {
    /// The standard deviation, as the model says it.
    pub expression: String,
    /// Its smallest and largest value at the compared samples of the run.
    pub deviations: [f64; 2],
    /// Root mean square of the residuals over their deviations: 1 where the expression is right.
    pub standardised: f64,
}

impl NoiseModelDocument {
    /// Of the output with this place among q, in a run of a fit; none where its noise is of one size.
    fn of(fit: &Fit, run: usize, output: usize) -> Option<Self> {
        let definition = fit.model.definition();
        let q = definition.outputs.len();
        let (samples, residuals) = (fit.noise_of_samples.get(run)?, &fit.estimate.runs.get(run)?.residuals);
        let expression = show(&definition.graph, definition.outputs.get(output)?.noise_model?, definition);
        let cells = samples.deviations.iter().zip(residuals).skip(output).step_by(q);
        let compared: Vec<(f64, f64)> = cells.filter(|(s, _)| !s.is_nan()).map(|(s, v)| (*s, v / s)).collect();
        let first = compared.first()?.0;
        let ends = compared.iter().fold([first, first], |[low, high], (s, _)| [low.min(*s), high.max(*s)]);
        let mean = compared.iter().map(|(_, e)| e * e).sum::<f64>() / compared.len() as f64;
        Some(Self { expression, deviations: ends, standardised: mean.sqrt() })
    }
}

impl From<&OutputFit> for OutputDocument {
    /// Of an output whose residuals were not asked, and whose unit is not known.
    fn from(fit: &OutputFit) -> Self {
        Self {
            name: fit.name.clone(),
            run: fit.run.clone(),
            unit: None,
            rms: fit.rms,
            mean: fit.bias,
            r2: fit.r2,
            tic: fit.tic,
            tic_parts: fit.tic_parts,
            compared: fit.compared,
            censored: fit.censored,
            whiteness: None,
            spectrum: None,
            distribution: None,
            inputs: None,
            noise_variation: None,
            noise_model: None,
            untested: None,
        }
    }
}

impl From<&OutputQuality> for OutputDocument {
    /// Of an output with what its residuals say, whose unit is not known.
    fn from(q: &OutputQuality) -> Self {
        Self {
            whiteness: Some(q.whiteness.clone()),
            spectrum: Some(q.spectrum.clone()),
            distribution: Some(q.distribution.clone()),
            inputs: Some(q.inputs.clone()),
            untested: Some(q.untested.map(|u| u.to_string())),
            ..Self::from(&q.fit)
        }
    }
}

impl OutputDocument {
    /// Of an output whose residuals were not asked.
    pub fn of(model: &Model, fit: &OutputFit) -> Self {
        let declared = model.definition().outputs.iter().find(|d| d.quantity.name == fit.name);
        let unit = declared.and_then(|d| d.quantity.unit.as_ref()).map(ToString::to_string);
        Self { unit, ..Self::from(fit) }
    }

    /// Of outputs with what their residuals say.
    pub fn of_quality(model: &Model, quality: &[OutputQuality]) -> Vec<Self> {
        quality.iter().map(|q| Self { unit: Self::of(model, &q.fit).unit, ..Self::from(q) }).collect()
    }

    /// Of a fit: what the residuals say, and what is known of the noise.
    pub fn of_fit(fit: &Fit) -> Vec<Self> {
        let mut outputs = Self::of_quality(&fit.model, &fit.quality);
        let q = fit.model.definition().outputs.len().max(1);
        for (k, output) in outputs.iter_mut().enumerate() {
            let varies = fit.estimate.noise_variation.iter().find(|v| v.output == output.name && v.is_significant());
            output.noise_variation = varies.cloned();
            output.noise_model = NoiseModelDocument::of(fit, k / q, k % q);
        }
        outputs
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
