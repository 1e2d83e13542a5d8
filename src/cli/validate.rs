//! `fdm validate`: a result on runs that it was not fitted to. What all runs share is held; biases and initial states are
//! found anew.

use crate::delivery::{Delivery, Outcome};
use crate::failure::{Failure, NUMBERS};
use crate::fit::remarks;
use crate::integrator::Integration;
use crate::progress::Progress;
use crate::reading::{Reading, open, were_fitted};
use crate::records::{Records, notes};
use clap::Args;
use fdm::diagnose::misfit::{Left, Misfit, misfit};
use fdm::estimate::{Fit, FitOptions, fit};
use fdm::record::{Run, Sampling};
use fdm::report::{estimate_table, fit_json, validation_by_frequency, validation_by_time, validation_table};
use fdm::store::{Identity, Manifest, ResultFolder};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm validate` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Model file (.fdm); the result holds its own, and this must be the same
    #[arg(value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Result folder that `fdm fit --out` wrote
    #[arg(long, value_name = "DIR", help_heading = "Data")]
    from_result: PathBuf,
    #[command(flatten)]
    records: Records,
    #[command(flatten)]
    integration: Integration,
    #[command(flatten)]
    delivery: Delivery,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut progress = Progress::new(arguments.delivery.quiet);
    let Reading { folder, model } = open(&arguments.from_result, arguments.model.as_deref())?;
    let records = arguments.records.load(&model, true)?;
    if !arguments.delivery.quiet {
        notes(&records);
    }
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let (per_interval, scheme) = (arguments.integration.per_interval(), arguments.integration.scheme());
    let options = FitOptions { per_interval, scheme, ..folder.validation(&model) };
    let prepared = arguments.delivery.prepare()?;
    let (_live, _) = prepared.live(&model, None, &mut progress);
    let result = fit(&model, &runs, &options, &mut progress);
    progress.finish();
    let fit = result.map_err(|e| Failure::input([e]))?;

    let identity = Identity::of(&model, &runs, &options);
    let mut manifest = Manifest::new(&model, identity, options.options.noise.clone());
    manifest.command = std::env::args().collect();
    arguments.records.describe(&runs, &mut manifest);
    let mut remarks = own_remarks(&fit, &were_fitted(&folder, &runs, &arguments.records.data));
    let misfits = misfits(&fit, &runs, &mut remarks);
    let mut document = fit_json(&fit);
    document["validation"] = json!({
        "of": folder.folder().display().to_string(),
        "outputs": fit.quality,
        "fitted_outputs": folder.quality(),
        "misfit": misfits,
    });
    let outcome = Outcome {
        model: &fit.model,
        fit: Some(&fit),
        runs: &runs,
        spectra: Vec::new(),
        tables: Vec::new(),
        text: text(&fit, &folder, &misfits),
        json: document,
        remarks,
        manifest,
    };
    let delivered = prepared.deliver(outcome);
    Ok(if fit.estimate.is_good() && delivered { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

fn own_remarks(fit: &Fit, fitted: &[String]) -> Vec<String> {
    let mut found = remarks(fit, true);
    found.extend(fitted.iter().map(|run| format!("note: run `{run}` was part of the fit; it validates nothing")));
    found
}

/// What the prediction gets wrong, of the runs that are sampled evenly.
fn misfits(fit: &Fit, runs: &[Run], remarks: &mut Vec<String>) -> Vec<Misfit> {
    let mut left = Vec::new();
    for (run, result) in runs.iter().zip(&fit.estimate.runs) {
        match Sampling::new(&run.time).filter(Sampling::is_even) {
            Some(sampling) => left.push(Left { run, residual: &result.residuals, interval: sampling.median }),
            None => remarks.push(format!(
                "note: run `{}` is not sampled evenly: its error is not divided by frequency and time",
                run.name
            )),
        }
    }
    misfit(&fit.model, &left)
}

fn text(fit: &Fit, folder: &ResultFolder, misfits: &[Misfit]) -> String {
    let mut text = format!("{}: validation of the result in {}\n\n", fit.model.name(), folder.folder().display());
    text.push_str(&validation_table(&fit.quality, folder.quality()));
    if !misfits.is_empty() {
        let time = fit.model.definition().time.to_string();
        text.push_str(&format!("\n{}", validation_by_time(misfits, &time)));
        text.push_str(&format!("\n{}\n", validation_by_frequency(misfits, &time)));
        misfits.iter().flat_map(|m| &m.sentences).for_each(|sentence| text.push_str(&format!("{sentence}\n")));
    }
    text.push_str(&format!("\n{}\n", estimate_table(&fit.estimate)));
    text.push_str(&format!("{} after {} corrections\n", fit.estimate.termination, fit.estimate.iterations));
    text
}
