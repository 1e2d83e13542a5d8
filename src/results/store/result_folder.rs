//! A result on disk: written whole, read back with everything checked.

use super::destination::{Destination, DestinationError, is_plain, manifest_text, standing};
use super::disk::reason;
use super::file::{read_input, read_input_text};
use super::identity::Identity;
use super::identity::fingerprint;
use super::manifest::{self, KeptFile, Manifest};
use crate::documents::{FitDocument, KeptParameter, OutputDocument, ResultDocument, from_text, to_text};
use fdm_estimate::{Changes, Fit, FitOptions, Options, Status};
use fdm_system::model::{Model, ModelError};
use fdm_system::record::Run;
use fdm_system::simulate::Accuracy;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// The text of the model.
const MODEL: &str = "model.fdm";
/// The text of the k-th file that the model uses, from 1.
fn used_name(k: usize) -> String {
    format!("model.{k}.fdm")
}
/// Everything that `--json` prints.
const RESULT: &str = "result.json";
/// What the residuals of the fitted runs say.
const QUALITY: &str = "quality.json";

/// A result that was read back.
#[derive(Debug, Clone)]
pub struct ResultFolder {
    folder: PathBuf,
    manifest: Manifest,
    model: String,
    used: Vec<String>,
    result: ResultDocument,
    quality: Vec<OutputDocument>,
    parameters: Vec<KeptParameter>,
}

/// Why a folder gives no result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ResultError {
    /// There is no such folder, or it cannot be read.
    Unreadable {
        /// What is wrong where.
        reason: String,
    },
    /// It is not a result of this program.
    Foreign {
        /// The folder.
        folder: PathBuf,
    },
    /// It was written by a program with another format, older or newer.
    OtherFormat {
        /// The folder.
        folder: PathBuf,
        /// Its format.
        format: u32,
    },
    /// Files were changed since it was written, or are missing.
    Changed {
        /// The folder.
        folder: PathBuf,
        /// The files.
        files: Vec<String>,
    },
    /// Per-run parameters of several runs, and nothing says which are wanted.
    Ambiguous {
        /// The run that is to be simulated.
        run: String,
        /// The runs of the result.
        fitted: Vec<String>,
    },
    /// A run that the result does not have.
    NoRun {
        /// The run.
        run: String,
        /// The runs of the result.
        fitted: Vec<String>,
    },
}

impl fmt::Display for ResultError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable { reason } => write!(f, "the result cannot be read: {reason}"),
            Self::Foreign { folder } => {
                write!(f, "{} is not a result of fdm: it was not written by `--out`", folder.display())
            }
            Self::OtherFormat { folder, format } => {
                let (age, cure) = match *format > manifest::FORMAT {
                    true => ("a newer", ""),
                    false => ("an older", ": make it again with the command in its manifest.json"),
                };
                let (folder, own) = (folder.display(), manifest::FORMAT);
                write!(f, "{folder} was written by {age} fdm (format {format}, this program reads {own}){cure}")
            }
            Self::Changed { folder, files } => write!(
                f,
                "{}: changed or missing since it was written, and not to be trusted: {}",
                folder.display(),
                files.join(", ")
            ),
            Self::Ambiguous { run, fitted } => write!(
                f,
                "the result has per-run parameters of the runs {}, but none for `{run}`: choose with --like RUN",
                names(fitted)
            ),
            Self::NoRun { run, fitted } => write!(f, "the result has no run `{run}`, only {}", names(fitted)),
        }
    }
}

fn names(runs: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown: Vec<String> = runs.iter().take(SHOWN).map(|r| format!("`{r}`")).collect();
    let more = runs.len().saturating_sub(SHOWN);
    shown.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
}

impl std::error::Error for ResultError {}

/// What is written beside the manifest: the model's text, the result for programs, and further files by name.
#[derive(Debug, Clone)]
pub struct Contents {
    /// What it was made from; its list of files is filled in.
    pub manifest: Manifest,
    /// Text of the model.
    pub model: String,
    /// Texts of the files that the model uses, in their order.
    pub used: Vec<String>,
    /// Everything that `--json` prints.
    pub result: ResultDocument,
    /// What the residuals of each output of each run say.
    pub quality: Vec<OutputDocument>,
    /// Tables, time histories, pictures.
    pub others: Vec<(String, Vec<u8>)>,
}

impl Contents {
    /// Of an output-error fit of these runs with these options: a folder as `fdm fit --out` makes it, without tables and pictures.
    pub fn of_fit(fit: &Fit, runs: &[Run], options: &FitOptions) -> Self {
        let noise = options.options.noise.clone();
        let manifest = Manifest::new(&fit.model, Identity::of(&fit.model, runs, options), noise);
        let mut texts = fit.model.source().texts().iter().map(|t| t.text().to_string());
        let (model, used) = (texts.next().unwrap_or_default(), texts.collect());
        let quality = OutputDocument::of_quality(&fit.model, &fit.quality);
        let result = ResultDocument::Fit(Box::new(FitDocument::of(fit)));
        Self { manifest, model, used, result, quality, others: Vec::new() }
    }

    /// Writes the folder: all of it or nothing.
    ///
    /// # Errors
    /// [`DestinationError`].
    pub fn write(self, destination: &Destination) -> Result<(), DestinationError> {
        destination.fill(&self.files()?)
    }

    /// The files of the folder, names and contents, the manifest last.
    ///
    /// # Errors
    /// [`DestinationError`] when the manifest has no text.
    pub fn files(self) -> Result<Vec<(String, Vec<u8>)>, DestinationError> {
        let unwritable = |e: serde_json::Error| DestinationError::Unwritable { reason: e.to_string() };
        let result = self.result.text().map_err(unwritable)?;
        let quality = to_text(&self.quality).map_err(unwritable)?;
        let own = [(MODEL, self.model), (RESULT, result), (QUALITY, quality)];
        let mut files: Vec<(String, Vec<u8>)> =
            own.into_iter().map(|(name, text)| (name.to_string(), text.into_bytes())).collect();
        files.extend(self.used.into_iter().enumerate().map(|(k, text)| (used_name(k + 1), text.into_bytes())));
        files.extend(self.others);
        self.manifest.sealed(files).map_err(unwritable)
    }
}

/// The files of a result or a diagnosis, names and contents, the manifest last: every one of them as it was written.
///
/// # Errors
/// [`ResultError`].
pub fn whole_files(folder: &Path) -> Result<Vec<(String, Vec<u8>)>, ResultError> {
    undisturbed(folder, || files_as_they_stand(folder))
}

/// Reads once more where another program has put a new result there meanwhile.
fn undisturbed<T>(folder: &Path, read: impl Fn() -> Result<T, ResultError>) -> Result<T, ResultError> {
    let before = manifest_text(folder);
    match read() {
        Err(ResultError::Changed { .. }) if manifest_text(folder) != before => read(),
        other => other,
    }
}

fn files_as_they_stand(folder: &Path) -> Result<Vec<(String, Vec<u8>)>, ResultError> {
    let (text, manifest) = manifest_of(folder, Manifest::any_format)?;
    let mut files = Vec::new();
    for file in &manifest.files {
        let content = read_same(folder, file);
        let changed = || ResultError::Changed { folder: folder.into(), files: vec![file.name.clone()] };
        files.push((file.name.clone(), content.ok_or_else(changed)?));
    }
    files.push((manifest::NAME.into(), text.into_bytes()));
    Ok(files)
}

/// The manifest of a folder, and its text; `format` says which folders are ours.
fn manifest_of(folder: &Path, format: fn(&str) -> Option<u32>) -> Result<(String, Manifest), ResultError> {
    let foreign = || ResultError::Foreign { folder: folder.into() };
    let text = match read_input_text(&standing(folder, manifest::NAME)) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound && folder.is_dir() => return Err(foreign()),
        Err(e) if e.kind() == io::ErrorKind::InvalidData => return Err(foreign()),
        Err(e) => return Err(ResultError::Unreadable { reason: format!("{}: {}", folder.display(), reason(&e)) }),
    };
    let format = format(&text).ok_or_else(foreign)?;
    if format != manifest::FORMAT {
        return Err(ResultError::OtherFormat { folder: folder.into(), format });
    }
    let manifest = serde_json::from_str::<Manifest>(&text).ok().filter(|m| m.is_whole(&text));
    let changed = || ResultError::Changed { folder: folder.into(), files: vec![manifest::NAME.into()] };
    Ok((text, manifest.ok_or_else(changed)?))
}

impl ResultFolder {
    /// Whether a folder holds a manifest, as that of every result does; whether it is whole is seen when it is opened.
    pub fn stands_in(folder: impl AsRef<Path>) -> bool {
        folder.as_ref().join(manifest::NAME).is_file()
    }

    /// Reads a folder and checks its version and every file's fingerprint.
    ///
    /// # Errors
    /// [`ResultError`].
    pub fn open(folder: impl AsRef<Path>) -> Result<Self, ResultError> {
        let folder = folder.as_ref();
        undisturbed(folder, || Self::as_it_stands(folder))
    }

    fn as_it_stands(folder: &Path) -> Result<Self, ResultError> {
        let (_, manifest) = manifest_of(folder, Manifest::format)?;
        let wrong: Vec<String> =
            manifest.files.iter().filter(|f| read_same(folder, f).is_none()).map(|f| f.name.clone()).collect();
        if !wrong.is_empty() {
            return Err(ResultError::Changed { folder: folder.into(), files: wrong });
        }
        Self::read(folder, manifest, &|name| read_input_text(&standing(folder, name)).ok())
    }

    /// From the files of a result in memory, as [`Contents::files`] makes them; `folder` is what messages call them.
    ///
    /// # Errors
    /// [`ResultError`].
    pub fn from_files(folder: impl AsRef<Path>, files: &[(String, Vec<u8>)]) -> Result<Self, ResultError> {
        let folder = folder.as_ref();
        let text = |name: &str| {
            let (_, content) = files.iter().find(|(own, _)| own == name)?;
            String::from_utf8(content.clone()).ok()
        };
        let manifest = text(manifest::NAME).and_then(|text| serde_json::from_str(&text).ok());
        let manifest = manifest.ok_or_else(|| ResultError::Foreign { folder: folder.into() })?;
        Self::read(folder, manifest, &text)
    }

    fn read(folder: &Path, manifest: Manifest, text: &dyn Fn(&str) -> Option<String>) -> Result<Self, ResultError> {
        let broken = |name: &str| ResultError::Changed { folder: folder.into(), files: vec![name.into()] };
        let read = |name: &str| text(name).ok_or_else(|| broken(name));
        let (model, result, quality) = (read(MODEL)?, read(RESULT)?, read(QUALITY)?);
        let result = ResultDocument::read(&result).map_err(|_| broken(RESULT))?;
        let quality = from_text(&quality).map_err(|_| broken(QUALITY))?;
        let names = (1..).map(used_name).take_while(|name| manifest.files.iter().any(|f| f.name == *name));
        let used = names.map(|name| read(&name)).collect::<Result<Vec<_>, _>>()?;
        let parameters = result.parameters();
        Ok(Self { folder: folder.into(), manifest, model, used, result, quality, parameters })
    }

    /// Where it was found.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What it was made from.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Everything that `--json` printed.
    pub fn result(&self) -> &ResultDocument {
        &self.result
    }

    /// What the residuals of each output of each fitted run say.
    pub fn quality(&self) -> &[OutputDocument] {
        &self.quality
    }

    /// Every parameter, per-run ones once for every run, and derived quantities.
    pub fn parameters(&self) -> &[KeptParameter] {
        &self.parameters
    }

    /// The model, as it was written by the user; its parameters are at their declared start values.
    ///
    /// # Errors
    /// [`ModelError`] when this version of the program no longer reads it.
    pub fn model(&self) -> Result<Model, ModelError> {
        // names of used files are relative to the model's: one of them may be `model.fdm` itself
        let own = Path::new(&self.manifest.model_file).file_name().filter(|_| !self.used.is_empty());
        let name = own.map_or_else(|| self.folder.join(MODEL), |own| self.folder.join(own));
        let origin = Path::new(&self.manifest.model_file);
        let model = Model::from_kept(name.display().to_string(), &self.model, &self.used, origin)?
            .grouped(self.manifest.groups.clone())?;
        // the names were taken from this text
        Ok(model.untied(&self.manifest.untied).unwrap_or(model))
    }

    /// The runs that were fitted.
    pub fn runs(&self) -> Vec<String> {
        self.manifest.data.iter().map(|d| d.run.clone()).collect()
    }

    /// All parameters of `model` (p) as they were found, per-run ones those of `like`, or when that is not given those of the
    /// fitted run with the same name as `run`, or of the only one.
    ///
    /// # Errors
    /// [`ResultError::Ambiguous`] and [`ResultError::NoRun`]. A parameter that the result does not have keeps its value.
    pub fn theta(&self, model: &Model, run: &str, like: Option<&str>) -> Result<Vec<f64>, ResultError> {
        let params = &model.definition().params;
        let owner =
            if params.iter().any(|p| p.per_run && !p.is_recorded()) { Some(self.owner(run, like)?) } else { None };
        let value = |p: &fdm_grammar::model::Param| {
            let owner = owner.as_deref().filter(|_| p.per_run && !p.is_recorded());
            let kept = self.parameters.iter().find(|k| k.name == p.quantity.name && k.run.as_deref() == owner);
            kept.map_or(p.value, |k| k.value)
        };
        Ok(params.iter().map(value).collect())
    }

    /// Method and steps with which a run was fitted, and their integration error.
    pub fn integration(&self, run: &str) -> Option<Accuracy> {
        let found = self.result.fit()?.integration.as_ref()?.iter().find(|i| i.run == run)?;
        Some(Accuracy { steps: found.spacing.clone(), error: found.error.unwrap_or(f64::NAN) })
    }

    /// What makes a fit of `model` a validation of this result: shared parameters are held where they were found, and so
    /// are per-run ones that the fit held; the others are free, from their declared start values and the data.
    pub fn held(&self, model: &Model) -> Changes {
        let mut changes = Changes::default();
        for p in &model.definition().params {
            let name = &p.quantity.name;
            let Some(kept) = self.parameters.iter().find(|k| k.name == *name) else { continue };
            if p.per_run && kept.status != Status::Fixed {
                if p.fixed {
                    changes.free.push(name.clone());
                }
                continue;
            }
            changes.set.push((name.clone(), kept.value));
            changes.fix.push(name.clone());
        }
        changes
    }

    /// The fit of `model` that validates this result: [`Self::held`], by the noise that it assumed.
    pub fn validation(&self, model: &Model) -> FitOptions {
        let options = Options { noise: self.manifest.noise.clone(), ..Options::default() };
        FitOptions { changes: self.held(model), options, ..FitOptions::default() }
    }

    /// The fitted run whose own parameters are to be used.
    fn owner(&self, run: &str, like: Option<&str>) -> Result<String, ResultError> {
        let fitted = self.runs();
        if let Some(like) = like {
            let known = fitted.iter().any(|r| r == like);
            return if known { Ok(like.into()) } else { Err(ResultError::NoRun { run: like.into(), fitted }) };
        }
        match &fitted[..] {
            [only] => Ok(only.clone()),
            _ if fitted.iter().any(|r| r == run) => Ok(run.into()),
            _ => Err(ResultError::Ambiguous { run: run.into(), fitted }),
        }
    }
}

/// A file as it was written; none when it is missing or another.
fn read_same(folder: &Path, file: &KeptFile) -> Option<Vec<u8>> {
    let content = is_plain(&file.name).then(|| read_input(&standing(folder, &file.name)))?.ok()?;
    (content.len() as u64 == file.bytes && fingerprint(&content) == file.sha256).then_some(content)
}

#[cfg(test)]
mod tests {
    use super::super::faults::{Faulty, Kind};
    use super::super::identity::Identity;
    use super::super::manifest::DataFile;
    use super::*;
    use crate::documents::specimen::{fit, parameter};
    use fdm_estimate::Noise;
    use std::fs;
    use std::sync::Arc;

    const TEXT: &str = "model a { param k = 1, b = 0 per run; output y = k + b; }";

    fn contents(value: f64, runs: &[&str]) -> Contents {
        let model = Model::from_text("a.fdm", TEXT).unwrap();
        let mut manifest = Manifest::new(&model, Identity::of(&model, &[], &FitOptions::default()), Noise::Diagonal);
        let data = |run: &&str| DataFile {
            run: run.to_string(),
            file: "f".into(),
            path: None,
            bytes: None,
            sha256: None,
            reading: None,
        };
        manifest.data = runs.iter().map(data).collect();
        let own = runs.iter().enumerate().map(|(k, run)| parameter("b", Some(run), 10.0 + k as f64, None));
        let parameters = std::iter::once(parameter("k", None, value, None)).chain(own).collect();
        Contents {
            manifest,
            model: TEXT.into(),
            used: Vec::new(),
            result: fit(parameters).into(),
            quality: Vec::new(),
            others: vec![("result.txt".into(), b"k is known".to_vec())],
        }
    }

    fn write(folder: &Path, value: f64) {
        contents(value, &["one"]).write(&Destination::prepare_for(folder, &[], false).unwrap()).unwrap();
    }

    fn value(folder: &Path) -> Option<f64> {
        ResultFolder::open(folder).ok().map(|r| r.parameters()[0].value)
    }

    #[test]
    fn used_files_are_kept_with_the_model() {
        let used = vec!["model b { param k = 1; let y = k; }".to_string()];
        let text = "model a { use \"model.fdm\" as b; param b0 = 0 per run; output y = b.y + b0; }";
        let model = Model::from_texts("dir/a.fdm", text, &used).unwrap();
        let manifest = Manifest::new(&model, Identity::of(&model, &[], &FitOptions::default()), Noise::Diagonal);
        let folder = tempfile::tempdir().unwrap();
        let place = Destination::prepare_for(folder.path().join("result"), &[], false).unwrap();
        Contents { manifest, model: text.into(), used, ..contents(1.0, &["one"]) }.write(&place).unwrap();
        let read = ResultFolder::open(folder.path().join("result")).unwrap();
        assert!(read.model().unwrap().source().same_texts(model.source()));
    }

    #[test]
    fn what_was_written_is_read_back_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("deep").join("result");
        write(&place, 0.1 + 0.2);
        let read = ResultFolder::open(&place).unwrap();
        let model = read.model().unwrap();
        assert_eq!(read.theta(&model, "one", None), Ok(vec![0.1 + 0.2, 10.0]));
        assert_eq!(read.theta(&model, "other", None), Ok(vec![0.1 + 0.2, 10.0]), "the only run");
        assert_eq!(fs::read_dir(folder.path().join("deep")).unwrap().count(), 1, "nothing is left beside it");
        contents(2.0, &["one", "two"]).write(&Destination::prepare_for(&place, &[], false).unwrap()).unwrap();
        let read = ResultFolder::open(&place).unwrap();
        assert_eq!(read.theta(&model, "two", None), Ok(vec![2.0, 11.0]));
        assert_eq!(read.theta(&model, "two", Some("one")), Ok(vec![2.0, 10.0]));
        let held = Changes { set: vec![("k".into(), 2.0)], fix: vec!["k".into()], free: Vec::new() };
        assert_eq!(read.held(&model), held, "the bias of each run is found anew");
        assert!(read.theta(&model, "three", None).unwrap_err().to_string().contains("choose with --like"));
        assert!(read.theta(&model, "one", Some("x")).unwrap_err().to_string().contains("only `one`, `two`"));
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn files_of_others_are_kept_and_those_with_our_names_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("result");
        let prepared = |names: &[&str], force| {
            let names: Vec<String> = names.iter().map(ToString::to_string).collect();
            Destination::prepare_for(&place, &names, force)
        };
        fs::create_dir_all(place.join("sketches")).unwrap();
        fs::write(place.join("thesis.txt"), "all of it").unwrap();
        fs::write(place.join("sketches/one.txt"), "first").unwrap();
        let ours = ["manifest.json", "model.fdm", "quality.json", "result.json", "result.txt"];
        let all = [&ours[..4], &["result.txt", "sketches", "thesis.txt"]].concat();
        for value in [1.0, 2.0] {
            contents(value, &["one"]).write(&prepared(&ours, false).unwrap()).unwrap();
            assert_eq!(ResultFolder::open(&place).unwrap().parameters()[0].value, value);
            assert_eq!(names(&place), all);
        }
        assert_eq!(fs::read_to_string(place.join("thesis.txt")).unwrap(), "all of it");
        assert_eq!(fs::read_to_string(place.join("sketches/one.txt")).unwrap(), "first");
        // a file that the next result does not have goes, unless it was changed
        let mut more = contents(3.0, &["one"]);
        more.others.extend(["a.csv", "b.csv"].map(|name| (name.to_string(), b"1".to_vec())));
        more.write(&prepared(&ours, false).unwrap()).unwrap();
        contents(4.0, &["one"]).write(&prepared(&ours, false).unwrap()).unwrap();
        assert_eq!(names(&place), all);
        // changed since it was written
        fs::write(place.join("result.txt"), "k is known, and I know it").unwrap();
        let refused = prepared(&[], false).err().unwrap().to_string();
        assert!(
            refused.contains("`result.txt` changed since fdm wrote it") && refused.contains("--force"),
            "{refused}"
        );
        contents(5.0, &["one"]).write(&prepared(&ours, true).unwrap()).unwrap();
        assert_eq!(value(&place), Some(5.0));
        // of a stranger, under a name that is needed
        fs::write(place.join("plot.svg"), "a drawing").unwrap();
        assert!(prepared(&[], false).is_ok());
        let refused = prepared(&["plot.svg"], false).err().unwrap().to_string();
        assert!(refused.contains("fdm did not write `plot.svg`"), "{refused}");
        let mut drawn = contents(6.0, &["one"]);
        drawn.others.push(("plot.svg".into(), b"<svg/>".to_vec()));
        // one that was not foreseen is found at the end
        assert!(drawn.clone().write(&prepared(&[], false).unwrap()).is_err());
        assert_eq!(
            (value(&place), fs::read_to_string(place.join("plot.svg")).unwrap().as_str()),
            (Some(5.0), "a drawing")
        );
        drawn.write(&prepared(&["plot.svg"], true).unwrap()).unwrap();
        assert_eq!(
            (value(&place), fs::read_to_string(place.join("plot.svg")).unwrap().as_str()),
            (Some(6.0), "<svg/>")
        );
    }

    #[test]
    fn what_is_no_folder_and_no_result_is_told() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Destination::prepare_for(folder.path(), &[], false).is_ok(), "empty");
        fs::write(folder.path().join("thesis.txt"), "all of it").unwrap();
        assert!(matches!(ResultFolder::open(folder.path()), Err(ResultError::Foreign { .. })));
        let file = folder.path().join("thesis.txt");
        assert!(matches!(Destination::prepare_for(file, &[], false), Err(DestinationError::Foreign { .. })));
        assert!(matches!(ResultFolder::open(folder.path().join("none")), Err(ResultError::Unreadable { .. })));
    }

    #[test]
    fn every_change_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("result");
        write(&place, 1.0);
        for name in ["manifest.json", "model.fdm", "result.json", "result.txt"] {
            let path = place.join(name);
            let whole = fs::read_to_string(&path).unwrap();
            let digit = whole.find("1").unwrap_or(3);
            let changed = format!("{}2{}", &whole[..digit], &whole[digit + 1..]);
            for broken in [changed.as_str(), &whole[..whole.len() - 2], ""] {
                fs::write(&path, broken).unwrap();
                let said = ResultFolder::open(&place).map(|_| ()).unwrap_err().to_string();
                assert!(said.contains(name) || name == "manifest.json", "{name}: {said}");
            }
            fs::remove_file(&path).unwrap();
            assert!(ResultFolder::open(&place).is_err());
            fs::write(&path, whole).unwrap();
            assert!(ResultFolder::open(&place).is_ok());
        }
    }

    #[test]
    fn other_formats_are_told() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("manifest.json"), r#"{"kind": "fdm result", "format": 1, "old": []}"#).unwrap();
        let said = ResultFolder::open(folder.path()).map(|_| ()).unwrap_err().to_string();
        assert!(said.contains("an older fdm (format 1,"), "{said}");
        fs::write(folder.path().join("manifest.json"), r#"{"kind": "fdm result", "format": 99, "new": []}"#).unwrap();
        let said = ResultFolder::open(folder.path()).map(|_| ()).unwrap_err().to_string();
        assert!(said.contains("newer fdm (format 99"), "{said}");
        assert!(Destination::prepare_for(folder.path(), &[], false).is_ok(), "it is ours and may be replaced");
    }

    /// The program dies, or the disk fails, at the n-th operation while a result is replaced, for every n; a stranger's file stands
    /// in the folder.
    #[test]
    fn the_old_result_stands_until_the_new_one_is_complete() {
        for (dies, kind) in [(true, Kind::Nothing), (true, Kind::Torn), (true, Kind::Done), (false, Kind::Nothing)] {
            for n in 0.. {
                let folder = tempfile::tempdir().unwrap();
                let place = folder.path().join("result");
                let mut first = contents(1.0, &["one"]);
                first.others.push(("a.csv".into(), b"1".to_vec()));
                first.write(&Destination::prepare_for(&place, &[], false).unwrap()).unwrap();
                fs::write(place.join("thesis.txt"), "all of it").unwrap();
                let disk = if dies { Faulty::dies(n, kind) } else { Faulty::fails_once(n, kind) };
                let written = Destination::on(Arc::new(disk.clone()), &place, &[], false)
                    .and_then(|destination| contents(2.0, &["one"]).write(&destination));
                let found = value(&place);
                match written {
                    Ok(()) => assert_eq!(found, Some(2.0), "operation {n}"),
                    Err(_) => assert!(found == Some(1.0) || found == Some(2.0), "operation {n}: nothing is left"),
                }
                assert_eq!(whole_files(&place).is_ok(), found.is_some(), "operation {n}");
                // and the next one finds its way
                write(&place, 3.0);
                assert_eq!(value(&place), Some(3.0), "operation {n}");
                let all = ["manifest.json", "model.fdm", "quality.json", "result.json", "result.txt", "thesis.txt"];
                assert_eq!(names(&place), all, "operation {n}");
                assert_eq!(names(folder.path()), ["result"], "operation {n}");
                assert_eq!(fs::read_to_string(place.join("thesis.txt")).unwrap(), "all of it");
                if !disk.failed() {
                    assert!(n > 15, "all operations were tried");
                    break;
                }
            }
        }
    }

    /// Where no folder stands yet it is not there, or whole.
    #[test]
    fn a_new_folder_appears_whole() {
        for kind in [Kind::Nothing, Kind::Torn, Kind::Done] {
            for n in 0.. {
                let folder = tempfile::tempdir().unwrap();
                let place = folder.path().join("result");
                let disk = Faulty::dies(n, kind);
                let written = Destination::on(Arc::new(disk.clone()), &place, &[], false)
                    .and_then(|destination| contents(2.0, &["one"]).write(&destination));
                assert_eq!(value(&place).is_some(), place.exists(), "operation {n}");
                assert!(written.is_err() || place.exists());
                write(&place, 3.0);
                assert_eq!((value(&place), names(folder.path())), (Some(3.0), vec!["result".into()]), "operation {n}");
                if !disk.failed() {
                    break;
                }
            }
        }
    }
}
