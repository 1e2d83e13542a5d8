//! `fdm diagnose`: lack of fit of a model, its cause, the extended model, and the gain.

use crate::answer::{Answer, NamedFile, Wanted};
use crate::conduct::Conduct;
use crate::effects::{Chosen, Effects, difference};
use crate::failure::{Failure, OrFailure};
use crate::halt::TimeLimit;
use crate::load::{Estimated, ModelFile};
use crate::methods::DOMAINS;
use crate::options::DiagnosedSpectra;
use crate::records::Records;
use crate::session::Session;
use crate::tables::{overlay_table, run_file};
use crate::verb::{Given, Verb, Visit, as_one_task};
use crate::word::one_of;
use clap::Args;
use fdm_estimate::{CheckpointStore, Domain, FitOptions};
use fdm_infer::{self as infer, Diagnosis, DiagnosisError, DiagnosisOptions, diagnose as search};
use fdm_report::{Words, diagnosis_text};
use fdm_results::documents::DiagnosisDocument;
use fdm_results::store::Identity;
use fdm_system::Model;
use std::path::PathBuf;

/// What a diagnosis works with.
#[derive(Debug, Args)]
pub struct Options {
    #[command(flatten)]
    model: ModelFile,
    #[command(flatten)]
    records: Records,
    /// Validation data: an effect must improve its prediction too
    ///
    /// A run that is not fitted; may be given several times.
    #[arg(long, value_name = "RUN", help_heading = "Data")]
    validation: Vec<PathBuf>,
    #[command(flatten)]
    effects: Effects,
    #[command(flatten)]
    chosen: Chosen,
    #[command(flatten)]
    estimated: Estimated,
    /// Most effects that are added, one after the other
    #[arg(long = "max-effects", value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(0..=20), help_heading = "Search")]
    most: u16,
    /// Where models are compared with records; `frequency` is for linear models, unstable ones too, and for nonlinear terms
    /// that can be computed from the records
    #[arg(long, value_name = "time|frequency", value_parser = one_of(&DOMAINS), default_value = "time", help_heading = "Frequency domain", hide_short_help = true)]
    domain: Domain,
    #[command(flatten)]
    spectra: DiagnosedSpectra,
    /// Write the model with the accepted effects
    ///
    /// Your own text with the new lines in place. Your start values stay; new parameters start at their estimates.
    #[arg(long, value_name = "FILE", help_heading = "Result")]
    pub write: Option<PathBuf>,
    #[command(flatten)]
    limit: TimeLimit,
}

/// A diagnosis, and what is needed to tell it.
pub struct Diagnosed<'s> {
    asked: &'s Options,
    session: &'s Session,
    options: DiagnosisOptions,
    /// What was found.
    pub found: Diagnosis,
    in_time: bool,
}

/// Looks for what the model of a session gets wrong: chooses the effects, searches, tells how far the search came.
///
/// # Errors
/// [`Failure`]; [`Failure::Stopped`], where there was no time.
pub fn diagnose<'s>(asked: &'s Options, session: &'s Session, conduct: &mut Conduct) -> Result<Diagnosed<'s>, Failure> {
    let catalogue = asked.chosen.of(asked.effects.read()?)?;
    let options = asked.chosen(&session.model, asked.domain()?);
    let _writer = conduct.follow(session, None);
    let Session { model, runs, validation, .. } = session;
    let found = search(model, runs, validation, &catalogue, &options, &conduct.progress.work());
    conduct.progress.finish();
    // told in any case
    let in_time = conduct.progress.in_time();
    match found {
        Ok(found) => Ok(Diagnosed { asked, session, options, found, in_time }),
        Err(DiagnosisError::Model(e)) => Err(Failure::Model(e)),
        Err(e @ DiagnosisError::Stopped) => Err(Failure::Stopped(e.to_string())),
        // numbers went wrong: the input may be good
        Err(e @ DiagnosisError::NoFit(_)) => Err(Failure::Numbers(e.to_string())),
        Err(other) => Err(Failure::input([other])),
    }
}

impl Diagnosed<'_> {
    /// What is told of it; the extended text was `written` to that file, where it was written.
    ///
    /// # Errors
    /// [`Failure::Input`], for a manifest without a text.
    pub fn answer(&self, written: Option<&str>, wanted: Wanted) -> Result<Answer, Failure> {
        let Self { asked, session, options, found, in_time } = self;
        let document = DiagnosisDocument { records: session.judged.clone(), ..DiagnosisDocument::of(found, written) };
        let changed = |text: &String| difference(session.model.source().text(), text, &asked.model.model);
        let difference = found.extended.as_ref().map(changed).unwrap_or_default();
        let gap = if difference.is_empty() { "" } else { "\n" };
        let words = Words::of(session.model.source());
        let told = |verbose: bool| format!("{}{gap}{difference}", diagnosis_text(&document, verbose, words));
        let both = Wanted { json: wanted.json || wanted.files, ..wanted };
        let answer = Answer::of(told(wanted.verbose), &document, both)?;
        let mut answer = Answer { good: *in_time && !found.stopped, ..answer };
        if !wanted.verbose {
            answer.text.push_str("\n`--verbose` tells what else was weighed, tried and assumed.\n");
        }
        if asked.write.is_some() && found.extended.is_none() {
            answer.text.push_str("nothing was written: no effect was accepted\n");
        }
        if wanted.files {
            let noise = options.fit.options.noise.clone();
            let identity = Identity::of(&session.model, &session.all(), options);
            let manifest = session.manifest_of_diagnosis(identity, noise, wanted);
            answer.files = manifest.sealed(self.files(&answer, (told(true), &difference))).or_failure()?;
        }
        answer.json = answer.json.filter(|_| wanted.json);
        Ok(answer)
    }

    /// What a folder holds.
    fn files(&self, answer: &Answer, (whole, difference): (String, &str)) -> Vec<NamedFile> {
        let model = &self.session.model;
        let (own, json) = (model.source().text().to_string(), answer.json.clone().unwrap_or_default());
        let mut files = vec![("diagnosis.txt", whole), ("diagnosis.json", json), ("model.fdm", own)];
        if let Some(extended) = &self.found.extended {
            files.extend([("extended.fdm", extended.clone()), ("extended.diff", difference.to_string())]);
        }
        let mut files: Vec<NamedFile> = files.into_iter().map(|(n, t)| (n.to_string(), t.into_bytes())).collect();
        let overlays = self.found.overlays.iter().enumerate();
        files.extend(overlays.map(|(k, overlay)| overlay_table(model, k, overlay)));
        files
    }
}

impl Verb for Options {
    fn given(&self) -> Given<'_> {
        Given { model: &self.model, records: &self.records, limit: &self.limit }
    }

    fn session(&self, conduct: &Conduct) -> Result<Session, Failure> {
        self.domain()?;
        let model = self.model.load_for(&self.records)?;
        self.records.session_with_validation(model, &self.validation, conduct.quiet)?.refuse_censored("a diagnosis")
    }

    fn names(&self, session: &Session) -> Vec<String> {
        let own = ["diagnosis.txt", "diagnosis.json", "model.fdm", "extended.fdm", "extended.diff"];
        let all = session.runs.iter().chain(&session.validation).enumerate();
        let mut names: Vec<String> = own.iter().map(ToString::to_string).collect();
        names.extend(all.map(|(k, run)| run_file(k, &run.name)));
        names.extend((1..session.model.source().texts().len()).map(|k| format!("model.{k}.fdm")));
        names
    }

    fn answer(&self, session: &Session, conduct: &mut Conduct) -> Result<Answer, Failure> {
        diagnose(self, session, conduct)?.answer(None, conduct.wanted)
    }

    /// A diagnosis is one task.
    fn tasks(
        &self,
        session: &Session,
        conduct: &Conduct,
        _: &dyn CheckpointStore,
        visit: Visit<'_>,
    ) -> Result<(), Failure> {
        let options = self.chosen(&session.model, self.domain()?);
        let identity = Identity::of(&session.model, &session.all(), &options);
        as_one_task(self, session, conduct, &identity, visit)
    }
}

impl Options {
    fn chosen(&self, model: &Model, domain: infer::Domain) -> DiagnosisOptions {
        let changes = self.model.changes(&self.estimated);
        DiagnosisOptions {
            most: self.most.into(),
            fit: FitOptions { changes, ..FitOptions::default() }.with_declared_noise(model),
            domain,
        }
    }

    /// Options of the frequency domain are refused in the time domain.
    fn domain(&self) -> Result<infer::Domain, Failure> {
        let given = self.spectra.given();
        match self.domain {
            Domain::Frequency => Ok(infer::Domain::Frequency(Box::new(self.spectra.options()))),
            Domain::Time if given.is_empty() => Ok(infer::Domain::Time),
            Domain::Time => Err(Failure::input([format!(
                "{} cannot be combined with --domain time: leave it out, or use --domain frequency",
                given.join(", ")
            )])),
        }
    }
}
