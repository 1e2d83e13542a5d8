//! What is to be done, as a file: commands with their words, the tasks that they are cut into, and what all tasks begin with.

use super::tasks::{Kind, Tasks};
use fdm_results::store::{Identity, TaskKey, fingerprint};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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
