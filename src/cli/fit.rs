//! `fdm fit`: parameters, their standard errors and the quality of the match, from one or several runs.

use crate::delivery::{Delivery, Outcome};
use crate::failure::{Failure, NUMBERS, none_ignored};
use crate::filter;
use crate::histories::histories;
use crate::integrator::{Integration, integration};
use crate::iteration::Choice;
use crate::keeping::Keeping;
use crate::noise::noise;
use crate::progress::Progress;
use crate::records::{Records, notes};
use crate::responses;
use crate::spectral::{self, Spectral};
use crate::strategies::Strategies;
use crate::subject::{Estimated, Subject};
use clap::Args;
use fdm::Model;
use fdm::estimate::{BestOptions, Fit, FitOptions, MultiStart, best_iterate, changed, fit_kept};
use fdm::record::Run;
use fdm::report::{confidence, fit_json, fit_table, history_table, overlays, starts_table, way};
use fdm::store::{Identity, Manifest};
use std::process::ExitCode;

/// What `fdm fit` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) subject: Subject,
    #[command(flatten)]
    pub(crate) records: Records,
    #[command(flatten)]
    pub(crate) estimated: Estimated,
    /// Measurement noise: `diagonal` (one variance per output, estimated), `full` (their covariance, estimated), or the known
    /// standard deviation of an output; where nothing is said, what the model declares is known and the rest estimated
    #[arg(long, value_name = "diagonal|full|OUTPUT=DEVIATION", help_heading = "Estimation")]
    pub(crate) noise: Vec<String>,
    #[command(flatten)]
    pub(crate) choice: Choice,
    /// Fit from so many starts and take the best: the given one, and others between the bounds of the parameters or around
    /// their start values
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Estimation",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(crate) starts: u32,
    /// Chooses the other starts; the same seed gives the same ones
    #[arg(long, value_name = "S", default_value_t = 0, allow_negative_numbers = true, help_heading = "Estimation")]
    seed: u64,
    #[command(flatten)]
    pub(crate) strategies: Strategies,
    #[command(flatten)]
    pub(crate) spectral: Spectral,
    #[command(flatten)]
    pub(crate) integration: Integration,
    /// Show the 95 % interval of each parameter
    #[arg(long, help_heading = "Result")]
    pub(crate) intervals: bool,
    /// Show the iteration, correction by correction
    #[arg(long, help_heading = "Result")]
    pub(crate) history: bool,
    /// Watch the cost fall, and see measurement and model in the terminal
    #[arg(long, help_heading = "Result")]
    watch: bool,
    #[command(flatten)]
    pub(crate) keeping: Keeping,
    #[command(flatten)]
    pub(crate) delivery: Delivery,
}

impl Arguments {
    pub(crate) fn options(&self, model: &Model) -> Result<FitOptions, Failure> {
        let options = FitOptions {
            changes: self.subject.changes(&self.estimated),
            options: self.choice.options(noise(&self.noise, model)?),
            per_interval: self.integration.per_interval(),
            scheme: self.integration.scheme(),
            starts: MultiStart { count: self.starts as usize, seed: self.seed },
            ..FitOptions::default()
        };
        Ok(self.strategies.among(options))
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if arguments.choice.is_spectral() {
        none_ignored("--method fd", &arguments.spectral.of_responses(), "--method fr")?;
        return spectral::run(arguments);
    }
    if arguments.choice.is_of_responses() {
        none_ignored("--method fr", &arguments.spectral.of_spectra(), "--method fd")?;
        return responses::run(arguments);
    }
    let others = [arguments.spectral.of_both(), arguments.spectral.of_spectra(), arguments.spectral.of_responses()];
    none_ignored("estimation in the time domain", &others.concat(), "the frequency domain (--method fd, --method fr)")?;
    if arguments.choice.is_of_a_filter() {
        return filter::run(arguments);
    }
    let mut progress = Progress::new(arguments.delivery.quiet).watching(arguments.watch);
    let model = arguments.subject.load()?;
    let records = arguments.records.load(&model, true)?;
    if !arguments.delivery.quiet {
        notes(&records);
    }
    let mut options = arguments.options(&model)?;
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let first = match arguments.choice.is_recursive() {
        true => begin_at_best_iterate(&model, &runs, &mut options)?,
        false => String::new(),
    };
    let identity = Identity::of(&model, &runs, &options);
    // places that cannot be written are told before the work
    let prepared = arguments.delivery.prepare()?;
    let kept = arguments.keeping.open(&identity, arguments.delivery.quiet)?;
    let (_live, _) = prepared.live(&model, arguments.keeping.folder(), &mut progress);
    let result = fit_kept(&model, &runs, &options, kept.keeper(), &mut progress);
    progress.finish();
    let fit = result.map_err(|e| Failure::input([e]))?;

    let mut manifest = Manifest::new(&model, identity, options.options.noise.clone());
    (manifest.command, manifest.seed) = (std::env::args().collect(), Some(arguments.seed));
    if arguments.delivery.describes() {
        arguments.records.describe(&runs, &mut manifest);
    }
    let all = fit.starts.is_empty() || fit.starts.len() == options.starts.count;
    let (text, json) = (format!("{first}{}", text(&fit, &runs, arguments)), fit_json(&fit));
    let (model, remarks) = (&fit.model, remarks(&fit, all));
    let (spectra, tables) = (Vec::new(), Vec::new());
    let outcome = Outcome { model, fit: Some(&fit), runs: &runs, spectra, tables, text, json, remarks, manifest };
    let delivered = prepared.deliver(outcome);
    let whole = kept.close();
    let good = fit.estimate.is_good() && all && delivered && whole;
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

/// Start values from recursive least squares, where none were typed; says which iterate they are.
fn begin_at_best_iterate(model: &Model, runs: &[Run], options: &mut FitOptions) -> Result<String, Failure> {
    let model = changed(model, &options.changes).map_err(|e| Failure::input([e]))?;
    let found = best_iterate(&model, runs, &BestOptions::default()).map_err(|e| Failure::input([e]))?;
    let params = &found.model.definition().params;
    for parameter in &found.recursion.parameters {
        let value = params.iter().find(|p| p.quantity.name == parameter.name).map(|p| p.value);
        let typed = options.changes.set.iter().any(|(name, _)| *name == parameter.name);
        options.changes.set.extend(value.filter(|_| !typed).map(|v| (parameter.name.clone(), v)));
    }
    let (count, best) = (found.recursion.iterates.len(), found.best + 1);
    Ok(format!(
        "begun at iterate {best} of {count} of recursive least squares (`fdm regress --method rls` shows them)\n\n"
    ))
}

/// What is said where parameters are not determined.
pub(crate) const UNDETERMINED: &str =
    "the data do not determine every parameter: fix some of what is named above, or add runs that move them";

/// What is said behind a result that is not good.
pub(crate) fn remarks(fit: &Fit, all: bool) -> Vec<String> {
    let termination = &fit.estimate.termination;
    let mut remarks = Vec::new();
    if !termination.is_good() {
        remarks.push(termination.to_string());
    } else if !fit.estimate.is_good() {
        remarks.push(UNDETERMINED.into());
    }
    if fit.model.definition().states.iter().any(|s| s.noise.is_some()) {
        remarks.push("the noise in the model's equations was left out: `--method fe` takes it into account".into());
    }
    if !all {
        remarks.push("interrupted: the result is the best of the starts that had ended".into());
    }
    remarks
}

/// Name and meaning of a model.
pub(crate) fn title(model: &Model) -> String {
    let (name, doc) = (model.name(), &model.definition().doc);
    if doc.is_empty() { name.to_string() } else { format!("{name}: {doc}") }
}

/// Tables and sentences of a fit.
fn text(fit: &Fit, runs: &[Run], arguments: &Arguments) -> String {
    let e = &fit.estimate;
    let mut text = format!("{}\n\n{}\n", title(&fit.model), fit_table(fit, arguments.intervals));
    if arguments.history {
        text.push_str(&format!("\n{}\n", history_table(&e.history)));
    }
    if !fit.starts.is_empty() {
        text.push_str(&format!("{}\n", starts_table(&fit.starts, arguments.starts as usize)));
    }
    if arguments.watch {
        text.push_str(&format!("\n{}\n", overlays(&histories(fit, runs))));
    }
    text.push_str(&confidence(fit));
    text.push_str(&way(fit));
    let cost = e.cost.map_or(String::new(), |c| format!(", cost {c:.9e}"));
    text.push_str(&format!("{} after {} corrections{cost}\n", e.termination, e.iterations));
    if fit.model.layout().states > 0 {
        for (run, a) in runs.iter().zip(&fit.integration).filter(|_| !e.runs.is_empty()) {
            let chosen = arguments.integration.is_open();
            text.push_str(&format!("{}: {} samples, {}\n", run.name, run.len(), integration(a, chosen)));
        }
    }
    text
}
