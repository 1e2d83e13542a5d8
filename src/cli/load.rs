//! What a command works on: a model and the changes of its parameters, recorded runs, measurement noise, or a result that was
//! written before.

use crate::campaign::{RecordFile, Role, RunTable, expanded, group, known_value, mask};
use crate::delays::{DelayError, with_free_delays};
use crate::failure::{Failure, OrFailure, did_you_mean, remark, tell};
use crate::foreign_code::refuse_foreign_code;
use clap::Args;
use fdm_doctor::{AloneOptions, Finding, Record, examine_alone, examine_repeats, leading};
use fdm_estimate::{Changes, Noise};
use fdm_grammar::number::held;
use fdm_readers::{RecordMap, shipped};
use fdm_results::documents::JudgedRecords;
use fdm_results::store::{DataFile, Manifest, ResultFolder, differences, read_input_text, reason};
use fdm_system::Model;
use fdm_system::record::{Assumptions, Known, ReadOptions, Run, SampleMask, Summary, channels, questioned, read_each};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A model file and the changes of its parameters.
#[derive(Debug, Args)]
#[command(next_help_heading = "Parameters")]
pub(crate) struct ModelFile {
    /// Model file (.fdm)
    #[arg(value_name = "MODEL", help_heading = None)]
    pub(crate) model: PathBuf,
    /// Other start value of a parameter
    ///
    /// Free initial values are called `x(0)`.
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, f64)>,
    /// Switch off the tie of a parameter, so that it is estimated by itself; `all` for every tie
    #[arg(long, value_name = "NAME,...|all", value_delimiter = ',', hide_short_help = true)]
    untie: Vec<String>,
}

/// Which parameters are estimated, where that differs from the model's text.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Parameters")]
pub(crate) struct Estimated {
    /// Keep a parameter at its start value
    #[arg(long, value_name = "NAME")]
    fix: Vec<String>,
    /// Estimate a parameter that the model declares `fixed`
    #[arg(long, value_name = "NAME")]
    free: Vec<String>,
}

impl Estimated {
    /// Names to fix and to free.
    pub(crate) fn changes(&self) -> Changes {
        Changes { set: Vec::new(), fix: self.fix.clone(), free: self.free.clone() }
    }
}

impl ModelFile {
    /// Reads and compiles the model; warnings go to standard error.
    pub(crate) fn load(&self) -> Result<Model, Failure> {
        self.untied(&load_model(&self.model)?)
    }

    /// Reads and compiles the model for the groups of the runs, and with the delays that their maps leave free.
    pub(crate) fn load_for(&self, records: &Records) -> Result<Model, Failure> {
        let model = records.grouped(&load_model(&self.model)?)?;
        self.untied(&records.with_free_delays(&model)?)
    }

    /// A model with the ties switched off that were named.
    pub(crate) fn untied(&self, model: &Model) -> Result<Model, Failure> {
        model.untied(&self.untie).or_failure()
    }

    /// The model with the values that were typed.
    pub(crate) fn load_changed(&self, estimated: &Estimated) -> Result<Model, Failure> {
        with_changes(&self.load()?, &self.changes(estimated))
    }

    /// The changes of start values, together with names to fix and to free.
    pub(crate) fn changes(&self, estimated: &Estimated) -> Changes {
        Changes { set: self.set.clone(), ..estimated.changes() }
    }
}

/// A model, or a result that holds one with its estimates.
#[derive(Debug, Args)]
#[command(next_help_heading = "Parameters")]
pub(crate) struct ModelOrResult {
    /// Model file (.fdm); a result holds its own, and this must be the same
    #[arg(value_name = "MODEL", required_unless_present = "from_result", help_heading = None)]
    model: Option<PathBuf>,
    /// Other value of a parameter (free initial values are called `x(0)`)
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment)]
    pub(crate) set: Vec<(String, f64)>,
    /// Switch off the tie of a parameter, so that it has a value of its own; `all` for every tie
    #[arg(
        long,
        value_name = "NAME,...|all",
        value_delimiter = ',',
        conflicts_with = "from_result",
        hide_short_help = true
    )]
    untie: Vec<String>,
    /// Take model and parameters from a result folder that `fdm fit --out` wrote
    #[arg(long, value_name = "DIR")]
    from_result: Option<PathBuf>,
}

impl ModelOrResult {
    /// The model, and the result when one was named; values that were typed are not in the model yet.
    pub(crate) fn load(&self) -> Result<(Model, Option<ResultFolder>), Failure> {
        match (&self.from_result, &self.model) {
            (Some(folder), model) => {
                let (folder, model) = open_result(folder, model.as_deref())?;
                Ok((model, Some(folder)))
            }
            (None, Some(model)) => Ok((load_model(model)?.untied(&self.untie).or_failure()?, None)),
            (None, None) => Err(Failure::input(["a model or a result is needed"])),
        }
    }

    /// These arguments with another model or result in its place.
    pub(crate) fn of(&self, path: &Path) -> Self {
        Self::at(path, &self.set)
    }

    /// A model file, or the folder of a result, with other values.
    pub(crate) fn at(path: &Path, set: &[(String, f64)]) -> Self {
        let (model, from_result) = match path.is_dir() {
            true => (None, Some(path.to_path_buf())),
            false => (Some(path.to_path_buf()), None),
        };
        Self { model, from_result, set: set.to_vec(), untie: Vec::new() }
    }

    /// The model with the values that were typed.
    pub(crate) fn changed(&self, model: &Model) -> Result<Model, Failure> {
        with_changes(model, &Changes { set: self.set.clone(), ..Changes::default() })
    }
}

/// Reads and compiles a model; warnings go to standard error.
pub(crate) fn load_model(file: &Path) -> Result<Model, Failure> {
    let model = Model::from_file(file)?;
    refuse_foreign_code(&model).or_failure()?;
    tell(model.source(), model.warnings());
    Ok(model)
}

/// A model with these changes of its parameters.
pub(crate) fn with_changes(model: &Model, changes: &Changes) -> Result<Model, Failure> {
    let mut params = model.definition().params.clone();
    changes.apply(&mut params).map_err(Failure::input)?;
    Ok(model.with_params(params))
}

/// Opens a result and its model; a model that is given beside it must be the same.
pub(crate) fn open_result(folder: &Path, beside: Option<&Path>) -> Result<(ResultFolder, Model), Failure> {
    let folder = ResultFolder::open(folder).or_failure()?;
    let model = folder.model()?;
    refuse_foreign_code(&model).or_failure()?;
    if let Some(path) = beside {
        let other = Model::from_file(path)?;
        let other = other.untied(&model.open_ties()).unwrap_or(other);
        let differences = differences(&model, &other);
        if !differences.is_empty() {
            return Err(Failure::Input(vec![another_model(path, &folder, &differences)]));
        }
    }
    Ok((folder, model))
}

fn another_model(path: &Path, folder: &ResultFolder, differences: &[String]) -> String {
    const SHOWN: usize = 8;
    let place = folder.folder().display();
    let mut text = format!("{} is not the model of the result in {place}:", path.display());
    differences.iter().take(SHOWN).for_each(|d| text.push_str(&format!("\n  {d}")));
    if differences.len() > SHOWN {
        text.push_str(&format!("\n  and {} more", differences.len() - SHOWN));
    }
    text
}

/// The runs that were read, and their files.
pub(crate) struct Campaign {
    pub(crate) files: Vec<RecordFile>,
    pub(crate) runs: Vec<Run>,
    /// What was assumed about them and found in them; none where that is nothing.
    pub(crate) judged: Option<JudgedRecords>,
    /// How files are read of which nothing else is said.
    pub(crate) reading: ReadOptions,
}

impl Campaign {
    /// Writes into a result what it was made from.
    pub(crate) fn describe(&self, manifest: &mut Manifest) {
        manifest.reading = self.reading.clone();
        manifest.data = data_files(&self.files, &self.runs, &self.reading);
    }
}

/// Runs and their files as a result tells them; how a file was read is said where it differs from `reading`.
pub(crate) fn data_files(files: &[RecordFile], runs: &[Run], reading: &ReadOptions) -> Vec<DataFile> {
    let one = |(run, file): (&Run, &RecordFile)| DataFile {
        reading: Some(file.options.clone()).filter(|own| own != reading),
        ..DataFile::new(&run.name, &file.path)
    };
    runs.iter().zip(files).map(one).collect()
}

/// The runs that a result was fitted to.
pub(crate) fn fitted_before(folder: &ResultFolder, runs: &[Run], files: &[RecordFile]) -> Vec<String> {
    let files = runs.iter().zip(files).map(|(run, file)| DataFile::new(&run.name, &file.path));
    let fitted = |file: &DataFile| folder.manifest().data.iter().any(|own| own.is_same(file));
    files.filter(fitted).map(|file| file.run).collect()
}

/// Recorded runs: which files, and how they are read.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct Records {
    /// Recorded runs, as those behind the model
    ///
    /// CSV with a header `name [unit], ...`, or a log with --map-file, or patterns such as 'flights/*.csv'; `-` for standard input; may
    /// be given several times.
    #[arg(long = "data", value_name = "RUN", required_unless_present = "runs", num_args = 1.., group = "recorded")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) list: RunList,
    /// End with exit code 1 where anything but remarks is found in the records
    #[arg(long, hide_short_help = true)]
    pub(crate) strict: bool,
    #[command(flatten)]
    pub(crate) selection: Selection,
}

/// A table of runs.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct RunList {
    /// Table of runs: a row for each with its `file`
    ///
    /// Where wanted with `run` (name), `role` (fit or validation), `map`, `from`, `to`, `begin`, values (`known T0 per run`) and groups
    /// (`per group aircraft`).
    #[arg(long = "runs", value_name = "RUNS.csv", group = "recorded")]
    runs: Option<PathBuf>,
}

impl RunList {
    /// Whether there is one.
    pub(crate) fn is_given(&self) -> bool {
        self.runs.is_some()
    }

    /// The table, where one is given.
    pub(crate) fn table(&self) -> Result<Option<RunTable>, Failure> {
        self.runs.as_deref().map(RunTable::read).transpose()
    }

    /// The model for the groups of the table and of `--group`.
    pub(crate) fn grouped(&self, model: &Model, selection: &Selection) -> Result<Model, Failure> {
        let mut groups = self.table()?.map(|table| table.groups(model)).unwrap_or_default();
        for grouping in model.groupings() {
            if let Some((_, group)) = selection.group.iter().find(|(name, _)| name == grouping) {
                groups.entry(grouping.into()).or_insert_with(|| vec![group.clone()]);
            }
        }
        Ok(if groups.is_empty() { model.clone() } else { model.grouped(groups)? })
    }

    /// The files of the table, or those of `--data`, which are all of one role.
    pub(crate) fn files(
        &self,
        (data, role): (&[PathBuf], Role),
        options: &ReadOptions,
        model: &Model,
    ) -> Result<Vec<RecordFile>, Failure> {
        if let Some(table) = self.table()? {
            return table.files(model, options);
        }
        let one = |path| RecordFile { path, name: None, role, options: options.clone() };
        Ok(expanded(data)?.into_iter().map(one).collect())
    }
}

/// What is assumed about runs, and what the quick tests of the doctor find in them; none where that is nothing.
pub(crate) fn judged(model: &Model, records: &[(Run, Option<Summary>)]) -> Option<JudgedRecords> {
    let options = AloneOptions { kinematics: false, ..AloneOptions::default() };
    let seen: Vec<Record> =
        records.iter().map(|(run, summary)| Record::of_run(model.definition(), run, summary.as_ref())).collect();
    let mut findings: Vec<Finding> = seen.iter().flat_map(|record| examine_alone(record, &options)).collect();
    findings.extend(examine_repeats(&seen));
    fdm_doctor::sort(&mut findings);
    let assumed = records.iter().filter_map(|(run, summary)| Some(Assumptions::of(&run.name, summary.as_ref()?)));
    JudgedRecords { assumed: assumed.filter(|a| !a.sentences().is_empty()).collect(), findings }.unless_empty()
}

/// What is used of the files, and as what.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub(crate) struct Selection {
    /// Column of a channel when its name differs
    ///
    /// The time is called `t`; `y=log(c [mol/l])` takes logarithms.
    #[arg(long = "map", value_name = "NAME=COLUMN", value_parser = pair, requires = "recorded")]
    map: Vec<(String, String)>,
    /// Map of the channels: a file, or `px4`, `ardupilot`, `fti`
    ///
    /// It names fields of a log or columns, with unit, sign, scale, hold and delay.
    #[arg(long, value_name = "MAP", value_parser = map_file, requires = "recorded")]
    map_file: Option<RecordMap>,
    /// Use what can be read of a damaged log; what is lost is said
    #[arg(long, requires = "recorded", hide_short_help = true)]
    salvage: bool,
    /// Use the record from this time on, in the file's unit
    #[arg(long, value_parser = number, value_name = "TIME", allow_negative_numbers = true, requires = "recorded")]
    from: Option<f64>,
    /// Use the record up to this time, in the file's unit
    #[arg(long, value_parser = number, value_name = "TIME", allow_negative_numbers = true, requires = "recorded")]
    to: Option<f64>,
    /// Where the run begins: the instant that is the model's time 0, at the first sample or before, in the file's unit [default: the first sample]
    #[arg(long, value_parser = number, value_name = "TIME", allow_negative_numbers = true, requires = "recorded", hide_short_help = true)]
    begin: Option<f64>,
    /// Use every N-th sample
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        allow_negative_numbers = true,
        requires = "recorded",
        hide_short_help = true
    )]
    every: usize,
    /// Zero-order hold: this input keeps its value
    ///
    /// Until the next sample [default: as the model or the map says; else where it moves only at samples, all at once].
    #[arg(long, value_name = "INPUT", requires = "recorded")]
    zoh: Vec<String>,
    /// This input goes in straight lines between samples, whatever its samples look like
    #[arg(long, value_name = "INPUT", requires = "recorded", hide_short_help = true)]
    linear: Vec<String>,
    /// Leave an output out: it is not compared, whether it was measured or not; may be given several times
    #[arg(long = "without-output", value_name = "OUTPUT", requires = "recorded", hide_short_help = true)]
    without_output: Vec<String>,
    /// Value that the runs bring (`known T0 per run;`), in the model's unit or its own (`--known 'T0=20 degC'`)
    #[arg(long, value_name = "NAME=VALUE", value_parser = known_value, requires = "recorded", hide_short_help = true)]
    known: Vec<Known>,
    /// Group that the runs belong to (`param k per group aircraft;`)
    #[arg(long, value_name = "GROUPING=GROUP", value_parser = group, requires = "recorded", hide_short_help = true)]
    pub(crate) group: Vec<(String, String)>,
    /// Compare only the samples where this column holds a number that is not 0; of one output, or of all
    #[arg(long, value_name = "[OUTPUT=]COLUMN", value_parser = mask, requires = "recorded", hide_short_help = true)]
    mask: Vec<SampleMask>,
}

impl Records {
    /// The model for the groups of the runs.
    pub(crate) fn grouped(&self, model: &Model) -> Result<Model, Failure> {
        self.list.grouped(model, &self.selection)
    }

    /// The model with the delays that the maps of the fitted runs leave free.
    fn with_free_delays(&self, model: &Model) -> Result<Model, Failure> {
        let files = self.files(Role::Fit, &self.selection.options(true), model)?;
        let maps: Vec<&RecordMap> = files.iter().filter_map(|f| f.options.map_file.as_ref()).collect();
        let free = |map: &&RecordMap| map.channel.values().any(|c| c.free_delay.is_some());
        if !maps.iter().any(free) {
            return Ok(model.clone());
        }
        if maps.len() < files.len() {
            let said = "a map leaves a delay free, and some run has no map: give each run one";
            return Err(Failure::input([said]));
        }
        let (model, said) = with_free_delays(model, &maps).map_err(|e| match e {
            DelayError::Model(e) => Failure::Model(e),
            DelayError::Maps(wrong) => Failure::Input(wrong),
        })?;
        said.iter().for_each(|note| remark(format_args!("{note}")));
        Ok(model)
    }

    /// The files of the runs of a role; of those that `--data` names all are.
    pub(crate) fn files(&self, role: Role, options: &ReadOptions, model: &Model) -> Result<Vec<RecordFile>, Failure> {
        let of_list = self.list.runs.is_some();
        let mut files = self.list.files((&self.data, role), options, model)?;
        files.retain(|f| f.role == role);
        if files.is_empty() && role == Role::Fit && of_list {
            return Err(Failure::input(["--runs: no run has the role `fit`"]));
        }
        Ok(files)
    }

    /// The files of all runs, whatever their role.
    pub(crate) fn every(&self, options: &ReadOptions, model: &Model) -> Result<Vec<RecordFile>, Failure> {
        self.list.files((&self.data, Role::Fit), options, model)
    }

    /// The paths of all runs where there is no model.
    pub(crate) fn paths(&self) -> Result<Vec<PathBuf>, Failure> {
        self.list.table()?.map_or_else(|| expanded(&self.data), |table| table.paths())
    }

    /// The files of a role in the table of runs; none where there is no table.
    pub(crate) fn of_list(&self, role: Role, options: &ReadOptions, model: &Model) -> Result<Vec<RecordFile>, Failure> {
        if self.list.runs.is_some() { self.files(role, options, model) } else { Ok(Vec::new()) }
    }

    /// Reads all runs that are fitted, with all their outputs, and judges them by the quick tests of the doctor: three lines at most are
    /// said unless it is to be quiet.
    pub(crate) fn read(&self, model: &Model, quiet: bool) -> Result<Campaign, Failure> {
        self.say_left(model, quiet)?;
        self.read_files(model, Vec::new(), quiet).map(|(campaign, _)| campaign)
    }

    /// Reads all runs that are fitted together with validation runs, which are not: those of the role `validation` in
    /// the table of runs, and those `named` beside it. They are judged beside the others.
    ///
    /// # Errors
    /// A run of both kinds too.
    pub(crate) fn read_with_validation(
        &self,
        model: &Model,
        named: &[PathBuf],
        quiet: bool,
    ) -> Result<(Campaign, Vec<Run>), Failure> {
        let options = self.selection.options(true);
        let mut validation = self.of_list(Role::Validation, &options, model)?;
        let one = |path| RecordFile { path, name: None, role: Role::Validation, options: options.clone() };
        validation.extend(expanded(named)?.into_iter().map(one));
        self.read_files(model, validation, quiet)
    }

    /// Refuses runs with a beginning of their own where nothing is simulated from it.
    pub(crate) fn refuse_begin(&self, model: &Model) -> Result<(), Failure> {
        let files = self.every(&self.selection.options(true), model)?;
        if files.iter().all(|file| file.options.beginning().is_none()) {
            return Ok(());
        }
        let said = "--begin: only a simulation in time begins somewhere; spectra, frequency responses and regressions begin with the first sample: leave it out";
        Err(Failure::input([said]))
    }

    /// Says how many runs of the table are left aside.
    pub(crate) fn say_left(&self, model: &Model, quiet: bool) -> Result<(), Failure> {
        let left = self.of_list(Role::Validation, &self.selection.options(true), model)?.len();
        if left > 0 && !quiet {
            remark(format_args!("note: {left} run(s) of --runs have the role `validation` and are left aside"));
        }
        Ok(())
    }

    /// Reads the runs that are fitted, and judges them together with those of `validation`, whose files stand behind the others.
    fn read_files(
        &self,
        model: &Model,
        mut validation: Vec<RecordFile>,
        quiet: bool,
    ) -> Result<(Campaign, Vec<Run>), Failure> {
        let reading = self.selection.options(true);
        let mut files = self.files(Role::Fit, &reading, model)?;
        refuse_both(&files, &validation)?;
        let mut records = read_records(&files, model, &[])?;
        let fitted = records.len();
        let elsewhere = measured(model, records.iter().map(|(run, _)| run));
        records.extend(read_records(&validation, model, &elsewhere)?);
        files.append(&mut validation);
        if !quiet {
            say_notes(&records);
        }
        let mut records: Vec<(Run, Option<Summary>)> = records.into_iter().map(|(run, s)| (run, Some(s))).collect();
        let names = records.iter_mut().map(|(run, _)| &mut run.name).collect();
        told_apart(names, fitted);
        let judged = self.judge(model, &records, quiet)?;
        let mut runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
        let validation = runs.split_off(fitted);
        Ok((Campaign { files, runs, judged, reading }, validation))
    }

    /// Reads runs that a result predicts: each may lack outputs.
    pub(crate) fn read_predicted(&self, model: &Model, quiet: bool) -> Result<Campaign, Failure> {
        let files = self.predicted_files(model)?;
        let runs = read_runs(&files, model, &vec![true; model.layout().outputs], quiet)?;
        self.refuse(model, &runs)?;
        Ok(Campaign { files, runs, judged: None, reading: self.selection.options(true) })
    }

    /// What the quick tests of the doctor find in runs that were read.
    ///
    /// # Errors
    /// Where something was found and `--strict` refuses to go on.
    pub(crate) fn judge(
        &self,
        model: &Model,
        records: &[(Run, Option<Summary>)],
        quiet: bool,
    ) -> Result<Option<JudgedRecords>, Failure> {
        let judged = judged(model, records);
        let lines = judged.as_ref().map_or(Vec::new(), |j| leading(&j.findings));
        if !quiet {
            lines.iter().for_each(|line| remark(format_args!("{line}")));
        }
        if self.strict && !lines.is_empty() {
            return Err(Failure::Strict);
        }
        Ok(judged)
    }

    /// Refuses runs with findings where `--strict` was typed.
    pub(crate) fn refuse(&self, model: &Model, runs: &[Run]) -> Result<(), Failure> {
        if self.strict {
            let records: Vec<(Run, Option<Summary>)> = runs.iter().map(|run| (run.clone(), None)).collect();
            self.judge(model, &records, false)?;
        }
        Ok(())
    }

    /// The files of runs that a result predicts: those of the role `validation`, or all where there is none of it.
    fn predicted_files(&self, model: &Model) -> Result<Vec<RecordFile>, Failure> {
        let options = self.selection.options(true);
        let files = self.files(Role::Validation, &options, model)?;
        if files.is_empty() { self.files(Role::Fit, &options, model) } else { Ok(files) }
    }
}

impl Selection {
    /// Whether what can be read of damaged logs is used.
    pub(crate) fn is_salvaged(&self) -> bool {
        self.salvage
    }

    /// The map of the channels, where one was given.
    pub(crate) fn map(&self) -> Option<&RecordMap> {
        self.map_file.as_ref()
    }

    /// How files are read; with `require_outputs` they must hold every output of the model, in one run at least.
    pub(crate) fn options(&self, require_outputs: bool) -> ReadOptions {
        ReadOptions {
            any_size: false,
            map: self.map.clone(),
            from: self.from,
            to: self.to,
            begin: self.begin,
            every: self.every,
            hold: self.zoh.clone(),
            linear: self.linear.clone(),
            require_outputs,
            without: self.without_output.clone(),
            map_file: self.map_file.clone(),
            salvage: self.salvage,
            known: self.known.clone(),
            groups: self.group.iter().cloned().collect(),
            masks: self.mask.clone(),
        }
    }
}

/// Which outputs (q) some run measures.
pub(crate) fn measured<'a>(model: &Model, runs: impl IntoIterator<Item = &'a Run>) -> Vec<bool> {
    let mut measured = vec![false; model.layout().outputs];
    for run in runs {
        measured.iter_mut().enumerate().for_each(|(k, measured)| *measured |= run.measures(k));
    }
    measured
}

/// Refuses a part of a file that is to be fitted and predicted.
fn refuse_both(fitted: &[RecordFile], validation: &[RecordFile]) -> Result<(), Failure> {
    let place = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    // another part of the same file is another record
    let is = |one: &RecordFile, other: &RecordFile| {
        let part = |file: &RecordFile| (file.options.from, file.options.to);
        place(&one.path) == place(&other.path) && part(one) == part(other)
    };
    let both = validation.iter().filter(|file| fitted.iter().any(|other| is(file, other)));
    let said: Vec<String> = both
        .map(|file| {
            let said = "is both fitted and validation data: validation data must not be fitted; give another run";
            format!("{} {said}", file.path.display())
        })
        .collect();
    if said.is_empty() { Ok(()) } else { Err(Failure::Input(said)) }
}

/// Names of runs, of which those behind the fitted ones are validation runs: one with the name of a run before it is marked.
pub(crate) fn told_apart(mut names: Vec<&mut String>, fitted: usize) {
    for k in fitted..names.len() {
        while names[..k].iter().any(|other| **other == *names[k]) {
            names[k].push_str(" (validation)");
        }
    }
}

/// Reads runs and says what a careful reader would mention about them.
pub(crate) fn read_runs(
    files: &[RecordFile],
    model: &Model,
    elsewhere: &[bool],
    quiet: bool,
) -> Result<Vec<Run>, Failure> {
    let records = read_records(files, model, elsewhere)?;
    if !quiet {
        say_notes(&records);
    }
    Ok(records.into_iter().map(|(run, _)| run).collect())
}

/// Reads runs; the problems of all files are reported together. Runs are named after their files. Outputs that are measured `elsewhere`
/// (q, or nothing) may be missing in all of them.
pub(crate) fn read_records(
    files: &[RecordFile],
    model: &Model,
    elsewhere: &[bool],
) -> Result<Vec<(Run, Summary)>, Failure> {
    let channels = channels(model.definition());
    let each: Vec<(&Path, &ReadOptions)> = files.iter().map(|f| (f.path.as_path(), &f.options)).collect();
    let mut runs = read_each(&each, &channels, elsewhere).map_err(Failure::Records)?;
    for ((run, summary), file) in runs.iter_mut().zip(files) {
        summary.notes.extend(questioned(model.definition(), run, summary));
        file.name.iter().for_each(|name| run.name.clone_from(name));
    }
    number_equal_names(runs.iter_mut().map(|(run, _)| run).collect());
    let mut known = files_of_runs();
    known.extend(runs.iter().zip(files).map(|((run, _), file)| (run.name.clone(), file.path.display().to_string())));
    drop(known);
    Ok(runs)
}

/// The files that runs were read from, by the names of the runs.
fn files_of_runs() -> MutexGuard<'static, BTreeMap<String, String>> {
    static FILES: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());
    FILES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What is said of a run, with the file that it was read from.
pub(crate) fn with_files(said: &str) -> String {
    let mut told = said.to_string();
    for (run, file) in files_of_runs().iter().filter(|(_, file)| !said.contains(file.as_str())) {
        told = told.replacen(&format!("run `{run}`"), &format!("run `{run}` ({file})"), 1);
    }
    told
}

/// Runs whose files share a name are numbered.
pub(crate) fn number_equal_names(runs: Vec<&mut Run>) {
    let names: Vec<String> = runs.iter().map(|run| run.name.clone()).collect();
    for (k, run) in runs.into_iter().enumerate() {
        if names.iter().filter(|n| **n == names[k]).count() > 1 {
            run.name = format!("{}#{}", names[k], 1 + names[..k].iter().filter(|n| **n == names[k]).count());
        }
    }
}

/// Says what a careful reader would mention about the records.
pub(crate) fn say_notes(records: &[(Run, Summary)]) {
    let mut told: Vec<(String, Vec<&str>)> = Vec::new();
    for (run, summary) in records {
        for note in notes(summary) {
            match told.iter_mut().find(|(other, _)| *other == note) {
                Some((_, runs)) => runs.push(&run.name),
                None => told.push((note, vec![&run.name])),
            }
        }
    }
    for (note, runs) in told {
        let of = match runs[..] {
            [one] => format!("run `{one}`"),
            [one, other] => format!("runs `{one}` and `{other}`"),
            _ => format!("runs `{}`, `{}` and {} more", runs[0], runs[1], runs.len() - 2),
        };
        remark(format_args!("{}", with_files(&format!("note: {of}: {note}"))));
    }
}

/// What a careful reader would mention about a record.
pub(crate) fn notes(summary: &Summary) -> Vec<String> {
    Assumptions::of("", summary).sentences()
}

/// Measurement noise as it is typed.
#[derive(Debug, Args)]
#[command(next_help_heading = "Estimation")]
pub(crate) struct MeasurementNoise {
    /// Measurement noise: `diagonal`, `full`, or `OUTPUT=DEVIATION`
    ///
    /// `diagonal` (one variance for each output, estimated), `full` (their covariance, estimated), or the known standard deviation of an
    /// output [default: as the model declares; the rest is estimated].
    #[arg(long = "noise", value_name = "NOISE")]
    words: Vec<String>,
}

impl MeasurementNoise {
    /// Whether anything was typed.
    pub(crate) fn is_given(&self) -> bool {
        !self.words.is_empty()
    }

    /// What was typed, and what the model declares.
    pub(crate) fn of(&self, model: &Model) -> Result<Noise, Failure> {
        noise(&self.words, model)
    }
}

/// What the words of `--noise` say; each is `diagonal`, `full` or `OUTPUT=DEVIATION`.
pub(crate) fn noise(words: &[String], model: &Model) -> Result<Noise, Failure> {
    let outputs = &model.definition().outputs;
    let (mut given, mut kind) = (vec![None; outputs.len()], None);
    let mut wrong = Vec::new();
    for word in words {
        match word.as_str() {
            "diagonal" | "full" => {
                let wanted = if word == "full" { Noise::Full } else { Noise::Diagonal };
                if kind.replace(wanted.clone()).is_some_and(|other| other != wanted) {
                    wrong.push("--noise diagonal and --noise full exclude each other".into());
                }
            }
            _ => match assignment(word) {
                Ok((name, deviation)) => match outputs.iter().position(|o| o.quantity.name == name) {
                    Some(k) => {
                        if let Some(other) = given[k].replace(deviation).filter(|other| *other != deviation) {
                            wrong.push(format!(
                                "--noise {name}={other} and --noise {word}: give one deviation of `{name}`"
                            ));
                        }
                    }
                    None => {
                        let hint = did_you_mean(&name, outputs.iter().map(|o| o.quantity.name.as_str()));
                        wrong.push(format!("--noise {word}: the model has no output `{name}`{hint}"));
                    }
                },
                Err(e) => wrong.push(format!("--noise {word}: {e}, `diagonal` or `full`")),
            },
        }
    }
    let any = given.iter().any(Option::is_some);
    let declared = outputs.iter().any(|o| o.noise.is_some());
    // deviations without a number put the model's expressions aside
    let aside = kind == Some(Noise::Diagonal) && outputs.iter().any(|o| o.noise_model.is_some());
    if any && kind == Some(Noise::Full) {
        wrong.push("--noise full estimates the whole covariance: deviations cannot be given beside it".into());
    }
    if !wrong.is_empty() {
        return Err(Failure::Input(wrong));
    }
    if kind.is_none() {
        given.iter_mut().zip(outputs).for_each(|(given, output)| *given = given.or(output.noise));
    }
    Ok(match kind {
        Some(Noise::Full) => Noise::Full,
        _ if any || declared || aside => Noise::Given(given),
        _ => Noise::Diagonal,
    })
}

/// `NAME=VALUE`
pub(crate) fn assignment(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.rsplit_once('=').ok_or("expected NAME=VALUE")?;
    Ok((name.trim().to_string(), number(value)?))
}

/// `LO:HI`
pub(crate) fn band(text: &str) -> Result<(f64, f64), String> {
    let (low, high) = text.split_once(':').ok_or("expected LO:HI, such as 0.1:3")?;
    Ok((number(low)?, number(high)?))
}

/// A number as it is typed.
pub(crate) fn number(text: &str) -> Result<f64, String> {
    let text = text.trim();
    held(text).map_err(|unheld| format!("`{text}` {unheld}: {}", unheld.hint()))
}

/// A number above 0 as it is typed.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 { Ok(value) } else { Err(format!("`{text}` is not above 0")) }
}

/// A map of channels: a file, or one that comes with the program.
pub(crate) fn map_file(text: &str) -> Result<RecordMap, String> {
    let (known, names) = shipped(text);
    let map = match read_input_text(Path::new(text)) {
        Ok(map) => map,
        Err(_) if known.is_some() => known.unwrap_or_default().into(),
        Err(e) => return Err(format!("{}; maps that come with fdm are {}", reason(&e), names.join(", "))),
    };
    RecordMap::parse(&map).map_err(|e| e.to_string())
}

/// `CHANNEL=COLUMN`
pub(crate) fn pair(text: &str) -> Result<(String, String), String> {
    let (channel, column) = text.split_once('=').ok_or("expected CHANNEL=COLUMN")?;
    Ok((channel.trim().to_string(), column.trim().to_string()))
}
