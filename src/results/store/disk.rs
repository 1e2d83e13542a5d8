//! The few operations on files that must survive an interruption at any moment; tests put a disk that fails in their place.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

/// What the room asks of a file system. Every operation is finished, or failed, when it returns.
pub(super) trait Disk: Send + Sync {
    /// Writes a new file, or all of an old one anew, and waits until the bytes are on the disk.
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;

    /// Gives a file or folder another name; a file takes the place of a file of that name in one instant.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Waits until the names in a folder are on the disk.
    fn settle(&self, folder: &Path) -> io::Result<()>;

    /// Makes a folder, and those that it stands in.
    fn make_folder(&self, path: &Path) -> io::Result<()>;

    /// Removes a folder with all that it holds.
    fn remove_folder(&self, path: &Path) -> io::Result<()>;
}

/// The file system of the computer.
#[derive(Debug, Clone, Copy)]
pub(super) struct System;

impl Disk for System {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = File::create(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn settle(&self, folder: &Path) -> io::Result<()> {
        // elsewhere a folder cannot be opened as a file, and its names are settled with the file
        if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
    }

    fn make_folder(&self, path: &Path) -> io::Result<()> {
        fs::create_dir_all(path)
    }

    fn remove_folder(&self, path: &Path) -> io::Result<()> {
        fs::remove_dir_all(path)
    }
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
        _ => error.to_string(),
    }
}
