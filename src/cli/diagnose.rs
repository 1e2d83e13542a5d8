//! `fdm diagnose`: lack of fit of a model, its cause, the extended model, and the gain.

use crate::campaign::{RecordFile, Role, expanded};
use crate::deliver::{NamedFile, Output, Places, overlay_table, run_file, write};
use crate::effects::{Chosen, Effects, difference};
use crate::failure::{Ending, Failure, as_json, ended, print, remark};
use crate::halt::TimeLimit;
use crate::load::{Campaign, Estimated, ModelFile, Records, data_files, measured, number, read_records, say_notes};
use crate::methods::Domain;
use crate::options::DiagnosedSpectra;
use crate::progress::Progress;
use clap::Args;
use fdm_discover::screening::ScreeningOptions;
use fdm_discover::{self as discover, Diagnosis, DiagnosisError, DiagnosisOptions, diagnose_while};
use fdm_estimate::FitOptions;
use fdm_grammar::effect::Catalogue;
use fdm_report::diagnosis_text;
use fdm_results::documents::{DiagnosisDocument, JudgedRecords};
use fdm_results::store::{Destination, Identity, Manifest};
use fdm_system::Model;
use fdm_system::record::{Run, Summary};
use std::path::PathBuf;
use std::sync::Mutex;

/// What `fdm diagnose` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    pub(crate) model: ModelFile,
    #[command(flatten)]
    records: Records,
    /// Validation data: a run that is not fitted; an effect must improve its prediction too; may be given several times
    #[arg(long, alias = "holdout", value_name = "RUN", help_heading = "Data")]
    validation: Vec<PathBuf>,
    #[command(flatten)]
    effects: Effects,
    #[command(flatten)]
    chosen: Chosen,
    #[command(flatten)]
    estimated: Estimated,
    /// Family-wise probability of a false alarm, over the whole catalogue
    #[arg(long, value_name = "P", default_value_t = 0.01, value_parser = probability, help_heading = "Search")]
    alpha: f64,
    /// Most effects that are added, one after the other
    #[arg(long = "max-effects", alias = "most", value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u16).range(0..=20), help_heading = "Search")]
    most: u16,
    /// Where models are compared with records; `frequency` is for linear models, unstable ones too, and for nonlinear terms
    /// that can be computed from the records
    #[arg(long, value_name = "time|frequency", value_enum, default_value_t = Domain::Time, help_heading = "Frequency domain")]
    domain: Domain,
    #[command(flatten)]
    spectra: DiagnosedSpectra,
    /// Write the model with the accepted effects: your own text with the new lines in place. Your start values stay; new parameters
    /// start at their estimates
    #[arg(long, value_name = "FILE", help_heading = "Result")]
    write: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) limit: TimeLimit,
    #[command(flatten)]
    places: Places,
    #[command(flatten)]
    output: Output,
}

/// A number between 0 and 1.
pub(crate) fn probability(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 && value < 1.0 { Ok(value) } else { Err("a probability is between 0 and 1".into()) }
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let (domain, catalogue) = arguments.searched()?;
    let model = arguments.model.load_for(&arguments.records)?;
    let (campaign, validation) = arguments.runs(&model)?;
    let runs = &campaign.runs[..];
    // places that cannot be written are told before the work
    let destination = arguments.places.destination(&names(&model, runs, &validation))?;
    let options = arguments.options(&model, domain);
    let mut progress = Progress::new(arguments.output.quiet).within(&arguments.limit);
    let (_writer, _) = progress.follow(destination.iter().map(|d| d.folder().to_path_buf()).collect(), &model);
    let (found, in_time) = search(&model, (runs, &validation), (&catalogue, &options), progress);
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

/// The search, and whether it ended in time.
pub(crate) fn search(
    model: &Model,
    (runs, validation): (&[Run], &[Run]),
    (catalogue, options): (&Catalogue, &DiagnosisOptions),
    progress: Progress,
) -> (Result<Diagnosis, DiagnosisError>, bool) {
    let halt = progress.halt();
    let progress = Mutex::new(progress);
    let say = |text: &str| {
        if let Ok(progress) = progress.lock() {
            progress.say(text);
        }
    };
    let goes_on = || halt.goes_on();
    let found = diagnose_while(model, runs, validation, catalogue, (options, &say), &goes_on);
    let mut in_time = true;
    if let Ok(progress) = progress.lock() {
        progress.finish();
        in_time = progress.in_time();
    }
    (found, in_time)
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

    /// Runs that are fitted, and validation runs.
    fn runs(&self, model: &Model) -> Result<(Campaign, Vec<Run>), Failure> {
        let options = self.records.selection.options(true);
        let mut files = self.records.files(Role::Fit, &options, model)?;
        let mut records = read_records(&files, model, &[])?;
        let fitted = records.len();
        let elsewhere = measured(model, records.iter().map(|(run, _)| run));
        let mut validation = self.records.of_list(Role::Validation, &options, model)?;
        let one = |path| RecordFile { path, name: None, role: Role::Validation, options: options.clone() };
        validation.extend(expanded(&self.validation)?.into_iter().map(one));
        records.extend(read_records(&validation, model, &elsewhere)?);
        files.append(&mut validation);
        if !self.output.quiet {
            say_notes(&records);
        }
        let records: Vec<(Run, Option<Summary>)> = records.into_iter().map(|(run, s)| (run, Some(s))).collect();
        let judged = self.records.judge(model, &records, self.output.quiet)?;
        let mut runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
        for k in fitted..runs.len() {
            // a validation file may have the name of another
            while runs[..k].iter().any(|r| r.name == runs[k].name) {
                runs[k].name.push_str(" (validation)");
            }
        }
        let validation = runs.split_off(fitted);
        Ok((Campaign { files, runs, judged, reading: options }, validation))
    }

    /// What the diagnosis was made from.
    fn manifest(&self, model: &Model, campaign: &Campaign, validation: &[Run], options: &DiagnosisOptions) -> Manifest {
        let all: Vec<Run> = campaign.runs.iter().chain(validation).cloned().collect();
        let noise = options.fit.options.noise.clone();
        let mut manifest = Manifest::of_diagnosis(model, Identity::of(model, &all, options), noise);
        manifest.command = crate::command_line();
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
        let difference = found
            .extended
            .as_ref()
            .map_or(String::new(), |text| difference(model.source().text(), text, &self.model.model));
        let mut failed = Vec::new();
        let mut path = None;
        if let (Some(file), Some(text)) = (&self.write, &found.extended) {
            match write(file, text) {
                Ok(()) => path = Some(file.display().to_string()),
                Err(e) => failed.push(e.to_string()),
            }
        }
        let json = as_json(&DiagnosisDocument { records: judged, ..DiagnosisDocument::of(found, path.as_deref()) })?;
        let mut text = diagnosis_text(found);
        if !difference.is_empty() {
            text.push_str(&format!("\n{difference}"));
        }
        if self.write.is_some() && found.extended.is_none() {
            text.push_str("nothing was written: no effect was accepted\n");
        }
        if let Some(manifest) = manifest {
            let files = manifest.sealed(files(model, (&text, &json), &difference, found)).map_err(|e| e.to_string());
            failed.extend(files.and_then(|files| self.write_files(&files, destination)).err());
        }
        let printed = print(if self.output.json { &json } else { &text });
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
