//! `fdm compare`: several results side by side, and what they predict of validation runs.

use crate::bands::of_validation;
use crate::campaign::{RecordFile, Role};
use crate::deliver::{Output, write};
use crate::effects::Effects;
use crate::failure::{Ending, Failure, ended, remark};
use crate::front::Diagnosed;
use crate::load::{RunList, Selection, fitted_before, open_result, read_runs};
use crate::progress::Progress;
use clap::Args;
use fdm_report::comparison_table;
use fdm_report::page::comparison_page;
use fdm_results::comparison::{Candidate, Comparison, Prediction, compare, predict};
use fdm_results::store::ResultFolder;
use fdm_system::Model;
use std::path::PathBuf;

/// What `fdm compare` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Result folders that `fdm fit --out` wrote; the first is the reference for the others. A folder of `fdm diagnose --out` gives its best models, each refitted
    #[arg(value_name = "RESULT", required = true, num_args = 1..)]
    results: Vec<PathBuf>,
    /// Validation data: runs that none of them was fitted to, or patterns; may be given several times
    #[arg(long = "data", value_name = "RUN", help_heading = "Data", num_args = 1.., group = "recorded")]
    data: Vec<PathBuf>,
    #[command(flatten)]
    list: RunList,
    #[command(flatten)]
    selection: Selection,
    #[command(flatten)]
    effects: Effects,
    #[command(flatten)]
    output: Output,
    /// Write one page for a browser: criteria, parameters beside each other and averaged, predictions
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    report: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let progress = Progress::new(arguments.output.manner.quiet);
    let (mut results, mut held) = (Vec::new(), Vec::new());
    for folder in &arguments.results {
        match Diagnosed::open(folder)? {
            Some(found) => {
                results.extend(found.results(&arguments.effects, &progress)?);
                held.extend(found.files(Role::Validation)?);
            }
            None => results.push(open_result(folder, None)?),
        }
    }
    progress.finish();
    if results.len() < 2 {
        return Err(Failure::input([
            "nothing to compare: give two results or more, or a diagnosis (`fdm diagnose --out`) with several best models",
        ]));
    }
    let mut comparison = compare(results.iter().map(|(folder, _)| Candidate::new(folder)).collect());
    if !arguments.data.is_empty() || arguments.list.is_given() || !held.is_empty() {
        let predictions = predictions(arguments, (&results, &held), &comparison)?;
        comparison = comparison.with_predictions(predictions);
    }
    let printed = arguments.output.print(|| comparison_table(&comparison), || &comparison)?;
    let written = arguments.report.as_ref().map_or(Ok(()), |file| write(file, comparison_page(&comparison)));
    if let Err(e) = &written {
        remark(format_args!("error: {e}; the result is what is printed"));
    }
    ended(printed && written.is_ok() && comparison.predictions.iter().all(|p| p.converged))
}

fn predictions(
    arguments: &Arguments,
    (results, held): (&[(ResultFolder, Model)], &[RecordFile]),
    comparison: &Comparison,
) -> Result<Vec<Prediction>, Failure> {
    let progress = Progress::new(arguments.output.manner.quiet);
    let mut predictions = Vec::new();
    for (k, ((folder, model), candidate)) in results.iter().zip(&comparison.candidates).enumerate() {
        let quiet = arguments.output.manner.quiet || k > 0;
        let elsewhere = vec![true; model.layout().outputs];
        let options = arguments.selection.options(true);
        let mut files = match arguments.data.is_empty() && !arguments.list.is_given() {
            // the validation runs of the diagnosis
            true => held.to_vec(),
            false => arguments.list.files((&arguments.data, Role::Validation), &options, model)?,
        };
        if files.iter().any(|f| f.role == Role::Validation) {
            files.retain(|f| f.role == Role::Validation);
        }
        let runs = read_runs(&files, model, &elsewhere, quiet)?;
        for fitted in fitted_before(folder, &runs, &files) {
            remark(format_args!(
                "note: {}: run `{fitted}` was part of the fit: it is no validation data",
                candidate.name
            ));
        }
        progress.say(&format!("predicting with {}", candidate.name));
        let name = &candidate.name;
        let found = predict(name, folder, model, &runs, &progress.work());
        let (prediction, fit) = found.map_err(|e| Failure::input([format!("{name}: {e}")]))?;
        let bands: Vec<Option<Vec<f64>>> =
            of_validation(&fit, folder, &runs).into_iter().map(|b| b.ok().map(|b| b.measurement)).collect();
        predictions.push(prediction.with_bands(&bands));
    }
    progress.finish();
    Ok(predictions)
}
