//! `fdm fit`: parameters, their standard errors and the quality of the match, from one or several runs, by any method.

use crate::answer::{Answer, NamedFile, Wanted};
use crate::checkpoint::Checkpoints;
use crate::conduct::Conduct;
use crate::failure::{Failure, OrFailure, SoFar, as_json};
use crate::first_cause::ask_doctor;
use crate::halt::TimeLimit;
use crate::load::{Estimated, ModelFile};
use crate::methods::{Methods, Question, given};
use crate::noise::MeasurementNoise;
use crate::options::{FrequencyDomain, Integration, Strategies};
use crate::outcome::{Outcome, names};
use crate::records::Records;
use crate::regress::UNDETERMINED;
use crate::session::Session;
use crate::tables::{course_tables, csv, histories, title};
use crate::verb::{Given, Verb, Visit, as_one_task};
use clap::Args;
use fdm_estimate::residuals::Baseline;
use fdm_estimate::{
    BestOptions, CheckpointStore, Domain, Estimate, FilterFit, Fit, FitOptions, Identified, IntegrationFault, Loss,
    Method, MultiStart, Noise, ResponseFit, SpectralFit, StartValues, Termination, best_iterate, changed, identify,
    start_search,
};
use fdm_lab::job;
use fdm_lab::study::StudyError;
use fdm_report::{
    Detail, TimeHistory, Words, baseline_table, confidence, fit_table, fit_verdict, fitted_response_columns,
    fitted_response_table, hidden_mode, history_table, overlays, prediction_table, regression_table, spectral_table,
    spectrum_columns, starts_hint, starts_table, way,
};
use fdm_results::documents::{FitDocument, RegressionDocument, ResultDocument, TimeDomain};
use fdm_results::store::Identity;
use fdm_system::Model;
use fdm_system::record::Run;
use num_complex::Complex64;
use serde::Serialize;
use std::path::PathBuf;

/// What a fit works with.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    model: ModelFile,
    #[command(flatten)]
    records: Records,
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
    limit: TimeLimit,
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
    checkpoints: Checkpoints,
}

/// A fit, and what is told of it.
pub struct Fitted {
    /// What the method found.
    pub found: Identified,
    /// What is told.
    pub answer: Answer,
}

/// Fits the model of a session to its runs: chooses the method, works, judges, tells, keeps.
///
/// # Errors
/// [`Failure`]; an iteration that went wrong is an answer that is not good.
pub fn answer(options: &Options, session: &Session, conduct: &mut Conduct) -> Result<Fitted, Failure> {
    let chosen = options.chosen(session)?;
    let checkpoint = conduct.checkpoint(&options.checkpoints, &chosen.identity)?;
    let found = work(options, &chosen, (session, checkpoint.keeper()), conduct)?;
    let told = options.told(&found, &chosen, session, conduct)?;
    let answer = kept(&found, &chosen, told, (session, conduct.wanted))?;
    let late = match answer.good {
        true => "the estimates have converged, but not all that comes after them is there",
        false => "the result is the best so far",
    };
    let answer = conduct.in_time(conduct.kept(answer, checkpoint), late);
    Ok(Fitted { found, answer })
}

fn work(
    options: &Options,
    chosen: &Chosen,
    (session, keeper): (&Session, Option<&dyn CheckpointStore>),
    conduct: &mut Conduct,
) -> Result<Identified, Failure> {
    let _writer = conduct.follow(session, Some(&options.checkpoints));
    conduct.progress.watching(options.watch);
    let work = conduct.progress.work().keeping(keeper);
    let found = identify(&session.model, &session.runs, &chosen.fit, &work);
    conduct.progress.finish();
    found.or_failure()
}

/// As it is printed and written.
fn kept(
    found: &Identified,
    chosen: &Chosen,
    told: Told,
    (session, wanted): (&Session, Wanted),
) -> Result<Answer, Failure> {
    let Chosen { fit, identity, .. } = chosen;
    let mut manifest = session.manifest(identity.clone(), fit.options.noise.clone(), wanted);
    manifest.seed = matches!(found, Identified::OutputError(_)).then_some(fit.starts.seed);
    let frequencies = frequencies(found);
    let outcome = Outcome {
        fit: found.in_time(),
        spectra: panels(found, &frequencies),
        tables: files(found, &session.runs),
        whole: told.whole,
        remarks: remarks_of(found, fit.starts.count),
        ..Outcome::new((found.model(), &session.runs), told.text, told.document, manifest)
    };
    let good = found.is_good() && found.is_complete(fit.starts.count);
    Ok(Answer { good, ..outcome.answer(wanted)? })
}

impl Verb for Options {
    fn given(&self) -> Given<'_> {
        Given { model: &self.model, records: &self.records, limit: &self.limit }
    }

    fn session(&self, conduct: &Conduct) -> Result<Session, Failure> {
        let question = self.question(conduct.wanted.plot)?;
        let model = self.model.load_for(&self.records)?;
        if question.method == Method::EquationError || question.domain == Domain::Frequency {
            self.records.refuse_begin(&model)?;
        }
        let session = match question.method {
            Method::EquationError => self.records.session(model, conduct.quiet),
            _ => self.records.session_with_validation(model, &self.validation, conduct.quiet),
        };
        self.limited(session?)
    }

    fn names(&self, session: &Session) -> Vec<String> {
        names(&session.model, &session.runs)
    }

    fn answer(&self, session: &Session, conduct: &mut Conduct) -> Result<Answer, Failure> {
        answer(self, session, conduct).map(|fitted| fitted.answer)
    }

    /// The starts where there are many, or the fit as one task.
    fn tasks(
        &self,
        session: &Session,
        conduct: &Conduct,
        _: &dyn CheckpointStore,
        visit: Visit<'_>,
    ) -> Result<(), Failure> {
        let Chosen { fit, identity, .. } = self.chosen(session)?;
        if fit.method == Method::EquationError {
            let said = "--method equation-error takes no longer than reading its records: `fdm fit` does it at once";
            return Err(Failure::input([said]));
        }
        if fit.method != Method::OutputError || fit.domain != Domain::Time || fit.starts.count < 2 {
            return as_one_task(self, session, conduct, &identity, visit);
        }
        let progress = conduct.aside();
        let search = start_search(&session.model, &session.runs, &fit, &progress.work()).or_failure()?;
        visit(&job::Starts(search), &identity)
    }
}

/// How a fit is made.
struct Chosen {
    fit: FitOptions,
    /// What is said in front of the result.
    said: String,
    /// What the bits of the result depend on.
    identity: Identity,
}

/// What is told of a fit.
struct Told {
    /// Tables and sentences.
    text: String,
    /// Tables and sentences with all remarks; none where nothing is left out.
    whole: Option<String>,
    document: ResultDocument,
}

impl Options {
    /// What is asked for; `plot` where a drawing is wanted.
    pub(crate) fn question(&self, plot: bool) -> Result<Question, Failure> {
        let own = given(&[
            ("--noise", self.noise.is_given()),
            ("--loss", !self.loss.is_squares()),
            ("--starts", self.starts > 1),
            ("--validation", !self.validation.is_empty()),
            ("--intervals", self.intervals),
            ("--history", self.history),
            ("--watch", self.watch),
            ("--plot", plot),
        ]);
        let strategies = self.strategies.given();
        let all = [own, strategies, self.checkpoints.given(), self.integration.given(), self.frequency.given()];
        self.methods.question(&all.concat())
    }

    /// With the deviations that samples below a limit want.
    ///
    /// # Errors
    /// [`Failure`]
    pub(crate) fn limited(&self, session: Session) -> Result<Session, Failure> {
        let question = self.question(false)?;
        match (question.method, question.domain) {
            (Method::OutputError, Domain::Time) => session.with_noise_of_censored(self.noise.words()),
            (method, domain) => session.refuse_censored(&format!("{method} in the {domain} domain")),
        }
    }

    /// With start values of these runs, where equation error is to give them.
    fn chosen(&self, session: &Session) -> Result<Chosen, Failure> {
        let question = self.question(false)?;
        let mut fit = FitOptions { censored: session.censored(), ..self.fit_options(question, &session.model)? };
        let simulated = fit.domain == Domain::Time && fit.method != Method::EquationError;
        let said = match self.methods.start() {
            Some(StartValues::EquationError) if simulated => start_at_best_iterate(session, &mut fit)?,
            _ => String::new(),
        };
        let identity = identity(&fit, session);
        Ok(Chosen { fit, said, identity })
    }

    fn fit_options(&self, question: Question, model: &Model) -> Result<FitOptions, Failure> {
        let Question { method, domain, .. } = question;
        // frequency responses have the errors that the coherence gives
        let unasked = matches!(method, Method::FrequencyResponse | Method::EquationError);
        let noise = if unasked { Noise::Diagonal } else { self.noise.of(model)? };
        let fit = FitOptions {
            method,
            domain,
            changes: self.model.changes(&self.estimated),
            options: self.methods.options(question, noise),
            loss: self.loss,
            starts: MultiStart { count: self.starts as usize, seed: self.seed },
            ..FitOptions::default()
        };
        Ok(match domain {
            Domain::Frequency => FitOptions { frequency: self.frequency.options(self.methods.start()), ..fit },
            Domain::Time => self.strategies.among(self.integration.among(fit)),
        })
    }

    fn told(&self, found: &Identified, chosen: &Chosen, session: &Session, conduct: &Conduct) -> Result<Told, Failure> {
        let (document, estimate) = match (document(found, &session.runs), found.estimate()) {
            (ResultDocument::Fit(document), Some(estimate)) => (document, estimate),
            (mut document, _) => {
                document.set_records(session.judged.clone());
                return Ok(Told { text: tables(found, Detail::default()), whole: None, document });
            }
        };
        let (mut document, progress) = (*document, &conduct.progress);
        let mut verdict = fit_verdict(&document);
        ask_doctor((found.model(), estimate, &session.runs), &mut document, &mut verdict, progress);
        let mut behind = String::new();
        if !session.validation.is_empty()
            && let Some(predicted) =
                found.predict(&session.validation, chosen.fit.options.noise.clone(), &progress.work()).or_failure()?
        {
            let baselines = predicted.baselines(&session.validation, 0.0);
            let (quality, baseline) = (prediction_table(&predicted.quality), baseline_table(&baselines));
            behind = format!("\nvalidation runs, not fitted\n{quality}\n{baseline}");
            let beaten = baselines.iter().filter_map(Baseline::beaten);
            beaten.for_each(|line| behind.push_str(&format!("{line}\n")));
            document.validation_runs = Some(TimeDomain::of(&predicted));
        }
        document.records.clone_from(&session.judged);
        let told = |verbose: bool| {
            let text = self.text((found, estimate), session, (&verdict, verbose));
            format!("{}{text}{behind}", chosen.said)
        };
        Ok(Told { text: told(false), whole: Some(told(true)), document: document.into() })
    }

    /// Tables and sentences.
    fn text(
        &self,
        (found, e): (&Identified, &Estimate),
        session: &Session,
        (verdict, verbose): (&str, bool),
    ) -> String {
        let words = Words::of(found.model().source());
        let detail = Detail { intervals: self.intervals, verbose, words };
        let mut text = format!("{}\n{verdict}\n\n{}\n", title(found.model()), tables(found, detail));
        if self.history {
            text.push_str(&format!("\n{}\n", history_table(&e.history)));
        }
        if let Identified::OutputError(fit) = found
            && !fit.starts.is_empty()
        {
            text.push_str(&starts_table(FitDocument::of(fit).starts(), self.starts as usize));
            text.push_str(&format!("{}\n", starts_hint(&fit.model.definition().params)));
        }
        if let Some(fit) = found.in_time().filter(|_| self.watch) {
            text.push_str(&format!("\n{}\n", overlays(&histories(fit, &session.runs))));
        }
        if let Identified::OutputError(fit) = found {
            let document = FitDocument::of(fit);
            text.push_str(&confidence(&document));
            text.push_str(&way(&document));
        }
        let cost = match found {
            Identified::FrequencyResponse(fit) => fit.cost().map(|c| format!(", average cost {c:.3}")),
            _ => e.cost.map(|c| format!(", cost {c:.9e}")),
        };
        let logarithm = e.log_likelihood.map(|l| format!(", log-likelihood {l:.6}"));
        let cost = cost.map(|cost| cost + &logarithm.unwrap_or_default());
        text.push_str(&format!("{} after {} iterations{}\n", e.termination, e.iterations, cost.unwrap_or_default()));
        text.push_str(&self.integrated((found, e), session, verbose));
        text
    }

    /// How each run was integrated, or the first ones.
    fn integrated(&self, (found, e): (&Identified, &Estimate), session: &Session, verbose: bool) -> String {
        let integrated = match found {
            Identified::OutputError(_) | Identified::FilterError(_) if !e.runs.is_empty() => {
                found.in_time().map_or(&[][..], |fit| &fit.integration)
            }
            _ => &[],
        };
        let all = session.runs.iter().zip(integrated).filter(|_| found.model().layout().states > 0);
        let mut text = String::new();
        for (run, accuracy) in all.clone().take(if verbose { session.runs.len() } else { RUNS }) {
            let scheme = self.integration.said(accuracy);
            text.push_str(&format!("{}: {} samples, {scheme}\n", run.name, run.len()));
        }
        let more = all.count().saturating_sub(RUNS);
        if more > 0 && !verbose {
            text.push_str(&format!("{more} more runs: --verbose\n"));
        }
        text
    }
}

/// Start values from recursive least squares, where none were typed; says which iterate they are.
fn start_at_best_iterate(session: &Session, options: &mut FitOptions) -> Result<String, Failure> {
    let model = changed(&session.model, &options.changes).or_failure()?;
    let found = best_iterate(&model, &session.runs, &BestOptions::default()).or_failure()?;
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

/// Tells a result of filter error from one of output error with the same options.
#[derive(Serialize)]
struct Filtered<'a> {
    filter_error: &'a FitOptions,
}

fn identity(fit: &FitOptions, session: &Session) -> Identity {
    let (model, runs) = (&session.model, &session.runs);
    match (fit.method, fit.domain) {
        (Method::FrequencyResponse, _) => Identity::of(model, runs, &fit.of_responses()),
        (Method::EquationError, _) => Identity::of(model, runs, &fit.of_regression()),
        (Method::FilterError, _) => Identity::of(model, runs, &Filtered { filter_error: fit }),
        (Method::OutputError, Domain::Frequency) => Identity::of(model, runs, &fit.of_spectra()),
        (Method::OutputError, Domain::Time) => Identity::of(model, runs, fit),
    }
}

fn document(found: &Identified, runs: &[Run]) -> ResultDocument {
    match found {
        Identified::OutputError(fit) => FitDocument::of(fit).into(),
        Identified::FilterError(fit) => FitDocument::of_filter(fit).into(),
        Identified::Spectra(fit) => FitDocument::of_spectra(fit).into(),
        Identified::FrequencyResponse(fit) => FitDocument::of_responses(fit).into(),
        Identified::EquationError { model, regression } => RegressionDocument::of(model, runs, regression).into(),
    }
}

fn tables(found: &Identified, detail: Detail) -> String {
    match found {
        Identified::OutputError(fit) => fit_table(&FitDocument::of(fit), detail),
        Identified::FilterError(fit) => fit_table(&FitDocument::of_filter(fit), detail),
        Identified::Spectra(fit) => spectral_table(fit, detail),
        Identified::FrequencyResponse(fit) => fitted_response_table(fit, detail),
        Identified::EquationError { regression, .. } => {
            // what is printed says nothing of residuals
            regression_table(&RegressionDocument::of(found.model(), &[], regression))
        }
    }
}

/// What is said behind a result.
fn remarks_of(found: &Identified, starts: usize) -> Vec<String> {
    let hidden = |e: &Estimate, unobservable: &[fdm_estimate::UnobservableMode]| {
        let hidden = unobservable.iter().filter(|_| e.termination.is_good()).map(|m| hidden_mode(found.model(), m));
        unsuccessful(e, false).into_iter().chain(hidden).collect()
    };
    match found {
        Identified::OutputError(fit) => remarks(fit, found.is_complete(starts)),
        Identified::FilterError(filter) => {
            let FilterFit { fit, .. } = &**filter;
            unsuccessful(&fit.estimate, has_moved(fit)).into_iter().chain(integration_remarks(fit)).collect()
        }
        Identified::Spectra(fit) => match &**fit {
            SpectralFit { unanswered: Some(why), .. } => vec![why.to_string()],
            SpectralFit { estimate, unobservable, .. } => hidden(estimate, unobservable),
        },
        Identified::FrequencyResponse(fit) => match &**fit {
            ResponseFit { unanswered: Some(why), .. } => vec![why.to_string()],
            ResponseFit { estimate, unobservable, .. } => hidden(estimate, unobservable),
        },
        Identified::EquationError { regression, .. } if regression.is_undetermined() => vec![UNDETERMINED.into()],
        Identified::EquationError { .. } => Vec::new(),
    }
}

/// The frequencies of every spectrum, in cycles per unit of time.
fn frequencies(found: &Identified) -> Vec<Vec<f64>> {
    let Identified::Spectra(fit) = found else { return Vec::new() };
    fit.spectra.iter().map(|s| s.omega.iter().map(|w| w / std::f64::consts::TAU).collect()).collect()
}

/// Measured and modelled spectra as pictures: their magnitudes over frequency.
fn panels<'a>(found: &Identified, frequencies: &'a [Vec<f64>]) -> Vec<TimeHistory<'a>> {
    let Identified::Spectra(fit) = found else { return Vec::new() };
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
fn files(found: &Identified, runs: &[Run]) -> Vec<NamedFile> {
    match found {
        Identified::EquationError { model, regression } => course_tables(model, runs, regression),
        Identified::Spectra(fit) => {
            let table = |run: usize| (format!("spectrum_{}.csv", run + 1), csv(&spectrum_columns(fit, run)));
            (0..fit.spectra.len()).map(table).collect()
        }
        Identified::FrequencyResponse(fit) => {
            let columns = |pair| {
                let columns = fitted_response_columns(pair).into_iter();
                columns.map(|(name, values)| (name.to_string(), None, values)).collect::<Vec<_>>()
            };
            let table = |(k, pair)| (format!("response_{}.csv", k + 1), csv(&columns(pair)));
            fit.pairs.iter().enumerate().map(table).collect()
        }
        _ => Vec::new(),
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

/// What went wrong, and a fit as far as it came, when the work that it was made for cannot go on from there.
pub(crate) fn astray(error: &StudyError, fit: &Fit, conduct: &Conduct) -> Failure {
    let document = FitDocument::of(fit);
    let (e, table) = (&fit.estimate, fit_table(&document, Detail::default()));
    let text = format!("{}\n\n{table}\n{} after {} iterations\n", title(&fit.model), e.termination, e.iterations);
    let json = conduct.wanted.json.then(|| as_json(&document).ok()).flatten();
    Failure::Astray { said: error.to_string(), so_far: SoFar { text, json, remarks: remarks(fit, true) } }
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
