//! `fdm fit --method fr`: the same estimation on frequency responses.

use crate::delivery::Outcome;
use crate::failure::{Failure, NUMBERS};
use crate::fit::Arguments as Fit;
use crate::progress::Progress;
use crate::records::notes;
use crate::spectral::{UNDETERMINED, refuse_what_is_of_time};
use fdm::estimate::{Noise, ResponseFit, ResponseOptions, fit_responses};
use fdm::record::{Column, Dialect, Run, write_to};
use fdm::report::{
    fitted_response_columns, fitted_response_json, fitted_response_table, hidden_mode, history_table, prediction_table,
    time_json,
};
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
    if arguments.delivery.out.is_some() {
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
        remarks: remarks(&fit),
        manifest,
    };
    let delivered = prepared.deliver(outcome);
    Ok(if fit.is_good() && delivered { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

fn options(arguments: &Fit) -> ResponseOptions {
    let spectral = &arguments.spectral;
    let defaults = ResponseOptions::default();
    ResponseOptions {
        changes: arguments.subject.changes(&arguments.fix, &arguments.free),
        options: arguments.choice.options(Noise::Diagonal),
        frequencies: match spectral.band {
            Some(_) => spectral.frequencies(),
            None => Frequencies::Grid { lowest: None, highest: None },
        },
        segments: spectral.segments.clone(),
        pairs: spectral.pairs.clone(),
        coherence: spectral.coherence.unwrap_or(defaults.coherence),
        finish: true,
    }
}

fn text(fit: &ResponseFit, arguments: &Fit) -> String {
    let e = &fit.estimate;
    let doc = &fit.model.definition().doc;
    let title = if doc.is_empty() { fit.model.name().to_string() } else { format!("{}: {doc}", fit.model.name()) };
    let mut text = format!("{title}\n\n{}\n", fitted_response_table(fit, arguments.intervals));
    if arguments.history {
        text.push_str(&format!("\n{}\n", history_table(&e.history)));
    }
    let cost = fit.cost().map_or(String::new(), |c| format!(", average cost {c:.3}"));
    text.push_str(&format!("{} after {} corrections{cost}\n", e.termination, e.iterations));
    text
}

fn remarks(fit: &ResponseFit) -> Vec<String> {
    let termination = &fit.estimate.termination;
    if let Some(why) = &fit.unanswered {
        return vec![why.to_string()];
    }
    if !termination.is_good() {
        return vec![termination.to_string()];
    }
    let mut remarks = Vec::new();
    if !fit.estimate.is_good() {
        remarks.push(UNDETERMINED.into());
    }
    remarks.extend(fit.hidden.iter().map(|mode| hidden_mode(&fit.model, mode)));
    remarks
}

/// The response of every pair as a table.
fn tables(fit: &ResponseFit) -> Vec<(String, Vec<u8>)> {
    let table = |(k, pair)| {
        let columns = fitted_response_columns(pair);
        let columns: Vec<Column<'_>> =
            columns.iter().map(|(name, values)| Column { name, unit: None, values }).collect();
        let mut text = Vec::new();
        // memory takes everything that is written to it
        let _ = write_to(&mut text, Dialect::default(), &columns);
        (format!("response_{}.csv", k + 1), text)
    };
    fit.pairs.iter().enumerate().map(table).collect()
}
