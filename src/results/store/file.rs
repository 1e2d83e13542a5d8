//! A file that appears whole: written beside its place, brought to the disk, renamed.
//!
//! Files that are read whole because somebody, or another file, has named them: of a kind that ends, and of a size that is read.

use super::disk::{Disk, disk};
use super::temporary;
use fdm_system::record::open_input;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use std::{fs, io};

/// Writes a file whole, in the place of what stands there: a reader finds the one or the other, and so does everybody after an
/// interruption at any moment. A link stays a link, and permissions stay. Devices and pipes are written as they are.
///
/// # Errors
/// Those of the file system; what stood there stands there still then.
pub fn write_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    put(&*disk(), path, bytes, Before::Anything)
}

/// Writes a file whole where nothing stands yet.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`], and as [`write_file`].
pub fn write_new_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    if fs::symlink_metadata(path).is_ok() {
        return Err(io::ErrorKind::AlreadyExists.into());
    }
    put(&*disk(), path, bytes, Before::Nothing)
}

/// Makes a folder, and those that it stands in.
///
/// # Errors
/// Those of the file system.
pub fn make_folder(path: &Path) -> io::Result<()> {
    disk().make_folder(path)
}

/// Whether a file can be written, as far as that shows without writing it.
///
/// # Errors
/// Those of the file system.
pub fn admits(path: &Path) -> io::Result<()> {
    if is_stream(path) {
        return File::options().append(true).open(path).map(drop);
    }
    let (folder, _) = of_file(&end_of_links(path)?)?;
    is_free_to_change(path)?;
    tempfile::tempfile_in(folder).map(drop)
}

/// The time by the clock of the file system of a folder, as a file has it that is made there and gone at once; none where none can be made.
pub fn clock_of(folder: &Path) -> Option<SystemTime> {
    tempfile::tempfile_in(folder).ok()?.metadata().ok()?.modified().ok()
}

/// The file that a path leads to, which need not be there: links are followed.
///
/// # Errors
/// Those of the file system; links that lead back.
pub fn end_of_links(path: &Path) -> io::Result<PathBuf> {
    let mut place = path.to_path_buf();
    // links that lead on to links are followed so often
    for _ in 0..40 {
        match fs::read_link(&place) {
            Ok(next) => place = place.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(place),
        }
    }
    Err(io::Error::other("a link that leads back to itself"))
}

/// What may stand at a place before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Before {
    /// A file that is replaced, or nothing.
    Anything,
    Nothing,
}

fn put(disk: &dyn Disk, path: &Path, bytes: &[u8], before: Before) -> io::Result<()> {
    if is_stream(path) {
        return File::options().write(true).open(path)?.write_all(bytes);
    }
    let place = end_of_links(path)?;
    let (folder, name) = of_file(&place)?;
    is_free_to_change(&place)?;
    temporary::clear(disk, &folder, name);
    let new = temporary::place(&folder, name);
    let written = disk.write(&new, bytes).and_then(|held| {
        if let Ok(about) = fs::metadata(&place) {
            held.set_permissions(about.permissions())?;
        }
        match before {
            Before::Anything => disk.rename(&new, &place),
            Before::Nothing => disk.rename_new(&new, &place),
        }
    });
    if written.is_err() {
        let _ = disk.remove_file(&new);
    }
    written?;
    disk.settle(&folder)
}

/// A device or a pipe: nothing stands there that could be lost. What is open in this program already is one of them.
fn is_stream(path: &Path) -> bool {
    let kind = fs::metadata(path).map(|about| about.file_type());
    kind.is_ok_and(|kind| !kind.is_file() && !kind.is_dir() || path.starts_with("/dev") || path.starts_with("/proc"))
}

/// Folder and name of a file.
fn of_file(place: &Path) -> io::Result<(PathBuf, &OsStr)> {
    let name = place.file_name().filter(|_| !place.is_dir()).ok_or(io::ErrorKind::IsADirectory)?;
    let folder = place.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Ok((folder.into(), name))
}

/// A file that is protected against writing is not replaced either.
fn is_free_to_change(place: &Path) -> io::Result<()> {
    match File::options().append(true).open(place) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        opened => opened.map(drop),
    }
}

/// Most bytes of a text that is read whole: tables, plans and problems. A plan of a million tasks has a tenth of it; larger ones are
/// records, which have a reader of their own.
pub const MOST_BYTES: u64 = 1 << 30;

/// The bytes of an input file ([`open_input`]).
///
/// # Errors
/// As [`open_input`]; for a file of more than [`MOST_BYTES`].
pub fn read_input(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_input(path)?.take(MOST_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(io::Error::other(format!("is larger than the limit of {} MiB", MOST_BYTES >> 20)));
    }
    Ok(bytes)
}

/// The text of an input file ([`read_input`]).
///
/// # Errors
/// As [`read_input`]; for what is not UTF-8.
pub fn read_input_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read_input(path)?).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "is not UTF-8 text"))
}

#[cfg(test)]
mod tests {
    use super::super::disk::System;
    use super::super::faults::{Faulty, Kind};
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn the_file_is_the_old_or_the_new_one_whatever_fails_and_nothing_is_left() {
        for (dies, kind) in [(true, Kind::Nothing), (true, Kind::Torn), (true, Kind::Done), (false, Kind::Nothing)] {
            for n in 0.. {
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join("a.csv");
                fs::write(&path, "old and whole").unwrap();
                let disk = if dies { Faulty::dies(n, kind) } else { Faulty::fails_once(n, kind) };
                let written = put(&disk, &path, b"new and whole", Before::Anything);
                let found = fs::read_to_string(&path).unwrap();
                match written {
                    Ok(()) => assert_eq!(found, "new and whole", "operation {n}"),
                    Err(_) => assert!(found == "old and whole" || found == "new and whole", "operation {n}: {found}"),
                }
                assert!(dies || names(folder.path()) == ["a.csv"], "{:?}", names(folder.path()));
                put(&System, &path, b"third", Before::Anything).unwrap();
                assert_eq!(names(folder.path()), ["a.csv"], "operation {n}");
                if !disk.failed() {
                    assert!(n > 3, "all operations were tried");
                    break;
                }
            }
        }
    }

    #[test]
    fn a_new_file_never_takes_the_place_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        write_new_file(&path, b"one").unwrap();
        assert_eq!(write_new_file(&path, b"two").unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        // one that turned up since it was looked for
        assert_eq!(put(&System, &path, b"two", Before::Nothing).unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!((fs::read_to_string(&path).unwrap().as_str(), names(folder.path()).len()), ("one", 1));
    }

    #[cfg(unix)]
    #[test]
    fn links_permissions_and_devices_stay_what_they_are() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("a.csv"), "old").unwrap();
        fs::set_permissions(at("a.csv"), fs::Permissions::from_mode(0o640)).unwrap();
        symlink("a.csv", at("link")).unwrap();
        symlink("not yet", at("ahead")).unwrap();
        write_file(&at("link"), b"new").unwrap();
        write_file(&at("ahead"), b"new").unwrap();
        assert!(fs::read_link(at("link")).is_ok() && fs::read_link(at("ahead")).is_ok());
        assert_eq!(fs::read_to_string(at("a.csv")).unwrap(), "new");
        assert_eq!(fs::read_to_string(at("not yet")).unwrap(), "new");
        assert_eq!(fs::metadata(at("a.csv")).unwrap().permissions().mode() & 0o777, 0o640);
        write_file(Path::new("/dev/null"), b"gone").unwrap();
        symlink("back", at("forth")).unwrap();
        symlink("forth", at("back")).unwrap();
        assert!(write_file(&at("back"), b"x").is_err());
        assert!(write_file(folder.path(), b"x").is_err());
    }
}

#[cfg(test)]
mod input_tests {
    use super::*;
    use std::fs;

    #[test]
    fn only_what_ends_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        fs::write(&file, "a = 1").unwrap();
        assert_eq!(read_input_text(&file).unwrap(), "a = 1");
        assert!(read_input(folder.path()).unwrap_err().to_string().contains("directory"));
        fs::write(&file, [0xff, 0xfe]).unwrap();
        assert!(read_input_text(&file).unwrap_err().to_string().contains("UTF-8"));
        #[cfg(unix)]
        for device in ["/dev/zero", "/dev/null"] {
            assert!(read_input(Path::new(device)).unwrap_err().to_string().contains("device"), "{device}");
        }
    }
}
