//! What can be wrong with an experiment.

use super::catalogue::UnknownName;
use super::description::Experiment;
use fdm_grammar::diagnostic::nearest;
use fdm_system::model::ModelError;
use fdm_system::record::RecordError;
use fdm_system::simulate::{Divergence, Unsuited};
use std::fmt;
use std::path::PathBuf;

/// Why an experiment cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// Its file cannot be read.
    #[error("{}: {reason}", file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// What the operating system said.
        reason: String,
    },
    /// A record cannot be written.
    #[error("{}: {reason}", file.display())]
    Unwritable {
        /// The file.
        file: PathBuf,
        /// What the operating system said.
        reason: String,
    },
    /// Its file is not what it should be.
    #[error("{}: {reason}", file.display())]
    Malformed {
        /// The file.
        file: PathBuf,
        /// Place and sentence.
        reason: String,
    },
    /// What it says does not fit together.
    #[error("{}", faults.iter().map(|f| format!("{}: {f}", file.display())).collect::<Vec<_>>().join("\n"))]
    Faults {
        /// The file.
        file: PathBuf,
        /// All that does not.
        faults: Vec<Fault>,
    },
    /// There is none of this name.
    #[error(transparent)]
    Unknown(#[from] UnknownName),
    /// One of its models is not a model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A record cannot be read or written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// A record cannot be made by this model.
    #[error("record `{record}`: {fault}")]
    Flight {
        /// Its name.
        record: String,
        /// Why.
        fault: Fault,
    },
    /// A record cannot be simulated.
    #[error("record `{record}`: {reason}")]
    Unsuited {
        /// Its name.
        record: String,
        /// Why.
        reason: Unsuited,
    },
    /// The truth runs away.
    #[error("record `{record}`: the truth does not stay finite: {reason:?}")]
    Diverged {
        /// Its name.
        record: String,
        /// Where.
        reason: Divergence,
    },
}

/// A mistake in the description of an experiment.
#[derive(Debug, Clone, PartialEq)]
#[allow(missing_docs, reason = "the message of each variant says what its fields are")]
pub enum Fault {
    Nameless { what: &'static str },
    Twice { what: &'static str, name: String },
    Unknown { place: String, what: &'static str, name: String, nearest: Option<String> },
    NeitherFileNorTruth { record: String },
    NoTime { record: String },
    Word { place: String, word: String, wanted: &'static str },
    Unit { place: String, what: &'static str },
    NotInLoop { name: String },
    NoiseOfRecord { output: String },
    Unfed { input: String },
}

impl Fault {
    /// A name that nothing has, with the nearest that something has.
    pub fn unknown<'a>(
        place: impl Into<String>,
        what: &'static str,
        name: &str,
        known: impl Iterator<Item = &'a str>,
    ) -> Self {
        let hint = nearest(name, known).map(String::from);
        Self::Unknown { place: place.into(), what, name: name.into(), nearest: hint }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nameless { what } => write!(f, "a {what} has no name"),
            Self::Twice { what, name } => write!(f, "two {what}s are called `{name}`"),
            Self::Unknown { place, what, name, nearest } => {
                write!(f, "{place}: there is no {what} `{name}`")?;
                nearest.as_ref().map_or(Ok(()), |near| write!(f, "; did you mean `{near}`?"))
            }
            Self::NeitherFileNorTruth { record } => {
                write!(f, "record `{record}` has neither a `file` nor a `truth`, the model that makes it")
            }
            Self::NoTime { record } => {
                write!(f, "record `{record}` needs `dt` and `duration`, both above 0, and at most ten million samples")
            }
            Self::Word { place, word, wanted } => write!(f, "{place}: `{word}` is not one of {wanted}"),
            Self::Unit { place, what } => write!(f, "{place}: {what} has a unit that does not fit"),
            Self::NotInLoop { name } => {
                write!(
                    f,
                    "`{name}` has delays or derivatives of inputs, which a closed loop does not have here; close the loop in the truth's own text"
                )
            }
            Self::NoiseOfRecord { output } => {
                write!(
                    f,
                    "the noise of `{output}` is a part of the record, which a closed loop does not know beforehand; give it in its own unit"
                )
            }
            Self::Unfed { input } => {
                write!(f, "nothing moves the input `{input}`; give it a signal, `{input} = []` for none")
            }
        }
    }
}

impl Experiment {
    /// Names that nothing has, records without time.
    pub(super) fn faults(&self) -> Vec<Fault> {
        let mut faults = Vec::new();
        for (k, record) in self.records.iter().enumerate() {
            match &record.name {
                name if name.is_empty() => faults.push(Fault::Nameless { what: "record" }),
                name if self.records[..k].iter().any(|r| r.name == *name) => {
                    faults.push(Fault::Twice { what: "record", name: name.clone() });
                }
                _ => {}
            }
            let samples = record.duration / record.dt;
            if record.file.is_none() && record.truth.is_none() {
                faults.push(Fault::NeitherFileNorTruth { record: record.name.clone() });
            } else if record.truth.is_some() && !(samples.is_finite() && samples > 0.0 && samples < 1e7) {
                faults.push(Fault::NoTime { record: record.name.clone() });
            }
        }
        for (k, stage) in self.stages.iter().enumerate() {
            let before = &self.stages[..k];
            if stage.name.is_empty() {
                faults.push(Fault::Nameless { what: "step" });
            } else if before.iter().any(|s| s.name == stage.name) {
                faults.push(Fault::Twice { what: "step", name: stage.name.clone() });
            }
            let place = || format!("step `{}`", stage.name);
            for name in stage.records.iter().chain(&stage.predict) {
                if self.record(name).is_none() {
                    faults.push(Fault::unknown(place(), "record", name, self.records.iter().map(|r| r.name.as_str())));
                }
            }
            for name in stage.held.keys().chain(&stage.from) {
                if !before.iter().any(|s| s.name == *name) {
                    faults.push(Fault::unknown(place(), "earlier step", name, before.iter().map(|s| s.name.as_str())));
                }
            }
        }
        faults
    }
}
