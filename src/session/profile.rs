//! `fdm profile`: profile-likelihood confidence intervals. A parameter moves, all others are fitted again, until the cost has risen
//! by what noise explains.

use crate::answer::Answer;
use crate::conduct::Conduct;
use crate::failure::{Failure, OrFailure, did_you_mean};
use crate::fit::{astray, integration_remarks};
use crate::halt::TimeLimit;
use crate::load::{Estimated, ModelFile};
use crate::noise::MeasurementNoise;
use crate::options::Integration;
use crate::records::Records;
use crate::session::Session;
use crate::study::refused;
use crate::value::number;
use crate::verb::{Given, Verb, Visit};
use clap::Args;
use fdm_estimate::{CheckpointStore, Fit, FitOptions, Status, fit};
use fdm_lab::job;
use fdm_lab::study::{End, Profile, Profiler, StudyError};
use fdm_numeric::parallel;
use fdm_report::page::profile_page;
use fdm_report::{profile_svg, profile_table};
use fdm_results::store::Identity;
use fdm_system::Model;
use serde::Serialize;

/// What profiles work with.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    model: ModelFile,
    #[command(flatten)]
    records: Records,
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
    limit: TimeLimit,
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

impl Verb for Options {
    fn given(&self) -> Given<'_> {
        Given { model: &self.model, records: &self.records, limit: &self.limit }
    }

    fn session(&self, conduct: &Conduct) -> Result<Session, Failure> {
        let model = self.model.load_for(&self.records)?;
        self.are_known(&model)?;
        self.records.session(model, conduct.quiet)?.with_noise_of_censored(self.noise.words())
    }

    /// The page is the file `page.html`.
    fn answer(&self, session: &Session, conduct: &mut Conduct) -> Result<Answer, Failure> {
        self.are_known(&session.model)?;
        let options = self.chosen(session)?;
        let done = conduct.done.clone();
        let done = done.as_deref().map(|done| done as &dyn CheckpointStore);
        let work = conduct.progress.work().keeping(done);
        let found = fit(&session.model, &session.runs, &options, &work).or_failure()?;
        let profiler = match Profiler::new(&found, &session.runs, &options, &work) {
            Ok(profiler) => profiler.with_rise(self.rise),
            Err(e) => return Err(astray(&e, &found, conduct)),
        };
        let names = self.profiled(&found)?;
        conduct.progress.say(&format!("profiling {}", names.join(", ")));
        let profiles: Result<Vec<Profile>, StudyError> =
            parallel::map(&names, |name| profiler.of(name)).into_iter().collect();
        let profiles = profiles.or_failure()?;
        let mut answer = Answer::of(profile_table(&profiles), &profiles, conduct.wanted)?;
        if conduct.wanted.files {
            let page = profile_page(session.model.name(), &profiles);
            answer.files.push(("page.html".into(), page.into_bytes()));
        }
        let lost = |p: &Profile| p.ends.iter().any(|e| matches!(e, End::Interrupted(_)));
        let good = found.is_integrated() && !profiles.iter().any(lost);
        let plot = conduct.wanted.plot.then(|| profile_svg(&profiles));
        let remarks = integration_remarks(&found);
        Ok(conduct.in_time(Answer { plot, remarks, good, ..answer }, "the result is the best so far"))
    }

    /// The sides of the profiles; `states` keeps the fit.
    fn tasks(
        &self,
        session: &Session,
        conduct: &Conduct,
        states: &dyn CheckpointStore,
        visit: Visit<'_>,
    ) -> Result<(), Failure> {
        let (Session { model, runs, .. }, options) = (session, self.chosen(session)?);
        let progress = conduct.aside();
        let work = progress.work();
        let found = fit(model, runs, &options, &progress.work().keeping(Some(states))).or_failure()?;
        let profiler = Profiler::new(&found, runs, &options, &work).map_err(refused)?.with_rise(self.rise);
        let parameters = self.profiled(&found)?;
        let identity = Identity::of(model, runs, &Asked { fit: &options, parameters: &parameters, rise: self.rise });
        visit(&job::Sides { profiler: &profiler, parameters }, &identity)
    }
}

impl Options {
    fn chosen(&self, session: &Session) -> Result<FitOptions, Failure> {
        let plain = self.integration.plain(self.model.changes(&self.estimated), self.noise.of(&session.model)?);
        Ok(FitOptions { censored: session.censored(), ..plain })
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

    /// Names that are none are told before the work.
    fn are_known(&self, model: &Model) -> Result<(), Failure> {
        let names = || model.definition().params.iter().map(|p| p.quantity.name.as_str());
        let unknown = self.parameters.iter().filter(|wanted| !names().any(|name| name == wanted.as_str()));
        let hint = |wanted: &String| did_you_mean(wanted, names());
        let reasons: Vec<String> =
            unknown.map(|p| format!("--parameter {p}: the model has no such parameter{}", hint(p))).collect();
        if reasons.is_empty() { Ok(()) } else { Err(Failure::Input(reasons)) }
    }
}
