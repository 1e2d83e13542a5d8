//! What a program asks for with the words of the command line, of a model and runs that it holds in memory: the same options,
//! defaults, refusals and numbers. Nothing is printed.
//!
//! Words are those of the command without model and records, such as `--method=filter-error`. **Start** at [`read`] and [`fit`].

pub use crate::campaign::{RecordFile, Role};

use crate::deliver::{NamedFile, Outcome};
use crate::diagnose::{is_of_numbers, refused, search};
use crate::effects::{as_text, difference, subject_of};
use crate::failure::{Failure, as_json};
use crate::fit::{Made, Task};
use crate::load::{Records, notes, number_equal_names, read_records, told_apart};
use crate::methods::{Domain, Method};
use crate::progress::{Progress, RepeatProgress};
use crate::progress_file::Course;
use crate::{
    check, design, diagnose as diagnosis, doctor, effects as catalogues, margins, modes, profile, regress, sample,
    simulate, spectra, study,
};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, Command};
use fdm_discover::{Diagnosis, DiagnosisError};
use fdm_estimate::{Estimate, Fit, FitOptions, Halt, Iteration, Noise, UnknownName};
use fdm_lab::study::{Repeat, StudyError, series};
use fdm_readers::{Field, Topic};
use fdm_report::{
    calibration_text, check_text, design_table, diagnosis_text, doctor_text, margins_text, modes_table, profile_table,
    response_table, sample_text, study_table,
};
use fdm_results::documents::{
    DiagnosisDocument, DoctorDocument, EffectsDocument, JudgedRecords, ModelDocument, ModesDocument,
    RegressionDocument, SpectraDocument,
};
use fdm_results::store::{DataFile, Identity, Manifest, ResultFolder};
use fdm_system::record::{Assumptions, ReadOptions, RecordError, Run, Summary};
use fdm_system::{Model, ModelError};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Why a request came to nothing.
#[derive(Debug)]
pub enum Refusal {
    /// A word that the command does not know, in a sentence; the option, where one is meant.
    Words {
        /// What is wrong.
        said: String,
        /// The option that is not known, without dashes.
        unknown: Option<String>,
    },
    /// A model that cannot be read or compiled.
    Model(Box<ModelError>),
    /// Records that cannot be used, each with all its problems.
    Records(Vec<RecordError>),
    /// Anything else that is wrong with the input, one sentence each.
    Input(Vec<String>),
    /// The input may be good, but numbers went wrong.
    Numbers(String),
    /// The work was stopped before there was anything to give.
    Stopped,
}

impl From<Failure> for Refusal {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Model(e) => Self::Model(e),
            Failure::Records(errors) => Self::Records(errors),
            Failure::Input(reasons) => Self::Input(reasons),
            Failure::Strict => Self::Numbers("the records have findings, and `strict` refuses to go on".into()),
            Failure::Numbers(said) => Self::Numbers(said),
            Failure::Unwritten(file) => Self::Numbers(file.to_string()),
        }
    }
}

/// A file of a run.
#[derive(Debug, Clone)]
pub struct Source {
    /// The file, and how it is read.
    pub file: RecordFile,
    /// How files are read of which nothing else is said.
    common: ReadOptions,
}

/// A run, and the file that it was read from.
#[derive(Debug, Clone)]
pub struct Record {
    /// The samples.
    pub run: Run,
    /// The file; none of samples that were in memory.
    pub source: Option<Source>,
    /// What was found while it was read; none of samples that were in memory.
    pub summary: Option<Summary>,
}

impl Record {
    /// Samples that are in memory.
    pub fn in_memory(run: Run) -> Self {
        Self { run, source: None, summary: None }
    }

    fn file(&self) -> Option<&Path> {
        self.source.as_ref().map(|source| source.file.path.as_path())
    }

    /// Described beside files that are read in the `common` way.
    fn data_file(&self, common: &ReadOptions) -> DataFile {
        match &self.source {
            Some(Source { file, .. }) => DataFile {
                reading: Some(file.options.clone()).filter(|own| own != common),
                ..DataFile::new(&self.run.name, &file.path)
            },
            None => DataFile {
                run: self.run.name.clone(),
                file: String::new(),
                path: None,
                bytes: None,
                sha256: None,
                reading: None,
            },
        }
    }
}

/// Watches work from another thread, and stops it.
#[derive(Clone, Default)]
pub struct Watch {
    halt: Halt,
    course: Course,
}

/// How far work is.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    /// What is being done, in words.
    pub doing: String,
    /// The last iteration of the estimation at work.
    pub iteration: Option<Iteration>,
    /// What is estimated, and the values as they stand.
    pub values: Vec<(UnknownName, f64)>,
    /// Starts or repeats that have ended, and of how many; none where they are not counted.
    pub counted: Option<(usize, usize)>,
}

impl Watch {
    /// Asks the work to end with the best so far.
    pub fn stop(&self) {
        self.halt.interrupt();
    }

    /// Whether it was asked to end.
    pub fn is_stopped(&self) -> bool {
        self.halt.is_interrupted()
    }

    /// How far the work is.
    pub fn seen(&self) -> Seen {
        let course = self.course.lock();
        let (starts, of) = (course.starts.0.len(), course.starts.1);
        let counted = course.repeats.as_ref().map(|r| r.counts()).or((of > 0).then_some((starts, of)));
        Seen {
            doing: course.doing.clone(),
            iteration: course.history.last().copied(),
            values: course.names.iter().cloned().zip(course.values.iter().copied()).collect(),
            counted,
        }
    }

    fn progress(&self, limit: &crate::halt::TimeLimit) -> Progress {
        Progress::hidden(self.halt.clone().at(limit.deadline()), self.course.clone())
    }
}

/// Options that say where a result goes, which is the program's matter.
const OF_THE_COMMAND: [&str; 10] =
    ["--json", "--quiet", "--out", "--report", "--force", "--plot", "--watch", "--write", "--records", "--arviz"];

/// The arguments of a command; `fixed` stands for what the program holds.
fn parsed<A: Args>(fixed: &[String], words: &[String]) -> Result<A, Refusal> {
    let name = |word: &str| word.split('=').next().unwrap_or(word).to_string();
    if let Some(word) = words.iter().map(|w| name(w)).find(|w| OF_THE_COMMAND.contains(&w.as_str())) {
        let unknown = Some(word.trim_start_matches('-').to_string());
        return Err(Refusal::Words { said: format!("{word} is an option of the command alone"), unknown });
    }
    let command = A::augment_args(Command::new("fdm").no_binary_name(true).disable_help_flag(true));
    let matches = command.try_get_matches_from(fixed.iter().chain(words)).map_err(|e| unclear(&e))?;
    A::from_arg_matches(&matches).map_err(|e| unclear(&e))
}

/// What clap says, without its advice about a command line.
pub(crate) fn unclear(error: &clap::Error) -> Refusal {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        Some(ContextValue::Strings(texts)) => texts.first().cloned(),
        _ => None,
    };
    if error.kind() == ErrorKind::UnknownArgument
        && let Some(option) = text(ContextKind::InvalidArg)
    {
        let near = text(ContextKind::SuggestedArg).map_or(String::new(), |near| format!("; did you mean {near}?"));
        let unknown = Some(option.trim_start_matches('-').to_string());
        return Refusal::Words { said: format!("there is no option {option}{near}"), unknown };
    }
    let whole = error.render().to_string();
    let said = whole.split("\n\nUsage").next().unwrap_or(&whole).split("\n\nFor more").next().unwrap_or(&whole);
    let said = said.trim_start_matches("error: ").split_whitespace().collect::<Vec<_>>().join(" ");
    Refusal::Words { said, unknown: None }
}

/// Model and runs as the command line would name them.
fn named(model: &Model, records: &[Record]) -> Vec<String> {
    let file = |r: &Record| r.file().map_or_else(|| r.run.name.clone(), |file| file.display().to_string());
    let data = records.iter().map(|r| format!("--data={}", file(r)));
    std::iter::once(model.source().name().to_string()).chain(data).collect()
}

/// The runs, those of one name numbered.
fn runs(records: &mut [Record]) -> Vec<Run> {
    number_equal_names(records.iter_mut().map(|r| &mut r.run).collect());
    records.iter().map(|r| r.run.clone()).collect()
}

/// Validation runs, whose names differ from those of the fitted ones.
fn validation_runs(fitted: &[Record], validation: &mut [Record]) -> Vec<Run> {
    number_equal_names(validation.iter_mut().map(|r| &mut r.run).collect());
    let mut names: Vec<String> = fitted.iter().chain(&*validation).map(|r| r.run.name.clone()).collect();
    told_apart(names.iter_mut().collect(), fitted.len());
    validation.iter_mut().zip(names.drain(fitted.len()..)).for_each(|(r, name)| r.run.name = name);
    validation.iter().map(|r| r.run.clone()).collect()
}

/// What is assumed about the records and found in them.
fn judged(model: &Model, records: &[Record]) -> Option<JudgedRecords> {
    crate::load::judged(model, &read_so(records))
}

fn read_so(records: &[Record]) -> Vec<(Run, Option<Summary>)> {
    records.iter().map(|r| (r.run.clone(), r.summary.clone())).collect()
}

/// Refuses records with findings where `--strict` is among the words.
fn strictly(model: &Model, records: &[Record], asked: &Records) -> Result<(), Refusal> {
    if asked.strict {
        asked.judge(model, &read_so(records), true)?;
    }
    Ok(())
}

/// With the command that would do the same, and the records.
fn described(verb: &str, mut manifest: Manifest, (model, records): (&Model, &[Record]), words: &[String]) -> Manifest {
    manifest.command =
        ["fdm", verb].map(String::from).into_iter().chain(named(model, records)).chain(words.iter().cloned()).collect();
    manifest.reading = records.iter().find_map(|r| r.source.as_ref()).map_or(manifest.reading, |s| s.common.clone());
    manifest.data = records.iter().map(|r| r.data_file(&manifest.reading)).collect();
    manifest
}

/// The files that `--data` would read with these words, and how: patterns are written out, and a table of runs may stand among the words
/// (`--runs=FILE`). `to_simulate` runs need no outputs, and may be of any size.
///
/// # Errors
/// [`Refusal`]
pub fn sources(model: &Model, files: &[PathBuf], words: &[String], to_simulate: bool) -> Result<Vec<Source>, Refusal> {
    let data: Vec<String> = files.iter().map(|f| format!("--data={}", f.display())).collect();
    let records: Records = parsed(&data, words)?;
    let common = records.selection.options(!to_simulate);
    let found = records.every(&common, model)?;
    Ok(found.into_iter().map(|file| Source { file, common: common.clone() }).collect())
}

/// Reads runs, and says what a careful reader would mention about each. Outputs that are measured `elsewhere` (q, or nothing) may be
/// missing in all.
///
/// # Errors
/// [`Refusal`]
pub fn read(model: &Model, sources: &[Source], elsewhere: &[bool]) -> Result<Vec<(Record, Vec<String>)>, Refusal> {
    let file = |s: &Source| {
        let any_size = !s.common.require_outputs;
        RecordFile { options: ReadOptions { any_size, ..s.file.options.clone() }, ..s.file.clone() }
    };
    let files: Vec<RecordFile> = sources.iter().map(file).collect();
    let read = read_records(&files, model, elsewhere)?;
    let record = |((run, summary), source): ((Run, Summary), &Source)| {
        let notes = notes(&summary);
        (Record { run, source: Some(source.clone()), summary: Some(summary) }, notes)
    };
    Ok(read.into_iter().zip(sources).map(record).collect())
}

/// What was worked out, for people, for programs, and as the files of a folder.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Tables and sentences.
    pub text: String,
    /// What was worked out as JSON, as `--json` prints it.
    pub json: String,
    /// The files that `--out` would write, and others that the command makes.
    pub files: Vec<NamedFile>,
    /// Whether the command would end with 0.
    pub good: bool,
}

impl Answer {
    fn of(text: String, document: &impl Serialize, good: bool) -> Result<Self, Refusal> {
        Ok(Self { text, json: as_json(document)?, files: Vec::new(), good })
    }
}

/// A fit by any method.
pub struct Fitted {
    records: Vec<Record>,
    runs: Vec<Run>,
    of: Of,
    manifest: Manifest,
    whole: bool,
}

enum Of {
    /// Parameters by simulation or by transforms.
    Made(Box<Made>),
    /// Equation error.
    Regressed { model: Box<Model>, text: String, document: Box<RegressionDocument>, determined: bool },
}

/// `fdm fit`, and what it predicts of validation runs.
///
/// # Errors
/// [`Refusal`]
pub fn fit(
    model: &Model,
    mut records: Vec<Record>,
    mut validation: Vec<Record>,
    words: &[String],
    watch: &Watch,
) -> Result<Fitted, Refusal> {
    let arguments: crate::fit::Arguments = parsed(&named(model, &records), words)?;
    let model = arguments.model.untied(model)?;
    strictly(&model, &records, &arguments.records)?;
    let runs = runs(&mut records);
    let predicted = validation_runs(&records, &mut validation);
    let all: Vec<Record> = records.iter().chain(&validation).cloned().collect();
    let question = arguments.question()?;
    let described = |manifest, records: &[Record]| described("fit", manifest, (&model, records), words);
    if question.method == Method::EquationError {
        let changed =
            fdm_estimate::changed(&model, &arguments.changes()).map_err(|e| Refusal::Input(vec![e.to_string()]))?;
        let options = regress::at_once((question.domain == Domain::Frequency).then(|| arguments.frequencies()));
        let found = regress::estimates(&changed, &runs, &options);
        let (text, mut document, determined) = found.map_err(|e| Refusal::Input(vec![e.to_string()]))?;
        document.records = judged(&changed, &all);
        let manifest = Manifest::new(&changed, Identity::of(&changed, &runs, &options), Noise::Diagonal);
        let manifest = described(manifest, &records);
        let of = Of::Regressed { model: Box::new(changed), text, document: Box::new(document), determined };
        return Ok(Fitted { records, runs, of, manifest, whole: true });
    }
    let progress = watch.progress(&arguments.limit);
    let options = arguments.options(question, &model)?;
    let task = Task::new(&arguments, options, &model, &runs)?;
    let checkpoint = arguments.checkpoints.open(&task.identity, true)?;
    let found = task.work(&model, &runs, &progress.work().keeping(checkpoint.keeper()))?;
    let made = task.made(found, (&runs, &predicted), &progress)?.with_records(judged(&model, &all));
    let manifest = Manifest::new(&model, made.identity.clone(), made.noise.clone());
    let manifest = described(made.manifest(manifest), &records);
    let whole = checkpoint.close() && progress.in_time();
    Ok(Fitted { records, runs, of: Of::Made(Box::new(made)), manifest, whole })
}

impl Fitted {
    /// The model with the changes that were asked for.
    pub fn model(&self) -> &Model {
        match &self.of {
            Of::Made(made) => made.found.model(),
            Of::Regressed { model, .. } => model,
        }
    }

    /// The runs that were fitted.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// The runs that were fitted, with their files.
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// The estimate; none of equation error.
    pub fn estimate(&self) -> Option<&Estimate> {
        match &self.of {
            Of::Made(made) => Some(made.found.estimate()),
            Of::Regressed { .. } => None,
        }
    }

    /// The fit in the time domain, where there is one: responses and residuals.
    pub fn in_time(&self) -> Option<&Fit> {
        match &self.of {
            Of::Made(made) => made.found.in_time(),
            Of::Regressed { .. } => None,
        }
    }

    /// Whether the command would end with 0.
    pub fn is_good(&self) -> bool {
        self.whole
            && match &self.of {
                Of::Made(made) => made.is_good(),
                Of::Regressed { determined, .. } => *determined,
            }
    }

    fn outcome<'a>(&'a self, frequencies: &'a [Vec<f64>]) -> Outcome<'a> {
        let manifest = self.manifest.clone();
        match &self.of {
            Of::Made(made) => made.outcome(&self.runs, frequencies, manifest),
            Of::Regressed { model, text, document, determined } => {
                let found = (text.clone(), document.as_ref().clone().into(), *determined);
                regress::outcome(model, &self.runs, found, manifest)
            }
        }
    }

    fn frequencies(&self) -> Vec<Vec<f64>> {
        match &self.of {
            Of::Made(made) => made.found.frequencies(),
            Of::Regressed { .. } => Vec::new(),
        }
    }

    /// What is printed, and what goes to standard error behind it.
    pub fn text(&self) -> (String, Vec<String>) {
        let frequencies = self.frequencies();
        let Outcome { text, remarks, .. } = self.outcome(&frequencies);
        (text, remarks)
    }

    /// The files of the folder that `--out` would write.
    ///
    /// # Errors
    /// When the manifest has no text.
    pub fn files(&self) -> Result<Vec<NamedFile>, Refusal> {
        let frequencies = self.frequencies();
        self.outcome(&frequencies).files().map_err(|e| Refusal::Input(vec![e]))
    }
}

/// What `fdm validate` makes of a result in memory: shared parameters are held, biases and initial states estimated anew.
///
/// # Errors
/// [`Refusal`]
pub fn validate(files: &[NamedFile], model: &Model, runs: &[Run], watch: &Watch) -> Result<Fit, Refusal> {
    let kept = kept(files)?;
    let progress = Progress::hidden(watch.halt.clone(), watch.course.clone());
    let found = fdm_estimate::fit(model, runs, &kept.validation(model), &progress.work());
    found.map_err(|e| Refusal::Input(vec![e.to_string()]))
}

fn kept(files: &[NamedFile]) -> Result<ResultFolder, Refusal> {
    ResultFolder::from_files("the result", files).map_err(|e| Refusal::Input(vec![e.to_string()]))
}

/// The model of a result, its parameters at their declared start values.
///
/// # Errors
/// [`Refusal`]
pub fn model_of(files: &[NamedFile]) -> Result<Model, Refusal> {
    Ok(kept(files)?.model().map_err(Failure::from)?)
}

/// `fdm diagnose`: the answer, and the model's text with the accepted effects.
///
/// # Errors
/// [`Refusal`]
pub fn diagnose(
    model: &Model,
    mut records: Vec<Record>,
    mut validation: Vec<Record>,
    words: &[String],
    watch: &Watch,
) -> Result<(Answer, Diagnosis), Refusal> {
    let arguments: diagnosis::Arguments = parsed(&named(model, &records), words)?;
    let (domain, catalogue) = arguments.searched()?;
    let model = arguments.model.untied(model)?;
    strictly(&model, &records, &arguments.records)?;
    let runs = runs(&mut records);
    let predicted = validation_runs(&records, &mut validation);
    let options = arguments.options(&model, domain);
    let progress = watch.progress(&arguments.limit);
    let (found, in_time) = search(&model, (&runs, &predicted), (&catalogue, &options), &progress);
    let found = match found {
        Err(DiagnosisError::Stopped) => return Err(Refusal::Stopped),
        Err(error) if is_of_numbers(&error) => return Err(Refusal::Numbers(error.to_string())),
        found => found.map_err(refused)?,
    };
    let name = Path::new(model.source().name());
    let changed = found.extended.as_ref().map(|text| difference(model.source().text(), text, name)).unwrap_or_default();
    let all: Vec<Record> = records.iter().chain(&validation).cloned().collect();
    let document = DiagnosisDocument { records: judged(&model, &all), ..DiagnosisDocument::of(&found, None) };
    let mut text = diagnosis_text(&document);
    if !changed.is_empty() {
        text.push_str(&format!("\n{changed}"));
    }
    let json = as_json(&document)?;
    let all: Vec<Run> = runs.iter().chain(&predicted).cloned().collect();
    let noise = options.fit.options.noise.clone();
    let manifest = Manifest::of_diagnosis(&model, Identity::of(&model, &all, &options), noise);
    let mut manifest = described("diagnose", manifest, (&model, &records), words);
    let common = manifest.reading.clone();
    manifest.data.extend(validation.iter().map(|r| r.data_file(&common)));
    let files = manifest.sealed(diagnosis::files(&model, (&text, &json), &changed, &found));
    let files = files.map_err(|e| Refusal::Input(vec![e.to_string()]))?;
    Ok((Answer { text, json, files, good: in_time && !found.stopped }, found))
}

/// `fdm sample` of a result in memory, over these records or over the files that it was fitted to; the draws are the file `draws.json`, in the form that
/// ArviZ reads.
///
/// # Errors
/// [`Refusal`]
pub fn sample(
    files: &[NamedFile],
    mut records: Vec<Record>,
    words: &[String],
    watch: &Watch,
) -> Result<Answer, Refusal> {
    let arguments: sample::Arguments = parsed(&["result".to_string()], words)?;
    let given = (!records.is_empty()).then(|| runs(&mut records));
    let progress = watch.progress(&arguments.limit);
    let drawn = arguments.draw(&kept(files)?, given, &progress)?;
    let good = progress.in_time() && !watch.is_stopped() && drawn.document.is_good();
    let answer = Answer::of(sample_text(&drawn.document), &drawn.document, good)?;
    let page = fdm_report::page::sample_page(&drawn.document, &drawn.draws);
    let files = vec![
        ("draws.json".to_string(), as_json(&drawn.draws)?.into_bytes()),
        ("page.html".to_string(), page.into_bytes()),
    ];
    Ok(Answer { files, ..answer })
}

/// `fdm study --calibration`.
///
/// # Errors
/// [`Refusal`]
pub fn calibrate(model: &Model, mut records: Vec<Record>, words: &[String], watch: &Watch) -> Result<Answer, Refusal> {
    let fixed: Vec<String> = named(model, &records).into_iter().chain(["--calibration".to_string()]).collect();
    let arguments: study::Arguments = parsed(&fixed, words)?;
    let model = arguments.model.untied(model)?;
    strictly(&model, &records, &arguments.records)?;
    let runs = runs(&mut records);
    let options = arguments.options(&model)?;
    let progress = watch.progress(&arguments.limit);
    let found = arguments.calibrated((&model, &runs), &options, &progress)?;
    let good = progress.in_time() && !watch.is_stopped() && found.is_good();
    let answer = Answer::of(calibration_text(&found), &found, good)?;
    let page = fdm_report::page::calibration_page(&found);
    Ok(Answer { files: vec![("page.html".to_string(), page.into_bytes())], ..answer })
}

/// `fdm study`: the answer, and every repeat.
///
/// # Errors
/// [`Refusal`]
pub fn study(
    model: &Model,
    mut records: Vec<Record>,
    words: &[String],
    watch: &Watch,
) -> Result<(Answer, Repeats), Refusal> {
    let arguments: study::Arguments = parsed(&named(model, &records), words)?;
    let model = arguments.model.untied(model)?;
    strictly(&model, &records, &arguments.records)?;
    let runs = runs(&mut records);
    let options = arguments.options(&model)?;
    let identity = arguments.identity(&model, &runs, &options)?;
    let checkpoint = arguments.repetition.checkpoints.open(&identity, true)?;
    let progress = watch.progress(&arguments.limit);
    let first = first(&model, &runs, &options, &progress)?;
    let bootstrap = arguments.bootstrap(&first, &runs, &options)?.map_err(unstudied)?;
    let mut repeat_watch = RepeatProgress::new("", arguments.repeats as usize, true, progress.halt().clone());
    {
        let mut course = watch.course.lock();
        course.doing = "Monte Carlo repeats".into();
        course.repeats = Some(repeat_watch.remembering());
    }
    let work = repeat_watch.work().keeping(checkpoint.keeper());
    let came = |k: u64, repeat: &Repeat| repeat_watch.came(k, repeat);
    let repeats = series(arguments.repeats as usize, &work, &came, &|k| bootstrap.once(k, work.halt()));
    let found = bootstrap.study(&repeats);
    let whole = checkpoint.close() && progress.in_time();
    let good = whole && first.is_integrated() && found.is_whole() && found.converged > 0;
    let answer = Answer::of(study_table(&found), &found, good)?;
    let goals = bootstrap.goals().unwrap_or_default();
    let columns = fdm_report::repeat_columns(bootstrap.subjects(), goals, &repeats);
    let columns = columns.into_iter().map(|(name, values)| (name.to_string(), values)).collect();
    Ok((answer, Repeats { columns, repeats }))
}

/// Every repeat of a study.
pub struct Repeats {
    /// Name and values of each column of `repeats.csv`.
    pub columns: Vec<(String, Vec<f64>)>,
    /// The repeats by number; none where the study was stopped before.
    pub repeats: Vec<Option<Repeat>>,
}

fn first(model: &Model, runs: &[Run], options: &FitOptions, progress: &Progress) -> Result<Fit, Refusal> {
    fdm_estimate::fit(model, runs, options, &progress.work()).map_err(|e| Refusal::Input(vec![e.to_string()]))
}

fn unstudied(error: StudyError) -> Refusal {
    if error.is_of_numbers() { Refusal::Numbers(error.to_string()) } else { Refusal::Input(vec![error.to_string()]) }
}

/// `fdm profile`.
///
/// # Errors
/// [`Refusal`]
pub fn profile(model: &Model, mut records: Vec<Record>, words: &[String], watch: &Watch) -> Result<Answer, Refusal> {
    let arguments: profile::Arguments = parsed(&named(model, &records), words)?;
    let model = arguments.model.untied(model)?;
    arguments.are_known(&model)?;
    strictly(&model, &records, &arguments.records)?;
    let runs = runs(&mut records);
    let progress = watch.progress(&arguments.limit);
    let profiled = arguments.work(&model, &runs, &progress)?;
    let profiles = profiled.profiles.map_err(|e| if watch.is_stopped() { Refusal::Stopped } else { unstudied(e) })?;
    let good = progress.in_time() && !watch.is_stopped() && profiled.found.is_integrated();
    Answer::of(profile_table(&profiles), &profiles, good)
}

/// `fdm design`, with the inputs of the planned runs as files; a result gives parameters and noise.
///
/// # Errors
/// [`Refusal`]
pub fn design(
    model: &Model,
    mut records: Vec<Record>,
    result: Option<&[NamedFile]>,
    words: &[String],
    watch: &Watch,
) -> Result<Answer, Refusal> {
    let arguments: design::Arguments = parsed(&named(model, &records), words)?;
    let model = arguments.model.changed(model)?;
    let folder = result.map(kept).transpose()?;
    let question = arguments.question(&model, folder.as_ref(), runs(&mut records))?;
    let progress = watch.progress(&arguments.limit);
    progress.say("comparing manoeuvres");
    let found = fdm_lab::design::design(&question, progress.halt()).map_err(Refusal::Input)?;
    let answer = Answer::of(design_table(&found, &model), &found, progress.in_time() && !watch.is_stopped())?;
    Ok(Answer { files: design::planned(&question, &found), ..answer })
}

/// `fdm spectra`.
///
/// # Errors
/// [`Refusal`]
pub fn spectra(model: &Model, mut records: Vec<Record>, words: &[String]) -> Result<Answer, Refusal> {
    let arguments: spectra::Arguments = parsed(&named(model, &records), words)?;
    let channels = arguments.channels(model)?;
    strictly(model, &records, &arguments.records)?;
    let (found, names) = arguments.responses(model, &runs(&mut records), &channels)?;
    Answer::of(response_table(&found, &names), &SpectraDocument::of(&found, &names), true)
}

/// `fdm modes` at the values of the parameters.
///
/// # Errors
/// [`Refusal`]
pub fn modes(model: &Model) -> Result<Answer, Refusal> {
    let (trim, modes) = modes::modes(model)?;
    let document = ModesDocument::of(model, &trim, &modes, &[]);
    Answer::of(modes_table(&document), &document, true)
}

/// `fdm margins` of a result in memory.
///
/// # Errors
/// [`Refusal`]
pub fn margins(files: &[NamedFile], words: &[String]) -> Result<Answer, Refusal> {
    let arguments: margins::Arguments = parsed(&["result".to_string()], words)?;
    let found = arguments.asked.margins(&kept(files)?)?;
    Answer::of(margins_text(&found), &found, found.is_good())
}

/// The response of a run.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// Outputs (N by q); NaN behind a divergence.
    pub response: Vec<f64>,
    /// How it was integrated, in words.
    pub integration: String,
    /// What makes the numbers wrong; empty when nothing does.
    pub faults: Vec<String>,
}

/// `fdm simulate`: one run, at the parameters of the model unless others are among the words.
///
/// # Errors
/// [`Refusal`]
pub fn simulate(model: &Model, run: &Run, words: &[String]) -> Result<Simulated, Refusal> {
    let fixed = [model.source().name().to_string(), format!("--data={}", run.name)];
    let arguments: simulate::Arguments = parsed(&fixed, words)?;
    let model = arguments.model.changed(model)?;
    let response = simulate::respond(&model, run, None, &arguments)?;
    let (integration, faults) = (arguments.integration.said(&response.accuracy), response.faults(&model));
    Ok(Simulated { response: response.y, integration, faults })
}

/// `fdm check` of a model that compiles: every derivative against a complex step.
///
/// # Errors
/// [`Refusal`]
pub fn check(model: &Model) -> Result<Answer, Refusal> {
    let found = check::verified(model);
    Answer::of(check_text(model, &found), &ModelDocument::of(model, &found), found.passed())
}

/// What `fdm doctor` finds.
pub struct Judged {
    arguments: doctor::Arguments,
    records: Vec<fdm_doctor::Record>,
    document: DoctorDocument,
}

impl Judged {
    /// What is printed; good where nothing but remarks was found.
    ///
    /// # Errors
    /// [`Refusal`]
    pub fn answer(&self) -> Result<Answer, Refusal> {
        Answer::of(doctor_text(&self.document), &self.document, self.document.is_clean())
    }

    /// The page: each finding with its channel drawn.
    pub fn page(&self) -> String {
        fdm_report::page::doctor_page(&self.document, &self.records)
    }

    /// The map with all repairs that a map can hold.
    pub fn map(&self) -> String {
        self.arguments.map(&self.records, &self.document)
    }
}

/// A table of samples in memory: each field with its name, unit and values (N).
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// What messages call it.
    pub name: String,
    /// The field that is its time, where it has one.
    pub time: Option<usize>,
    /// The fields.
    pub fields: Vec<(String, Option<String>, Vec<f64>)>,
}

/// `fdm doctor` beside a model.
///
/// # Errors
/// [`Refusal`]
pub fn doctor(model: &Model, mut records: Vec<Record>, words: &[String], watch: &Watch) -> Result<Judged, Refusal> {
    let arguments = doctor_arguments(&named(model, &records), words)?;
    let summaries: Vec<Option<Summary>> = records.iter().map(|r| r.summary.clone()).collect();
    let progress = watch.progress(&arguments.limit);
    let read = runs(&mut records).into_iter().zip(summaries).collect();
    let (records, document) = arguments.beside(model, read, &progress);
    Ok(Judged { arguments, records, document })
}

/// `fdm doctor` without a model: every table of every file, and tables in memory behind them.
///
/// # Errors
/// [`Refusal`]
pub fn doctor_alone(files: &[PathBuf], tables: Vec<Table>, words: &[String]) -> Result<Judged, Refusal> {
    let data = files.iter().map(|f| f.display().to_string()).chain(tables.iter().map(|t| t.name.clone()));
    let arguments = doctor_arguments(&data.map(|d| format!("--data={d}")).collect::<Vec<_>>(), words)?;
    let mut all = doctor::tables(files, arguments.is_salvaged())?;
    all.extend(tables.into_iter().map(|table| {
        let fields = table.fields.into_iter().map(|(name, unit, values)| Field { name, unit, values });
        let topic = Topic { name: String::new(), time: table.time, fields: fields.collect() };
        (Assumptions::of_samples(&table.name, "arrays", topic.rows()), topic)
    }));
    let (records, document) = arguments.of_tables(all);
    Ok(Judged { arguments, records, document })
}

fn doctor_arguments(fixed: &[String], words: &[String]) -> Result<doctor::Arguments, Refusal> {
    let arguments: doctor::Arguments = parsed(fixed, words)?;
    match &arguments.fix {
        None => Ok(arguments),
        Some(_) => Err(Refusal::Words {
            said: "--fix is an option of the command alone: the result has the map".into(),
            unknown: Some("fix".into()),
        }),
    }
}

/// `fdm effects`.
///
/// # Errors
/// [`Refusal`]
pub fn effects(model: &Model, words: &[String]) -> Result<Answer, Refusal> {
    let arguments: catalogues::Arguments = parsed(&named(model, &[]), words)?;
    let catalogue = arguments.catalogue()?;
    let places = catalogue.places(&subject_of(model)?);
    Answer::of(as_text(&catalogue, &places, false), &EffectsDocument::of(&catalogue, &places), true)
}

/// `fdm extend`: the text of the model with the effects in it, and what changes.
///
/// # Errors
/// [`Refusal`]
pub fn extend(model: &Model, words: &[String]) -> Result<(String, String), Refusal> {
    let arguments: catalogues::Extend = parsed(&named(model, &[]), words)?;
    let extended = arguments.applied(subject_of(model)?)?;
    let new = extended.source().text().to_string();
    let changes = difference(model.source().text(), &new, Path::new(model.source().name()));
    Ok((new, changes))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "model decay { state x = 1; param k = 0.2 [1/s]; der(x) = -k*x; output y = x; }";

    fn record(model: &Model) -> Record {
        let times: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k)).collect();
        let y: Vec<f64> = times.iter().map(|t| (-0.5 * t).exp() + 1e-3 * (37.0 * t).sin()).collect();
        let run = model.run("a").times(times).samples("y", y).build().expect("a run");
        Record::in_memory(run)
    }

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(ToString::to_string).collect()
    }

    fn refused(asked: &[&str]) -> String {
        let model = Model::from_text("decay.fdm", TEXT).expect("a model");
        match fit(&model, vec![record(&model)], vec![], &words(asked), &Watch::default()) {
            Err(Refusal::Words { said, .. }) => said,
            Err(Refusal::Input(said)) => said.join("; "),
            Err(other) => format!("{other:?}"),
            Ok(_) => panic!("{asked:?} was taken"),
        }
    }

    #[test]
    fn a_fit_in_memory_is_that_of_the_same_options() {
        let model = Model::from_text("decay.fdm", TEXT).expect("a model");
        let found =
            fit(&model, vec![record(&model)], vec![], &words(&["--set=k=0.9"]), &Watch::default()).expect("a fit");
        let changes = fdm_estimate::Changes { set: vec![("k".into(), 0.9)], ..Default::default() };
        let options = FitOptions { changes, ..FitOptions::default() };
        let other =
            fdm_estimate::fit(&model, &[record(&model).run], &options, &fdm_estimate::Work::default()).expect("a fit");
        let value = |e: &Estimate| e.parameters[0].value.to_bits();
        assert_eq!(found.estimate().map(value), Some(value(&other.estimate)));
        let files = found.files().expect("files");
        let kept = ResultFolder::from_files("memory", &files).expect("a result");
        assert_eq!(kept.parameters()[0].value.to_bits(), value(&other.estimate));
        assert_eq!(kept.runs(), ["a"]);
        let predicted = validate(&files, &model, &[record(&model).run], &Watch::default()).expect("a prediction");
        assert_eq!(value(&predicted.estimate), value(&other.estimate));
    }

    #[test]
    fn words_are_refused_as_on_the_command_line() {
        assert_eq!(refused(&["--metod=output-error"]), "there is no option --metod; did you mean --method?");
        assert!(refused(&["--method=output"]).contains("invalid value 'output'"));
        assert!(refused(&["--coherence=0.5"]).contains("or use --method frequency-response"));
        assert!(refused(&["--fix=kk"]).contains("did you mean `k`?"));
        assert_eq!(refused(&["--out=x"]), "--out is an option of the command alone");
    }

    #[test]
    fn work_that_is_stopped_gives_the_best_so_far() {
        let model = Model::from_text("decay.fdm", TEXT).expect("a model");
        let watch = Watch::default();
        watch.stop();
        let found = fit(&model, vec![record(&model)], vec![], &[], &watch).expect("a fit");
        assert!(!found.is_good());
        assert_eq!(found.estimate().map(|e| e.parameters[0].value), Some(0.2));
        assert_eq!(watch.seen().iteration.map(|i| i.number), Some(0));
    }
}
