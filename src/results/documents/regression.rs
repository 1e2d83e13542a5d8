//! Equation error: regressions, recursive least squares, and the search for a structure.

use super::doctor::JudgedRecords;
use super::fit::OutputDocument;
use super::json::present;
use super::model::ModesDocument;
use super::result::KeptParameter;
use fdm_estimate::equation_error::{
    ChannelNoise, Dependence, Domain, EquationErrorFit, Refusal, Regression, Structure,
};
use fdm_estimate::{BestIterate, Criterion, Status};
use fdm_system::Model;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The regressions of a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RegressionDocument {
    /// The model's name.
    pub model: String,
    /// Every parameter, as every result has them.
    pub parameters: Vec<KeptParameter>,
    /// `time` or `frequency`.
    pub domain: String,
    /// One for each equation, or for several that share parameters.
    pub fits: Vec<EquationErrorFit>,
    /// Equations that are no regressions.
    pub refused: Vec<RefusalDocument>,
    /// Free parameters that none of the regressions gives.
    pub kept: Vec<String>,
    /// What smoothing found.
    pub noise: Vec<ChannelNoise>,
    /// How well every equation is met in every run, and what its residuals say; nothing in the frequency domain.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outputs: Vec<OutputDocument>,
    /// What was assumed about the records and found in them; left out where that is nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub records: Option<JudgedRecords>,
    /// The estimates over the highest frequency; where that was asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_cutoff: Option<Vec<Dependence>>,
    /// The estimates over the part of the records; where that was asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub by_length: Option<Vec<Dependence>>,
    /// Modes of the model as it was found; null where it has no states.
    #[serde(default, deserialize_with = "present", skip_serializing_if = "Option::is_none")]
    pub modes: Option<Option<ModesDocument>>,
}

/// An equation that is no regression.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RefusalDocument {
    /// Which.
    pub equation: String,
    /// Why.
    pub reason: String,
}

impl fmt::Display for RefusalDocument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.reason)
    }
}

impl From<&Refusal> for RefusalDocument {
    fn from(refusal: &Refusal) -> Self {
        Self { equation: refusal.equation().to_string(), reason: refusal.to_string() }
    }
}

impl RegressionDocument {
    /// Of all regressions of a model.
    pub fn of(model: &Model, runs: &[Run], regression: &Regression) -> Self {
        let found = regression.fits.iter().flat_map(|f| &f.parameters).map(|p| KeptParameter {
            name: p.name.clone(),
            run: p.run.clone(),
            value: p.value,
            status: Status::Estimated,
            unit: p.unit.clone(),
            standard_error: Some(p.standard_error).filter(|e| e.is_finite()),
            corrected_error: p.coloured_error,
        });
        let domain = match regression.domain {
            Domain::Time => "time",
            Domain::Frequency(_) => "frequency",
        };
        let outputs = regression.quality(model, runs);
        let unit = |name: &str| regression.courses.iter().find(|c| c.equation == name).and_then(|c| c.unit.clone());
        let outputs = outputs.iter().map(|q| OutputDocument { unit: unit(&q.fit.name), ..OutputDocument::from(q) });
        Self {
            model: model.name().into(),
            parameters: found.collect(),
            outputs: outputs.collect(),
            domain: domain.into(),
            fits: regression.fits.clone(),
            refused: regression.refused.iter().map(RefusalDocument::from).collect(),
            kept: regression.kept.clone(),
            noise: regression.noise.clone(),
            by_cutoff: None,
            by_length: None,
            modes: None,
            records: None,
        }
    }

    /// With the estimates over the highest frequency and over the part of the records.
    pub fn with_dependence(self, by_cutoff: Vec<Dependence>, by_length: Vec<Dependence>) -> Self {
        Self { by_cutoff: Some(by_cutoff), by_length: Some(by_length), ..self }
    }
}

/// The structures that a search found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StructureDocument {
    /// The model's name.
    pub model: String,
    /// One for each measured rate.
    pub structures: Vec<Structure>,
}

/// Recursive least squares, with the history.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecursiveDocument {
    /// The model's name.
    pub model: String,
    /// `recursive least squares`.
    pub method: String,
    /// By what the iterate was chosen.
    pub criterion: Criterion,
    /// Which it is.
    pub best: usize,
    /// Of so many.
    pub iterates: usize,
    /// Mean part of the outputs' mean square that a simulation does not meet.
    pub simulated_error: SimulatedError,
    /// Every parameter.
    pub parameters: Vec<RecursiveValue>,
    /// The iterates, thinned.
    pub history: Vec<Iterates>,
    /// Equations that are no regressions.
    pub refused: Vec<RefusalDocument>,
    /// Free parameters that are not estimated.
    pub kept: Vec<String>,
}

/// Errors of simulations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SimulatedError {
    /// With the chosen iterate.
    pub best: Option<f64>,
    /// With the last one.
    pub last: Option<f64>,
    /// With least squares of all steps.
    pub all_steps: Option<f64>,
}

/// A parameter by recursive least squares.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecursiveValue {
    /// Its name.
    pub name: String,
    /// The run whose value it is.
    pub run: Option<String>,
    /// Its unit.
    pub unit: Option<String>,
    /// Its value in the chosen iterate.
    pub value: Option<f64>,
    /// The standard error of that.
    pub standard_error: Option<f64>,
    /// Its last value.
    pub last: Option<f64>,
    /// By least squares of all steps.
    pub all_steps: f64,
}

/// One iterate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Iterates {
    /// Its number.
    pub iterate: usize,
    /// The run.
    pub run: String,
    /// Time of the sample behind the step.
    pub time: f64,
    /// Values of the parameters.
    pub values: Vec<f64>,
    /// Their standard errors.
    pub errors: Vec<f64>,
    /// Root mean square of all steps' errors.
    pub one_step: f64,
    /// Error of a simulation, where there was one.
    pub simulated: Option<f64>,
}

impl RecursiveDocument {
    /// Of the chosen iterate and all others.
    pub fn of(found: &BestIterate) -> Self {
        let r = &found.recursion;
        let (best, last, count) = (r.iterates.get(found.best), r.iterates.last(), r.iterates.len());
        let parameters = r.parameters.iter().enumerate().map(|(j, p)| RecursiveValue {
            name: p.name.clone(),
            run: p.run.clone(),
            unit: p.unit.clone(),
            value: best.map(|b| b.values[j]),
            standard_error: best.map(|b| b.errors[j]),
            last: last.map(|l| l.values[j]),
            all_steps: r.batch[j],
        });
        // most iterates of a history; longer ones are thinned evenly
        let stride = count.div_ceil(1000).max(1);
        let kept = (0..count).filter(|k| k % stride == 0 || *k == found.best || k + 1 == count);
        let history = kept.map(|k| {
            let i = &r.iterates[k];
            Iterates {
                iterate: k,
                run: r.runs[i.run].name.clone(),
                time: i.time,
                values: i.values.clone(),
                errors: i.errors.clone(),
                one_step: i.one_step,
                simulated: found.error_of(k),
            }
        });
        Self {
            model: found.model.name().into(),
            method: "recursive least squares".into(),
            criterion: found.criterion,
            best: found.best,
            iterates: count,
            simulated_error: SimulatedError {
                best: found.error_of(found.best),
                last: count.checked_sub(1).and_then(|k| found.error_of(k)),
                all_steps: found.batch_error,
            },
            parameters: parameters.collect(),
            history: history.collect(),
            refused: r.refused.iter().map(RefusalDocument::from).collect(),
            kept: r.kept.clone(),
        }
    }
}
