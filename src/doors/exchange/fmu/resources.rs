//! What a unit's library reads in its folder `resources`: the model's text, the texts that it uses, and the values of its parameters.
//!
//! A unit as one file: a zip archive with description, library and resources.

use super::description::{description, identifier};
use super::variables::{Kind, Variables};
use crate::Stamp;
use fdm_grammar::Groups;
use fdm_grammar::graph::Signal;
use fdm_system::dynamics::Workspace;
use fdm_system::{Model, ModelError};
use fdm_units::{DESCRIPTION, Files, Version, library_name};
use flate2::Compression;
use flate2::write::DeflateEncoder;
use rawzip::{CompressionMethod, ZipArchiveWriter};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The model's own text, in the folder `resources`.
pub(super) const TEXT: &str = "model.fdm";
/// Everything else, beside it.
pub(super) const REST: &str = "model.json";

/// A model as a unit keeps it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Resources {
    /// The program that wrote it.
    pub fdm: String,
    /// Texts of the files that the model uses, in the order in which they are asked for.
    pub used: Vec<String>,
    /// Groups of runs that parameters are shared within.
    pub groups: Groups,
    /// Names of the parameters whose ties are off.
    pub untied: Vec<String>,
    /// Values of the parameters.
    pub values: BTreeMap<String, f64>,
    /// Checks the texts and values.
    pub stamp: String,
    /// The model's own text, which stands in a file of its own.
    #[serde(skip)]
    pub text: String,
}

/// Why a unit's model cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ResourcesError {
    /// A file is missing, or cannot be read.
    #[error("{}: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
    },
    /// The text is refused: it was changed, or another version of fdm wrote it.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Text or values are not those that were written.
    #[error("text or values were changed since the unit was written: write it anew with `fdm export`")]
    Changed,
}

impl Resources {
    /// Of a model with the values that its parameters have.
    pub fn of(model: &Model) -> Self {
        let texts = model.source().texts();
        let params = model.definition().params.iter().filter(|p| !p.is_recorded());
        Self {
            fdm: env!("CARGO_PKG_VERSION").into(),
            used: texts.iter().skip(1).map(|t| t.text().to_string()).collect(),
            groups: model.source().groups().clone(),
            untied: model.open_ties(),
            values: params.map(|p| (p.quantity.name.clone(), p.value)).collect(),
            stamp: Stamp::of(model).to_string(),
            text: model.source().text().to_string(),
        }
    }

    /// Reads a unit's folder `resources`.
    ///
    /// # Errors
    /// [`ResourcesError::Unreadable`].
    pub fn read(folder: &Path) -> Result<Self, ResourcesError> {
        let read = |name: &str| {
            let path = folder.join(name);
            let length = std::fs::metadata(&path).map(|m| m.len());
            let text = match length {
                // longer files are none of ours
                Ok(length) if length > (256 << 20) => Err("is too long".to_string()),
                _ => std::fs::read_to_string(&path).map_err(|e| e.to_string()),
            };
            text.map_err(|reason| ResourcesError::Unreadable { path, reason })
        };
        let (text, rest) = (read(TEXT)?, read(REST)?);
        let unreadable =
            |e: serde_json::Error| ResourcesError::Unreadable { path: folder.join(REST), reason: e.to_string() };
        let found: Self = serde_json::from_str(&rest).map_err(unreadable)?;
        Ok(Self { text, ..found })
    }

    /// As files: name and contents.
    pub(super) fn files(&self) -> serde_json::Result<[(&'static str, String); 2]> {
        Ok([(TEXT, self.text.clone()), (REST, serde_json::to_string_pretty(self)?)])
    }

    /// The model with its values.
    ///
    /// # Errors
    /// [`ResourcesError::Model`], [`ResourcesError::Changed`].
    pub fn model(&self) -> Result<Model, ResourcesError> {
        let model = Model::from_texts(TEXT, &self.text, &self.used)?.grouped(self.groups.clone())?;
        let model = model.untied(&self.untied).map_err(|_| ResourcesError::Changed)?;
        let mut params = model.definition().params.clone();
        for param in params.iter_mut().filter(|p| !p.is_recorded()) {
            param.value = *self.values.get(&param.quantity.name).ok_or(ResourcesError::Changed)?;
        }
        let model = model.with_params(params);
        if Stamp::of(&model).to_string() == self.stamp { Ok(model) } else { Err(ResourcesError::Changed) }
    }
}

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

fn packed(files: &Files) -> Result<Vec<u8>, FmuError> {
    let mut archive = ZipArchiveWriter::new(Vec::new());
    for (name, bytes) in files {
        // the description's stamp is to stand in the first bytes of the file
        // larger libraries hold debug information, and are stored: packing them would take longer than they are kept
        if name == DESCRIPTION || bytes.len() > (32 << 20) {
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
