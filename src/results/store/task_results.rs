//! Results of independent tasks, to which many programs on many machines add at once.
//!
//! A file holds the results of some tasks, and its name is the SHA-256 of what it holds: what is torn, changed or foreign is seen by its
//! name, and the same results have the same name whoever writes them. A file appears by a rename, and is never changed. Nothing is locked, so
//! that a lock that is left over on a network file system stops nobody.
//!
//! The report of work that goes on: one small file beside the place of the result, replaced now and then, gone at the end.

use super::disk::{Disk, disk, reason};
use super::identity::fingerprint;
use super::temporary;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fmt, fs, io};

const MAGIC: &[u8; 8] = b"fdm-task";
const VERSION: u32 = 1;
/// SHA-256 as hexadecimal digits.
const DIGITS: usize = 64;
/// Magic, version, plan, program.
const HEADER: usize = 8 + 4 + 2 * DIGITS;
const ENDING: &str = ".results";

/// A task: the command of a plan that it belongs to, and its number there, both from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct TaskKey {
    /// Number of the command.
    pub command: u32,
    /// Number of the task.
    pub task: u64,
}

/// What results come from: they are believed where both are the same.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provenance {
    /// SHA-256 of the plan, as 64 hexadecimal digits.
    pub plan: String,
    /// SHA-256 of the program, as 64 hexadecimal digits.
    pub program: String,
}

/// A folder with results of one plan by one program.
pub struct TaskResults {
    folder: PathBuf,
    disk: Arc<dyn Disk>,
    own: Provenance,
}

/// All results that a folder holds.
#[derive(Debug, Default)]
pub struct Gathered {
    /// The result of each task that has one.
    pub results: BTreeMap<TaskKey, Vec<u8>>,
    /// Files that were read.
    pub files: usize,
    /// Files that are torn, changed or foreign, one sentence each; what they held counts as not there.
    pub damaged: Vec<String>,
}

/// Why results cannot be believed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TaskError {
    /// The folder cannot be read.
    Unreadable {
        /// What is wrong where.
        reason: String,
    },
    /// Results of another plan.
    OtherPlan {
        /// The file.
        file: PathBuf,
    },
    /// Results of another program.
    OtherProgram {
        /// The file.
        file: PathBuf,
    },
    /// Two results of one task are not the same.
    Contradiction {
        /// The task.
        task: TaskKey,
        /// The file with the other result.
        file: PathBuf,
    },
}

impl fmt::Display for TaskError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable { reason } => f.write_str(reason),
            Self::OtherPlan { file } => {
                write!(
                    f,
                    "{}: results of another plan; remove the file, or give the folder of that plan",
                    file.display()
                )
            }
            Self::OtherProgram { file } => write!(
                f,
                "{}: results of another build of fdm, whose numbers may differ in the last digits; remove the file, and run those \
                 tasks again",
                file.display()
            ),
            Self::Contradiction { task, file } => write!(
                f,
                "{}: task {} of command {} has another result in another file: the machines do not compute the same bits; remove \
                 the file of the one that is in doubt",
                file.display(),
                task.task,
                task.command
            ),
        }
    }
}

impl std::error::Error for TaskError {}

impl TaskResults {
    /// In this folder, which need not be there yet.
    pub fn new(folder: impl Into<PathBuf>, own: Provenance) -> Self {
        Self { folder: folder.into(), disk: disk(), own }
    }

    /// Adds results. What is there already is not written again.
    ///
    /// # Errors
    /// Those of the file system; nothing is left of the file then.
    pub fn keep(&self, results: &BTreeMap<TaskKey, Vec<u8>>) -> io::Result<()> {
        self.disk.make_folder(&self.folder)?;
        let bytes = sealed(&self.own, results).map_err(io::Error::other)?;
        let name = format!("{}{ENDING}", fingerprint(&bytes));
        let place = self.folder.join(&name);
        if fs::read(&place).is_ok_and(|there| there == bytes) {
            return Ok(());
        }
        let new = temporary::place(&self.folder, OsStr::new(&name));
        let written = self.disk.write_unlocked(&new, &bytes).and_then(|()| self.disk.rename(&new, &place));
        if written.is_err() {
            let _ = self.disk.remove_file(&new);
        }
        written?;
        self.disk.settle(&self.folder)
    }

    /// Everything that is there.
    ///
    /// # Errors
    /// [`TaskError`]; torn and foreign files are none, but reported.
    pub fn gather(&self) -> Result<Gathered, TaskError> {
        let said = |path: &Path, e: &io::Error| format!("{}: {}", path.display(), reason(e));
        let mut names = Vec::new();
        match fs::read_dir(&self.folder) {
            Ok(entries) => {
                for entry in entries {
                    let entry = entry.map_err(|e| TaskError::Unreadable { reason: said(&self.folder, &e) })?;
                    names.push(entry.file_name());
                }
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            Err(e) => return Err(TaskError::Unreadable { reason: said(&self.folder, &e) }),
        }
        // the same messages on every machine
        names.sort();
        let mut found = Gathered::default();
        for name in names {
            let name = name.to_string_lossy().into_owned();
            let file = self.folder.join(&name);
            let Some(digest) = name.strip_suffix(ENDING) else {
                // what a program that died was about to write begins with a dot
                if !name.starts_with('.') {
                    found.damaged.push(format!("{}: not a file of fdm; it is left alone", file.display()));
                }
                continue;
            };
            let bytes = match fs::read(&file) {
                Ok(bytes) => bytes,
                Err(e) => {
                    found.damaged.push(said(&file, &e));
                    continue;
                }
            };
            if fingerprint(&bytes) != digest {
                found.damaged.push(format!(
                    "{}: damaged: its content is not that of its name; its tasks count as not done",
                    file.display()
                ));
                continue;
            }
            let Some((whence, results)) = opened(&bytes) else {
                found.damaged.push(format!("{}: its format is of another version of fdm", file.display()));
                continue;
            };
            if whence.plan != self.own.plan {
                return Err(TaskError::OtherPlan { file });
            }
            if whence.program != self.own.program {
                return Err(TaskError::OtherProgram { file });
            }
            found.files += 1;
            for (task, result) in results {
                let before = found.results.entry(task).or_insert_with(|| result.clone());
                if *before != result {
                    return Err(TaskError::Contradiction { task, file });
                }
            }
        }
        Ok(found)
    }
}

fn sealed(own: &Provenance, results: &BTreeMap<TaskKey, Vec<u8>>) -> Result<Vec<u8>, postcard::Error> {
    let mut bytes = Vec::new();
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    for digest in [&own.plan, &own.program] {
        let mut digits = digest.as_bytes().to_vec();
        digits.resize(DIGITS, b' ');
        bytes.extend_from_slice(&digits);
    }
    bytes.extend(postcard::to_allocvec(results)?);
    Ok(bytes)
}

fn opened(bytes: &[u8]) -> Option<(Provenance, BTreeMap<TaskKey, Vec<u8>>)> {
    let (header, body) = bytes.split_at_checked(HEADER)?;
    let rest = header.strip_prefix(MAGIC)?.strip_prefix(&VERSION.to_le_bytes())?;
    let digest = |digits: &[u8]| String::from_utf8_lossy(digits).trim_end().to_string();
    let own = Provenance { plan: digest(&rest[..DIGITS]), program: digest(&rest[DIGITS..]) };
    Some((own, postcard::from_bytes(body).ok()?))
}

/// The file beside a folder that work is to fill.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgressFile {
    path: PathBuf,
}

impl ProgressFile {
    /// Of a folder, which need not be there yet. The file stands beside it, so that the folder is nothing but a result.
    pub fn of(folder: impl AsRef<Path>) -> Self {
        // a link keeps pointing to the place where the result stands
        let folder = fs::canonicalize(&folder).unwrap_or_else(|_| folder.as_ref().to_path_buf());
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        Self { path: folder.with_file_name(format!(".{name}.progress")) }
    }

    /// Where it stands.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Puts a text in the place of the last report: a reader finds the one or the other, never a part. Nothing waits
    /// for the disk; what a power failure takes was worth a second.
    ///
    /// # Errors
    /// Those of the file system; the last report stands then.
    pub fn tell(&self, text: &str) -> io::Result<()> {
        let new = self.next();
        let written = fs::write(&new, text).and_then(|()| fs::rename(&new, &self.path));
        if written.is_err() {
            let _ = fs::remove_file(&new);
        }
        written
    }

    /// The last report; none when no work goes on.
    pub fn read(&self) -> Option<String> {
        fs::read_to_string(&self.path).ok()
    }

    /// Ends it.
    pub fn remove(&self) {
        // and what a program that died has left half written
        [&self.path, &self.next()].into_iter().for_each(|path| _ = fs::remove_file(path));
    }

    fn next(&self) -> PathBuf {
        self.path.with_extension("progress.new")
    }
}

#[cfg(test)]
mod tests {
    use super::super::faults::{Faulty, Kind};
    use super::*;

    fn own() -> Provenance {
        Provenance { plan: fingerprint(b"plan"), program: fingerprint(b"program") }
    }

    fn some(tasks: &[u64]) -> BTreeMap<TaskKey, Vec<u8>> {
        tasks.iter().map(|task| (TaskKey { command: 0, task: *task }, format!("result {task}").into_bytes())).collect()
    }

    fn only(folder: &Path) -> PathBuf {
        let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(files.len(), 1, "{files:?}");
        files.remove(0)
    }

    #[test]
    fn results_are_found_in_any_order_and_twice() {
        let folder = tempfile::tempdir().unwrap();
        let store = TaskResults::new(folder.path().join("deep"), own());
        assert!(store.gather().unwrap().results.is_empty());
        for tasks in [&[3, 4][..], &[0, 1], &[3, 4], &[1, 2, 3]] {
            store.keep(&some(tasks)).unwrap();
        }
        let found = store.gather().unwrap();
        assert_eq!((found.results, found.files, found.damaged.len()), (some(&[0, 1, 2, 3, 4]), 3, 0));
    }

    #[test]
    fn torn_changed_and_foreign_files_are_told_and_not_believed() {
        let folder = tempfile::tempdir().unwrap();
        let store = TaskResults::new(folder.path(), own());
        store.keep(&some(&[1, 2])).unwrap();
        let file = only(folder.path());
        let whole = fs::read(&file).unwrap();
        let flipped: Vec<u8> = whole.iter().enumerate().map(|(k, b)| if k == 150 { b ^ 1 } else { *b }).collect();
        for broken in [&whole[..whole.len() - 1], &flipped[..], b""] {
            fs::write(&file, broken).unwrap();
            let found = store.gather().unwrap();
            assert!(found.results.is_empty() && found.damaged[0].contains("damaged"), "{:?}", found.damaged);
        }
        // and the same results mend it
        store.keep(&some(&[1, 2])).unwrap();
        fs::write(folder.path().join("notes.txt"), "mine").unwrap();
        fs::write(folder.path().join("ab.results"), "mine").unwrap();
        let found = store.gather().unwrap();
        assert_eq!((found.results, found.damaged.len()), (some(&[1, 2]), 2));
    }

    #[test]
    fn other_plans_programs_and_results_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let store = TaskResults::new(folder.path(), own());
        store.keep(&some(&[1])).unwrap();
        let other = |own| TaskResults::new(folder.path(), own).gather().unwrap_err();
        let plan = fingerprint(b"other");
        assert!(matches!(other(Provenance { plan: plan.clone(), ..own() }), TaskError::OtherPlan { .. }));
        assert!(matches!(other(Provenance { program: plan, ..own() }), TaskError::OtherProgram { .. }));
        let mut others = some(&[1]);
        others.values_mut().for_each(|result| result.push(0));
        store.keep(&others).unwrap();
        assert!(store.gather().unwrap_err().to_string().contains("do not compute the same bits"));
    }

    /// A disk that fails at any operation, or a program that dies there: nothing wrong is believed, and the next attempt succeeds.
    #[test]
    fn whatever_fails_results_are_there_whole_or_not() {
        for kind in [Kind::Nothing, Kind::Torn, Kind::Done] {
            for n in 0.. {
                let folder = tempfile::tempdir().unwrap();
                let disk = Faulty::dies(n, kind);
                let faulty = TaskResults { disk: Arc::new(disk.clone()), ..TaskResults::new(folder.path(), own()) };
                let kept = faulty.keep(&some(&[5]));
                let store = TaskResults::new(folder.path(), own());
                let found = store.gather().unwrap();
                assert!(found.damaged.is_empty() && (found.results.is_empty() || found.results == some(&[5])));
                assert!(kept.is_err() || found.results == some(&[5]), "operation {n}");
                store.keep(&some(&[5])).unwrap();
                assert_eq!(store.gather().unwrap().results, some(&[5]), "operation {n}");
                if !disk.failed() {
                    assert!(n > 3, "all operations were tried");
                    break;
                }
            }
        }
    }
}

#[cfg(test)]
mod progress_tests {
    use super::*;

    #[test]
    fn what_is_told_stands_beside_the_folder_and_leaves_nothing() {
        let desk = tempfile::tempdir().unwrap();
        let folder = desk.path().join("result");
        let file = ProgressFile::of(&folder);
        assert_eq!(file.read(), None);
        file.tell("one").unwrap();
        file.tell("two").unwrap();
        assert_eq!(file.read().as_deref(), Some("two"));
        // the folder appears, and the place stays the same
        fs::create_dir(&folder).unwrap();
        assert_eq!(ProgressFile::of(&folder).read().as_deref(), Some("two"));
        assert_eq!(fs::read_dir(desk.path()).unwrap().count(), 2);
        fs::write(desk.path().join(".result.progress.new"), "ha").unwrap();
        file.remove();
        assert_eq!(fs::read_dir(desk.path()).unwrap().count(), 1);
        assert!(ProgressFile::of(desk.path().join("none/result")).tell("x").is_err());
    }
}
