//! A unit's file: a zip archive with a description, libraries and resources.

use flate2::read::DeflateDecoder;
use rawzip::{CompressionMethod, ZipArchive};
use std::io::Read;

/// A version of the Functional Mock-up Interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// FMI 2.0
    Two,
    /// FMI 3.0
    Three,
}

/// Why a unit cannot be a part of a model.
#[derive(Debug, thiserror::Error)]
pub enum UnitError {
    /// It is no zip archive, or a damaged one.
    #[error("the archive: {0}")]
    Archive(#[from] rawzip::Error),
    /// Its contents are packed wrongly.
    #[error("the archive: {0}")]
    Packed(#[from] std::io::Error),
    /// Its description is no XML.
    #[error("its {DESCRIPTION}: {0}")]
    Xml(#[from] roxmltree::Error),
    /// It is something that no model can have as a part.
    #[error("{0}")]
    Unsuited(String),
}

/// Files: names and contents.
pub type Files = Vec<(String, Vec<u8>)>;

/// The description's name.
pub const DESCRIPTION: &str = "modelDescription.xml";

/// The folder of libraries for this kind of machine, as the standard calls it.
pub fn library_folder(version: Version) -> String {
    let system = if cfg!(windows) {
        ("win", "windows")
    } else if cfg!(target_os = "macos") {
        ("darwin", "darwin")
    } else {
        ("linux", "linux")
    };
    match version {
        Version::Two => format!("binaries/{}{}", system.0, usize::BITS),
        Version::Three => format!("binaries/{}-{}", std::env::consts::ARCH, system.1),
    }
}

/// Where a unit has its library for this kind of machine.
pub fn library_name(version: Version, identifier: &str) -> String {
    let ending = if cfg!(windows) {
        "dll"
    } else if cfg!(target_os = "macos") {
        "dylib"
    } else {
        "so"
    };
    format!("{}/{identifier}.{ending}", library_folder(version))
}

/// Most bytes of all files in a unit together.
const MOST_BYTES: u64 = 1 << 30;
/// Most bytes that one deflated byte becomes: two bits for a match of 258 bytes (RFC 1951).
const DENSEST: u64 = 1032;
/// Refuses an archive whose files share bytes, or become more than [`MOST_BYTES`]: before anything is unpacked.
fn refuse_dense(bytes: &[u8], archive: &rawzip::ZipSliceArchive<&[u8]>) -> Result<(), UnitError> {
    let (mut packed, mut size) = (0_u64, 0_u64);
    for entry in archive.entries() {
        let entry = entry?;
        packed = packed.saturating_add(entry.compressed_size_hint());
        size = size.saturating_add(entry.uncompressed_size_hint());
    }
    let unsuited = |said: String| Err(UnitError::Unsuited(said));
    if packed > bytes.len() as u64 {
        return unsuited(format!(
            "the files in the archive have {packed} bytes packed, and it has {}: they share them",
            bytes.len()
        ));
    }
    if size > MOST_BYTES || size > packed.saturating_mul(DENSEST) {
        return unsuited(format!(
            "the files in the archive are said to become {size} bytes, beyond the limit of {} MiB or of what {packed} packed bytes become",
            MOST_BYTES >> 20
        ));
    }
    Ok(())
}

/// The files of a unit: names and contents. Names lead nowhere outside.
///
/// # Errors
/// [`UnitError`] where it is no archive, or packed in another way than stored or deflated.
pub fn unpacked(bytes: &[u8]) -> Result<Files, UnitError> {
    let archive = ZipArchive::from_slice(bytes)?;
    refuse_dense(bytes, &archive)?;
    let mut files = Files::new();
    for entry in archive.entries() {
        let entry = entry?;
        if entry.is_dir() {
            continue;
        }
        let name = entry.file_path().try_normalize()?.as_ref().to_string();
        let (method, place) = (entry.compression_method(), archive.get_entry(entry.wayfinder())?);
        let mut contents = Vec::new();
        match method {
            CompressionMethod::STORE => contents.extend_from_slice(place.data()),
            CompressionMethod::DEFLATE => {
                let reader = place.verifying_reader(DeflateDecoder::new(place.data()));
                // not more than its directory says, which was summed
                reader.take(entry.uncompressed_size_hint() + 1).read_to_end(&mut contents)?;
            }
            _ => {
                return Err(UnitError::Unsuited(format!(
                    "`{name}` in the archive is packed in another way than stored or deflated"
                )));
            }
        }
        files.push((name, contents));
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A zip of stored entries `name`, all of the same stream of `data`, each said to become `size` bytes.
    fn zip(names: &[&str], data: &[u8], size: u32) -> Vec<u8> {
        let (mut bytes, mut directory) = (Vec::new(), Vec::new());
        let head = |name: &str| {
            let mut head = vec![20, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0];
            head.extend((data.len() as u32).to_le_bytes());
            head.extend(size.to_le_bytes());
            head.extend((name.len() as u16).to_le_bytes());
            head.extend([0, 0]);
            head
        };
        bytes.extend(b"PK\x03\x04");
        bytes.extend(head(names[0]));
        bytes.extend(names[0].bytes());
        bytes.extend(data);
        for name in names {
            directory.extend(b"PK\x01\x02\x14\0");
            directory.extend(head(name));
            directory.extend([0; 14]);
            directory.extend(name.bytes());
        }
        let (at, count) = (bytes.len() as u32, names.len() as u16);
        let length = directory.len() as u32;
        bytes.extend(directory);
        bytes.extend(b"PK\x05\x06\0\0\0\0");
        bytes.extend([count.to_le_bytes(), count.to_le_bytes()].concat());
        bytes.extend(length.to_le_bytes());
        bytes.extend(at.to_le_bytes());
        bytes.extend([0, 0]);
        bytes
    }

    #[test]
    fn archives_are_summed_before_anything_is_unpacked() {
        let said = |bytes: &[u8]| unpacked(bytes).unwrap_err().to_string();
        let names: Vec<String> = (0..100).map(|k| format!("resources/{k}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        assert!(said(&zip(&names, &vec![1; 50_000], 50_000)).contains("share"));
        assert!(said(&zip(&["a"], &vec![1; 5_000], 1 << 31)).contains("beyond the limit"));
        assert!(said(&zip(&["a"], &[1; 50], 60_000)).contains("beyond the limit"));
    }
}
