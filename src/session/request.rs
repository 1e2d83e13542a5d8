//! What a program asks for with the words of the command line, of a model and runs that it holds in memory: the same options,
//! defaults, refusals and numbers. Nothing is printed.
//!
//! Words are those of the command without model and records, such as `--method=filter-error`. **Start** at [`read`] and [`fit`].

pub use crate::campaign::{RecordFile, Role};
pub use crate::doctor::Judged;
pub use crate::{Answer, Failure, Record, Source};
pub use fdm_readers::{Field, Topic};

use crate::answer::{NamedFile, Wanted};
use crate::conduct::Conduct;
use crate::effects::{as_text, difference, subject_of};
use crate::failure::OrFailure;
use crate::progress_file::Course;
use crate::records::{ReadRun, Records, notes, read_records, record};
use crate::session::{Origin, Session};
use crate::verb::Verb;
use crate::{
    check as checks, design as designs, diagnose as diagnoses, doctor as doctors, effects as catalogues, fit as fits,
    margins as uses, modes as eigenvalues, profile as profiles, sample as samples, simulate as simulations,
    spectra as responses, study as studies,
};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, Command};
use fdm_estimate::{Fit, Halt, Identified, Iteration, UnknownName};
use fdm_infer::Diagnosis;

use fdm_report::study_table;
use fdm_results::documents::EffectsDocument;
use fdm_results::store::ResultFolder;
use fdm_system::Model;
use fdm_system::record::{Assumptions, ReadOptions, Run};
use std::path::{Path, PathBuf};

/// Text and JSON.
const DOCUMENT: Wanted = Wanted { json: true, files: false, folder: false, plot: false, verbose: false };
/// The files of a folder, and JSON.
const FILES: Wanted = Wanted { files: true, ..DOCUMENT };

/// What a program holds, and what it asks for.
pub struct Held<'h> {
    /// The model.
    pub model: &'h Model,
    /// Runs.
    pub records: Vec<Record>,
    /// Runs that are not fitted.
    pub validation: Vec<Record>,
    /// The words of the command.
    pub words: &'h [String],
}

impl Held<'_> {
    /// Model and runs as the command line would name them.
    fn named(&self) -> Vec<String> {
        named(self.model, self.records.iter().map(|r| (&r.run, &r.origin)))
    }

    /// The runs, of a model for them.
    fn session(self, model: Model) -> Session {
        Session::new(model, self.records, self.validation)
    }

    /// The options of a verb, the session that it works on, and how it works.
    fn asked<V: Verb + Args>(
        self,
        verb: &str,
        (watch, wanted): (&Watch, Wanted),
    ) -> Result<(V, Session, Conduct), Failure> {
        let options: V = parsed(&self.named(), self.words)?;
        let (given, words) = (options.given(), self.words.to_vec());
        let conduct = watch.conduct(wanted).within(given.limit);
        let model = given.model.untied(self.model)?;
        let session = self.session(model).judged(given.records.strict, true)?;
        let named = named(&session.model, session.fitted());
        let command = ["fdm", verb].map(String::from).into_iter().chain(named).chain(words);
        Ok((options, session.of_command(command.collect()), conduct))
    }
}

/// A model and runs as the command line would name them.
fn named<'r>(model: &Model, runs: impl Iterator<Item = (&'r Run, &'r Origin)>) -> Vec<String> {
    let data = runs.map(|(run, origin)| match &origin.source {
        Some(source) => format!("--data={}", source.file.path.display()),
        None => format!("--data={}", run.name),
    });
    std::iter::once(model.source().name().to_string()).chain(data).collect()
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

    /// An answer, which is not good where the work was asked to end.
    fn unstopped(&self, answer: Answer) -> Answer {
        Answer { good: answer.good && !self.is_stopped(), ..answer }
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

    /// Work that is watched, with what is wanted of its answer.
    pub fn conduct(&self, wanted: Wanted) -> Conduct {
        Conduct::hidden(self.halt.clone(), self.course.clone(), wanted)
    }
}

/// Options that say where a result goes, which is the program's matter.
const OF_THE_COMMAND: [&str; 11] = [
    "--json",
    "--quiet",
    "--verbose",
    "--out",
    "--report",
    "--force",
    "--plot",
    "--watch",
    "--write",
    "--records",
    "--arviz",
];

/// The arguments of a command; `fixed` stands for what the program holds.
///
/// # Errors
/// [`Failure::Words`], for words that the command does not know, and for those that say where a result goes.
pub fn parsed<A: Args>(fixed: &[String], words: &[String]) -> Result<A, Failure> {
    let name = |word: &str| word.split('=').next().unwrap_or(word).to_string();
    if let Some(word) = words.iter().map(|w| name(w)).find(|w| OF_THE_COMMAND.contains(&w.as_str())) {
        let unknown = Some(word.trim_start_matches('-').to_string());
        return Err(Failure::Words { said: format!("{word} is an option of the command alone"), unknown });
    }
    let command = A::augment_args(Command::new("fdm").no_binary_name(true).disable_help_flag(true));
    let matches = command.try_get_matches_from(fixed.iter().chain(words)).map_err(|e| unclear(&e))?;
    A::from_arg_matches(&matches).map_err(|e| unclear(&e))
}

/// What the parser of the command line says, without its advice about a command line.
pub fn unclear(error: &clap::Error) -> Failure {
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
        return Failure::Words { said: format!("there is no option {option}{near}"), unknown };
    }
    let whole = error.render().to_string();
    let said = whole.split("\n\nUsage").next().unwrap_or(&whole).split("\n\nFor more").next().unwrap_or(&whole);
    let said = said.trim_start_matches("error: ").split_whitespace().collect::<Vec<_>>().join(" ");
    Failure::Words { said, unknown: None }
}

/// The files that `--data` would read with these words, and how: patterns are written out, and a table of runs may stand among the words
/// (`--runs=FILE`). `to_simulate` runs need no outputs, and may be of any size.
///
/// # Errors
/// [`Failure`]
pub fn sources(model: &Model, files: &[PathBuf], words: &[String], to_simulate: bool) -> Result<Vec<Source>, Failure> {
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
/// [`Failure`]
pub fn read(model: &Model, sources: &[Source], elsewhere: &[bool]) -> Result<Vec<(Record, Vec<String>)>, Failure> {
    let file = |s: &Source| {
        let any_size = !s.common.require_outputs;
        RecordFile { options: ReadOptions { any_size, ..s.file.options.clone() }, ..s.file.clone() }
    };
    let files: Vec<RecordFile> = sources.iter().map(file).collect();
    let read = read_records(&files, model, elsewhere)?;
    let common = |file: &RecordFile| sources.iter().find(|s| s.file.path == file.path).map(|s| &s.common);
    let one = |(read, file): ReadRun| {
        let (said, common) = (notes(&read.1), common(&file).cloned().unwrap_or_default());
        // what is read again has squares that are taken, unless it is only simulated
        let options = ReadOptions { any_size: false, ..file.options };
        (record(read, RecordFile { options, ..file }, &common), said)
    };
    Ok(read.into_iter().map(one).collect())
}

/// A fit by any method.
pub struct Fitted {
    /// What was fitted.
    pub session: Session,
    /// What the method found.
    pub found: Identified,
    /// What is told, with the files of a folder.
    pub answer: Answer,
}

/// `fdm fit`, and what it predicts of validation runs.
///
/// # Errors
/// [`Failure`]
pub fn fit(held: Held<'_>, watch: &Watch) -> Result<Fitted, Failure> {
    let wanted = Wanted { json: false, ..FILES };
    let (options, session, mut conduct) = held.asked::<fits::Options>("fit", (watch, wanted))?;
    let session = options.limited(session)?;
    let fits::Fitted { found, answer } = fits::answer(&options, &session, &mut conduct)?;
    Ok(Fitted { session, found, answer })
}

/// What `fdm validate` makes of a result in memory: shared parameters are held, biases and initial states estimated anew.
///
/// # Errors
/// [`Failure`]
pub fn validate(files: &[NamedFile], model: &Model, runs: &[Run], watch: &Watch) -> Result<Fit, Failure> {
    let (kept, conduct) = (kept(files)?, watch.conduct(DOCUMENT));
    fdm_estimate::fit(model, runs, &kept.validation(model), &conduct.progress.work()).or_failure()
}

fn kept(files: &[NamedFile]) -> Result<ResultFolder, Failure> {
    ResultFolder::from_files("the result", files).or_failure()
}

/// The model of a result, its parameters at their declared start values.
///
/// # Errors
/// [`Failure`]
pub fn model_of(files: &[NamedFile]) -> Result<Model, Failure> {
    Ok(kept(files)?.model()?)
}

/// `fdm diagnose`: the answer, and what was found.
///
/// # Errors
/// [`Failure`]
pub fn diagnose(held: Held<'_>, watch: &Watch) -> Result<(Answer, Diagnosis), Failure> {
    let (options, session, mut conduct) = held.asked::<diagnoses::Options>("diagnose", (watch, FILES))?;
    let diagnosed = diagnoses::diagnose(&options, &session, &mut conduct)?;
    Ok((diagnosed.answer(None, FILES)?, diagnosed.found))
}

/// `fdm sample` of a result in memory, over these runs or over the files that it was fitted to; the draws are the file `draws.json`, in the form that
/// ArviZ reads.
///
/// # Errors
/// [`Failure`]
pub fn sample(files: &[NamedFile], records: Vec<Record>, words: &[String], watch: &Watch) -> Result<Answer, Failure> {
    let options: samples::Options = parsed(&["result".to_string()], words)?;
    let folder = kept(files)?;
    let given = match records.is_empty() {
        true => None,
        false => Some(Session::new(folder.model()?, records, Vec::new()).runs),
    };
    let mut conduct = watch.conduct(FILES).within(&options.limit);
    Ok(watch.unstopped(samples::draw(&options, &folder, given, &mut conduct)?))
}

/// `fdm study`: the answer, and the columns of `repeats.csv`.
///
/// # Errors
/// [`Failure`]
pub fn study(held: Held<'_>, watch: &Watch) -> Result<(Answer, studies::Columns), Failure> {
    let (options, session, mut conduct) = held.asked::<studies::Options>("study", (watch, Wanted::default()))?;
    let studies::Studied { answer, study, columns } = studies::study(&options, &session, &mut conduct)?;
    Ok((Answer { good: answer.good, ..Answer::of(study_table(&study), &study, DOCUMENT)? }, columns))
}

/// What a verb answers that gives nothing but an answer: `profile`, or `study` (with `--calibration` among the words).
///
/// # Errors
/// [`Failure`]; [`Failure::Stopped`], where it was stopped before there was anything to give.
pub fn ask(verb: &str, held: Held<'_>, watch: &Watch) -> Result<Answer, Failure> {
    match verb {
        "profile" => answered::<profiles::Options>(verb, held, watch),
        "study" => answered::<studies::Options>(verb, held, watch),
        _ => Err(Failure::input([format!("`{verb}` gives more than an answer, or is no verb")])),
    }
}

fn answered<V: Verb + Args>(verb: &str, held: Held<'_>, watch: &Watch) -> Result<Answer, Failure> {
    let (options, session, mut conduct) = held.asked::<V>(verb, (watch, FILES))?;
    match options.answer(&session, &mut conduct) {
        Err(Failure::Astray { said, .. }) if watch.is_stopped() => Err(Failure::Stopped(said)),
        found => Ok(watch.unstopped(found?)),
    }
}

/// `fdm design`, with the inputs of the planned runs as files; a result gives parameters and noise.
///
/// # Errors
/// [`Failure`]
pub fn design(held: Held<'_>, result: Option<&[NamedFile]>, watch: &Watch) -> Result<Answer, Failure> {
    let options: designs::Options = parsed(&held.named(), held.words)?;
    let model = options.model.changed(held.model)?;
    let folder = result.map(kept).transpose()?;
    let Session { model, runs, .. } = held.session(model);
    let mut conduct = watch.conduct(DOCUMENT).within(&options.limit);
    Ok(watch.unstopped(designs::design(&options, (&model, folder.as_ref()), runs, &mut conduct)?))
}

/// `fdm spectra`.
///
/// # Errors
/// [`Failure`]
pub fn spectra(held: Held<'_>) -> Result<Answer, Failure> {
    let options: responses::Options = parsed(&held.named(), held.words)?;
    let model = held.model.clone();
    let session = held.session(model).judged(options.records.strict, true)?;
    responses::answer(&options, &session, DOCUMENT)
}

/// `fdm modes` at the values of the parameters.
///
/// # Errors
/// [`Failure`]
pub fn modes(model: &Model) -> Result<Answer, Failure> {
    eigenvalues::of_model(model, None, DOCUMENT)
}

/// `fdm margins` of a result in memory.
///
/// # Errors
/// [`Failure`]
pub fn margins(files: &[NamedFile], words: &[String]) -> Result<Answer, Failure> {
    let options: uses::Options = parsed(&[], words)?;
    uses::answer(&options, &kept(files)?, DOCUMENT)
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
/// [`Failure`]
pub fn simulate(model: &Model, run: &Run, words: &[String]) -> Result<Simulated, Failure> {
    let fixed = [model.source().name().to_string(), format!("--data={}", run.name)];
    let options: simulations::Options = parsed(&fixed, words)?;
    let model = options.model.changed(model)?;
    let response = simulations::respond(&model, run, None, &options)?;
    let (integration, faults) = (options.integration.said(&response.accuracy), response.faults(&model));
    Ok(Simulated { response: response.y, integration, faults })
}

/// `fdm check` of a model that compiles: every derivative against a complex step.
///
/// # Errors
/// [`Failure`]
pub fn check(model: &Model) -> Result<Answer, Failure> {
    checks::answer(model, DOCUMENT)
}

/// `fdm doctor` beside a model: what it finds, what is told of it, and the map with all repairs that a map can hold.
///
/// # Errors
/// [`Failure`]
pub fn doctor(held: Held<'_>, watch: &Watch) -> Result<(Judged, Answer, String), Failure> {
    let options = doctor_options(&held.named(), held.words)?;
    let conduct = watch.conduct(DOCUMENT).within(&options.limit);
    let model = held.model.clone();
    told(&options, options.beside(&held.session(model), &conduct))
}

/// `fdm doctor` without a model: every table of every file, and tables in memory behind them, each with what messages call it.
///
/// # Errors
/// [`Failure`]
pub fn doctor_alone(
    files: &[PathBuf],
    tables: Vec<(String, Topic)>,
    words: &[String],
) -> Result<(Judged, Answer, String), Failure> {
    let data = files.iter().map(|f| f.display().to_string()).chain(tables.iter().map(|(name, _)| name.clone()));
    let options = doctor_options(&data.map(|d| format!("--data={d}")).collect::<Vec<_>>(), words)?;
    let in_memory = |(name, topic): (String, Topic)| (Assumptions::of_samples(&name, "arrays", topic.rows()), topic);
    told(&options, options.judged_alone(files, tables.into_iter().map(in_memory).collect())?)
}

fn told(options: &doctors::Options, judged: Judged) -> Result<(Judged, Answer, String), Failure> {
    let (answer, map) = (judged.answer(DOCUMENT)?, options.map(&judged));
    Ok((judged, answer, map))
}

fn doctor_options(fixed: &[String], words: &[String]) -> Result<doctors::Options, Failure> {
    let options: doctors::Options = parsed(fixed, words)?;
    match &options.fix {
        None => Ok(options),
        Some(_) => Err(Failure::Words {
            said: "--fix is an option of the command alone: the result has the map".into(),
            unknown: Some("fix".into()),
        }),
    }
}

/// `fdm effects`.
///
/// # Errors
/// [`Failure`]
pub fn effects(model: &Model, words: &[String]) -> Result<Answer, Failure> {
    let options: catalogues::Options = parsed(&named(model, std::iter::empty()), words)?;
    let catalogue = options.catalogue()?;
    let places = catalogue.places(&subject_of(model)?);
    Answer::of(as_text(&catalogue, &places, false), &EffectsDocument::of(&catalogue, &places), DOCUMENT)
}

/// `fdm extend`: the text of the model with the effects in it, and what changes.
///
/// # Errors
/// [`Failure`]
pub fn extend(model: &Model, words: &[String]) -> Result<(String, String), Failure> {
    let options: catalogues::Extend = parsed(&named(model, std::iter::empty()), words)?;
    let extended = options.applied(subject_of(model)?)?;
    let new = extended.source().text().to_string();
    let changes = difference(model.source().text(), &new, Path::new(model.source().name()));
    Ok((new, changes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_estimate::{Estimate, FitOptions};

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

    fn fitted(model: &Model, words: &[String], watch: &Watch) -> Result<Fitted, Failure> {
        fit(Held { model, records: vec![record(model)], validation: Vec::new(), words }, watch)
    }

    fn refused(asked: &[&str]) -> String {
        let model = Model::from_text("decay.fdm", TEXT).expect("a model");
        match fitted(&model, &words(asked), &Watch::default()) {
            Err(Failure::Words { said, .. }) => said,
            Err(Failure::Input(said)) => said.join("; "),
            Err(other) => format!("{other:?}"),
            Ok(_) => panic!("{asked:?} was taken"),
        }
    }

    #[test]
    fn a_fit_in_memory_is_that_of_the_same_options() {
        let model = Model::from_text("decay.fdm", TEXT).expect("a model");
        let found = fitted(&model, &words(&["--set=k=0.9"]), &Watch::default()).expect("a fit");
        let changes = fdm_estimate::Changes { set: vec![("k".into(), 0.9)], ..Default::default() };
        let options = FitOptions { changes, ..FitOptions::default() };
        let other =
            fdm_estimate::fit(&model, &[record(&model).run], &options, &fdm_estimate::Work::default()).expect("a fit");
        let value = |e: &Estimate| e.parameters[0].value.to_bits();
        assert_eq!(found.found.estimate().map(value), Some(value(&other.estimate)));
        let files = found.answer.files;
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
        let found = fitted(&model, &[], &watch).expect("a fit");
        assert!(!found.answer.good);
        assert_eq!(found.found.estimate().map(|e| e.parameters[0].value), Some(0.2));
        assert_eq!(watch.seen().iteration.map(|i| i.number), Some(0));
    }
}
