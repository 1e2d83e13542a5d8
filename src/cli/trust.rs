//! What a file may ask for that nobody typed: a project file, a job or an experiment may have come with a folder from elsewhere.
//!
//! A project file counts only where it belongs to the user, as Git has it for its own folders (`safe.directory`). Files do not say
//! `force`, and the results that they name lie in their own folder.

use crate::failure::Failure;
use crate::paths::{innermost, is_written};
use clap::{ArgMatches, Command};
use fdm_results::store::WorkFolder;
use std::fs::Metadata;
use std::path::{Path, PathBuf};

/// The environment's list of folders whose project files count although they are another user's.
const SAFE: &str = "FDM_SAFE_FOLDERS";
/// Options that are typed, and stand in no file.
const TYPED_ONLY: [&str; 3] = ["force", "allow-units", "no-project"];

/// Why an option does not stand in a file; none where it may.
pub(crate) fn typed_only(name: &str) -> Option<&'static str> {
    TYPED_ONLY.contains(&name).then_some("it is only typed on the command line: no file says this for a user")
}

/// Refuses a project file of another user: whatever it names would be read, written or run in the name of this one.
#[cfg(unix)]
pub(crate) fn refuse_other_owner(file: &Path) -> Result<(), Failure> {
    use std::os::unix::fs::MetadataExt;
    // who this program works for is who its files belong to
    let user =
        WorkFolder::with(&[]).and_then(|own| std::fs::metadata(own.path())).map_err(|e| Failure::at(file, &e))?.uid();
    // root by sudo works for the user who called it
    let caller = std::env::var("SUDO_UID").ok().and_then(|id| id.parse().ok()).filter(|_| user == 0);
    let owners = [std::fs::symlink_metadata(file), std::fs::metadata(file)];
    let owners: Vec<u32> = owners.iter().flatten().map(Metadata::uid).collect();
    let Some(other) = owners.into_iter().find(|owner| *owner != user && Some(*owner) != caller) else { return Ok(()) };
    let folder = file.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new(".")).canonicalize();
    let safe = std::env::var_os(SAFE).unwrap_or_default();
    if folder
        .as_ref()
        .is_ok_and(|folder| std::env::split_paths(&safe).any(|s| s.canonicalize().is_ok_and(|s| s == *folder)))
    {
        return Ok(());
    }
    let shown = folder.unwrap_or_default();
    Err(Failure::Input(vec![format!(
        "{}: left alone: it belongs to {}, not to {}; --no-project goes on without it, {SAFE}={} trusts it",
        file.display(),
        name_of(other),
        name_of(user),
        shown.display()
    )]))
}

/// Elsewhere files have no owner that could be told.
#[cfg(not(unix))]
pub(crate) fn refuse_other_owner(_: &Path) -> Result<(), Failure> {
    Ok(())
}

/// A user as the system's list calls him, else by his number.
#[cfg(unix)]
fn name_of(user: u32) -> String {
    let list = fdm_results::store::read_input_text(Path::new("/etc/passwd")).unwrap_or_default();
    let id = user.to_string();
    let found = list.lines().find(|line| line.split(':').nth(2) == Some(&id)).and_then(|line| line.split(':').next());
    found.map_or(format!("user {user}"), |name| format!("`{name}` (user {user})"))
}

/// What is wrong with the place of a result that a file names by an option; none where the option names none, or its place lies in the
/// folder of the file, links followed.
pub(crate) fn outside(verb: &str, id: &str, value: &Path, folder: &Path) -> Option<String> {
    if !is_written(verb, id) || value == Path::new("-") {
        return None;
    }
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let own = folder.canonicalize().ok()?;
    let within =
        std::path::absolute(value).ok().and_then(|path| landing(&path, 40)).is_some_and(|at| at.starts_with(&own));
    (!within).then(|| {
        format!(
            "{} lies outside {}: a file names results in its own folder only; type the option for another place",
            value.display(),
            own.display()
        )
    })
}

/// Where a path leads, also where nothing stands yet; none where that cannot be told. So many links are followed as systems do.
fn landing(path: &Path, links: usize) -> Option<PathBuf> {
    if let Ok(found) = path.canonicalize() {
        return Some(found);
    }
    let (folder, name) = (path.parent()?, path.file_name()?);
    match std::fs::read_link(path) {
        Ok(target) => landing(&folder.join(target), links.checked_sub(1)?),
        Err(_) => Some(landing(folder, links)?.join(name)),
    }
}

/// Refuses words of a file that only a user says, and results outside the working folder, which is that of the file.
pub(crate) fn refuse_liberties(command: &Command, matches: &ArgMatches) -> Result<(), Failure> {
    let (command, matches) = innermost(command, matches);
    let verb = command.get_name();
    let mut wrong = Vec::new();
    if matches!(matches.try_get_one::<bool>("force"), Ok(Some(true))) {
        wrong.extend(typed_only("force").map(|why| format!("force: {why}")));
    }
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let Ok(Some(values)) = matches.try_get_many::<PathBuf>(id) else { continue };
        wrong.extend(
            values.filter_map(|value| outside(verb, id, value, Path::new("."))).map(|said| format!("{id}: {said}")),
        );
    }
    if wrong.is_empty() { Ok(()) } else { Err(Failure::Input(wrong)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_of_a_file_lie_in_its_folder() {
        let desk = tempfile::tempdir().unwrap();
        let own = desk.path().join("own");
        std::fs::create_dir(&own).unwrap();
        let at = |path: &str| outside("fit", "report", &own.join(path), &own);
        for inside in ["a.html", "deep/er/a.html", "./a.html"] {
            assert_eq!(at(inside), None, "{inside}");
        }
        for beyond in ["../a.html", "deep/../../a.html", "/tmp/a.html"] {
            assert!(at(beyond).is_some(), "{beyond}");
        }
        assert!(outside("fit", "data", Path::new("/etc/passwd"), &own).is_none());
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("../stranger", own.join("link")).unwrap();
            assert!(at("link").is_some() && at("link/a.html").is_some());
        }
    }
}
