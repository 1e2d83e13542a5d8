//! What a command works on, told apart by what it is: a model ends in `.fdm`, the folder of a result holds its manifest, all else is a
//! record. Their order does not matter, and records need no `--data`; what cannot be told is answered with the line to type.

use crate::failure::Failure;
use clap::builder::ValueRange;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, ArgMatches, Command};
use fdm_results::store::ResultFolder;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// The place of records behind the model.
const RECORD: &str = "record";
/// Endings of models.
const MODEL: &str = "fdm";
/// Endings of records; what a file holds is seen by its content when it is read.
const RECORDS: [&str; 17] = [
    "csv", "tsv", "dat", "asc", "gz", "npz", "npy", "mat", "ulg", "bin", "log", "h5", "hdf5", "parquet", "xlsx",
    "json", "data",
];

/// What a word names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Model,
    /// The folder of a result.
    Result,
    Record,
    /// A file with another ending, or a folder without a result.
    Other,
    /// Nothing that is there, and no ending.
    Bare,
}

fn kind(word: &OsStr) -> Kind {
    let path = Path::new(word);
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
    let shown = word.to_string_lossy();
    match ending.as_deref() {
        _ if path.is_dir() && ResultFolder::stands_in(path) => Kind::Result,
        Some(MODEL) => Kind::Model,
        Some(ending) if RECORDS.contains(&ending) => Kind::Record,
        _ if shown == "-" || shown.contains(['*', '?', '[']) => Kind::Record,
        Some(_) => Kind::Other,
        None if path.exists() => Kind::Other,
        None => Kind::Bare,
    }
}

/// The words behind a verb: what they name, and the rest.
#[derive(Default)]
struct Picked {
    /// Without an option.
    plain: Vec<(OsString, Kind)>,
    /// Behind `--data`.
    data: Vec<(OsString, Kind)>,
    /// Options with their values.
    rest: Vec<OsString>,
}

/// How many words behind an option are its values.
fn values(argument: &Arg) -> usize {
    if !argument.get_action().takes_values() {
        return 0;
    }
    argument.get_num_args().map_or(1, |range: ValueRange| range.max_values())
}

impl Picked {
    fn of(words: &[OsString], (root, verb): (&Command, &Command)) -> Self {
        let mut picked = Self::default();
        let known = || verb.get_arguments().chain(root.get_arguments());
        let is_option = |word: &OsString| word.len() > 1 && word.to_string_lossy().starts_with('-');
        let mut words = words.iter().peekable();
        while let Some(word) = words.next() {
            let shown = word.to_string_lossy();
            let argument = match shown.strip_prefix("--") {
                Some(long) => known().find(|a| a.get_long() == long.split('=').next()),
                // the last of several letters may take a value
                None if is_option(word) => known().find(|a| a.get_short() == shown.chars().last()),
                None => {
                    picked.plain.push((word.clone(), kind(word)));
                    continue;
                }
            };
            let is_data = argument.is_some_and(|a| a.get_long() == Some("data"));
            match shown.split_once('=').filter(|_| is_data) {
                Some((_, value)) => picked.data.push((value.into(), kind(OsStr::new(value)))),
                None if !is_data => picked.rest.push(word.clone()),
                None => {}
            }
            let count = argument.filter(|_| !(shown.starts_with("--") && shown.contains('='))).map_or(0, values);
            for taken in 0..count {
                // the first value may look like an option, such as a negative number
                let Some(value) = words.next_if(|value| !is_option(value) || count == 1 && taken == 0) else { break };
                match is_data {
                    true => picked.data.push((value.clone(), kind(value))),
                    false => picked.rest.push(value.clone()),
                }
            }
        }
        picked
    }

    fn all(&self, wanted: Kind) -> Vec<&OsString> {
        self.plain.iter().chain(&self.data).filter(|(_, kind)| *kind == wanted).map(|(word, _)| word).collect()
    }
}

/// A line that is to be typed.
fn line<'w>(verb: &Command, words: impl IntoIterator<Item = &'w OsStr>) -> String {
    let shown: Vec<_> = words.into_iter().map(OsStr::to_string_lossy).collect();
    format!("fdm {} {}", verb.get_name(), shown.join(" "))
}

/// Whether a verb has an argument.
fn takes(verb: &Command, id: &str) -> bool {
    verb.get_arguments().any(|a| a.get_id() == id)
}

/// Whether a verb does nothing without a model or a result.
fn needs_model(verb: &Command) -> bool {
    takes(verb, "from_result") || verb.get_arguments().any(|a| a.get_id() == "model" && a.is_required_set())
}

/// The verb of a command line, and where it stands.
fn verb<'c>(words: &[OsString], command: &'c Command) -> Option<(usize, &'c Command)> {
    let lenient = command.clone().ignore_errors(true).try_get_matches_from(words);
    let name = lenient.as_ref().ok().and_then(ArgMatches::subcommand_name)?;
    let verb = command.find_subcommand(name)?;
    (takes(verb, "data") || takes(verb, "from_result")).then_some(())?;
    Some((words.iter().position(|word| word == name)?, verb))
}

/// The words of a command line with the model in front, a result behind `--from-result` and records behind `--data`.
pub(crate) fn sorted(words: Vec<OsString>, command: &Command) -> Result<Vec<OsString>, Failure> {
    let Some((at, verb)) = verb(&words, command) else { return Ok(words) };
    let (front, back) = words.split_at(at + 1);
    // behind two dashes words are what they are
    if back.iter().any(|word| word == "--") {
        return Ok(words);
    }
    let picked = Picked::of(back, (command, verb));
    let found = if takes(verb, "results") { picked.beside_results() } else { picked.told_apart(verb)? };
    let Some((named, records)) = found else { return Ok(words) };
    let mut all = front.to_vec();
    all.extend(named);
    all.extend(picked.rest.iter().cloned());
    all.extend(records.iter().map(|record| option("--data", record)));
    Ok(all)
}

/// An option with its value in one word.
fn option(name: &str, value: &OsStr) -> OsString {
    let mut word = OsString::from(name);
    word.push("=");
    word.push(value);
    word
}

/// Models and results, and records.
type Told = Option<(Vec<OsString>, Vec<OsString>)>;

impl Picked {
    /// Of a verb that works on many results; none where nothing is to be changed.
    fn beside_results(&self) -> Told {
        let is_record = |(_, kind): &&(OsString, Kind)| *kind == Kind::Record;
        let own = |(word, _): &(OsString, Kind)| word.clone();
        self.plain.iter().any(|one| is_record(&one)).then(|| {
            let results = self.plain.iter().filter(|one| !is_record(one)).map(own).collect();
            let records = self.plain.iter().filter(is_record).chain(&self.data).map(own).collect();
            (results, records)
        })
    }

    /// Of a verb that works on one model or result; none where nothing is to be changed.
    fn told_apart(&self, verb: &Command) -> Result<Told, Failure> {
        let is_data = takes(verb, "data");
        let mut results = self.all(Kind::Result);
        if takes(verb, "from_result") {
            results.extend(self.plain.iter().filter(|(_, kind)| *kind == Kind::Bare).map(|(word, _)| word));
        }
        let models = self.all(Kind::Model);
        let is_named = !models.is_empty() || !results.is_empty();
        let usual = self.plain.len() <= 1
            && self.plain.iter().all(|(_, kind)| *kind == Kind::Model)
            && self.data.iter().all(|(_, kind)| *kind != Kind::Model);
        // with records behind an option the only other word is the model, whatever its ending
        let by_option =
            !self.data.is_empty() || self.rest.iter().any(|word| word.to_string_lossy().starts_with("--runs"));
        let only = !is_named && by_option && self.plain.len() == 1 && self.plain[0].1 != Kind::Record;
        if usual || only || !is_data && (results.is_empty() || self.plain.len() > results.len() + models.len()) {
            return Ok(None);
        }
        let records: Vec<OsString> = self
            .plain
            .iter()
            .chain(&self.data)
            .map(|(word, _)| word)
            .filter(|word| !models.contains(word) && !results.contains(word))
            .cloned()
            .collect();
        let seen: Vec<&OsStr> = records.iter().map(OsString::as_os_str).collect();
        self.refuse(verb, (&models, &results), &seen)?;
        let mut named: Vec<OsString> = models.into_iter().cloned().collect();
        named.extend(results.iter().map(|result| option("--from-result", result)));
        Ok(Some((named, records)))
    }

    /// Refuses words that cannot be told apart, with the line to type.
    fn refuse(
        &self,
        verb: &Command,
        (models, results): (&[&OsString], &[&OsString]),
        records: &[&OsStr],
    ) -> Result<(), Failure> {
        let with = |first: &OsStr| line(verb, std::iter::once(first).chain(records.iter().copied()));
        let name = verb.get_name();
        let said = match (models, results) {
            ([one, other, ..], _) => {
                let (one, other) = (one.display(), other.display());
                format!("two models, {one} and {other}: `fdm {name}` works on one:\n  {}", with(models[0]))
            }
            (_, [result, ..]) if !takes(verb, "from_result") => {
                let model = Path::new(result).join("model.fdm");
                let shown = result.display();
                format!("{shown} is a result, and `fdm {name}` takes a model:\n  {}", with(model.as_os_str()))
            }
            (_, [one, other, ..]) => {
                let (one, other) = (one.display(), other.display());
                format!("two results, {one} and {other}: `fdm {name}` works on one:\n  {}", with(results[0]))
            }
            ([], []) if needs_model(verb) => {
                match self.plain.iter().filter(|(_, kind)| *kind == Kind::Other).collect::<Vec<_>>()[..] {
                    [(other, _)] => {
                        let mut rest: Vec<&OsStr> =
                            records.iter().copied().filter(|word| *word != other.as_os_str()).collect();
                        if rest.is_empty() {
                            rest.push(OsStr::new("RUN.csv"));
                        }
                        let all = [other.as_os_str(), OsStr::new("--data")].into_iter().chain(rest);
                        format!(
                            "{} is named neither as a model (.fdm) nor as a record: where it is the model, type\n  {}",
                            other.display(),
                            line(verb, all)
                        )
                    }
                    _ => return Ok(()),
                }
            }
            _ => return Ok(()),
        };
        Err(Failure::input([said]))
    }
}

/// What is missing among the words, with the line to type; none where clap has something else to say.
pub(crate) fn missing(error: &clap::Error, words: &[OsString], command: &Command) -> Option<Failure> {
    let Some(ContextValue::Strings(arguments)) = error.get(ContextKind::InvalidArg) else { return None };
    if error.kind() != ErrorKind::MissingRequiredArgument {
        return None;
    }
    let (at, verb) = verb(words, command)?;
    let lacks = |name: &str| arguments.iter().any(|argument| argument.contains(name));
    let (model, data) = (lacks("<MODEL>"), lacks("--data"));
    if !takes(verb, RECORD) || !model && !data || arguments.len() > usize::from(model) + usize::from(data) {
        return None;
    }
    let picked = Picked::of(&words[at + 1..], (command, verb));
    let own = |kinds: &[Kind]| {
        picked.plain.iter().chain(&picked.data).find(|(_, kind)| kinds.contains(kind)).map(|(word, _)| word.clone())
    };
    let beside = beside();
    let only = |ending: &[&str]| {
        let is = |path: &&PathBuf| path.extension().is_some_and(|e| ending.contains(&e.to_string_lossy().as_ref()));
        let mut found = beside.iter().filter(is);
        found.next().filter(|_| found.next().is_none()).map(|path| path.clone().into_os_string())
    };
    let named = own(&[Kind::Model]).or_else(|| only(&[MODEL]));
    let record = own(&[Kind::Record, Kind::Other]).or_else(|| only(&["csv"]));
    let [named, record] = [named.unwrap_or_else(|| "MODEL.fdm".into()), record.unwrap_or_else(|| "RUN.csv".into())];
    let what = match (model, data) {
        (true, true) => "no model and no record",
        (true, false) => "no model among these words, which would end in .fdm",
        _ => "no record of a run",
    };
    let first = if only(&[MODEL]).is_none() && model { "\n`fdm new MODEL.fdm` writes a first one" } else { "" };
    Some(Failure::input([format!("{what}: type\n  {}{first}", line(verb, [named.as_os_str(), record.as_os_str()]))]))
}

/// The files in the working folder, in order.
fn beside() -> Vec<PathBuf> {
    let entries = std::fs::read_dir(".").into_iter().flatten().flatten();
    let mut names: Vec<PathBuf> = entries.map(|entry| PathBuf::from(entry.file_name())).collect();
    names.sort();
    names
}

/// The verbs with a place for records behind the model, for usage and completions: [`sorted`] puts what stands there behind `--data`.
pub(crate) fn with_places(command: Command) -> Command {
    let place = || {
        Arg::new(RECORD)
            .value_name("RUN")
            .num_args(0..)
            .value_parser(clap::value_parser!(PathBuf))
            .help_heading(None::<&'static str>)
            .help("Recorded runs: CSV, logs, or patterns such as 'flights/*.csv'")
    };
    let is_wanted = |verb: &Command| takes(verb, "data") && takes(verb, "model") && verb.get_name() != "export";
    command.mut_subcommands(|verb| if is_wanted(&verb) { verb.arg(place()) } else { verb })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(words: &str) -> Result<String, String> {
        let all = words.split_whitespace().map(OsString::from).collect();
        match sorted(all, &crate::command()) {
            Ok(words) => Ok(words.iter().map(|w| w.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")),
            Err(Failure::Input(said)) => Err(said.join("; ")),
            Err(_) => Err(String::new()),
        }
    }

    #[test]
    fn models_and_records_are_told_apart_in_any_order() {
        let expected = "fdm fit wing.fdm --data=flight.csv";
        for words in [
            "fdm fit wing.fdm flight.csv",
            "fdm fit flight.csv wing.fdm",
            "fdm fit --data flight.csv wing.fdm",
            "fdm fit wing.fdm --data=flight.csv",
        ] {
            let found = told(words);
            let typed = words == "fdm fit wing.fdm --data=flight.csv";
            assert_eq!(found.as_deref(), Ok(if typed { words } else { expected }), "{words}");
        }
        for (words, expected) in [
            // what is in its place stays as it was typed
            ("fdm fit wing.fdm --data flight.csv", "fdm fit wing.fdm --data flight.csv"),
            ("fdm fit wing.txt --data flight.csv", "fdm fit wing.txt --data flight.csv"),
            ("fdm fit wing.fdm -q --set k=1 a.csv", "fdm fit wing.fdm -q --set k=1 --data=a.csv"),
            ("fdm --threads 2 fit a.csv --gain -1 wing.fdm", "fdm --threads 2 fit wing.fdm --gain -1 --data=a.csv"),
            ("fdm doctor flight.csv", "fdm doctor --data=flight.csv"),
            ("fdm doctor flight.txt", "fdm doctor --data=flight.txt"),
            ("fdm fit flight.txt wing.fdm", "fdm fit wing.fdm --data=flight.txt"),
            ("fdm diagnose wing.fdm a.csv b.ulg", "fdm diagnose wing.fdm --data=a.csv --data=b.ulg"),
            ("fdm fit wing.fdm 'all/*.csv' -", "fdm fit wing.fdm --data='all/*.csv' --data=-"),
            ("fdm validate found new.csv", "fdm validate --from-result=found --data=new.csv"),
            ("fdm simulate found", "fdm simulate --from-result=found"),
            ("fdm modes found", "fdm modes --from-result=found"),
            ("fdm compare one other new.csv", "fdm compare one other --data=new.csv"),
            ("fdm plot found", "fdm plot found"),
        ] {
            assert_eq!(told(words).as_deref(), Ok(expected), "{words}");
        }
    }

    #[test]
    fn a_slip_is_answered_with_the_line_to_type() {
        for (words, expected) in [
            (
                "fdm fit a.fdm b.fdm c.csv",
                "two models, a.fdm and b.fdm: `fdm fit` works on one:\n  fdm fit a.fdm c.csv",
            ),
            ("fdm fit wing.mdl flight.csv", "where it is the model, type\n  fdm fit wing.mdl --data flight.csv"),
            ("fdm simulate one other", "two results, one and other: `fdm simulate` works on one:\n  fdm simulate one"),
        ] {
            assert!(told(words).is_err_and(|said| said.contains(expected)), "{words}: {:?}", told(words));
        }
    }
}
