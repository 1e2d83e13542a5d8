//! A folder whose files change all at once, and in which nothing is touched that is not the program's own.
//!
//! New files are made in a folder of their own and brought to the disk. Where no folder stands yet that folder gets its name. Where
//! one stands it becomes [`READY`] in it, in one instant: from then on the new result is the one that counts, whoever reads it, and
//! its files go to their places one by one. What is interrupted in between is finished by the next one that writes there.

use super::disk::{Disk, disk, reason};
use super::file::read_input_text;
use super::identity::fingerprint;
use super::manifest::{self, Claim, KeptFile, Manifest};
use super::temporary;
use std::ffi::OsStr;
use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The folder, in that of a result, whose files count before those beside it.
const READY: &str = ".fdm-ready";

/// Where a result folder is to stand.
pub struct Destination {
    folder: PathBuf,
    disk: Arc<dyn Disk>,
    /// Files of others are replaced too.
    force: bool,
}

/// Why a result folder cannot be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DestinationError {
    /// It is no folder.
    Foreign {
        /// The place.
        folder: PathBuf,
    },
    /// Files stand there which the program did not write, or which were changed since, under names that it needs.
    Occupied {
        /// The place.
        folder: PathBuf,
        /// The files that the program did not write.
        foreign: Vec<String>,
        /// The files that were changed since it wrote them.
        changed: Vec<String>,
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
                "{} is not a result of fdm but a file, and is left alone: give a new or empty folder",
                folder.display()
            ),
            Self::Occupied { folder, foreign, changed } => {
                write!(f, "{}: left alone: ", folder.display())?;
                if !foreign.is_empty() {
                    write!(f, "fdm did not write {}", some(foreign))?;
                }
                if !changed.is_empty() {
                    let and = if foreign.is_empty() { "" } else { ", and " };
                    write!(f, "{and}{} changed since fdm wrote it", some(changed))?;
                }
                write!(f, "; move it, give another folder, or replace it with --force")
            }
            Self::Unwritable { reason } => write!(f, "the result folder cannot be written: {reason}"),
        }
    }
}

impl std::error::Error for DestinationError {}

fn some(names: &[String]) -> String {
    const SHOWN: usize = 6;
    let shown: Vec<String> = names.iter().take(SHOWN).map(|name| format!("`{name}`")).collect();
    let more = names.len().saturating_sub(SHOWN);
    shown.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
}

impl Destination {
    /// Looks at the place, before any work, for a result whose files are not known yet: [`Self::prepare_for`].
    ///
    /// # Errors
    /// [`DestinationError`]; nothing has been changed then.
    pub fn prepare(folder: impl AsRef<Path>) -> Result<Self, DestinationError> {
        Self::prepare_for(folder, &[], false)
    }

    /// Looks at the place, before any work: in it the program may replace what it wrote itself, and new files must be admitted.
    /// `names` are those of the files that the result will have as far as they are known, its manifest left out. With `force` files
    /// that the program did not write may be replaced too where they have these names.
    ///
    /// # Errors
    /// [`DestinationError`]; nothing has been changed then.
    pub fn prepare_for(folder: impl AsRef<Path>, names: &[String], force: bool) -> Result<Self, DestinationError> {
        Self::on(disk(), folder.as_ref(), names, force)
    }

    pub(super) fn on(
        disk: Arc<dyn Disk>,
        folder: &Path,
        names: &[String],
        force: bool,
    ) -> Result<Self, DestinationError> {
        // a link keeps pointing to the place where the result stands
        let folder = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_path_buf());
        if folder.file_name().is_none() {
            return Err(DestinationError::Foreign { folder });
        }
        let destination = Self { folder, disk, force };
        let there = destination.is_there()?;
        destination.refuse_strangers(names)?;
        let parent = destination.parent();
        destination.disk.make_folder(&parent).map_err(|e| unwritable(&parent, &e))?;
        // a read-only place is refused now, not after hours of work
        let within = if there { &destination.folder } else { &parent };
        tempfile::tempfile_in(within).map_err(|e| unwritable(within, &e))?;
        Ok(destination)
    }

    /// The place.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Puts the files in the place of those that the program wrote there before; all other files stay as they are.
    ///
    /// # Errors
    /// [`DestinationError`]; what stood there before stands there still, or the new files stand there whole.
    pub fn fill(&self, files: &[(String, Vec<u8>)]) -> Result<(), DestinationError> {
        let names: Vec<String> = files.iter().map(|(name, _)| name.clone()).collect();
        let there = self.is_there()?;
        if there {
            self.settle_into_place()?;
        }
        self.refuse_strangers(&names)?;
        let (parent, name) = (self.parent(), self.folder.file_name().unwrap_or_default());
        temporary::clear(&*self.disk, &parent, name);
        temporary::clear(&*self.disk, &self.folder, OsStr::new(""));
        let new = match there {
            true => temporary::place(&self.folder, OsStr::new("")),
            false => temporary::place(&parent, name),
        };
        let made = self.make(&new, files).and_then(|()| {
            let place = if there { self.folder.join(READY) } else { self.folder.clone() };
            self.disk.rename(&new, &place).map_err(|e| unwritable(&self.folder, &e))
        });
        if made.is_err() && fs::symlink_metadata(&new).is_ok() {
            let _ = self.disk.remove_folder(&new);
        }
        made?;
        let above = if there { &self.folder } else { &parent };
        self.disk.settle(above).map_err(|e| unwritable(above, &e))?;
        if there { self.settle_into_place() } else { Ok(()) }
    }

    fn make(&self, new: &Path, files: &[(String, Vec<u8>)]) -> Result<(), DestinationError> {
        self.disk.make_folder(new).map_err(|e| unwritable(&self.folder, &e))?;
        let _held = temporary::hold(new);
        let within =
            |name: &str| Path::new(name).parent().filter(|at| !at.as_os_str().is_empty()).map(|at| new.join(at));
        let mut inner: Vec<PathBuf> = files.iter().filter_map(|(name, _)| within(name)).collect();
        inner.dedup();
        inner.iter().try_for_each(|at| self.disk.make_folder(at)).map_err(|e| unwritable(&self.folder, &e))?;
        for (name, content) in files {
            self.disk.write(&new.join(name), content).map_err(|e| unwritable(&self.folder.join(name), &e))?;
        }
        inner.iter().try_for_each(|at| self.disk.settle(at)).map_err(|e| unwritable(&self.folder, &e))?;
        self.disk.settle(new).map_err(|e| unwritable(&self.folder, &e))
    }

    /// Brings files that are ready to their places, and removes those of the program that they do not replace. It may begin anew at
    /// any point: the manifest goes last.
    fn settle_into_place(&self) -> Result<(), DestinationError> {
        let ready = self.folder.join(READY);
        if !ready.is_dir() {
            return Ok(());
        }
        let claimed = |folder: &Path| fs::read_to_string(folder.join(manifest::NAME)).ok();
        let new = claimed(&ready).and_then(|text| Manifest::claim(&text));
        if let Some(new) = new {
            let names: Vec<String> = new.files.iter().map(|f| f.name.clone()).chain([manifest::NAME.into()]).collect();
            self.refuse_strangers(&names)?;
            let old = claimed(&self.folder).and_then(|text| Manifest::claim(&text));
            for file in old.iter().flat_map(|old| &old.files) {
                let path = self.folder.join(&file.name);
                // what was changed since is no longer the program's own
                if !names.contains(&file.name) && is_plain(&file.name) && file.stands_at(&path) {
                    self.disk.remove_file(&path).map_err(|e| unwritable(&path, &e))?;
                }
            }
            for name in names.iter().filter(|name| is_plain(name) && ready.join(name).exists()) {
                let path = self.folder.join(name);
                self.disk.rename(&ready.join(name), &path).map_err(|e| unwritable(&path, &e))?;
            }
            self.disk.settle(&self.folder).map_err(|e| unwritable(&self.folder, &e))?;
        }
        // nothing that counts is left in it
        let _ = self.disk.remove_folder(&ready);
        Ok(())
    }

    /// Whether a folder stands there; what else stands there is refused.
    fn is_there(&self) -> Result<bool, DestinationError> {
        match fs::symlink_metadata(&self.folder) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(e) => Err(unwritable(&self.folder, &e)),
            Ok(at) if !at.is_dir() => Err(DestinationError::Foreign { folder: self.folder.clone() }),
            Ok(_) => Ok(true),
        }
    }

    /// Refuses files under these names that the program did not write, and all of its own that were changed since.
    fn refuse_strangers(&self, names: &[String]) -> Result<(), DestinationError> {
        if self.force {
            return Ok(());
        }
        let claims = Claims::of(&self.folder);
        let mut all: Vec<&str> =
            names.iter().map(String::as_str).chain([manifest::NAME]).chain(claims.names()).collect();
        all.sort_unstable();
        all.dedup();
        let (mut foreign, mut changed) = (Vec::new(), Vec::new());
        for name in all.into_iter().filter(|name| is_plain(name)) {
            let path = self.folder.join(name);
            if fs::symlink_metadata(&path).is_err() || claims.wrote(name, &path) {
                continue;
            }
            let list = if claims.names().any(|own| own == name) { &mut changed } else { &mut foreign };
            list.push(name.to_string());
        }
        match foreign.is_empty() && changed.is_empty() {
            true => Ok(()),
            false => Err(DestinationError::Occupied { folder: self.folder.clone(), foreign, changed }),
        }
    }

    fn parent(&self) -> PathBuf {
        match self.folder.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.into(),
            _ => PathBuf::from("."),
        }
    }
}

/// What the manifests in a folder say of its files: that of its result, and that of one which is ready to take its place.
struct Claims(Vec<Claim>);

impl Claims {
    fn of(folder: &Path) -> Self {
        let texts = [folder.to_path_buf(), folder.join(READY)].map(|at| fs::read_to_string(at.join(manifest::NAME)));
        Self(texts.iter().flatten().filter_map(|text| Manifest::claim(text)).collect())
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        let own = self.0.first().map(|_| manifest::NAME);
        own.into_iter().chain(self.0.iter().flat_map(|claim| claim.files.iter().map(|f| f.name.as_str())))
    }

    /// Whether a file stands as the program wrote it.
    fn wrote(&self, name: &str, path: &Path) -> bool {
        if name == manifest::NAME {
            let claim = fs::read_to_string(path).ok().and_then(|text| Manifest::claim(&text));
            return claim.is_some_and(|claim| claim.is_whole);
        }
        self.0.iter().flat_map(|claim| &claim.files).any(|f| f.name == name && f.stands_at(path))
    }
}

impl KeptFile {
    /// Whether it stands there as it was written.
    fn stands_at(&self, path: &Path) -> bool {
        let about = fs::symlink_metadata(path);
        about.is_ok_and(|about| about.is_file() && about.len() == self.bytes)
            && fs::read(path).is_ok_and(|content| fingerprint(&content) == self.sha256)
    }
}

/// The list is ours, and still no name in it may lead out of the folder.
pub(super) fn is_plain(name: &str) -> bool {
    Path::new(name).file_name().is_some_and(|n| n == name)
}

/// Where a file of a result is read: one that is ready counts before the one that it is to replace.
pub(super) fn standing(folder: &Path, name: &str) -> PathBuf {
    let ready = folder.join(READY);
    // a result that is ready has its manifest until all of it is in its place
    let counts = ready.join(manifest::NAME).is_file() && ready.join(name).is_file();
    if counts { ready.join(name) } else { folder.join(name) }
}

/// The text of the manifest of a result, when one stands there.
pub fn manifest_text(folder: &Path) -> Option<String> {
    read_input_text(&standing(folder, manifest::NAME)).ok()
}

/// The files of the program in a folder by its manifest, the manifest first, and the records that they were made from; nothing where
/// no result stands.
pub fn own_files(folder: &Path) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let Some(claim) = manifest_text(folder).and_then(|text| Manifest::claim(&text)) else { return Default::default() };
    let names = claim.files.iter().map(|f| f.name.as_str()).filter(|name| is_plain(name));
    (std::iter::once(manifest::NAME).chain(names).map(|name| folder.join(name)).collect(), claim.data)
}

fn unwritable(path: &Path, e: &io::Error) -> DestinationError {
    DestinationError::Unwritable { reason: format!("{}: {}", path.display(), reason(e)) }
}
