//! A diagnosis: what a model gets wrong, the cause, and what was tried.

use super::doctor::JudgedRecords;
use fdm_infer::{
    Biased, Cause, Diagnosis, Explanation, Feedback, FrontModel, LackOfFit, LeftOut, MendedRecords, OutputGain,
    SearchStep, UnnamedCause, Verdict,
};
use serde::{Deserialize, Serialize};

/// What a diagnosis came to. Numbers that do not exist are null; evidence is in nats.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisDocument {
    /// In one word.
    pub verdict: Verdict,
    /// Faults of the records that were mended before all else was asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mended: Option<MendedRecords>,
    /// Every kind of explanation with its probability, the likeliest first.
    pub explanations: Vec<Explanation>,
    /// The dearest first.
    pub causes: Vec<Cause>,
    /// What has no name: disturbances and laws with their places, the likeliest first.
    pub unnamed: Vec<UnnamedCause>,
    /// What is wrong with every output of the model as it was given.
    pub lack_of_fit: Vec<LackOfFit>,
    /// Where the extended text was written.
    pub extended_model: Option<String>,
    /// Why the search ended.
    pub ended: String,
    /// Whether it was stopped before its end: that nothing was found then says nothing.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stopped: bool,
    /// Stages of the search as they are written.
    pub front: Vec<FrontModel>,
    /// Each search.
    pub searches: Vec<SearchStep>,
    /// Parameters that the missing effect had moved.
    pub biased_parameters: Vec<Biased>,
    /// How outputs are matched.
    pub outputs: Vec<OutputGain>,
    /// Inputs that move with the states, as under a controller or a pilot.
    pub feedback: Option<Feedback>,
    /// Candidates that could not be tried.
    pub left_out: Vec<LeftOut>,
    /// `time` or `frequency`.
    pub domain: String,
    /// Lowest and highest frequency, in the frequency domain.
    pub band: Option<(f64, f64)>,
    /// What was assumed, and what was not asked, in sentences.
    pub notes: Vec<String>,
    /// What was assumed about the records and found in them; left out where that is nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub records: Option<JudgedRecords>,
}

impl DiagnosisDocument {
    /// Of a diagnosis; `extended_model` is where the extended text was written.
    pub fn of(d: &Diagnosis, extended_model: Option<&str>) -> Self {
        Self {
            verdict: d.verdict,
            mended: d.mended.clone(),
            explanations: d.explanations.clone(),
            causes: d.causes.clone(),
            unnamed: d.unnamed.clone(),
            lack_of_fit: d.lack_of_fit.clone(),
            extended_model: extended_model.map(str::to_string),
            ended: d.ended.clone(),
            stopped: d.stopped,
            front: d.front.clone(),
            searches: d.steps.clone(),
            biased_parameters: d.biased.clone(),
            outputs: d.outputs.clone(),
            feedback: d.feedback.clone(),
            left_out: d.left_out.clone(),
            domain: if d.spectral.is_some() { "frequency" } else { "time" }.into(),
            band: d.spectral.as_ref().map(|s| s.band),
            notes: d.notes.iter().chain(d.spectral.iter().flat_map(|s| &s.notes)).cloned().collect(),
            records: None,
        }
    }
}
