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

/// Most bytes of one file in a unit.
const MOST_BYTES: u64 = 1 << 30;

/// The files of a unit: names and contents. Names lead nowhere outside.
///
/// # Errors
/// [`UnitError`] where it is no archive, or packed in another way than stored or deflated.
pub fn unpacked(bytes: &[u8]) -> Result<Files, UnitError> {
    let archive = ZipArchive::from_slice(bytes)?;
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
                reader.take(MOST_BYTES).read_to_end(&mut contents)?;
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
