//! Work for many machines: the job file, the commands in it, and what they have in common at every stage.
//!
//! A job file holds a command with its options by their long names. `plan` cuts the command into tasks, `run` does some of them, `merge`
//! ends the command with what all have done, by the code that the command itself runs.

use crate::failure::{Ending, Failure, OrFailure, at, did_you_mean};
use crate::project::{self, plain, typed};
use crate::request::{Refusal, unclear};
use crate::tasks::{Visit, said};
use crate::trust::{refuse_liberties, typed_only};
use crate::{Verb, campaign, diagnose, fit, paths, profile, reproduce, study};
use clap::{Arg, FromArgMatches};
use fdm_estimate::{CheckpointStore, Halt};
use fdm_lab::job::{Memory, Plan};
use fdm_results::store::{Identity, Provenance, TaskResults, program_fingerprint, read_input_text};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A command that can be cut into tasks.
pub(crate) enum Command {
    Fit(Box<fit::Arguments>),
    Study(Box<study::Arguments>),
    Profile(Box<profile::Arguments>),
    Diagnose(Box<diagnose::Arguments>),
    Reproduce(Box<reproduce::Arguments>),
}

/// The verbs of such commands.
const VERBS: [&str; 5] = ["fit", "study", "profile", "diagnose", "reproduce"];
/// Options that make no sense in a job, and why.
const LEFT_OUT: [(&str, &str); 5] = [
    ("checkpoint", "the folder of `fdm job run --out` keeps what is done"),
    ("watch", "nobody watches a shard; `fdm job status` tells how far it is"),
    ("write", "the extended text is a file of the result: give `out`"),
    ("threads", "it is an option of `fdm job run`"),
    ("time-limit", "it is an option of `fdm job run`, where a task that was begun is done again"),
];

impl Command {
    /// The command of these words, the first of which is the verb.
    pub(crate) fn read(words: &[String]) -> Result<Self, Failure> {
        let mut command = crate::command();
        let all = std::iter::once("fdm".to_string()).chain(words.iter().cloned());
        let refused = |e: &clap::Error| match unclear(e) {
            Refusal::Words { said, .. } => Failure::Input(vec![said]),
            _ => Failure::input([e]),
        };
        let matches = command.try_get_matches_from_mut(all).map_err(|e| refused(&e))?;
        let arguments = crate::Arguments::from_arg_matches(&matches).map_err(|e| refused(&e))?;
        paths::refuse_conflicts(&command, &matches)?;
        refuse_liberties(&command, &matches)?;
        match arguments.verb {
            Verb::Fit(a) => Ok(Self::Fit(a)),
            Verb::Study(a) => Ok(Self::Study(a)),
            Verb::Profile(a) => Ok(Self::Profile(a)),
            Verb::Diagnose(a) => Ok(Self::Diagnose(a)),
            Verb::Reproduce(a) => Ok(Self::Reproduce(Box::new(a))),
            _ => Err(Failure::Input(vec![format!("command: expected {}", VERBS.join(", "))])),
        }
    }

    /// This command where a result is to tell these words as its command; with what was done elsewhere, where it is to
    /// end by that.
    pub(crate) fn finishing(self, words: &[String], done: Option<Arc<Memory>>) -> Self {
        let typed: Vec<String> = std::iter::once("fdm".to_string()).chain(words.iter().cloned()).collect();
        match (self, done) {
            (Self::Fit(a), done) => Self::Fit(Box::new(a.finishing(done, typed))),
            (Self::Diagnose(a), done) => Self::Diagnose(Box::new(a.finishing(done, typed))),
            (Self::Study(a), Some(done)) => Self::Study(Box::new(a.finishing(done, typed))),
            (Self::Profile(a), Some(done)) => Self::Profile(Box::new(a.finishing(done))),
            (Self::Reproduce(a), Some(done)) => Self::Reproduce(Box::new(a.finishing(done))),
            (other, None) => other,
        }
    }

    /// Makes ready what the tasks have in common, and shows them.
    pub(crate) fn tasks(&self, states: &dyn CheckpointStore, halt: &Halt, visit: Visit<'_>) -> Result<(), Failure> {
        match self {
            Self::Fit(a) => a.tasks(halt, visit),
            Self::Study(a) => a.tasks(states, halt, visit),
            Self::Profile(a) => a.tasks(states, halt, visit),
            Self::Diagnose(a) => a.tasks(visit),
            Self::Reproduce(a) => a.tasks(visit),
        }
    }

    /// What the command does.
    pub(crate) fn run(&self) -> Ending {
        match self {
            Self::Fit(a) => fit::run(a),
            Self::Study(a) => study::run(a),
            Self::Profile(a) => profile::run(a),
            Self::Diagnose(a) => diagnose::run(a),
            Self::Reproduce(a) => reproduce::run(a),
        }
    }
}

/// Commands as a job file asks for them: each with the name of its result, empty where there is only one.
pub(crate) fn read_job(file: &Path) -> Result<Vec<(String, Vec<String>)>, Failure> {
    let shown = file.display();
    let refused = |what: String| Failure::Input(vec![format!("{shown}: {what}")]);
    let text = read_input_text(file).map_err(|e| Failure::at(file, &e))?;
    let mut job: toml::Table = toml::from_str(&text).map_err(|e| refused(e.to_string().trim_end().to_string()))?;
    let verb = match job.remove("command") {
        Some(toml::Value::String(verb)) if VERBS.contains(&verb.as_str()) => verb,
        Some(other) => {
            let hint = other.as_str().map_or_else(String::new, |verb| did_you_mean(verb, VERBS));
            return Err(refused(format!("command = {}: expected {}{hint}", plain(&other), VERBS.join(", "))));
        }
        None => return Err(refused(format!("`command` is missing: one of {}", VERBS.join(", ")))),
    };
    let each = match job.remove("each") {
        None => toml::Table::new(),
        Some(toml::Value::Table(table)) => table,
        Some(_) => {
            return Err(refused("`each` is a table: an option with a list of values, one for each result".into()));
        }
    };
    let command = crate::command();
    let of_verb = command.find_subcommand(&verb).ok_or_else(|| refused("there is no such command".into()))?;
    // what stands behind the verb without an option: the model, or the name of an experiment
    let first = of_verb.get_positionals().next().map_or("model", |argument| argument.get_id().as_str());
    let known: Vec<&str> = of_verb.get_arguments().filter_map(Arg::get_long).chain([first]).collect();
    let mut wrong = Vec::new();
    for name in job.keys().chain(each.keys()) {
        if let Some(why) = typed_only(name) {
            wrong.push(format!("{shown}: {name}: {why}"));
        } else if let Some((_, why)) = LEFT_OUT.iter().find(|(left, _)| left == name) {
            wrong.push(format!("{shown}: {name}: not an option of a job: {why}"));
        } else if !known.contains(&name.as_str()) {
            let hint = did_you_mean(name, known.iter().copied());
            wrong.push(format!("{shown}: {name}: `fdm {verb}` has no option --{name}{hint}"));
        }
    }
    let out = job.get("out").and_then(toml::Value::as_str).map(PathBuf::from);
    if !each.is_empty() && known.contains(&"out") && out.is_none() {
        wrong.push(format!("{shown}: several results need a folder: out = \"results\""));
    }
    if !each.is_empty() && job.get("json").and_then(toml::Value::as_bool) == Some(true) {
        wrong.push(format!("{shown}: json: several results are printed as text; each folder has its JSON"));
    }
    if !wrong.is_empty() {
        return Err(Failure::Input(wrong));
    }
    let mut commands = Vec::new();
    for (name, own) in combinations(&each).map_err(refused)? {
        let mut options = job.clone();
        options.extend(own);
        if let (Some(out), false) = (&out, name.is_empty()) {
            options.insert("out".into(), out.join(&name).display().to_string().into());
        }
        let mut words = vec![verb.clone()];
        words.extend(options.remove(first).and_then(|model| model.as_str().map(String::from)));
        words.extend(options.iter().flat_map(|(name, value)| typed(name, value)));
        commands.push((name, words));
    }
    Ok(commands)
}

/// Every combination of the values in a table of lists, each with a name made of them.
fn combinations(each: &toml::Table) -> Result<Vec<(String, toml::Table)>, String> {
    let mut all = vec![(String::new(), toml::Table::new())];
    for (option, values) in each {
        let toml::Value::Array(list) = values else {
            return Err(format!("each.{option}: expected a list of values, one for each result"));
        };
        let mut values = Vec::new();
        for value in list {
            match value.as_str().filter(|text| option == "data" && text.contains(['*', '?', '['])) {
                // a pattern stands for its files, one by one
                Some(pattern) => {
                    let files = campaign::expanded(&[PathBuf::from(pattern)]).map_err(|e| said(&e))?;
                    values.extend(files.iter().map(|file| toml::Value::from(file.display().to_string())));
                }
                None => values.push(value.clone()),
            }
        }
        if values.is_empty() {
            return Err(format!("each.{option}: the list is empty"));
        }
        all = all
            .iter()
            .flat_map(|(name, table)| {
                values.iter().map(move |value| {
                    let mut table = table.clone();
                    table.insert(option.clone(), value.clone());
                    let own = plain_name(value);
                    (if name.is_empty() { own } else { format!("{name}-{own}") }, table)
                })
            })
            .collect();
    }
    // values that make the same name are numbered
    let names: Vec<String> = all.iter().map(|(name, _)| name.clone()).collect();
    for (k, (name, _)) in all.iter_mut().enumerate() {
        if names.iter().filter(|other| *other == name).count() > 1 {
            *name = format!("{name}#{}", k + 1);
        }
    }
    Ok(all)
}

/// A value as the part of a file's name: the stem of a file, or the value itself.
fn plain_name(value: &toml::Value) -> String {
    let one = |value: &toml::Value| match value.as_str() {
        Some(text) if text.contains(['/', '.']) => {
            Path::new(text).file_stem().map_or_else(|| text.to_string(), |stem| stem.to_string_lossy().into_owned())
        }
        Some(text) => text.to_string(),
        None => plain(value),
    };
    let whole = match value {
        toml::Value::Array(list) => list.iter().map(one).collect::<Vec<_>>().join("+"),
        other => one(other),
    };
    whole.chars().map(|c| if c.is_alphanumeric() || "-_.+=".contains(c) { c } else { '_' }).collect()
}

/// The words of a command with what the project file of the working folder adds to them.
pub(crate) fn completed(words: &[String]) -> Result<Vec<String>, Failure> {
    let all = std::iter::once("fdm".to_string()).chain(words.iter().cloned()).map(Into::into).collect();
    let all = project::completed(all, &crate::command())?;
    Ok(all.iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect())
}

/// The name of the plan in a folder with results.
const PLAN: &str = "job.plan";
/// The folder with the results in that folder.
const RESULTS: &str = "results";

/// A folder in which a plan is followed.
pub(crate) struct JobFolder {
    pub(crate) folder: PathBuf,
    pub(crate) plan: Plan,
    pub(crate) results: TaskResults,
}

impl JobFolder {
    /// The folder of a plan; the working folder becomes that of its commands.
    pub(crate) fn of(plan: Plan, folder: &Path) -> Result<Self, Failure> {
        let program = program_fingerprint().or_failure()?;
        if plan.program != program {
            return Err(Failure::Input(vec![format!(
                "the plan was made by another build of fdm (version {}, SHA-256 {}; this is {program}), whose numbers may differ in the last digits: use that build, or make the plan anew",
                plan.fdm, plan.program
            )]));
        }
        let folder = std::path::absolute(folder).map_err(|e| Failure::at(folder, &e))?;
        let own = Provenance { plan: plan.id.clone(), program: program.into() };
        let results = TaskResults::new(folder.join(RESULTS), own);
        std::env::set_current_dir(&plan.folder).map_err(|e| Failure::at(&plan.folder, &e))?;
        Ok(Self { folder, plan, results })
    }

    /// The plan that is followed in a folder.
    pub(crate) fn open(folder: &Path) -> Result<Self, Failure> {
        let file = folder.join(PLAN);
        if !file.is_file() {
            let said =
                format!("{}: no job is worked on here; `fdm job run PLAN --out DIR` begins one", folder.display());
            return Err(Failure::Input(vec![said]));
        }
        Self::of(read_plan(&file)?, folder)
    }

    /// The plan that the folder holds, where it holds one.
    pub(crate) fn held(&self) -> Result<Option<Plan>, Failure> {
        let file = self.folder.join(PLAN);
        if file.is_file() { read_plan(&file).map(Some) } else { Ok(None) }
    }

    /// The text of the plan as the folder holds it.
    pub(crate) fn plan_file(&self) -> Result<(PathBuf, String), Failure> {
        Ok((self.folder.join(PLAN), self.plan.text().or_failure()?))
    }
}

/// Reads a plan.
pub(crate) fn read_plan(file: &Path) -> Result<Plan, Failure> {
    let text = read_input_text(file).map_err(|e| Failure::at(file, &e))?;
    let place = std::path::absolute(file).map_err(|e| Failure::at(file, &e))?;
    let beside = place.parent().unwrap_or(Path::new("/"));
    Plan::read(&text, beside).map_err(|e| Failure::Input(vec![format!("{}: {e}", file.display())]))
}

/// What differs between the work that was planned and the work as it is now.
pub(crate) fn refuse_other(planned: &Identity, now: &Identity, name: &str) -> Result<(), Failure> {
    let differences = planned.differences(now);
    if differences.is_empty() {
        return Ok(());
    }
    let what: Vec<String> = differences.iter().take(6).map(ToString::to_string).collect();
    let of = if name.is_empty() { String::new() } else { format!(" of {name}") };
    Err(Failure::Input(vec![format!(
        "the work{of} is not what was planned: {}; bring back what has changed, or make the plan anew",
        what.join("; ")
    )]))
}

/// The states that tasks begin with, and the results of tasks, as a command looks for them.
pub(crate) fn kept(plan: &Plan, command: usize, results: &BTreeMap<u64, Vec<u8>>) -> Result<Memory, Failure> {
    let planned = &plan.commands[command];
    let mut all = planned.states();
    all.extend(planned.cut.kept(&planned.names, results).or_failure()?);
    Ok(Memory::with(all))
}

/// The name of this machine.
pub(crate) fn host() -> String {
    let kernel = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let named = kernel.or_else(|| std::env::var("HOSTNAME").or_else(|_| std::env::var("COMPUTERNAME")).ok());
    named.map(|name| name.trim().to_string()).filter(|name| !name.is_empty()).unwrap_or_else(|| "machine".into())
}

/// A file that could not be written.
pub(crate) fn unwritten(path: &Path, error: &std::io::Error) -> Failure {
    Failure::Unwritten(crate::failure::Unwritten(at(path, error)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Result<Vec<String>, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("job.toml");
        std::fs::write(&file, text).expect("written");
        let read = read_job(&file).map_err(|e| said(&e))?;
        Ok(read.iter().map(|(name, words)| format!("{name}: {}", words.join(" "))).collect())
    }

    #[test]
    fn a_job_is_a_command_with_its_options() {
        let text = "command = 'fit'\nmodel = 'a.fdm'\ndata = ['1.csv', '2.csv']\nstarts = 20\nseed = 3\nset = ['k=1']\njson = true";
        let expected = ": fit a.fdm --data=1.csv --data=2.csv --json --seed=3 --set=k=1 --starts=20";
        assert_eq!(words(text).as_deref(), Ok(&[expected.to_string()][..]));
    }

    #[test]
    fn each_value_makes_a_result() {
        let text = "command = 'fit'\nout = 'all'\n[each]\nmodel = ['m/a.fdm', 'm/b.fdm']\ndata = ['1.csv', ['2.csv', '3.csv']]";
        let found = words(text).expect("a job");
        assert_eq!(found.len(), 4);
        assert_eq!(found[0], "1-a: fit m/a.fdm --data=1.csv --out=all/1-a");
        assert_eq!(found[3], "2+3-b: fit m/b.fdm --data=2.csv --data=3.csv --out=all/2+3-b");
    }

    #[test]
    fn mistakes_of_a_job_are_told_with_the_nearest_name() {
        let refused = |text: &str| words(text).expect_err("refused");
        assert!(refused("model = 'a.fdm'").contains("`command` is missing"));
        assert!(refused("command = 'studdy'").contains("did you mean `study`?"));
        assert!(refused("command = 'study'\nrepeatz = 3").contains("did you mean `repeats`?"));
        assert!(refused("command = 'study'\ncheckpoint = 'x'").contains("not an option of a job"));
        assert!(refused("command = 'fit'\neach = 3").contains("`each` is a table"));
        assert!(refused("command = 'fit'\n[each]\nmodel = ['a.fdm']").contains("several results need a folder"));
        assert!(refused("command = 'fit'\nout = 'x'\n[each]\nmodel = 'a.fdm'").contains("expected a list"));
        assert!(refused("command = ").contains("job.toml"));
    }
}
