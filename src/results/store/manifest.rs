//! What a result was made from, and what its folder holds.

use super::identity::Identity;
use super::identity::fingerprint;
use fdm_estimate::Noise;
use fdm_grammar::Groups;
use fdm_system::record::ReadOptions;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The file that holds it.
pub(super) const NAME: &str = "manifest.json";
/// Says that a folder is one of ours.
const KIND: &str = "fdm result";
/// Says that a folder is a diagnosis of ours.
const DIAGNOSIS: &str = "fdm diagnosis";
/// Changes when another program could not read a folder any more.
pub(super) const FORMAT: u32 = 2;

/// What a result was made from, and what its folder holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    kind: String,
    format: u32,
    /// Version of the program.
    pub fdm: String,
    /// The command line, as it was typed.
    pub command: Vec<String>,
    /// Name of the model, as it names itself.
    pub model: String,
    /// The file that it was read from; its text is in the folder.
    pub model_file: String,
    /// Params whose ties were switched off.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub untied: Vec<String>,
    /// The groups of the runs, by the name of the grouping.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub groups: Groups,
    /// The runs.
    pub data: Vec<DataFile>,
    /// How their files were read.
    pub reading: ReadOptions,
    /// Seed of everything random.
    pub seed: Option<u64>,
    /// What was assumed about the measurement noise.
    pub noise: Noise,
    /// Everything that the bits of the result depend on: program, model, data, options.
    pub identity: Identity,
    /// The files of the folder, this one left out.
    pub files: Vec<KeptFile>,
    /// SHA-256 of this text with nothing between these quotes.
    sha256: String,
}

/// What a folder says of itself, as far as any version of the program can read it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Claim {
    /// The files that the program wrote, the manifest left out.
    pub(super) files: Vec<KeptFile>,
    /// The files of the records that it was made from.
    pub(super) data: Vec<PathBuf>,
    /// Whether nobody has changed it since it was written, as far as this version knows.
    pub(super) is_whole: bool,
}

/// A recorded run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DataFile {
    /// Name of the run.
    pub run: String,
    /// The file, as it was typed.
    pub file: String,
    /// The file's path from the root of the file system.
    pub path: Option<String>,
    /// Its size in bytes; none for what is not a file, such as a pipe.
    pub bytes: Option<u64>,
    /// Its SHA-256; none for what is not a file.
    pub sha256: Option<String>,
    /// How it was read, where that differs from the other runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reading: Option<ReadOptions>,
}

/// A file of the folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptFile {
    /// Its name.
    pub name: String,
    /// Its size.
    pub bytes: u64,
    /// Its SHA-256.
    pub sha256: String,
}

impl DataFile {
    /// A run and the file that it was read from.
    pub fn new(run: &str, file: &Path) -> Self {
        // a pipe is empty by now, and reading it again could wait for ever
        let content = fs::metadata(file).ok().filter(fs::Metadata::is_file).and_then(|_| fs::read(file).ok());
        Self {
            run: run.into(),
            file: file.display().to_string(),
            path: fs::canonicalize(file).ok().map(|p| p.display().to_string()),
            bytes: content.as_ref().map(|c| c.len() as u64),
            sha256: content.as_ref().map(|c| fingerprint(c)),
            reading: None,
        }
    }

    /// Whether `other` has the same content, as far as that is known.
    pub fn is_same(&self, other: &Self) -> bool {
        self.sha256.is_some() && self.sha256 == other.sha256
    }
}

impl KeptFile {
    pub(super) fn new(name: &str, content: &[u8]) -> Self {
        Self { name: name.into(), bytes: content.len() as u64, sha256: fingerprint(content) }
    }
}

impl Manifest {
    /// A manifest without files yet.
    pub fn new(model: &fdm_system::Model, identity: Identity, noise: Noise) -> Self {
        Self {
            kind: KIND.into(),
            format: FORMAT,
            fdm: env!("CARGO_PKG_VERSION").into(),
            command: Vec::new(),
            model: model.name().into(),
            model_file: model.source().name().into(),
            untied: model.open_ties(),
            groups: model.source().groups().clone(),
            data: Vec::new(),
            reading: ReadOptions::default(),
            seed: None,
            noise,
            identity,
            files: Vec::new(),
            sha256: String::new(),
        }
    }

    /// The manifest of a diagnosis.
    pub fn of_diagnosis(model: &fdm_system::Model, identity: Identity, noise: Noise) -> Self {
        Self { kind: DIAGNOSIS.into(), ..Self::new(model, identity, noise) }
    }

    /// With these files in its list, as the last of them.
    ///
    /// # Errors
    /// When it has no text.
    pub fn sealed(mut self, mut files: Vec<(String, Vec<u8>)>) -> Result<Vec<(String, Vec<u8>)>, serde_json::Error> {
        self.files = files.iter().map(|(name, content)| KeptFile::new(name, content)).collect();
        files.push((NAME.into(), self.text()?.into_bytes()));
        Ok(files)
    }

    /// The text of the file, which says when it was changed.
    pub(super) fn text(&self) -> Result<String, serde_json::Error> {
        let mut sealed = Self { sha256: String::new(), ..self.clone() };
        sealed.sha256 = fingerprint(serde_json::to_string_pretty(&sealed)?.as_bytes());
        Ok(serde_json::to_string_pretty(&sealed)? + "\n")
    }

    /// Whether nothing was changed since it was written.
    pub(super) fn is_whole(&self, text: &str) -> bool {
        self.text().is_ok_and(|own| own == text)
    }

    /// Reads the format of any result of ours, whatever its version; none when it is not one.
    pub(super) fn format(text: &str) -> Option<u32> {
        Self::format_of(text, &[KIND])
    }

    /// What the manifest of a folder claims, be it of a result or of a diagnosis; none when it is none of ours.
    pub(super) fn claim(text: &str) -> Option<Claim> {
        #[derive(Deserialize)]
        struct Data {
            path: Option<PathBuf>,
        }
        #[derive(Deserialize)]
        struct Lists {
            #[serde(default)]
            files: Vec<KeptFile>,
            #[serde(default)]
            data: Vec<Data>,
        }
        let newer = Self::any_format(text)? > FORMAT;
        let Lists { files, data } = serde_json::from_str(text).ok()?;
        let is_whole = newer || serde_json::from_str::<Self>(text).is_ok_and(|own| own.is_whole(text));
        Some(Claim { files, data: data.into_iter().filter_map(|d| d.path).collect(), is_whole })
    }

    /// The format of a manifest of a result or a diagnosis.
    pub(super) fn any_format(text: &str) -> Option<u32> {
        Self::format_of(text, &[KIND, DIAGNOSIS])
    }

    fn format_of(text: &str, kinds: &[&str]) -> Option<u32> {
        #[derive(Deserialize)]
        struct Head {
            kind: String,
            format: u32,
        }
        let head: Head = serde_json::from_str(text).ok()?;
        kinds.contains(&head.kind.as_str()).then_some(head.format)
    }
}
