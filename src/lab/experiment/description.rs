//! What the file of an experiment may say.

use super::amount::Tolerance;
use super::experiment_error::ExperimentError;
use super::signal::Noise;
use super::signal::Signal;
use fdm_estimate::{Domain, Method, StartValues};
use fdm_grammar::number::{Unheld, held};
use serde::de::{self, IntoDeserializer};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// An experiment: records, the steps of their evaluation, what must come out.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Name of its folder.
    #[serde(skip)]
    pub name: String,
    /// Where its models and records lie.
    #[serde(skip)]
    pub folder: PathBuf,
    /// The system in a few words.
    pub title: String,
    /// Who published it, or who measured it.
    pub source: String,
    /// Other names of the system.
    #[serde(default)]
    pub also: Vec<String>,
    /// Whether the paper's figure is reproduced, and why not where it is not.
    #[serde(default)]
    pub remark: String,
    /// How records are made or where they are.
    #[serde(default, rename = "record")]
    pub records: Vec<Record>,
    /// Steps of the evaluation.
    #[serde(default, rename = "step")]
    pub stages: Vec<Stage>,
}

/// One record, or several segments of one flight.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Record {
    /// Its name.
    pub name: String,
    /// A measured record beside the experiment's file; everything else belongs to records that are made.
    pub file: Option<String>,
    /// The model that makes the record.
    pub truth: Option<String>,
    /// Parameters of the truth that differ from its start values.
    pub values: BTreeMap<String, f64>,
    /// Time between samples, in the model's unit of time.
    pub dt: f64,
    /// Time of the last sample.
    pub duration: f64,
    /// Parts of the flight that become records of their own.
    pub segments: Option<Segments>,
    /// What moves each input: the sum of these.
    pub inputs: BTreeMap<String, Vec<Signal>>,
    /// The controller: a model whose inputs are measured outputs and commands, and whose outputs are inputs of the truth one sample later.
    pub controller: Option<String>,
    /// Measurement noise of each output; `all` for those that are not named.
    pub noise: BTreeMap<String, Noise>,
    /// Significant digits that are kept.
    pub digits: Option<usize>,
    /// Decides noise and random phases.
    pub seed: u64,
    /// Noise and gusts are those of this repeat, while random phases stay; none for the record itself.
    #[serde(skip)]
    pub repeat: Option<String>,
    /// So many of them, each with noise and phases of its own.
    pub copies: Option<u32>,
    /// Runge-Kutta steps between samples; chosen by accuracy when not given (8 in a closed loop).
    pub steps: Option<usize>,
}

/// Parts of one flight.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segments {
    /// When each begins.
    pub begin: Vec<f64>,
    /// How long each is.
    pub length: f64,
}

/// What a step does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// Parameters are estimated by this method.
    Estimation(Method),
    /// Recursive least squares, and the best of its iterates.
    RecursiveLeastSquares,
    /// Nothing is estimated: eigenvalues of the model as it stands.
    Modes,
}

impl Default for Task {
    fn default() -> Self {
        Self::Estimation(Method::default())
    }
}

impl<'de> Deserialize<'de> for Task {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        const WORDS: [&str; 6] = [
            "output-error",
            "frequency-response",
            "filter-error",
            "recursive-least-squares",
            "equation-error",
            "modes",
        ];
        let word = String::deserialize(from)?;
        match word.as_str() {
            "recursive-least-squares" => Ok(Self::RecursiveLeastSquares),
            "modes" => Ok(Self::Modes),
            method => {
                let unknown = |_: de::value::Error| de::Error::unknown_variant(method, &WORDS);
                Method::deserialize(method.into_deserializer()).map(Self::Estimation).map_err(unknown)
            }
        }
    }
}

/// A step of the evaluation.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Stage {
    /// Its name.
    pub name: String,
    /// The model that is fitted.
    pub model: String,
    /// Records that it is fitted to; all when none is named.
    pub records: Vec<String>,
    /// What it does.
    pub method: Task,
    /// Where output error compares: in time when not given.
    pub domain: Option<Domain>,
    /// All start values are off by this part of the truth, up and down in turn.
    pub off: f64,
    /// Other start values.
    pub set: BTreeMap<String, f64>,
    /// Parameters that are not estimated.
    pub fix: Vec<String>,
    /// Parameters that are estimated although the model declares them `fixed`.
    pub free: Vec<String>,
    /// Parameters that keep what an earlier step found: its name, and theirs.
    pub held: BTreeMap<String, Vec<String>>,
    /// The step whose result the start values are.
    pub from: Option<String>,
    /// Columns of channels whose names differ.
    pub map: BTreeMap<String, String>,
    /// Inputs that keep their value until the next sample.
    pub hold: Vec<String>,
    /// Every n-th sample only.
    pub every: Option<usize>,
    /// First and last time that is used.
    pub window: Option<[f64; 2]>,
    /// Whether the full covariance of the noise is estimated.
    pub full_noise: bool,
    /// Frequencies in cycles per unit of time, for spectra and equation error.
    pub band: Option<[f64; 2]>,
    /// Their distance; the record's own when not given.
    pub df: Option<f64>,
    /// End-point corrections: `free`, `known` or `none`.
    pub end_points: Option<String>,
    /// Nonlinear terms: `measured-regressors` or `linearise`.
    pub nonlinear: Option<String>,
    /// Standard deviations of the noise of recorded inputs, for spectra.
    pub input_noise: BTreeMap<String, f64>,
    /// Where a fit of spectra begins: at equation-error estimates when not given.
    pub start_values: Option<StartValues>,
    /// Principal components of equation error: `auto`, `level` or a number.
    pub components: Option<String>,
    /// Samples in the window by which equation error takes rates.
    pub smooth: Option<usize>,
    /// Weight of a sample of recursive least squares relative to the one behind it.
    pub forgetting: Option<f64>,
    /// Cut-off of a low-pass without phase before recursive least squares, in cycles per unit of time.
    pub lowpass: Option<f64>,
    /// Samples of the polynomial that smooths records before recursive least squares.
    pub polynomial: Option<usize>,
    /// Length of the parts that are simulated to find the best iterate of recursive least squares, each from initial values of its own.
    pub restart: Option<f64>,
    /// States whose records take their place in a first fit.
    pub substitute: Vec<String>,
    /// Segments of multiple shooting.
    pub shooting: Option<usize>,
    /// Starts spread over the bounds.
    pub starts: Option<usize>,
    /// Shorter records are fitted too, which orders the parameters by confidence.
    pub confidence: bool,
    /// Records that are predicted with what was found.
    pub predict: Vec<String>,
    /// How far estimates may be from the truth, where nothing else is said.
    pub within: Vec<Tolerance>,
    /// Estimates that are not compared with the truth.
    pub except: Vec<String>,
    /// Whether estimates are compared with the parameters of the truth.
    pub compared: Option<bool>,
    /// Figures that are expected: parameters, or `rms(y)`, `r2(y)`, `tic(y)`, ...
    pub expected: BTreeMap<String, Expected>,
    /// Eigenvalues that are expected: real and imaginary part.
    pub modes: Vec<[f64; 2]>,
    /// What the paper has: value, and its error where it is printed.
    pub paper: BTreeMap<String, Answer>,
    /// What must be said.
    pub says: Says,
    /// Left out when the experiment is thinned.
    pub long: bool,
}

/// A figure that is expected.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Expected {
    /// The figure.
    pub value: Option<f64>,
    /// How far it may be off: all of these hold.
    pub within: Vec<Tolerance>,
    /// Least admissible.
    pub least: Option<f64>,
    /// Greatest admissible.
    pub most: Option<f64>,
}

/// A figure of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Answer {
    /// A value.
    Value(f64),
    /// A value and its error.
    WithError([f64; 2]),
}

/// Statements that must come out.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Says {
    /// Parameters that these data do not determine: a bound only.
    pub undetermined: Vec<String>,
    /// Parameters that differ from zero by more than four errors.
    pub determined: Vec<String>,
    /// Parameters that are off the truth by more than three errors.
    pub biased: Vec<String>,
    /// A combination that is not identifiable: it has these parameters.
    pub not_identifiable: Vec<Vec<String>>,
    /// A combination that is known worse than to its own size: these parameters stand in it.
    pub weak: Vec<Vec<String>>,
    /// Groups of parameters in the order of confidence.
    pub order: Vec<Vec<String>>,
    /// The fit must not come to an end.
    pub astray: bool,
}

impl Experiment {
    /// The name of an experiment's file in its folder.
    pub const FILE: &'static str = "experiment.toml";

    /// Reads the experiment of a folder.
    ///
    /// # Errors
    /// [`ExperimentError::Unreadable`], [`ExperimentError::Malformed`] with line and sentence, [`ExperimentError::Faults`] for names that nothing has.
    pub fn read(folder: &Path) -> Result<Self, ExperimentError> {
        let file = folder.join(Self::FILE);
        let text = fdm_results::store::read_input_text(&file)
            .map_err(|e| ExperimentError::Unreadable { file: file.clone(), reason: fdm_results::store::reason(&e) })?;
        let mut experiment: Self = toml::from_str(&text)
            .map_err(|e| ExperimentError::Malformed { file: file.clone(), reason: e.to_string().trim_end().into() })?;
        if let Some(reason) = unheld(&text) {
            return Err(ExperimentError::Malformed { file, reason });
        }
        experiment.name = folder.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        experiment.folder = folder.into();
        let faults = experiment.faults();
        if faults.is_empty() { Ok(experiment) } else { Err(ExperimentError::Faults { file, faults }) }
    }

    /// The files of all its models, in its folder; a file may be named more than once.
    pub fn models(&self) -> impl Iterator<Item = &str> {
        let records = self.records.iter().flat_map(|r| [r.truth.as_deref(), r.controller.as_deref()]).flatten();
        records.chain(self.stages.iter().map(|stage| stage.model.as_str())).filter(|name| !name.is_empty())
    }

    /// The names of all records.
    pub(super) fn record_names(&self) -> impl Iterator<Item = &str> {
        self.records.iter().map(|r| r.name.as_str())
    }

    /// The record of this name.
    pub fn record(&self, name: &str) -> Option<&Record> {
        self.records.iter().find(|r| r.name == name)
    }
}

/// The first number of a description that double precision does not hold, which would be read as zero or infinite.
fn unheld(text: &str) -> Option<String> {
    for (k, line) in text.lines().enumerate() {
        // texts in quotes have readers of their own
        let bare: String = line.split('"').step_by(2).collect::<Vec<_>>().join(" ");
        let bare = bare.split('#').next().unwrap_or_default();
        let words = bare.split(|c: char| !(c.is_ascii_alphanumeric() || "+-._".contains(c)));
        for word in
            words.filter(|w| w.contains(['e', 'E']) && w.starts_with(|c: char| c.is_ascii_digit() || "+-".contains(c)))
        {
            if let Err(unheld @ (Unheld::TooLarge | Unheld::TooSmall)) = held(&word.replace('_', "")) {
                return Some(format!("line {}: the number `{word}` {unheld}: {}", k + 1, unheld.hint()));
            }
        }
    }
    None
}

impl Stage {
    /// The records that it needs.
    pub(super) fn needed<'a>(&'a self, experiment: &'a Experiment) -> Vec<&'a str> {
        let none = self.method == Task::Modes;
        let all = experiment.record_names().filter(|_| self.records.is_empty());
        all.chain(self.records.iter().chain(&self.predict).map(String::as_str)).filter(|_| !none).collect()
    }
}
