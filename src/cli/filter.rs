//! `fdm fit --method fe`: maximum likelihood with a Kalman filter, where noise enters the equations.

use crate::delivery::Outcome;
use crate::failure::{Failure, NUMBERS, none_ignored};
use crate::fit::{Arguments as Fit, UNDETERMINED, title};
use crate::integrator::integration;
use crate::progress::Progress;
use crate::records::notes;
use fdm::estimate::{FilterFit, fit_filter};
use fdm::record::Run;
use fdm::report::{filter_json, filter_table, history_table};
use fdm::simulate::Scheme;
use fdm::store::{Identity, Manifest};
use std::process::ExitCode;

/// Options that belong to a filter alone, so that an identity tells it from other fits of the same options.
#[derive(Debug)]
struct Filtered<'a> {
    #[expect(dead_code, reason = "printed")]
    filter_error: &'a fdm::estimate::FitOptions,
}

/// Fits predictions of a filter as the arguments of `fdm fit` say.
pub(crate) fn run(arguments: &Fit) -> Result<ExitCode, Failure> {
    let mut given = arguments.strategies.given();
    given.extend((arguments.starts > 1).then_some("--starts"));
    given.extend(arguments.keeping.is_asked().then_some("--checkpoint"));
    given.extend(arguments.choice.is_gained().then_some("--gain"));
    given.extend((arguments.integration.scheme() == Some(Scheme::Radau)).then_some("--integrator radau"));
    none_ignored("the filter-error method", &given, "output error")?;
    let mut progress = Progress::new(arguments.delivery.quiet);
    let model = arguments.subject.load()?;
    let records = arguments.records.load(&model, true)?;
    if !arguments.delivery.quiet {
        notes(&records);
    }
    let options = arguments.options(&model)?;
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let prepared = arguments.delivery.prepare()?;
    let (_live, _) = prepared.live(&model, None, &mut progress);
    let result = fit_filter(&model, &runs, &options, &mut progress);
    progress.finish();
    let found = result.map_err(|e| Failure::input([e]))?;
    let identity = Identity::of(&model, &runs, &Filtered { filter_error: &options });
    let mut manifest = Manifest::new(&model, identity, options.options.noise.clone());
    manifest.command = std::env::args().collect();
    if arguments.delivery.describes() {
        arguments.records.describe(&runs, &mut manifest);
    }
    let outcome = Outcome {
        model: &found.fit.model,
        fit: Some(&found.fit),
        runs: &runs,
        spectra: Vec::new(),
        tables: Vec::new(),
        text: text(&found, &runs, arguments),
        json: filter_json(&found),
        remarks: remarks(&found),
        manifest,
    };
    let delivered = prepared.deliver(outcome);
    Ok(if found.fit.estimate.is_good() && delivered { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

fn remarks(found: &FilterFit) -> Vec<String> {
    let estimate = &found.fit.estimate;
    match (estimate.termination.is_good(), estimate.is_good()) {
        (false, _) => vec![estimate.termination.to_string()],
        (true, false) => vec![UNDETERMINED.into()],
        _ => Vec::new(),
    }
}

fn text(found: &FilterFit, runs: &[Run], arguments: &Fit) -> String {
    let e = &found.fit.estimate;
    let mut text = format!("{}\n\n{}\n", title(&found.fit.model), filter_table(found, arguments.intervals));
    if arguments.history {
        text.push_str(&format!("\n{}\n", history_table(&e.history)));
    }
    let cost = e.cost.map_or(String::new(), |c| format!(", cost {c:.9e}"));
    text.push_str(&format!("{} after {} corrections{cost}\n", e.termination, e.iterations));
    for (run, accuracy) in runs.iter().zip(&found.fit.integration).filter(|_| !e.runs.is_empty()) {
        text.push_str(&format!("{}: {} samples, {}\n", run.name, run.len(), integration(accuracy, false)));
    }
    text
}
