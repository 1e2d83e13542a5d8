//! `fdm regress`: equation error, in the time domain or, with a band, in the frequency domain.

use crate::delivery::{Delivery, Outcome};
use crate::failure::{Failure, NUMBERS, none_ignored, print};
use crate::records::{Records, notes};
use crate::recursive::Recursive;
use crate::subject::{Estimated, Subject};
use clap::{Args, ValueEnum};
use fdm::Model;
use fdm::estimate::{Noise, changed};
use fdm::record::Run;
use fdm::regression::{
    Components, Dependence, Detrend, Domain, Limits, RegressionError, RegressionOptions, Smoothing, by_cutoff,
    by_length, regress, structure,
};
use fdm::report::{dependence_table, regression_json, regression_table, structure_table};
use fdm::spectrum::Frequencies;
use fdm::store::{Identity, Manifest};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm regress` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    #[command(flatten)]
    records: Records,
    #[command(flatten)]
    estimated: Estimated,
    /// Least squares of all rows at once, or recursively, step by step, with forgetting
    #[arg(long, value_name = "METHOD", value_enum, default_value_t, help_heading = "Regression")]
    method: Approach,
    /// Compare transforms at the frequencies of this band, in cycles per unit of time
    #[arg(long, value_name = "LO:HI", value_parser = pair, help_heading = "Regression")]
    band: Option<(f64, f64)>,
    /// Distance of the frequencies [default: those of the record]
    #[arg(long, value_name = "STEP", requires = "band", help_heading = "Regression")]
    df: Option<f64>,
    /// Rates in the time domain: `local`, `local:POINTS` (a polynomial through so many neighbours), `fourier` (optimal Fourier
    /// smoothing), or `fourier:CUTOFF`
    #[arg(long, value_name = "HOW", default_value = "local", value_parser = smoothing, conflicts_with = "band", help_heading = "Regression")]
    smooth: Smoothing,
    /// Take `none`, the `mean` or the best `line` off rates and regressors of every run
    #[arg(long, value_name = "WHAT", default_value = "none", value_parser = detrend, conflicts_with = "band", help_heading = "Regression")]
    detrend: Detrend,
    /// Principal components of the solution: all but directions in which columns move together (`auto`), those up to where R^2
    /// levels off and errors are least (`level`), or so many
    #[arg(long, value_name = "auto|level|K", default_value = "auto", value_parser = components, help_heading = "Regression")]
    components: Components,
    #[command(flatten)]
    recursive: Recursive,
    /// Search the structure of every measured rate among signals, squares and products instead
    #[arg(long, help_heading = "Regression")]
    stepwise: bool,
    /// Show how the estimates depend on the highest frequency, and on the part of the records that is used
    #[arg(long, conflicts_with = "stepwise", help_heading = "Result")]
    dependence: bool,
    /// Print JSON instead of tables
    #[arg(long, help_heading = "Result")]
    json: bool,
    /// Write everything to a folder: model, options, fingerprints of the data, result, tables
    #[arg(long, value_name = "DIR", conflicts_with = "stepwise", help_heading = "Result")]
    out: Option<PathBuf>,
    /// Write one page for a browser with equations, tables and figures, as `fdm report` makes it from a folder
    #[arg(long, value_name = "FILE.html", conflicts_with = "stepwise", help_heading = "Result")]
    report: Option<PathBuf>,
    /// Say nothing about the records
    #[arg(short, long, help_heading = "Result")]
    quiet: bool,
}

/// What `--method` takes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
enum Approach {
    /// Least squares by singular values
    #[default]
    Ls,
    /// Recursive least squares with forgetting; of all iterates the one whose simulation errs least
    Rls,
}

/// Parts of the band and of the records that `--dependence` shows.
const PARTS: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];

impl Arguments {
    /// Options that would be ignored are told, not ignored.
    fn refuse(&self) -> Result<(), Failure> {
        let (given, method, belongs) = match self.method {
            Approach::Ls => (self.recursive.given(), "least squares", "--method rls"),
            Approach::Rls => {
                let given = [
                    ("--band", self.band.is_some()),
                    ("--df", self.df.is_some()),
                    ("--smooth", self.smooth != Smoothing::default()),
                    ("--components", self.components != Components::default()),
                    ("--stepwise", self.stepwise),
                    ("--dependence", self.dependence),
                    ("--out", self.out.is_some()),
                    ("--report", self.report.is_some()),
                ];
                let given = given.into_iter().filter(|(_, given)| *given).map(|(name, _)| name).collect();
                (given, "recursive least squares", "--method ls")
            }
        };
        none_ignored(method, &given, belongs)
    }

    fn options(&self) -> RegressionOptions {
        let domain = match (self.band, self.df) {
            (None, _) => Domain::Time,
            (Some((low, high)), None) => {
                Domain::Frequency(Frequencies::Grid { lowest: Some(low), highest: Some(high) })
            }
            (Some((lowest, highest)), spacing) => Domain::Frequency(Frequencies::Band { lowest, highest, spacing }),
        };
        RegressionOptions { domain, smoothing: self.smooth, detrend: self.detrend, components: self.components }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    arguments.refuse()?;
    let model = arguments.subject.load()?;
    let changes = arguments.subject.changes(&arguments.estimated);
    let model = changed(&model, &changes).map_err(|e| Failure::input([e]))?;
    let records = arguments.records.load(&model, true)?;
    if !arguments.quiet {
        notes(&records);
    }
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    if arguments.method == Approach::Rls {
        return arguments.recursive.run(&model, &runs, arguments.detrend, arguments.json);
    }
    if arguments.stepwise {
        let text = searched(&model, &runs, arguments).map_err(|e| Failure::input([e]))?;
        return Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) });
    }
    // places that cannot be written are told before the work
    let (json, quiet) = (arguments.json, arguments.quiet);
    let delivery = Delivery::of_tables(json, quiet, arguments.out.clone(), arguments.report.clone());
    let prepared = delivery.prepare()?;
    let (text, json) = estimated(&model, &runs, arguments).map_err(|e| Failure::input([e]))?;
    let options = arguments.options();
    let mut manifest = Manifest::new(&model, Identity::of(&model, &runs, &options), Noise::Diagonal);
    manifest.command = std::env::args().collect();
    if delivery.describes() {
        arguments.records.describe(&runs, &mut manifest);
    }
    let (spectra, tables, remarks) = (Vec::new(), Vec::new(), Vec::new());
    let outcome = Outcome { model: &model, fit: None, runs: &runs, spectra, tables, text, json, remarks, manifest };
    Ok(if prepared.deliver(outcome) { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

fn searched(model: &Model, runs: &[Run], arguments: &Arguments) -> Result<String, RegressionError> {
    let found = structure(model, runs, &arguments.options(), &Limits::default())?;
    Ok(if arguments.json {
        format!("{}\n", json!({ "model": model.name(), "structures": found }))
    } else {
        structure_table(&found)
    })
}

/// Tables, and the same for programs.
fn estimated(model: &Model, runs: &[Run], arguments: &Arguments) -> Result<(String, Value), RegressionError> {
    let options = arguments.options();
    let found = regress(model, runs, &options)?;
    let (mut text, mut document) = (regression_table(&found), regression_json(model.name(), &found));
    if arguments.dependence {
        let (low, high) = arguments.band.unwrap_or_else(|| (0.0, nyquist(runs) / 4.0));
        let cutoffs = PARTS.map(|part| low + part * (high - low));
        let cutoff: Vec<Dependence> = by_cutoff(model, runs, &options, &cutoffs);
        let length: Vec<Dependence> = by_length(model, runs, &options, &PARTS);
        text.push_str(&format!("\n{}\n{}", dependence_table("highest", &cutoff), dependence_table("part", &length)));
        (document["by_cutoff"], document["by_length"]) = (json!(cutoff), json!(length));
    }
    Ok((text, document))
}

/// Half the mean sampling rate of the slowest record.
fn nyquist(runs: &[Run]) -> f64 {
    let rate = |run: &Run| 0.5 * (run.len() as f64 - 1.0) / (run.time[run.len() - 1] - run.time[0]);
    runs.iter().filter(|r| r.len() > 1).map(rate).fold(f64::INFINITY, f64::min)
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| format!("`{text}` is not a number"))
}

/// `LO:HI`
fn pair(text: &str) -> Result<(f64, f64), String> {
    let (low, high) = text.split_once(':').ok_or("expected LO:HI")?;
    Ok((number(low)?, number(high)?))
}

fn smoothing(text: &str) -> Result<Smoothing, String> {
    match text.split_once(':') {
        None if text == "local" => Ok(Smoothing::default()),
        None if text == "fourier" => Ok(Smoothing::Optimal),
        Some(("local", points)) => {
            let points = points.trim().parse().map_err(|_| format!("`{points}` is not a number of samples"))?;
            Ok(Smoothing::Local { points })
        }
        Some(("fourier", cutoff)) => Ok(Smoothing::Fixed { cutoff: number(cutoff)? }),
        _ => Err("expected local, local:POINTS, fourier or fourier:CUTOFF".into()),
    }
}

fn detrend(text: &str) -> Result<Detrend, String> {
    match text {
        "none" => Ok(Detrend::None),
        "mean" => Ok(Detrend::Mean),
        "line" => Ok(Detrend::Line),
        _ => Err("expected none, mean or line".into()),
    }
}

fn components(text: &str) -> Result<Components, String> {
    match text {
        "auto" => Ok(Components::Auto),
        "level" => Ok(Components::Levelled),
        _ => text
            .parse()
            .ok()
            .filter(|k| *k > 0)
            .map(Components::Count)
            .ok_or_else(|| "expected auto, level or a number from 1 on".into()),
    }
}
