//! `fdm fit`: parameters, their standard errors and the quality of the match, from one or several runs.

use crate::failure::{Failure, NUMBERS, print};
use crate::progress::Progress;
use crate::records::Records;
use crate::strategies::Strategies;
use crate::subject::{Subject, assignment};
use clap::Args;
use fdm::Model;
use fdm::estimate::{Fit, FitOptions, Noise, Options, fit};
use fdm::record::{Run, Summary};
use fdm::report::{TimeHistory, confidence, fit_json, fit_table, history_table, svg, way};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm fit` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    #[command(flatten)]
    records: Records,
    /// Keep a parameter at its start value
    #[arg(long, value_name = "NAME")]
    fix: Vec<String>,
    /// Estimate a parameter that the model declares `fixed`
    #[arg(long, value_name = "NAME")]
    free: Vec<String>,
    /// Measurement noise: `diagonal` (one variance per output, estimated), `full` (their covariance, estimated), or the known
    /// standard deviation of an output
    #[arg(long, value_name = "diagonal|full|OUTPUT=DEVIATION")]
    noise: Vec<String>,
    /// Most corrections
    #[arg(long, value_name = "N", default_value_t = 100)]
    iterations: usize,
    /// Largest correction, relative to the parameter, at which the estimates count as converged
    #[arg(long, value_name = "T", default_value_t = 1e-9)]
    tolerance: f64,
    /// Runge-Kutta steps between samples, instead of as many as accuracy needs
    #[arg(long, value_name = "N")]
    steps: Option<NonZeroUsize>,
    #[command(flatten)]
    strategies: Strategies,
    /// Print JSON instead of tables
    #[arg(long)]
    json: bool,
    /// Draw measurement, model and residual over time to an SVG file
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Show the interval of two standard errors of each parameter
    #[arg(long)]
    intervals: bool,
    /// Show the iteration, correction by correction
    #[arg(long)]
    history: bool,
    /// Say nothing while working
    #[arg(short, long)]
    quiet: bool,
}

#[allow(clippy::print_stderr, reason = "this is where the command line speaks")]
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut progress = Progress::new(arguments.quiet);
    let model = arguments.subject.load()?;
    let records = arguments.records.load(&model, true)?;
    if !arguments.quiet {
        notes(&records);
    }
    let options = FitOptions {
        changes: arguments.subject.changes(&arguments.fix, &arguments.free),
        options: Options {
            noise: noise(&arguments.noise, &model)?,
            iterations: arguments.iterations,
            tolerance: arguments.tolerance,
            ..Options::default()
        },
        per_interval: arguments.steps.map(NonZeroUsize::get),
        ..FitOptions::default()
    };
    let options = arguments.strategies.among(options);
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let result = fit(&model, &runs, &options, &mut progress);
    progress.finish();
    let result = result.map_err(|e| Failure::input([e]))?;
    print(&if arguments.json { format!("{}\n", fit_json(&result)) } else { text(&result, &runs, arguments) });
    if let Some(path) = &arguments.plot {
        let drawn = svg(&histories(&result, &runs)).map_err(|e| Failure::input([e]))?;
        std::fs::write(path, drawn).map_err(|e| Failure::input([format!("{}: {e}", path.display())]))?;
    }
    let (good, termination) = (result.estimate.is_good(), &result.estimate.termination);
    if !termination.is_good() {
        eprintln!("{termination}");
    } else if !good {
        eprintln!(
            "the data do not determine every parameter: fix some of what is named above, or add runs that move them"
        );
    }
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

/// What a careful reader would mention about the records.
#[allow(clippy::print_stderr, reason = "this is where the command line speaks")]
fn notes(records: &[(Run, Summary)]) {
    for (run, summary) in records {
        for note in &summary.notes {
            eprintln!("note: {}: {note}", run.name);
        }
        let gaps: Vec<String> = summary
            .sources
            .iter()
            .filter(|s| s.gaps > 0 && s.column.is_some())
            .map(|s| format!("{} of `{}`", s.gaps, s.channel))
            .collect();
        if !gaps.is_empty() {
            eprintln!("note: {}: cells without a value: {}", run.name, gaps.join(", "));
        }
    }
}

fn noise(words: &[String], model: &Model) -> Result<Noise, Failure> {
    let outputs = &model.definition().outputs;
    let (mut given, mut kind) = (vec![None; outputs.len()], None);
    let mut wrong = Vec::new();
    for word in words {
        match word.as_str() {
            "diagonal" => kind = Some(Noise::Diagonal),
            "full" => kind = Some(Noise::Full),
            _ => match assignment(word) {
                Ok((name, deviation)) => match outputs.iter().position(|o| o.quantity.name == name) {
                    Some(k) => given[k] = Some(deviation),
                    None => {
                        let names = outputs.iter().map(|o| o.quantity.name.as_str());
                        let hint = fdm_grammar::diagnostic::nearest(&name, names);
                        let hint = hint.map_or(String::new(), |h| format!("; did you mean `{h}`?"));
                        wrong.push(format!("--noise {word}: the model has no output `{name}`{hint}"));
                    }
                },
                Err(e) => wrong.push(format!("--noise {word}: {e}, `diagonal` or `full`")),
            },
        }
    }
    let any = given.iter().any(Option::is_some);
    if any && kind == Some(Noise::Full) {
        wrong.push("--noise full estimates the whole covariance: deviations cannot be given beside it".into());
    }
    if !wrong.is_empty() {
        return Err(Failure::Input(wrong));
    }
    Ok(if any { Noise::Given(given) } else { kind.unwrap_or_default() })
}

fn text(fit: &Fit, runs: &[Run], arguments: &Arguments) -> String {
    let e = &fit.estimate;
    let name = fit.model.name();
    let doc = &fit.model.definition().doc;
    let title = if doc.is_empty() { name.to_string() } else { format!("{name}: {doc}") };
    let mut text = format!("{title}\n\n{}\n", fit_table(fit, arguments.intervals));
    if arguments.history {
        text.push_str(&format!("\n{}\n", history_table(&e.history)));
    }
    text.push_str(&confidence(fit));
    text.push_str(&way(fit));
    let cost = e.cost.map_or(String::new(), |c| format!(", cost {c:.9e}"));
    text.push_str(&format!("{} after {} corrections{cost}\n", e.termination, e.iterations));
    if fit.model.layout().states > 0 {
        for (run, a) in runs.iter().zip(&fit.integration).filter(|_| !e.runs.is_empty()) {
            let (steps, plural) = (a.per_interval, if a.per_interval == 1 { "" } else { "s" });
            text.push_str(&format!(
                "{}: {} samples, {steps} Runge-Kutta step{plural} between samples, integration error {:.0e} of the range\n",
                run.name,
                run.len(),
                a.error
            ));
        }
    }
    text
}

/// Every output of every run over time.
fn histories<'a>(fit: &Fit, runs: &'a [Run]) -> Vec<TimeHistory<'a>> {
    let definition = fit.model.definition();
    let q = definition.outputs.len();
    let mut histories = Vec::new();
    for (run, result) in runs.iter().zip(&fit.estimate.runs) {
        for (o, output) in definition.outputs.iter().enumerate() {
            let column = |values: &[f64]| values.iter().skip(o).step_by(q).copied().collect();
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
                measured: column(&run.measured),
                modelled: column(&result.response),
            });
        }
    }
    histories
}
