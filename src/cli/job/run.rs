//! `fdm job run`: a share of the tasks of a plan. What is done is kept in a folder that many programs fill at once, whatever becomes of them.

use super::work::{Command, JobFolder, host, kept, read_plan, refuse_other, unwritten};
use crate::deliver::Manner;
use crate::failure::{Ending, Failure, OrFailure, ended, remark};
use crate::halt::TimeLimit;
use crate::progress::{Progress, counted};
use crate::tasks::said;
use clap::Args;
use fdm_estimate::Halt;
use fdm_lab::job::{Shard, work_off};
use fdm_results::documents::{ShardAtWork, to_text};
use fdm_results::store::{ProgressFile, TaskKey, TaskResults, make_folder, write_file};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// What `fdm job run` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Plan that `fdm job plan` made
    #[arg(value_name = "PLAN")]
    plan: PathBuf,
    /// The I-th of N shares; `auto` or auto/N as the engine says that has started this program (Slurm, HyperQueue, PBS, Grid Engine, LSF,
    /// Kubernetes, AWS Batch, GNU parallel, MPI)
    #[arg(long, value_name = "I/N", default_value = "1/1", value_parser = shard)]
    shard: Shard,
    /// Folder of the results, common to all shares; what is there is not done again
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    limit: TimeLimit,
    #[command(flatten)]
    manner: Manner,
}

fn shard(words: &str) -> Result<Shard, String> {
    Shard::read(words, &|name| std::env::var(name).ok()).map_err(|e| e.to_string())
}

/// Least and longest time between two files with results; a quarter of the time at work lies between: a kill loses no more.
const LEAST: Duration = Duration::from_secs(1);
const LONGEST: Duration = Duration::from_secs(60);
const PART: u32 = 4;
/// How much longer the work is than the writing of its results.
const SHARE: u32 = 20;
/// How often a program tells that it is at work; `fdm job status` counts on it.
pub(super) const PULSE: Duration = Duration::from_secs(5);

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let progress = Progress::new(arguments.manner.quiet).within(&arguments.limit);
    let halt = progress.halt();
    let plan = read_plan(&arguments.plan)?;
    let job = JobFolder::of(plan, &arguments.out)?;
    settle(&job)?;
    let gathered = job.results.gather().or_failure()?;
    gathered.damaged.iter().for_each(|d| remark(format_args!("note: {d}")));
    let own: Vec<TaskKey> = job.plan.tasks().filter(|(k, _)| arguments.shard.has(*k)).map(|(_, key)| key).collect();
    let missing: Vec<TaskKey> = own.iter().filter(|key| !gathered.results.contains_key(key)).copied().collect();
    drop(gathered);
    let bench = Bench::new(&job.results, (own.len(), own.len() - missing.len()));
    let bar = counted(own.len(), "tasks");
    bar.set_position((own.len() - missing.len()) as u64);
    let mut by_command: BTreeMap<u32, Vec<u64>> = BTreeMap::new();
    missing.iter().for_each(|key| by_command.entry(key.command).or_default().push(key.task));
    let by_command: Vec<(u32, Vec<u64>)> = by_command.into_iter().collect();
    let name =
        format!("shard-{}-of-{}-{}-{}", arguments.shard.index + 1, arguments.shard.count, host(), std::process::id());
    let file = ProgressFile::of(job.folder.join(name));
    let failures: Vec<Failure> = std::thread::scope(|scope| {
        scope.spawn(|| bench.tell(&file, &arguments.shard.to_string()));
        let one = |(command, tasks): &(u32, Vec<u64>)| -> Option<Failure> {
            if !halt.goes_on() {
                return None;
            }
            let came = |task, result| {
                bench.put(TaskKey { command: *command, task }, result);
                bar.inc(1);
            };
            work(&job, *command, tasks, halt, &came).err()
        };
        let failures = by_command.par_iter().with_max_len(1).filter_map(one).collect();
        bench.end();
        failures
    });
    file.remove();
    bar.finish_and_clear();
    let written = bench.flush();
    if let Err(e) = &written {
        remark(format_args!("error: {}: results are lost with this program: {e}", job.folder.display()));
    }
    for failure in &failures {
        failure.report();
    }
    if let Some(Failure::Input(_) | Failure::Model(_) | Failure::Records(_)) = failures.first() {
        return Err(Failure::Input(vec!["the tasks above cannot be done".into()]));
    }
    let (tasks, done) = bench.counts();
    if !arguments.manner.quiet || done < tasks {
        remark(format_args!(
            "{done} of {tasks} tasks of shard {} are done in {}",
            arguments.shard,
            job.folder.display()
        ));
    }
    let in_time = progress.in_time();
    ended(in_time && written.is_ok() && failures.is_empty() && done == tasks)
}

/// The plan in the folder, so that everything else is said by the folder alone.
fn settle(job: &JobFolder) -> Result<(), Failure> {
    if let Some(held) = job.held()? {
        if held.id != job.plan.id {
            return Err(Failure::Input(vec![format!(
                "{} holds results of another plan; give another folder",
                job.folder.display()
            )]));
        }
        // a plan of more repeats goes on from one of fewer
        if held.count() >= job.plan.count() {
            return Ok(());
        }
    }
    make_folder(&job.folder).map_err(|e| unwritten(&job.folder, &e))?;
    let (file, text) = job.plan_file()?;
    write_file(&file, text.as_bytes()).map_err(|e| unwritten(&file, &e))
}

/// Does tasks of one command.
fn work(
    job: &JobFolder,
    command: u32,
    tasks: &[u64],
    halt: &Halt,
    came: &(dyn Fn(u64, Vec<u8>) + Sync),
) -> Result<(), Failure> {
    let planned = &job.plan.commands[command as usize];
    let read = Command::read(&planned.words)?.finishing(&planned.words, None);
    let states = kept(&job.plan, command as usize, &BTreeMap::new())?;
    read.tasks(&states, halt, &mut |of_command, identity| {
        refuse_other(&planned.identity, identity, &planned.name)?;
        let numbers = |reason: String| Failure::Numbers(reason);
        work_off(of_command, tasks, halt, came).map_err(numbers)
    })
    .map_err(|e| match (e, planned.name.as_str()) {
        (e, "") => e,
        (Failure::Numbers(reason), name) => Failure::Numbers(format!("{name}: {reason}")),
        (e, name) => Failure::Input(vec![format!("{name}: {}", said(&e))]),
    })
}

/// Where results lie until they are written.
struct Bench<'r> {
    results: &'r TaskResults,
    fresh: Mutex<Fresh>,
    begun: Instant,
    tasks: u64,
    /// Those that were done before.
    before: u64,
    own: AtomicU64,
    ended: (Mutex<bool>, Condvar),
}

struct Fresh {
    results: BTreeMap<TaskKey, Vec<u8>>,
    next: Instant,
    failing: bool,
}

impl<'r> Bench<'r> {
    fn new(results: &'r TaskResults, (tasks, before): (usize, usize)) -> Self {
        let begun = Instant::now();
        let fresh = Fresh { results: BTreeMap::new(), next: begun + LEAST, failing: false };
        Self {
            results,
            fresh: Mutex::new(fresh),
            begun,
            tasks: tasks as u64,
            before: before as u64,
            own: AtomicU64::new(0),
            ended: (Mutex::new(false), Condvar::new()),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Fresh> {
        self.fresh.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a result; writes all that are there now and then.
    fn put(&self, key: TaskKey, result: Vec<u8>) {
        let due = {
            let mut fresh = self.lock();
            fresh.results.insert(key, result);
            Instant::now() >= fresh.next
        };
        self.own.fetch_add(1, Ordering::Relaxed);
        // what cannot be written now is tried again later
        if due {
            let _ = self.flush();
        }
    }

    /// Writes what is there.
    fn flush(&self) -> Result<(), String> {
        let results = {
            let mut fresh = self.lock();
            // others go on with their tasks meanwhile
            fresh.next = Instant::now() + LONGEST;
            std::mem::take(&mut fresh.results)
        };
        if results.is_empty() {
            return Ok(());
        }
        let begun = Instant::now();
        let kept = self.results.keep(&results).map_err(|e| fdm_results::store::reason(&e));
        let mut fresh = self.lock();
        let pause = (self.begun.elapsed() / PART).clamp(LEAST, LONGEST).max(SHARE * begun.elapsed());
        fresh.next = Instant::now() + pause;
        match &kept {
            Ok(()) => fresh.failing = false,
            Err(e) => {
                fresh.results.extend(results);
                if !std::mem::replace(&mut fresh.failing, true) {
                    remark(format_args!(
                        "warning: results cannot be written ({e}); the work goes on, and it is tried again"
                    ));
                }
            }
        }
        kept
    }

    /// Tasks, and those of them that are done.
    fn counts(&self) -> (u64, u64) {
        (self.tasks, self.before + self.own.load(Ordering::Relaxed))
    }

    /// Tells now and then that this program is at work.
    fn tell(&self, file: &ProgressFile, shard: &str) {
        let (ended, bell) = &self.ended;
        let mut pause = LEAST;
        loop {
            let guard = ended.lock().unwrap_or_else(PoisonError::into_inner);
            let waited = bell.wait_timeout_while(guard, pause, |ended| !*ended);
            if waited.map_or(true, |(ended, _)| *ended) {
                return;
            }
            pause = PULSE;
            let (tasks, done) = self.counts();
            let told = ShardAtWork {
                shard: shard.into(),
                host: host(),
                process: std::process::id(),
                tasks,
                done,
                own: done - self.before,
                elapsed: self.begun.elapsed().as_secs_f64(),
            };
            // a place that cannot be written is no reason to stop the work
            let _ = to_text(&told).map(|text| file.tell(&text));
        }
    }

    fn end(&self) {
        let (ended, bell) = &self.ended;
        *ended.lock().unwrap_or_else(PoisonError::into_inner) = true;
        bell.notify_all();
    }
}
