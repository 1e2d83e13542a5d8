//! A disk that fails or dies at a chosen operation, and remembers what it did: for the tests of the store, and of the whole program.

use super::disk::{Disk, System, choose};
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The exit code of a program that dies at an operation.
const DEAD: i32 = 86;

/// Lets the n-th operation on files of this program fail, from 0: `KIND:N` or `dies:KIND:N`, where the kind is `nothing`, `torn` or
/// `done`. It is reported on standard error when that operation is reached. A program that dies ends there with exit code 86, and
/// nothing is tidied up.
///
/// # Errors
/// Words that mean nothing.
pub fn fail_at(words: &str) -> Result<(), String> {
    let parts: Vec<&str> = words.split(':').collect();
    let (dies, kind, at) = match parts[..] {
        ["dies", kind, at] => (true, kind, at),
        [kind, at] => (false, kind, at),
        _ => return Err(format!("`{words}` is no fault")),
    };
    let kind = match kind {
        "nothing" => Kind::Nothing,
        "torn" => Kind::Torn,
        "done" => Kind::Done,
        _ => return Err(format!("`{kind}` is no kind of fault")),
    };
    let at = at.parse().map_err(|_| format!("`{at}` is no number"))?;
    let faulty = Faulty::new(Some(at), kind, dies);
    faulty.state().reported = true;
    choose(Arc::new(faulty));
    Ok(())
}

/// How far an operation comes that fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Nothing happens.
    Nothing,
    /// Half of the bytes are written; of other operations nothing happens.
    Torn,
    /// All is done, and then reported as failed (or the program ends before it hears of it).
    Done,
}

/// What a disk did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Event {
    Written(PathBuf),
    Synced(PathBuf),
    Renamed(PathBuf, PathBuf),
    Settled(PathBuf),
    Made(PathBuf),
    Removed(PathBuf),
}

#[derive(Debug)]
struct State {
    count: usize,
    fails_at: Option<usize>,
    kind: Kind,
    /// Every operation after the failing one fails too: the program is dead.
    dies: bool,
    failed: bool,
    /// The failure is that of the whole program.
    reported: bool,
    events: Vec<Event>,
}

/// A disk with one fault; clones share it. Writing counts as two operations: the bytes, and waiting for them.
#[derive(Debug, Clone)]
pub(super) struct Faulty(Arc<Mutex<State>>);

impl Faulty {
    fn new(fails_at: Option<usize>, kind: Kind, dies: bool) -> Self {
        let state = State { count: 0, fails_at, kind, dies, failed: false, reported: false, events: Vec::new() };
        Self(Arc::new(Mutex::new(state)))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn step(
        &self,
        event: Event,
        whole: impl FnOnce() -> io::Result<()>,
        half: impl FnOnce() -> io::Result<()>,
    ) -> io::Result<()> {
        let mut state = self.state();
        let full = || Err(io::Error::from(io::ErrorKind::StorageFull));
        if state.failed && state.dies {
            return full();
        }
        let now = state.fails_at == Some(state.count);
        state.count += 1;
        if !now {
            state.events.push(event);
            return whole();
        }
        state.failed = true;
        if state.reported {
            let _ = writeln!(io::stderr(), "fault at operation {}: {event:?}", state.count - 1);
        }
        let done = match state.kind {
            Kind::Nothing => Ok(()),
            Kind::Torn => half(),
            Kind::Done => whole(),
        };
        if state.reported && state.dies {
            std::process::exit(DEAD);
        }
        done.and(full())
    }
}

impl Disk for Faulty {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<File> {
        let mut made = None;
        let half = || System::new_file(path)?.write_all(&bytes[..bytes.len() / 2]);
        let whole = || {
            let mut file = System::new_file(path)?;
            file.write_all(bytes)?;
            made = Some(file);
            Ok(())
        };
        self.step(Event::Written(path.into()), whole, half)?;
        self.step(Event::Synced(path.into()), || Ok(()), || Ok(()))?;
        made.ok_or_else(|| io::ErrorKind::StorageFull.into())
    }

    fn write_unlocked(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.write(path, bytes).map(drop)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.step(Event::Renamed(from.into(), to.into()), || System.rename(from, to), || Ok(()))
    }

    fn rename_new(&self, from: &Path, to: &Path) -> io::Result<()> {
        let half = || fs::hard_link(from, to);
        self.step(Event::Renamed(from.into(), to.into()), || System.rename_new(from, to), half)
    }

    fn settle(&self, folder: &Path) -> io::Result<()> {
        self.step(Event::Settled(folder.into()), || Ok(()), || Ok(()))
    }

    fn make_folder(&self, path: &Path) -> io::Result<()> {
        self.step(Event::Made(path.into()), || System.make_folder(path), || Ok(()))
    }

    fn remove_file(&self, path: &Path) -> io::Result<()> {
        self.step(Event::Removed(path.into()), || System.remove_file(path), || Ok(()))
    }

    fn remove_folder(&self, path: &Path) -> io::Result<()> {
        // a removal that dies leaves a part
        let half = || match fs::read_dir(path)?.next() {
            Some(entry) => fs::remove_file(entry?.path()),
            None => Ok(()),
        };
        self.step(Event::Removed(path.into()), || System.remove_folder(path), half)
    }
}

#[cfg(test)]
impl Faulty {
    pub(super) fn none() -> Self {
        Self::new(None, Kind::Nothing, false)
    }

    pub(super) fn dies(at: usize, kind: Kind) -> Self {
        Self::new(Some(at), kind, true)
    }

    pub(super) fn fails_once(at: usize, kind: Kind) -> Self {
        Self::new(Some(at), kind, false)
    }

    /// Whether the operation that was to fail was reached.
    pub(super) fn failed(&self) -> bool {
        self.state().failed
    }

    pub(super) fn events(&self) -> Vec<Event> {
        self.state().events.clone()
    }
}
