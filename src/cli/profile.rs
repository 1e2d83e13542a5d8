//! `fdm profile`: how far a parameter may go until the best fit with it costs more than chance explains.

use crate::failure::{Failure, NUMBERS, print, remark};
use crate::integrator::Integration;
use crate::noise::noise;
use crate::progress::Progress;
use crate::records::{Records, notes};
use crate::subject::{Estimated, Subject};
use clap::Args;
use fdm::Model;
use fdm::estimate::{FitOptions, Options, Status, fit};
use fdm::record::Run;
use fdm::report::{profile_json, profile_svg, profile_table};
use fdm::store::reason;
use fdm::study::{End, Profile, Profiler, StudyError};
use fdm_grammar::diagnostic::nearest;
use rayon::prelude::*;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

/// What `fdm profile` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    #[command(flatten)]
    records: Records,
    /// Parameter that is profiled; may be given several times [default: all that are estimated and shared]
    #[arg(long = "parameter", value_name = "NAME", help_heading = "Parameters")]
    parameters: Vec<String>,
    #[command(flatten)]
    estimated: Estimated,
    /// Measurement noise, as `fdm fit` takes it
    #[arg(long, value_name = "diagonal|full|OUTPUT=DEVIATION", help_heading = "Estimation")]
    noise: Vec<String>,
    #[command(flatten)]
    integration: Integration,
    /// Print JSON instead of a table
    #[arg(long, help_heading = "Result")]
    json: bool,
    /// Draw the cost over each parameter to an SVG file
    #[arg(long, value_name = "FILE.svg", help_heading = "Result")]
    plot: Option<PathBuf>,
    /// Say nothing while working
    #[arg(short, long, help_heading = "Result")]
    quiet: bool,
}

impl Arguments {
    /// Names that are none are told before the work.
    fn are_known(&self, model: &Model) -> Result<(), Failure> {
        let names = || model.definition().params.iter().map(|p| p.quantity.name.as_str());
        let unknown = self.parameters.iter().filter(|wanted| !names().any(|name| name == wanted.as_str()));
        let reasons: Vec<String> = unknown
            .map(|wanted| {
                let hint = nearest(wanted, names()).map_or(String::new(), |h| format!("; did you mean `{h}`?"));
                format!("--parameter {wanted}: the model has no such parameter{hint}")
            })
            .collect();
        if reasons.is_empty() { Ok(()) } else { Err(Failure::Input(reasons)) }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut progress = Progress::new(arguments.quiet);
    let model = arguments.subject.load()?;
    arguments.are_known(&model)?;
    let records = arguments.records.load(&model, true)?;
    if !arguments.quiet {
        notes(&records);
    }
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let options = FitOptions {
        changes: arguments.subject.changes(&arguments.estimated),
        options: Options { noise: noise(&arguments.noise, &model)?, ..Options::default() },
        per_interval: arguments.integration.per_interval(),
        scheme: arguments.integration.scheme(),
        ..FitOptions::default()
    };
    let found = fit(&model, &runs, &options, &mut progress).map_err(|e| Failure::input([e]))?;
    let interrupted = progress.interrupted();
    let goes_on = move || !interrupted.load(Ordering::Relaxed);
    let profiler = match Profiler::new(&found, &runs, &options, &goes_on) {
        Ok(profiler) => profiler,
        Err(e) => {
            progress.finish();
            remark(format_args!("error: {e}"));
            return Ok(ExitCode::from(NUMBERS));
        }
    };
    let shared = found.estimate.parameters.iter().filter(|p| p.run.is_none() && p.status == Status::Estimated);
    let names: Vec<String> = match &arguments.parameters[..] {
        [] => shared.map(|p| p.name.clone()).collect(),
        some => some.to_vec(),
    };
    if names.is_empty() {
        return Err(Failure::input(["no shared parameter is estimated; name one with --parameter"]));
    }
    progress.say(&format!("refits for {}", names.join(", ")));
    let profiles: Result<Vec<Profile>, StudyError> = names.par_iter().map(|name| profiler.of(name)).collect();
    progress.finish();
    let profiles = profiles.map_err(|e| Failure::input([e]))?;
    let document = || format!("{}\n", profile_json(&profiles));
    let printed = print(&if arguments.json { document() } else { profile_table(&profiles) });
    let drawn = arguments.plot.as_ref().map_or(Ok(()), |file| {
        let picture = profile_svg(&profiles).map_err(|e| e.to_string())?;
        std::fs::write(file, picture).map_err(|e| format!("{}: {}", file.display(), reason(&e)))
    });
    if let Err(e) = &drawn {
        remark(format_args!("error: {e}; the result is what is printed"));
    }
    let lost = |p: &Profile| p.ends.iter().any(|e| matches!(e, End::Interrupted(_)));
    let good = printed && drawn.is_ok() && !profiles.iter().any(lost);
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}
