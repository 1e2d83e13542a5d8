//! A diagnosis: what a model gets wrong, the cause, and what was tried.

use super::doctor::JudgedRecords;
use fdm_discover::{
    Attribution, Biased, Cause, Detectable, Diagnosis, Feedback, FrontModel, LackOfFit, LeftOut, Ordinate, OutputGain,
    PlaceEvidence, PlaceKind, Rejected, RunGain, SelectionStep, Suggestions, Verdict,
};
use serde::{Deserialize, Serialize};

/// What a diagnosis came to. Numbers that do not exist are null.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisDocument {
    /// In one word.
    pub verdict: Verdict,
    /// The chance that noise alone makes any effect look as good as the best one.
    pub family_wise_p: f64,
    /// In the order in which they were accepted.
    pub causes: Vec<Cause>,
    /// What is wrong with every output of the model as it was given.
    pub lack_of_fit: Vec<LackOfFit>,
    /// How small each effect could have been.
    pub detectable: Vec<Detectable>,
    /// Where the extended text was written.
    pub extended_model: Option<String>,
    /// Where something enters that no effect explains.
    pub places: Vec<PlaceEvidence>,
    /// What is still unexplained, in words.
    pub residual_analysis: Vec<String>,
    /// Effect, disturbance or unknown cause, weighed against each other.
    pub attribution: Option<Attribution>,
    /// The course of the likeliest disturbance, where the verdict rests on one.
    pub disturbance: Option<DisturbanceCourse>,
    /// What an unknown cause looks like.
    pub suggestions: Option<Suggestions>,
    /// Why the search ended.
    pub ended: String,
    /// Whether it was stopped before its end: that nothing was found then says nothing.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stopped: bool,
    /// The best models by number of effects.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub front: Vec<FrontModel>,
    /// What was fitted and not accepted.
    pub rejected: Vec<Rejected>,
    /// Each search.
    pub searches: Vec<SelectionStep>,
    /// Parameters that the missing effect had moved.
    pub biased_parameters: Vec<Biased>,
    /// What each run gains.
    pub gains: Vec<RunGain>,
    /// How outputs are matched before and after.
    pub outputs: Vec<OutputGain>,
    /// Inputs that are correlated with the states, as under a controller or pilot.
    pub feedback: Option<Feedback>,
    /// Candidates that could not be tried.
    pub left_out: Vec<LeftOut>,
    /// Number of hat functions of each output's noise spectrum.
    pub noise_knots: Vec<usize>,
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

/// The course of a disturbance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DisturbanceCourse {
    /// What it enters.
    pub name: String,
    /// What kind of place that is.
    pub kind: PlaceKind,
    /// Run by run.
    pub course: Vec<Vec<Ordinate>>,
}

impl DiagnosisDocument {
    /// Of a diagnosis; `extended_model` is where the extended text was written.
    pub fn of(d: &Diagnosis, extended_model: Option<&str>) -> Self {
        Self {
            verdict: d.verdict,
            family_wise_p: d.family_wise_p,
            causes: d.causes.clone(),
            lack_of_fit: d.lack_of_fit.clone(),
            detectable: d.detectable.clone(),
            extended_model: extended_model.map(str::to_string),
            places: d.attribution.as_ref().map_or(Vec::new(), |a| a.places.clone()),
            residual_analysis: d.attribution.as_ref().map_or(Vec::new(), |a| a.warnings.clone()),
            attribution: d.attribution.clone(),
            disturbance: disturbance(d),
            suggestions: d.suggestions.clone(),
            ended: d.ended.clone(),
            stopped: d.stopped,
            front: d.front.clone(),
            rejected: d.rejected.clone(),
            searches: d.steps.clone(),
            biased_parameters: d.biased.clone(),
            gains: d.gains.clone(),
            outputs: d.outputs.clone(),
            feedback: d.feedback.clone(),
            left_out: d.left_out.clone(),
            noise_knots: d.noise_knots.clone(),
            domain: if d.spectral.is_some() { "frequency" } else { "time" }.into(),
            band: d.spectral.as_ref().map(|s| s.band),
            notes: d.notes.iter().chain(d.spectral.iter().flat_map(|s| &s.notes)).cloned().collect(),
            records: None,
        }
    }
}

/// The course of the likeliest disturbance, where the verdict rests on one.
fn disturbance(d: &Diagnosis) -> Option<DisturbanceCourse> {
    let rests = matches!(d.verdict, Verdict::Disturbance | Verdict::UnknownCause);
    let first = d.places.as_ref()?.disturbances.first().filter(|first| rests && first.evidence > 0.0)?;
    Some(DisturbanceCourse { name: first.place.name.clone(), kind: first.place.kind, course: first.course.clone() })
}
