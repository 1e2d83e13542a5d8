//! Work that tells how far it is while it works: a file beside the place of its result, which `fdm serve` shows.
//!
//! A thread of its own writes it, at most once a second, so that the work waits for nothing; work without a place for its
//! result has no such thread.

use fdm::Model;
use fdm::estimate::{Iteration, StartSummary, UnknownName};
use fdm::report::starts_json;
use fdm::store::ProgressFile;
use serde_json::{Value, json};
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

/// Makes parts of the result so far, and says how many seconds are left.
pub(crate) type Parts = dyn Fn() -> (Value, Option<f64>) + Send + Sync;

/// How far work has come.
#[derive(Default)]
pub(crate) struct Course {
    /// What is being done, in words.
    pub(crate) doing: String,
    /// What is estimated, and the values as they stand.
    pub(crate) names: Vec<UnknownName>,
    pub(crate) values: Vec<f64>,
    /// Corrections of the estimation at work.
    pub(crate) history: Vec<Iteration>,
    /// Starts that have ended, of so many.
    pub(crate) starts: (Vec<StartSummary>, usize),
    /// What else there is: parts of the result so far, and the time that is left.
    pub(crate) more: Option<Arc<Parts>>,
}

/// A course that the work writes and the thread reads.
#[derive(Clone, Default)]
pub(crate) struct Shared(Arc<Mutex<Course>>);

impl Shared {
    pub(crate) fn lock(&self) -> MutexGuard<'_, Course> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread and its files; they are gone when this is.
#[derive(Default)]
pub(crate) struct Live {
    files: Vec<ProgressFile>,
    end: Arc<(Mutex<bool>, Condvar)>,
    thread: Option<JoinHandle<()>>,
}

impl Live {
    /// Tells of work on a model beside these folders; does nothing where there are none.
    pub(crate) fn begin(folders: Vec<PathBuf>, model: &Model, course: Shared) -> Self {
        if folders.is_empty() {
            return Self::default();
        }
        let files: Vec<ProgressFile> = folders.iter().map(ProgressFile::of).collect();
        let head = Head {
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

impl Live {
    /// Whether anybody is told.
    pub(crate) fn is_told(&self) -> bool {
        self.thread.is_some()
    }
}

impl Drop for Live {
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
    began: (SystemTime, Instant),
    model: String,
    model_file: String,
    text: String,
}

impl Head {
    /// Everything as JSON: like a result, as far as it is there.
    fn text(&self, course: &Shared) -> String {
        let (mut result, doing, more) = {
            let course = course.lock();
            let named = course.names.iter().zip(&course.values);
            let parameters: Vec<Value> = named
                .map(|(n, value)| json!({ "name": n.name, "run": n.run, "unit": n.unit, "value": value, "status": "estimated" }))
                .collect();
            let (starts, count) = &course.starts;
            let result = json!({
                "model": self.model, "parameters": parameters, "history": course.history,
                "iterations": course.history.last().map(|i| i.number),
                "starts": if starts.is_empty() { Value::Null } else { starts_json(starts) },
                "starts_asked": if *count == 0 { Value::Null } else { json!(count) },
            });
            (result, course.doing.clone(), course.more.clone())
        };
        // what takes time is made while the work goes on
        let (parts, left) = more.map_or((Value::Null, None), |more| more());
        if let (Value::Object(result), Value::Object(parts)) = (&mut result, parts) {
            result.extend(parts);
        }
        let seconds = |time: SystemTime| time.duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64());
        let document = json!({
            "kind": "fdm progress", "format": 1, "fdm": env!("CARGO_PKG_VERSION"),
            "manifest": { "command": std::env::args().collect::<Vec<_>>(), "model": self.model, "model_file": self.model_file },
            "model_text": self.text,
            "progress": {
                "doing": doing, "began": seconds(self.began.0), "told": seconds(SystemTime::now()),
                "elapsed": self.began.1.elapsed().as_secs_f64(), "left": left,
            },
            "result": result,
        });
        format!("{document}\n")
    }
}
