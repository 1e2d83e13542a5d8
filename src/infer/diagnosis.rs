//! What a diagnosis came to: every kind of explanation with its probability, the causes with what could stand in their place, what was tried.
//!
//! Evidence is in nats (natural logarithms of odds), prior odds included, unless it says otherwise.

use crate::candidates::Place;
use crate::lack_of_fit::LackOfFit;
use fdm_doctor::Finding;
use serde::{Deserialize, Serialize};

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The records have a fault, or begin where the model does not; the model lacks nothing else.
    RecordFault,
    /// Effects of the catalogue explain it.
    EffectFound,
    /// A disturbance with a course of its own in every run enters an equation: gusts, waves.
    Disturbance,
    /// A function of one signal, the same in every run, is missing in an equation, and no effect of the catalogue is it.
    Law,
    /// Something is wrong at an output that nothing in the model explains.
    UnknownCause,
    /// The records say nothing against the model.
    NoEffectFound,
}

/// A kind of explanation, with its probability among all of them.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Explanation {
    /// Which kind.
    pub verdict: Verdict,
    /// Evidence of all explanations of that kind together, beside that of the model as it was given.
    pub evidence: f64,
    /// Its probability.
    pub probability: f64,
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
    /// Its value in the extended text: that of a plain fit, where that predicts as well.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub written: Option<f64>,
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

    pub(crate) fn serialize<S: Serializer>(value: &Option<f64>, to: S) -> Result<S::Ok, S::Error> {
        match value {
            Some(v) if !v.is_finite() => to.serialize_str(&v.to_string()),
            value => value.serialize(to),
        }
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
        let read = |read: Read| match read {
            Read::Number(v) => Ok(v),
            Read::Word(word) => word.parse().map_err(D::Error::custom),
        };
        Option::<Read>::deserialize(from)?.map(read).transpose()
    }
}

/// What could stand in the place of a cause.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Alternative {
    /// Which.
    #[serde(flatten)]
    pub place: EffectAt,
    /// Its evidence beside that of the cause.
    pub evidence: f64,
    /// The probability that it is the cause, given that one of these is.
    pub probability: f64,
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
    /// Evidence that is lost where it alone is left out.
    pub loss: f64,
    /// How far parts of the records are apart on it, in what noise lets them be (about 1 where the model is right); none in the frequency domain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scatter: Option<f64>,
    /// The probability that it is this one, given that something stands in its place.
    pub probability: f64,
    /// What these records cannot tell from it at odds of 100 : 1, the likeliest first; itself left out.
    pub group: Vec<Alternative>,
    /// The experiment that would.
    pub separating_experiment: Option<String>,
}

/// A cause without a name.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct UnnamedCause {
    /// Where it enters.
    #[serde(flatten)]
    pub place: Place,
    /// The signal that it is a function of; none of a disturbance.
    pub signal: Option<String>,
    /// Its evidence beside that of the model as it was given.
    pub evidence: f64,
}

/// A model of the table: a stage of the search as it is written and simulated.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct FrontModel {
    /// Its effects; none of the model as it was given.
    pub effects: Vec<EffectAt>,
    /// Parameters that they bring.
    pub parameters: usize,
    /// Evidence beside that of the model as it was given.
    pub evidence: f64,
    /// Root mean square of the residual over that of the model as it was given, the mean over outputs, on the training runs.
    pub error_training: f64,
    /// The same on the validation runs; none without such runs.
    pub error_validation: Option<f64>,
    /// How each output is matched.
    pub outputs: Vec<FrontOutput>,
    /// Whether it is the one that is written.
    pub recommended: bool,
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

/// A set of effects that was fitted.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Tried {
    /// The set.
    pub effects: Vec<EffectAt>,
    /// Its evidence beside that of the state from which the search went on.
    pub evidence: f64,
}

/// One search for more effects.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct SearchStep {
    /// What was fitted, the likeliest first.
    pub tried: Vec<Tried>,
    /// The set with which the search went on.
    pub accepted: Option<Vec<EffectAt>>,
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
    /// What white noise as large as the residual's upper frequencies would leave.
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

/// What records came to whose faults are mended: all else in a diagnosis is about them.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct MendedRecords {
    /// The faults, each with its repair.
    pub faults: Vec<Finding>,
    /// Evidence of them, with what is told beside them, over that of records as they are.
    pub evidence: f64,
    /// The probability that the records are to be mended, among all explanations.
    pub probability: f64,
    /// Root mean square of the residual of each output beside the model as it was given: of records as they are, and mended.
    pub outputs: Vec<MendedOutput>,
}

/// What the mending of records changes at an output, all runs together.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct MendedOutput {
    /// The output.
    pub output: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Root mean square of the residual of records as they are.
    pub before: Option<f64>,
    /// That of mended ones.
    pub after: Option<f64>,
}

/// What a diagnosis came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// In one word.
    pub verdict: Verdict,
    /// Faults of the records that were mended before all else was asked; none where records as they are are likelier.
    pub mended: Option<MendedRecords>,
    /// Every kind of explanation, the likeliest first.
    pub explanations: Vec<Explanation>,
    /// The dearest first; of an unknown cause those that come nearest; empty where no effect is told.
    pub causes: Vec<Cause>,
    /// Causes without a name that were asked about, the likeliest first.
    pub unnamed: Vec<UnnamedCause>,
    /// Stages of the search, from the model as it was given on; that alone where there were none.
    pub front: Vec<FrontModel>,
    /// Each search.
    pub steps: Vec<SearchStep>,
    /// Candidates that could not be tried in the first search.
    pub left_out: Vec<LeftOut>,
    /// Parameters that moved.
    pub biased: Vec<Biased>,
    /// How outputs are matched.
    pub outputs: Vec<OutputGain>,
    /// Responses before and after, run by run; empty in the frequency domain.
    pub overlays: Vec<Overlay>,
    /// The user's text with the effects; none when there are none.
    pub extended: Option<String>,
    /// Why the search ended, in a sentence.
    pub ended: String,
    /// Whether it was stopped before its end: that nothing was found then says nothing.
    pub stopped: bool,
    /// What is wrong with every output of the model as it was given.
    pub lack_of_fit: Vec<LackOfFit>,
    /// Inputs that move with the states; none where every input is its own.
    pub feedback: Option<Feedback>,
    /// What was assumed about the runs, in sentences.
    pub notes: Vec<String>,
    /// Of a diagnosis in the frequency domain.
    pub spectral: Option<FrequencyDomain>,
}
