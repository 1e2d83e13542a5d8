//! A folder that keeps the state of one fit, and of no other.

use super::disk::{Disk, disk, reason};
use super::generations::Generations;
use super::identity::{Difference, Identity};
use fdm_estimate::CheckpointStore;
use std::fmt;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The name under which the identity of the fit is kept.
const IDENTITY: &str = "identity";
/// The file that one program at a time locks; the lock ends with the program, however that ends.
const LOCK: &str = "lock";

/// Keeps the state of a fit in a folder: a fit that was interrupted at any moment goes on from there and ends with the
/// same bits.
pub struct Checkpoint {
    kept: Generations,
    resumed: bool,
    /// Held as long as the checkpoint is in use.
    _lock: File,
    troubles: Mutex<Troubles>,
}

#[derive(Debug, Default)]
struct Troubles {
    notes: Vec<String>,
    failure: Option<String>,
}

/// Why a folder cannot keep the state of a fit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CheckpointError {
    /// It cannot be made, read or written.
    Unusable {
        /// What is wrong where.
        reason: String,
    },
    /// It holds other files.
    Foreign {
        /// The folder.
        folder: PathBuf,
        /// One of the files.
        file: String,
    },
    /// Another program is at work with it.
    Busy {
        /// The folder.
        folder: PathBuf,
    },
    /// What it holds cannot be read.
    Damaged {
        /// The folder.
        folder: PathBuf,
        /// What is damaged how.
        damage: Vec<String>,
    },
    /// It belongs to another fit.
    Other {
        /// The folder.
        folder: PathBuf,
        /// In what the other fit differs.
        differences: Vec<Difference>,
    },
}

impl fmt::Display for CheckpointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN: usize = 6;
        match self {
            Self::Unusable { reason } => write!(f, "the checkpoint cannot be kept: {reason}"),
            Self::Foreign { folder, file } => write!(
                f,
                "{} holds other files (`{file}`) and no checkpoint: give a new or empty folder",
                folder.display()
            ),
            Self::Busy { folder } => {
                write!(f, "the checkpoint in {} is in use by another fit that is running", folder.display())
            }
            Self::Damaged { folder, damage } => write!(
                f,
                "the checkpoint in {} cannot be read: {}; remove the folder to begin anew",
                folder.display(),
                damage.join("; ")
            ),
            Self::Other { folder, differences } => {
                write!(f, "the checkpoint in {} belongs to another fit: ", folder.display())?;
                let said: Vec<String> = differences.iter().take(SHOWN).map(ToString::to_string).collect();
                write!(f, "{}", said.join("; "))?;
                if differences.len() > SHOWN {
                    write!(f, "; and {} more", differences.len() - SHOWN)?;
                }
                write!(f, ". Repeat the command that began it, or give another folder")
            }
        }
    }
}

impl std::error::Error for CheckpointError {}

impl Checkpoint {
    /// Opens a folder for a fit, and makes it when there is none. A folder that has kept the same fit before gives back
    /// what it holds.
    ///
    /// # Errors
    /// [`CheckpointError`], before anything in the folder is changed but the file that locks it.
    pub fn open(folder: impl AsRef<Path>, identity: &Identity) -> Result<Self, CheckpointError> {
        Self::on(disk(), folder.as_ref(), identity)
    }

    pub(super) fn on(disk: Arc<dyn Disk>, folder: &Path, identity: &Identity) -> Result<Self, CheckpointError> {
        let unusable =
            |e: io::Error| CheckpointError::Unusable { reason: format!("{}: {}", folder.display(), reason(&e)) };
        disk.make_folder(folder).map_err(unusable)?;
        refuse_foreign(folder)?;
        let lock = lock(folder)?;
        let kept = Generations::new(folder, disk);
        let before = kept.find(IDENTITY).map_err(|reason| CheckpointError::Unusable { reason })?;
        let damaged = |damage| CheckpointError::Damaged { folder: folder.into(), damage };
        let resumed = match before.state {
            Some(state) => {
                let then: Identity = serde_json::from_slice(&state)
                    .map_err(|_| damaged(vec!["its identity is of another version of fdm".into()]))?;
                let differences = then.differences(identity);
                if !differences.is_empty() {
                    return Err(CheckpointError::Other { folder: folder.into(), differences });
                }
                true
            }
            None if !before.damaged.is_empty() => return Err(damaged(before.damaged)),
            None => false,
        };
        // kept anew when it is there already: a folder that can no longer be written is refused before the work begins
        let state = serde_json::to_vec(identity)
            .map_err(|e| CheckpointError::Unusable { reason: format!("{}: {e}", folder.display()) })?;
        kept.keep(IDENTITY, &state).map_err(|reason| CheckpointError::Unusable { reason })?;
        let troubles = Troubles { notes: before.damaged, failure: None };
        Ok(Self { kept, resumed, _lock: lock, troubles: Mutex::new(troubles) })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.kept.folder()
    }

    /// Whether the folder held this fit already.
    pub fn resumed(&self) -> bool {
        self.resumed
    }

    /// What was found damaged, and what was done instead.
    pub fn notes(&self) -> Vec<String> {
        self.troubles().notes.clone()
    }

    /// Why the last state could not be kept; none when it was, or when nothing was to be kept.
    pub fn failure(&self) -> Option<String> {
        self.troubles().failure.clone()
    }

    fn troubles(&self) -> MutexGuard<'_, Troubles> {
        self.troubles.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl CheckpointStore for Checkpoint {
    fn keep(&self, name: &str, state: &[u8]) -> Result<(), String> {
        let kept = self.kept.keep(name, state);
        self.troubles().failure = kept.clone().err();
        kept
    }

    fn find(&self, name: &str) -> Result<Option<Vec<u8>>, String> {
        let found = self.kept.find(name)?;
        let lost = found.state.is_none() && !found.damaged.is_empty();
        let instead = if lost { "it is computed anew" } else { "what was kept before it is used" };
        self.troubles().notes.extend(found.damaged.iter().map(|d| format!("{d}; {instead}")));
        if lost { Err(found.damaged.join("; ")) } else { Ok(found.state) }
    }
}

/// Refuses a folder with files, of which none is the identity of a fit.
fn refuse_foreign(folder: &Path) -> Result<(), CheckpointError> {
    let unusable = |e: io::Error| CheckpointError::Unusable { reason: format!("{}: {}", folder.display(), reason(&e)) };
    let (mut ours, mut other) = (false, None::<String>);
    for entry in fs::read_dir(folder).map_err(unusable)? {
        let name = entry.map_err(unusable)?.file_name().to_string_lossy().into_owned();
        if name.starts_with(IDENTITY) {
            ours = true;
        } else if name != LOCK && other.as_ref().is_none_or(|o| name < *o) {
            other = Some(name);
        }
    }
    match other {
        Some(file) if !ours => Err(CheckpointError::Foreign { folder: folder.into(), file }),
        _ => Ok(()),
    }
}

fn lock(folder: &Path) -> Result<File, CheckpointError> {
    let path = folder.join(LOCK);
    let unusable = |e: io::Error| CheckpointError::Unusable { reason: format!("{}: {}", path.display(), reason(&e)) };
    let file = File::options().create(true).truncate(false).write(true).open(&path).map_err(unusable)?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(CheckpointError::Busy { folder: folder.into() }),
        // some network file systems know no locks: better without one than not at all
        Err(TryLockError::Error(e)) if e.kind() == io::ErrorKind::Unsupported => Ok(file),
        Err(TryLockError::Error(e)) => Err(unusable(e)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::faults::{Faulty, Kind};
    use super::*;
    use fdm_estimate::FitOptions;
    use fdm_system::model::Model;

    fn identity(text: &str) -> Identity {
        Identity::of(&Model::from_text("a.fdm", text).unwrap(), &[], &FitOptions::default())
    }

    const TEXT: &str = "model a { param k = 1; output y = k; }";

    fn refused(folder: &Path, identity: &Identity) -> String {
        Checkpoint::open(folder, identity).err().expect("refused").to_string()
    }

    #[test]
    fn a_folder_keeps_one_fit_and_gives_it_back() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("deep").join("checkpoint");
        let first = Checkpoint::open(&place, &identity(TEXT)).unwrap();
        assert!(!first.resumed());
        first.keep("iteration", b"one").unwrap();
        assert!(refused(&place, &identity(TEXT)).contains("in use by another fit"));
        drop(first);
        let again = Checkpoint::open(&place, &identity(TEXT)).unwrap();
        assert!(again.resumed());
        assert_eq!(again.find("iteration"), Ok(Some(b"one".to_vec())));
        assert_eq!(again.find("start-1"), Ok(None));
        drop(again);
        let said = refused(&place, &identity(&TEXT.replace("= 1", "= 2")));
        assert!(said.contains("belongs to another fit: another model"), "{said}");
    }

    #[test]
    fn folders_with_other_files_are_refused_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("thesis.txt"), "all of it").unwrap();
        let said = refused(folder.path(), &identity(TEXT));
        assert!(said.contains("`thesis.txt`"), "{said}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let said = refused(&folder.path().join("thesis.txt"), &identity(TEXT));
        assert!(said.contains("thesis.txt"), "{said}");
    }

    #[test]
    fn a_damaged_state_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let kept = Checkpoint::open(folder.path(), &identity(TEXT)).unwrap();
        kept.keep("iteration", b"one").unwrap();
        fs::write(folder.path().join("iteration.1"), "torn").unwrap();
        assert!(kept.find("iteration").unwrap_err().contains("iteration.1 is damaged"));
        assert!(kept.notes()[0].ends_with("it is computed anew"));
        kept.keep("iteration", b"two").unwrap();
        kept.keep("iteration", b"three").unwrap();
        // the third took the place of the first
        fs::write(folder.path().join("iteration.1"), "torn").unwrap();
        assert_eq!(kept.find("iteration").unwrap().as_deref(), Some(&b"two"[..]));
        assert!(kept.notes().len() == 2 && kept.notes()[1].ends_with("what was kept before it is used"));
        drop(kept);
        fs::write(folder.path().join("identity.1"), "torn").unwrap();
        assert!(refused(folder.path(), &identity(TEXT)).contains("remove the folder to begin anew"));
    }

    /// A program that dies while it makes the folder can be started again, whenever that was.
    #[test]
    fn dying_while_the_folder_is_made_leaves_one_that_can_be_used() {
        for kind in [Kind::Nothing, Kind::Torn, Kind::Done] {
            for n in 0..6 {
                let folder = tempfile::tempdir().unwrap();
                let place = folder.path().join("checkpoint");
                drop(Checkpoint::on(Arc::new(Faulty::dies(n, kind)), &place, &identity(TEXT)));
                let again = Checkpoint::open(&place, &identity(TEXT));
                assert!(again.is_ok(), "died at operation {n}: {:?}", again.err());
            }
        }
    }

    #[test]
    fn a_disk_that_fills_up_is_remembered_until_there_is_room_again() {
        let folder = tempfile::tempdir().unwrap();
        let disk = Faulty::fails_once(6, Kind::Torn);
        let kept = Checkpoint::on(Arc::new(disk), folder.path(), &identity(TEXT)).unwrap();
        let ends: Vec<bool> = (0..3).map(|_| kept.keep("iteration", b"state").is_ok()).collect();
        assert!(ends.contains(&false) && ends[2], "{ends:?}");
        assert_eq!(kept.failure(), None);
        let kept = Faulty::dies(6, Kind::Nothing);
        let folder = tempfile::tempdir().unwrap();
        let kept = Checkpoint::on(Arc::new(kept), folder.path(), &identity(TEXT)).unwrap();
        (0..3).for_each(|_| drop(kept.keep("iteration", b"state")));
        assert!(kept.failure().is_some_and(|f| f.ends_with("the disk is full")));
    }
}
