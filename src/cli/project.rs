//! The project file `fdm.toml`: what a command would be told again and again (model, records, map, options). It is looked for in the working
//! directory and in those above it; what is typed goes before it.

use crate::failure::{Failure, did_you_mean, remark};
use crate::trust::{outside, refuse_other_owner, typed_only};
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command};
use fdm_results::store::read_input_text;
use fdm_session::foreign_code::{ALLOW_UNITS, models_are_named_by};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The name of the file.
pub(crate) const NAME: &str = "fdm.toml";
/// The option that leaves it aside.
const ASIDE: &str = "--no-project";

/// Options that say how records are read, or what is made of them, where a command can do without records.
const OF_RECORDS: [&str; 7] = ["map", "map-file", "zoh", "linear", "known", "begin", "forgetting"];

/// Options that name a model, or a result that has one.
const NAMING_MODELS: [&str; 4] = ["model", "from-result", "between", "against"];

/// What the file holds; paths are relative to its folder.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Project {
    /// The model.
    model: Option<PathBuf>,
    /// Records that are fitted, or patterns.
    #[serde(default)]
    data: Several,
    /// Records that are predicted, or patterns.
    #[serde(default)]
    validation: Several,
    /// A table of runs, in the place of both.
    runs: Option<PathBuf>,
    /// A map of channels: a file, or the name of one that comes with the program.
    map: Option<String>,
    /// Options by their long names, for all commands that have them; in a table of a command's name, for that alone.
    #[serde(default)]
    options: BTreeMap<String, toml::Value>,
}

/// One text, or several.
#[derive(Debug, Default, Deserialize)]
#[serde(untagged)]
enum Several {
    #[default]
    None,
    One(String),
    Many(Vec<String>),
}

impl Several {
    fn list(&self) -> &[String] {
        match self {
            Self::None => &[],
            Self::One(one) => std::slice::from_ref(one),
            Self::Many(many) => many,
        }
    }
}

/// The words of a command line with what the project file adds to them, which is remarked.
pub(crate) fn completed(words: Vec<OsString>, command: &Command) -> Result<Vec<OsString>, Failure> {
    let (words, added) = completion(words, command)?;
    added.into_iter().for_each(|note| remark(format_args!("{note}")));
    Ok(words)
}

/// The words of a command line with what the project file adds to them, and a note of that.
pub(crate) fn completion(
    mut words: Vec<OsString>,
    command: &Command,
) -> Result<(Vec<OsString>, Option<String>), Failure> {
    let aside = words.iter().any(|w| w == ASIDE);
    words.retain(|w| w != ASIDE);
    if aside {
        return Ok((words, None));
    }
    let lenient = command.clone().ignore_errors(true).try_get_matches_from(&words);
    let Some((verb, typed)) = lenient.as_ref().ok().and_then(ArgMatches::subcommand) else { return Ok((words, None)) };
    let Some(of_verb) = command.find_subcommand(verb) else { return Ok((words, None)) };
    let takes = |id: &str| of_verb.get_arguments().any(|a| a.get_id() == id);
    if !takes("data") && !takes("model") {
        return Ok((words, None));
    }
    let Some((up, text)) = found()? else { return Ok((words, None)) };
    let file = up.join(NAME);
    let allowed = words.iter().any(|w| w == ALLOW_UNITS);
    let project: Project = toml::from_str(&text)
        .map_err(|e| Failure::input([format!("{}: {}", file.display(), e.to_string().trim_end())]))?;
    let asked = Asked { project: &project, up: &up, verb: of_verb, typed };
    let (in_front, behind) = (asked.model(), asked.records().into_iter().chain(asked.options(command, &file)?));
    if !in_front.is_empty() || asked.adds_a_result() {
        models_are_named_by(file.display().to_string(), allowed);
    }
    let added: Vec<String> = in_front.iter().cloned().chain(behind).collect();
    let mut note = None;
    if !added.is_empty() {
        note = Some(format!("note: {} adds {}", file.display(), added.join(" ")));
        let at = words.iter().position(|w| *w == *verb).map_or(words.len(), |k| k + 1);
        let (front, back) = added.split_at(in_front.len());
        words.splice(at..at, front.iter().map(OsString::from));
        words.extend(back.iter().map(OsString::from));
    }
    Ok((words, note))
}

/// The way up to the folder of the file, and its text.
fn found() -> Result<Option<(PathBuf, String)>, Failure> {
    let Ok(here) = std::env::current_dir() else { return Ok(None) };
    let mut up = PathBuf::new();
    for folder in here.ancestors() {
        let file = folder.join(NAME);
        // a folder of that name is none of ours, and what cannot be looked at is not there for this user
        if std::fs::metadata(&file).is_ok_and(|about| !about.is_dir()) {
            refuse_other_owner(&file)?;
            let text = read_input_text(&file).map_err(|e| Failure::at(&up.join(NAME), &e))?;
            return Ok(Some((up, text)));
        }
        up.push("..");
    }
    Ok(None)
}

/// A command that a project file is to complete.
struct Asked<'a> {
    project: &'a Project,
    up: &'a Path,
    verb: &'a Command,
    typed: &'a ArgMatches,
}

impl Asked<'_> {
    fn argument(&self, id: &str) -> Option<&Arg> {
        self.verb.get_arguments().find(|a| a.get_id() == id)
    }

    fn is_typed(&self, id: &str) -> bool {
        self.argument(id).is_some() && self.typed.value_source(id) == Some(ValueSource::CommandLine)
    }

    fn at(&self, path: impl AsRef<Path>) -> String {
        self.up.join(path).display().to_string()
    }

    /// Whether a result, and with it a model, comes from the file.
    fn adds_a_result(&self) -> bool {
        let own = self.project.options.get(self.verb.get_name()).and_then(toml::Value::as_table);
        NAMING_MODELS.iter().any(|name| {
            let said = self.project.options.contains_key(*name) || own.is_some_and(|table| table.contains_key(*name));
            let id = name.replace('-', "_");
            said && self.argument(&id).is_some() && !self.is_typed(&id)
        })
    }

    /// The model, where the command takes one and none is typed.
    fn model(&self) -> Vec<String> {
        let wanted = self.argument("model").is_some_and(Arg::is_positional)
            && !["model", "from_result", "between"].iter().any(|id| self.is_typed(id));
        self.project.model.iter().filter(|_| wanted).map(|m| self.at(m)).collect()
    }

    /// Whether the command works on records, as far as its options say.
    fn works_on_records(&self) -> bool {
        self.verb.get_name() != "export" || self.is_typed("recursive")
    }

    /// Whether it takes the records that a result names: what is validated or compared is not among them.
    fn takes_records_of_a_result(&self) -> bool {
        self.is_typed("from_result") && !["validate", "compare"].contains(&self.verb.get_name())
    }

    fn records(&self) -> Vec<String> {
        if !self.works_on_records() {
            return Vec::new();
        }
        let project = self.project;
        let takes = |id: &str| self.argument(id).is_some();
        let mut added = Vec::new();
        let predicts = ["validate", "compare"].contains(&self.verb.get_name());
        let table = self.argument("runs").is_some_and(|a| a.get_long() == Some("runs") && !a.is_required_set())
            && (takes("salvage") || self.verb.get_name() == "export")
            && self.verb.get_name() != "design";
        let named = self.is_typed("data") || table && self.is_typed("runs") || self.takes_records_of_a_result();
        if takes("data") && !named {
            let list =
                if predicts && !project.validation.list().is_empty() { &project.validation } else { &project.data };
            if let (Some(runs), true) = (&project.runs, table) {
                added.extend(["--runs".to_string(), self.at(runs)]);
            } else if self.verb.get_name() != "compare" || !project.validation.list().is_empty() {
                added.extend(list.list().iter().map(|file| format!("--data={}", self.at(file))));
            }
        }
        let regressed = self.verb.get_name() == "fit" && self.of("method").as_deref() == Some("equation-error");
        if takes("validation")
            && !self.is_typed("validation")
            && !self.is_typed("data")
            && !regressed
            && project.runs.is_none()
        {
            added.extend(project.validation.list().iter().map(|file| format!("--validation={}", self.at(file))));
        }
        if let Some(map) = project
            .map
            .as_ref()
            .filter(|_| takes("map_file") && !self.is_typed("map_file") && (!added.is_empty() || self.is_typed("data")))
        {
            let beside = self.at(map);
            added.push(format!("--map-file={}", if Path::new(&beside).exists() { &beside } else { map }));
        }
        added
    }

    /// The value of an option, typed or of the project.
    fn of(&self, id: &str) -> Option<String> {
        if self.is_typed(id) {
            return self.typed.get_raw(id)?.next().map(|v| v.to_string_lossy().into_owned());
        }
        let own = self.project.options.get(self.verb.get_name()).and_then(|t| t.get(id));
        own.or_else(|| self.project.options.get(id)).and_then(toml::Value::as_str).map(String::from)
    }

    fn options(&self, command: &Command, file: &Path) -> Result<Vec<String>, Failure> {
        let (mut added, mut wrong) = (Vec::new(), Vec::new());
        let long = |c: &Command, name: &str| {
            c.get_arguments().find(|a| a.get_long() == Some(name)).map(|a| a.get_id().to_string())
        };
        let mut own: BTreeMap<&str, &toml::Value> = BTreeMap::new();
        for (name, value) in &self.project.options {
            if let toml::Value::Table(table) = value {
                let Some(verb) = command.find_subcommand(name) else {
                    let hint = did_you_mean(name, command.get_subcommands().map(Command::get_name));
                    wrong.push(format!("{}: options.{name}: there is no such command{hint}", file.display()));
                    continue;
                };
                for (name, value) in table {
                    if long(verb, name).is_none() {
                        let known = verb.get_arguments().filter_map(Arg::get_long);
                        let (hint, of) = (did_you_mean(name, known), verb.get_name());
                        wrong.push(format!(
                            "{}: options.{of}.{name}: `fdm {of}` has no option --{name}{hint}",
                            file.display()
                        ));
                    } else if verb.get_name() == self.verb.get_name() {
                        own.insert(name, value);
                    }
                }
                continue;
            }
            if !command.get_subcommands().any(|c| long(c, name).is_some()) {
                let known: Vec<&str> =
                    command.get_subcommands().flat_map(|c| c.get_arguments().filter_map(Arg::get_long)).collect();
                let hint = did_you_mean(name, known.iter().copied());
                wrong.push(format!("{}: options.{name}: no command has an option --{name}{hint}", file.display()));
            } else if long(self.verb, name).is_some() {
                own.entry(name).or_insert(value);
            }
        }
        // a result says how its own records were read
        let of_result = self.takes_records_of_a_result() && !self.is_typed("data") && !self.is_typed("runs");
        for (name, value) in own {
            if let Some(why) = typed_only(name) {
                wrong.push(format!("{}: options.{name}: {why}", file.display()));
                continue;
            }
            let is_of_records = OF_RECORDS.contains(&name) && (of_result || !self.works_on_records());
            if is_of_records || long(self.verb, name).is_some_and(|id| self.is_typed(&id)) {
                continue;
            }
            let id = long(self.verb, name).unwrap_or_default();
            let values =
                if let toml::Value::Array(list) = value { list.as_slice() } else { std::slice::from_ref(value) };
            let places = values.iter().filter_map(toml::Value::as_str).map(Path::new);
            let told = places.filter_map(|place| outside(self.verb.get_name(), &id, place, self.up));
            wrong.extend(told.map(|said| format!("{}: options.{name}: {said}", file.display())));
            added.extend(typed(name, value));
        }
        if wrong.is_empty() { Ok(added) } else { Err(Failure::Input(wrong)) }
    }
}

/// An option with its value, as words: one for each item of a list, none for `false`.
pub(crate) fn typed(name: &str, value: &toml::Value) -> Vec<String> {
    match value {
        toml::Value::Boolean(true) => vec![format!("--{name}")],
        toml::Value::Boolean(false) => Vec::new(),
        toml::Value::Array(list) => list.iter().map(|v| format!("--{name}={}", plain(v))).collect(),
        one => vec![format!("--{name}={}", plain(one))],
    }
}

/// A value as it is typed.
pub(crate) fn plain(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Integer(number) => number.to_string(),
        toml::Value::Float(number) => number.to_string(),
        toml::Value::Boolean(truth) => truth.to_string(),
        toml::Value::Datetime(stamp) => stamp.to_string(),
        toml::Value::Array(list) => list.iter().map(plain).collect::<Vec<_>>().join(","),
        toml::Value::Table(_) => String::new(),
    }
}
