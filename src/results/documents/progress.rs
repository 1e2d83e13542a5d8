//! The report of work that goes on: a result as far as it is there.
//!
//! How far the tasks of a job are, and what the programs that work on them report.

use super::fit::StartDocument;
use super::study::Study;
use fdm_estimate::{Iteration, Status};
use serde::{Deserialize, Serialize};

/// Says that a text is one of ours.
const KIND: &str = "fdm progress";
/// Changes when an older program could not read it any more.
const FORMAT: u32 = 2;

/// The report of work that goes on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProgressDocument {
    kind: String,
    format: u32,
    /// Version of the program.
    pub fdm: String,
    /// What is at work on what.
    pub manifest: ProgressManifest,
    /// The model's text.
    pub model_text: String,
    /// How far it is.
    pub progress: AtWork,
    /// The result so far.
    pub result: CourseDocument,
}

/// What is at work on what.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProgressManifest {
    /// The command line.
    pub command: Vec<String>,
    /// The model's name.
    pub model: String,
    /// Its file.
    pub model_file: String,
}

/// How far work is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AtWork {
    /// What is being done.
    pub doing: String,
    /// When it began, in seconds since 1970.
    pub began: f64,
    /// When this was reported.
    pub reported: f64,
    /// Seconds at work.
    pub elapsed: f64,
    /// Seconds that are left, where that is known.
    pub left: Option<f64>,
}

/// The result so far.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CourseDocument {
    /// The model's name.
    pub model: String,
    /// The parameters as they stand.
    pub parameters: Vec<CourseParameter>,
    /// The iteration so far.
    pub history: Vec<Iteration>,
    /// Iterations so far; none before the first.
    pub iterations: Option<usize>,
    /// Starts that have ended; none where there is one only.
    pub starts: Option<Vec<StartDocument>>,
    /// Of so many.
    pub starts_asked: Option<usize>,
    /// The study so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub study: Option<Study>,
}

/// A parameter as it stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CourseParameter {
    /// Its name.
    pub name: String,
    /// The run that it belongs to.
    pub run: Option<String>,
    /// Its unit.
    pub unit: Option<String>,
    /// Its value.
    pub value: f64,
    /// `estimated`.
    pub status: Status,
}

impl ProgressDocument {
    /// Of this version of the program.
    pub fn new(manifest: ProgressManifest, model_text: String, progress: AtWork, result: CourseDocument) -> Self {
        let fdm = env!("CARGO_PKG_VERSION").into();
        Self { kind: KIND.into(), format: FORMAT, fdm, manifest, model_text, progress, result }
    }

    /// Whether it is what it should be, in a version that this program reads.
    pub fn is_ours(&self) -> bool {
        self.kind == KIND && self.format == FORMAT
    }
}

/// What a program reports while it works on a shard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShardAtWork {
    /// Which part of the tasks, as `i/N`.
    pub shard: String,
    /// The machine.
    pub host: String,
    /// The number of the process.
    pub process: u32,
    /// Tasks of the shard.
    pub tasks: u64,
    /// Tasks of the shard that are done, whoever did them.
    pub done: u64,
    /// Tasks that this program has done.
    pub own: u64,
    /// Seconds at work.
    pub elapsed: f64,
}

/// The report of a shard at work, and when it was heard of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShardStatus {
    /// Its report.
    #[serde(flatten)]
    pub report: ShardAtWork,
    /// Seconds since then.
    pub silent: f64,
    /// Whether it is at work, as far as is known.
    pub alive: bool,
}

/// How far one command is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandStatus {
    /// What distinguishes its result from those of the others; empty where there is only one.
    pub name: String,
    /// The command line.
    pub command: Vec<String>,
    /// What its tasks are: `start`, `repeat`, `side of a profile`, `result`.
    pub task: String,
    /// How many there are.
    pub tasks: u64,
    /// How many are done.
    pub done: u64,
}

/// How far a job is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JobStatus {
    /// The folder with its results.
    pub folder: String,
    /// Version of the program that made the plan.
    pub fdm: String,
    /// Decides which results belong to it.
    pub plan: String,
    /// All tasks.
    pub tasks: u64,
    /// Tasks that are done.
    pub done: u64,
    /// The first of those that are missing, by name.
    pub missing: Vec<String>,
    /// Each command.
    pub commands: Vec<CommandStatus>,
    /// The programs that have reported; those that have ended report nothing.
    pub shards: Vec<ShardStatus>,
    /// Files with results.
    pub files: usize,
    /// Files that are damaged or foreign, one sentence each.
    pub damaged: Vec<String>,
    /// Seconds that the rest takes at the speed of those at work; none where nobody is.
    pub left: Option<f64>,
}

impl ShardAtWork {
    /// Tasks in a second.
    pub fn rate(&self) -> f64 {
        if self.elapsed > 0.0 { self.own as f64 / self.elapsed } else { 0.0 }
    }
}

impl JobStatus {
    /// Whether everything is done.
    pub fn is_whole(&self) -> bool {
        self.done == self.tasks
    }
}
