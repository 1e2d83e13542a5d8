//! How far the tasks of a job are, and what the programs that work on them report.

use serde::{Deserialize, Serialize};

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
