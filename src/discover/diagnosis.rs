//! What a diagnosis came to: the verdict, the causes with their alternatives, what was rejected, what would have been seen.

use crate::disturbance::{Attribution, Localisation, Suggestions};
use crate::lack_of_fit::LackOfFit;
use serde::{Deserialize, Serialize};

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// An effect of the catalogue explains it.
    EffectFound,
    /// A disturbance that no effect makes enters the model: gusts, waves.
    Disturbance,
    /// Something is wrong that no effect of the catalogue explains.
    UnknownCause,
    /// The records say nothing against the model.
    NoEffectFound,
}

/// An effect at its place.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize)]
pub struct EffectAt {
    /// Its name in the catalogue.
    pub effect: String,
    /// The names that it is attached to.
    pub targets: Vec<String>,
}

impl std::fmt::Display for EffectAt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}({})", self.effect, self.targets.join(", "))
    }
}

/// A parameter that an effect brought.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct NewValue {
    /// Its name in the extended model.
    pub name: String,
    /// What it is.
    pub doc: String,
    /// Its estimate.
    pub value: f64,
    /// Its standard error, under the colour of the noise; none at a bound, or where it is not estimated.
    pub standard_error: Option<f64>,
    /// Its unit, where the model has units.
    pub unit: Option<String>,
    /// The value at which the effect vanishes; none for a nuisance.
    #[serde(default, with = "maybe_infinite")]
    pub null: Option<f64>,
}

/// A number that may be infinite, for which JSON has no number: the word `inf` or `-inf`.
mod maybe_infinite {
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Read {
        Number(f64),
        Word(String),
    }

    pub(super) fn serialize<S: Serializer>(value: &Option<f64>, to: S) -> Result<S::Ok, S::Error> {
        match value {
            Some(v) if !v.is_finite() => to.serialize_str(&v.to_string()),
            value => value.serialize(to),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
        let read = |read: Read| match read {
            Read::Number(v) => Ok(v),
            Read::Word(word) => word.parse().map_err(D::Error::custom),
        };
        Option::<Read>::deserialize(from)?.map(read).transpose()
    }
}

/// An alternative that these data cannot tell from the best effect.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Alternative {
    /// Which.
    #[serde(flatten)]
    pub place: EffectAt,
    /// Gain in log-likelihood on the runs that were fitted.
    pub gain_training: f64,
    /// Gain on the runs that were for validation.
    pub gain_validation: Option<f64>,
    /// Gains less the penalty of its parameters.
    pub score: f64,
    /// Cosine of the angle between what both add, beside what is fitted.
    pub cosine: f64,
}

/// A cause that was found, and what it explains.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Cause {
    /// Which effect, where.
    #[serde(flatten)]
    pub place: EffectAt,
    /// In words.
    pub doc: String,
    /// Its parameters.
    pub parameters: Vec<NewValue>,
    /// Gain in log-likelihood on the runs that were fitted, by the noise of the better model.
    pub gain_training: f64,
    /// Gain on the runs that were for validation, where only what belongs to a run is estimated; none without such runs.
    pub gain_validation: Option<f64>,
    /// What screening had predicted.
    pub gain_predicted: f64,
    /// Gains less 3 for each parameter.
    pub score: f64,
    /// The chance that noise alone makes any effect look as good as the best one.
    pub p: f64,
    /// The effects that these data cannot tell from this one, itself included.
    pub group: Vec<Alternative>,
    /// The experiment that would.
    pub separating_experiment: Option<String>,
}

/// A model of the front: the best with so many effects, as it is written and simulated.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct FrontModel {
    /// Its effects; none of the model as it was given.
    pub effects: Vec<EffectAt>,
    /// Parameters that they bring.
    pub parameters: usize,
    /// Root mean square of the residual over that of the model as it was given, the mean over outputs, on the training runs.
    pub error_training: f64,
    /// Root mean square of the residual over that of the model as it was given, the mean over outputs, on the
    /// validation runs; none without such runs.
    pub error_validation: Option<f64>,
    /// Without validation runs: root mean square of the residual over that of the model as it was given, the mean over
    /// outputs, on each run by a fit to the others, or on the last third of a single run by a fit to the rest.
    pub error_cross_validated: Option<f64>,
    /// How each output is matched.
    pub outputs: Vec<FrontOutput>,
    /// Whether it is the one that is recommended.
    pub recommended: bool,
    /// Why it cannot be recommended, in words.
    pub objection: Option<String>,
    /// The coefficient that is a table in it; none where none is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<CoefficientTable>,
}

/// A coefficient that depends on a signal, as a smooth table in the text.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct CoefficientTable {
    /// The param that the table takes the place of.
    pub coefficient: String,
    /// What it depends on: a state, an input or a `let`.
    pub signal: String,
    /// The signal's unit, as it is declared.
    pub signal_unit: Option<String>,
    /// From where on the coefficient is constant; none where that is as far as the runs go, or where it is constant nowhere.
    pub constant_from: Option<f64>,
    /// Up to where the coefficient is constant; none where that is as far as the runs go, or where it is constant
    /// nowhere.
    pub constant_to: Option<f64>,
    /// Effective number of parameters of the table.
    pub effective_parameters: f64,
    /// Gain in log-likelihood on the runs that were fitted, beside the same model with a constant.
    pub gain_training: f64,
    /// Gain on the runs that were for validation; none without such runs.
    pub gain_validation: Option<f64>,
    /// The chance that noise alone makes any coefficient look as bent over any signal as this one.
    pub p: f64,
    /// All of that in words.
    pub sentence: String,
}

/// How a model of the front matches an output, all runs together.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct FrontOutput {
    /// The output.
    pub output: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Root mean square of the residual on the training runs.
    pub rms_training: Option<f64>,
    /// Root mean square of the residual on the validation runs.
    pub rms_validation: Option<f64>,
}

/// An effect that was fitted and not accepted, or accepted and taken out again.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Rejected {
    /// Which.
    #[serde(flatten)]
    pub place: EffectAt,
    /// The search, from 1, in which that was.
    pub step: usize,
    /// Gain in log-likelihood on the runs that were fitted.
    pub gain_training: f64,
    /// Gain on the runs that were for validation.
    pub gain_validation: Option<f64>,
    /// Why.
    pub reason: String,
}

/// A candidate that could not be tried.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct LeftOut {
    /// Which.
    #[serde(flatten)]
    pub place: EffectAt,
    /// Why.
    pub reason: String,
}

/// What screening says of a candidate.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Screened {
    /// Which.
    #[serde(flatten)]
    pub place: EffectAt,
    /// Its predicted gain in log-likelihood.
    pub gain: f64,
    /// The chance that noise gives this candidate as much.
    pub chance: f64,
    /// What is left of it beside the fitted parameters, as a share.
    pub distinct: f64,
    /// The size that predicts it, of the parameter `parameter`; none where the fitted parameters make up for all of it.
    pub size: Option<f64>,
    /// The parameter.
    pub parameter: String,
}

/// One search for one more effect.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct SelectionStep {
    /// The chance that noise alone makes any candidate look as good as the best one.
    pub family_wise_p: f64,
    /// Candidates by rank, the likeliest first.
    pub ranking: Vec<Screened>,
    /// The effect that was accepted.
    pub accepted: Option<EffectAt>,
}

/// How small an effect would have been seen.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Detectable {
    /// Which.
    #[serde(flatten)]
    pub place: EffectAt,
    /// The parameter that is its size.
    pub parameter: String,
    /// The value that would be seen in four of five records like these; none where the fitted parameters make up for it.
    pub smallest: Option<f64>,
    /// Its unit, where the model has units.
    pub unit: Option<String>,
    /// What is left of it beside the fitted parameters, as a share.
    pub distinct: f64,
}

/// A parameter that the missing effect had moved.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Biased {
    /// Its name.
    pub name: String,
    /// Its run, where it belongs to one.
    pub run: Option<String>,
    /// Its unit.
    pub unit: Option<String>,
    /// The estimate without the effects, with its standard error.
    pub before: f64,
    /// See `before`.
    pub before_error: Option<f64>,
    /// The estimate with them.
    pub after: f64,
    /// See `after`.
    pub after_error: Option<f64>,
    /// How far it moved, in standard errors that the fit without the effects claims.
    pub moved: Option<f64>,
}

/// How an output of a run is matched before and after.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct OutputGain {
    /// The run.
    pub run: String,
    /// Whether it took part in the fit.
    pub validation: bool,
    /// The output.
    pub output: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Root mean square of the residual without the effects.
    pub rms_before: Option<f64>,
    /// Root mean square of the residual with the effects.
    pub rms_after: Option<f64>,
    /// What noise leaves, by the spectrum that was found.
    pub noise_level: f64,
    /// Theil's inequality coefficient, before.
    pub tic_before: Option<f64>,
    /// Theil's inequality coefficient with the effects.
    pub tic_after: Option<f64>,
    /// Share of the measured variance that is explained, before.
    pub r2_before: Option<f64>,
    /// Share of the measured variance that is explained with the effects.
    pub r2_after: Option<f64>,
}

/// Part of the measured variance below which a model is said to explain nothing of an output.
const NOTHING: f64 = 0.1;

impl OutputGain {
    /// Outputs of which the model as it was given explains nothing in any training run, each with its best R^2.
    pub fn unexplained(outputs: &[Self]) -> Vec<(String, f64)> {
        let mut best: Vec<(String, f64)> = Vec::new();
        for (gain, r2) in outputs.iter().filter(|o| !o.validation).filter_map(|o| Some((o, o.r2_before?))) {
            match best.iter_mut().find(|(name, _)| *name == gain.output) {
                Some((_, known)) => *known = known.max(r2),
                None => best.push((gain.output.clone(), r2)),
            }
        }
        best.retain(|(_, r2)| *r2 < NOTHING);
        best
    }
}

/// The gain of all accepted effects on one run, by the last noise.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct RunGain {
    /// The run.
    pub run: String,
    /// Whether it took part in the fit.
    pub validation: bool,
    /// Gain in log-likelihood.
    pub gain: f64,
    /// Deviation of that gain, by noise of the size that the effects leave.
    pub deviation: f64,
}

/// The responses of a run before and after, where models were compared in time.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// The run.
    pub run: String,
    /// Whether it took part in the fit.
    pub validation: bool,
    /// Time of each sample (N), on an even grid.
    pub time: Vec<f64>,
    /// Measured outputs, N by q row-major; NaN where there is none.
    pub measured: Vec<f64>,
    /// Outputs of the model as it was given, fitted to the runs that take part.
    pub before: Vec<f64>,
    /// Outputs with the accepted effects; those of the model as it was given where there are none.
    pub after: Vec<f64>,
}

/// How models were compared with records in the frequency domain.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct FrequencyDomain {
    /// Lowest and highest frequency, in cycles per unit of time.
    pub band: (f64, f64),
    /// What was not asked, or not as in the time domain, in sentences.
    pub notes: Vec<String>,
}

/// Inputs that move with the states, and what these records hide for it.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Feedback {
    /// Which, and how closely.
    pub inputs: Vec<CorrelatedInput>,
    /// Effects that the fitted parameters make up for, in part or altogether: they may be there, and nobody would see them.
    pub hidden: Vec<EffectAt>,
}

/// An input that moves with the states.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct CorrelatedInput {
    /// Its name.
    pub input: String,
    /// The part of its variance that a linear function of the states explains.
    pub explained: f64,
    /// Whether what is new in the outputs is in the input later: a controller or a pilot closes the loop.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub feedback: bool,
}

/// What a diagnosis came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// In one word.
    pub verdict: Verdict,
    /// The chance that noise alone makes any effect look as good as the best one, for the model as it was given.
    pub family_wise_p: f64,
    /// In the order in which they were accepted.
    pub causes: Vec<Cause>,
    /// The best models by number of effects, from none on, by their plain errors; empty where no effect was accepted.
    pub front: Vec<FrontModel>,
    /// What was fitted and not accepted.
    pub rejected: Vec<Rejected>,
    /// Each search.
    pub steps: Vec<SelectionStep>,
    /// How small each effect could have been in the last search.
    pub detectable: Vec<Detectable>,
    /// Candidates that could not be tried in the first search.
    pub left_out: Vec<LeftOut>,
    /// Parameters that moved.
    pub biased: Vec<Biased>,
    /// How outputs are matched.
    pub outputs: Vec<OutputGain>,
    /// What each run gains.
    pub gains: Vec<RunGain>,
    /// Responses before and after, run by run; empty in the frequency domain.
    pub overlays: Vec<Overlay>,
    /// Number of hat functions of each output's noise spectrum; 1 is white.
    pub noise_knots: Vec<usize>,
    /// The user's text with the accepted effects; none when there are none.
    pub extended: Option<String>,
    /// Why the search ended, in a sentence.
    pub ended: String,
    /// Whether it was stopped before its end: that nothing was found then says nothing.
    pub stopped: bool,
    /// What is wrong with every output of the model as it was given.
    pub lack_of_fit: Vec<LackOfFit>,
    /// Effect, disturbance or unknown cause, weighed against each other; none where that could not be asked.
    pub attribution: Option<Attribution>,
    /// Where a disturbance would enter the model as it was given.
    pub places: Option<Localisation>,
    /// What an unknown cause looks like, where the verdict is that.
    pub suggestions: Option<Suggestions>,
    /// Inputs that move with the states; none where every input is its own.
    pub feedback: Option<Feedback>,
    /// What was assumed about the runs, in sentences.
    pub notes: Vec<String>,
    /// Of a diagnosis in the frequency domain.
    pub spectral: Option<FrequencyDomain>,
}
