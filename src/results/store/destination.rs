//! A folder that appears whole: built beside its place, brought to the disk, renamed.

use super::disk::{Disk, System, reason};
use super::manifest::{self, Manifest};
use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Where a result folder is to stand.
pub struct Destination {
    folder: PathBuf,
    disk: Box<dyn Disk>,
}

/// Why a result folder cannot be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DestinationError {
    /// Files that are not a result stand there.
    Foreign {
        /// The place.
        folder: PathBuf,
    },
    /// It cannot be written.
    Unwritable {
        /// What is wrong where.
        reason: String,
    },
}

impl fmt::Display for DestinationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Foreign { folder } => write!(
                f,
                "{} holds something that is not a result of fdm and is left alone: give a new or empty folder",
                folder.display()
            ),
            Self::Unwritable { reason } => write!(f, "the result folder cannot be written: {reason}"),
        }
    }
}

impl std::error::Error for DestinationError {}

impl Destination {
    /// Looks at the place, before any work: it must be new, an empty folder, or a result that is to be replaced, and
    /// new files must be admitted beside it.
    ///
    /// # Errors
    /// [`DestinationError`]; nothing has been changed then.
    pub fn prepare(folder: impl AsRef<Path>) -> Result<Self, DestinationError> {
        Self::on(Box::new(System), folder.as_ref())
    }

    pub(super) fn on(disk: Box<dyn Disk>, folder: &Path) -> Result<Self, DestinationError> {
        // a link keeps pointing to the place where the result stands
        let folder = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_path_buf());
        if folder.file_name().is_none() {
            return Err(DestinationError::Foreign { folder });
        }
        let destination = Self { folder, disk };
        destination.refuse_foreign()?;
        let parent = destination.parent();
        destination.disk.make_folder(&parent).map_err(|e| unwritable(&parent, &e))?;
        // a read-only place is told now, not after hours of work
        tempfile::Builder::new().prefix(".fdm-").tempdir_in(&parent).map_err(|e| unwritable(&parent, &e))?;
        Ok(destination)
    }

    /// The place.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Builds the folder from its files. What stood there before is removed when the new one is complete, and not
    /// earlier.
    ///
    /// # Errors
    /// [`DestinationError`]; what stood there before stands there still, or beside it under the name that
    /// [`ResultFolder::open`](super::ResultFolder::open) knows.
    pub fn fill(&self, files: &[(String, Vec<u8>)]) -> Result<(), DestinationError> {
        self.refuse_foreign()?;
        let parent = self.parent();
        let fresh =
            tempfile::Builder::new().prefix(".fdm-").tempdir_in(&parent).map_err(|e| unwritable(&parent, &e))?;
        for (name, content) in files {
            let path = fresh.path().join(name);
            self.disk.write(&path, content).map_err(|e| unwritable(&self.folder.join(name), &e))?;
        }
        self.disk.settle(fresh.path()).map_err(|e| unwritable(&self.folder, &e))?;
        readable(fresh.path()).map_err(|e| unwritable(&self.folder, &e))?;
        self.replace(&fresh.keep()).map_err(|e| unwritable(&self.folder, &e))
    }

    /// Puts the complete new folder into its place.
    fn replace(&self, fresh: &Path) -> io::Result<()> {
        let (parent, before) = (self.parent(), before(&self.folder));
        let replaced = (|| {
            if is_there(&self.folder) {
                // only leftovers of a replacement that was interrupted later than here stand in the way
                if is_there(&before) {
                    self.disk.remove_folder(&before)?;
                }
                self.disk.rename(&self.folder, &before)?;
            }
            let placed = self.disk.rename(fresh, &self.folder);
            if placed.is_err() && is_there(&before) && !is_there(&self.folder) {
                let _ = self.disk.rename(&before, &self.folder);
            }
            placed
        })();
        if replaced.is_err() && is_there(fresh) {
            let _ = self.disk.remove_folder(fresh);
        }
        replaced?;
        self.disk.settle(&parent)?;
        // the new one stands; an old one that cannot be removed does no harm
        if is_there(&before) {
            let _ = self.disk.remove_folder(&before);
        }
        Ok(())
    }

    /// Only results and empty folders may be replaced.
    fn refuse_foreign(&self) -> Result<(), DestinationError> {
        let foreign = || DestinationError::Foreign { folder: self.folder.clone() };
        match fs::symlink_metadata(&self.folder) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(e) => return Err(unwritable(&self.folder, &e)),
            Ok(at) if !at.is_dir() => return Err(foreign()),
            Ok(_) => {}
        }
        let mut entries = fs::read_dir(&self.folder).map_err(|e| unwritable(&self.folder, &e))?;
        if entries.next().is_none() {
            return Ok(());
        }
        let ours = fs::read_to_string(self.folder.join(manifest::NAME)).ok().and_then(|t| Manifest::format(&t));
        ours.map(|_| ()).ok_or_else(foreign)
    }

    fn parent(&self) -> PathBuf {
        match self.folder.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.into(),
            _ => PathBuf::from("."),
        }
    }
}

/// Where a result stands while a new one takes its place.
pub(super) fn before(folder: &Path) -> PathBuf {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    folder.with_file_name(format!(".{name}.before"))
}

fn is_there(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok()
}

/// Temporary folders are private; a result is as readable as other folders that the user makes.
#[cfg(unix)]
fn readable(folder: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    // what the user's own mask allows is seen at a file that was made just now
    let mask = match fs::read_dir(folder)?.next() {
        Some(entry) => entry?.metadata()?.permissions().mode() & 0o444,
        None => 0o400,
    };
    fs::set_permissions(folder, fs::Permissions::from_mode(0o700 | mask | mask >> 2))
}

#[cfg(not(unix))]
fn readable(_: &Path) -> io::Result<()> {
    Ok(())
}

fn unwritable(path: &Path, e: &io::Error) -> DestinationError {
    DestinationError::Unwritable { reason: format!("{}: {}", path.display(), reason(e)) }
}
