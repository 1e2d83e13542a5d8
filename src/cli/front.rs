//! The best models of a diagnosis, fitted as they are written: what `fdm compare` averages over where it is given a diagnosis.

use crate::failure::{Failure, OrFailure, remark};
use fdm_effects::Catalogue;
use fdm_estimate::{Changes, FitOptions, fit};
use fdm_infer::EffectAt;
use fdm_results::documents::{DiagnosisDocument, from_text};
use fdm_results::store::{Contents, DataFile, Manifest, ResultError, ResultFolder, whole_files};
use fdm_session::campaign::{RecordFile, Role};
use fdm_session::effects::{Effects, Sampling, subject_of, with_effects};
use fdm_session::progress::Progress;
use fdm_session::records::read_runs;
use fdm_session::simulate::unchanged;
use fdm_session::value::assignment;
use fdm_system::Model;
use fdm_system::record::Run;
use std::path::{Path, PathBuf};

/// Most alternatives of a cause that are fitted beside it.
const ALTERNATIVES: usize = 4;

/// A diagnosis that was kept.
pub(crate) struct Diagnosed {
    folder: PathBuf,
    manifest: Manifest,
    document: DiagnosisDocument,
    text: String,
}

/// What all models of a diagnosis are made from.
struct Given {
    catalogue: Catalogue,
    changes: Changes,
    files: Vec<RecordFile>,
    /// The model as it was given, and its runs.
    model: Model,
    runs: Vec<Run>,
}

impl Diagnosed {
    /// That of a folder; none where the folder holds something else.
    pub(crate) fn open(folder: &Path) -> Result<Option<Self>, Failure> {
        if !folder.join("diagnosis.json").is_file() {
            return Ok(None);
        }
        let files = whole_files(folder).or_failure()?;
        let lost = |name: &str| ResultError::Changed { folder: folder.into(), files: vec![name.into()] };
        let content = |name: &str| {
            let found = files.iter().find(|(own, _)| own == name).map(|(_, content)| String::from_utf8_lossy(content));
            found.ok_or_else(|| lost(name))
        };
        let document = content("diagnosis.json").or_failure()?;
        let document = from_text(&document).map_err(|_| lost("diagnosis.json")).or_failure()?;
        let manifest = content("manifest.json").or_failure()?;
        let manifest = from_text(&manifest).map_err(|_| lost("manifest.json")).or_failure()?;
        let text = content("model.fdm").or_failure()?.into_owned();
        Ok(Some(Self { folder: folder.into(), manifest, document, text }))
    }

    /// Effects of every model: those of the table of best models, and the alternatives that the data cannot tell from a cause of the recommended one.
    fn models(&self) -> Vec<Vec<EffectAt>> {
        let mut all: Vec<Vec<EffectAt>> = self.document.front.iter().map(|m| m.effects.clone()).collect();
        let recommended = self.document.front.iter().find(|m| m.recommended).map(|m| m.effects.clone());
        for cause in &self.document.causes {
            let place = &cause.place;
            let Some(at) = recommended.as_ref().and_then(|r| r.iter().position(|e| e == place)) else { continue };
            for other in cause.group.iter().map(|a| &a.place).filter(|other| *other != place).take(ALTERNATIVES) {
                let mut effects = recommended.clone().unwrap_or_default();
                effects[at] = other.clone();
                if !all.contains(&effects) {
                    all.push(effects);
                }
            }
        }
        all
    }

    /// The files of the runs that took part in the fits, or of those that did not.
    pub(crate) fn files(&self, role: Role) -> Result<Vec<RecordFile>, Failure> {
        let changed =
            |path: &Path, run: &str| format!("{}: changed or removed since run `{run}` was diagnosed", path.display());
        unchanged(&self.manifest, &self.data(role).collect::<Vec<_>>(), role, &changed)
    }

    fn data(&self, role: Role) -> impl Iterator<Item = &DataFile> {
        let held = |data: &&DataFile| self.document.outputs.iter().any(|o| o.validation && o.run == data.run);
        self.manifest.data.iter().filter(move |data| held(data) == (role == Role::Validation))
    }

    /// What the command changed of the model's parameters.
    fn changes(&self) -> Result<Changes, Failure> {
        let mut changes = Changes::default();
        let mut words = self.manifest.command.iter();
        while let Some(word) = words.next() {
            let (option, value) = match word.split_once('=') {
                Some((option, value)) if option.starts_with("--") => (option, Some(value.to_string())),
                _ => (word.as_str(), None),
            };
            if !["--set", "--fix", "--free"].contains(&option) {
                continue;
            }
            let Some(value) = value.or_else(|| words.next().cloned()) else { break };
            match option {
                "--set" => changes.set.push(assignment(&value).map_err(|e| Failure::input([e]))?),
                "--fix" => changes.fix.push(value),
                _ => changes.free.push(value),
            }
        }
        Ok(changes)
    }

    /// The model as a text says it.
    fn made(&self, text: &str) -> Result<Model, Failure> {
        let name = self.folder.join("model.fdm").display().to_string();
        let model = Model::from_texts(name.as_str(), text, &[])?.grouped(self.manifest.groups.clone())?;
        Ok(model.untied(&self.manifest.untied).unwrap_or(model))
    }

    /// The model with effects, its new parameters where the diagnosis found them.
    fn extended(&self, effects: &[EffectAt], given: &Given) -> Result<Model, Failure> {
        let wanted: Vec<String> = effects.iter().map(ToString::to_string).collect();
        let extended = with_effects(subject_of(&given.model)?, &wanted, &given.catalogue, Sampling::of(&given.runs))?;
        let model = self.made(extended.source().text())?;
        let mut params = model.definition().params.clone();
        let known = |name: &str| self.document.causes.iter().flat_map(|c| &c.parameters).find(|p| p.name == name);
        for param in params.iter_mut().filter(|p| !p.is_recorded()) {
            if let Some(found) = known(&param.quantity.name).filter(|found| found.value.is_finite()) {
                param.value = found.value.clamp(param.lower, param.upper);
            }
        }
        Ok(model.with_params(params))
    }

    /// Fits of all models, as results in memory; models without a fit are told.
    pub(crate) fn results(
        &self,
        effects: &Effects,
        progress: &Progress,
    ) -> Result<Vec<(ResultFolder, Model)>, Failure> {
        if self.document.domain != "time" {
            return Err(Failure::input([format!(
                "{}: its models were compared by spectra, and averages are of fits in time; write the models with `fdm extend`, fit and compare them",
                self.folder.display()
            )]));
        }
        let (files, model) = (self.files(Role::Fit)?, self.made(&self.text)?);
        let runs = read_runs(&files, &model, &[], true)?;
        let given = Given { catalogue: effects.read()?, changes: self.changes()?, files, model, runs };
        let mut results = Vec::new();
        for effects in self.models() {
            let names: Vec<String> = effects.iter().map(ToString::to_string).collect();
            let name = if names.is_empty() { "as given".to_string() } else { names.join(" + ") };
            progress.say(&format!("fitting {name}"));
            let found = match effects.is_empty() {
                true => self.result(&name, &given.model, (&given.runs, &given.changes), progress),
                false => self.extended(&effects, &given).and_then(|model| {
                    // an effect may have made inputs or outputs of its own
                    let runs = read_runs(&given.files, &model, &[], true)?;
                    self.result(&name, &model, (&runs, &given.changes), progress)
                }),
            };
            match found {
                Ok(found) => results.push(found),
                Err(e) => remark(format_args!("note: {name} is left out: {}", e)),
            }
        }
        Ok(results)
    }

    fn result(
        &self,
        name: &str,
        model: &Model,
        (runs, changes): (&[Run], &Changes),
        progress: &Progress,
    ) -> Result<(ResultFolder, Model), Failure> {
        let options = FitOptions { changes: changes.clone(), ..FitOptions::default() }.with_declared_noise(model);
        let found = fit(model, runs, &options, &progress.work()).or_failure()?;
        let mut contents = Contents::of_fit(&found, runs, &options);
        contents.manifest.data = self.data(Role::Fit).cloned().collect();
        contents.manifest.reading = self.manifest.reading.clone();
        let folder = ResultFolder::from_files(name, &contents.files().or_failure()?).or_failure()?;
        let model = folder.model()?;
        Ok((folder, model))
    }
}
