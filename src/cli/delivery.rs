//! Where a result goes: to the terminal as tables or JSON, to a picture, to a folder.

use crate::failure::{Failure, print, remark};
use crate::histories::{histories, tables};
use crate::live::{Live, Shared};
use crate::modes::of_result;
use crate::progress::Progress;
use clap::Args;
use fdm::Model;
use fdm::estimate::Fit;
use fdm::page::Subject;
use fdm::record::Run;
use fdm::report::{TimeHistory, quality_json, svg};
use fdm::store::{Contents, Destination, Manifest, reason};
use serde_json::Value;
use std::fmt::Display;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Where a result goes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Result")]
pub(crate) struct Delivery {
    /// Print JSON instead of tables
    #[arg(long)]
    pub(crate) json: bool,
    /// Draw measurement, model and residual over time to an SVG file
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Write everything to a folder: model, options, fingerprints of the data, result, tables, time histories, picture
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Write one page for a browser with equations, tables and figures, as `fdm report` makes it from a folder
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Say nothing while working
    #[arg(short, long)]
    pub(crate) quiet: bool,
}

/// A result and what is said about it.
pub(crate) struct Outcome<'a> {
    pub(crate) model: &'a Model,
    /// The fit in the time domain, whose histories are drawn and written.
    pub(crate) fit: Option<&'a Fit>,
    pub(crate) runs: &'a [Run],
    /// Spectra to be drawn in front of the histories.
    pub(crate) spectra: Vec<TimeHistory<'a>>,
    /// Tables to be written besides: file names and contents.
    pub(crate) tables: Vec<(String, Vec<u8>)>,
    /// Tables and sentences.
    pub(crate) text: String,
    /// The same for programs.
    pub(crate) json: Value,
    /// What goes to standard error behind it.
    pub(crate) remarks: Vec<String>,
    pub(crate) manifest: Manifest,
}

/// A place that was looked at before the work.
pub(crate) struct Prepared<'a> {
    delivery: &'a Delivery,
    destination: Option<Destination>,
}

impl Delivery {
    /// Of a result that is tables and has no histories to be drawn.
    pub(crate) fn of_tables(json: bool, quiet: bool, out: Option<PathBuf>, report: Option<PathBuf>) -> Self {
        Self { json, plot: None, out, report, quiet }
    }

    /// Whether it will be asked what the result was made from.
    pub(crate) fn describes(&self) -> bool {
        self.out.is_some() || self.report.is_some()
    }

    /// Looks at the places before any work is done in vain.
    pub(crate) fn prepare(&self) -> Result<Prepared<'_>, Failure> {
        for path in self.plot.iter().chain(&self.report) {
            admits(path).map_err(|e| Failure::input([format!("{}: {}", path.display(), reason(&e))]))?;
        }
        let destination = self.out.as_deref().map(Destination::prepare).transpose();
        Ok(Prepared { delivery: self, destination: destination.map_err(|e| Failure::input([e]))? })
    }
}

/// Whether a file can be written, as far as can be told without writing it.
fn admits(path: &Path) -> io::Result<()> {
    if path.exists() {
        return File::options().append(true).open(path).map(drop);
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(folder).map(drop)
}

impl Prepared<'_> {
    /// Tells of the work while it goes on, beside the folder that is to hold its result and beside its checkpoint.
    pub(crate) fn live(&self, model: &Model, checkpoint: Option<&Path>, progress: &mut Progress) -> (Live, Shared) {
        let folders = self.destination.iter().map(Destination::folder).chain(checkpoint);
        let (folders, course): (Vec<PathBuf>, _) = (folders.map(Path::to_path_buf).collect(), Shared::default());
        if !folders.is_empty() {
            progress.told(course.clone());
        }
        (Live::begin(folders, model, course.clone()), course)
    }

    /// Prints the result, then writes what was asked for. What cannot be written is told; says whether all was.
    pub(crate) fn deliver(&self, mut outcome: Outcome<'_>) -> bool {
        if self.delivery.json || self.delivery.describes() {
            let runs: Vec<String> = outcome.runs.iter().map(|run| run.name.clone()).collect();
            outcome.json["modes"] = of_result(outcome.model, &outcome.json, &runs);
        }
        let json = format!("{}\n", outcome.json);
        let printed = print(if self.delivery.json { &json } else { &outcome.text });
        outcome.remarks.iter().for_each(|r| remark(format_args!("{r}")));
        let plot = self.delivery.plot.as_deref().map_or(Ok(()), |path| draw(&outcome, path));
        let written = self.kept(outcome, json);
        let failed = [plot.err(), written.err()];
        failed.iter().flatten().for_each(|e| remark(format_args!("error: {e}")));
        printed && failed.iter().all(Option::is_none)
    }
}

impl Prepared<'_> {
    /// Writes folder and page, where they are wanted, from the same files.
    fn kept(&self, outcome: Outcome<'_>, json: String) -> Result<(), String> {
        if !self.delivery.describes() {
            return Ok(());
        }
        let lost = |e: String| format!("{e}; the result is what is printed");
        let files = contents(outcome, json).and_then(|c| c.files().map_err(said)).map_err(lost)?;
        let page = self.delivery.report.as_deref().map_or(Ok(()), |path| {
            let text = fdm::page::page(&Subject::from_files(&files).map_err(said)?);
            std::fs::write(path, text).map_err(|e| format!("{}: {}", path.display(), reason(&e)))
        });
        let folder = self.destination.as_ref().map_or(Ok(()), |place| place.fill(&files).map_err(said));
        folder.and(page).map_err(lost)
    }
}

fn picture(outcome: &Outcome<'_>) -> Result<String, String> {
    let mut panels = outcome.spectra.clone();
    panels.extend(outcome.fit.map_or(Vec::new(), |fit| histories(fit, outcome.runs)));
    svg(&panels).map_err(said)
}

fn draw(outcome: &Outcome<'_>, path: &Path) -> Result<(), String> {
    let text = picture(outcome)?;
    std::fs::write(path, text).map_err(|e| format!("{}: {}; the result is what is printed", path.display(), reason(&e)))
}

/// Everything that a folder holds.
fn contents(outcome: Outcome<'_>, json: String) -> Result<Contents, String> {
    let mut text = outcome.text.clone();
    outcome.remarks.iter().for_each(|r| text.push_str(&format!("{r}\n")));
    let mut others = vec![("result.txt".to_string(), text.into_bytes())];
    if outcome.fit.is_some() || !outcome.spectra.is_empty() {
        others.push(("plot.svg".into(), picture(&outcome)?.into_bytes()));
    }
    others.extend(outcome.fit.map_or(Vec::new(), |fit| tables(fit, outcome.runs)));
    others.extend(outcome.tables);
    let mut texts = outcome.model.source().texts().iter().map(|t| t.text().to_string());
    let model = texts.next().unwrap_or_default();
    let used = texts.collect();
    let judged = outcome.fit.map_or(&[][..], |fit| &fit.quality);
    let quality = format!("{}\n", Value::from(quality_json(outcome.model, judged)));
    Ok(Contents { manifest: outcome.manifest, model, used, result: json, quality, others })
}

fn said(e: impl Display) -> String {
    e.to_string()
}
