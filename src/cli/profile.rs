//! `fdm profile`: profile-likelihood confidence intervals. A parameter moves, all others are fitted again, until the cost has risen
//! by what noise explains.

use crate::deliver::{Output, write};
use crate::failure::{Ending, Failure, OrFailure, did_you_mean, ended, remark};
use crate::fit::{integration_remarks, print_so_far};
use crate::halt::TimeLimit;
use crate::load::{Estimated, MeasurementNoise, ModelFile, Records, number};
use crate::options::Integration;
use crate::ownership::Overwriting;
use crate::progress::Progress;
use crate::progress_file::Course;
use crate::tasks::Visit;
use clap::Args;
use fdm_estimate::{CheckpointStore, Fit, FitOptions, Halt, Options, Status, fit};
use fdm_lab::job;
use fdm_lab::study::{End, Profile, Profiler, StudyError};
use fdm_numeric::parallel;
use fdm_report::page::profile_page;
use fdm_report::{profile_svg, profile_table};
use fdm_results::store::Identity;
use fdm_system::Model;
use fdm_system::record::Run;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;

/// What `fdm profile` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) model: ModelFile,
    #[command(flatten)]
    pub(crate) records: Records,
    /// Parameter that is profiled; may be given several times [default: all that are estimated and shared]
    #[arg(long = "parameter", value_name = "NAME", help_heading = "Parameters")]
    parameters: Vec<String>,
    /// End intervals where the cost has risen by so much: 1.92 is what a likelihood ratio allows white residuals [default: by the errors of the fit]
    #[arg(long, value_name = "COST", value_parser = above_zero, help_heading = "Intervals")]
    rise: Option<f64>,
    #[command(flatten)]
    estimated: Estimated,
    #[command(flatten)]
    noise: MeasurementNoise,
    #[command(flatten)]
    integration: Integration,
    #[command(flatten)]
    pub(crate) limit: TimeLimit,
    #[command(flatten)]
    output: Output,
    /// Draw the cost over each parameter to an SVG file
    #[arg(long, value_name = "FILE.svg", help_heading = "Result")]
    plot: Option<PathBuf>,
    /// Write one page for a browser: intervals, and the cost over each parameter
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    report: Option<PathBuf>,
    #[command(flatten)]
    overwriting: Overwriting,
    /// What was done elsewhere, where this is the end of a job.
    #[arg(skip)]
    done: Option<Arc<job::Memory>>,
}

/// What decides the numbers of profiles.
#[derive(Serialize)]
struct Asked<'a> {
    fit: &'a FitOptions,
    parameters: &'a [String],
    rise: Option<f64>,
}

/// A number above zero.
fn above_zero(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 && value.is_finite() { Ok(value) } else { Err("it must be above zero".into()) }
}

/// A fit, and the profiles around it, or why there are none.
pub(crate) struct Profiled {
    pub(crate) found: Fit,
    pub(crate) profiles: Result<Vec<Profile>, StudyError>,
}

impl Arguments {
    pub(crate) fn work(&self, model: &Model, runs: &[Run], progress: &Progress) -> Result<Profiled, Failure> {
        let options = self.options(model)?;
        let done = self.done.as_deref().map(|done| done as &dyn CheckpointStore);
        let found = fit(model, runs, &options, &progress.work().keeping(done)).or_failure()?;
        let profiler = match Profiler::new(&found, runs, &options, &progress.work().keeping(done)) {
            Ok(profiler) => profiler.with_rise(self.rise),
            Err(e) => {
                progress.finish();
                return Ok(Profiled { found, profiles: Err(e) });
            }
        };
        let names = self.profiled(&found)?;
        progress.say(&format!("profiling {}", names.join(", ")));
        let profiles: Result<Vec<Profile>, StudyError> =
            parallel::map(names.iter(), |name| profiler.of(name)).into_iter().collect();
        progress.finish();
        let profiles = profiles.or_failure()?;
        Ok(Profiled { found, profiles: Ok(profiles) })
    }

    fn options(&self, model: &Model) -> Result<FitOptions, Failure> {
        Ok(self.integration.among(FitOptions {
            changes: self.model.changes(&self.estimated),
            options: Options { noise: self.noise.of(model)?, ..Options::default() },
            ..FitOptions::default()
        }))
    }

    /// The parameters that are profiled.
    fn profiled(&self, found: &Fit) -> Result<Vec<String>, Failure> {
        let shared = found.estimate.parameters.iter().filter(|p| p.run.is_none() && p.status == Status::Estimated);
        let names: Vec<String> = match &self.parameters[..] {
            [] => shared.map(|p| p.name.clone()).collect(),
            some => some.to_vec(),
        };
        if names.is_empty() {
            return Err(Failure::input(["no shared parameter is estimated; name one with --parameter"]));
        }
        Ok(names)
    }

    /// Makes ready what the profiles have in common, and shows their sides as tasks; `states` keeps the fit.
    pub(crate) fn tasks(&self, states: &dyn CheckpointStore, halt: &Halt, visit: Visit<'_>) -> Result<(), Failure> {
        let model = self.model.load_for(&self.records)?;
        self.are_known(&model)?;
        let runs = self.records.read(&model, true)?.runs;
        let options = self.options(&model)?;
        let progress = Progress::hidden(halt.clone(), Course::default());
        let found = fit(&model, &runs, &options, &progress.work().keeping(Some(states))).or_failure()?;
        let profiler =
            Profiler::new(&found, &runs, &options, &progress.work()).map_err(|e| match e.is_of_numbers() {
                true => Failure::Numbers(e.to_string()),
                false => Failure::input([e]),
            })?;
        let profiler = profiler.with_rise(self.rise);
        let parameters = self.profiled(&found)?;
        let identity = Identity::of(&model, &runs, &Asked { fit: &options, parameters: &parameters, rise: self.rise });
        visit(&job::Sides { profiler: &profiler, parameters }, &identity)
    }

    /// These arguments at the end of a job.
    pub(crate) fn finishing(mut self, done: Arc<job::Memory>) -> Self {
        self.done = Some(done);
        self
    }

    /// Names that are none are told before the work.
    pub(crate) fn are_known(&self, model: &Model) -> Result<(), Failure> {
        let names = || model.definition().params.iter().map(|p| p.quantity.name.as_str());
        let unknown = self.parameters.iter().filter(|wanted| !names().any(|name| name == wanted.as_str()));
        let hint = |wanted: &String| did_you_mean(wanted, names());
        let reasons: Vec<String> =
            unknown.map(|p| format!("--parameter {p}: the model has no such parameter{}", hint(p))).collect();
        if reasons.is_empty() { Ok(()) } else { Err(Failure::Input(reasons)) }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let progress = Progress::new(arguments.output.manner.quiet).within(&arguments.limit);
    let model = arguments.model.load_for(&arguments.records)?;
    arguments.are_known(&model)?;
    let runs = arguments.records.read(&model, arguments.output.manner.quiet)?.runs;
    let Profiled { found, profiles } = arguments.work(&model, &runs, &progress)?;
    let profiles = match profiles {
        Ok(profiles) => profiles,
        Err(e) => {
            remark(format_args!("error: {e}"));
            return print_so_far(&found, &arguments.output);
        }
    };
    let printed = arguments.output.print(|| profile_table(&profiles), || &profiles)?;
    integration_remarks(&found).iter().for_each(|r| remark(format_args!("{r}")));
    let drawn = arguments.plot.as_ref().map_or(Ok(()), |file| write(file, profile_svg(&profiles)));
    let page = || profile_page(model.name(), &profiles);
    let drawn = [drawn, arguments.report.as_ref().map_or(Ok(()), |file| write(file, page()))];
    for e in drawn.iter().filter_map(|d| d.as_ref().err()) {
        remark(format_args!("error: {e}; the result is what is printed"));
    }
    let lost = |p: &Profile| p.ends.iter().any(|e| matches!(e, End::Interrupted(_)));
    // told in any case
    let in_time = progress.in_time();
    ended(in_time && found.is_integrated() && printed && drawn.iter().all(Result::is_ok) && !profiles.iter().any(lost))
}
