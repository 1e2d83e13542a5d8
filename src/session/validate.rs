//! `fdm validate`: a result against runs that it was not fitted to. What all runs share is held; biases and initial states are
//! estimated anew.

use crate::answer::Answer;
use crate::bands::{beyond_visited, of_coloured_noise, of_validation};
use crate::censored::predicted_below;
use crate::conduct::Conduct;
use crate::failure::{Failure, OrFailure};
use crate::fit::remarks;
use crate::halt::TimeLimit;
use crate::load::{fitted_before, open_result};
use crate::options::Integration;
use crate::outcome::Outcome;
use crate::records::Records;
use crate::session::Session;
use crate::value::positive;
use clap::Args;
use fdm_estimate::residuals::Baseline;
use fdm_estimate::{Fit, FitOptions, fit, fit_from_initial_conditions};
use fdm_infer::{LackOfFit, RunResidual, lack_of_fit};
use fdm_lab::posterior::Bands;
use fdm_report::{Detail, Words, band_verdict, estimate_text, fit_verdict, validation_text};
use fdm_results::documents::{BandCoverage, FitDocument, ResultDocument, Validation};
use fdm_results::store::{Identity, ResultFolder};
use fdm_system::record::{Run, Sampling};
use fdm_system::simulate::Accuracy;
use std::path::PathBuf;

/// What a validation works with.
#[derive(Debug, Args)]
pub struct Options {
    /// Model file (.fdm); the result holds its own, and this must be the same
    #[arg(value_name = "MODEL")]
    model: Option<PathBuf>,
    /// Result folder that `fdm fit --out` wrote
    #[arg(long, value_name = "DIR", help_heading = "Data")]
    from_result: PathBuf,
    #[command(flatten)]
    records: Records,
    /// Estimate what is a run's own from its first samples alone
    ///
    /// Free initial values and biases; the time is in the model's unit, and all behind it is predicted [default: from the whole run].
    #[arg(long, value_name = "TIME", value_parser = positive, allow_negative_numbers = true, help_heading = "Estimation")]
    initial_from: Option<f64>,
    #[command(flatten)]
    integration: Integration,
    /// How long it may work.
    #[command(flatten)]
    pub limit: TimeLimit,
}

impl Options {
    /// The result, and its model with the runs that are named.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn read(&self, quiet: bool) -> Result<(ResultFolder, Session), Failure> {
        let (folder, model) = open_result(&self.from_result, self.model.as_deref())?;
        Ok((folder, self.records.predicted(model, quiet)?))
    }
}

/// What a result predicts of the runs of a session.
///
/// # Errors
/// [`Failure`]
pub fn answer(
    asked: &Options,
    folder: &ResultFolder,
    session: &Session,
    conduct: &mut Conduct,
) -> Result<Answer, Failure> {
    let Session { model, runs, .. } = session;
    let censored = session.censored_with_noise();
    let options = FitOptions { censored, ..asked.integration.among(folder.validation(model)) };
    let _writer = conduct.follow(session, None);
    let work = conduct.progress.work();
    let result = match asked.initial_from {
        None => fit(model, runs, &options, &work),
        Some(length) => fit_from_initial_conditions(model, runs, length, &options, &work),
    };
    conduct.progress.finish();
    let fit = result.or_failure()?;
    let identity = Identity::of(&session.model, runs, &options);
    let manifest = session.manifest(identity, options.options.noise.clone(), conduct.wanted);
    let mut remarks = remarks(&fit, true);
    let fitted = fitted_before(folder, runs, &session.files());
    remarks.extend(fitted.iter().map(|run| format!("note: run `{run}` was part of the fit: it is no validation data")));
    remarks.extend(predicted_below(&fit, session));
    let errors = prediction_errors(&fit, runs, &mut remarks);
    let bands: Vec<Option<Bands>> = of_validation(&fit, folder, runs)
        .into_iter()
        .zip(runs)
        .map(|(bands, run)| bands.map_err(|e| remarks.push(format!("note: run `{}` has no bands: {e}", run.name))).ok())
        .collect();
    remarks.extend(
        bands.iter().flatten().next().and_then(|_| of_coloured_noise(folder)).map(|said| format!("note: {said}")),
    );
    remarks.extend(where_unvisited(&fit, folder, runs));
    let covered = covered(&fit, runs, &bands);
    let baselines = fit.baselines(runs, asked.initial_from.unwrap_or(0.0));
    remarks.extend(baselines.iter().filter_map(Baseline::beaten));
    let validation = Validation {
        of: folder.folder().display().to_string(),
        outputs: fit.quality.clone(),
        fitted_outputs: folder.quality().to_vec(),
        lack_of_fit: errors,
        bands: covered,
    };
    let document = FitDocument { validation: Some(validation.clone()), ..FitDocument::of(&fit) };
    let told = |verbose: bool| {
        let detail = Detail { verbose, words: Words::of(fit.model.source()), ..Detail::default() };
        text(&fit, &validation, &fit_verdict(&document), &baselines, detail)
    };
    let (brief, whole) = (told(false), Some(told(true)));
    let outcome = Outcome::new((&fit.model, runs), brief, document.into(), manifest);
    let outcome = Outcome { fit: Some(&fit), bands, whole, remarks, ..outcome };
    let answer = Answer { good: fit.is_good(), ..outcome.answer(conduct.wanted)? };
    Ok(conduct.in_time(answer, "the result is the best so far"))
}

/// Where the prediction uses what the fit does not know.
fn where_unvisited(fit: &Fit, folder: &ResultFolder, runs: &[Run]) -> Vec<String> {
    let found = ResultDocument::from(FitDocument::of(fit));
    let of = |(run, accuracy): (&Run, &Accuracy)| {
        beyond_visited(folder, &fit.model, (run, &found.theta(&fit.model, &run.name)), &accuracy.steps)
    };
    runs.iter().zip(&fit.integration).flat_map(of).map(|said| format!("note: {said}")).collect()
}

/// What the prediction gets wrong, of the runs that are sampled evenly.
fn prediction_errors(fit: &Fit, runs: &[Run], remarks: &mut Vec<String>) -> Vec<LackOfFit> {
    let mut even = Vec::new();
    for (run, result) in runs.iter().zip(&fit.estimate.runs) {
        match Sampling::new(&run.time).filter(Sampling::is_even) {
            Some(sampling) => even.push(RunResidual { run, residual: &result.residuals, interval: sampling.median }),
            None => remarks.push(format!(
                "note: run `{}` is not sampled evenly: its error is not shown by frequency and time",
                run.name
            )),
        }
    }
    lack_of_fit(&fit.model, &even)
}

/// How much of each output lies within its bands, and how wide these are.
fn covered(fit: &Fit, runs: &[Run], bands: &[Option<Bands>]) -> Vec<BandCoverage> {
    let outputs = &fit.model.definition().outputs;
    let q = outputs.len();
    let mut all = Vec::new();
    for ((run, result), bands) in runs.iter().zip(&fit.estimate.runs).zip(bands) {
        let Some(bands) = bands else { continue };
        for (o, output) in outputs.iter().enumerate().filter(|(o, _)| run.measures(*o)) {
            let mean = |values: &[f64]| {
                let own = || values.iter().skip(o).step_by(q).filter(|v| v.is_finite());
                let count = own().count();
                (count > 0).then(|| own().sum::<f64>() / count as f64)
            };
            all.push(BandCoverage {
                output: output.quantity.name.clone(),
                run: run.name.clone(),
                response: mean(&bands.response),
                measurement: mean(&bands.measurement),
                within: bands.covered(o, q, &result.residuals),
            });
        }
    }
    all
}

fn text(fit: &Fit, validation: &Validation, verdict: &str, baselines: &[Baseline], detail: Detail) -> String {
    let (e, time) = (&fit.estimate, fit.model.definition().time.to_string());
    let mut text = format!("{}: validation of the result in {}\n{verdict}\n", fit.model.name(), validation.of);
    band_verdict(&validation.bands).iter().for_each(|said| text.push_str(&format!("{said}\n")));
    text.push_str(&format!("\n{}\n", validation_text(validation, baselines, &time)));
    text.push_str(&format!("{}\n", estimate_text(e, detail)));
    text.push_str(&format!("{} after {} iterations\n", e.termination, e.iterations));
    text
}
