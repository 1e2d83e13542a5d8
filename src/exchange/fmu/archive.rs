//! A unit as one file: a zip archive with description, library and resources.

use super::description::{description, identifier};
use super::resources::Resources;
use super::variables::{Kind, Variables};
use super::version::Version;
use crate::Stamp;
use fdm_grammar::graph::Signal;
use fdm_system::Model;
use fdm_system::dynamics::Workspace;
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use rawzip::{CompressionMethod, ZipArchive, ZipArchiveWriter};
use std::collections::BTreeMap;
use std::io::{Read, Write};

/// Why there is no unit.
#[derive(Debug, thiserror::Error)]
pub enum FmuError {
    /// Something in the model that the standard has no place for.
    #[error("{0}")]
    Unsuited(String),
    /// The archive cannot be made, or is damaged.
    #[error("the archive: {0}")]
    Archive(#[from] rawzip::Error),
    /// The archive's contents cannot be packed.
    #[error("the archive: {0}")]
    Packed(#[from] std::io::Error),
    /// The resources cannot be written.
    #[error("the resources: {0}")]
    Resources(#[from] serde_json::Error),
}

/// Files: names and contents.
pub type Files = Vec<(String, Vec<u8>)>;

/// What goes into a unit.
#[derive(Debug, Clone, Copy)]
pub struct Contents<'a> {
    /// The model with the values that its parameters are to have.
    pub model: &'a Model,
    /// Version of the standard.
    pub version: Version,
    /// The library `fdm-fmu` of this machine's kind.
    pub library: &'a [u8],
    /// Standard errors of parameters, by name; they are told in the descriptions.
    pub errors: &'a BTreeMap<String, f64>,
}

/// A unit as the bytes of one file; the same bytes for the same contents.
///
/// # Errors
/// [`FmuError::Unsuited`] where a value is not finite or a delay is negative; [`FmuError::Archive`].
pub fn write(contents: &Contents<'_>) -> Result<Vec<u8>, FmuError> {
    let Contents { model, version, library, .. } = *contents;
    suited(model)?;
    let resources = Resources::of(model);
    let mut files = Files::new();
    files.push((DESCRIPTION.into(), description(contents, &Stamp::of(model)).into_bytes()));
    files.push((library_path(version, model), library.to_vec()));
    for (name, text) in resources.files()? {
        files.push((format!("resources/{name}"), text.into_bytes()));
    }
    packed(&files)
}

/// Where a unit of a model has its library for this kind of machine.
pub(crate) fn library_path(version: Version, model: &Model) -> String {
    format!("binaries/{}/{}.{ENDING}", folder(version), identifier(model))
}

/// The description's name.
pub(crate) const DESCRIPTION: &str = "modelDescription.xml";

/// The ending of libraries.
const ENDING: &str = if cfg!(windows) {
    "dll"
} else if cfg!(target_os = "macos") {
    "dylib"
} else {
    "so"
};

/// The folder of libraries for this kind of machine, as the standard calls it.
fn folder(version: Version) -> String {
    let system = if cfg!(windows) {
        ("win", "windows")
    } else if cfg!(target_os = "macos") {
        ("darwin", "darwin")
    } else {
        ("linux", "linux")
    };
    match version {
        Version::Two => format!("{}{}", system.0, usize::BITS),
        Version::Three => format!("{}-{}", std::env::consts::ARCH, system.1),
    }
}

/// Refuses what a unit could not compute.
fn suited(model: &Model) -> Result<(), FmuError> {
    if model.definition().has_events() {
        let said = "the model has events (`when`), which units do not hold yet; `limit x in [a, b];` they do";
        return Err(FmuError::Unsuited(said.into()));
    }
    let variables = Variables::of(model);
    let infinite = variables.list.iter().find(|v| v.start.is_some_and(|s| !s.is_finite()));
    if let Some(variable) = infinite {
        let said = format!("`{}` has no finite value; give one with --set {}=VALUE", variable.name, variable.name);
        return Err(FmuError::Unsuited(said));
    }
    let (layout, dynamics) = (model.layout(), model.dynamics());
    let mut known = vec![0.0; layout.known];
    dynamics.prepare(&model.definition().start(), &mut known, &mut Workspace::new(dynamics));
    for (tau, signal) in known[layout.tau.clone()].iter().zip(&layout.delayed) {
        if *tau < 0.0 {
            let signal = match *signal {
                Signal::Input(k) => variables.of_kind(Kind::Input(k as usize)),
                Signal::State(k) => variables.of_kind(Kind::State(k as usize)),
            };
            let name = signal.and_then(|s| variables.get(s)).map_or("", |v| &v.name);
            return Err(FmuError::Unsuited(format!(
                "the delay of `{name}` is {tau}: a unit cannot look ahead; shift the record, or give a delay of 0 or more with --set"
            )));
        }
    }
    Ok(())
}

/// Larger libraries hold debug information, and are stored: packing them would take longer than they are kept.
const MOST_PACKED: usize = 32 << 20;

fn packed(files: &Files) -> Result<Vec<u8>, FmuError> {
    let mut archive = ZipArchiveWriter::new(Vec::new());
    for (name, bytes) in files {
        // the description's stamp is to stand in the first bytes of the file
        if name == DESCRIPTION || bytes.len() > MOST_PACKED {
            let (mut entry, config) = archive.new_file(name.as_str()).start()?;
            let mut data = config.wrap(&mut entry);
            data.write_all(bytes)?;
            let (_, described) = data.finish()?;
            entry.finish(described)?;
            continue;
        }
        let (mut entry, config) =
            archive.new_file(name.as_str()).compression_method(CompressionMethod::DEFLATE).start()?;
        let mut data = config.wrap(DeflateEncoder::new(&mut entry, Compression::default()));
        data.write_all(bytes)?;
        let (encoder, described) = data.finish()?;
        encoder.finish()?;
        entry.finish(described)?;
    }
    Ok(archive.finish()?)
}

/// Most bytes of one file in a unit.
const MOST_BYTES: u64 = 1 << 30;

/// The files of a unit: names and contents.
pub(crate) fn unpacked(bytes: &[u8]) -> Result<Files, FmuError> {
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
                return Err(FmuError::Unsuited(format!(
                    "`{name}` in the archive is packed in another way than stored or deflated"
                )));
            }
        }
        files.push((name, contents));
    }
    Ok(files)
}
