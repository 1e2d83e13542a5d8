//! `fdm job merge`: what all machines have done becomes the result of the command, which ends as if it had done everything itself.

use super::work::{Command, JobFolder, kept};
use crate::deliver::Manner;
use crate::failure::{Ending, Failure, OrFailure, ended, print, remark, report};
use clap::Args;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// What `fdm job merge` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Folder that the shares were written to
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Print JSON instead of tables, whatever the job says
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    manner: Manner,
}

/// Tasks that are named where some are missing.
const NAMED: usize = 5;

pub(crate) fn run(arguments: &Arguments) -> Ending {
    let job = JobFolder::open(&arguments.folder)?;
    let gathered = job.results.gather().or_failure()?;
    gathered.damaged.iter().for_each(|d| remark(format_args!("note: {d}")));
    let missing: Vec<_> =
        job.plan.tasks().map(|(_, key)| key).filter(|key| !gathered.results.contains_key(key)).collect();
    if !missing.is_empty() {
        let named: Vec<String> = missing.iter().take(NAMED).map(|key| job.plan.task(*key)).collect();
        let more = missing.len().saturating_sub(NAMED);
        let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
        return Err(Failure::Numbers(format!(
            "{} of {} tasks are missing: {}{rest}; `fdm job run {} --out {}` does them",
            missing.len(),
            job.plan.count(),
            named.join(", "),
            job.plan_file()?.0.display(),
            job.folder.display()
        )));
    }
    let mut results: Vec<BTreeMap<u64, Vec<u8>>> = vec![BTreeMap::new(); job.plan.commands.len()];
    for (key, result) in gathered.results {
        // a shorter plan leaves those beyond it alone
        if let Some(own) = results.get_mut(key.command as usize) {
            own.insert(key.task, result);
        }
    }
    let several = job.plan.commands.len() > 1;
    if arguments.json && several {
        return Err(Failure::input(["--json: several results are printed as text; each folder has its JSON"]));
    }
    let mut worst = 0;
    for (k, (planned, results)) in job.plan.commands.iter().zip(&results).enumerate() {
        let done = Arc::new(kept(&job.plan, k, results)?);
        let command = crate::command();
        let of_verb = planned.words.first().and_then(|verb| command.find_subcommand(verb));
        let takes = |name: &str| of_verb.is_some_and(|verb| verb.get_arguments().any(|a| a.get_long() == Some(name)));
        let mut words = planned.words.clone();
        for (name, asked) in [("json", arguments.json), ("quiet", arguments.manner.quiet)] {
            let word = format!("--{name}");
            if asked && takes(name) && !words.contains(&word) {
                words.push(word);
            }
        }
        if several && !print(&format!("{}{}\n", if k > 0 { "\n" } else { "" }, planned.name)) {
            return ended(false);
        }
        let ending = Command::read(&words, &planned.words)?.finish(done);
        let code = ending.unwrap_or_else(|failure| report(&failure));
        worst = worst.max((0..=2).find(|n| ExitCode::from(*n) == code).unwrap_or(1));
    }
    Ok(ExitCode::from(worst))
}
