//! `fdm study`: Monte Carlo study of a fit: bias and scatter of its estimates, coverage of their intervals.

use crate::answer::{Answer, NamedFile};
use crate::conduct::Conduct;
use crate::failure::{Failure, OrFailure, as_json};
use crate::fit::{astray, integration_remarks};
use crate::halt::TimeLimit;
use crate::load::{Estimated, ModelFile};
use crate::margins;
use crate::noise::MeasurementNoise;
use crate::options::{Integration, Repeats};
use crate::outcome::{Outcome, names};
use crate::progress::{Progress, RepeatProgress};
use crate::records::Records;
use crate::session::Session;
use crate::tables::title;
use crate::verb::{Given, Verb, Visit};
use clap::Args;
use fdm_estimate::{CheckpointStore, Fit, FitOptions, Halt, fit};
use fdm_lab::job;
use fdm_lab::posterior::{Calibration, Posterior, Ranks, SampleError, Sampling, calibrated, sample};
use fdm_lab::requirement::Draws;
use fdm_lab::study::{Bootstrap, Colour, FORM, Study, StudyError, series};
use fdm_numeric::parallel;
use fdm_report::page::calibration_page;
use fdm_report::{Detail, calibration_text, fit_table, repeat_columns, study_table};
use fdm_results::documents::FitDocument;
use fdm_results::documents::calibration::CalibrationDocument;
use fdm_results::store::Identity;
use fdm_system::Model;
use serde::Serialize;
use std::sync::Arc;

/// What a Monte Carlo study works with.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    model: ModelFile,
    #[command(flatten)]
    records: Records,
    #[command(flatten)]
    estimated: Estimated,
    #[command(flatten)]
    noise: MeasurementNoise,
    /// Number of repeats
    #[arg(long, value_name = "N", default_value_t = 1000, help_heading = "Repeats",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    repeats: u32,
    /// Simulation-based calibration of `fdm sample` instead: ranks of the truth among draws, conditional on the records
    #[arg(long, help_heading = "Repeats", hide_short_help = true)]
    calibration: bool,
    /// Transitions in which the step and the metric of each chain of a calibration are adapted
    #[arg(long, value_name = "N", default_value_t = 300, requires = "calibration", help_heading = "Repeats",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(20..=1_000_000), hide_short_help = true)]
    warmup: u32,
    /// Draws of the parameters in each repeat, by which it is seen where a requirement of the text is not linear in them; 0 for none
    #[arg(long, value_name = "N", default_value_t = 400, help_heading = "Repeats",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(0..=1_000_000), hide_short_help = true)]
    draws: u32,
    #[command(flatten)]
    repetition: Repeats,
    #[command(flatten)]
    integration: Integration,
    #[command(flatten)]
    limit: TimeLimit,
}

/// What decides the numbers of the repeats, but not how many there are.
#[derive(Serialize)]
struct Repeated<'a> {
    fit: &'a FitOptions,
    noise_colour: Colour,
    seed: u64,
    draws: u32,
    form: u8,
}

/// Names and values of columns.
pub type Columns = Vec<(String, Vec<f64>)>;

/// A study, and every repeat of it.
pub struct Studied {
    /// What is told.
    pub answer: Answer,
    /// The study.
    pub study: Study,
    /// Name and values of each column of `repeats.csv`.
    pub columns: Columns,
}

/// Fits the model of a session to its runs, then again and again to records that the fit makes with other noise.
///
/// # Errors
/// [`Failure`]; [`Failure::Astray`], where the fit cannot be repeated.
pub fn study(asked: &Options, session: &Session, conduct: &mut Conduct) -> Result<Studied, Failure> {
    let options = asked.chosen(&session.model)?;
    let identity = asked.identity(session, &options)?;
    let checkpoint = conduct.checkpoint(&asked.repetition.checkpoints, &identity)?;
    let _writer = conduct.follow(session, Some(&asked.repetition.checkpoints));
    let work = conduct.progress.work().keeping(checkpoint.keeper());
    let first = fit(&session.model, &session.runs, &options, &work);
    conduct.progress.finish();
    let first = first.or_failure()?;
    let bootstrap = match asked.bootstrap(&first, session, &options)? {
        Ok(bootstrap) => bootstrap,
        Err(e) if e.is_of_numbers() => return Err(astray(&e, &first, conduct)),
        Err(e) => return Err(Failure::input([e])),
    };
    let count = asked.repeats as usize;
    let mut watch = RepeatProgress::new("", count, conduct.quiet, conduct.progress.halt().clone());
    asked.tell_repeats(&mut watch, &bootstrap, session, &conduct.progress);
    let work = watch.work().keeping(checkpoint.keeper());
    let repeats = series(count, &work, &|k, repeat| watch.came(k, repeat), &|k| bootstrap.once(k, work.halt()));
    watch.finish();
    let study = bootstrap.study(&repeats);

    let columns = repeat_columns(bootstrap.subjects(), bootstrap.goals().unwrap_or_default(), &repeats);
    let mut manifest = session.manifest(identity, options.options.noise.clone(), conduct.wanted);
    manifest.seed = Some(asked.repetition.seed);
    let text = format!("{}\n\n{}", title(&first.model), study_table(&study));
    let json = FitDocument { study: Some(study.clone()), ..FitDocument::of(&first) };
    let outcome = Outcome {
        fit: Some(&first),
        tables: if conduct.wanted.files { files(&first, &study, &columns)? } else { Vec::new() },
        remarks: integration_remarks(&first),
        ..Outcome::new((&first.model, &session.runs), text, json.into(), manifest)
    };
    let answer = outcome.answer(conduct.wanted)?;
    let good = first.is_integrated() && study.is_whole() && study.converged > 0;
    let answer = conduct.kept(Answer { good, ..answer }, checkpoint);
    let answer = conduct.in_time(answer, "the result is the best so far");
    Ok(Studied { answer, study, columns })
}

impl Verb for Options {
    fn given(&self) -> Given<'_> {
        Given { model: &self.model, records: &self.records, limit: &self.limit }
    }

    fn session(&self, conduct: &Conduct) -> Result<Session, Failure> {
        let (wanted, kept) = (conduct.wanted, !self.repetition.checkpoints.given().is_empty());
        if self.calibration && (wanted.folder || wanted.plot || kept) {
            return Err(Failure::input([
                "--calibration has no folder, drawing or checkpoint; --report and --json keep it",
            ]));
        }
        let session = self.records.session(self.model.load_for(&self.records)?, conduct.quiet)?;
        session.refuse_censored("a study, which draws values for all samples,")
    }

    fn names(&self, session: &Session) -> Vec<String> {
        names(&session.model, &session.runs)
    }

    fn answer(&self, session: &Session, conduct: &mut Conduct) -> Result<Answer, Failure> {
        if self.calibration {
            return calibrate(self, session, conduct);
        }
        study(self, session, conduct).map(|studied| studied.answer)
    }

    /// The repeats; `states` keeps the fit that is repeated.
    fn tasks(
        &self,
        session: &Session,
        conduct: &Conduct,
        states: &dyn CheckpointStore,
        visit: Visit<'_>,
    ) -> Result<(), Failure> {
        if self.calibration {
            return Err(Failure::input(["--calibration is not cut into tasks; run it as one command"]));
        }
        let options = self.chosen(&session.model)?;
        let identity = self.identity(session, &options)?;
        let progress = conduct.aside();
        let work = progress.work().keeping(Some(states));
        let first = fit(&session.model, &session.runs, &options, &work).or_failure()?;
        let bootstrap = self.bootstrap(&first, session, &options)?.map_err(refused)?;
        let once = |k: u64, halt: &Halt| bootstrap.once(k, halt);
        visit(&job::Repeats { once: &once, count: self.repeats.into() }, &identity)
    }
}

/// Why there is no study.
pub(crate) fn refused(error: StudyError) -> Failure {
    if error.is_of_numbers() { Failure::Numbers(error.to_string()) } else { Failure::input([error]) }
}

/// Calibrates the sampler of the posterior of the runs of a session; its page is the file `page.html`.
///
/// # Errors
/// [`Failure`]
pub(crate) fn calibrate(asked: &Options, session: &Session, conduct: &mut Conduct) -> Result<Answer, Failure> {
    let options = asked.chosen(&session.model)?;
    let found = asked.calibrated(session, &options, &conduct.progress);
    conduct.progress.finish();
    // told in any case
    let in_time = conduct.progress.in_time();
    let found = found?;
    let mut answer = Answer::of(calibration_text(&found), &found, conduct.wanted)?;
    if conduct.wanted.files {
        answer.files.push(("page.html".into(), calibration_page(&found).into_bytes()));
    }
    Ok(Answer { good: in_time && found.is_good(), ..answer })
}

impl Options {
    /// Calibrates the sampler of the posterior of these runs.
    fn calibrated(
        &self,
        Session { model, runs, .. }: &Session,
        options: &FitOptions,
        progress: &Progress,
    ) -> Result<CalibrationDocument, Failure> {
        let first = fit(model, runs, options, &progress.work()).or_failure()?;
        if !first.estimate.termination.is_good() {
            let e = StudyError::Astray { reason: first.estimate.termination.to_string() };
            return Err(Failure::Numbers(e.to_string()));
        }
        let noise = options.clone().with_declared_noise(&first.model).options.noise;
        let posterior = Posterior::of_fit(&first, runs, &noise).or_failure()?;
        let (seed, warmup) = (self.repetition.seed, self.warmup as usize);
        let sampling = Sampling { chains: 4, draws: 1000, warmup, seed, target: 0.8, most_depth: 10 };
        let halt = progress.halt();
        progress.say("sampling the posterior");
        let refused = |e: SampleError| match e {
            SampleError::NotFinite => Failure::Numbers(e.to_string()),
            e => Failure::input([e]),
        };
        let samples = sample(&posterior, &sampling, halt).map_err(refused)?;
        if !samples.whole {
            return Err(Failure::Numbers("it was stopped before there were draws".into()));
        }
        progress.say("calibrating");
        let calibration = Calibration::new(&posterior, &samples, sampling);
        let once = |k: u64| if halt.goes_on() { calibration.once(k, halt) } else { Ok(None) };
        let repeats: Result<Vec<Option<Ranks>>, SampleError> =
            parallel::map(0..u64::from(self.repeats), once).into_iter().collect();
        Ok(calibrated(model.name(), seed, &samples.names, &repeats.map_err(refused)?))
    }

    /// Lets others read how far the repeats are, where somebody does.
    fn tell_repeats(&self, watch: &mut RepeatProgress, bootstrap: &Bootstrap, session: &Session, progress: &Progress) {
        let Some(course) = progress.course() else { return };
        let so_far = watch.remembering();
        let (name, subjects) = (session.model.name().to_string(), bootstrap.subjects().to_vec());
        let noise = (Some(bootstrap.colour()), self.repetition.seed);
        let mut course = course.lock();
        course.doing = "Monte Carlo repeats".into();
        course.repeats = Some(so_far.clone());
        course.more = Some(Arc::new(move || {
            let (repeats, left) = so_far.read();
            (Study::of(name.clone(), noise, &subjects, &repeats), left)
        }));
    }

    /// What the bits of the repeats depend on.
    fn identity(&self, session: &Session, fit: &FitOptions) -> Result<Identity, Failure> {
        let (noise_colour, seed, draws) = (self.colour()?, self.repetition.seed, self.draws);
        Ok(Identity::of(&session.model, &session.runs, &Repeated { fit, noise_colour, seed, draws, form: FORM }))
    }

    /// The fit, ready to be repeated.
    fn bootstrap(
        &self,
        first: &Fit,
        session: &Session,
        options: &FitOptions,
    ) -> Result<Result<Bootstrap, StudyError>, Failure> {
        let draws = Draws { count: self.draws as usize, seed: margins::SEED };
        let bootstrap = Bootstrap::new(first, &session.runs, options, (self.colour()?, self.repetition.seed));
        Ok(bootstrap.map(|b| b.judging(first, draws)))
    }

    fn chosen(&self, model: &Model) -> Result<FitOptions, Failure> {
        Ok(self.integration.plain(self.model.changes(&self.estimated), self.noise.of(model)?))
    }

    fn colour(&self) -> Result<Colour, Failure> {
        match self.repetition.noise_colour[..] {
            [] => Ok(Colour::default()),
            [colour] => Ok(colour),
            _ => Err(Failure::input(["--noise-colour: give one colour; repeat the command for another"])),
        }
    }
}

/// Files of a folder: the study, the fit that was repeated, and every repeat.
fn files(first: &Fit, study: &Study, columns: &[(String, Vec<f64>)]) -> Result<Vec<NamedFile>, Failure> {
    let cell = |v: f64| if v.is_nan() { String::new() } else { v.to_string() };
    let quoted = |name: &String| format!("\"{}\"", name.replace('"', "\"\""));
    let mut csv = columns.iter().map(|(name, _)| quoted(name)).collect::<Vec<_>>().join(",");
    for row in 0..columns.first().map_or(0, |(_, values)| values.len()) {
        csv.push('\n');
        csv.push_str(&columns.iter().map(|(_, values)| cell(values[row])).collect::<Vec<_>>().join(","));
    }
    csv.push('\n');
    Ok(vec![
        ("study.json".into(), as_json(study)?.into_bytes()),
        (
            "fit.txt".into(),
            fit_table(&FitDocument::of(first), Detail { verbose: true, ..Detail::default() }).into_bytes(),
        ),
        ("repeats.csv".into(), csv.into_bytes()),
    ])
}
