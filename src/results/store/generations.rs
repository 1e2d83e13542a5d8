//! Two generations of every state: the next is written beside the two that there are and takes the place of the older one,
//! so that the newest complete one survives whatever happens while writing.
//!
//! The form in which a state lies on the disk: a header with magic, version, sequence number, length and checksum, then
//! the state itself.

use super::disk::{Disk, reason};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{fmt, fs, io};

/// States under names in one folder.
pub(super) struct Generations {
    folder: PathBuf,
    disk: Arc<dyn Disk>,
    /// Sequence number and place of what was written or found last.
    newest: Mutex<BTreeMap<String, Newest>>,
}

#[derive(Debug, Clone, Copy)]
struct Newest {
    sequence: u64,
    slot: usize,
}

/// What was found under a name.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Found {
    /// The newest state that is whole.
    pub(super) state: Option<Vec<u8>>,
    /// The files that are there and not whole, one sentence each.
    pub(super) damaged: Vec<String>,
}

impl Generations {
    pub(super) fn new(folder: impl Into<PathBuf>, disk: Arc<dyn Disk>) -> Self {
        Self { folder: folder.into(), disk, newest: Mutex::default() }
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Keeps a state in place of the older one of the two that there are.
    pub(super) fn keep(&self, name: &str, state: &[u8]) -> Result<(), String> {
        let mut newest = self.lock();
        let last = match newest.get(name) {
            Some(last) => Some(*last),
            None => self.read(name)?.1,
        };
        let next = last.map_or(Newest { sequence: 1, slot: 0 }, |l| Newest {
            sequence: l.sequence.saturating_add(1),
            slot: 1 - l.slot,
        });
        let (new, place) = (self.new_file(name), self.file(name, next.slot));
        let bytes = seal(name, next.sequence, state);
        let said = |path: &Path, e: &io::Error| format!("{}: {}", path.display(), reason(e));
        // left by a program that died, or that could not write it
        if fs::symlink_metadata(&new).is_ok() {
            self.disk.remove_file(&new).map_err(|e| said(&new, &e))?;
        }
        self.disk.write(&new, &bytes).map_err(|e| said(&new, &e))?;
        self.disk.rename(&new, &place).map_err(|e| said(&place, &e))?;
        newest.insert(name.to_string(), next);
        self.disk.settle(&self.folder).map_err(|e| said(&self.folder, &e))
    }

    /// The newest state that is whole, and what is damaged.
    pub(super) fn find(&self, name: &str) -> Result<Found, String> {
        let mut newest = self.lock();
        let (found, last) = self.read(name)?;
        if let Some(last) = last {
            newest.insert(name.to_string(), last);
        }
        Ok(found)
    }

    fn read(&self, name: &str) -> Result<(Found, Option<Newest>), String> {
        let (mut found, mut last) = (Found::default(), None::<Newest>);
        for slot in 0..2 {
            let path = self.file(name, slot);
            let bytes = match fs::read(&path) {
                Ok(bytes) => bytes,
                Err(e) if e.kind() == io::ErrorKind::NotFound => continue,
                Err(e) => return Err(format!("{}: {}", path.display(), reason(&e))),
            };
            match open(name, &bytes) {
                Ok((sequence, state)) if last.is_none_or(|l| sequence > l.sequence) => {
                    found.state = Some(state);
                    last = Some(Newest { sequence, slot });
                }
                Ok(_) => {}
                Err(damage) => found.damaged.push(format!("{} is damaged: {damage}", path.display())),
            }
        }
        Ok((found, last))
    }

    fn file(&self, name: &str, slot: usize) -> PathBuf {
        self.folder.join(format!("{}.{}", plain(name), slot + 1))
    }

    fn new_file(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{}.new", plain(name)))
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<String, Newest>> {
        // a thread that panicked while keeping left the map as it was before or as it is on the disk
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A name that every file system takes, different for different names.
fn plain(name: &str) -> String {
    let mut plain = String::with_capacity(name.len());
    for byte in name.bytes() {
        match byte {
            b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_' => plain.push(char::from(byte)),
            other => plain.push_str(&format!("%{other:02x}")),
        }
    }
    plain
}

const MAGIC: &[u8; 8] = b"fdm-kept";
const VERSION: u32 = 1;
/// Magic, version, sequence number, length, checksum.
const HEADER: usize = 8 + 4 + 8 + 8 + 4;

/// Why bytes are not a state that was kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Damage {
    Foreign,
    Version(u32),
    Length { found: usize, wanted: u64 },
    Checksum,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Foreign => write!(f, "it does not begin like a file of fdm"),
            Self::Version(v) => write!(f, "its format is version {v}, this program reads version {VERSION}"),
            Self::Length { found, wanted } => write!(f, "it holds {found} of {wanted} bytes"),
            Self::Checksum => write!(f, "its checksum does not fit its content"),
        }
    }
}

/// The bytes of a file that keeps `state` under `name`; the higher the sequence number, the newer.
pub(super) fn seal(name: &str, sequence: u64, state: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER + state.len());
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&sequence.to_le_bytes());
    bytes.extend_from_slice(&(state.len() as u64).to_le_bytes());
    let sum = checksum(name, &bytes, state);
    bytes.extend_from_slice(&sum.to_le_bytes());
    bytes.extend_from_slice(state);
    bytes
}

/// Sequence number and state of a file.
pub(super) fn open(name: &str, bytes: &[u8]) -> Result<(u64, Vec<u8>), Damage> {
    let (header, state) = bytes.split_at_checked(HEADER).ok_or(Damage::Foreign)?;
    if !header.starts_with(MAGIC) {
        return Err(Damage::Foreign);
    }
    let (version, sequence, length, sum) = (four(header, 8), eight(header, 12), eight(header, 20), four(header, 28));
    if version != VERSION {
        return Err(Damage::Version(version));
    }
    if state.len() as u64 != length {
        return Err(Damage::Length { found: state.len(), wanted: length });
    }
    if checksum(name, &header[..HEADER - 4], state) != sum {
        return Err(Damage::Checksum);
    }
    Ok((sequence, state.to_vec()))
}

/// Covers the name too, so that files that changed places are noticed.
fn checksum(name: &str, header: &[u8], state: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    [name.as_bytes(), header, state].iter().for_each(|part| hasher.update(part));
    hasher.finalize()
}

fn four(bytes: &[u8], at: usize) -> u32 {
    let mut number = [0; 4];
    number.copy_from_slice(&bytes[at..at + 4]);
    u32::from_le_bytes(number)
}

fn eight(bytes: &[u8], at: usize) -> u64 {
    let mut number = [0; 8];
    number.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(number)
}

#[cfg(test)]
mod tests {
    use super::super::disk::System;
    use super::super::faults::{Event, Faulty, Kind};
    use super::*;

    fn state(k: u64) -> Vec<u8> {
        format!("state {k} ").repeat(20 + k as usize).into_bytes()
    }

    fn generations(folder: &Path) -> Generations {
        Generations::new(folder, Arc::new(System))
    }

    #[test]
    fn what_was_kept_last_is_found_and_nothing_else_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let kept = generations(folder.path());
        assert_eq!(kept.find("a/B"), Ok(Found::default()));
        for k in 0..5 {
            kept.keep("a/B", &state(k)).unwrap();
            kept.keep("other", &state(100 + k)).unwrap();
            // by the one that wrote it and by one that comes later
            assert_eq!(kept.find("a/B").unwrap().state, Some(state(k)));
            assert_eq!(generations(folder.path()).find("a/B").unwrap().state, Some(state(k)));
        }
        let mut names: Vec<_> =
            fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        assert_eq!(names, ["a%2f%42.1", "a%2f%42.2", "other.1", "other.2"]);
    }

    #[test]
    fn a_torn_or_flipped_file_falls_back_to_the_one_before_and_says_so() {
        let folder = tempfile::tempdir().unwrap();
        (0..4).for_each(|k| generations(folder.path()).keep("a", &state(k)).unwrap());
        // the fourth stands in the second place
        let newest = folder.path().join("a.2");
        let whole = fs::read(&newest).unwrap();
        let mut flipped = whole.clone();
        flipped[40] ^= 1;
        for broken in [&whole[..whole.len() - 1], &whole[..5], &[], &flipped] {
            fs::write(&newest, broken).unwrap();
            let found = generations(folder.path()).find("a").unwrap();
            assert_eq!(found.state, Some(state(2)));
            assert!(found.damaged.len() == 1 && found.damaged[0].contains("a.2 is damaged"), "{:?}", found.damaged);
        }
        // the next one takes the place of the damaged one
        generations(folder.path()).keep("a", &state(9)).unwrap();
        assert_eq!(generations(folder.path()).find("a"), Ok(Found { state: Some(state(9)), damaged: Vec::new() }));
    }

    /// The program dies at the n-th operation of the disk, for every n, in every way.
    #[test]
    fn dying_at_any_operation_leaves_the_last_or_the_next_state() {
        for kind in [Kind::Nothing, Kind::Torn, Kind::Done] {
            for n in 0.. {
                let folder = tempfile::tempdir().unwrap();
                (0..3).for_each(|k| generations(folder.path()).keep("a", &state(k)).unwrap());
                let faulty = Faulty::dies(n, kind);
                let kept = Generations::new(folder.path(), Arc::new(faulty.clone()));
                let ends: Vec<bool> = (3..6).map(|k| kept.keep("a", &state(k)).is_ok()).collect();
                let last = 2 + ends.iter().take_while(|ok| **ok).count() as u64;
                let found = generations(folder.path()).find("a").unwrap();
                let either = [Some(state(last)), Some(state(last + 1))];
                assert!(either.contains(&found.state), "died at operation {n} ({kind:?}), after state {last}");
                assert_eq!(found.damaged, Vec::<String>::new(), "the two generations are never written in place");
                if !faulty.failed() {
                    assert!(n > 6, "all operations were tried");
                    break;
                }
            }
        }
    }

    /// A disk that is full for a moment: one operation fails, the next work again.
    #[test]
    fn one_failure_loses_nothing_and_work_goes_on() {
        for kind in [Kind::Nothing, Kind::Torn, Kind::Done] {
            for n in 0..12 {
                let folder = tempfile::tempdir().unwrap();
                let kept = Generations::new(folder.path(), Arc::new(Faulty::fails_once(n, kind)));
                let mut last = None;
                for k in 0..4 {
                    match kept.keep("a", &state(k)) {
                        Ok(()) => last = Some(state(k)),
                        Err(said) => {
                            assert!(said.ends_with("the disk is full"), "{said}");
                            let found = kept.find("a").unwrap();
                            let either = [last.clone(), Some(state(k))];
                            assert!(found.damaged.is_empty() && either.contains(&found.state), "operation {n}");
                        }
                    }
                }
                assert_eq!(generations(folder.path()).find("a").unwrap().state, Some(state(3)), "operation {n}");
            }
        }
    }

    #[test]
    fn the_bytes_are_on_the_disk_before_the_name_and_the_name_before_the_return() {
        let folder = tempfile::tempdir().unwrap();
        let faulty = Faulty::none();
        Generations::new(folder.path(), Arc::new(faulty.clone())).keep("a", b"1").unwrap();
        let path = |name: &str| folder.path().join(name);
        let wanted = [
            Event::Written(path("a.new")),
            Event::Synced(path("a.new")),
            Event::Renamed(path("a.new"), path("a.1")),
            Event::Settled(folder.path().into()),
        ];
        assert_eq!(faulty.events(), wanted);
    }
}

#[cfg(test)]
mod envelope_tests {
    use super::*;

    #[test]
    fn every_cut_and_every_flipped_bit_is_noticed() {
        let sealed = seal("start-3", 17, b"the state of a fit");
        assert_eq!(open("start-3", &sealed), Ok((17, b"the state of a fit".to_vec())));
        for length in 0..sealed.len() {
            assert!(open("start-3", &sealed[..length]).is_err(), "cut to {length} bytes");
        }
        for bit in 0..8 * sealed.len() {
            let mut flipped = sealed.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(open("start-3", &flipped).is_err(), "bit {bit}");
        }
        assert_eq!(open("start-4", &sealed), Err(Damage::Checksum), "a file that changed its name");
        assert!(open("start-3", &[&sealed[..], b"x"].concat()).is_err(), "a tail");
        assert_eq!(open("", &seal("", 0, b"")), Ok((0, Vec::new())));
    }
}
