//! `fdm job plan`: a job file becomes tasks that many machines can share, with what they cost.

use super::engine::Engine;
use super::work::{Command, completed, read_job};
use crate::deliver::Manner;
use crate::failure::{Ending, Failure, OrFailure, as_json, ended, print, print_lines, remark};
use crate::halt::uninterrupted;
use crate::progress::Progress;
use clap::Args;
use fdm_estimate::CheckpointStore;
use fdm_lab::job::{Memory, Plan, PlannedCommand};
use fdm_report::page::duration;
use fdm_results::store::{program_fingerprint, read_input, write_file};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What `fdm job plan` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Job file: a command and its options by their long names
    #[arg(value_name = "JOB.toml")]
    job: PathBuf,
    /// The plan [default: beside the job file, with the ending .plan]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write a script for an engine beside the plan, which starts the shards and merges them
    #[arg(long = "for", value_name = "ENGINE", value_enum)]
    engine: Option<Engine>,
    /// Shards that the script asks for
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    shards: u32,
    /// Do not do one task to see how long it takes
    #[arg(long)]
    untimed: bool,
    /// Replace files of these names that fdm did not write
    #[arg(long)]
    force: bool,
    /// Print JSON instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manner: Manner,
}

/// What is printed of a plan.
#[derive(Serialize)]
struct Told {
    plan: String,
    script: Option<String>,
    id: String,
    tasks: u64,
    /// Of one task, on one thread.
    seconds: Option<f64>,
    /// Of all tasks, on one thread.
    total: Option<f64>,
    commands: Vec<ToldCommand>,
}

#[derive(Serialize)]
struct ToldCommand {
    name: String,
    command: Vec<String>,
    task: &'static str,
    tasks: u64,
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let from = |path: &Path| std::path::absolute(path).map_err(|e| Failure::at(path, &e));
    let job = from(&arguments.job)?;
    let folder = job.parent().unwrap_or(Path::new("/")).to_path_buf();
    let output = arguments.output.as_deref().map_or_else(|| Ok(job.with_extension("plan")), from)?;
    let script = arguments.engine.map(|engine| output.with_extension(engine.ending()));
    for file in std::iter::once(&output).chain(&script) {
        refuse_strangers(file, arguments.force)?;
    }
    let progress = Progress::new(arguments.manner.quiet);
    // paths in a job are relative to its folder
    std::env::set_current_dir(&folder).map_err(|e| Failure::at(&folder, &e))?;
    let mut commands = Vec::new();
    let mut seconds = None;
    let asked = read_job(&job)?;
    let count = asked.len();
    for (k, (name, words)) in asked.into_iter().enumerate() {
        if count > 1 {
            progress.say(&format!("{} of {count}: {name}", k + 1));
        }
        let timed = k == 0 && !arguments.untimed;
        let (planned, time) = planned(name, &words, timed, &progress)?;
        commands.push(planned);
        seconds = seconds.or(time);
    }
    progress.finish();
    if !uninterrupted(progress.halt()) {
        return ended(false);
    }
    let program = program_fingerprint().or_failure()?;
    let beside = output.parent() == Some(&folder);
    let within = if beside { PathBuf::new() } else { folder };
    let mut plan = Plan::new(program, within, commands).or_failure()?;
    plan.seconds = seconds;
    write(&output, plan.text().or_failure()?.as_bytes())?;
    if let (Some(engine), Some(script)) = (arguments.engine, &script) {
        write(script, engine.script(&output, arguments.shards).as_bytes())?;
    }
    told(arguments, &plan, &output, script.as_deref())
}

/// A command with its tasks; the seconds that one takes, where that is wanted.
fn planned(
    name: String,
    words: &[String],
    timed: bool,
    progress: &Progress,
) -> Result<(PlannedCommand, Option<f64>), Failure> {
    let words = completed(words)?;
    let named = |e: Failure| match (e, name.as_str()) {
        (Failure::Input(reasons), name) if !name.is_empty() => {
            Failure::Input(reasons.iter().map(|r| format!("{name}: {r}")).collect())
        }
        (e, _) => e,
    };
    let command = Command::read(&words).map_err(named)?.finishing(&words, None);
    let (states, halt) = (Memory::default(), progress.halt());
    let (mut found, mut seconds) = (None, None);
    command
        .tasks(&states as &dyn CheckpointStore, halt, &mut |tasks, identity| {
            found = Some(PlannedCommand::new(&name, &words, tasks, identity));
            if timed {
                progress.say("doing one task, to see how long it takes");
                // the first start is the given one, which is not like the others
                let task = 1.min(tasks.count().saturating_sub(1));
                let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().or_failure()?;
                let begun = Instant::now();
                let done = one.install(|| tasks.once(task, halt)).map_err(Failure::Numbers)?;
                seconds = done.map(|_| begun.elapsed().as_secs_f64());
            }
            Ok(())
        })
        .map_err(named)?;
    let found = found.ok_or_else(|| Failure::input(["the command has no tasks"]))?;
    Ok((found.with_states(&states.all()), seconds))
}

fn told(arguments: &Arguments, plan: &Plan, output: &Path, script: Option<&Path>) -> Ending {
    let tasks = plan.count();
    let total = plan.seconds.map(|s| s * tasks as f64);
    let command = |c: &PlannedCommand| ToldCommand {
        name: c.name.clone(),
        command: c.words.clone(),
        task: c.cut.task(),
        tasks: c.tasks,
    };
    let shown = |path: &Path| path.display().to_string();
    let told = Told {
        plan: shown(output),
        script: script.map(shown),
        id: plan.id.clone(),
        tasks,
        seconds: plan.seconds,
        total,
        commands: plan.commands.iter().map(command).collect(),
    };
    if arguments.json {
        return ended(print_lines(&as_json(&told)?));
    }
    let mut text = format!("{}: {tasks} tasks\n", told.plan);
    const SHOWN: usize = 12;
    for c in told.commands.iter().take(SHOWN) {
        let name = if c.name.is_empty() { String::new() } else { format!("{}: ", c.name) };
        let plural = if c.tasks == 1 { "" } else { "s" };
        let task =
            if c.task.starts_with("side") { "side(s) of profiles".into() } else { format!("{}{plural}", c.task) };
        text.push_str(&format!("  {name}{} {task}   fdm {}\n", c.tasks, c.command.join(" ")));
    }
    if told.commands.len() > SHOWN {
        text.push_str(&format!("  and {} more results\n", told.commands.len() - SHOWN));
    }
    if let (Some(seconds), Some(total)) = (plan.seconds, total) {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        text.push_str(&format!(
            "one task takes {} here: all about {} on one core, {} on the {cores} of this machine\n",
            duration(seconds),
            duration(total),
            duration(total / cores.min(tasks.max(1) as usize) as f64)
        ));
    }
    match script {
        Some(script) => text.push_str(&format!("script: {}\n", script.display())),
        None => text.push_str(&format!(
            "next: fdm job run {0} --shard I/N --out DIR for every I from 1 to N, then fdm job merge DIR\n",
            output.file_name().unwrap_or_default().to_string_lossy()
        )),
    }
    ended(print(&text))
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_file(path, bytes).map_err(|e| super::work::unwritten(path, &e))
}

/// Refuses to write over what is no plan and no script of ours.
fn refuse_strangers(path: &Path, force: bool) -> Result<(), Failure> {
    let there = read_input(path).unwrap_or_default();
    let text = String::from_utf8_lossy(&there);
    if force || there.is_empty() || text.contains("\"kind\": \"fdm plan\"") || text.contains(Engine::MARK) {
        return Ok(());
    }
    remark(format_args!("note: {} is no plan of fdm", path.display()));
    Err(Failure::Input(vec![crate::deliver::standing(path)]))
}
