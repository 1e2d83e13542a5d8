//! The progress file: how far work is, written beside the place of its result while it goes on; `fdm serve` shows it.
//!
//! A thread of its own writes it, at most once a second, so that the work waits for nothing. Work without a place for its
//! result has no such thread.

use crate::progress::RepeatsSoFar;
use crate::session::Session;
use fdm_estimate::{Iteration, StartSummary, Status, UnknownName};
use fdm_results::documents::study::Study;
use fdm_results::documents::{AtWork, CourseDocument, CourseParameter, ProgressDocument, ProgressManifest, to_text};
use fdm_results::store::ProgressFile;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Least time between two texts; work that ends sooner leaves no file at all.
const PAUSE: Duration = Duration::from_secs(1);
/// How much longer the pause is than the making of a text.
const SHARE: u32 = 20;
/// Longest pause: whoever hears nothing for twice as long takes the work for dead.
const LONGEST: Duration = Duration::from_secs(10);

/// Makes the study so far, and says how many seconds are left.
pub type Parts = dyn Fn() -> (Study, Option<f64>) + Send + Sync;

/// How far work is.
#[derive(Default)]
pub struct State {
    /// What is being done, in words.
    pub doing: String,
    /// What is estimated.
    pub names: Vec<UnknownName>,
    /// The values as they stand.
    pub values: Vec<f64>,
    /// Iterations of the estimation at work.
    pub history: Vec<Iteration>,
    /// Starts that have ended, of so many.
    pub starts: (Vec<StartSummary>, usize),
    /// Repeats of a Monte Carlo study that have ended.
    pub repeats: Option<RepeatsSoFar>,
    /// What else there is: the study so far, and the time that is left.
    pub more: Option<Arc<Parts>>,
}

/// The course of the work, which the work itself writes and the thread reads.
#[derive(Clone, Default)]
pub struct Course(Arc<Mutex<State>>);

impl Course {
    /// To be read or written.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread and its files; they are gone when this is.
#[derive(Default)]
pub struct CourseWriter {
    files: Vec<ProgressFile>,
    end: Arc<(Mutex<bool>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

impl CourseWriter {
    /// Writes beside these folders.
    pub fn begin(folders: Vec<PathBuf>, session: &Session, course: Course) -> Self {
        let files: Vec<ProgressFile> = folders.iter().map(ProgressFile::of).collect();
        let model = &session.model;
        let head = Head {
            command: session.command.clone(),
            began: (SystemTime::now(), Instant::now()),
            model: model.name().to_string(),
            model_file: model.source().name().to_string(),
            text: model.source().texts().first().map_or(String::new(), |t| t.text().to_string()),
        };
        let end = Arc::new((Mutex::new(false), Condvar::new()));
        let (own, places) = (Arc::clone(&end), files.clone());
        let work = move || {
            let mut pause = PAUSE;
            let (ended, bell) = &*own;
            loop {
                let guard = ended.lock().unwrap_or_else(PoisonError::into_inner);
                let waited = bell.wait_timeout_while(guard, pause, |ended| !*ended);
                if waited.map_or(true, |(ended, _)| *ended) {
                    return;
                }
                let begun = Instant::now();
                let text = head.text(&course);
                // a place that cannot be written is no reason to stop the work, and the result tells of it
                places.iter().for_each(|file| _ = file.tell(&text));
                pause = (SHARE * begun.elapsed()).clamp(PAUSE, LONGEST);
            }
        };
        // where no thread can be had nothing is told
        let thread = std::thread::Builder::new().name("progress".into()).spawn(work).ok();
        Self { files, end, thread }
    }
}

impl Drop for CourseWriter {
    fn drop(&mut self) {
        let (ended, bell) = &*self.end;
        *ended.lock().unwrap_or_else(PoisonError::into_inner) = true;
        bell.notify_all();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        self.files.iter().for_each(ProgressFile::remove);
    }
}

/// What does not change.
struct Head {
    command: Vec<String>,
    began: (SystemTime, Instant),
    model: String,
    model_file: String,
    text: String,
}

impl Head {
    /// Everything as JSON: like a result, as far as it is there.
    fn text(&self, course: &Course) -> String {
        let (mut result, doing, more) = {
            let course = course.lock();
            let named = course.names.iter().zip(&course.values).map(|(n, value)| CourseParameter {
                name: n.name.clone(),
                run: n.run.clone(),
                unit: n.unit.clone(),
                value: *value,
                status: Status::Estimated,
            });
            let (starts, count) = &course.starts;
            let result = CourseDocument {
                model: self.model.clone(),
                parameters: named.collect(),
                history: course.history.clone(),
                iterations: course.history.last().map(|i| i.number),
                starts: (!starts.is_empty()).then(|| starts.iter().map(Into::into).collect()),
                starts_asked: Some(*count).filter(|count| *count > 0),
                study: None,
            };
            (result, course.doing.clone(), course.more.clone())
        };
        // what takes time is made while the work goes on
        let left = more.and_then(|more| {
            let (study, left) = more();
            result.study = Some(study);
            left
        });
        let seconds = |time: SystemTime| time.duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
        let (command, model) = (self.command.clone(), self.model.clone());
        let manifest = ProgressManifest { command, model, model_file: self.model_file.clone() };
        let (began, reported) = (seconds(self.began.0), seconds(SystemTime::now()));
        let progress = AtWork { doing, began, reported, elapsed: self.began.1.elapsed().as_secs_f64(), left };
        // keys are texts, so that there is always a text
        to_text(&ProgressDocument::new(manifest, self.text.clone(), progress, result)).unwrap_or_default()
    }
}
