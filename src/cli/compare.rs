//! `fdm compare`: several results side by side, and what they predict of runs that none was fitted to.

use crate::failure::{Failure, NUMBERS, print, remark};
use crate::progress::Progress;
use crate::reading::{Reading, open, were_fitted};
use crate::records::{Selection, load, notes};
use clap::Args;
use fdm::comparison::{Candidate, Comparison, Prediction, compare, predict};
use fdm::record::Run;
use fdm::report::{comparison_json, comparison_table};
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm compare` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Result folders that `fdm fit --out` wrote; the first is what the others are measured by
    #[arg(value_name = "RESULT", required = true, num_args = 2..)]
    results: Vec<PathBuf>,
    /// Run that none of them was fitted to; may be given several times
    #[arg(long = "data", value_name = "RUN", help_heading = "Data")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    selection: Selection,
    /// Print JSON instead of tables
    #[arg(long, help_heading = "Result")]
    json: bool,
    /// Say nothing while working
    #[arg(short, long, help_heading = "Result")]
    quiet: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let readings: Vec<Reading> =
        arguments.results.iter().map(|folder| open(folder, None)).collect::<Result<_, Failure>>()?;
    let mut comparison = compare(readings.iter().map(|r| Candidate::new(&r.folder)).collect());
    if !arguments.data.is_empty() {
        let predictions = predictions(arguments, &readings, &comparison)?;
        comparison = comparison.with_predictions(predictions);
    }
    let text = match arguments.json {
        true => format!("{}\n", comparison_json(&comparison)),
        false => comparison_table(&comparison),
    };
    let good = comparison.predictions.iter().all(|p| p.converged);
    Ok(if print(&text) && good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

fn predictions(
    arguments: &Arguments,
    readings: &[Reading],
    comparison: &Comparison,
) -> Result<Vec<Prediction>, Failure> {
    let mut progress = Progress::new(arguments.quiet);
    let mut predictions = Vec::new();
    for (k, (Reading { folder, model }, candidate)) in readings.iter().zip(&comparison.candidates).enumerate() {
        let records = load(&arguments.data, &arguments.selection.options(true), model)?;
        if !arguments.quiet && k == 0 {
            notes(&records);
        }
        let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
        for fitted in were_fitted(folder, &runs, &arguments.data) {
            remark(format_args!("note: {}: run `{fitted}` was part of the fit; it predicts nothing", candidate.name));
        }
        progress.say(&format!("predicting by {}", candidate.name));
        let name = &candidate.name;
        let found = predict(name, folder, model, &runs, &mut progress);
        predictions.push(found.map_err(|e| Failure::input([format!("{name}: {e}")]))?);
    }
    progress.finish();
    Ok(predictions)
}
