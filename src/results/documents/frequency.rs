//! The frequency domain: fits of spectra and of frequency responses, and the frequency responses that records show.

use super::digits::digits;
use super::fit::OutputDocument;
use fdm_estimate::{
    Fit, PairFit, ParameterEstimate, ResponseFit, Sensitivity, SpectralFit, StartingValue, Status, UnobservableMode,
};
use fdm_system::Model;
use fdm_system::linear::Trim;
use fdm_system::spectrum::{Bridge, FrequencyResponseEstimate};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// What is particular to a fit of spectra.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrequencyDomain {
    /// Lowest and highest frequency, in cycles per unit of time.
    pub band: (f64, f64),
    /// How many independent frequencies those of all runs are worth.
    pub independent_frequencies: f64,
    /// Frequencies of each run.
    pub frequencies: Vec<usize>,
    /// Channels with long gaps, and what was done about them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bridged: Vec<BridgeDocument>,
    /// End-point corrections: initial and final conditions of the states, found together with the parameters.
    pub end_points: Vec<ParameterEstimate>,
    /// Nonlinear terms that are measured regressors: computed from records.
    pub measured_regressors: Vec<MeasuredRegressorDocument>,
    /// Where the model was linearised, when that matters.
    pub trim: Option<TrimValues>,
    /// What the estimation began with.
    pub first_values: Vec<StartingValue>,
    /// Free parameters that are not identifiable in this band.
    pub not_identifiable: Vec<String>,
    /// Inputs without power in the band of any run.
    pub unexcited_inputs: Vec<String>,
    /// Outputs whose residuals are multiples of each other.
    pub dependent_outputs: Vec<String>,
    /// Unstable modes that no response shows.
    pub unobservable_or_uncontrollable_modes: Vec<UnobservableModeDocument>,
    /// Why a response could not be computed.
    pub unanswered: Option<String>,
    /// Why there are no time histories.
    pub unfinished: Option<String>,
}

/// A channel of a run with long gaps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BridgeDocument {
    /// The run.
    pub run: String,
    /// The channel.
    pub channel: String,
    /// Samples without a value.
    pub missing: usize,
    /// Samples of the longest gap.
    pub longest: usize,
    /// Root mean square error of the bridges in the coefficients that are compared, as a part of their root mean square; none when none is.
    pub error: Option<f64>,
    /// Frequencies at which the error is too large, so that they are not compared.
    pub left_out: usize,
}

impl BridgeDocument {
    /// Of a channel of this run.
    pub fn of((run, bridge): &(String, Bridge)) -> Self {
        let Bridge { channel, missing, longest, error, left_out } = bridge;
        let (missing, longest, error, left_out) = (*missing, *longest, *error, *left_out);
        Self { run: run.clone(), channel: channel.name.clone(), missing, longest, error, left_out }
    }

    /// In words.
    pub fn sentence(&self) -> String {
        let Self { run, channel, missing, longest, left_out, .. } = self;
        let gaps = format!("{missing} missing values of `{channel}` in {run}, {longest} in the longest gap");
        match self.error {
            Some(error) => {
                let left = if *left_out > 0 {
                    format!("; {left_out} frequencies at which it would be larger are not compared")
                } else {
                    String::new()
                };
                format!("{gaps}, were bridged: the error is {} % of its spectrum{left}", digits(100.0 * error, 2))
            }
            None => format!("{gaps}: its spectrum is not compared"),
        }
    }
}

/// A nonlinear term that was computed from records.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeasuredRegressorDocument {
    /// As it stands in the equations.
    pub term: String,
    /// The equations.
    pub equations: Vec<String>,
}

/// Values at which a model was linearised.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrimValues {
    /// Of the states.
    pub states: Vec<f64>,
    /// Of the inputs.
    pub inputs: Vec<f64>,
}

impl TrimValues {
    fn of(trim: &Trim) -> Self {
        Self { states: trim.states.clone(), inputs: trim.inputs.clone() }
    }
}

/// An unstable mode that no response shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnobservableModeDocument {
    /// Real part of the eigenvalue.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
    /// The states that dominate it.
    pub states: Vec<String>,
    /// Whether an output shows it.
    pub observable: bool,
    /// Whether an input moves it.
    pub controllable: bool,
}

impl UnobservableModeDocument {
    fn of(model: &Model, mode: &UnobservableMode) -> Self {
        let states = mode.states.iter().map(|k| model.definition().states[*k].quantity.name.clone()).collect();
        Self { re: mode.s.re, im: mode.s.im, states, observable: mode.observable, controllable: mode.controllable }
    }
}

impl FrequencyDomain {
    /// Of a fit of spectra.
    pub fn of(fit: &SpectralFit) -> Self {
        let regressors = fit.measured_regressors.iter();
        Self {
            band: fit.band,
            independent_frequencies: fit.independent,
            frequencies: fit.spectra.iter().map(|s| s.omega.len()).collect(),
            bridged: fit.bridged.iter().map(BridgeDocument::of).collect(),
            end_points: fit.end_points.clone(),
            measured_regressors: regressors
                .map(|t| MeasuredRegressorDocument { term: t.text.clone(), equations: t.equations.clone() })
                .collect(),
            trim: fit.trim.as_ref().map(TrimValues::of),
            first_values: fit.starting_values.clone(),
            not_identifiable: fit.not_identifiable.clone(),
            unexcited_inputs: fit.unexcited.clone(),
            dependent_outputs: fit.dependent.clone(),
            unobservable_or_uncontrollable_modes: fit
                .unobservable
                .iter()
                .map(|m| UnobservableModeDocument::of(&fit.model, m))
                .collect(),
            unanswered: fit.unanswered.as_ref().map(ToString::to_string),
            unfinished: fit.unfinished.as_ref().map(ToString::to_string),
        }
    }
}

/// What is particular to a fit of frequency responses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrequencyResponses {
    /// Mean cost of all pairs.
    pub cost: Option<f64>,
    /// The pairs that were compared.
    pub pairs: Vec<Pair>,
    /// Pairs (output, input) that are nowhere coherent.
    pub incoherent: Vec<(String, String)>,
    /// Lengths of the segments that were averaged.
    pub segments: Vec<f64>,
    /// Coherence below which a frequency does not count.
    pub least_coherence: f64,
    /// Bounds and insensitivities of the parameters.
    pub sensitivities: Vec<Sensitivity>,
    /// Where the model was linearised, when that matters.
    pub trim: Option<TrimValues>,
    /// What the estimation began with.
    pub first_values: Vec<StartingValue>,
    /// Free parameters that are not identifiable in this band.
    pub not_identifiable: Vec<String>,
    /// Unstable modes that no response shows.
    pub unobservable_or_uncontrollable_modes: Vec<UnobservableModeDocument>,
    /// Why a response could not be computed.
    pub unanswered: Option<String>,
    /// Why there are no time histories.
    pub unfinished: Option<String>,
}

/// The frequency response of one output to one input, measured and modelled.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// The output.
    pub output: String,
    /// The input.
    pub input: String,
    /// The cost of the pair: good up to 100.
    pub cost: f64,
    /// Frequencies that were left out because their coherence is too low.
    pub left_out: usize,
    /// Frequencies, in cycles per unit of time.
    pub frequency: Vec<f64>,
    /// Measured magnitude.
    pub decibels: Vec<f64>,
    /// Measured phase.
    pub degrees: Vec<f64>,
    /// The model's magnitude.
    pub model_decibels: Vec<f64>,
    /// The model's phase.
    pub model_degrees: Vec<f64>,
    /// Partial coherence.
    pub coherence: Vec<f64>,
    /// Random error of the magnitude as a part of it, and of the phase in radians.
    pub error: Vec<f64>,
}

impl From<&PairFit> for Pair {
    fn from(p: &PairFit) -> Self {
        let part = |of: &[[f64; 2]], k: usize| of.iter().map(|v| v[k]).collect();
        Self {
            output: p.output.clone(),
            input: p.input.clone(),
            cost: p.cost,
            left_out: p.left_out,
            frequency: p.omega.iter().map(|w| w / TAU).collect(),
            decibels: part(&p.measured, 0),
            degrees: part(&p.measured, 1),
            model_decibels: part(&p.modelled, 0),
            model_degrees: part(&p.modelled, 1),
            coherence: p.coherence.clone(),
            error: p.error.clone(),
        }
    }
}

impl FrequencyResponses {
    /// Of a fit of frequency responses.
    pub fn of(fit: &ResponseFit) -> Self {
        Self {
            cost: fit.cost(),
            pairs: fit.pairs.iter().map(Pair::from).collect(),
            incoherent: fit.incoherent.clone(),
            segments: fit.segments.clone(),
            least_coherence: fit.least_coherence,
            sensitivities: fit.sensitivities.clone(),
            trim: fit.trim.as_ref().map(TrimValues::of),
            first_values: fit.starting_values.clone(),
            not_identifiable: fit.not_identifiable.clone(),
            unobservable_or_uncontrollable_modes: fit
                .unobservable
                .iter()
                .map(|m| UnobservableModeDocument::of(&fit.model, m))
                .collect(),
            unanswered: fit.unanswered.as_ref().map(ToString::to_string),
            unfinished: fit.unfinished.as_ref().map(ToString::to_string),
        }
    }
}

/// Initial states, biases and the match of time histories.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TimeDomain {
    /// The parameters that were found in time.
    pub parameters: Vec<ParameterEstimate>,
    /// How well each output of each run is matched.
    pub outputs: Vec<OutputDocument>,
}

impl TimeDomain {
    /// Of the fit in time behind one in the frequency domain.
    pub fn of(fit: &Fit) -> Self {
        let found = fit.estimate.parameters.iter().filter(|p| p.status != Status::Fixed);
        Self { parameters: found.cloned().collect(), outputs: OutputDocument::of_quality(&fit.model, &fit.quality) }
    }
}

/// Names of the channels and of the unit of frequency.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResponseNames {
    /// Inputs (m).
    pub inputs: Vec<String>,
    /// Outputs (q).
    pub outputs: Vec<String>,
    /// `Hz`, or cycles per another unit of time.
    pub frequency: String,
}

/// Frequency responses that records show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpectraDocument {
    /// Frequencies (M), rising.
    pub frequency: Vec<f64>,
    /// Their unit.
    pub unit: String,
    /// Independent averages (M).
    pub averages: Vec<f64>,
    /// Every output by every input.
    pub responses: Vec<SpectraPair>,
    /// Of every output.
    pub multiple_coherence: Vec<MultipleCoherence>,
}

/// The frequency response of one output to one input.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpectraPair {
    /// The input.
    pub input: String,
    /// The output.
    pub output: String,
    /// Real part (M).
    pub re: Vec<f64>,
    /// Imaginary part (M).
    pub im: Vec<f64>,
    /// Partial coherence (M).
    pub coherence: Vec<f64>,
    /// Random error of the magnitude as a part of it (M).
    pub random_error: Vec<f64>,
}

/// The part of an output's power that all inputs explain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MultipleCoherence {
    /// The output.
    pub output: String,
    /// By frequency (M).
    pub coherence: Vec<f64>,
}

impl SpectraDocument {
    /// Of what records show.
    pub fn of(found: &FrequencyResponseEstimate, names: &ResponseNames) -> Self {
        let of = |o: usize, i: usize| {
            let at = found.pair(o, i);
            let response = &found.response[at.clone()];
            SpectraPair {
                input: names.inputs[i].clone(),
                output: names.outputs[o].clone(),
                re: response.iter().map(|h| h.re).collect(),
                im: response.iter().map(|h| h.im).collect(),
                coherence: found.partial_coherence[at.clone()].to_vec(),
                random_error: found.error[at].to_vec(),
            }
        };
        let multiple = names.outputs.iter().zip(found.coherence.chunks(found.omega.len().max(1)));
        let multiple = multiple.map(|(output, c)| MultipleCoherence { output: output.clone(), coherence: c.to_vec() });
        Self {
            frequency: found.omega.iter().map(|w| w / TAU).collect(),
            unit: names.frequency.clone(),
            averages: found.averages.clone(),
            responses: (0..found.outputs)
                .flat_map(|o| (0..found.inputs).map(move |i| (o, i)))
                .map(|(o, i)| of(o, i))
                .collect(),
            multiple_coherence: multiple.collect(),
        }
    }
}
