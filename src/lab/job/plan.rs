//! What is to be done, as a file: commands with their words, the tasks that they are cut into, and what all tasks begin with.
//!
//! Which part of the tasks one program does: the i-th of N, as it was typed, or as the engine that has started the program says.

use super::tasks::{Kind, Tasks};
use fdm_results::store::{Identity, TaskKey, fingerprint};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Says that a text is one of ours.
const KIND: &str = "fdm plan";
/// Changes when an older program could not read it any more.
const FORMAT: u32 = 1;

/// A plan. Its numbers are those of one program, and no other takes part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    kind: String,
    format: u32,
    /// Version of the program.
    pub fdm: String,
    /// SHA-256 of the program.
    pub program: String,
    /// Decides which results belong to it: SHA-256 of program, commands, models, data and options. The number of repeats is not part of it.
    pub id: String,
    /// The folder that paths in the commands are relative to: from the folder of this file, or from the root.
    pub folder: PathBuf,
    /// Seconds that one task took on one thread when the plan was made; none where none was timed.
    pub seconds: Option<f64>,
    /// The commands.
    pub commands: Vec<PlannedCommand>,
    /// SHA-256 of this text with nothing between these quotes.
    sha256: String,
}

/// A command that was cut into tasks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedCommand {
    /// What tells its result from those of the others; empty where there is only one.
    pub name: String,
    /// The command line without the program.
    pub words: Vec<String>,
    /// How it is cut.
    pub cut: Kind,
    /// How many tasks there are.
    pub tasks: u64,
    /// Their names, where they have others than their numbers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
    /// Everything that the bits of its result depend on.
    pub identity: Identity,
    /// The state that all tasks begin with, as hexadecimal digits.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    states: BTreeMap<String, String>,
}

/// Why a text is no plan that can be followed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PlanError {
    /// Something else.
    #[error("this is no plan; `fdm job plan JOB.toml` makes one")]
    Foreign,
    /// Of a later version.
    #[error("this plan is of a newer fdm (format {0}; this program reads format {FORMAT})")]
    Newer(u32),
    /// Changed since it was made, or torn.
    #[error("this plan was changed or torn since it was made; `fdm job plan JOB.toml` makes it anew")]
    Damaged,
}

impl PlannedCommand {
    /// A command of these words with these tasks, whose bits depend on `identity`.
    pub fn new(name: &str, words: &[String], tasks: &dyn Tasks, identity: &Identity) -> Self {
        Self {
            name: name.into(),
            words: words.to_vec(),
            cut: tasks.kind(),
            tasks: tasks.count(),
            names: tasks.names(),
            identity: identity.clone(),
            states: BTreeMap::new(),
        }
    }

    /// With the states that all its tasks begin with.
    pub fn with_states(mut self, states: &BTreeMap<String, Vec<u8>>) -> Self {
        let digits = |bytes: &Vec<u8>| bytes.iter().map(|b| format!("{b:02x}")).collect();
        self.states = states.iter().map(|(name, bytes)| (name.clone(), digits(bytes))).collect();
        self
    }

    /// The states that all its tasks begin with. What cannot be read is computed anew.
    pub fn states(&self) -> BTreeMap<String, Vec<u8>> {
        let bytes = |digits: &String| -> Option<Vec<u8>> {
            let pair = |k: usize| u8::from_str_radix(digits.get(k..k + 2)?, 16).ok();
            (0..digits.len()).step_by(2).map(pair).collect()
        };
        self.states.iter().filter_map(|(name, digits)| Some((name.clone(), bytes(digits)?))).collect()
    }

    /// What a task is called.
    pub fn task(&self, task: u64) -> String {
        let own = self.names.get(task as usize).cloned();
        let own = own.unwrap_or_else(|| match self.cut {
            Kind::Whole => self.words.first().cloned().unwrap_or_default(),
            cut => format!("{} {}", cut.task(), task + 1),
        });
        if self.name.is_empty() { own } else { format!("{own} of {}", self.name) }
    }
}

impl Plan {
    /// Of these commands, by the program with this fingerprint.
    ///
    /// # Errors
    /// When it has no text.
    pub fn new(program: &str, folder: PathBuf, commands: Vec<PlannedCommand>) -> Result<Self, serde_json::Error> {
        let parts: Vec<(&str, Kind, &Identity)> =
            commands.iter().map(|c| (c.name.as_str(), c.cut, &c.identity)).collect();
        let id = fingerprint(serde_json::to_string(&(FORMAT, program, parts))?.as_bytes());
        Ok(Self {
            kind: KIND.into(),
            format: FORMAT,
            fdm: env!("CARGO_PKG_VERSION").into(),
            program: program.into(),
            id,
            folder,
            seconds: None,
            commands,
            sha256: String::new(),
        })
    }

    /// The text of the file.
    ///
    /// # Errors
    /// When it has none.
    pub fn text(&self) -> Result<String, serde_json::Error> {
        let mut sealed = Self { sha256: String::new(), ..self.clone() };
        sealed.sha256 = fingerprint(serde_json::to_string_pretty(&sealed)?.as_bytes());
        Ok(serde_json::to_string_pretty(&sealed)? + "\n")
    }

    /// Reads what [`Self::text`] made; its folder is that of the file where it is not from the root.
    ///
    /// # Errors
    /// [`PlanError`]
    pub fn read(text: &str, beside: &Path) -> Result<Self, PlanError> {
        #[derive(Deserialize)]
        struct Head {
            kind: String,
            format: u32,
        }
        let head: Head = serde_json::from_str(text).map_err(|_| match text.contains(KIND) {
            true => PlanError::Damaged,
            false => PlanError::Foreign,
        })?;
        if head.kind != KIND {
            return Err(PlanError::Foreign);
        }
        if head.format > FORMAT {
            return Err(PlanError::Newer(head.format));
        }
        let plan: Self = serde_json::from_str(text).map_err(|_| PlanError::Damaged)?;
        if !plan.text().is_ok_and(|own| own == text) {
            return Err(PlanError::Damaged);
        }
        Ok(Self { folder: beside.join(&plan.folder), ..plan })
    }

    /// How many tasks there are.
    pub fn count(&self) -> u64 {
        self.commands.iter().map(|c| c.tasks).sum()
    }

    /// All tasks in their order, each with its number among all.
    pub fn tasks(&self) -> impl Iterator<Item = (u64, TaskKey)> + '_ {
        let commands = self.commands.iter().enumerate();
        let keys = commands.flat_map(|(k, c)| (0..c.tasks).map(move |task| TaskKey { command: k as u32, task }));
        keys.enumerate().map(|(k, key)| (k as u64, key))
    }

    /// What a task is called.
    pub fn task(&self, key: TaskKey) -> String {
        self.commands.get(key.command as usize).map_or_else(String::new, |command| command.task(key.task))
    }
}

/// The `index`-th of `count` parts, from 0: every task whose number leaves the remainder `index`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 0.
    pub index: u64,
    /// At least one.
    pub count: u64,
}

/// Why a shard is none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ShardError {
    /// It is not `i/N`.
    Words,
    /// No engine says which part this is.
    Alone,
    /// The engine says which part this is, but not of how many.
    Count {
        /// The variable that says which.
        variable: &'static str,
    },
    /// A variable of the engine that is no number, or beyond the others.
    Variable {
        /// The variable.
        variable: &'static str,
        /// What it holds.
        value: String,
    },
}

impl fmt::Display for ShardError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Words => f.write_str("expected I/N with I from 1 to N, such as 3/20, or `auto`, or auto/N"),
            Self::Alone => write!(
                f,
                "`auto`: no engine says which part this is; looked for {}",
                ENGINES.map(|engine| engine.index).join(", ")
            ),
            Self::Count { variable } => {
                write!(f, "`auto`: {variable} says which part this is, and nothing of how many; give --shard auto/N")
            }
            Self::Variable { variable, value } => {
                write!(f, "`auto`: {variable}={value}: expected a number of a part that there is")
            }
        }
    }
}

impl std::error::Error for ShardError {}

/// The variables by which an engine numbers the programs that it starts.
struct Engine {
    index: &'static str,
    /// The number of the first, as a variable or as it is.
    first: Number,
    /// How far the numbers of neighbours lie apart, as a variable.
    step: Option<&'static str>,
    /// Either the number of the last, or how many there are.
    extent: Option<Extent>,
}

enum Number {
    Is(u64),
    Variable(&'static str),
}

enum Extent {
    Last(&'static str),
    Count(&'static str),
}

/// The variables, by the manuals of the engines.
const ENGINES: [Engine; 10] = [
    // sbatch(1)
    Engine {
        index: "SLURM_ARRAY_TASK_ID",
        first: Number::Variable("SLURM_ARRAY_TASK_MIN"),
        step: Some("SLURM_ARRAY_TASK_STEP"),
        extent: Some(Extent::Last("SLURM_ARRAY_TASK_MAX")),
    },
    // HyperQueue: the number in the array
    Engine { index: "HQ_TASK_ID", first: Number::Is(1), step: None, extent: None },
    // PBS Professional and OpenPBS, qsub(1B)
    Engine { index: "PBS_ARRAY_INDEX", first: Number::Is(1), step: None, extent: None },
    // Grid Engine, qsub(1)
    Engine {
        index: "SGE_TASK_ID",
        first: Number::Variable("SGE_TASK_FIRST"),
        step: Some("SGE_TASK_STEPSIZE"),
        extent: Some(Extent::Last("SGE_TASK_LAST")),
    },
    // LSF
    Engine { index: "LSB_JOBINDEX", first: Number::Is(1), step: None, extent: Some(Extent::Last("LSB_JOBINDEX_END")) },
    // Kubernetes, Indexed Job
    Engine { index: "JOB_COMPLETION_INDEX", first: Number::Is(0), step: None, extent: None },
    // AWS Batch
    Engine { index: "AWS_BATCH_JOB_ARRAY_INDEX", first: Number::Is(0), step: None, extent: None },
    // GNU parallel
    Engine { index: "PARALLEL_SEQ", first: Number::Is(1), step: None, extent: None },
    // MPI: Open MPI, then those with the process manager's interface (MPICH, Intel)
    Engine {
        index: "OMPI_COMM_WORLD_RANK",
        first: Number::Is(0),
        step: None,
        extent: Some(Extent::Count("OMPI_COMM_WORLD_SIZE")),
    },
    Engine { index: "PMI_RANK", first: Number::Is(0), step: None, extent: Some(Extent::Count("PMI_SIZE")) },
];
/// Ranks of MPI stand last: an array of MPI programs has both, and each of its programs all ranks.
const RANKS: usize = 2;

impl Shard {
    /// All tasks.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Whether a task belongs to it, by its number.
    pub fn has(self, task: u64) -> bool {
        task % self.count == self.index
    }

    /// `i/N` with i from 1; `auto` and `auto/N` as the environment says.
    ///
    /// # Errors
    /// [`ShardError`]
    pub fn read(words: &str, variable: &dyn Fn(&str) -> Option<String>) -> Result<Self, ShardError> {
        match words.split_once('/') {
            None if words == "auto" => Self::of_engine(None, variable),
            Some(("auto", count)) => {
                let count: u64 = count.parse().ok().filter(|n| *n > 0).ok_or(ShardError::Words)?;
                Self::of_engine(Some(count), variable)
            }
            _ => words.parse(),
        }
    }

    fn of_engine(count: Option<u64>, variable: &dyn Fn(&str) -> Option<String>) -> Result<Self, ShardError> {
        let found = |engines: &'static [Engine]| engines.iter().find(|e| variable(e.index).is_some());
        let (arrays, ranks) = ENGINES.split_at(ENGINES.len() - RANKS);
        match (found(arrays), found(ranks)) {
            (None, None) => Err(ShardError::Alone),
            (Some(one), None) | (None, Some(one)) => one.shard(count, variable),
            // every program of the array is started once for each rank
            (Some(array), Some(rank)) => {
                let inner = rank.shard(None, variable)?;
                let outer = array.shard(count.map(|all| (all / inner.count).max(1)), variable)?;
                Ok(Self { index: outer.index * inner.count + inner.index, count: outer.count * inner.count })
            }
        }
    }
}

impl Engine {
    fn shard(&self, count: Option<u64>, variable: &dyn Fn(&str) -> Option<String>) -> Result<Shard, ShardError> {
        let number = |name: &'static str| -> Result<Option<u64>, ShardError> {
            let Some(value) = variable(name) else { return Ok(None) };
            let read = value.trim().parse().ok();
            read.map(Some).ok_or(ShardError::Variable { variable: name, value })
        };
        let beyond = || ShardError::Variable { variable: self.index, value: variable(self.index).unwrap_or_default() };
        let own = number(self.index)?.ok_or(ShardError::Alone)?;
        let first = match self.first {
            Number::Is(first) => first,
            Number::Variable(name) => number(name)?.unwrap_or(1),
        };
        let step = self.step.map(number).transpose()?.flatten().filter(|s| *s > 0).unwrap_or(1);
        let index = own.checked_sub(first).ok_or_else(beyond)? / step;
        let said = match &self.extent {
            Some(Extent::Last(name)) => number(name)?.map(|last| last.saturating_sub(first) / step + 1),
            Some(Extent::Count(name)) => number(name)?,
            None => None,
        };
        // what was typed goes before what is said: an array may be started again in part
        let count = count.or(said).ok_or(ShardError::Count { variable: self.index })?;
        if index < count { Ok(Shard { index, count }) } else { Err(beyond()) }
    }
}

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(words: &str) -> Result<Self, ShardError> {
        let (index, count) = words.split_once('/').ok_or(ShardError::Words)?;
        let number = |text: &str| text.trim().parse::<u64>().map_err(|_| ShardError::Words);
        let (index, count) = (number(index)?, number(count)?);
        if index == 0 || index > count { Err(ShardError::Words) } else { Ok(Self { index: index - 1, count }) }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(repeats: u64, seed: u64) -> Plan {
        let command = |name: &str| PlannedCommand {
            name: name.into(),
            words: vec!["study".into()],
            cut: Kind::Repeats,
            tasks: repeats,
            names: Vec::new(),
            identity: Identity::of_texts(&[], &seed),
            states: BTreeMap::new(),
        };
        let states = BTreeMap::from([("fit".to_string(), vec![0, 255, 16])]);
        let commands = vec![command("a").with_states(&states), command("b")];
        Plan::new("program", PathBuf::new(), commands).unwrap()
    }

    #[test]
    fn a_plan_is_read_back_and_a_change_is_noticed() {
        let made = Plan { seconds: Some(0.1 + 0.2), ..plan(10, 1) };
        let text = made.text().unwrap();
        let read = Plan::read(&text, Path::new("/desk")).unwrap();
        assert_eq!((read.folder.as_path(), read.seconds, read.count()), (Path::new("/desk"), Some(0.1 + 0.2), 20));
        assert_eq!(read.commands[0].states()["fit"], [0, 255, 16]);
        assert_eq!(Plan::read(&text.replace("\"tasks\": 10", "\"tasks\": 11"), Path::new("")), Err(PlanError::Damaged));
        assert_eq!(Plan::read(&text[..text.len() / 2], Path::new("")), Err(PlanError::Damaged));
        assert_eq!(Plan::read("thesis", Path::new("")), Err(PlanError::Foreign));
        assert_eq!(
            Plan::read(&text.replace("\"format\": 1", "\"format\": 2"), Path::new("")),
            Err(PlanError::Newer(2))
        );
    }

    #[test]
    fn more_repeats_are_the_same_plan_and_another_seed_is_not() {
        assert_eq!(plan(10, 1).id, plan(20, 1).id);
        assert_ne!(plan(10, 1).id, plan(10, 2).id);
        let keys: Vec<(u64, TaskKey)> = plan(2, 1).tasks().collect();
        assert_eq!(keys[2], (2, TaskKey { command: 1, task: 0 }));
        assert_eq!(plan(2, 1).task(keys[3].1), "repeat 2 of b");
    }
}

#[cfg(test)]
mod shard_tests {
    use super::*;

    fn auto(words: &str, environment: &[(&str, &str)]) -> Result<String, String> {
        let variable = |name: &str| environment.iter().find(|(n, _)| *n == name).map(|(_, v)| v.to_string());
        Shard::read(words, &variable).map(|s| s.to_string()).map_err(|e| e.to_string())
    }

    #[test]
    fn shards_are_what_engines_say() {
        let slurm = [("SLURM_ARRAY_TASK_ID", "7"), ("SLURM_ARRAY_TASK_MIN", "3"), ("SLURM_ARRAY_TASK_MAX", "11")];
        assert_eq!(auto("auto", &slurm).as_deref(), Ok("5/9"));
        let stepped = [&slurm[..], &[("SLURM_ARRAY_TASK_STEP", "4")]].concat();
        assert_eq!(auto("auto", &stepped).as_deref(), Ok("2/3"));
        assert_eq!(auto("auto", &[("OMPI_COMM_WORLD_RANK", "0"), ("OMPI_COMM_WORLD_SIZE", "4")]).as_deref(), Ok("1/4"));
        assert_eq!(auto("auto/20", &[("JOB_COMPLETION_INDEX", "19")]).as_deref(), Ok("20/20"));
        assert_eq!(auto("auto/20", &[("PBS_ARRAY_INDEX", "20")]).as_deref(), Ok("20/20"));
        // an array of MPI programs
        let both = [&slurm[..], &[("PMI_RANK", "1"), ("PMI_SIZE", "2")]].concat();
        assert_eq!(auto("auto", &both).as_deref(), Ok("10/18"));
        assert_eq!(auto("3/20", &slurm).as_deref(), Ok("3/20"));
    }

    #[test]
    fn what_is_no_shard_is_told() {
        for words in ["0/3", "4/3", "3", "x/3", "auto/0", "auto/x", "-1/3", "/", ""] {
            assert!(auto(words, &[("HQ_TASK_ID", "1")]).unwrap_err().contains("I/N"), "{words}");
        }
        assert!(auto("auto", &[]).unwrap_err().contains("no engine"));
        assert!(auto("auto", &[("HQ_TASK_ID", "1")]).unwrap_err().contains("auto/N"));
        assert!(auto("auto/2", &[("HQ_TASK_ID", "3")]).unwrap_err().contains("HQ_TASK_ID=3"));
        assert!(auto("auto/2", &[("HQ_TASK_ID", "0")]).unwrap_err().contains("HQ_TASK_ID=0"));
        assert!(auto("auto/2", &[("HQ_TASK_ID", "one")]).unwrap_err().contains("HQ_TASK_ID=one"));
    }

    #[test]
    fn every_task_belongs_to_one_shard() {
        for count in 1..7 {
            let owners = |task: u64| (0..count).filter(|index| Shard { index: *index, count }.has(task)).count();
            assert!((0..50).all(|task| owners(task) == 1));
        }
    }
}
