//! A unit as one file: a zip archive with description, library and resources.

use super::description::{description, identifier};
use super::resources::Resources;
use super::variables::{Kind, Variables};
use crate::Stamp;
use fdm_grammar::graph::Signal;
use fdm_system::Model;
use fdm_system::dynamics::Workspace;
use fdm_units::{DESCRIPTION, Files, Version, library_name};
use flate2::Compression;
use flate2::write::DeflateEncoder;
use rawzip::{CompressionMethod, ZipArchiveWriter};
use std::collections::BTreeMap;
use std::io::Write;

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
    library_name(version, &identifier(model))
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
