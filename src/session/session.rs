//! What a verb works on: a model with its runs, wherever they come from.

use crate::answer::Wanted;
use crate::campaign::RecordFile;
use crate::failure::Failure;
use crate::records::{judged, number_equal_names, refuse_findings, told_apart};
use fdm_estimate::Noise;
use fdm_results::documents::JudgedRecords;
use fdm_results::store::{DataFile, Identity, Manifest};
use fdm_system::Model;
use fdm_system::record::{ReadOptions, Run, Summary};

/// A file of a run.
#[derive(Debug, Clone)]
pub struct Source {
    /// The file, and how it is read.
    pub file: RecordFile,
    /// How files are read of which nothing else is said.
    pub(crate) common: ReadOptions,
}

/// Where a run comes from.
#[derive(Debug, Clone, Default)]
pub struct Origin {
    /// The file; none of samples that were in memory.
    pub source: Option<Source>,
    /// What was found while it was read; none of samples that were in memory.
    pub summary: Option<Summary>,
}

/// A run, and where it comes from.
#[derive(Debug, Clone)]
pub struct Record {
    /// The samples.
    pub run: Run,
    /// Where they come from.
    pub origin: Origin,
}

impl Record {
    /// Samples that are in memory.
    pub fn in_memory(run: Run) -> Self {
        Self { run, origin: Origin::default() }
    }
}

/// What a verb works on: a model, runs that are fitted, and runs that are predicted.
#[derive(Debug, Clone)]
pub struct Session {
    /// The model, made for the groups of the runs.
    pub model: Model,
    /// The runs that are fitted.
    pub runs: Vec<Run>,
    /// The runs that are predicted; their names differ from those of the fitted ones.
    pub validation: Vec<Run>,
    /// Where the runs come from, the fitted ones first.
    origins: Vec<Origin>,
    /// What was assumed about the runs and found in them; none where that is nothing, and before they are judged.
    pub judged: Option<JudgedRecords>,
    /// The command that would do the same, as results tell it.
    pub command: Vec<String>,
}

impl Session {
    /// Of a model and its runs; those of one name are numbered.
    pub fn new(model: Model, fitted: Vec<Record>, validation: Vec<Record>) -> Self {
        let count = fitted.len();
        let (mut runs, origins): (Vec<Run>, Vec<Origin>) =
            fitted.into_iter().chain(validation).map(|record| (record.run, record.origin)).unzip();
        number_equal_names(runs[..count].iter_mut().collect());
        number_equal_names(runs[count..].iter_mut().collect());
        told_apart(runs.iter_mut().map(|run| &mut run.name).collect(), count);
        let validation = runs.split_off(count);
        Self { model, runs, validation, origins, judged: None, command: Vec::new() }
    }

    /// With the command that results tell.
    pub fn of_command(self, command: Vec<String>) -> Self {
        Self { command, ..self }
    }

    /// With what the quick tests of the doctor find in all runs; their leading findings are told unless it is to be `quiet`.
    ///
    /// # Errors
    /// [`Failure::Strict`], where something is found and `strict` refuses to go on.
    pub fn judged(mut self, strict: bool, quiet: bool) -> Result<Self, Failure> {
        self.judged = judged(&self.model, self.read());
        refuse_findings(self.judged.as_ref(), strict, quiet)?;
        Ok(self)
    }

    /// All runs, the fitted ones first.
    pub fn all(&self) -> Vec<Run> {
        self.runs.iter().chain(&self.validation).cloned().collect()
    }

    /// All runs with what was found while they were read.
    pub(crate) fn read(&self) -> impl Iterator<Item = (&Run, Option<&Summary>)> {
        self.runs.iter().chain(&self.validation).zip(self.origins.iter().map(|origin| origin.summary.as_ref()))
    }

    /// The runs that are fitted, and where they come from.
    pub(crate) fn fitted(&self) -> impl Iterator<Item = (&Run, &Origin)> {
        self.runs.iter().zip(&self.origins)
    }

    /// The runs that are fitted, as records.
    pub fn records(&self) -> Vec<Record> {
        self.fitted().map(|(run, origin)| Record { run: run.clone(), origin: origin.clone() }).collect()
    }

    /// The files of all runs that were read from some, the fitted ones first.
    pub(crate) fn files(&self) -> Vec<RecordFile> {
        self.origins.iter().filter_map(|origin| origin.source.as_ref()).map(|source| source.file.clone()).collect()
    }

    /// How files are read of which nothing else is said.
    fn reading(&self) -> ReadOptions {
        self.origins.iter().find_map(|origin| origin.source.as_ref()).map(|s| s.common.clone()).unwrap_or_default()
    }

    /// What a result of the fitted runs was made from.
    pub(crate) fn manifest(&self, identity: Identity, noise: Noise, wanted: Wanted) -> Manifest {
        self.described(Manifest::new(&self.model, identity, noise), wanted, self.runs.len())
    }

    /// What a diagnosis of all runs was made from.
    pub(crate) fn manifest_of_diagnosis(&self, identity: Identity, noise: Noise, wanted: Wanted) -> Manifest {
        self.described(Manifest::of_diagnosis(&self.model, identity, noise), wanted, self.origins.len())
    }

    fn described(&self, mut manifest: Manifest, wanted: Wanted, runs: usize) -> Manifest {
        manifest.command.clone_from(&self.command);
        // files are read for their fingerprints
        if wanted.files {
            manifest.reading = self.reading();
            let all = self.runs.iter().chain(&self.validation).zip(&self.origins).take(runs);
            manifest.data = all.map(|(run, origin)| data_file(run, origin, &manifest.reading)).collect();
        }
        manifest
    }
}

/// A run as a result tells it; how its file was read is said where it differs from the `common` way.
fn data_file(run: &Run, origin: &Origin, common: &ReadOptions) -> DataFile {
    match &origin.source {
        Some(Source { file, .. }) => DataFile {
            reading: Some(file.options.clone()).filter(|own| own != common),
            ..DataFile::new(&run.name, &file.path)
        },
        None => DataFile {
            run: run.name.clone(),
            file: String::new(),
            path: None,
            bytes: None,
            sha256: None,
            reading: None,
        },
    }
}
