//! What a step of the evaluation works on: its model, its runs, its start values, and what the truth is.

use super::description::{Experiment, Record, Stage, Task};
use super::experiment_error::{ExperimentError, Fault};
use super::flight::flown;
use super::stage::Found;
use super::table::Table;
use fdm_estimate::Changes;
use fdm_grammar::model::{Origin, Param};
use fdm_system::Model;
use fdm_system::record::{ReadOptions, Run, channels, read};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// All records of an experiment as files.
pub(super) struct Shelf {
    /// Names of runs and their files, for each record.
    files: BTreeMap<String, Vec<(String, PathBuf)>>,
    /// Holds what was made.
    _made: tempfile::TempDir,
}

impl Shelf {
    /// Makes what is to be made of these records.
    pub(super) fn filled(experiment: &Experiment, wanted: &BTreeSet<&str>) -> Result<Self, ExperimentError> {
        let unwritable = |e: std::io::Error| {
            let (file, reason) = (std::env::temp_dir(), fdm_results::store::reason(&e));
            ExperimentError::Unreadable { file, reason }
        };
        let made = tempfile::tempdir().map_err(unwritable)?;
        let mut files = BTreeMap::new();
        for record in experiment.records.iter().filter(|r| wanted.contains(r.name.as_str())) {
            let named = |table: &Table| Ok((table.name.clone(), table.write(made.path())?));
            let places: Result<Vec<_>, ExperimentError> = match (&record.file, &record.truth) {
                (Some(file), _) => Ok(vec![(record.name.clone(), experiment.folder.join(file))]),
                (None, Some(truth)) => flown(experiment, record, truth)?.iter().map(named).collect(),
                (None, None) => Ok(Vec::new()),
            };
            files.insert(record.name.clone(), places?);
        }
        Ok(Self { files, _made: made })
    }

    /// The runs of some records for a model.
    fn runs(&self, names: &[String], model: &Model, stage: &Stage) -> Result<Vec<Run>, ExperimentError> {
        let declared = model.definition().inputs.iter().filter(|i| i.is_declared() && !i.known);
        let names_of = declared.map(|i| i.quantity.name.clone());
        let straight = names_of.filter(|name| !stage.hold.contains(name)).collect();
        let options = ReadOptions {
            map: stage.map.iter().map(|(channel, column)| (channel.clone(), column.clone())).collect(),
            from: stage.window.map(|w| w[0]),
            to: stage.window.map(|w| w[1]),
            every: stage.every.unwrap_or(1),
            hold: stage.hold.clone(),
            // an experiment is explicit: what it does not hold goes in straight lines, as it was flown
            linear: straight,
            ..ReadOptions::default()
        };
        let channels = channels(model.definition());
        let mut runs = Vec::new();
        for (name, file) in names.iter().filter_map(|n| self.files.get(n)).flatten() {
            let (run, _) = read(file, &channels, &options)?;
            runs.push(Run { name: name.clone(), ..run });
        }
        Ok(runs)
    }

    /// The record that a run belongs to.
    fn record_of(&self, run: &str) -> Option<&str> {
        let has = |files: &[(String, PathBuf)]| files.iter().any(|(name, _)| name == run);
        self.files.iter().find(|(_, files)| has(files)).map(|(record, _)| record.as_str())
    }
}

/// What a step works on.
pub(super) struct Setting {
    pub(super) model: Model,
    pub(super) runs: Vec<Run>,
    /// Runs that are predicted.
    pub(super) others: Vec<Run>,
    pub(super) changes: Changes,
    /// True values by parameter and, where it has its own there, run.
    truth: BTreeMap<(String, Option<String>), f64>,
}

impl Setting {
    /// Collects it; `earlier` are the results of the steps that this one needs.
    pub(super) fn new(
        experiment: &Experiment,
        stage: &Stage,
        shelf: &Shelf,
        earlier: &BTreeMap<&str, &Found>,
    ) -> Result<Self, ExperimentError> {
        let model = Model::from_file(experiment.folder.join(&stage.model))?;
        let all = || experiment.records.iter().map(|r| r.name.clone()).collect::<Vec<_>>();
        let names = if stage.records.is_empty() { all() } else { stage.records.clone() };
        let (mut runs, mut others) = (Vec::new(), Vec::new());
        if stage.method != Task::Modes {
            runs = shelf.runs(&names, &model, stage)?;
            others = shelf.runs(&stage.predict, &model, stage)?;
        }
        let mut setting = Self { model, runs, others, changes: Changes::default(), truth: BTreeMap::new() };
        setting.find_truth(experiment, &names, shelf)?;
        setting.changes = setting.changed(stage, earlier);
        setting.check_names(experiment, stage, earlier)?;
        Ok(setting)
    }

    fn find_truth(
        &mut self,
        experiment: &Experiment,
        records: &[String],
        shelf: &Shelf,
    ) -> Result<(), ExperimentError> {
        let mut models: BTreeMap<&str, Model> = BTreeMap::new();
        for record in records.iter().filter_map(|name| experiment.record(name)) {
            let Some(file) = record.truth.as_deref().filter(|_| record.file.is_none()) else { continue };
            if !models.contains_key(file) {
                models.insert(file, Model::from_file(experiment.folder.join(file))?);
            }
            let values = true_values(&models[file], record);
            let params = &self.model.definition().params;
            for param in params {
                let name = &param.quantity.name;
                let Some(value) = values.get(name).copied() else { continue };
                if param.per_run {
                    let own = self.runs.iter().filter(|r| shelf.record_of(&r.name) == Some(&record.name));
                    self.truth.extend(own.map(|r| ((name.clone(), Some(r.name.clone())), value)));
                } else {
                    self.truth.entry((name.clone(), None)).or_insert(value);
                }
            }
        }
        Ok(())
    }

    /// The true value of a parameter, or of a parameter of a run.
    pub(super) fn truth(&self, name: &str, run: Option<&str>) -> Option<f64> {
        self.truth.get(&(name.to_string(), run.map(String::from))).copied()
    }

    fn changed(&self, stage: &Stage, earlier: &BTreeMap<&str, &Found>) -> Changes {
        let params = &self.model.definition().params;
        let mut set: BTreeMap<String, f64> = BTreeMap::new();
        let open = |p: &&Param| {
            (!p.fixed || stage.free.contains(&p.quantity.name)) && !p.per_run && p.origin == Origin::Declared
        };
        if stage.off != 0.0 {
            for (k, p) in params.iter().filter(open).enumerate() {
                let factor = if k % 2 == 0 { 1.0 + stage.off } else { 1.0 - stage.off };
                let value = self.truth(&p.quantity.name, None).unwrap_or(p.value) * factor;
                set.insert(p.quantity.name.clone(), value.clamp(p.lower, p.upper));
            }
        }
        if let Some(found) = stage.from.as_deref().and_then(|name| earlier.get(name)) {
            let known =
                found.parameters.iter().filter(|f| f.run.is_none() && params.iter().any(|p| p.quantity.name == f.name));
            set.extend(known.map(|f| (f.name.clone(), f.value)));
        }
        let mut fix = stage.fix.clone();
        for (step, names) in &stage.held {
            let Some(found) = earlier.get(step.as_str()) else { continue };
            for value in found.parameters.iter().filter(|f| names.contains(&f.name)) {
                set.insert(value.name.clone(), value.value);
                fix.push(value.name.clone());
            }
        }
        set.extend(stage.set.iter().map(|(name, value)| (name.clone(), *value)));
        Changes { set: set.into_iter().collect(), fix, free: stage.free.clone() }
    }

    /// Names of parameters that the model does not have.
    fn check_names(
        &self,
        experiment: &Experiment,
        stage: &Stage,
        earlier: &BTreeMap<&str, &Found>,
    ) -> Result<(), ExperimentError> {
        let d = self.model.definition();
        let params = || {
            d.params.iter().map(|p| p.quantity.name.as_str()).chain(d.derived.iter().map(|d| d.quantity.name.as_str()))
        };
        let says = &stage.says;
        let lists = [&stage.fix, &stage.free, &stage.except, &says.undetermined, &says.determined, &says.biased];
        let flat = says.not_identifiable.iter().chain(&says.weak).chain(&says.order).flatten();
        let held = stage.held.values().flatten();
        let named = lists.into_iter().flatten().chain(flat).chain(held).chain(stage.set.keys());
        let place = || format!("step `{}`", stage.name);
        let unknown = named.filter(|name| !params().any(|p| p == name.as_str()));
        let mut faults: Vec<Fault> = unknown.map(|name| Fault::unknown(place(), "parameter", name, params())).collect();
        for (step, names) in &stage.held {
            // what went astray is told by its own check
            let Some(found) = earlier.get(step.as_str()).filter(|f| !f.parameters.is_empty()) else { continue };
            let known = || found.parameters.iter().map(|p| p.name.as_str());
            let lost = names.iter().filter(|name| !known().any(|own| own == name.as_str()));
            faults.extend(lost.map(|name| Fault::unknown(place(), "earlier parameter", name, known())));
        }
        if faults.is_empty() {
            return Ok(());
        }
        Err(ExperimentError::Faults { file: experiment.folder.join(Experiment::FILE), faults })
    }
}

/// Parameters of a truth as a record has them.
fn true_values(truth: &Model, record: &Record) -> BTreeMap<String, f64> {
    let params = truth.definition().params.iter();
    let value = |p: &Param| record.values.get(&p.quantity.name).copied().unwrap_or(p.value);
    params.map(|p| (p.quantity.name.clone(), value(p))).collect()
}
