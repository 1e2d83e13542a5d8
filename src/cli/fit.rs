//! `fdm fit`: parameters, their standard errors and the quality of the match, from one or several runs, by any method.

use crate::checkpoint::Checkpoints;
use crate::deliver::{Delivery, NamedFile, Outcome, Output, Rendered, csv, histories, title};
use crate::failure::{Ending, Failure, OrFailure, ended, remark};
use crate::first_cause::ask_doctor;
use crate::halt::TimeLimit;
use crate::load::{Estimated, MeasurementNoise, ModelFile, Records};
use crate::methods::{Domain, Method, Methods, Question, StartValues, given};
use crate::options::{FrequencyDomain, Integration, Strategies};
use crate::progress::Progress;
use crate::progress_file::Course;
use crate::regress::equation_error;
use crate::tasks::{Visit, WholeCommand};
use clap::Args;
use fdm_estimate::residuals::Baseline;
use fdm_estimate::{
    BestOptions, Changes, Estimate, FilterFit, Fit, FitOptions, Halt, IntegrationFault, Loss, MultiStart, Noise,
    ResponseFit, ResponseOptions, SpectralFit, SpectralOptions, Termination, Work, best_iterate, changed, fit,
    fit_filter, fit_responses, fit_spectra, start_search,
};
use fdm_lab::job;
use fdm_report::{
    Detail, TimeHistory, baseline_table, confidence, fit_table, fit_verdict, fitted_response_columns,
    fitted_response_table, hidden_mode, history_table, overlays, prediction_table, spectral_table, spectrum_columns,
    starts_hint, starts_table, way,
};
use fdm_results::documents::{FitDocument, JudgedRecords, TimeDomain};
use fdm_results::store::{Identity, Manifest};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::spectrum::Frequencies;
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// What `fdm fit` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) model: ModelFile,
    #[command(flatten)]
    pub(crate) records: Records,
    /// Validation data: a run that is predicted, not fitted
    ///
    /// May be given several times.
    #[arg(long, value_name = "RUN", help_heading = "Data")]
    validation: Vec<PathBuf>,
    #[command(flatten)]
    estimated: Estimated,
    #[command(flatten)]
    noise: MeasurementNoise,
    /// What is made of residuals: `squares`, or against outliers `huber` (1.345 deviations, or `huber:K`) and `student` (4 degrees of freedom, or `student:N`)
    #[arg(long, value_name = "LOSS", default_value = "squares", help_heading = "Estimation", hide_short_help = true)]
    loss: Loss,
    #[command(flatten)]
    methods: Methods,
    /// Fit from N starts and take the best
    ///
    /// The given one, and random ones between the bounds of the parameters or around their start values.
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Estimation",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    starts: u32,
    /// Seed of the random starts
    #[arg(
        long,
        value_name = "S",
        default_value_t = 0,
        allow_negative_numbers = true,
        help_heading = "Estimation",
        hide_short_help = true
    )]
    seed: u64,
    #[command(flatten)]
    strategies: Strategies,
    #[command(flatten)]
    frequency: FrequencyDomain,
    #[command(flatten)]
    integration: Integration,
    #[command(flatten)]
    pub(crate) limit: TimeLimit,
    /// Show the 95 % interval of each parameter
    #[arg(long, help_heading = "Result", hide_short_help = true)]
    intervals: bool,
    /// Show the iterations
    #[arg(long, help_heading = "Result", hide_short_help = true)]
    history: bool,
    /// Watch the cost fall, and see measurement and model in the terminal
    #[arg(long, help_heading = "Result", hide_short_help = true)]
    watch: bool,
    #[command(flatten)]
    pub(crate) checkpoints: Checkpoints,
    #[command(flatten)]
    delivery: Delivery,
}

impl Arguments {
    pub(crate) fn question(&self) -> Result<Question, Failure> {
        let own = given(&[
            ("--noise", self.noise.is_given()),
            ("--loss", !self.loss.is_squares()),
            ("--starts", self.starts > 1),
            ("--validation", !self.validation.is_empty()),
            ("--intervals", self.intervals),
            ("--history", self.history),
            ("--watch", self.watch),
            ("--plot", self.delivery.plot.is_some()),
        ]);
        let strategies = self.strategies.given();
        let all = [own, strategies, self.checkpoints.given(), self.integration.given(), self.frequency.given()];
        self.methods.question(&all.concat())
    }

    pub(crate) fn changes(&self) -> Changes {
        self.model.changes(&self.estimated)
    }

    pub(crate) fn frequencies(&self) -> Frequencies {
        self.frequency.spectra.frequencies()
    }

    pub(crate) fn options(&self, question: Question, model: &Model) -> Result<Chosen, Failure> {
        let changes = self.changes();
        // frequency responses have the errors that the coherence gives
        let noise =
            if question.method == Method::FrequencyResponse { Noise::Diagonal } else { self.noise.of(model)? };
        let options = self.methods.options(question, noise);
        Ok(match (question.method, question.domain) {
            (Method::FrequencyResponse, _) => Chosen::Responses(self.frequency.of_responses(changes, options)),
            (_, Domain::Frequency) => {
                Chosen::Spectra(self.frequency.of_spectra(changes, options, self.methods.start()))
            }
            (method, Domain::Time) => {
                let starts = MultiStart { count: self.starts as usize, seed: self.seed };
                let options = FitOptions { changes, options, starts, loss: self.loss, ..FitOptions::default() };
                let options = self.strategies.among(self.integration.among(options));
                if method == Method::FilterError { Chosen::Filter(options) } else { Chosen::Output(options) }
            }
        })
    }
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let question = arguments.question()?;
    let quiet = arguments.delivery.output.manner.quiet;
    if question.method == Method::EquationError {
        let asked = (&arguments.model, &arguments.estimated, &arguments.records);
        let frequencies = (question.domain == Domain::Frequency).then(|| arguments.frequencies());
        return equation_error(asked, &arguments.delivery, frequencies);
    }
    let mut progress = Progress::new(quiet).within(&arguments.limit).watching(arguments.watch);
    let model = arguments.model.load_for(&arguments.records)?;
    if question.method == Method::FrequencyResponse || question.domain == Domain::Frequency {
        arguments.records.refuse_begin(&model)?;
    }
    let (campaign, validation) = arguments.records.read_with_validation(&model, &arguments.validation, quiet)?;
    let runs = &campaign.runs[..];
    let options = arguments.options(question, &model)?;
    let task = Task::new(arguments, options, &model, runs)?;
    // places that cannot be written are told before the work
    let prepared = arguments.delivery.prepare(&model, runs)?;
    if let Some(whole) = arguments.checkpoints.done.as_deref().and_then(|done| job::Kind::whole(done)) {
        let Whole { good, rendered } = postcard::from_bytes(&whole).or_failure()?;
        return ended(prepared.hand_over(rendered) && good);
    }
    let checkpoint = arguments.checkpoints.open(&task.identity, quiet)?;
    let (_writer, _) = prepared.follow(&model, arguments.checkpoints.folder(), &mut progress);
    let result = task.work(&model, runs, &progress.work().keeping(checkpoint.keeper()));
    progress.finish();
    let made = task.made(result?, (runs, &validation), &progress)?.with_records(campaign.judged.clone());
    let manifest = made.manifest(prepared.manifest(&model, made.identity.clone(), made.noise.clone(), &campaign));
    let good = made.is_good();
    let frequencies = made.found.frequencies();
    let delivered = prepared.deliver(made.outcome(runs, &frequencies, manifest));
    let whole = checkpoint.close();
    // told in any case
    let in_time = match good {
        true => progress.in_time_or("the estimates have converged, but not all that comes after them is there"),
        false => progress.in_time(),
    };
    ended(in_time && good && delivered && whole)
}

/// A fit that was made elsewhere.
#[derive(Serialize, Deserialize)]
struct Whole {
    good: bool,
    rendered: Rendered,
}

impl Arguments {
    /// Makes ready what the tasks have in common, and shows them: the starts where there are many, or the fit as one task.
    pub(crate) fn tasks(&self, halt: &Halt, visit: Visit<'_>) -> Result<(), Failure> {
        let question = self.question()?;
        if question.method == Method::EquationError {
            let said = "--method equation-error takes no longer than reading its records: `fdm fit` does it at once";
            return Err(Failure::input([said]));
        }
        let model = self.model.load_for(&self.records)?;
        let (campaign, validation) = self.records.read_with_validation(&model, &self.validation, true)?;
        let runs = &campaign.runs[..];
        let options = self.options(question, &model)?;
        let task = Task::new(self, options, &model, runs)?;
        let progress = Progress::hidden(halt.clone(), Course::default());
        if let Chosen::Output(options) = &task.options
            && options.starts.count > 1
        {
            let search = start_search(&model, runs, options, &progress.work()).or_failure()?;
            return visit(&job::Starts(search), &task.identity);
        }
        let whole = |halt: &Halt| -> Result<Option<Vec<u8>>, Failure> {
            let progress = Progress::hidden(halt.clone(), Course::default());
            let task = Task::new(self, self.options(self.question()?, &model)?, &model, runs)?;
            let found = task.work(&model, runs, &progress.work())?;
            let made = task.made(found, (runs, &validation), &progress)?.with_records(campaign.judged.clone());
            if !halt.goes_on() {
                return Ok(None);
            }
            let places = &self.delivery.places;
            let manifest = places.manifest(&model, made.identity.clone(), made.noise.clone(), &campaign);
            let (manifest, frequencies) = (made.manifest(manifest), made.found.frequencies());
            let rendered = self.delivery.rendered(made.outcome(runs, &frequencies, manifest));
            postcard::to_allocvec(&Whole { good: made.is_good(), rendered }).or_failure().map(Some)
        };
        visit(&WholeCommand(&whole), &task.identity)
    }

    /// These arguments at the end of a job, or as a task of it.
    pub(crate) fn finishing(mut self, done: Option<Arc<job::Memory>>, typed: Vec<String>) -> Self {
        self.checkpoints.done = done;
        self.delivery.places.typed = Some(typed);
        self
    }
}

/// A fit that is asked for, by any method but equation error.
pub(crate) struct Task<'a> {
    arguments: &'a Arguments,
    options: Chosen,
    /// What is said in front of the result.
    text: String,
    /// What the bits of the result depend on.
    pub(crate) identity: Identity,
}

impl<'a> Task<'a> {
    /// With start values of these runs, where equation error is to give them.
    pub(crate) fn new(
        arguments: &'a Arguments,
        mut options: Chosen,
        model: &Model,
        runs: &[Run],
    ) -> Result<Self, Failure> {
        let text = match (&mut options, arguments.methods.start()) {
            (Chosen::Output(options) | Chosen::Filter(options), Some(StartValues::EquationError)) => {
                start_at_best_iterate(model, runs, options)?
            }
            _ => String::new(),
        };
        let identity = options.identity(model, runs);
        Ok(Self { arguments, options, text, identity })
    }

    pub(crate) fn work(&self, model: &Model, runs: &[Run], work: &Work<'_>) -> Result<Found, Failure> {
        self.options.fit(model, runs, work)
    }

    /// What is told of a fit to these runs, and of runs that took no part.
    pub(crate) fn made(
        self,
        found: Found,
        (runs, validation): (&[Run], &[Run]),
        progress: &Progress,
    ) -> Result<Made, Failure> {
        let mut document = found.document();
        let mut verdict = fit_verdict(&document);
        ask_doctor((found.model(), found.estimate(), runs), &mut document, &mut verdict, progress);
        let told = |verbose: bool| format!("{}{}", self.text, found.text(self.arguments, runs, (&verdict, verbose)));
        let (mut text, mut whole) = (told(self.arguments.delivery.output.manner.verbose), told(true));
        if let Some(predicted) = found.predicted(validation, self.options.noise(), progress)? {
            let mut said = format!("\nvalidation runs, not fitted\n{}", prediction_table(&predicted.quality));
            let baselines = predicted.baselines(validation, 0.0);
            said.push_str(&format!("\n{}", baseline_table(&baselines)));
            let beaten = baselines.iter().filter_map(Baseline::beaten);
            beaten.for_each(|line| said.push_str(&format!("{line}\n")));
            text.push_str(&said);
            whole.push_str(&said);
            document.validation_runs = Some(TimeDomain::of(&predicted));
        }
        let seed = matches!(self.options, Chosen::Output(_)).then_some(self.arguments.seed);
        let (starts, noise) = (self.arguments.starts as usize, self.options.noise());
        Ok(Made { found, text, whole, document, starts, seed, noise, identity: self.identity })
    }
}

/// A fit that was made.
pub(crate) struct Made {
    pub(crate) found: Found,
    /// Tables and sentences.
    pub(crate) text: String,
    /// Tables and sentences with all remarks.
    whole: String,
    /// The fit for programs.
    document: FitDocument,
    starts: usize,
    seed: Option<u64>,
    pub(crate) noise: Noise,
    pub(crate) identity: Identity,
}

impl Made {
    pub(crate) fn is_good(&self) -> bool {
        self.found.is_good(self.starts)
    }

    /// With what was assumed about the records and found in them.
    pub(crate) fn with_records(mut self, records: Option<JudgedRecords>) -> Self {
        self.document.records = records;
        self
    }

    /// With what the fit says of what it was made from.
    pub(crate) fn manifest(&self, mut manifest: Manifest) -> Manifest {
        manifest.seed = self.seed;
        manifest
    }

    /// What is printed and written of it.
    pub(crate) fn outcome<'a>(
        &'a self,
        runs: &'a [Run],
        frequencies: &'a [Vec<f64>],
        manifest: Manifest,
    ) -> Outcome<'a> {
        Outcome {
            model: self.found.model(),
            fit: self.found.in_time(),
            runs,
            spectra: self.found.panels(frequencies),
            tables: self.found.tables(),
            bands: Vec::new(),
            text: self.text.clone(),
            whole: Some(self.whole.clone()),
            json: self.document.clone().into(),
            remarks: self.found.remarks(self.starts),
            manifest,
        }
    }
}

/// Start values from recursive least squares, where none were typed; says which iterate they are.
fn start_at_best_iterate(model: &Model, runs: &[Run], options: &mut FitOptions) -> Result<String, Failure> {
    let model = changed(model, &options.changes).or_failure()?;
    let found = best_iterate(&model, runs, &BestOptions::default()).or_failure()?;
    let params = &found.model.definition().params;
    for parameter in &found.recursion.parameters {
        let value = params.iter().find(|p| p.quantity.name == parameter.name).map(|p| p.value);
        let typed = options.changes.set.iter().any(|(name, _)| *name == parameter.name);
        options.changes.set.extend(value.filter(|_| !typed).map(|v| (parameter.name.clone(), v)));
    }
    let (count, best) = (found.recursion.iterates.len(), found.best + 1);
    Ok(format!(
        "start values: iterate {best} of {count} of recursive least squares (`fdm regress --recursive` shows them)\n\n"
    ))
}

/// Runs whose integration is told where not all is.
const RUNS: usize = 3;

/// The options of the method that was chosen.
pub(crate) enum Chosen {
    Output(FitOptions),
    Filter(FitOptions),
    Spectra(SpectralOptions),
    Responses(ResponseOptions),
}

/// Tells a result of filter error from one of output error with the same options.
#[derive(Serialize)]
struct Filtered<'a> {
    filter_error: &'a FitOptions,
}

impl Chosen {
    fn identity(&self, model: &Model, runs: &[Run]) -> Identity {
        match self {
            Self::Output(options) => Identity::of(model, runs, options),
            Self::Filter(options) => Identity::of(model, runs, &Filtered { filter_error: options }),
            Self::Spectra(options) => Identity::of(model, runs, options),
            Self::Responses(options) => Identity::of(model, runs, options),
        }
    }

    fn noise(&self) -> Noise {
        match self {
            Self::Output(options) | Self::Filter(options) => options.options.noise.clone(),
            Self::Spectra(options) => options.options.noise.clone(),
            Self::Responses(_) => Noise::Diagonal,
        }
    }

    fn fit(&self, model: &Model, runs: &[Run], work: &Work<'_>) -> Result<Found, Failure> {
        match self {
            Self::Output(options) => fit(model, runs, options, work).or_failure().map(Found::Output),
            Self::Filter(options) => fit_filter(model, runs, options, work).or_failure().map(Found::Filter),
            Self::Spectra(options) => fit_spectra(model, runs, options, work).or_failure().map(Found::Spectra),
            Self::Responses(options) => fit_responses(model, runs, options, work).or_failure().map(Found::Responses),
        }
    }
}

/// What the method found.
pub(crate) enum Found {
    Output(Fit),
    Filter(FilterFit),
    Spectra(SpectralFit),
    Responses(ResponseFit),
}

impl Found {
    pub(crate) fn model(&self) -> &Model {
        match self {
            Self::Output(fit) | Self::Filter(FilterFit { fit, .. }) => &fit.model,
            Self::Spectra(fit) => &fit.model,
            Self::Responses(fit) => &fit.model,
        }
    }

    pub(crate) fn estimate(&self) -> &Estimate {
        match self {
            Self::Output(fit) | Self::Filter(FilterFit { fit, .. }) => &fit.estimate,
            Self::Spectra(fit) => &fit.estimate,
            Self::Responses(fit) => &fit.estimate,
        }
    }

    /// The fit in the time domain; results of the frequency domain are simulated where that is possible.
    pub(crate) fn in_time(&self) -> Option<&Fit> {
        match self {
            Self::Output(fit) | Self::Filter(FilterFit { fit, .. }) => Some(fit),
            Self::Spectra(fit) => fit.finish.as_ref(),
            Self::Responses(fit) => fit.finish.as_ref(),
        }
    }

    /// Whether all starts have ended.
    fn is_complete(&self, starts: usize) -> bool {
        !matches!(self, Self::Output(fit) if !fit.starts.is_empty() && fit.starts.len() != starts)
    }

    fn is_good(&self, starts: usize) -> bool {
        match self {
            Self::Output(fit) | Self::Filter(FilterFit { fit, .. }) => fit.is_good() && self.is_complete(starts),
            Self::Spectra(fit) => fit.is_good(),
            Self::Responses(fit) => fit.is_good(),
        }
    }

    fn document(&self) -> FitDocument {
        match self {
            Self::Output(fit) => FitDocument::of(fit),
            Self::Filter(fit) => FitDocument::of_filter(fit),
            Self::Spectra(fit) => FitDocument::of_spectra(fit),
            Self::Responses(fit) => FitDocument::of_responses(fit),
        }
    }

    /// What the result predicts of runs that were not fitted.
    fn predicted(&self, runs: &[Run], noise: Noise, progress: &Progress) -> Result<Option<Fit>, Failure> {
        match self {
            Self::Output(fit) | Self::Filter(FilterFit { fit, .. })
                if !runs.is_empty() && fit.estimate.termination.is_good() =>
            {
                fit.predict(runs, noise, &progress.work()).or_failure().map(Some)
            }
            Self::Spectra(fit) if !runs.is_empty() && fit.estimate.termination.is_good() => {
                fit.predict(runs, &progress.work()).or_failure().map(Some)
            }
            Self::Responses(fit) if !runs.is_empty() && fit.is_good() => {
                fit.predict(runs, &progress.work()).or_failure().map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Tables and sentences.
    fn text(&self, arguments: &Arguments, runs: &[Run], (verdict, verbose): (&str, bool)) -> String {
        let e = self.estimate();
        let detail = Detail { intervals: arguments.intervals, verbose };
        let tables = match self {
            Self::Output(fit) => fit_table(&FitDocument::of(fit), detail),
            Self::Filter(fit) => fit_table(&FitDocument::of_filter(fit), detail),
            Self::Spectra(fit) => spectral_table(fit, detail),
            Self::Responses(fit) => fitted_response_table(fit, detail),
        };
        let mut text = format!("{}\n{verdict}\n\n{tables}\n", title(self.model()));
        if arguments.history {
            text.push_str(&format!("\n{}\n", history_table(&e.history)));
        }
        if let Self::Output(fit) = self
            && !fit.starts.is_empty()
        {
            text.push_str(&starts_table(FitDocument::of(fit).starts(), arguments.starts as usize));
            text.push_str(&format!("{}\n", starts_hint(&fit.model.definition().params)));
        }
        if let Some(fit) = self.in_time().filter(|_| arguments.watch) {
            text.push_str(&format!("\n{}\n", overlays(&histories(fit, runs))));
        }
        if let Self::Output(fit) = self {
            let document = FitDocument::of(fit);
            text.push_str(&confidence(&document));
            text.push_str(&way(&document));
        }
        let cost = match self {
            Self::Responses(fit) => fit.cost().map(|c| format!(", average cost {c:.3}")),
            _ => e.cost.map(|c| format!(", cost {c:.9e}")),
        };
        let logarithm = e.log_likelihood.map(|l| format!(", log-likelihood {l:.6}"));
        let cost = cost.map(|cost| cost + &logarithm.unwrap_or_default());
        text.push_str(&format!("{} after {} iterations{}\n", e.termination, e.iterations, cost.unwrap_or_default()));
        let integrated = match self {
            Self::Output(fit) | Self::Filter(FilterFit { fit, .. }) if !e.runs.is_empty() => &fit.integration[..],
            _ => &[],
        };
        let all = runs.iter().zip(integrated).filter(|_| self.model().layout().states > 0);
        for (run, accuracy) in all.clone().take(if verbose { runs.len() } else { RUNS }) {
            let scheme = arguments.integration.said(accuracy);
            text.push_str(&format!("{}: {} samples, {scheme}\n", run.name, run.len()));
        }
        let more = all.count().saturating_sub(RUNS);
        if more > 0 && !verbose {
            text.push_str(&format!("{more} more runs: --verbose\n"));
        }
        text
    }

    fn remarks(&self, starts: usize) -> Vec<String> {
        match self {
            Self::Output(fit) => remarks(fit, self.is_complete(starts)),
            Self::Filter(FilterFit { fit, .. }) => {
                unsuccessful(&fit.estimate, has_moved(fit)).into_iter().chain(integration_remarks(fit)).collect()
            }
            Self::Spectra(SpectralFit { unanswered: Some(why), .. })
            | Self::Responses(ResponseFit { unanswered: Some(why), .. }) => vec![why.to_string()],
            Self::Spectra(SpectralFit { unobservable, .. }) | Self::Responses(ResponseFit { unobservable, .. }) => {
                let e = self.estimate();
                let hidden =
                    unobservable.iter().filter(|_| e.termination.is_good()).map(|m| hidden_mode(self.model(), m));
                unsuccessful(e, false).into_iter().chain(hidden).collect()
            }
        }
    }

    /// The frequencies of every spectrum, in cycles per unit of time.
    pub(crate) fn frequencies(&self) -> Vec<Vec<f64>> {
        let Self::Spectra(fit) = self else { return Vec::new() };
        fit.spectra.iter().map(|s| s.omega.iter().map(|w| w / std::f64::consts::TAU).collect()).collect()
    }

    /// Measured and modelled spectra as pictures: their magnitudes over frequency.
    fn panels<'a>(&self, frequencies: &'a [Vec<f64>]) -> Vec<TimeHistory<'a>> {
        let Self::Spectra(fit) = self else { return Vec::new() };
        let definition = fit.model.definition();
        let mut panels = Vec::new();
        for (spectrum, time) in fit.spectra.iter().zip(frequencies) {
            for (o, output) in definition.outputs.iter().enumerate() {
                let (name, count) = (&output.quantity.name, time.len());
                let unit = output.quantity.unit.as_ref().map_or(String::new(), ToString::to_string);
                let size = |plane: &[Complex64]| plane[o * count..(o + 1) * count].iter().map(|v| v.norm()).collect();
                panels.push(TimeHistory {
                    title: format!("{}: spectrum of {name} in {}", fit.model.name(), spectrum.run),
                    time_label: format!("cycles per {}", definition.time),
                    value_label: format!("|{name}| [{unit}]"),
                    time,
                    measured: size(&spectrum.measured),
                    modelled: size(&spectrum.modelled),
                });
            }
        }
        panels
    }

    /// The spectra of every run, or the response of every pair, as tables.
    fn tables(&self) -> Vec<NamedFile> {
        match self {
            Self::Output(_) | Self::Filter(_) => Vec::new(),
            Self::Spectra(fit) => {
                let table = |run: usize| (format!("spectrum_{}.csv", run + 1), csv(&spectrum_columns(fit, run)));
                (0..fit.spectra.len()).map(table).collect()
            }
            Self::Responses(fit) => {
                let columns = |pair| {
                    let columns = fitted_response_columns(pair).into_iter();
                    columns.map(|(name, values)| (name.to_string(), None, values)).collect::<Vec<_>>()
                };
                let table = |(k, pair)| (format!("response_{}.csv", k + 1), csv(&columns(pair)));
                fit.pairs.iter().enumerate().map(table).collect()
            }
        }
    }
}

/// Why an estimate is not good; `moved` where something else has moved the values before its iteration.
fn unsuccessful(estimate: &Estimate, moved: bool) -> Option<String> {
    if estimate.termination == Termination::Interrupted {
        return Some(match estimate.iterations {
            0 if !moved => {
                "interrupted before the first iteration: the values are the start values, and their errors mean nothing"
                    .into()
            }
            _ => "interrupted: the values are the best so far, not a minimum, and their errors hold only at one".into(),
        });
    }
    if !estimate.termination.is_good() {
        return Some(estimate.termination.to_string());
    }
    if let Some(why) = estimate.degenerate.first() {
        return Some(why.to_string());
    }
    (!estimate.is_good()).then(|| {
        "the data do not determine every parameter: fix some of those named above, or add runs that excite them".into()
    })
}

/// Whether the values come from shorter records, segments, measured states or other starts.
fn has_moved(fit: &Fit) -> bool {
    let strategies =
        [fit.fallback.is_some(), fit.shooting.is_some(), !fit.substituted.is_empty(), !fit.starts.is_empty()];
    strategies.contains(&true) || fit.by_length.len() > 1
}

/// Prints a fit as far as it came, when the work that it was made for cannot go on from there.
pub(crate) fn print_so_far(fit: &Fit, output: &Output) -> Ending {
    let e = &fit.estimate;
    let table = || {
        let table = fit_table(&FitDocument::of(fit), Detail::default());
        format!("{}\n\n{table}\n{} after {} iterations\n", title(&fit.model), e.termination, e.iterations)
    };
    output.print(table, || FitDocument::of(fit))?;
    remarks(fit, true).iter().for_each(|r| remark(format_args!("{r}")));
    ended(false)
}

/// What is said behind a result of output error; `complete` when all starts have ended.
pub(crate) fn remarks(fit: &Fit, complete: bool) -> Vec<String> {
    let mut remarks: Vec<String> = unsuccessful(&fit.estimate, has_moved(fit)).into_iter().collect();
    remarks.extend(integration_remarks(fit));
    if fit.model.definition().states.iter().any(|s| s.noise.is_some()) {
        remarks.push("the model's process noise was left out: `--method filter-error` takes it into account".into());
    }
    if !complete {
        remarks.push("interrupted: the result is the best of the starts that had ended".into());
    }
    remarks
}

/// What is said about integration errors that are not to be passed over.
pub(crate) fn integration_remarks(fit: &Fit) -> Vec<String> {
    let advice = |fault: &IntegrationFault| match fault.chosen {
        true => {
            "choosing steps and fitting again has not ended; bound the parameters that went far, or take more steps (--steps)"
        }
        false => "take more steps (--steps), another method (--integrator), or leave both to be chosen",
    };
    let said = |fault: &IntegrationFault| match fault.is_severe() {
        true => format!("{fault}: the estimates are those of the steps, not of the model; {}", advice(fault)),
        false => format!("note: {fault}"),
    };
    // one line for an output, of the run where it is worst
    let mut told: Vec<(&IntegrationFault, usize)> = Vec::new();
    for fault in &fit.integration_faults {
        let same = |other: &IntegrationFault| {
            other.output == fault.output
                && other.is_severe() == fault.is_severe()
                && other.part.is_infinite() == fault.part.is_infinite()
        };
        match told.iter_mut().find(|(other, _)| same(other)) {
            Some((worst, count)) => {
                *count += 1;
                *worst = if fault.part > worst.part { fault } else { worst };
            }
            None => told.push((fault, 1)),
        }
    }
    let summed = |(fault, count): (&IntegrationFault, usize)| match count {
        1 => said(fault),
        _ => format!("{} (the worst of {count} runs)", said(fault)),
    };
    told.into_iter().map(summed).collect()
}
