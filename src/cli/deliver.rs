//! Where a result goes: to the terminal as text or JSON, to a picture, to a folder, to a page.

use crate::bands::edges;
use crate::failure::{Failure, OrFailure, Unwritten, as_json, at, print, print_lines, remark};
use crate::load::Campaign;
use crate::margins;
use crate::modes::of_result;
use crate::progress::Progress;
use crate::progress_file::{Course, CourseWriter};
use clap::Args;
use fdm_discover::Overlay;
use fdm_estimate::{Fit, Noise, responses_of_fit};
use fdm_lab::posterior::Bands;
use fdm_report::page::{Subject, page};
use fdm_report::{TimeHistory, svg};
use fdm_results::documents::{OutputDocument, Pair, ResultDocument};
use fdm_results::store::{Contents, Destination, Identity, Manifest, make_folder, write_file};
use fdm_system::Model;
use fdm_system::record::{Column, Dialect, Run, write_to};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A file: its name and its contents.
pub(crate) type NamedFile = (String, Vec<u8>);

/// What is printed.
#[derive(Debug, Args)]
#[command(next_help_heading = "Result")]
pub(crate) struct Output {
    /// Print JSON instead of tables
    #[arg(long)]
    pub(crate) json: bool,
    #[command(flatten)]
    pub(crate) manner: Manner,
}

/// How much is said, by every verb alike; these options stand in front of the verb too.
#[derive(Debug, Args)]
pub(crate) struct Manner {
    /// Say nothing while working
    #[arg(short, long, global = true, display_order = 1000, help_heading = None)]
    pub(crate) quiet: bool,
    /// Say every remark, and how each run is integrated
    #[arg(long, global = true, display_order = 1001, help_heading = None)]
    pub(crate) verbose: bool,
}

impl Output {
    /// Prints the text, or a document as JSON when that is wanted; says whether all was printed.
    pub(crate) fn print<D: Serialize>(
        &self,
        text: impl FnOnce() -> String,
        document: impl FnOnce() -> D,
    ) -> Result<bool, Failure> {
        Ok(if self.json { print_lines(&as_json(&document())?) } else { print(&text()) })
    }

    /// Prints what was made before, text or JSON as was asked for.
    pub(crate) fn print_made(&self, made: &str) -> bool {
        if self.json { print_lines(made) } else { print(made) }
    }
}

/// Places of a whole result.
#[derive(Debug, Args)]
#[command(next_help_heading = "Result")]
pub(crate) struct Places {
    /// Write everything to a folder: model, result, tables, pictures
    ///
    /// With the options and the fingerprints of the data.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Write one page for a browser, as `fdm report` does
    ///
    /// Equations, tables and figures, as `fdm report` makes them from a folder.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) report: Option<PathBuf>,
    /// Replace files that fdm did not write; in the folder of --out those too that were changed since, while files with other names
    /// stay in any case
    #[arg(long, hide_short_help = true)]
    force: bool,
    /// The words that a result is to tell as its command, where they are not those of this process.
    #[arg(skip)]
    pub(crate) typed: Option<Vec<String>>,
}

/// A result as it is printed and written: nothing has to be computed any more.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Rendered {
    /// Text or JSON, whatever was asked for.
    pub(crate) printed: Result<String, String>,
    /// What goes to standard error behind it.
    pub(crate) remarks: Vec<String>,
    /// The drawing, where it is wanted.
    pub(crate) plot: Option<String>,
    /// The files of the folder, where a folder or a page is wanted.
    pub(crate) files: Option<Result<Vec<NamedFile>, String>>,
}

/// What is printed and written of a fit.
#[derive(Debug, Args)]
#[command(next_help_heading = "Result")]
pub(crate) struct Delivery {
    #[command(flatten)]
    pub(crate) output: Output,
    /// Draw measurement, model and residual over time to an SVG file
    #[arg(long, value_name = "FILE.svg", hide_short_help = true)]
    pub(crate) plot: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) places: Places,
}

/// A result and what is said about it.
pub(crate) struct Outcome<'a> {
    pub(crate) model: &'a Model,
    /// The fit in the time domain, whose histories are drawn and written.
    pub(crate) fit: Option<&'a Fit>,
    pub(crate) runs: &'a [Run],
    /// Spectra to be drawn in front of the histories.
    pub(crate) spectra: Vec<TimeHistory<'a>>,
    /// Tables to be written besides.
    pub(crate) tables: Vec<NamedFile>,
    /// Bands of each run, where it is a prediction.
    pub(crate) bands: Vec<Option<Bands>>,
    /// Tables and sentences.
    pub(crate) text: String,
    /// Tables and sentences with all remarks, for the folder; none where nothing is left out.
    pub(crate) whole: Option<String>,
    /// The result for programs.
    pub(crate) json: ResultDocument,
    /// What goes to standard error behind it.
    pub(crate) remarks: Vec<String>,
    pub(crate) manifest: Manifest,
}

impl Outcome<'_> {
    /// The modes of the model as it was found, its requirements and its frequency responses are part of what is written.
    fn find_modes(&mut self) {
        let runs: Vec<String> = self.runs.iter().map(|run| run.name.clone()).collect();
        let modes = of_result(self.model, &self.json, &runs);
        self.json.set_modes(modes);
        self.json.set_requirements(margins::of_result(self.model, &self.json, &runs));
        let in_time = self.fit.filter(|fit| fit.estimate.termination.is_good());
        let responses = in_time.filter(|_| self.json.is_simulated()).map(|fit| responses_of_fit(fit, self.runs));
        self.json.set_bode(responses.unwrap_or_default().iter().map(Pair::from).collect());
    }

    /// The files of the folder that `--out` would write.
    pub(crate) fn files(mut self) -> Result<Vec<NamedFile>, String> {
        self.find_modes();
        contents(self).files().map_err(|e| e.to_string())
    }
}

/// Places that were looked at before the work.
pub(crate) struct Prepared<'a> {
    output: &'a Output,
    plot: Option<&'a Path>,
    places: &'a Places,
    destination: Option<Destination>,
}

impl Delivery {
    /// Looks at the places before any work on these runs is done in vain.
    pub(crate) fn prepare(&self, model: &Model, runs: &[Run]) -> Result<Prepared<'_>, Failure> {
        prepare(&self.output, self.plot.as_deref(), &self.places, (model, runs))
    }
}

impl Delivery {
    /// A result as it will be delivered.
    pub(crate) fn rendered(&self, outcome: Outcome<'_>) -> Rendered {
        rendered(outcome, &self.output, self.plot.is_some(), &self.places)
    }
}

fn rendered(mut outcome: Outcome<'_>, output: &Output, plot: bool, places: &Places) -> Rendered {
    if output.json || places.any() {
        outcome.find_modes();
    }
    Rendered {
        printed: if output.json { outcome.json.text().map_err(|e| e.to_string()) } else { Ok(outcome.text.clone()) },
        remarks: outcome.remarks.clone(),
        plot: plot.then(|| picture(&outcome)),
        files: places.any().then(|| contents(outcome).files().map_err(|e| e.to_string())),
    }
}

impl Places {
    /// What a result was made from: this model, these runs, these options, this command.
    pub(crate) fn manifest(&self, model: &Model, identity: Identity, noise: Noise, campaign: &Campaign) -> Manifest {
        let mut manifest = Manifest::new(model, identity, noise);
        manifest.command = self.command();
        if self.any() {
            campaign.describe(&mut manifest);
        }
        manifest
    }

    /// The command that a result tells.
    pub(crate) fn command(&self) -> Vec<String> {
        self.typed.clone().unwrap_or_else(crate::command_line)
    }

    /// Whether it will be asked what the result was made from.
    pub(crate) fn any(&self) -> bool {
        self.out.is_some() || self.report.is_some()
    }

    /// Looks at the folder, where one is wanted, for a result with files of these names.
    pub(crate) fn destination(&self, names: &[String]) -> Result<Option<Destination>, Failure> {
        let out = self.out.as_deref();
        out.map(|out| Destination::prepare_for(out, names, self.force)).transpose().or_failure()
    }
}

/// Looks at the places before any work on these runs is done in vain; that files can be written was seen before.
pub(crate) fn prepare<'a>(
    output: &'a Output,
    plot: Option<&'a Path>,
    places: &'a Places,
    (model, runs): (&Model, &[Run]),
) -> Result<Prepared<'a>, Failure> {
    let destination = places.destination(&names(model, runs))?;
    Ok(Prepared { output, plot, places, destination })
}

/// Names of all files that the result of any method may have.
fn names(model: &Model, runs: &[Run]) -> Vec<String> {
    let own = ["model.fdm", "quality.json", "result.json", "result.txt", "plot.svg"];
    let study = ["study.json", "fit.txt", "repeats.csv"];
    let layout = model.layout();
    let mut names: Vec<String> = own.iter().chain(&study).map(ToString::to_string).collect();
    names.extend((1..model.source().texts().len()).map(|k| format!("model.{k}.fdm")));
    names.extend(runs.iter().enumerate().map(|(k, run)| run_file(k, &run.name)));
    names.extend((1..=runs.len()).map(|k| format!("spectrum_{k}.csv")));
    names.extend((1..=layout.inputs * layout.outputs).map(|k| format!("response_{k}.csv")));
    names
}

impl Prepared<'_> {
    /// Writes down how far the work is, beside the folder that is to hold its result and beside its checkpoint.
    pub(crate) fn follow(
        &self,
        model: &Model,
        checkpoint: Option<&Path>,
        progress: &mut Progress,
    ) -> (CourseWriter, Course) {
        let folders = self.destination.iter().map(Destination::folder).chain(checkpoint);
        progress.follow(folders.map(Path::to_path_buf).collect(), model)
    }

    /// What a result was made from: this model, these runs, these options, this command.
    pub(crate) fn manifest(&self, model: &Model, identity: Identity, noise: Noise, campaign: &Campaign) -> Manifest {
        self.places.manifest(model, identity, noise, campaign)
    }

    /// Prints the result, then writes what was asked for. What cannot be written is told; says whether all was.
    pub(crate) fn deliver(&self, outcome: Outcome<'_>) -> bool {
        self.hand_over(rendered(outcome, self.output, self.plot.is_some(), self.places))
    }

    /// Prints what was rendered before, then writes what was asked for.
    pub(crate) fn hand_over(&self, result: Rendered) -> bool {
        let printed = match &result.printed {
            Ok(made) => self.output.print_made(made),
            Err(e) => {
                remark(format_args!("error: {e}"));
                false
            }
        };
        result.remarks.iter().for_each(|r| remark(format_args!("{r}")));
        let drawing = self.plot.zip(result.plot);
        let plot = drawing.map_or(Ok(()), |(path, drawing)| write(path, drawing));
        let failed = [plot.err().map(|e| e.to_string()), result.files.and_then(|files| self.keep(files).err())];
        let say = |e: &String| remark(format_args!("error: {e}; the result is what is printed"));
        failed.iter().flatten().for_each(say);
        printed && failed.iter().all(Option::is_none)
    }

    /// Writes folder and page, where they are wanted, from the same files.
    fn keep(&self, files: Result<Vec<NamedFile>, String>) -> Result<(), String> {
        let files = files?;
        let page = self.places.write_page(&files);
        let folder = self.destination.as_ref().map_or(Ok(()), |place| place.fill(&files));
        folder.map_err(|e| e.to_string()).and(page)
    }
}

impl Places {
    /// Writes the page, where it is wanted, from the files of a result.
    pub(crate) fn write_page(&self, files: &[NamedFile]) -> Result<(), String> {
        let Some(path) = &self.report else { return Ok(()) };
        let page = page(&Subject::from_files(files).map_err(|e| e.to_string())?);
        write(path, page).map_err(|e| e.to_string())
    }
}

/// Writes a file: all of it, or what stood there before stays.
pub(crate) fn write(path: &Path, contents: impl AsRef<[u8]>) -> Result<(), Unwritten> {
    write_file(path, contents.as_ref()).map_err(|e| Unwritten(at(path, &e)))
}

/// Refuses files of a folder that would be written over others of the same name; with `force` they are replaced. What stands there
/// just so is as good as written.
pub(crate) fn refuse_others(folder: &Path, files: &[NamedFile], force: bool) -> Result<(), Failure> {
    let differs = |(name, contents): &&NamedFile| {
        let path = folder.join(name);
        path.symlink_metadata().is_ok() && std::fs::read(&path).ok().as_ref() != Some(contents)
    };
    let others: Vec<String> = files.iter().filter(differs).map(|(name, _)| name.clone()).collect();
    if force || others.is_empty() {
        return Ok(());
    }
    Err(Failure::Input(others.iter().map(|name| standing(&folder.join(name))).collect()))
}

/// What is said of a file that stands where another would be written.
pub(crate) fn standing(path: &Path) -> String {
    format!(
        "{}: exists already, and is not overwritten; give another folder, or replace it with --force",
        path.display()
    )
}

/// Writes files to a folder, which is made where there is none.
pub(crate) fn write_all(folder: &Path, files: &[NamedFile]) -> Result<(), Unwritten> {
    make_folder(folder).map_err(|e| Unwritten(at(folder, &e)))?;
    files.iter().try_for_each(|(name, contents)| write(&folder.join(name), contents))
}

/// Refuses a folder that stands there already.
pub(crate) fn refuse_standing(folder: &Path) -> Result<(), Failure> {
    match folder.symlink_metadata() {
        Ok(_) => Err(Failure::input([format!("{}: exists already, and is not overwritten", folder.display())])),
        Err(_) => Ok(()),
    }
}

/// Makes a new folder with these files, and with those in folders of it: whole, or not at all.
pub(crate) fn write_folder(folder: &Path, files: &[NamedFile]) -> Result<(), Unwritten> {
    let made = Destination::prepare(folder).and_then(|place| place.fill(files));
    made.map_err(|e| Unwritten(e.to_string()))
}

fn picture(outcome: &Outcome<'_>) -> String {
    let mut panels = outcome.spectra.clone();
    panels.extend(outcome.fit.map_or(Vec::new(), |fit| histories(fit, outcome.runs)));
    svg(&panels)
}

/// Everything that a folder holds.
fn contents(outcome: Outcome<'_>) -> Contents {
    let mut text = outcome.whole.as_ref().unwrap_or(&outcome.text).clone();
    outcome.remarks.iter().for_each(|r| text.push_str(&format!("{r}\n")));
    let mut others = vec![("result.txt".to_string(), text.into_bytes())];
    if outcome.fit.is_some() || !outcome.spectra.is_empty() {
        others.push(("plot.svg".into(), picture(&outcome).into_bytes()));
    }
    others.extend(outcome.fit.map_or(Vec::new(), |fit| run_tables(fit, outcome.runs, &outcome.bands)));
    others.extend(outcome.tables);
    let mut texts = outcome.model.source().texts().iter().map(|t| t.text().to_string());
    let model = texts.next().unwrap_or_default();
    let used = texts.collect();
    let judged = outcome.fit.map_or(&[][..], |fit| &fit.quality);
    let quality = OutputDocument::of_quality(outcome.model, judged);
    Contents { manifest: outcome.manifest, model, used, result: outcome.json, quality, others }
}

/// Name and meaning of a model.
pub(crate) fn title(model: &Model) -> String {
    let (name, doc) = (model.name(), &model.definition().doc);
    if doc.is_empty() { name.to_string() } else { format!("{name}: {doc}") }
}

/// Every output of every run over time: measurement beside response.
pub(crate) fn histories<'a>(fit: &Fit, runs: &'a [Run]) -> Vec<TimeHistory<'a>> {
    let definition = fit.model.definition();
    let q = definition.outputs.len();
    let mut histories = Vec::new();
    for (run, result) in runs.iter().zip(&fit.estimate.runs) {
        for (o, output) in definition.outputs.iter().enumerate() {
            let name = &output.quantity.name;
            let unit = output.quantity.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
            let quality = fit.estimate.outputs.iter().find(|f| f.name == *name && f.run == run.name);
            let rms =
                quality.and_then(|f| f.rms).map_or(String::new(), |r| format!(", RMS of the residual {r:.4}{unit}"));
            histories.push(TimeHistory {
                title: format!("{}: {name} in {}{rms}", fit.model.name(), run.name),
                time_label: format!("t [{}]", definition.time),
                value_label: format!("{name} [{}]", unit.trim()),
                time: &run.time,
                measured: column(&run.measured, o, q),
                modelled: column(&result.response, o, q),
            });
        }
    }
    histories
}

/// One table for each run: time, inputs, and of every output what was measured, the response and the residual. The name of
/// a file holds the name of its run as far as file systems allow.
fn run_tables(fit: &Fit, runs: &[Run], bands: &[Option<Bands>]) -> Vec<NamedFile> {
    let table = |(k, (run, result)): (usize, (&Run, &fdm_estimate::RunFit))| {
        let bands = bands.get(k).and_then(Option::as_ref);
        (run_file(k, &run.name), run_table(fit, run, (&result.response, &result.residuals), bands))
    };
    runs.iter().zip(&fit.estimate.runs).enumerate().map(table).collect()
}

fn run_table(fit: &Fit, run: &Run, (response, residuals): (&[f64], &[f64]), bands: Option<&Bands>) -> Vec<u8> {
    let definition = fit.model.definition();
    let (m, q) = (run.held.len(), definition.outputs.len());
    let mut columns = vec![("t".to_string(), Some(definition.time.to_string()), run.time.clone())];
    for (k, input) in definition.inputs.iter().enumerate().take(m) {
        let unit = input.quantity.unit.as_ref().map(ToString::to_string);
        columns.push((input.quantity.name.clone(), unit, column(&run.inputs, k, m)));
    }
    for (k, output) in definition.outputs.iter().enumerate() {
        let (name, unit) = (&output.quantity.name, output.quantity.unit.as_ref().map(ToString::to_string));
        columns.push((name.clone(), unit.clone(), column(&run.measured, k, q)));
        columns.push((format!("{name}_model"), unit.clone(), column(response, k, q)));
        columns.push((format!("{name}_residual"), unit.clone(), column(residuals, k, q)));
        if let Some(bands) = bands {
            let edges = edges(bands, name, response, k, q);
            columns.extend(edges.into_iter().map(|(name, values)| (name, unit.clone(), values)));
        }
    }
    csv(&columns)
}

/// The table of a run of a diagnosis: time, and of every output what was measured, and the responses before and after.
pub(crate) fn overlay_table(model: &Model, k: usize, overlay: &Overlay) -> NamedFile {
    let definition = model.definition();
    let q = definition.outputs.len();
    let mut columns = vec![("t".to_string(), Some(definition.time.to_string()), overlay.time.clone())];
    for (o, output) in definition.outputs.iter().enumerate() {
        let (name, unit) = (&output.quantity.name, output.quantity.unit.as_ref().map(ToString::to_string));
        columns.push((name.clone(), unit.clone(), column(&overlay.measured, o, q)));
        columns.push((format!("{name}_before"), unit.clone(), column(&overlay.before, o, q)));
        columns.push((format!("{name}_after"), unit, column(&overlay.after, o, q)));
    }
    (run_file(k, &overlay.run), csv(&columns))
}

/// Columns (name, unit, values) as a file.
pub(crate) fn csv(columns: &[(String, Option<String>, Vec<f64>)]) -> Vec<u8> {
    let columns: Vec<Column<'_>> =
        columns.iter().map(|(name, unit, values)| Column { name, unit: unit.as_deref(), values }).collect();
    let mut text = Vec::new();
    // memory takes everything that is written to it
    let _ = write_to(&mut text, Dialect::default(), &columns);
    text
}

/// The k-th of `width` values of every row.
pub(crate) fn column(rows: &[f64], k: usize, width: usize) -> Vec<f64> {
    rows.iter().skip(k).step_by(width).copied().collect()
}

/// The name of the file of the k-th run.
pub(crate) fn run_file(k: usize, run: &str) -> String {
    const LONGEST: usize = 60;
    let kept = |c: char| if c.is_alphanumeric() || "-_.#".contains(c) { c } else { '_' };
    let plain: String = run.chars().take(LONGEST).map(kept).collect();
    format!("run_{}_{plain}.csv", k + 1)
}
