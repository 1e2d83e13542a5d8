//! Recorded runs: which files they are, how they are read, and what the quick tests of the doctor say of them.

use crate::campaign::{RecordFile, Role, RunTable, expanded, group, known_value, mask};
use crate::delays::{DelayError, with_free_delays};
use crate::failure::Failure;
use crate::session::{Origin, Record, Session, Source};
use crate::telling::remark;
use crate::value::{below_limit, instant, map_file, pair};
use clap::Args;
use fdm_doctor::{AloneOptions, Finding, examine_alone, examine_repeats, leading};
use fdm_readers::RecordMap;
use fdm_results::documents::JudgedRecords;
use fdm_system::Model;
use fdm_system::record::{
    Assumptions, BelowLimit, Known, ReadOptions, Run, SampleMask, Summary, channels, questioned, read_each,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Recorded runs: which files, and how they are read.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub struct Records {
    /// Recorded runs, as those behind the model
    ///
    /// CSV with a header `name [unit], ...`, or a log with --map-file, or patterns such as 'flights/*.csv'; `-` for standard input; may
    /// be given several times.
    #[arg(long = "data", value_name = "RUN", required_unless_present = "runs", num_args = 1.., group = "recorded")]
    data: Vec<PathBuf>,
    /// The table of runs.
    #[command(flatten)]
    pub list: RunList,
    /// End with exit code 1 where anything but remarks is found in the records
    #[arg(long, hide_short_help = true)]
    pub strict: bool,
    /// What is used of the files.
    #[command(flatten)]
    pub selection: Selection,
}

/// A table of runs.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Data")]
pub struct RunList {
    /// Table of runs: a row for each with its `file`
    ///
    /// Where wanted with `run` (name), `role` (fit or validation), `map`, `from`, `to`, `begin`, values (`known T0 per run`) and groups
    /// (`per group aircraft`).
    #[arg(long = "runs", value_name = "RUNS.csv", group = "recorded")]
    runs: Option<PathBuf>,
}

impl RunList {
    /// Whether there is one.
    pub fn is_given(&self) -> bool {
        self.runs.is_some()
    }

    /// The table, where one is given.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn table(&self) -> Result<Option<RunTable>, Failure> {
        self.runs.as_deref().map(RunTable::read).transpose()
    }

    /// The model for the groups of the table and of `--group`.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn grouped(&self, model: &Model, selection: &Selection) -> Result<Model, Failure> {
        let mut groups = self.table()?.map(|table| table.groups(model)).unwrap_or_default();
        for grouping in model.groupings() {
            if let Some((_, group)) = selection.group.iter().find(|(name, _)| name == grouping) {
                groups.entry(grouping.into()).or_insert_with(|| vec![group.clone()]);
            }
        }
        Ok(if groups.is_empty() { model.clone() } else { model.grouped(groups)? })
    }

    /// The files of the table, or those of `--data`, which are all of one role.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn files(
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
pub(crate) fn judged<'r>(
    model: &Model,
    read: impl Iterator<Item = (&'r Run, Option<&'r Summary>)>,
) -> Option<JudgedRecords> {
    let read: Vec<_> = read.collect();
    let options = AloneOptions { kinematics: false, ..AloneOptions::default() };
    let seen: Vec<fdm_doctor::Record> =
        read.iter().map(|(run, summary)| fdm_doctor::Record::of_run(model.definition(), run, *summary)).collect();
    let mut findings: Vec<Finding> = seen.iter().flat_map(|record| examine_alone(record, &options)).collect();
    findings.extend(examine_repeats(&seen));
    fdm_doctor::sort(&mut findings);
    let assumed = read.iter().filter_map(|(run, summary)| Some(Assumptions::of(&run.name, (*summary)?)));
    JudgedRecords { assumed: assumed.filter(|a| !a.sentences().is_empty()).collect(), findings }.unless_empty()
}

/// Tells the leading findings unless it is to be `quiet`.
///
/// # Errors
/// [`Failure::Strict`], where there are some and `strict` refuses to go on.
pub(crate) fn refuse_findings(judged: Option<&JudgedRecords>, strict: bool, quiet: bool) -> Result<(), Failure> {
    let lines = judged.map_or(Vec::new(), |j| leading(&j.findings));
    if !quiet {
        lines.iter().for_each(|line| remark(format_args!("{line}")));
    }
    if strict && !lines.is_empty() { Err(Failure::Strict) } else { Ok(()) }
}

/// What is used of the files, and as what.
#[derive(Debug, Args)]
#[command(next_help_heading = "Data")]
pub struct Selection {
    /// Column of a channel when its name differs
    ///
    /// The time is called `t`; `y=log(c [mol/l])` takes logarithms.
    #[arg(long = "map", value_name = "NAME=COLUMN", value_parser = pair, requires = "recorded")]
    map: Vec<(String, String)>,
    /// Map of the channels: a file, or `px4`, `px4-rate`, `ardupilot`, `ardupilot-rate`, `fti`
    ///
    /// It names fields of a log or columns, with unit, sign, scale, hold and delay.
    #[arg(long, value_name = "MAP", value_parser = map_file, requires = "recorded")]
    pub(crate) map_file: Option<RecordMap>,
    /// Use what can be read of a damaged log; what is lost is said
    #[arg(long, requires = "recorded", hide_short_help = true)]
    pub(crate) salvage: bool,
    /// Use the record from this time on, in the file's unit
    #[arg(long, value_parser = instant, value_name = "TIME", allow_negative_numbers = true, requires = "recorded")]
    from: Option<f64>,
    /// Use the record up to this time, in the file's unit
    #[arg(long, value_parser = instant, value_name = "TIME", allow_negative_numbers = true, requires = "recorded")]
    to: Option<f64>,
    /// Where the run begins: the instant that is the model's time 0, at the first sample or before, in the file's unit [default: the first sample]
    #[arg(long, value_parser = instant, value_name = "TIME", allow_negative_numbers = true, requires = "recorded", hide_short_help = true)]
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
    pub group: Vec<(String, String)>,
    /// Compare only the samples where this column holds a number that is not 0; of one output, or of all
    #[arg(long, value_name = "[OUTPUT=]COLUMN", value_parser = mask, requires = "recorded", hide_short_help = true)]
    mask: Vec<SampleMask>,
    /// Samples per second of rows without times, or whose times count rows
    #[arg(long, value_name = "RATE", value_parser = instant, requires = "recorded", hide_short_help = true)]
    rate: Option<f64>,
    /// Column that tells the runs of a table apart
    #[arg(long, value_name = "COLUMN", requires = "recorded", hide_short_help = true)]
    runs_by: Option<String>,
    /// What stands in cells where nothing was measured, beside empty ones, `NA`, `.` and -999
    ///
    /// A number or word; `none` where -999 was measured.
    #[arg(long, value_name = "CODE", allow_hyphen_values = true, requires = "recorded", hide_short_help = true)]
    missing: Vec<String>,
    /// Values below a limit (`<0.5`, BLQ): `censored`, `missing`, or the limit of cells without one, in the column's unit
    ///
    /// Output error in the time domain compares censored values: that they are less than their limit. `missing` leaves them out, and estimates
    /// lean to what was seen.
    #[arg(long, value_name = "HOW", value_parser = below_limit, default_value = "censored", hide_short_help = true)]
    below_limit: BelowLimit,
    /// Rows of one time are repeats, each in a run of its own
    #[arg(long, requires = "recorded", hide_short_help = true)]
    replicates: bool,
}

impl Records {
    /// The model for the groups of the runs.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn grouped(&self, model: &Model) -> Result<Model, Failure> {
        self.list.grouped(model, &self.selection)
    }

    /// The model with the delays that the maps of the fitted runs leave free.
    pub(crate) fn with_free_delays(&self, model: &Model) -> Result<Model, Failure> {
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
    ///
    /// # Errors
    /// [`Failure`]
    pub fn files(&self, role: Role, options: &ReadOptions, model: &Model) -> Result<Vec<RecordFile>, Failure> {
        let of_list = self.list.runs.is_some();
        let mut files = self.list.files((&self.data, role), options, model)?;
        files.retain(|f| f.role == role);
        if files.is_empty() && role == Role::Fit && of_list {
            return Err(Failure::input(["--runs: no run has the role `fit`"]));
        }
        Ok(files)
    }

    /// The files of all runs, whatever their role.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn every(&self, options: &ReadOptions, model: &Model) -> Result<Vec<RecordFile>, Failure> {
        self.list.files((&self.data, Role::Fit), options, model)
    }

    /// The paths of all runs where there is no model.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn paths(&self) -> Result<Vec<PathBuf>, Failure> {
        self.list.table()?.map_or_else(|| expanded(&self.data), |table| table.paths())
    }

    /// The files of a role in the table of runs; none where there is no table.
    pub(crate) fn of_list(&self, role: Role, options: &ReadOptions, model: &Model) -> Result<Vec<RecordFile>, Failure> {
        if self.list.runs.is_some() { self.files(role, options, model) } else { Ok(Vec::new()) }
    }

    /// Reads all runs that are fitted, with all their outputs, and judges them by the quick tests of the doctor: three lines at most are
    /// said unless it is to be quiet.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn session(&self, model: Model, quiet: bool) -> Result<Session, Failure> {
        self.say_left(&model, quiet)?;
        self.read(model, Vec::new(), quiet)
    }

    /// Reads all runs that are fitted together with validation runs, which are not: those of the role `validation` in
    /// the table of runs, and those `named` beside it. They are judged beside the others.
    ///
    /// # Errors
    /// [`Failure`]; a run of both kinds too.
    pub(crate) fn session_with_validation(
        &self,
        model: Model,
        named: &[PathBuf],
        quiet: bool,
    ) -> Result<Session, Failure> {
        let options = self.selection.options(true);
        let mut validation = self.of_list(Role::Validation, &options, &model)?;
        let one = |path| RecordFile { path, name: None, role: Role::Validation, options: options.clone() };
        validation.extend(expanded(named)?.into_iter().map(one));
        self.read(model, validation, quiet)
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

    /// Reads the runs that are fitted, and judges them together with those of `validation`.
    fn read(&self, model: Model, validation: Vec<RecordFile>, quiet: bool) -> Result<Session, Failure> {
        let common = self.selection.options(true);
        let files = self.files(Role::Fit, &common, &model)?;
        refuse_both(&files, &validation)?;
        let mut records = read_records(&files, &model, &[])?;
        let fitted = records.len();
        let elsewhere = measured(&model, records.iter().map(|((run, _), _)| run));
        records.extend(read_records(&validation, &model, &elsewhere)?);
        if !quiet {
            say_notes(&records);
        }
        let mut records: Vec<Record> = records.into_iter().map(|(read, file)| record(read, file, &common)).collect();
        let validation = records.split_off(fitted);
        Session::new(model, records, validation).judged(self.strict, quiet)
    }

    /// Reads runs that a result predicts: each may lack outputs.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn predicted(&self, model: Model, quiet: bool) -> Result<Session, Failure> {
        let files = self.predicted_files(&model)?;
        let read = read_records(&files, &model, &vec![true; model.layout().outputs])?;
        if !quiet {
            say_notes(&read);
        }
        self.refuse(&model, read.iter().map(|((run, _), _)| run))?;
        let common = self.selection.options(true);
        let record = |((run, summary), file)| {
            let source = Some(Source { file, common: common.clone() });
            Record { run, origin: Origin { source, summary: Some(summary) } }
        };
        Ok(Session::new(model, read.into_iter().map(record).collect(), Vec::new()))
    }

    /// Refuses runs with findings where `--strict` was typed.
    ///
    /// # Errors
    /// [`Failure::Strict`]
    pub fn refuse<'r>(&self, model: &Model, runs: impl Iterator<Item = &'r Run>) -> Result<(), Failure> {
        if self.strict {
            refuse_findings(judged(model, runs.map(|run| (run, None))).as_ref(), true, false)?;
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
    /// How files are read; with `require_outputs` they must hold every output of the model, in one run at least.
    pub fn options(&self, require_outputs: bool) -> ReadOptions {
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
            rate: self.rate,
            missing: self.missing.clone(),
            below_limit: self.below_limit,
            replicates: self.replicates,
            runs_by: self.runs_by.clone(),
            part: None,
        }
    }
}

/// Which outputs (q) some run measures.
pub fn measured<'a>(model: &Model, runs: impl IntoIterator<Item = &'a Run>) -> Vec<bool> {
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
        let part = |file: &RecordFile| (file.options.from, file.options.to, file.options.part);
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

/// A run that was read from a file, where files of which nothing else is said are read in the `common` way.
pub(crate) fn record((run, summary): (Run, Summary), file: RecordFile, common: &ReadOptions) -> Record {
    let source = Some(Source { file, common: common.clone() });
    Record { run, origin: Origin { source, summary: Some(summary) } }
}

/// Names of runs, of which those behind the fitted ones are validation runs: one with the name of a run before it is marked.
pub fn told_apart(mut names: Vec<&mut String>, fitted: usize) {
    for k in fitted..names.len() {
        while names[..k].iter().any(|other| **other == *names[k]) {
            names[k].push_str(" (validation)");
        }
    }
}

/// Reads runs and says what a careful reader would mention about them.
///
/// # Errors
/// [`Failure`]
pub fn read_runs(files: &[RecordFile], model: &Model, elsewhere: &[bool], quiet: bool) -> Result<Vec<Run>, Failure> {
    let records = read_records(files, model, elsewhere)?;
    if !quiet {
        say_notes(&records);
    }
    Ok(records.into_iter().map(|((run, _), _)| run).collect())
}

/// A run with what was found while it was read, and the file, or the part of one, that it was read from.
pub(crate) type ReadRun = ((Run, Summary), RecordFile);

/// Reads runs, of a file with several all; the problems of all files are reported together. Runs are named after their files. Outputs that are measured `elsewhere`
/// (q, or nothing) may be missing in all of them.
pub(crate) fn read_records(files: &[RecordFile], model: &Model, elsewhere: &[bool]) -> Result<Vec<ReadRun>, Failure> {
    let channels = channels(model.definition());
    let each: Vec<(&Path, &ReadOptions)> = files.iter().map(|f| (f.path.as_path(), &f.options)).collect();
    let read = read_each(&each, &channels, elsewhere).map_err(Failure::Records)?;
    let mut runs = Vec::new();
    for (found, file) in read.into_iter().zip(files) {
        let several = found.len() > 1;
        for (part, (mut run, mut summary)) in found.into_iter().enumerate() {
            summary.notes.extend(questioned(model.definition(), &run, &summary));
            let mut file = file.clone();
            if several {
                file.options.part = Some(part);
            } else {
                file.name.iter().for_each(|name| run.name.clone_from(name));
            }
            runs.push(((run, summary), file));
        }
    }
    number_equal_names(runs.iter_mut().map(|((run, _), _)| run).collect());
    let mut known = files_of_runs();
    known.extend(runs.iter().map(|((run, _), file)| (run.name.clone(), file.path.display().to_string())));
    drop(known);
    Ok(runs)
}

/// The files that runs were read from, by the names of the runs.
fn files_of_runs() -> MutexGuard<'static, BTreeMap<String, String>> {
    static FILES: Mutex<BTreeMap<String, String>> = Mutex::new(BTreeMap::new());
    FILES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What is said of a run, with the file that it was read from.
pub fn with_files(said: &str) -> String {
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
pub(crate) fn say_notes(records: &[ReadRun]) {
    let mut told: Vec<(String, Vec<&str>)> = Vec::new();
    for ((run, summary), _) in records {
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
pub fn notes(summary: &Summary) -> Vec<String> {
    Assumptions::of("", summary).sentences()
}
