//! `fdm study`: Monte Carlo study of a fit: bias and scatter of its estimates, coverage of their intervals.

use crate::deliver::{Delivery, NamedFile, Outcome, title, write};
use crate::failure::{Ending, Failure, OrFailure, as_json, ended, remark};
use crate::fit::{integration_remarks, print_so_far};
use crate::halt::TimeLimit;
use crate::load::{Estimated, MeasurementNoise, ModelFile, Records};
use crate::margins;
use crate::options::{Integration, Repeats};
use crate::progress::{Progress, RepeatProgress};
use crate::progress_file::Course;
use crate::tasks::Visit;
use clap::Args;
use fdm_estimate::{CheckpointStore, Fit, FitOptions, Halt, Options, fit};
use fdm_lab::job;
use fdm_lab::posterior::{Calibration, Posterior, Ranks, SampleError, Sampling, calibrated, sample};
use fdm_lab::requirement::Draws;
use fdm_lab::study::{Bootstrap, Colour, FORM, Repeat, Study, StudyError, series};
use fdm_numeric::parallel;
use fdm_report::page::calibration_page;
use fdm_report::{Detail, calibration_text, fit_table, repeat_columns, study_table};
use fdm_results::documents::FitDocument;
use fdm_results::documents::calibration::CalibrationDocument;
use fdm_results::store::Identity;
use fdm_system::Model;
use fdm_system::record::Run;
use serde::Serialize;
use std::sync::Arc;

/// What `fdm study` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) model: ModelFile,
    #[command(flatten)]
    pub(crate) records: Records,
    #[command(flatten)]
    estimated: Estimated,
    #[command(flatten)]
    noise: MeasurementNoise,
    /// Number of repeats
    #[arg(long, value_name = "N", default_value_t = 1000, help_heading = "Repeats",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    pub(crate) repeats: u32,
    /// Simulation-based calibration of `fdm sample` instead: ranks of the truth among draws, conditional on the records
    #[arg(long, help_heading = "Repeats", hide_short_help = true)]
    pub(crate) calibration: bool,
    /// Transitions in which the step and the metric of each chain of a calibration are adapted
    #[arg(long, value_name = "N", default_value_t = 300, requires = "calibration", help_heading = "Repeats",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(20..=1_000_000), hide_short_help = true)]
    warmup: u32,
    /// Draws of the parameters in each repeat, by which it is seen where a requirement of the text is not linear in them; 0 for none
    #[arg(long, value_name = "N", default_value_t = 400, help_heading = "Repeats",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(0..=1_000_000), hide_short_help = true)]
    draws: u32,
    #[command(flatten)]
    pub(crate) repetition: Repeats,
    #[command(flatten)]
    integration: Integration,
    #[command(flatten)]
    pub(crate) limit: TimeLimit,
    #[command(flatten)]
    delivery: Delivery,
}

/// What decides the numbers of the repeats, but not how many there are.
#[derive(Serialize)]
struct Studied<'a> {
    fit: &'a FitOptions,
    noise_colour: Colour,
    seed: u64,
    draws: u32,
    form: u8,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (quiet, count) = (arguments.delivery.output.manner.quiet, arguments.repeats as usize);
    let checkpoints = &arguments.repetition.checkpoints;
    let mut progress = Progress::new(quiet).within(&arguments.limit);
    let model = arguments.model.load_for(&arguments.records)?;
    let campaign = arguments.records.read(&model, quiet)?;
    let runs = &campaign.runs;
    let options = arguments.options(&model)?;
    let identity = arguments.identity(&model, runs, &options)?;
    if arguments.calibration {
        return arguments.print_calibration((&model, runs), &options, &progress);
    }
    // places that cannot be written are told before the work
    let prepared = arguments.delivery.prepare(&model, runs)?;
    let checkpoint = checkpoints.open(&identity, quiet)?;
    let (writer, course) = prepared.follow(&model, checkpoints.folder(), &mut progress);
    let first = fit(&model, runs, &options, &progress.work().keeping(checkpoint.keeper()));
    progress.finish();
    let first = first.or_failure()?;
    let bootstrap = match arguments.bootstrap(&first, runs, &options)? {
        Ok(bootstrap) => bootstrap,
        Err(e) if e.is_of_numbers() => {
            remark(format_args!("error: {e}"));
            return print_so_far(&first, &arguments.delivery.output);
        }
        Err(e) => return Err(Failure::input([e])),
    };
    let mut watch = RepeatProgress::new("", count, quiet, progress.halt().clone());
    if writer.is_writing() {
        let so_far = watch.remembering();
        let (name, subjects) = (model.name().to_string(), bootstrap.subjects().to_vec());
        let noise = (Some(bootstrap.colour()), arguments.repetition.seed);
        let mut course = course.lock();
        course.doing = "Monte Carlo repeats".into();
        course.more = Some(Arc::new(move || {
            let (repeats, left) = so_far.read();
            (Study::of(name.clone(), noise, &subjects, &repeats), left)
        }));
    }
    let work = watch.work().keeping(checkpoint.keeper());
    let repeats = series(count, &work, &|k, repeat| watch.came(k, repeat), &|k| bootstrap.once(k, work.halt()));
    watch.finish();
    let study = bootstrap.study(&repeats);

    let mut manifest = prepared.manifest(&model, identity, options.options.noise.clone(), &campaign);
    manifest.seed = Some(arguments.repetition.seed);
    let json = FitDocument { study: Some(study.clone()), ..FitDocument::of(&first) }.into();
    let text = format!("{}\n\n{}", title(&first.model), study_table(&study));
    let tables = tables(&first, &study, &bootstrap, &repeats)?;
    let (model, fit, spectra, remarks) = (&first.model, Some(&first), Vec::new(), integration_remarks(&first));
    let outcome =
        Outcome { model, fit, runs, spectra, tables, bands: Vec::new(), text, whole: None, json, remarks, manifest };
    let delivered = prepared.deliver(outcome);
    let whole = checkpoint.close();
    // told in any case
    let in_time = progress.in_time();
    ended(in_time && first.is_integrated() && study.is_whole() && study.converged > 0 && delivered && whole)
}

impl Arguments {
    /// Makes ready what the repeats have in common, and shows them as tasks; `states` keeps the fit that is repeated.
    pub(crate) fn tasks(&self, states: &dyn CheckpointStore, halt: &Halt, visit: Visit<'_>) -> Result<(), Failure> {
        if self.calibration {
            return Err(Failure::input(["--calibration is not cut into tasks; run it as one command"]));
        }
        let model = self.model.load_for(&self.records)?;
        let runs = self.records.read(&model, true)?.runs;
        let options = self.options(&model)?;
        let identity = self.identity(&model, &runs, &options)?;
        let progress = Progress::hidden(halt.clone(), Course::default());
        let first = fit(&model, &runs, &options, &progress.work().keeping(Some(states))).or_failure()?;
        let refused = |e: StudyError| match e.is_of_numbers() {
            true => Failure::Numbers(e.to_string()),
            false => Failure::input([e]),
        };
        let bootstrap = self.bootstrap(&first, &runs, &options)?.map_err(refused)?;
        let once = |k: u64, halt: &Halt| bootstrap.once(k, halt);
        visit(&job::Repeats { once: &once, count: self.repeats.into() }, &identity)
    }

    /// Calibrates the sampler of the posterior of these runs.
    pub(crate) fn calibrated(
        &self,
        (model, runs): (&Model, &[Run]),
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

    /// Prints a calibration as a command does.
    fn print_calibration(&self, of: (&Model, &[Run]), options: &FitOptions, progress: &Progress) -> Ending {
        let places = &self.delivery.places;
        let kept = self.delivery.plot.is_some() || !self.repetition.checkpoints.given().is_empty();
        if places.out.is_some() || kept {
            return Err(Failure::input([
                "--calibration has no folder, drawing or checkpoint; --report and --json keep it",
            ]));
        }
        let found = self.calibrated(of, options, progress);
        progress.finish();
        // told in any case
        let in_time = progress.in_time();
        let found = found?;
        let printed = self.delivery.output.print(|| calibration_text(&found), || &found)?;
        let written = places.report.as_ref().map_or(Ok(()), |path| write(path, calibration_page(&found)));
        if let Err(e) = &written {
            remark(format_args!("error: {e}; the result is what is printed"));
        }
        ended(in_time && found.is_good() && printed && written.is_ok())
    }

    /// These arguments at the end of a job.
    pub(crate) fn finishing(mut self, done: Arc<job::Memory>, typed: Vec<String>) -> Self {
        self.repetition.checkpoints.done = Some(done);
        self.delivery.places.typed = Some(typed);
        self
    }

    /// What the bits of the repeats depend on.
    pub(crate) fn identity(&self, model: &Model, runs: &[Run], fit: &FitOptions) -> Result<Identity, Failure> {
        let (noise_colour, seed, draws) = (self.colour()?, self.repetition.seed, self.draws);
        Ok(Identity::of(model, runs, &Studied { fit, noise_colour, seed, draws, form: FORM }))
    }

    /// The fit, ready to be repeated.
    pub(crate) fn bootstrap(
        &self,
        first: &Fit,
        runs: &[Run],
        options: &FitOptions,
    ) -> Result<Result<Bootstrap, StudyError>, Failure> {
        let draws = Draws { count: self.draws as usize, seed: margins::SEED };
        let bootstrap = Bootstrap::new(first, runs, options, (self.colour()?, self.repetition.seed));
        Ok(bootstrap.map(|b| b.judging(first, draws)))
    }

    pub(crate) fn options(&self, model: &Model) -> Result<FitOptions, Failure> {
        Ok(self.integration.among(FitOptions {
            changes: self.model.changes(&self.estimated),
            options: Options { noise: self.noise.of(model)?, ..Options::default() },
            ..FitOptions::default()
        }))
    }

    pub(crate) fn colour(&self) -> Result<Colour, Failure> {
        match self.repetition.colours()[..] {
            [] => Ok(Colour::default()),
            [colour] => Ok(colour),
            _ => Err(Failure::input(["--noise-colour: give one colour; repeat the command for another"])),
        }
    }
}

/// Files of a folder: the study, the fit that was repeated, and every repeat.
fn tables(
    first: &Fit,
    study: &Study,
    bootstrap: &Bootstrap,
    repeats: &[Option<Repeat>],
) -> Result<Vec<NamedFile>, Failure> {
    let columns = repeat_columns(bootstrap.subjects(), bootstrap.goals().unwrap_or_default(), repeats);
    let cell = |v: f64| if v.is_nan() { String::new() } else { v.to_string() };
    let quoted = |name: &String| format!("\"{}\"", name.replace('"', "\"\""));
    let mut csv = columns.iter().map(|(name, _)| quoted(name)).collect::<Vec<_>>().join(",");
    for row in 0..columns.first().map_or(0, |(_, values)| values.len()) {
        csv.push('\n');
        csv.push_str(&columns.iter().map(|(_, values)| cell(values[row])).collect::<Vec<_>>().join(","));
    }
    csv.push('\n');
    let detail = Detail { verbose: true, ..Detail::default() };
    Ok(vec![
        ("study.json".into(), as_json(study)?.into_bytes()),
        ("fit.txt".into(), fit_table(&FitDocument::of(first), detail).into_bytes()),
        ("repeats.csv".into(), csv.into_bytes()),
    ])
}
