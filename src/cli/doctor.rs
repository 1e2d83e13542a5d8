//! `fdm doctor`: records judged before they are believed, by themselves and beside a model.

use crate::campaign::RecordFile;
use crate::deliver::{Output, write};
use crate::failure::{Ending, Failure, ended};
use crate::halt::{TimeLimit, uninterrupted};
use crate::load::{Records, load_model, read_records};
use crate::ownership::{Overwriting, refuse_other_tables};
use crate::progress::Progress;
use clap::Args;
use fdm_doctor::{
    AloneOptions, BesideOptions, Examination, Finding, Record, Severity, examine_alone, examine_beside,
    examine_repeats, repaired_map,
};
use fdm_readers::Topic;
use fdm_report::doctor_text;
use fdm_results::documents::DoctorDocument;
use fdm_system::Model;
use fdm_system::record::{Assumptions, Run, Summary, open_log};
use std::path::PathBuf;

/// What `fdm doctor` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Model file (.fdm); without one the records are judged by themselves
    #[arg(value_name = "MODEL")]
    model: Option<PathBuf>,
    #[command(flatten)]
    records: Records,
    /// Probability of a finding in a record without a fault, over all tests of the record by itself
    #[arg(long, value_name = "P", default_value_t = 0.01, value_parser = crate::diagnose::probability, help_heading = "Judgement", hide_short_help = true)]
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
    pub(crate) fix: Option<PathBuf>,
    /// Write one page for a browser: each finding with its channel drawn
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    report: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) limit: TimeLimit,
    #[command(flatten)]
    overwriting: Overwriting,
    #[command(flatten)]
    output: Output,
}

/// A number above 1.
fn odds(text: &str) -> Result<f64, String> {
    let value = crate::load::number(text)?;
    if value > 1.0 { Ok(value) } else { Err("odds are above 1".into()) }
}

/// What a map begins with that this command wrote.
const BEGINNING: &str = "# repairs proposed by fdm doctor";

pub(crate) fn run(arguments: &Arguments) -> Ending {
    if let Some(path) = arguments.fix.as_ref().filter(|_| !arguments.overwriting.force) {
        refuse_other_tables(path, BEGINNING.as_bytes())?;
    }
    let progress = Progress::new(arguments.output.manner.quiet).within(&arguments.limit);
    let judged = arguments.judged(&progress);
    progress.finish();
    // both are told
    let (in_time, whole) = (progress.in_time(), uninterrupted(progress.halt()));
    let (records, document) = judged?;
    let printed = arguments.output.print(|| doctor_text(&document), || document.clone())?;
    if let Some(path) = &arguments.fix {
        write(path, arguments.map(&records, &document))?;
    }
    if let Some(path) = &arguments.report {
        write(path, fdm_report::page::doctor_page(&document, &records))?;
    }
    ended(printed && in_time && whole && (document.is_clean() || !arguments.records.strict))
}

impl Arguments {
    /// The records and what was found in them.
    fn judged(&self, progress: &Progress) -> Result<(Vec<Record>, DoctorDocument), Failure> {
        let Some(path) = &self.model else { return self.by_themselves() };
        let model = self.records.grouped(&load_model(path)?)?;
        let files = self.records.every(&self.records.selection.options(false), &model)?;
        let read = read_records(&files, &model, &[])?;
        let records: Vec<Record> =
            read.iter().map(|(run, summary)| Record::of_run(model.definition(), run, Some(summary))).collect();
        let records = self.with_other_columns(records, &files, &read);
        let told: Vec<Assumptions> = read.iter().map(|(run, summary)| Assumptions::of(&run.name, summary)).collect();
        let runs: Vec<Run> = read.into_iter().map(|(run, _)| run).collect();
        let document = self.examined((&model, &runs), &records, told, progress);
        Ok((records, document))
    }

    /// Runs, and what was found while they were read, beside a model.
    pub(crate) fn beside(
        &self,
        model: &Model,
        read: Vec<(Run, Option<Summary>)>,
        progress: &Progress,
    ) -> (Vec<Record>, DoctorDocument) {
        let of_run = |(run, summary): &(Run, Option<Summary>)| {
            let in_memory = || Assumptions::of_samples(&run.name, "arrays", run.len());
            let told = summary.as_ref().map_or_else(in_memory, |summary| Assumptions::of(&run.name, summary));
            (Record::of_run(model.definition(), run, summary.as_ref()), told)
        };
        let (records, told): (Vec<Record>, Vec<Assumptions>) = read.iter().map(of_run).unzip();
        let runs: Vec<Run> = read.into_iter().map(|(run, _)| run).collect();
        let document = self.examined((model, &runs), &records, told, progress);
        (records, document)
    }

    fn examined(
        &self,
        (model, runs): (&Model, &[Run]),
        records: &[Record],
        told: Vec<Assumptions>,
        progress: &Progress,
    ) -> DoctorDocument {
        let found = self.by_records(records);
        let options = BesideOptions { odds: self.odds, estimated: !self.no_estimated, ..BesideOptions::default() };
        let found = examine_beside(model, runs, records, found, &options, &progress.work());
        DoctorDocument::of(Some(model.name()), told, &found)
    }

    /// With the columns that the model does not read, where a file is one table and all files have the same ones.
    fn with_other_columns(&self, records: Vec<Record>, files: &[RecordFile], read: &[(Run, Summary)]) -> Vec<Record> {
        if files.len() != records.len() {
            return records;
        }
        let wider = records.iter().zip(files).zip(read).map(|((record, file), (_, summary))| {
            let (log, _) = open_log(&file.path, self.records.selection.is_salvaged()).ok()?;
            let [topic] = &log.topics[..] else { return None };
            Some(record.clone().with_other_columns(topic, summary, &file.options))
        });
        let Some(wider) = wider.collect::<Option<Vec<Record>>>() else { return records };
        let names = |r: &Record| r.channels.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
        if wider.windows(2).all(|w| names(&w[0]) == names(&w[1])) { wider } else { records }
    }

    /// Without a model: every table of every file.
    fn by_themselves(&self) -> Result<(Vec<Record>, DoctorDocument), Failure> {
        let tables = tables(&self.records.paths()?, self.is_salvaged())?;
        Ok(self.of_tables(tables))
    }

    /// Whether what can be read of damaged logs is used.
    pub(crate) fn is_salvaged(&self) -> bool {
        self.records.selection.is_salvaged()
    }

    /// Tables by themselves.
    pub(crate) fn of_tables(&self, tables: Vec<(Assumptions, Topic)>) -> (Vec<Record>, DoctorDocument) {
        let records: Vec<Record> = tables.iter().map(|(told, topic)| Record::of_topic(&told.run, topic)).collect();
        let told = tables.into_iter().map(|(told, _)| told).collect();
        let found = Examination { findings: self.by_records(&records), ..Examination::default() };
        (records, DoctorDocument::of(None, told, &found))
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
    pub(crate) fn map(&self, records: &[Record], document: &DoctorDocument) -> String {
        let findings = document.findings.iter().filter(|f| f.severity == Severity::Finding);
        let repairs = findings.filter_map(|f| f.repair.as_ref());
        let before = self.records.selection.map();
        let map = records.first().map(|record| repaired_map(record, before, repairs)).unwrap_or_default();
        format!("{BEGINNING}; read the record with --map-file and this file\n{}", map.text())
    }
}

/// Every table of every file with more than two rows.
pub(crate) fn tables(files: &[PathBuf], salvage: bool) -> Result<Vec<(Assumptions, Topic)>, Failure> {
    let mut tables = Vec::new();
    for path in files {
        let (log, notes) = open_log(path, salvage).map_err(|e| Failure::Records(vec![e]))?;
        let name = path.file_stem().map_or_else(|| "run".into(), |s| s.to_string_lossy().into_owned());
        let mut notes = notes.into_iter();
        for topic in log.topics.into_iter().filter(|t| t.rows() > 2) {
            let name = if topic.name.is_empty() { name.clone() } else { format!("{name}: {}", topic.name) };
            // said once of each file
            let told = Assumptions::of_samples(&name, "table", topic.rows());
            tables.push((notes.by_ref().fold(told, |told, note| told.noted("reading", note.to_string())), topic));
        }
    }
    Ok(tables)
}
