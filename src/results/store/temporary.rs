//! What is not finished: its names, and the removal of what a program that died has left of it.
//!
//! A folder in which a command works while it runs, gone when it ends.

use super::disk::Disk;
use std::ffi::OsStr;
use std::fs::File;
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};
use std::{fs, io};
use tempfile::TempDir;

const MARK: &str = ".fdm-";
const ENDING: &str = ".new";

/// The place of a successor that is not finished, in a folder, of what is called `name` there; of the folder itself when the name
/// is empty.
pub(super) fn place(folder: &Path, name: &OsStr) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let moment = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.subsec_nanos());
    let (id, count) = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    folder.join(format!("{}{id:x}-{count:x}-{moment:x}{ENDING}", beginning(name)))
}

fn beginning(name: &OsStr) -> String {
    let name = name.to_string_lossy();
    // bytes of a name that go into that of its successor; file systems take 255
    let end = name.char_indices().map(|(k, c)| k + c.len_utf8()).take_while(|end| *end <= 180).last().unwrap_or(0);
    let stop = if end == 0 { "" } else { "." };
    format!("{stop}{}{MARK}", &name[..end])
}

/// Keeps a folder locked, so that others see that somebody works with it; none where folders cannot be locked.
pub(super) fn hold(folder: &Path) -> Option<File> {
    File::open(folder).ok().filter(|opened| opened.lock().is_ok())
}

/// Removes the successors of `name` that programs which have ended left unfinished: those with our names that nobody locks. What
/// cannot be removed stays, and does no harm.
pub(super) fn clear(disk: &dyn Disk, folder: &Path, name: &OsStr) {
    let beginning = beginning(name);
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let own = entry.file_name();
        let middle = own.to_str().and_then(|own| own.strip_prefix(&beginning)?.strip_suffix(ENDING));
        if !middle.is_some_and(|m| m.split('-').count() == 3 && m.chars().all(|c| c == '-' || c.is_ascii_hexdigit())) {
            continue;
        }
        let path = entry.path();
        let (Ok(kind), Ok(opened)) = (entry.file_type(), File::open(&path)) else { continue };
        // the lock ends with the program that had it, however that ends
        if opened.try_lock().is_err() {
            continue;
        }
        let _ = match kind {
            kind if kind.is_dir() => disk.remove_folder(&path),
            kind if kind.is_file() => disk.remove_file(&path),
            _ => Ok(()),
        };
    }
}

/// A folder with files, gone when it is dropped.
#[derive(Debug)]
pub struct WorkFolder(TempDir);

impl WorkFolder {
    /// With these files: names, which may have folders in them, and contents.
    ///
    /// # Errors
    /// Of the file system; of the kind `InvalidInput` for a name that leads out of the folder.
    pub fn with(files: &[(String, Vec<u8>)]) -> io::Result<Self> {
        let folder = tempfile::tempdir()?;
        for (name, contents) in files {
            if !Path::new(name).components().all(|c| matches!(c, Component::Normal(_))) {
                return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("`{name}` leads out of the folder")));
            }
            let path = folder.path().join(name);
            path.parent().map_or(Ok(()), fs::create_dir_all)?;
            fs::write(path, contents)?;
        }
        Ok(Self(folder))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

#[cfg(test)]
mod tests {
    use super::super::disk::System;
    use super::*;

    #[test]
    fn only_our_own_that_nobody_works_with_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let strangers = [".a.csv.fdm-notes.new", ".a.csv.fdm-1-2-3", ".b.csv.fdm-1-2-3.new", "a.csv.fdm-1-2-3.new"];
        strangers.iter().for_each(|name| fs::write(at(name), "mine").unwrap());
        let (dead, alive) = (place(folder.path(), "a.csv".as_ref()), place(folder.path(), "a.csv".as_ref()));
        drop(System.write(&dead, b"half").unwrap());
        let held = System.write(&alive, b"half").unwrap();
        let tree = place(folder.path(), "a.csv".as_ref());
        fs::create_dir_all(tree.join("deep")).unwrap();
        clear(&System, folder.path(), "a.csv".as_ref());
        assert!(!dead.exists() && alive.exists() && !tree.exists());
        assert!(strangers.iter().all(|name| at(name).exists()));
        drop(held);
        clear(&System, folder.path(), "a.csv".as_ref());
        assert!(!alive.exists());
    }

    #[test]
    fn names_are_not_too_long_for_a_file_system() {
        let folder = tempfile::tempdir().unwrap();
        let long = "ü".repeat(120);
        let made = place(folder.path(), long.as_ref());
        drop(System.write(&made, b"half").unwrap());
        clear(&System, folder.path(), long.as_ref());
        assert!(!made.exists());
    }
}

#[cfg(test)]
mod work_folder_tests {
    use super::*;

    #[test]
    fn files_stand_in_it_and_never_beside_it() {
        let file = |name: &str| vec![(name.to_string(), b"a".to_vec())];
        let folder = WorkFolder::with(&file("deep/a.txt")).unwrap();
        let path = folder.path().to_path_buf();
        assert_eq!(fs::read(path.join("deep/a.txt")).unwrap(), b"a");
        drop(folder);
        assert!(!path.exists());
        for name in ["../a.txt", "/a.txt", "deep/../../a.txt"] {
            assert!(WorkFolder::with(&file(name)).is_err(), "{name}");
        }
    }
}
