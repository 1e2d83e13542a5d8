//! A disk that fails or dies at a chosen operation, and remembers what it did.

use super::disk::{Disk, System};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

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
    events: Vec<Event>,
}

/// A disk with one fault; clones share it. Writing counts as two operations: the bytes, and waiting for them.
#[derive(Debug, Clone)]
pub(super) struct Faulty(Arc<Mutex<State>>);

impl Faulty {
    fn new(fails_at: Option<usize>, kind: Kind, dies: bool) -> Self {
        Self(Arc::new(Mutex::new(State { count: 0, fails_at, kind, dies, failed: false, events: Vec::new() })))
    }

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
        self.0.lock().unwrap().failed
    }

    pub(super) fn events(&self) -> Vec<Event> {
        self.0.lock().unwrap().events.clone()
    }

    fn step(
        &self,
        event: Event,
        whole: impl FnOnce() -> io::Result<()>,
        half: impl FnOnce() -> io::Result<()>,
    ) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
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
        match state.kind {
            Kind::Nothing => {}
            Kind::Torn => half()?,
            Kind::Done => whole()?,
        }
        full()
    }
}

impl Disk for Faulty {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let half = || fs::write(path, &bytes[..bytes.len() / 2]);
        self.step(Event::Written(path.into()), || fs::write(path, bytes), half)?;
        self.step(Event::Synced(path.into()), || Ok(()), || Ok(()))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.step(Event::Renamed(from.into(), to.into()), || System.rename(from, to), || Ok(()))
    }

    fn settle(&self, folder: &Path) -> io::Result<()> {
        self.step(Event::Settled(folder.into()), || Ok(()), || Ok(()))
    }

    fn make_folder(&self, path: &Path) -> io::Result<()> {
        self.step(Event::Made(path.into()), || System.make_folder(path), || Ok(()))
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
