//! The steps of an experiment whose estimates have a truth, again and again with other noise.

use super::description::{Experiment, Stage, Task};
use super::evaluation::evaluated;
use super::experiment_error::ExperimentError;
use super::setting::Found;
use super::setting::{Setting, Shelf};
use super::signal::Colour;
use fdm_estimate::{Domain, FitOptions, Method, ParameterEstimate, Status};
use fdm_system::Model;
use fdm_system::record::Run;
use std::collections::{BTreeMap, BTreeSet};

/// An experiment cut down to the steps that estimate from records with noise what a truth knows.
#[derive(Debug, Clone)]
pub struct Rehearsal {
    experiment: Experiment,
    /// Which steps are judged; the others are needed by them.
    judged: Vec<bool>,
    left_out: Vec<bool>,
}

/// What a step found, beside the truth.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StageAnswer {
    /// The step.
    pub step: String,
    /// Why there is no minimum.
    pub astray: Option<String>,
    /// Each parameter that was estimated and compared, with its true value.
    pub parameters: Vec<(ParameterEstimate, f64)>,
}

/// A step that fits measured records in the time domain, ready to be fitted.
pub struct MeasuredStage {
    /// The step.
    pub step: String,
    /// Its model.
    pub model: Model,
    /// Its records.
    pub runs: Vec<Run>,
    /// How it fits them.
    pub options: FitOptions,
}

impl Stage {
    /// Whether its estimates are to agree with a truth, so that intervals can be judged.
    fn has_truth(&self, experiment: &Experiment) -> bool {
        let noisy = |name: &String| {
            let noise =
                experiment.record(name).map(|r| r.noise.values().any(|n| n.deviation > 0.0) && r.file.is_none());
            noise == Some(true)
        };
        let names = self.taken(experiment);
        matches!(self.method, Task::Estimation(method) if method != Method::EquationError)
            && self.compared != Some(false)
            && !self.says.astray
            && self.says.biased.is_empty()
            && !names.is_empty()
            && names.iter().all(noisy)
    }

    /// The records that it is fitted to.
    fn taken(&self, experiment: &Experiment) -> Vec<String> {
        if self.records.is_empty() {
            experiment.record_names().map(String::from).collect()
        } else {
            self.records.clone()
        }
    }
}

impl Rehearsal {
    /// Of an experiment, with the noise that it describes or of another colour (at the distance of each record's samples); without long steps when `thin`. None
    /// when no step of it has a truth.
    pub fn new(experiment: &Experiment, colour: Option<&dyn Fn(f64) -> Colour>, thin: bool) -> Option<Self> {
        let mut experiment = experiment.clone();
        let judged: Vec<bool> =
            experiment.stages.iter().map(|s| s.has_truth(&experiment) && !(thin && s.long)).collect();
        if !judged.contains(&true) {
            return None;
        }
        let mut needed = judged.clone();
        for k in (0..needed.len()).rev().filter(|k| judged[*k] || needed[*k]).collect::<Vec<_>>() {
            let stage = &experiment.stages[k];
            let before: Vec<&String> = stage.held.keys().chain(&stage.from).collect();
            let places: Vec<usize> = (0..k).filter(|n| before.contains(&&experiment.stages[*n].name)).collect();
            places.into_iter().for_each(|n| needed[n] = true);
        }
        for record in &mut experiment.records {
            let dt = record.dt;
            if let Some(colour) = colour {
                record.noise.values_mut().for_each(|noise| noise.colour = colour(dt));
            }
        }
        for stage in &mut experiment.stages {
            // what is only told costs time
            stage.predict.clear();
            stage.expected.clear();
            stage.confidence = false;
            stage.says = super::description::Says::default();
        }
        let left_out = needed.iter().map(|n| !n).collect();
        Some(Self { experiment, judged, left_out })
    }

    /// What the judged steps find when all noise is that of a repeat of this name.
    ///
    /// # Errors
    /// [`ExperimentError`], where the description does not fit its models and records.
    pub fn once(&self, repeat: &str) -> Result<Vec<StageAnswer>, ExperimentError> {
        let mut experiment = self.experiment.clone();
        experiment.records.iter_mut().for_each(|r| r.repeat = Some(repeat.into()));
        let done = evaluated(&experiment, &self.left_out, &answer)?;
        let answers = done.into_iter().zip(&self.judged).filter(|(_, judged)| **judged);
        Ok(answers.filter_map(|(done, _)| done.map(|(_, answer)| answer)).collect())
    }
}

fn answer(stage: &Stage, setting: &Setting, found: &Found) -> StageAnswer {
    let compared = |p: &&ParameterEstimate| {
        let estimated = !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied);
        estimated && !stage.except.contains(&p.name)
    };
    let beside = |p: &ParameterEstimate| Some((p.clone(), setting.truth(&p.name, p.run.as_deref())?));
    let parameters = found.parameters.iter().filter(compared).filter_map(beside).collect();
    StageAnswer { step: stage.name.clone(), astray: found.astray.clone(), parameters }
}

/// The steps of an experiment that fit measured records in the time domain, from start values that need no earlier step.
///
/// # Errors
/// [`ExperimentError`], where the description does not fit its models and records.
pub fn measured_stages(experiment: &Experiment, thin: bool) -> Result<Vec<MeasuredStage>, ExperimentError> {
    let measured = |stage: &&Stage| {
        let names = stage.taken(experiment);
        stage.method == Task::Estimation(Method::OutputError)
            && stage.domain != Some(Domain::Frequency)
            && !(thin && stage.long)
            && stage.held.is_empty()
            && stage.from.is_none()
            && !names.is_empty()
            && names.iter().all(|name| experiment.record(name).is_some_and(|r| r.file.is_some()))
    };
    let ready = |stage: &Stage| {
        let mut stage = stage.clone();
        (stage.confidence, stage.predict) = (false, Vec::new());
        let names = stage.taken(experiment);
        let wanted: BTreeSet<&str> = names.iter().map(String::as_str).collect();
        let shelf = Shelf::filled(experiment, &wanted)?;
        let setting = Setting::new(experiment, &stage, &shelf, &BTreeMap::new())?;
        let options = stage.in_time(&setting);
        Ok(MeasuredStage { step: stage.name, model: setting.model, runs: setting.runs, options })
    };
    experiment.stages.iter().filter(measured).map(ready).collect()
}
