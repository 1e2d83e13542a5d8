//! A fit, whichever way the model was compared with the records.
//!
//! How well one output of one run is matched, in the output's unit.

use super::doctor::JudgedRecords;
use super::frequency::{FrequencyDomain, FrequencyResponses, Pair, TimeDomain};
use super::json::present;
use super::model::ModesDocument;
use super::remarks::{Remark, estimate_remarks, fit_remarks, limit_within_bounds, spectral_remarks};
use super::requirement::Assessment;
use super::study::Study;
use fdm_doctor::Finding;
use fdm_estimate::residuals::{
    Distribution, InputCorrelation, NoiseVariation, OutputFit, OutputQuality, ResidualSpectrum, TicParts, Whiteness,
};
use fdm_estimate::{
    BiasCorrection, Continuity, Curvature, Direction, DoubtedInitials, Estimate, FilterFit, Fit, InputInterpolation,
    Iteration, LengthFit, LengthSensitivity, Loss, NoiseColour, ParameterEstimate, Recovery, ResponseFit, Reweighting,
    Smoothing, SpectralColour, SpectralFit, StartSummary, Symmetric, TableEstimate, Termination, by_confidence,
};
use fdm_grammar::graph::show;
use fdm_infer::LackOfFit;
use fdm_system::Model;
use fdm_system::simulate::Steps;
use serde::{Deserialize, Serialize};

/// What every fit says, and beside it what its method adds. A key that a method does not have is missing; one that has nothing to say
/// here is null.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FitDocument {
    /// The model's name.
    pub model: String,
    /// Every parameter, per-run ones once for every run, then derived quantities.
    pub parameters: Vec<ParameterEstimate>,
    /// How well each output of each run is matched.
    pub outputs: Vec<OutputDocument>,
    /// Minus the logarithm of the likelihood, without its constant.
    pub cost: Option<f64>,
    /// Logarithm of the likelihood with its constant, without priors; left out where noise is not that of samples in time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_likelihood: Option<f64>,
    /// How the iteration ended, in one word.
    pub termination: Terminated,
    /// How the iteration ended, in a sentence.
    pub message: String,
    /// Gauss-Newton steps that were made.
    pub iterations: usize,
    /// Fallback strategies of the iteration, in words.
    pub iteration_fallbacks: Vec<String>,
    /// Simulations of all runs.
    pub evaluations: Evaluations,
    /// Parameters whose bias by noise of measured regressors was removed (SIMEX).
    pub bias_corrections: Vec<BiasCorrection>,
    /// Combinations that the data do not determine.
    pub undetermined: Vec<Direction>,
    /// Combinations that priors alone determine.
    pub determined_by_prior: Vec<Direction>,
    /// Covariance of the estimates: the bound of Cramer and Rao.
    pub covariance: Matrix,
    /// Their correlations.
    pub correlations: Matrix,
    /// Covariance corrected for the colour of the residuals; empty where it was not.
    pub corrected_covariance: Matrix,
    /// The colour of the noise of each output.
    pub noise_colour: Vec<NoiseColour>,
    /// Whether the residuals are white over the frequencies that were compared; left out in the time domain.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub spectral_colour: Vec<SpectralColour>,
    /// Intervals that the profile of the likelihood contradicts; left out where there is none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub curvature: Vec<Curvature>,
    /// Why errors were not corrected for it.
    pub uncorrected: Option<String>,
    /// Covariance of the measurement noise (q by q).
    pub noise_covariance: Option<Vec<Vec<f64>>>,
    /// How smooth tables are; left out where none is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub smoothing: Vec<Smoothing>,
    /// Tables at the estimates, and what of them was visited; left out where the model has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tables: Vec<TableEstimate>,
    /// Condition number of the scaled information matrix.
    pub condition: Option<f64>,
    /// The iteration, the start first.
    pub history: Vec<Iteration>,
    /// What should not be overlooked.
    pub remarks: Vec<Remark>,
    /// What the doctor names first of the records, where an output is not explained; left out where it was not asked, or names nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_cause: Option<Finding>,
    /// What was assumed about the records and found in them; left out where that is nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub records: Option<JudgedRecords>,

    /// Initial values that the model states and the data contradict; left out where they do not, or where that was not looked at.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubted_initials: Option<DoubtedInitials>,
    /// How each run was integrated; in the time domain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub integration: Option<Vec<Integration>>,
    /// What was done about start values that could not be used; in the time domain.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub fallback: Option<Option<Recovery>>,
    /// What was done about start values that could not be used, in words.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub fallback_message: Option<Option<String>>,
    /// What the record says of inputs about which nobody said how they go between samples.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub interpolations: Vec<InputInterpolation>,
    /// States whose records took their place in a first fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub substituted: Option<Vec<String>>,
    /// How continuous a result of multiple shooting is.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub shooting: Option<Option<Continuity>>,
    /// Estimates by length of the record.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_length: Option<Vec<LengthFit>>,
    /// Parameters in order of the confidence that they deserve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confidence: Option<Vec<LengthSensitivity>>,
    /// Estimates with other weights of the outputs.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub weights: Option<Option<Reweighting>>,
    /// What came out of each start; null of one.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub starts: Option<Option<Vec<StartDocument>>>,

    /// What was made of residuals, where that is not squares: `{"huber": K}` or `{"student": N}`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss: Option<Loss>,
    /// `filter error`; missing of other methods.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// Standard deviations of the measurement noise, of a filter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deviations: Option<Vec<ParameterEstimate>>,
    /// Intensities that are not identifiable from the records, of a filter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_identifiable: Option<Vec<String>>,

    /// What is particular to a fit of spectra.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_domain: Option<FrequencyDomain>,
    /// What is particular to a fit of frequency responses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frequency_responses: Option<FrequencyResponses>,
    /// Initial states, biases and time histories behind a fit in the frequency domain.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub time_domain: Option<Option<TimeDomain>>,
    /// Initial states, biases and time histories of runs that took no part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation_runs: Option<TimeDomain>,

    /// The study of which this was the first fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub study: Option<Study>,
    /// What this fit validates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation: Option<Validation>,
    /// Modes of the model as it was found; null where it has no states.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub modes: Option<Option<ModesDocument>>,
    /// Requirements of the model as it was found; left out where it has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub requirements: Vec<Assessment>,
    /// Frequency responses of a fit in the time domain, measured and modelled; left out where its runs show none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bode: Vec<Pair>,
}

/// How an iteration ended, in one word.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Terminated {
    /// At a minimum.
    Converged,
    /// All iterations were used.
    IterationLimit,
    /// No step lowers the cost, though one should.
    NoProgress,
    /// The simulation at the start values diverged.
    Diverged,
    /// There is no frequency response at the start values.
    Unanswered,
    /// An output at the start values is not finite.
    NotFinite,
    /// It was interrupted, or never begun.
    #[default]
    Interrupted,
    /// The time that was given was over.
    TimeLimit,
    /// The cost that was reached is none.
    Impossible,
    /// The free response grows beyond all that could follow it.
    Unstable,
}

impl From<&Termination> for Terminated {
    fn from(termination: &Termination) -> Self {
        match termination {
            Termination::Converged(_) => Self::Converged,
            Termination::IterationLimit => Self::IterationLimit,
            Termination::NoProgress => Self::NoProgress,
            Termination::Diverged { .. } => Self::Diverged,
            Termination::Unanswered { .. } => Self::Unanswered,
            Termination::NotFinite { .. } => Self::NotFinite,
            Termination::Interrupted => Self::Interrupted,
            Termination::TimeLimit => Self::TimeLimit,
            Termination::Impossible => Self::Impossible,
            Termination::Unstable { .. } => Self::Unstable,
        }
    }
}

/// Simulations of all runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Evaluations {
    /// With sensitivities.
    pub with_sensitivities: usize,
    /// Without.
    pub without: usize,
}

/// A symmetric matrix about some of the parameters.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Matrix {
    /// Places of the parameters in [`FitDocument::parameters`], row by row.
    pub parameters: Vec<usize>,
    /// Rows; none where the matrix is not known.
    pub values: Vec<Vec<f64>>,
}

impl Matrix {
    fn of(parameters: &[usize], matrix: &Symmetric) -> Self {
        Self { parameters: parameters.to_vec(), values: rows(matrix) }
    }
}

/// How a run was integrated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Integration {
    /// The run.
    pub run: String,
    /// The method.
    pub integrator: String,
    /// Steps of the whole run.
    pub steps: usize,
    /// Most steps in one interval between samples.
    pub steps_per_interval: usize,
    /// The steps themselves.
    pub spacing: Steps,
    /// Estimated integration error, as a part of each output's range; none where no step gave a finite response.
    pub error: Option<f64>,
}

/// What came out of one start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StartDocument {
    /// Its number; 1 is the given start.
    pub start: usize,
    /// Cost that was reached; none when the start values could not be simulated.
    pub cost: Option<f64>,
    /// Iterations of the last estimation.
    pub iterations: usize,
    /// How it ended; none when there was no estimation.
    pub termination: Option<Terminated>,
    /// How it ended, in words.
    pub message: String,
    /// The minimum that was reached, numbered by cost from 1.
    pub minimum: Option<usize>,
    /// Largest relative difference of a parameter from the best start's.
    pub distance: Option<f64>,
    /// Free parameters where it ended.
    pub values: Vec<f64>,
}

impl From<&StartSummary> for StartDocument {
    fn from(s: &StartSummary) -> Self {
        Self {
            start: s.number,
            cost: s.cost,
            iterations: s.iterations,
            termination: s.termination.as_ref().map(Terminated::from),
            message: s.message.clone(),
            minimum: s.minimum,
            distance: s.distance,
            values: s.values.clone(),
        }
    }
}

/// What a result says of runs that it was not fitted to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// The folder of the result.
    pub of: String,
    /// How well the outputs of these runs are matched.
    pub outputs: Vec<OutputQuality>,
    /// How well those of the fitted runs are.
    pub fitted_outputs: Vec<OutputDocument>,
    /// What the prediction gets wrong.
    pub lack_of_fit: Vec<LackOfFit>,
    /// Bands of the prediction, by run and output.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bands: Vec<BandCoverage>,
}

/// The 95 % bands of an output of a predicted run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BandCoverage {
    /// The output.
    pub output: String,
    /// The run.
    pub run: String,
    /// Mean half width of the band of the response, by the errors of the parameters.
    pub response: Option<f64>,
    /// Mean half width of the band of measurements, by these and the noise; none where the noise is not known.
    pub measurement: Option<f64>,
    /// Share of the measured samples within the band of measurements.
    pub within: Option<f64>,
}

impl FitDocument {
    /// Of a fit in the time domain.
    pub fn of(fit: &Fit) -> Self {
        let e = &fit.estimate;
        let accuracy = e.runs.iter().zip(&fit.integration);
        let integration = accuracy.map(|(run, a)| Integration {
            run: run.run.clone(),
            integrator: a.steps.scheme().to_string(),
            steps: a.steps.total(run.response.len() / e.outputs.len().max(1)),
            steps_per_interval: a.steps.most(),
            spacing: a.steps.clone(),
            error: Some(a.error).filter(|v| v.is_finite()),
        });
        let starts = (!fit.starts.is_empty()).then(|| fit.starts.iter().map(StartDocument::from).collect());
        let mut document = Self {
            integration: Some(integration.collect()),
            fallback: Some(fit.fallback.clone()),
            fallback_message: Some(fit.fallback.as_ref().map(ToString::to_string)),
            interpolations: fit.interpolations.clone(),
            substituted: Some(fit.substituted.clone()),
            shooting: Some(fit.shooting.clone()),
            by_length: Some(fit.by_length.clone()),
            confidence: Some(by_confidence(&fit.by_length)),
            weights: Some(fit.reweighting.clone()),
            starts: Some(starts),
            doubted_initials: fit.doubted_initials.clone(),
            ..Self::of_estimate(&fit.model, e)
        };
        if !fit.quality.is_empty() {
            document.outputs = OutputDocument::of_fit(fit);
            document.loss = (!fit.loss.is_squares()).then_some(fit.loss);
            document.remarks = fit_remarks(fit);
        }
        document
    }

    /// Of a Kalman filter's fit.
    pub fn of_filter(found: &FilterFit) -> Self {
        Self {
            method: Some("filter error".into()),
            deviations: Some(found.deviations.clone()),
            not_identifiable: Some(found.not_identifiable.clone()),
            ..Self::of(&found.fit)
        }
    }

    /// Of a fit of spectra.
    pub fn of_spectra(fit: &SpectralFit) -> Self {
        Self {
            parameters: fit.parameters(),
            remarks: spectral_remarks(fit),
            frequency_domain: Some(FrequencyDomain::of(fit)),
            time_domain: Some(fit.finish.as_ref().map(TimeDomain::of)),
            ..Self::of_estimate(&fit.model, &fit.estimate)
        }
    }

    /// Of a fit of frequency responses.
    pub fn of_responses(fit: &ResponseFit) -> Self {
        Self {
            parameters: fit.parameters(),
            frequency_responses: Some(FrequencyResponses::of(fit)),
            time_domain: Some(fit.finish.as_ref().map(TimeDomain::of)),
            ..Self::of_estimate(&fit.model, &fit.estimate)
        }
    }

    /// What is the same for every estimate, however it was reached.
    fn of_estimate(model: &Model, e: &Estimate) -> Self {
        Self {
            model: model.name().into(),
            // a limit beyond the other bound would be read as one
            parameters: e
                .parameters
                .iter()
                .map(|p| ParameterEstimate { limit: limit_within_bounds(p), ..p.clone() })
                .collect(),
            outputs: e.outputs.iter().map(|o| OutputDocument::of(model, o)).collect(),
            cost: e.cost,
            log_likelihood: e.log_likelihood,
            termination: Terminated::from(&e.termination),
            message: e.termination.to_string(),
            iterations: e.iterations,
            iteration_fallbacks: e.fallbacks.iter().map(ToString::to_string).collect(),
            evaluations: Evaluations { with_sensitivities: e.evaluations.0, without: e.evaluations.1 },
            bias_corrections: e.bias_corrections.clone(),
            undetermined: e.undetermined.clone(),
            determined_by_prior: e.determined_by_prior.clone(),
            covariance: Matrix::of(&e.covered, &e.covariance),
            correlations: Matrix::of(&e.covered, &e.correlations),
            corrected_covariance: Matrix::of(&e.covered, &e.corrected_covariance),
            noise_colour: e.colours.clone(),
            spectral_colour: e.spectral_colours.clone(),
            curvature: e.curvature.clone(),
            uncorrected: e.uncorrected.as_ref().map(ToString::to_string),
            noise_covariance: e.noise.as_ref().map(rows),
            smoothing: e.smoothing.clone(),
            tables: e.tables.clone(),
            condition: e.condition,
            history: e.history.clone(),
            remarks: estimate_remarks(e),
            ..Self::default()
        }
    }

    /// The outputs in time: those of the finish behind a fit in the frequency domain, else those of the fit.
    pub fn outputs_in_time(&self) -> &[OutputDocument] {
        let finish = self.time_domain.as_ref().and_then(|t| t.as_ref()).map(|t| &t.outputs[..]);
        finish.filter(|outputs| !outputs.is_empty()).unwrap_or(&self.outputs)
    }

    /// What came out of each start; none of one start.
    pub fn starts(&self) -> &[StartDocument] {
        self.starts.as_ref().and_then(|s| s.as_deref()).unwrap_or_default()
    }

    /// The covariance to be trusted: corrected for the colour of the residuals where that was done.
    pub fn trusted_covariance(&self) -> Option<&Matrix> {
        [&self.corrected_covariance, &self.covariance].into_iter().find(|m| !m.values.is_empty())
    }
}

fn rows(matrix: &Symmetric) -> Vec<Vec<f64>> {
    matrix.values.chunks(matrix.size.max(1)).map(<[f64]>::to_vec).collect()
}

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
