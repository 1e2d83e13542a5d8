//! Files that a command reads and files that it writes: no file is written over that the same command reads, whatever the ways
//! in which the two are named, and no two results go to one place. This is told before any work is done.

use crate::failure::{Failure, at};
use crate::ownership::{Kind, refuse_foreign};
use clap::{Arg, ArgMatches, Command};
use fdm_readers::RecordMap;
use fdm_results::store::{admits, end_of_links, own_files};
use fdm_session::campaign::{RunTable, expanded};
use fdm_system::{Model, read_source};
use std::fs;
use std::path::{Path, PathBuf};

/// What becomes of the file or folder that an argument names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    /// It is read, with everything in it that belongs to a result.
    Read,
    /// A file of this kind is written.
    File(Kind),
    /// A folder is filled.
    Folder,
    /// The verb sees to it itself: it rewrites what it reads, or writes only where nothing stands.
    Own,
}

/// Arguments that name what is written; every other one that takes a path names what is read.
fn role(verb: &str, argument: &str) -> Role {
    match (verb, argument) {
        ("new", "from") => Role::Read,
        // results of one job are added to each other
        ("fmt" | "new" | "plan" | "import", _) | ("run", "out") => Role::Own,
        ("export", "output") => Role::File(Kind::Export),
        ("simulate" | "data", "output") | ("doctor", "fix") => Role::File(Kind::Table),
        ("report", "output") | (_, "report") => Role::File(Kind::Page),
        ("plot", "output") | (_, "plot") => Role::File(Kind::Drawing),
        (_, "write") => Role::File(Kind::Model),
        ("man", "folder") | (_, "out" | "checkpoint" | "records") => Role::Folder,
        _ => Role::Read,
    }
}

/// Whether a command writes what an argument names.
pub(crate) fn is_written(verb: &str, argument: &str) -> bool {
    role(verb, argument) != Role::Read
}

/// The verb that is asked for, the last of several: `run` of `job run`.
pub(crate) fn innermost<'a>(command: &'a Command, matches: &'a ArgMatches) -> (&'a Command, &'a ArgMatches) {
    match matches.subcommand().and_then(|(verb, matches)| Some((command.find_subcommand(verb)?, matches))) {
        Some((command, matches)) => innermost(command, matches),
        None => (command, matches),
    }
}

/// A path that was typed, and the option that it was typed for.
struct Named {
    option: String,
    path: PathBuf,
    role: Role,
}

impl Named {
    /// What is written, where that is a single file.
    fn kind(&self) -> Option<Kind> {
        if let Role::File(kind) = self.role { Some(kind) } else { None }
    }
}

/// Refuses results that would be written over what the command reads, over each other, over what fdm did not write, or where
/// nothing can be written.
pub(crate) fn refuse_conflicts(command: &Command, matches: &ArgMatches) -> Result<(), Failure> {
    let (command, matches) = innermost(command, matches);
    let verb = command.get_name();
    let named: Vec<Named> = command.get_arguments().flat_map(|argument| paths(verb, argument, matches)).collect();
    let sources = named.iter().filter(|n| n.role == Role::Read);
    // what was named itself is told first
    let mut read: Vec<(&Named, PathBuf)> = sources.clone().map(|n| (n, n.path.clone())).collect();
    read.extend(sources.flat_map(belongings));
    let files: Vec<(&Named, Kind)> = named.iter().filter_map(|n| n.kind().map(|kind| (n, kind))).collect();
    let folders: Vec<&Named> = named.iter().filter(|n| n.role == Role::Folder).collect();
    let force = matches!(matches.try_get_one::<bool>("force"), Ok(Some(true)));
    let mut wrong = Vec::new();
    for (file, kind) in &files {
        if file.path == Path::new("-") {
            let option = &file.option;
            wrong.push(format!(
                "{option} -: what is printed goes to standard output; give a file ({option} ./- for one of that name)"
            ));
        } else if let Some((source, path)) = read.iter().find(|(_, path)| is_same(path, &file.path)) {
            wrong.push(over(file, source, path));
        } else if let Err(e) = admits(&file.path) {
            wrong.push(format!("{}: {}", file.option, at(&file.path, &e)));
        } else if !force
            && *kind != Kind::Table
            && let Err(said) = refuse_foreign(&file.path, *kind)
        {
            wrong.push(format!("{} {said}", file.option));
        }
    }
    for folder in &folders {
        let (own, _) = own_files(&folder.path);
        let lost =
            read.iter().find(|(_, path)| own.iter().any(|own| place(own).is_some() && place(own) == place(path)));
        if let Some((source, path)) = lost {
            wrong.push(over(folder, source, path));
        }
    }
    let written: Vec<&Named> = files.iter().map(|(file, _)| *file).chain(folders.iter().copied()).collect();
    for (k, one) in written.iter().enumerate() {
        for other in &written[..k] {
            let same =
                place(&one.path).is_some_and(|at| place(&other.path) == Some(at)) || is_same(&one.path, &other.path);
            if same && !is_device(&one.path) {
                let (path, other, option) = (one.path.display(), &other.option, &one.option);
                wrong.push(format!(
                    "{path} is both {other} and {option}: one would be written over the other; give two places"
                ));
            }
        }
    }
    if wrong.is_empty() { Ok(()) } else { Err(Failure::Input(wrong)) }
}

fn over(written: &Named, read: &Named, path: &Path) -> String {
    let (option, target) = (&written.option, written.path.display());
    format!(
        "{option} {target} would be written over {}, which {} reads: give another place for the result",
        path.display(),
        read.option
    )
}

/// The paths that were typed for an argument.
fn paths(verb: &str, argument: &Arg, matches: &ArgMatches) -> Vec<Named> {
    let id = argument.get_id().as_str();
    let values: Vec<PathBuf> = if let Ok(Some(values)) = matches.try_get_many::<PathBuf>(id) {
        values.cloned().collect()
    } else if matches!(matches.try_get_many::<RecordMap>(id), Ok(Some(_))) {
        matches.get_raw(id).into_iter().flatten().map(PathBuf::from).collect()
    } else {
        return Vec::new();
    };
    let long = argument.get_long().map(|long| format!("--{long}"));
    let option = long.unwrap_or_else(|| argument.get_value_names().unwrap_or_default().join(" "));
    // standard input and output; only the result itself goes there
    let is_result = id == "output";
    let stream = |path: &PathBuf| path.as_path() == Path::new("-");
    let files =
        values.into_iter().filter(|path| !stream(path) || matches!(role(verb, id), Role::File(_)) && !is_result);
    files.map(|path| Named { option: option.clone(), path, role: role(verb, id) }).collect()
}

/// Further files that are read with the one that is named: those that a model uses, those of a result and the records that it was
/// made from, those that a pattern finds, and the records and maps of a table of runs.
fn belongings(named: &Named) -> Vec<(&Named, PathBuf)> {
    let path = &named.path;
    let mut files = Vec::new();
    if path.is_dir() {
        let (own, records) = own_files(path);
        files.extend(own.into_iter().chain(records));
    } else if path.extension().is_some_and(|e| e == "fdm")
        && let Ok(mut source) = read_source(path)
    {
        Model::gather_files(&mut source);
        files.extend(source.texts().iter().skip(1).map(|text| PathBuf::from(text.name())));
    } else if named.option == "--runs" {
        // what is wrong with the table is told where it is read
        files.extend(RunTable::read(path).map(|table| table.reads()).unwrap_or_default());
    } else if !path.exists() {
        files.extend(expanded(std::slice::from_ref(path)).unwrap_or_default().into_iter().filter(|file| file != path));
    }
    files.into_iter().map(|file| (named, file)).collect()
}

/// Whether two paths lead to one file: by links of either kind, or by another spelling.
fn is_same(one: &Path, other: &Path) -> bool {
    if is_device(one) {
        return false;
    }
    match (fs::metadata(one), fs::metadata(other)) {
        (Ok(a), Ok(b)) => is_one(&a, &b) || place(one).is_some_and(|at| place(other) == Some(at)),
        _ => false,
    }
}

#[cfg(unix)]
fn is_one(one: &fs::Metadata, other: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

#[cfg(not(unix))]
fn is_one(_: &fs::Metadata, _: &fs::Metadata) -> bool {
    false
}

/// A device or a pipe: writing loses nothing.
fn is_device(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir())
}

/// Where a file stands or would stand, from the root of the file system.
fn place(path: &Path) -> Option<PathBuf> {
    if let Ok(found) = path.canonicalize() {
        return Some(found);
    }
    let end = end_of_links(path).ok()?;
    let folder = end.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Some(folder.canonicalize().ok()?.join(end.file_name()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every argument that takes a path, with what becomes of it: one that is new must be looked at.
    #[test]
    fn the_role_of_every_path_is_known() {
        let mut command = crate::command();
        command.build();
        let mut found = Vec::new();
        let verbs = command.get_subcommands().flat_map(|verb| std::iter::once(verb).chain(verb.get_subcommands()));
        for verb in verbs {
            for argument in verb.get_arguments() {
                if argument.get_value_parser().type_id() == std::any::TypeId::of::<PathBuf>() {
                    let role = role(verb.get_name(), argument.get_id().as_str());
                    found.push(format!("{} {} {role:?}", verb.get_name(), argument.get_id()));
                }
            }
        }
        let written: Vec<&str> = found.iter().filter(|f| !f.ends_with(" Read")).map(String::as_str).collect();
        let expected = [
            "new target Own",
            "data output File(Table)",
            "doctor fix File(Table)",
            "doctor report File(Page)",
            "fit checkpoint Folder",
            "fit plot File(Drawing)",
            "fit out Folder",
            "fit report File(Page)",
            "validate plot File(Drawing)",
            "validate out Folder",
            "validate report File(Page)",
            "diagnose write File(Model)",
            "diagnose out Folder",
            "diagnose report File(Page)",
            "compare report File(Page)",
            "simulate output File(Table)",
            "design records Folder",
            "design report File(Page)",
            "report output File(Page)",
            "export output File(Export)",
            "regress plot File(Drawing)",
            "regress out Folder",
            "regress report File(Page)",
            "spectra plot File(Drawing)",
            "spectra report File(Page)",
            "study checkpoint Folder",
            "study plot File(Drawing)",
            "study out Folder",
            "study report File(Page)",
            "profile plot File(Drawing)",
            "profile report File(Page)",
            "sample report File(Page)",
            "plot output File(Drawing)",
            "extend write File(Model)",
            "import problem Own",
            "import out Own",
            "fmt files Own",
            "plan job Own",
            "plan output Own",
            "run out Own",
            "status report File(Page)",
            "reproduce records Folder",
            "reproduce checkpoint Folder",
            "man folder Folder",
        ];
        assert_eq!(written, expected);
        assert!(found.len() > 60, "{found:?}");
    }
}
