//! Where a result goes: to the terminal as tables or JSON, to a picture, to a folder.

use crate::failure::{Failure, print, remark};
use crate::histories::{histories, tables};
use clap::Args;
use fdm::Model;
use fdm::estimate::Fit;
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
    /// Looks at the places before any work is done in vain.
    pub(crate) fn prepare(&self) -> Result<Prepared<'_>, Failure> {
        if let Some(path) = &self.plot {
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
    /// Prints the result, then writes what was asked for. What cannot be written is told; says whether all was.
    pub(crate) fn deliver(&self, outcome: Outcome<'_>) -> bool {
        let json = format!("{}\n", outcome.json);
        let printed = print(if self.delivery.json { &json } else { &outcome.text });
        outcome.remarks.iter().for_each(|r| remark(format_args!("{r}")));
        let plot = self.delivery.plot.as_deref().map_or(Ok(()), |path| draw(&outcome, path));
        let written = self.destination.as_ref().map_or(Ok(()), |place| write(outcome, json, place));
        let failed = [plot.err(), written.err()];
        failed.iter().flatten().for_each(|e| remark(format_args!("error: {e}")));
        printed && failed.iter().all(Option::is_none)
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

fn write(outcome: Outcome<'_>, json: String, place: &Destination) -> Result<(), String> {
    let mut text = outcome.text.clone();
    outcome.remarks.iter().for_each(|r| text.push_str(&format!("{r}\n")));
    let mut others = vec![("result.txt".to_string(), text.into_bytes())];
    others.push(("plot.svg".into(), picture(&outcome)?.into_bytes()));
    others.extend(outcome.fit.map_or(Vec::new(), |fit| tables(fit, outcome.runs)));
    others.extend(outcome.tables);
    let mut texts = outcome.model.source().texts().iter().map(|t| t.text().to_string());
    let model = texts.next().unwrap_or_default();
    let used = texts.collect();
    let judged = outcome.fit.map_or(&[][..], |fit| &fit.quality);
    let quality = format!("{}\n", Value::from(quality_json(outcome.model, judged)));
    let contents = Contents { manifest: outcome.manifest, model, used, result: json, quality, others };
    contents.write(place).map_err(|e| format!("{e}; the result is what is printed"))
}

fn said(e: impl Display) -> String {
    e.to_string()
}
