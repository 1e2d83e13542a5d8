//! `fdm job status`: how far a job is, and who is at work on it.

use super::run::PULSE;
use super::work::JobFolder;
use crate::deliver::write;
use crate::failure::{Ending, OrFailure, as_json, ended, print, print_lines};
use crate::ownership::Overwriting;
use clap::Args;
use fdm_report::job_text;
use fdm_report::page::job_page;
use fdm_results::documents::{CommandStatus, JobStatus, ShardAtWork, ShardStatus, from_text};
use fdm_results::store::{TaskKey, clock_of};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// What `fdm job status` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder that the shares are written to
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Print JSON instead of tables
    #[arg(long, help_heading = "Result")]
    json: bool,
    /// Write one page for a browser
    #[arg(long, value_name = "FILE.html", help_heading = "Result")]
    report: Option<PathBuf>,
    #[command(flatten)]
    overwriting: Overwriting,
}

/// Missing tasks that are named.
const NAMED: usize = 8;
/// Whoever tells nothing for so many of its pulses is taken for dead.
const PULSES: f64 = 6.0;

pub(crate) fn run(arguments: &Arguments) -> Ending {
    // the page belongs to the folder in which the command was typed
    let report = arguments.report.as_deref().map(std::path::absolute).transpose().or_failure()?;
    let job = JobFolder::open(&arguments.folder)?;
    let gathered = job.results.gather().or_failure()?;
    let keys = || job.plan.tasks().map(|(_, key)| key);
    let is_done = |key: &TaskKey| gathered.results.contains_key(key);
    let mut counts = vec![0; job.plan.commands.len()];
    for key in keys().filter(is_done) {
        counts[key.command as usize] += 1;
    }
    let commands = job.plan.commands.iter().zip(&counts).map(|(c, done)| CommandStatus {
        name: c.name.clone(),
        command: std::iter::once("fdm".to_string()).chain(c.words.iter().cloned()).collect(),
        task: c.cut.task().into(),
        tasks: c.tasks,
        done: *done,
    });
    let commands: Vec<CommandStatus> = commands.collect();
    let (tasks, done) = (job.plan.count(), counts.iter().sum());
    let shards = heard(&job.folder);
    let rate: f64 = shards.iter().filter(|s| s.alive).map(|s| s.report.rate()).sum();
    let status = JobStatus {
        folder: arguments.folder.display().to_string(),
        fdm: job.plan.fdm.clone(),
        plan: job.plan.id.clone(),
        tasks,
        done,
        missing: keys().filter(|key| !is_done(key)).take(NAMED).map(|key| job.plan.task(key)).collect(),
        commands,
        shards,
        files: gathered.files,
        damaged: gathered.damaged.clone(),
        left: (rate > 0.0 && done < tasks).then(|| (tasks - done) as f64 / rate),
    };
    let printed = if arguments.json { print_lines(&as_json(&status)?) } else { print(&job_text(&status)) };
    if let Some(file) = &report {
        write(file, job_page(&status))?;
    }
    ended(printed)
}

/// The programs that tell of themselves in a folder. How long ago that was is said by the clock of the file system where it can be asked,
/// since those of the machines differ.
fn heard(folder: &Path) -> Vec<ShardStatus> {
    let now = clock_of(folder).unwrap_or_else(SystemTime::now);
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let report = |entry: std::fs::DirEntry| -> Option<ShardStatus> {
        let name = entry.file_name().to_string_lossy().into_owned();
        if !(name.starts_with(".shard-") && name.ends_with(".progress")) {
            return None;
        }
        let report: ShardAtWork = from_text(&std::fs::read_to_string(entry.path()).ok()?).ok()?;
        let written = entry.metadata().and_then(|about| about.modified()).ok()?;
        let silent = now.duration_since(written).map_or(0.0, |d| d.as_secs_f64());
        Some(ShardStatus { report, silent, alive: silent < PULSES * PULSE.as_secs_f64() })
    };
    let mut all: Vec<ShardStatus> = entries.filter_map(report).collect();
    let number = |s: &ShardStatus| s.report.shard.split('/').next().and_then(|n| n.parse::<u64>().ok());
    all.sort_by(|a, b| {
        (number(a), &a.report.host, a.report.process).cmp(&(number(b), &b.report.host, b.report.process))
    });
    all
}
