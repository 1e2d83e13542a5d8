//! Files that a command reads and files that it writes: no file is written over that the same command reads, whatever the ways
//! in which the two are named, and no two results go to one place. This is told before any work is done.

use crate::failure::{Failure, at};
use clap::{Arg, ArgMatches, Command};
use fdm_results::store::{admits, end_of_links, own_files};
use fdm_system::{Model, read_source};
use std::fs;
use std::path::{Path, PathBuf};

/// What becomes of the file or folder that an argument names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    /// It is read, with everything in it that belongs to a result.
    Read,
    /// A file is written.
    File,
    /// A folder is filled.
    Folder,
    /// The verb sees to it itself: it rewrites what it reads, or writes only where nothing stands.
    Own,
}

/// Arguments that name what is written; every other one that takes a path names what is read.
fn role(verb: &str, argument: &str) -> Role {
    match (verb, argument) {
        ("fmt" | "new", _) => Role::Own,
        ("codegen", "out") | (_, "output" | "plot" | "report" | "write") => Role::File,
        ("man", "folder") | (_, "out" | "checkpoint" | "records") => Role::Folder,
        _ => Role::Read,
    }
}

/// A path that was typed, and the option that it was typed for.
struct Named {
    option: String,
    path: PathBuf,
    role: Role,
}

/// Refuses results that would be written over what the command reads, over each other, or where nothing can be written.
pub(crate) fn refuse_conflicts(command: &Command, matches: &ArgMatches) -> Result<(), Failure> {
    let Some((verb, matches)) = matches.subcommand() else { return Ok(()) };
    let Some(command) = command.find_subcommand(verb) else { return Ok(()) };
    let named: Vec<Named> = command.get_arguments().flat_map(|argument| paths(verb, argument, matches)).collect();
    let sources = named.iter().filter(|n| n.role == Role::Read);
    // what was named itself is told first
    let mut read: Vec<(&Named, PathBuf)> = sources.clone().map(|n| (n, n.path.clone())).collect();
    read.extend(sources.flat_map(belongings));
    let (files, folders): (Vec<&Named>, Vec<&Named>) =
        named.iter().filter(|n| matches!(n.role, Role::File | Role::Folder)).partition(|n| n.role == Role::File);
    let mut wrong = Vec::new();
    for file in &files {
        if let Some((source, path)) = read.iter().find(|(_, path)| is_same(path, &file.path)) {
            wrong.push(over(file, source, path));
        } else if let Err(e) = admits(&file.path) {
            wrong.push(format!("{}: {}", file.option, at(&file.path, &e)));
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
    let written: Vec<&Named> = files.iter().chain(&folders).copied().collect();
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
    let Ok(Some(values)) = matches.try_get_many::<PathBuf>(id) else { return Vec::new() };
    let long = argument.get_long().map(|long| format!("--{long}"));
    let option = long.unwrap_or_else(|| argument.get_value_names().unwrap_or_default().join(" "));
    // standard input and output
    let files = values.filter(|path| path.as_path() != Path::new("-"));
    files.map(|path| Named { option: option.clone(), path: path.clone(), role: role(verb, id) }).collect()
}

/// Further files that are read with the one that is named: those that a model uses, those of a result and the records that it was
/// made from.
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
        for verb in command.get_subcommands() {
            for argument in verb.get_arguments() {
                if argument.get_value_parser().type_id() == std::any::TypeId::of::<PathBuf>() {
                    let role = role(verb.get_name(), argument.get_id().as_str());
                    found.push(format!("{} {} {role:?}", verb.get_name(), argument.get_id()));
                }
            }
        }
        let written: Vec<&str> = found.iter().filter(|f| !f.ends_with(" Read")).map(String::as_str).collect();
        let expected = [
            "design records Folder",
            "diagnose write File",
            "diagnose out Folder",
            "diagnose report File",
            "extend write File",
            "simulate output File",
            "fit checkpoint Folder",
            "fit plot File",
            "fit out Folder",
            "fit report File",
            "fmt files Own",
            "profile plot File",
            "study checkpoint Folder",
            "study plot File",
            "study out Folder",
            "study report File",
            "regress plot File",
            "regress out Folder",
            "regress report File",
            "plot output File",
            "report output File",
            "reproduce records Folder",
            "reproduce checkpoint Folder",
            "spectra plot File",
            "new file Own",
            "codegen out File",
            "man folder Folder",
            "validate plot File",
            "validate out Folder",
            "validate report File",
        ];
        assert_eq!(written, expected);
        assert!(found.len() > 60, "{found:?}");
    }
}
