//! `fdm doctor`: records judged before they are believed, by themselves and beside a model.

use crate::answer::{Answer, Wanted};
use crate::campaign::RecordFile;
use crate::conduct::Conduct;
use crate::failure::Failure;
use crate::halt::TimeLimit;
use crate::load::load_model;
use crate::records::{Records, Selection, read_records, record};
use crate::session::Session;
use crate::value::{number, probability};
use clap::Args;
use fdm_doctor::{AloneOptions, Fault, Finding, Record, Role, Severity, examine_alone, examine_repeats, repaired_map};
use fdm_infer::{BesideOptions, Examination, examine_beside};
use fdm_readers::{Log, RecordMap, Topic, take};
use fdm_report::doctor_text;
use fdm_report::page::doctor_page;
use fdm_results::documents::DoctorDocument;
use fdm_system::record::{Assumptions, open_log};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// What records are judged with.
#[derive(Debug, Args)]
pub struct Options {
    /// Model file (.fdm); without one the records are judged by themselves
    #[arg(value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// The records.
    #[command(flatten)]
    pub records: Records,
    /// Probability of a finding in a record without a fault, over all tests of the record by itself
    #[arg(long, value_name = "P", default_value_t = 0.01, value_parser = probability, help_heading = "Judgement", hide_short_help = true)]
    alpha: f64,
    /// Odds that a fault must have beside the model to be told
    #[arg(long, value_name = "N", default_value_t = 20.0, value_parser = odds, help_heading = "Judgement", hide_short_help = true)]
    odds: f64,
    /// Do not estimate delays, filters, offsets, scale factors and drifts of clocks beside the model
    #[arg(long, requires = "model", help_heading = "Judgement", hide_short_help = true)]
    no_estimated: bool,
    /// Write a map with the repairs; the record is not touched
    ///
    /// Of findings that a map can hold.
    #[arg(long, value_name = "MAP.toml", help_heading = "Result")]
    pub fix: Option<PathBuf>,
    /// Write one page for a browser: each finding with its channel drawn
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    pub report: Option<PathBuf>,
    /// How long it may work.
    #[command(flatten)]
    pub limit: TimeLimit,
}

/// A number above 1.
fn odds(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 1.0 { Ok(value) } else { Err("odds are above 1".into()) }
}

/// What a map begins with that this command wrote.
pub const BEGINNING: &str = "# repairs proposed by fdm doctor";

/// Records, and what was found in them.
pub struct Judged {
    records: Vec<Record>,
    document: DoctorDocument,
}

impl Judged {
    /// What is told of it; good where nothing but remarks was found.
    ///
    /// # Errors
    /// [`Failure::Input`], for a document without a text.
    pub fn answer(&self, wanted: Wanted) -> Result<Answer, Failure> {
        let answer = Answer::of(doctor_text(&self.document), &self.document, wanted)?;
        Ok(Answer { good: self.document.is_clean(), ..answer })
    }

    /// The page: each finding with its channel drawn.
    pub fn page(&self) -> String {
        doctor_page(&self.document, &self.records)
    }
}

/// Judges the records that are named.
///
/// # Errors
/// [`Failure`]
pub fn judge(asked: &Options, conduct: &mut Conduct) -> Result<(Judged, Answer), Failure> {
    let judged = asked.judged(conduct);
    conduct.progress.finish();
    // both are told
    let (in_time, whole) = (conduct.progress.in_time(), conduct.progress.uninterrupted());
    let judged = judged?;
    let answer = judged.answer(conduct.wanted)?;
    let good = in_time && whole && (answer.good || !asked.records.strict);
    Ok((judged, Answer { good, ..answer }))
}

impl Options {
    /// The records and what was found in them.
    fn judged(&self, conduct: &Conduct) -> Result<Judged, Failure> {
        let Some(path) = &self.model else { return self.judged_alone(&self.records.paths()?, Vec::new()) };
        let model = self.records.grouped(&load_model(path)?)?;
        let common = self.records.selection.options(false);
        let files = self.records.every(&common, &model)?;
        let read = read_records(&files, &model, &[])?;
        let records = read.into_iter().map(|(read, file)| record(read, file, &common)).collect();
        let session = Session::new(model, records, Vec::new());
        let records = self.with_other_columns(seen(&session), &session);
        Ok(self.examined(&session, records, conduct))
    }

    /// The runs of a session beside its model.
    pub fn beside(&self, session: &Session, conduct: &Conduct) -> Judged {
        self.examined(session, seen(session), conduct)
    }

    fn examined(&self, session: &Session, records: Vec<Record>, conduct: &Conduct) -> Judged {
        let told = session.read().map(|(run, summary)| {
            let in_memory = || Assumptions::of_samples(&run.name, "arrays", run.len());
            summary.map_or_else(in_memory, |summary| Assumptions::of(&run.name, summary))
        });
        let mut found = self.by_records(&records);
        let mended = self.mended_by_the_reader(session, &records);
        let fresh = |f: &Finding| !found.iter().any(|known| (known.fault, &known.channels) == (f.fault, &f.channels));
        let mended: Vec<Finding> = mended.into_iter().filter(fresh).collect();
        found.extend(mended);
        fdm_doctor::sort(&mut found);
        let options = BesideOptions { odds: self.odds, estimated: !self.no_estimated, ..BesideOptions::default() };
        let work = conduct.progress.work();
        let found = examine_beside(&session.model, &session.runs, &records, found, &options, &work);
        Judged { document: DoctorDocument::of(Some(session.model.name()), told.collect(), &found), records }
    }

    /// What a record holds no more once it is read for a model: pauses, behind which another run begins, and numbers that stand for missing values.
    fn mended_by_the_reader(&self, session: &Session, runs: &[Record]) -> Vec<Finding> {
        let Selection { salvage, map_file, .. } = &self.records.selection;
        let whole = |file: &RecordFile| {
            let o = &file.options;
            o.from.is_none() && o.to.is_none() && o.runs_by.is_none() && !o.replicates
        };
        let files = session.files().into_iter().filter(whole);
        let paths: BTreeSet<PathBuf> = files.map(|file| file.path).collect();
        // what is no table was read as what it is, and of many topics some are not read at all
        let of = |path: &PathBuf| -> Option<Record> {
            let all = tables(std::slice::from_ref(path), *salvage, map_file.as_ref()).ok()?;
            let [(told, topic)] = &all[..] else { return None };
            Some(Record::of_topic(&told.run, topic))
        };
        let records: Vec<Record> = paths.iter().filter_map(of).collect();
        let mut found = self.by_records(&records);
        let read = |name: &String| {
            let mut channels = runs.iter().flat_map(|r| &r.channels);
            name == "t" || channels.any(|c| c.role != Role::Unknown && (c.name == *name || c.column == *name))
        };
        found.retain(|f| matches!(f.fault, Fault::Gap | Fault::Sentinel) && f.channels.iter().all(read));
        found
    }

    /// With the columns that the model does not read, where a file is one table and all files have the same ones.
    fn with_other_columns(&self, records: Vec<Record>, session: &Session) -> Vec<Record> {
        let files = session.files();
        if files.len() != records.len() {
            return records;
        }
        let wider = records.iter().zip(&files).zip(session.read()).map(|((record, file), (_, summary))| {
            let (log, _) = open_log(&file.path, self.records.selection.salvage, None).ok()?;
            let [topic] = &log.topics[..] else { return None };
            Some(record.clone().with_other_columns(topic, summary?, &file.options))
        });
        let Some(wider) = wider.collect::<Option<Vec<Record>>>() else { return records };
        let names = |r: &Record| r.channels.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
        if wider.windows(2).all(|w| names(&w[0]) == names(&w[1])) { wider } else { records }
    }

    /// Every table of every file by itself, and tables in memory behind them.
    ///
    /// # Errors
    /// [`Failure::Records`]
    pub(crate) fn judged_alone(&self, files: &[PathBuf], more: Vec<(Assumptions, Topic)>) -> Result<Judged, Failure> {
        let Selection { salvage, map_file, .. } = &self.records.selection;
        let mut tables = tables(files, *salvage, map_file.as_ref())?;
        for (told, topic) in more {
            let log = Log { format: "arrays", topics: vec![topic], ..Log::default() };
            let (log, notes) = mapped(log, map_file.as_ref(), &told.run)?;
            let told = notes.iter().fold(told, |told, note| told.noted("reading", note.clone()));
            tables.extend(log.topics.into_iter().map(|topic| (told.clone(), topic)));
        }
        let records: Vec<Record> = tables.iter().map(|(told, topic)| Record::of_topic(&told.run, topic)).collect();
        let told = tables.into_iter().map(|(told, _)| told).collect();
        let found = Examination { findings: self.by_records(&records), ..Examination::default() };
        Ok(Judged { document: DoctorDocument::of(None, told, &found), records })
    }

    /// What records say by themselves.
    fn by_records(&self, records: &[Record]) -> Vec<Finding> {
        let options = AloneOptions { false_alarms: self.alpha, kinematics: self.model.is_none() };
        let mut findings: Vec<Finding> = records.iter().flat_map(|record| examine_alone(record, &options)).collect();
        findings.extend(examine_repeats(records));
        fdm_doctor::sort(&mut findings);
        findings
    }

    /// The repairs of the findings as a map; what a remark says may be meant.
    pub fn map(&self, judged: &Judged) -> String {
        self.map_of(judged, |_, finding| finding.severity == Severity::Finding)
    }

    /// The repairs of the chosen ones among findings and remarks, by their places in the document, as a map.
    pub fn map_of(&self, Judged { records, document }: &Judged, chosen: impl Fn(usize, &Finding) -> bool) -> String {
        let findings = document.findings.iter().enumerate().filter(|(k, finding)| chosen(*k, finding));
        let repairs = findings.filter_map(|(_, finding)| finding.repair.as_ref());
        let before = self.records.selection.map_file.as_ref();
        let map = records.first().map(|record| repaired_map(record, before, repairs)).unwrap_or_default();
        format!("{BEGINNING}; read the record with --map-file and this file\n{}", map.text())
    }
}

/// Runs as the doctor sees them.
fn seen(session: &Session) -> Vec<Record> {
    let definition = session.model.definition();
    session.read().map(|(run, summary)| Record::of_run(definition, run, summary)).collect()
}

/// What a map takes of a log, as its only table, and what was done on the way; without a map the log as it is.
fn mapped(log: Log, map: Option<&RecordMap>, place: &str) -> Result<(Log, Vec<String>), Failure> {
    let Some(map) = map else { return Ok((log, Vec::new())) };
    let mut taken = take(&log, map, &|_| Some(false))
        .map_err(|errors| Failure::input(errors.iter().map(|e| format!("{place}: {e}"))))?;
    let notes = std::mem::take(&mut taken.notes);
    Ok((Log { topics: vec![taken.into_topic()], ..log }, notes))
}

/// Every table of every file with more than two rows; by a map its channels.
fn tables(files: &[PathBuf], salvage: bool, map: Option<&RecordMap>) -> Result<Vec<(Assumptions, Topic)>, Failure> {
    let mut tables = Vec::new();
    for path in files {
        let (log, notes) = open_log(path, salvage, map).map_err(|e| Failure::Records(vec![e]))?;
        let (log, taken) = mapped(log, map, &path.display().to_string())?;
        let name = path.file_stem().map_or_else(|| "run".into(), |s| s.to_string_lossy().into_owned());
        let mut notes = notes.iter().map(ToString::to_string).chain(taken);
        for topic in log.topics.into_iter().filter(|t| t.rows() > 2) {
            let name = if topic.name.is_empty() { name.clone() } else { format!("{name}: {}", topic.name) };
            // said once of each file
            let told = Assumptions::of_samples(&name, "table", topic.rows());
            tables.push((notes.by_ref().fold(told, |told, note| told.noted("reading", note)), topic));
        }
    }
    Ok(tables)
}
