//! Folders in which the libraries of units stand while a process works with them. They are removed when it ends; those of processes that were
//! killed by the next one that unpacks a unit, since the lock on a folder ends with the process that had it, however that ends.

use crate::archive::Files;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

const PREFIX: &str = "fdm-unit-";
/// Characters behind the prefix.
const RANDOM: usize = 6;

/// Folders of this process, each with its lock where it could be locked.
static FOLDERS: Mutex<Vec<(PathBuf, Option<File>)>> = Mutex::new(Vec::new());

/// Writes the files of a unit to a folder of its own.
pub(crate) fn unpacked(files: &Files) -> std::io::Result<PathBuf> {
    let mut folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
    if folders.is_empty() {
        clear(&std::env::temp_dir());
        at_the_end();
    }
    let (folder, lock) = locked()?;
    folders.push((folder.clone(), lock));
    drop(folders);
    let places = files.iter().filter_map(|(name, _)| Path::new(name).parent());
    for place in places.chain([Path::new("resources")]) {
        fs::create_dir_all(folder.join(place))?;
    }
    for (name, bytes) in files {
        fs::write(folder.join(name), bytes)?;
    }
    Ok(folder)
}

/// A new folder that is locked, where folders can be.
fn locked() -> std::io::Result<(PathBuf, Option<File>)> {
    loop {
        let folder = tempfile::Builder::new().prefix(PREFIX).rand_bytes(RANDOM).tempdir()?.keep();
        let lock = File::open(&folder).ok().filter(|opened| opened.lock().is_ok());
        // another process may have taken it for abandoned before it was locked
        if folder.is_dir() {
            return Ok((folder, lock));
        }
    }
}

/// Removes the folders of units in a folder that nobody works with. What cannot be removed stays, and does no harm.
fn clear(place: &Path) {
    for entry in fs::read_dir(place).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let random = name.to_str().and_then(|name| name.strip_prefix(PREFIX));
        let own = random.is_some_and(|r| r.len() == RANDOM && r.chars().all(|c| c.is_ascii_alphanumeric()));
        if !own || !entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            continue;
        }
        let Ok(opened) = File::open(entry.path()) else { continue };
        if opened.try_lock().is_ok() {
            // it is held until the folder is gone
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

/// Statics are never dropped, so the end of the process has to be asked for.
#[allow(unsafe_code, reason = "the C library is told what to do in the end")]
fn at_the_end() {
    unsafe extern "C" {
        fn atexit(act: extern "C" fn()) -> std::ffi::c_int;
    }
    extern "C" fn remove() {
        let folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
        folders.iter().for_each(|(folder, _)| drop(fs::remove_dir_all(folder)));
    }
    // SAFETY: the function touches nothing but a static of its own
    unsafe { atexit(remove) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_processes_that_were_killed_are_removed_and_no_others() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        for name in ["fdm-unit-aB3dE6", "fdm-unit-aB3dE7", "fdm-unit-notes", "other"] {
            fs::create_dir_all(at(name).join("binaries")).unwrap();
            fs::write(at(name).join("binaries/a.so"), "code").unwrap();
        }
        fs::write(at("fdm-unit-aB3dE8"), "a file").unwrap();
        let held = File::open(at("fdm-unit-aB3dE7")).unwrap();
        held.lock().unwrap();
        clear(place.path());
        let left = ["fdm-unit-aB3dE6", "fdm-unit-aB3dE7", "fdm-unit-notes", "other", "fdm-unit-aB3dE8"];
        assert_eq!(left.map(|name| at(name).exists()), [false, true, true, true, true]);
        drop(held);
        clear(place.path());
        assert!(!at("fdm-unit-aB3dE7").exists());
    }

    #[test]
    fn files_of_a_unit_stand_in_a_folder_that_is_held() {
        let folder = unpacked(&vec![("binaries/a.so".into(), b"code".to_vec())]).unwrap();
        assert_eq!(fs::read(folder.join("binaries/a.so")).unwrap(), b"code");
        clear(&std::env::temp_dir());
        assert!(folder.join("resources").is_dir());
    }
}
