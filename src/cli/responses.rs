//! `fdm fit --method fr`: the same estimation on frequency responses.

use crate::delivery::Outcome;
use crate::failure::{Failure, NUMBERS};
use crate::fit::Arguments as Fit;
use crate::histories::as_file;
use crate::progress::Progress;
use crate::records::notes;
use crate::spectral::{refuse_what_is_of_time, remarks, told};
use fdm::estimate::{Noise, ResponseFit, ResponseOptions, fit_responses};
use fdm::record::Run;
use fdm::report::{fitted_response_columns, fitted_response_json, fitted_response_table, prediction_table, time_json};
use fdm::spectrum::Frequencies;
use fdm::store::{Identity, Manifest};
use std::process::ExitCode;

/// Fits frequency responses as the arguments of `fdm fit` say.
pub(crate) fn run(arguments: &Fit) -> Result<ExitCode, Failure> {
    refuse_what_is_of_time(arguments)?;
    let mut progress = Progress::new(arguments.delivery.quiet);
    let model = arguments.subject.load()?;
    if !arguments.noise.is_empty() {
        let said = "--noise has no part in --method fr: decibels and degrees have the errors that the coherence tells; leave it out";
        return Err(Failure::input([said]));
    }
    let records = arguments.records.load(&model, true)?;
    if !arguments.delivery.quiet {
        notes(&records);
    }
    let options = options(arguments);
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let held_out = arguments.spectral.held_out(arguments, &model)?;
    let prepared = arguments.delivery.prepare()?;
    let (_live, _) = prepared.live(&model, None, &mut progress);
    let result = fit_responses(&model, &runs, &options, &mut progress);
    progress.finish();
    let fit = result.map_err(|e| Failure::input([e]))?;

    let (mut text, mut json) = (text(&fit, arguments), fitted_response_json(&fit));
    if !held_out.is_empty() && fit.is_good() {
        let predicted = fit.predict(&held_out, &mut progress).map_err(|e| Failure::input([e]))?;
        text.push_str(&format!("\nruns that took no part\n{}", prediction_table(&predicted.quality)));
        json["holdout"] = time_json(&predicted);
    }
    let mut manifest = Manifest::new(&model, Identity::of(&model, &runs, &options), Noise::Diagonal);
    manifest.command = std::env::args().collect();
    if arguments.delivery.describes() {
        arguments.records.describe(&runs, &mut manifest);
    }
    let outcome = Outcome {
        model: &fit.model,
        fit: fit.finish.as_ref(),
        runs: &runs,
        spectra: Vec::new(),
        tables: tables(&fit),
        text,
        json,
        remarks: remarks(&fit.model, &fit.estimate, fit.unanswered.as_ref(), &fit.hidden),
        manifest,
    };
    let delivered = prepared.deliver(outcome);
    Ok(if fit.is_good() && delivered { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

fn options(arguments: &Fit) -> ResponseOptions {
    let spectral = &arguments.spectral;
    let defaults = ResponseOptions::default();
    ResponseOptions {
        changes: arguments.subject.changes(&arguments.estimated),
        options: arguments.choice.options(Noise::Diagonal),
        frequencies: match spectral.lines.band {
            Some(_) => spectral.lines.frequencies(),
            None => Frequencies::Grid { lowest: None, highest: None },
        },
        segments: spectral.segments.clone(),
        pairs: spectral.pairs.clone(),
        coherence: spectral.coherence.unwrap_or(defaults.coherence),
        finish: true,
    }
}

fn text(fit: &ResponseFit, arguments: &Fit) -> String {
    let cost = fit.cost().map_or(String::new(), |c| format!(", average cost {c:.3}"));
    told(&fit.model, &fit.estimate, fitted_response_table(fit, arguments.intervals), arguments.history, &cost)
}

/// The response of every pair as a table.
fn tables(fit: &ResponseFit) -> Vec<(String, Vec<u8>)> {
    let table = |(k, pair)| {
        let columns = fitted_response_columns(pair).into_iter().map(|(name, values)| (name.to_string(), None, values));
        (format!("response_{}.csv", k + 1), as_file(&columns.collect::<Vec<_>>()))
    };
    fit.pairs.iter().enumerate().map(table).collect()
}
