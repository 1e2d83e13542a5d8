//! `fdm diagnose`: what a model gets wrong, the cause, the extended text, and the gain.

use crate::effects::{Chosen, Effects};
use crate::failure::{Failure, NUMBERS, print};
use crate::histories::overlay_table;
use crate::live::{Live, Shared};
use crate::progress::Progress;
use crate::records::{Records, load, notes};
use crate::spectral::Lines;
use crate::subject::{Estimated, Subject};
use clap::{Args, ValueEnum};
use fdm::Model;
use fdm::diagnose::diagnosis::Diagnosis;
use fdm::diagnose::screen::ScreeningOptions;
use fdm::diagnose::search::{Domain, SearchError, SearchOptions, search};
use fdm::estimate::{Changes, FitOptions, Options};
use fdm::page::{self, page};
use fdm::record::Run;
use fdm::report::{diagnosis_json, diagnosis_text};
use fdm::store::{DataFile, Identity, Manifest};
use serde_json::Value;
use similar::TextDiff;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;

/// What `fdm diagnose` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    #[command(flatten)]
    records: Records,
    /// Run that takes no part in fits: an effect must gain there too; may be given several times
    #[arg(long, value_name = "RUN", help_heading = "Data")]
    holdout: Vec<PathBuf>,
    #[command(flatten)]
    effects: Effects,
    #[command(flatten)]
    chosen: Chosen,
    #[command(flatten)]
    estimated: Estimated,
    /// Chance of a false alarm, over the whole catalogue, at which an effect is believed
    #[arg(long, value_name = "P", default_value_t = 0.01, value_parser = probability, help_heading = "Search")]
    alpha: f64,
    /// Most effects that are accepted, one after the other
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(0..=20), help_heading = "Search")]
    most: u16,
    /// Where models are compared with records; `frequency` is for linear models, unstable ones too, and for nonlinear terms
    /// that records show
    #[arg(long, value_name = "time|frequency", value_enum, default_value_t = Choice::Time, help_heading = "Frequency domain")]
    domain: Choice,
    #[command(flatten, next_help_heading = "Frequency domain")]
    lines: Lines,
    /// Write the model with the accepted effects: your own text with the new lines in their place. Your start values stay; new
    /// parameters start at their estimates
    #[arg(long, value_name = "FILE", help_heading = "Result")]
    write: Option<PathBuf>,
    /// Write text, JSON, the extended model and the difference to a folder
    #[arg(long, value_name = "DIR", help_heading = "Result")]
    out: Option<PathBuf>,
    /// Write one page for a browser: what is wrong, causes, the change of the equations, responses before and after
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    report: Option<PathBuf>,
    /// Print JSON instead of tables
    #[arg(long, help_heading = "Result")]
    json: bool,
    /// Say nothing while working
    #[arg(short, long, help_heading = "Result")]
    quiet: bool,
}

/// Domains as they are typed.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Choice {
    /// Responses are integrated
    Time,
    /// Responses at the frequencies of the records
    Frequency,
}

/// A number between 0 and 1.
fn probability(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("`{text}` is not a number"))?;
    if value > 0.0 && value < 1.0 { Ok(value) } else { Err("a probability is between 0 and 1".into()) }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let domain = domain(arguments)?;
    let catalogue = arguments.chosen.of(arguments.effects.read()?)?;
    let model = arguments.subject.load()?;
    let (runs, held) = read(arguments, &model)?;
    if let Some(folder) = &arguments.out {
        std::fs::create_dir_all(folder).map_err(|e| unwritten(folder, &e))?;
    }
    let options = SearchOptions {
        alpha: arguments.alpha,
        most: arguments.most.into(),
        fit: FitOptions { changes: arguments.subject.changes(&arguments.estimated), ..FitOptions::default() }
            .with_declared_noise(&model),
        screening: ScreeningOptions::default(),
        domain,
    };
    let (mut progress, course) = (Progress::of_a_whole(arguments.quiet), Shared::default());
    if arguments.out.is_some() {
        progress.told(course.clone());
    }
    let _live = Live::begin(arguments.out.iter().cloned().collect(), &model, course);
    let progress = Mutex::new(progress);
    let say = |text: &str| {
        if let Ok(progress) = progress.lock() {
            progress.say(text);
        }
    };
    let found = search(&model, &runs, &held, &catalogue, &options, &say);
    if let Ok(progress) = progress.lock() {
        progress.finish();
    }
    let found = found.map_err(refused)?;
    let manifest = made_from(arguments, &model, &runs, &held, &options);
    Ok(deliver(arguments, &model, &found, manifest))
}

/// What the diagnosis was made from.
fn made_from(
    arguments: &Arguments,
    model: &Model,
    runs: &[Run],
    held: &[Run],
    options: &SearchOptions,
) -> Option<Manifest> {
    if arguments.out.is_none() && arguments.report.is_none() {
        return None;
    }
    let all: Vec<Run> = runs.iter().chain(held).cloned().collect();
    let mut manifest =
        Manifest::of_diagnosis(model, Identity::of(model, &all, options), options.fit.options.noise.clone());
    manifest.command = std::env::args().collect();
    arguments.records.describe(runs, &mut manifest);
    let held = held.iter().zip(&arguments.holdout).map(|(run, file)| DataFile::new(&run.name, file));
    manifest.data.extend(held);
    Some(manifest)
}

/// Options that mean nothing to the other domain are refused, not passed over.
fn domain(arguments: &Arguments) -> Result<Domain, Failure> {
    let given = arguments.lines.given();
    match arguments.domain {
        Choice::Frequency => {
            Ok(Domain::Frequency(Box::new(arguments.lines.options(Changes::default(), Options::default()))))
        }
        Choice::Time if given.is_empty() => Ok(Domain::Time),
        Choice::Time => {
            let said = format!(
                "{} belongs to the frequency domain; say `--domain frequency`, or leave it out",
                given.join(", ")
            );
            Err(Failure::input([said]))
        }
    }
}

/// Runs that are learned from, and those that are held out.
fn read(arguments: &Arguments, model: &Model) -> Result<(Vec<Run>, Vec<Run>), Failure> {
    let mut records = arguments.records.load(model, true)?;
    let held = load(&arguments.holdout, &arguments.records.options(), model)?;
    let learned = records.len();
    records.extend(held);
    if !arguments.quiet {
        notes(&records);
    }
    let mut runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    for k in learned..runs.len() {
        // a held-out file may have the name of another
        while runs[..k].iter().any(|r| r.name == runs[k].name) {
            runs[k].name.push_str(" (held out)");
        }
    }
    let held = runs.split_off(learned);
    Ok((runs, held))
}

fn refused(error: SearchError) -> Failure {
    match error {
        SearchError::Model(e) => Failure::Model(e),
        other => Failure::input([other]),
    }
}

/// Prints the result and writes what was asked for; what cannot be written is told, and costs nothing of what was found.
fn deliver(arguments: &Arguments, model: &Model, found: &Diagnosis, manifest: Option<Manifest>) -> ExitCode {
    let difference = found.extended.as_ref().map_or(String::new(), |text| difference(arguments, model, text));
    let mut failed = Vec::new();
    let mut path = None;
    if let (Some(file), Some(text)) = (&arguments.write, &found.extended) {
        match std::fs::write(file, text) {
            Ok(()) => path = Some(file.display().to_string()),
            Err(e) => failed.push(unwritten(file, &e)),
        }
    }
    let json = diagnosis_json(found, path.as_deref());
    let mut text = diagnosis_text(found);
    if !difference.is_empty() {
        text.push_str(&format!("\n{difference}"));
    }
    if arguments.write.is_some() && found.extended.is_none() {
        text.push_str("nothing was written: no effect was accepted\n");
    }
    if let Some(manifest) = manifest {
        let files = files(model, &text, &json, &difference, found);
        failed.extend(manifest.sealed(files).map_err(|e| Failure::input([e])).and_then(|f| write(arguments, &f)).err());
    }
    let printed = print(&if arguments.json { format!("{json}\n") } else { text });
    failed.iter().for_each(|failure| _ = failure.report());
    if printed && failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) }
}

fn difference(arguments: &Arguments, model: &Model, text: &str) -> String {
    let name = arguments.subject.model.display().to_string();
    let diff = TextDiff::from_lines(model.source().text(), text);
    diff.unified_diff().context_radius(1).header(&name, "extended").to_string()
}

/// What a folder holds.
fn files(model: &Model, text: &str, json: &Value, difference: &str, found: &Diagnosis) -> Vec<(String, Vec<u8>)> {
    let own = model.source().text().to_string();
    let mut files =
        vec![("diagnosis.txt", text.to_string()), ("diagnosis.json", format!("{json}\n")), ("model.fdm", own)];
    if let Some(extended) = &found.extended {
        files.extend([("extended.fdm", extended.clone()), ("extended.diff", difference.to_string())]);
    }
    let mut files: Vec<(String, Vec<u8>)> = files.into_iter().map(|(n, t)| (n.to_string(), t.into_bytes())).collect();
    files.extend(found.overlays.iter().enumerate().map(|(k, overlay)| overlay_table(model, k, overlay)));
    files
}

/// The folder and the page, where they are wanted, from the same files.
fn write(arguments: &Arguments, files: &[(String, Vec<u8>)]) -> Result<(), Failure> {
    for (folder, (name, contents)) in arguments.out.iter().flat_map(|folder| files.iter().map(move |f| (folder, f))) {
        let path = folder.join(name);
        std::fs::write(&path, contents).map_err(|e| unwritten(&path, &e))?;
    }
    if let Some(path) = &arguments.report {
        let subject = page::Subject::from_files(files).map_err(|e| Failure::input([e]))?;
        std::fs::write(path, page(&subject)).map_err(|e| unwritten(path, &e))?;
    }
    Ok(())
}

fn unwritten(path: &Path, error: &std::io::Error) -> Failure {
    Failure::input([format!("{}: {}", path.display(), fdm::store::reason(error))])
}
