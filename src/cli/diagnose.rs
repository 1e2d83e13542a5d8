//! `fdm diagnose`: lack of fit of a model, its cause, the extended model, and the gain.

use crate::deliver::{NamedFile, Output, Places, overlay_table, run_file, write};
use crate::effects::{Chosen, Effects, difference};
use crate::failure::{Ending, Failure, OrFailure, as_json, ended, remark};
use crate::halt::TimeLimit;
use crate::load::{Campaign, Estimated, ModelFile, Records, data_files, number};
use crate::methods::Domain;
use crate::options::DiagnosedSpectra;
use crate::progress::Progress;
use crate::progress_file::Course;
use crate::tasks::{Visit, WholeCommand};
use clap::Args;
use fdm_discover::screening::ScreeningOptions;
use fdm_discover::{self as discover, Diagnosis, DiagnosisError, DiagnosisOptions, diagnose};
use fdm_effects::Catalogue;
use fdm_estimate::{FitOptions, Halt};
use fdm_lab::job;
use fdm_report::diagnosis_text;
use fdm_results::documents::{DiagnosisDocument, JudgedRecords};
use fdm_results::store::{Destination, Identity, Manifest};
use fdm_system::Model;
use fdm_system::record::Run;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// What `fdm diagnose` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) model: ModelFile,
    #[command(flatten)]
    pub(crate) records: Records,
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
    /// Family-wise probability of a false alarm, over the whole catalogue
    #[arg(long, value_name = "P", default_value_t = 0.03, value_parser = probability, help_heading = "Search", hide_short_help = true)]
    alpha: f64,
    /// Most effects that are added, one after the other
    #[arg(long = "max-effects", value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(0..=20), help_heading = "Search")]
    most: u16,
    /// Where models are compared with records; `frequency` is for linear models, unstable ones too, and for nonlinear terms
    /// that can be computed from the records
    #[arg(long, value_name = "time|frequency", value_enum, default_value_t = Domain::Time, help_heading = "Frequency domain", hide_short_help = true)]
    domain: Domain,
    #[command(flatten)]
    spectra: DiagnosedSpectra,
    /// Write the model with the accepted effects
    ///
    /// Your own text with the new lines in place. Your start values stay; new parameters start at their estimates.
    #[arg(long, value_name = "FILE", help_heading = "Result")]
    write: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) limit: TimeLimit,
    #[command(flatten)]
    places: Places,
    #[command(flatten)]
    output: Output,
    /// What was done elsewhere, where this is the end of a job.
    #[arg(skip)]
    done: Option<Arc<job::Memory>>,
}

/// A number between 0 and 1.
pub(crate) fn probability(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 && value < 1.0 { Ok(value) } else { Err("a probability is between 0 and 1".into()) }
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (domain, catalogue) = arguments.searched()?;
    let model = arguments.model.load_for(&arguments.records)?;
    let quiet = arguments.output.manner.quiet;
    let (campaign, validation) = arguments.records.read_with_validation(&model, &arguments.validation, quiet)?;
    let runs = &campaign.runs[..];
    // places that cannot be written are told before the work
    let destination = arguments.places.destination(&names(&model, runs, &validation))?;
    let options = arguments.options(&model, domain);
    if let Some(whole) = arguments.done.as_deref().and_then(|done| job::Kind::whole(done)) {
        let Whole { good, printed, files } = postcard::from_bytes(&whole).or_failure()?;
        let failed = files.and_then(|files| arguments.write_files(&files, destination.as_ref()).err());
        let whole = arguments.output.print_made(&printed);
        failed.iter().for_each(|failure| remark(format_args!("error: {failure}")));
        return ended(whole && good && failed.is_none());
    }
    let mut progress = Progress::new(arguments.output.manner.quiet).within(&arguments.limit);
    let (_writer, _) = progress.follow(destination.iter().map(|d| d.folder().to_path_buf()).collect(), &model);
    let (found, in_time) = search(&model, (runs, &validation), (&catalogue, &options), &progress);
    let found = match found {
        // numbers went wrong, or there was no time: the input may be good
        Err(error) if is_of_numbers(&error) => {
            remark(format_args!("error: {error}"));
            return ended(false);
        }
        found => found.map_err(refused)?,
    };
    let manifest = arguments.places.any().then(|| arguments.manifest(&model, &campaign, &validation, &options));
    let ending = arguments.deliver(&model, (&found, campaign.judged), manifest, destination.as_ref())?;
    if in_time && !found.stopped { Ok(ending) } else { ended(false) }
}

/// A diagnosis that was made elsewhere.
#[derive(Serialize, Deserialize)]
struct Whole {
    good: bool,
    /// Text or JSON, whatever was asked for.
    printed: String,
    /// Of the folder, where it or a page is wanted.
    files: Option<Vec<NamedFile>>,
}

/// The search, and whether it ended in time.
pub(crate) fn search(
    model: &Model,
    (runs, validation): (&[Run], &[Run]),
    (catalogue, options): (&Catalogue, &DiagnosisOptions),
    progress: &Progress,
) -> (Result<Diagnosis, DiagnosisError>, bool) {
    let found = diagnose(model, runs, validation, catalogue, options, &progress.work());
    progress.finish();
    (found, progress.in_time())
}

/// Whether the input may be good all the same: numbers went wrong, or there was no time.
pub(crate) fn is_of_numbers(error: &DiagnosisError) -> bool {
    matches!(error, DiagnosisError::Stopped | DiagnosisError::NoFit(_))
}

pub(crate) fn refused(error: DiagnosisError) -> Failure {
    match error {
        DiagnosisError::Model(e) => Failure::Model(e),
        other => Failure::input([other]),
    }
}

impl Arguments {
    /// Makes ready what a diagnosis begins with, and shows it as one task.
    pub(crate) fn tasks(&self, visit: Visit<'_>) -> Result<(), Failure> {
        let (domain, catalogue) = self.searched()?;
        let model = self.model.load_for(&self.records)?;
        let (campaign, validation) = self.records.read_with_validation(&model, &self.validation, true)?;
        let options = self.options(&model, domain);
        let all: Vec<Run> = campaign.runs.iter().chain(&validation).cloned().collect();
        let identity = Identity::of(&model, &all, &options);
        let whole = |halt: &Halt| -> Result<Option<Vec<u8>>, Failure> {
            let progress = Progress::hidden(halt.clone(), Course::default());
            let (found, _) = search(&model, (&campaign.runs, &validation), (&catalogue, &options), &progress);
            if !halt.goes_on() {
                return Ok(None);
            }
            let found = found.map_err(|e| match is_of_numbers(&e) {
                true => Failure::Numbers(e.to_string()),
                false => refused(e),
            })?;
            let difference = self.difference(&model, &found);
            let (text, json) = self.told(&found, (campaign.judged.clone(), None), &difference)?;
            let files = self.places.any().then(|| {
                let manifest = self.manifest(&model, &campaign, &validation, &options);
                manifest.sealed(files(&model, (&text, &json), &difference, &found))
            });
            let printed = if self.output.json { json } else { text };
            let whole = Whole { good: !found.stopped, printed, files: files.transpose().or_failure()? };
            postcard::to_allocvec(&whole).or_failure().map(Some)
        };
        visit(&WholeCommand(&whole), &identity)
    }

    /// These arguments at the end of a job, or as a task of it.
    pub(crate) fn finishing(mut self, done: Option<Arc<job::Memory>>, typed: Vec<String>) -> Self {
        (self.done, self.places.typed) = (done, Some(typed));
        self
    }

    /// What the extension changes in the model's text.
    fn difference(&self, model: &Model, found: &Diagnosis) -> String {
        let changed = |text: &String| difference(model.source().text(), text, &self.model.model);
        found.extended.as_ref().map(changed).unwrap_or_default()
    }

    /// A diagnosis for people and for programs.
    fn told(
        &self,
        found: &Diagnosis,
        (judged, path): (Option<JudgedRecords>, Option<&str>),
        difference: &str,
    ) -> Result<(String, String), Failure> {
        let document = DiagnosisDocument { records: judged, ..DiagnosisDocument::of(found, path) };
        let (json, mut text) = (as_json(&document)?, diagnosis_text(&document));
        if !difference.is_empty() {
            text.push_str(&format!("\n{difference}"));
        }
        Ok((text, json))
    }

    /// Where models are compared with records, and the effects that are searched.
    pub(crate) fn searched(&self) -> Result<(discover::Domain, Catalogue), Failure> {
        Ok((self.domain()?, self.chosen.of(self.effects.read()?)?))
    }

    pub(crate) fn options(&self, model: &Model, domain: discover::Domain) -> DiagnosisOptions {
        let changes = self.model.changes(&self.estimated);
        DiagnosisOptions {
            alpha: self.alpha,
            most: self.most.into(),
            fit: FitOptions { changes, ..FitOptions::default() }.with_declared_noise(model),
            screening: ScreeningOptions::default(),
            domain,
            tables: self.chosen.tables(),
        }
    }

    /// Options of the frequency domain are refused in the time domain.
    fn domain(&self) -> Result<discover::Domain, Failure> {
        let given = self.spectra.given();
        match self.domain {
            Domain::Frequency => Ok(discover::Domain::Frequency(Box::new(self.spectra.options()))),
            Domain::Time if given.is_empty() => Ok(discover::Domain::Time),
            Domain::Time => Err(Failure::input([format!(
                "{} cannot be combined with --domain time: leave it out, or use --domain frequency",
                given.join(", ")
            )])),
        }
    }

    /// What the diagnosis was made from.
    fn manifest(&self, model: &Model, campaign: &Campaign, validation: &[Run], options: &DiagnosisOptions) -> Manifest {
        let all: Vec<Run> = campaign.runs.iter().chain(validation).cloned().collect();
        let noise = options.fit.options.noise.clone();
        let mut manifest = Manifest::of_diagnosis(model, Identity::of(model, &all, options), noise);
        manifest.command = self.places.command();
        manifest.reading = campaign.reading.clone();
        manifest.data = data_files(&campaign.files, &all, &campaign.reading);
        manifest
    }

    /// Prints the result and writes what was asked for; what cannot be written is told, and costs nothing of what was found.
    fn deliver(
        &self,
        model: &Model,
        (found, judged): (&Diagnosis, Option<JudgedRecords>),
        manifest: Option<Manifest>,
        destination: Option<&Destination>,
    ) -> Ending {
        let difference = self.difference(model, found);
        let mut failed = Vec::new();
        let mut path = None;
        if let (Some(file), Some(text)) = (&self.write, &found.extended) {
            match write(file, text) {
                Ok(()) => path = Some(file.display().to_string()),
                Err(e) => failed.push(e.to_string()),
            }
        }
        let (mut text, json) = self.told(found, (judged, path.as_deref()), &difference)?;
        if self.write.is_some() && found.extended.is_none() {
            text.push_str("nothing was written: no effect was accepted\n");
        }
        if let Some(manifest) = manifest {
            let files = manifest.sealed(files(model, (&text, &json), &difference, found)).map_err(|e| e.to_string());
            failed.extend(files.and_then(|files| self.write_files(&files, destination)).err());
        }
        let printed = self.output.print_made(if self.output.json { &json } else { &text });
        failed.iter().for_each(|failure| remark(format_args!("error: {failure}")));
        ended(printed && failed.is_empty())
    }

    /// The folder and the page, where they are wanted, from the same files.
    fn write_files(&self, files: &[NamedFile], destination: Option<&Destination>) -> Result<(), String> {
        let page = self.places.write_page(files);
        let folder = destination.map_or(Ok(()), |place| place.fill(files));
        folder.map_err(|e| e.to_string()).and(page)
    }
}

/// Names of all files that a folder may hold.
fn names(model: &Model, runs: &[Run], validation: &[Run]) -> Vec<String> {
    let own = ["diagnosis.txt", "diagnosis.json", "model.fdm", "extended.fdm", "extended.diff"];
    let all = runs.iter().chain(validation).enumerate();
    let mut names: Vec<String> = own.iter().map(ToString::to_string).collect();
    names.extend(all.map(|(k, run)| run_file(k, &run.name)));
    names.extend((1..model.source().texts().len()).map(|k| format!("model.{k}.fdm")));
    names
}

/// What a folder holds.
pub(crate) fn files(model: &Model, (text, json): (&str, &str), difference: &str, found: &Diagnosis) -> Vec<NamedFile> {
    let own = model.source().text().to_string();
    let mut files = vec![("diagnosis.txt", text.to_string()), ("diagnosis.json", json.to_string()), ("model.fdm", own)];
    if let Some(extended) = &found.extended {
        files.extend([("extended.fdm", extended.clone()), ("extended.diff", difference.to_string())]);
    }
    let mut files: Vec<NamedFile> = files.into_iter().map(|(n, t)| (n.to_string(), t.into_bytes())).collect();
    files.extend(found.overlays.iter().enumerate().map(|(k, overlay)| overlay_table(model, k, overlay)));
    files
}
