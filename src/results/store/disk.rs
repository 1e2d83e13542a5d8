//! The few operations on files that must survive an interruption at any moment; tests put a disk that fails in their place.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// What the store asks of a file system. Every operation is finished, or failed, when it returns.
pub(super) trait Disk: Send + Sync {
    /// Writes a new file and waits until the bytes are on the disk. As long as the file is kept open it is locked, so that others see
    /// that somebody works with it.
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<File>;

    /// Writes a new file and waits until the bytes are on the disk, without a lock: network file systems may make a
    /// program wait for one for ever.
    fn write_unlocked(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;

    /// Gives a file or folder another name; a file takes the place of a file of that name in one instant.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Gives a file another name that nothing has yet.
    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Waits until the names in a folder are on the disk.
    fn settle(&self, folder: &Path) -> io::Result<()>;

    /// Makes a folder, and those that it stands in.
    fn make_folder(&self, path: &Path) -> io::Result<()>;

    /// Removes a file.
    fn remove_file(&self, path: &Path) -> io::Result<()>;

    /// Removes a folder with all that it holds.
    fn remove_folder(&self, path: &Path) -> io::Result<()>;
}

/// The file system of the computer.
#[derive(Debug, Clone, Copy)]
pub(super) struct System;

impl System {
    /// A new file, locked. What cannot be locked is used all the same.
    pub(super) fn new_file(path: &Path) -> io::Result<File> {
        let file = File::options().write(true).create_new(true).open(path)?;
        let _ = file.lock();
        Ok(file)
    }
}

impl Disk for System {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<File> {
        let mut file = Self::new_file(path)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        Ok(file)
    }

    fn write_unlocked(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = File::options().write(true).create_new(true).open(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()> {
        match fs::hard_link(from, to) {
            Ok(()) => fs::remove_file(from),
            // some file systems know no second names
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists && fs::symlink_metadata(to).is_err() => {
                fs::rename(from, to)
            }
            Err(e) => Err(e),
        }
    }

    fn settle(&self, folder: &Path) -> io::Result<()> {
        // elsewhere a folder cannot be opened as a file, and its names are settled with the file
        if !cfg!(unix) {
            return Ok(());
        }
        match File::open(folder).and_then(|folder| folder.sync_all()) {
            // some file systems know no such request, and a folder may be written but not read
            Err(e)
                if matches!(
                    e.kind(),
                    io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported | io::ErrorKind::PermissionDenied
                ) =>
            {
                Ok(())
            }
            settled => settled,
        }
    }

    fn make_folder(&self, path: &Path) -> io::Result<()> {
        fs::create_dir_all(path)
    }

    fn remove_file(&self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }

    fn remove_folder(&self, path: &Path) -> io::Result<()> {
        fs::remove_dir_all(path)
    }
}

/// The disk of this program, where it is another than that of the computer.
static CHOSEN: OnceLock<Arc<dyn Disk>> = OnceLock::new();

/// The disk that everything is written to.
pub(super) fn disk() -> Arc<dyn Disk> {
    CHOSEN.get().cloned().unwrap_or_else(|| Arc::new(System))
}

/// Puts another disk in the place of that of the computer, once.
pub(super) fn choose(other: Arc<dyn Disk>) {
    let _ = CHOSEN.set(other);
}

/// What an operating system's refusal means to the user.
pub fn reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::StorageFull => "the disk is full".into(),
        io::ErrorKind::QuotaExceeded => "your share of the disk is full".into(),
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only".into(),
        io::ErrorKind::PermissionDenied => "writing or reading is not permitted there".into(),
        io::ErrorKind::NotFound => "there is no such file or folder".into(),
        io::ErrorKind::NotADirectory => "a file stands where a folder is needed".into(),
        io::ErrorKind::IsADirectory => "a folder stands where a file is needed".into(),
        io::ErrorKind::AlreadyExists => "it exists already, and is not overwritten".into(),
        _ => error.to_string(),
    }
}
