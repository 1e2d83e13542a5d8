//! The experiments of a folder: every folder in it that has a description.

use super::description::Experiment;
use super::experiment_error::ExperimentError;
use fdm_grammar::diagnostic::nearest;
use std::path::{Path, PathBuf};

/// The experiments of a folder.
#[derive(Debug, Clone)]
pub struct Catalogue {
    /// All of them, by name.
    pub experiments: Vec<Experiment>,
}

/// A name that no experiment has.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no experiment `{name}`{}; there are {}", nearest.as_ref().map_or(String::new(), |n| format!("; did you mean `{n}`?")), known.join(", "))]
pub struct UnknownName {
    /// As typed.
    pub name: String,
    /// The one that may be meant.
    pub nearest: Option<String>,
    /// All.
    pub known: Vec<String>,
}

impl Catalogue {
    /// Reads all experiments below a folder.
    ///
    /// # Errors
    /// [`ExperimentError::Unreadable`] when the folder cannot be read, and what [`Experiment::read`] says of the first that is wrong.
    pub fn open(folder: &Path) -> Result<Self, ExperimentError> {
        let unreadable = |e: std::io::Error| ExperimentError::Unreadable {
            file: folder.into(),
            reason: fdm_results::store::reason(&e),
        };
        let entries = std::fs::read_dir(folder).map_err(unreadable)?;
        let mut folders: Vec<PathBuf> =
            entries.flatten().map(|e| e.path()).filter(|p| p.join(Experiment::FILE).is_file()).collect();
        folders.sort();
        let experiments = folders.iter().map(|f| Experiment::read(f)).collect::<Result<_, _>>()?;
        Ok(Self { experiments })
    }

    /// The experiment of this name alone, so that others may be broken: the folder of that name, else what all of them are called.
    ///
    /// # Errors
    /// As [`Self::open`]; [`ExperimentError::Unknown`].
    pub fn one(folder: &Path, name: &str) -> Result<Experiment, ExperimentError> {
        let own = folder.join(name);
        if own.join(Experiment::FILE).is_file() {
            return Experiment::read(&own);
        }
        Ok(Self::open(folder)?.find(name)?.clone())
    }

    /// The experiment of this name, upper or lower case.
    ///
    /// # Errors
    /// [`UnknownName`] with the nearest that there is.
    pub fn find(&self, name: &str) -> Result<&Experiment, UnknownName> {
        let same = |other: &String| other.eq_ignore_ascii_case(name);
        let found = self.experiments.iter().find(|e| same(&e.name) || e.also.iter().any(same));
        found.ok_or_else(|| {
            let all = self.experiments.iter().flat_map(|e| e.also.iter().chain([&e.name])).map(String::as_str);
            let lower = name.to_lowercase();
            let near = nearest(name, all.clone()).or_else(|| nearest(&lower, all)).map(String::from);
            let known = self.experiments.iter().map(|e| e.name.clone()).collect();
            UnknownName { name: name.into(), nearest: near, known }
        })
    }
}
