//! Verbs at work: each in a thread, watched and stopped from any window, its result in a folder that the command line reads.

use crate::folder::Folder;
use crate::http::{Refusal, Status};
use crate::{Completed, Studio};
use clap::Args;
use fdm_report::page::duration;
use fdm_results::store::{Destination, make_folder, write_file};
use fdm_session::doctor::{self, Judged, judge};
use fdm_session::failure::{Failure, OrFailure};
use fdm_session::request::{Watch, parsed};
use fdm_session::verb::answered;
use fdm_session::{Answer, Verb, Wanted, design, diagnose, fit, profile};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Work that goes on at once: more would only share the processors.
const MOST_AT_WORK: usize = 2;
/// Work that has ended and is remembered.
const REMEMBERED: usize = 20;
/// The options that say where results and planned runs are written.
const OUT: &str = "--out=";
const RECORDS: &str = "--records=";
/// A folder's files, and the document.
const WHOLE: Wanted = Wanted { json: true, files: true, folder: true, plot: false, verbose: false };

/// What is asked for.
#[derive(Debug, Deserialize)]
pub(crate) struct Asked {
    pub(crate) verb: String,
    /// Words of the command behind the verb.
    pub(crate) words: Vec<String>,
}

/// Work, and what came of it.
pub(crate) struct Job {
    id: u64,
    verb: String,
    command: Vec<String>,
    /// The result, relative to the folder; none of verbs without one.
    place: Option<String>,
    watch: Watch,
    begun: Instant,
    ended: Mutex<Option<Ended>>,
}

/// What came of work.
#[derive(Debug, Clone, Serialize)]
struct Ended {
    /// Whether all is well.
    good: bool,
    /// Whether the result stands in its place.
    kept: bool,
    /// What the command prints.
    text: String,
    took: String,
}

/// What windows are shown of work.
#[derive(Debug, Serialize)]
pub(crate) struct Shown {
    id: u64,
    verb: String,
    command: String,
    place: Option<String>,
    /// What is being done, in words.
    doing: String,
    iteration: Option<usize>,
    cost: Option<f64>,
    values: Vec<(String, f64)>,
    counted: Option<(usize, usize)>,
    stopped: bool,
    ended: Option<Ended>,
}

/// All work of this process, the oldest first.
#[derive(Default)]
pub(crate) struct Jobs {
    all: Mutex<(u64, Vec<Arc<Job>>)>,
    /// What the doctor found last, with the options that it was asked with.
    pub(crate) judged: Mutex<Option<(doctor::Options, Judged)>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Job {
    fn at_work(&self) -> bool {
        locked(&self.ended).is_none()
    }

    fn shown(&self) -> Shown {
        let seen = self.watch.seen();
        Shown {
            id: self.id,
            verb: self.verb.clone(),
            command: typed(&self.command),
            place: self.place.clone(),
            doing: seen.doing,
            iteration: seen.iteration.map(|i| i.number),
            cost: seen.iteration.map(|i| i.cost).filter(|c| c.is_finite()),
            values: seen.values.iter().map(|(n, v)| (n.name.clone(), *v)).collect(),
            counted: seen.counted,
            stopped: self.watch.is_stopped(),
            ended: locked(&self.ended).clone(),
        }
    }
}

impl Jobs {
    pub(crate) fn shown(&self) -> Vec<Shown> {
        locked(&self.all).1.iter().map(|job| job.shown()).collect()
    }

    pub(crate) fn any_at_work(&self) -> bool {
        locked(&self.all).1.iter().any(|job| job.at_work())
    }

    /// Work ends with the best so far.
    pub(crate) fn stop(&self, id: u64) -> Result<(), Refusal> {
        let all = locked(&self.all);
        let job = all.1.iter().find(|job| job.id == id);
        job.map(|job| job.watch.stop()).ok_or_else(|| Refusal::new(Status::NotFound, "there is no such work"))
    }

    /// Begins work; what is wrong with its words is told at once.
    pub(crate) fn begin(studio: &Arc<Studio>, asked: &Asked) -> Result<u64, Refusal> {
        let Asked { verb, words } = asked;
        studio.folder.refuse_outside(words)?;
        if let Some(word) = words.iter().find(|w| w.starts_with("--checkpoint")) {
            return Err(Refusal::wrong(format!(
                "{word}: results are kept in the folder; type the command in a terminal"
            )));
        }
        let own = &studio.jobs;
        let mut all = locked(&own.all);
        if all.1.iter().filter(|job| job.at_work()).count() >= MOST_AT_WORK {
            return Err(Refusal::new(Status::Busy, "other work goes on: wait for its end, or stop it"));
        }
        let place = match verb.as_str() {
            "doctor" => None,
            "fit" | "diagnose" | "profile" | "design" => Some(studio.folder.new_result(verb)?),
            _ => return Err(Refusal::wrong(format!("{verb}: fit, diagnose, profile, design and doctor work here"))),
        };
        let option = if verb == "design" { RECORDS } else { OUT };
        let out = place.as_ref().map(|place| format!("{option}{place}"));
        let typed = ["fdm".to_string(), verb.clone()].into_iter().chain(words.iter().cloned()).chain(out);
        let command: Vec<String> = typed.collect();
        let whole = (studio.doors.completed)(command.clone())?;
        all.0 += 1;
        let (id, watch) = (all.0, Watch::default());
        let job = Job { id, verb: verb.clone(), command, place, watch, begun: Instant::now(), ended: Mutex::default() };
        let job = Arc::new(job);
        let surplus = all.1.len().saturating_sub(REMEMBERED);
        all.1.retain({
            let mut left = surplus;
            move |job| {
                let drop = left > 0 && !job.at_work();
                left -= usize::from(drop);
                !drop
            }
        });
        all.1.push(Arc::clone(&job));
        drop(all);
        let studio = Arc::clone(studio);
        let work = move || {
            let ended = worked(&studio, &job, &whole);
            let took = duration(job.begun.elapsed().as_secs_f64());
            *locked(&job.ended) = Some(match ended {
                Ok(answer) => Ended { good: answer.good, kept: job.place.is_some(), text: told(&answer), took },
                Err(e) => Ended { good: false, kept: false, text: e.to_string(), took },
            });
        };
        std::thread::Builder::new().name("work".into()).spawn(work).map_err(Refusal::from)?;
        Ok(id)
    }
}

/// What a command prints, on both of its streams.
fn told(answer: &Answer) -> String {
    let behind = answer.remarks.iter().chain(&answer.closing).map(|line| format!("{line}\n"));
    std::iter::once(answer.text.clone()).chain(behind).collect()
}

fn worked(studio: &Studio, job: &Job, whole: &[String]) -> Result<Answer, Failure> {
    match job.verb.as_str() {
        "fit" => kept::<fit::Options>(studio, job, whole),
        "diagnose" => kept::<diagnose::Options>(studio, job, whole),
        "profile" => kept::<profile::Options>(studio, job, whole),
        "design" => designed(studio, job, whole),
        _ => {
            let options: doctor::Options = parsed(&[], whole.get(2..).unwrap_or_default())?;
            let mut conduct = job.watch.conduct(Wanted { json: true, ..Wanted::default() }).within(&options.limit);
            let (judged, answer) = judge(&options, &mut conduct)?;
            *locked(&studio.jobs.judged) = Some((options, judged));
            Ok(answer)
        }
    }
}

/// The words of a command behind its verb, but for where its result goes, which is this folder's matter.
fn within(whole: &[String]) -> Vec<String> {
    whole.iter().skip(2).filter(|w| !w.starts_with(OUT) && !w.starts_with(RECORDS)).cloned().collect()
}

/// Designs the next runs, and writes their manoeuvres into a folder.
fn designed(studio: &Studio, job: &Job, whole: &[String]) -> Result<Answer, Failure> {
    let options: design::Options = parsed(&[], &within(whole))?;
    let mut conduct = job.watch.conduct(Wanted::default()).within(&options.limit);
    let answer = design::answer(&options, &mut conduct)?;
    let place = studio.folder.result(job.place.as_deref().unwrap_or_default());
    make_folder(&place).map_err(|e| Failure::at(&place, &e))?;
    for (name, bytes) in &answer.files {
        write_file(&place.join(name), bytes).map_err(|e| Failure::at(&place, &e))?;
    }
    Ok(answer)
}

/// Works out a verb as the command does, and keeps its folder.
fn kept<V: Verb + Args>(studio: &Studio, job: &Job, whole: &[String]) -> Result<Answer, Failure> {
    let options: V = parsed(&[], &within(whole))?;
    let mut conduct = job.watch.conduct(WHOLE).within(options.given().limit);
    let session = options.session(&conduct)?.of_command(whole.to_vec());
    let place = studio.folder.result(job.place.as_deref().unwrap_or_default());
    let place = Destination::prepare_for(place, &options.names(&session), false).or_failure()?;
    let answer = answered(&options, &session, &mut conduct)?;
    place.fill(&answer.files).or_failure()?;
    Ok(answer)
}

/// Words as they are typed in a shell.
pub(crate) fn typed(words: &[String]) -> String {
    let plain =
        |word: &str| !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_=./,:+@%".contains(c));
    let quoted = |word: &String| if plain(word) { word.clone() } else { format!("'{}'", word.replace('\'', "'\\''")) };
    words.iter().map(quoted).collect::<Vec<_>>().join(" ")
}

/// Words with what the project adds.
pub(crate) fn completed(completed: &Completed, words: &[&str]) -> Result<Vec<String>, Failure> {
    completed(words.iter().map(ToString::to_string).collect())
}

/// A result folder of the project.
pub(crate) fn is_result(folder: &Folder, path: &str) -> Result<std::path::PathBuf, Refusal> {
    let place = folder.place(path)?;
    let stands = fdm_results::store::ResultFolder::stands_in(Path::new(&place));
    if stands { Ok(place) } else { Err(Refusal::new(Status::NotFound, format!("{path}: this is no result"))) }
}
