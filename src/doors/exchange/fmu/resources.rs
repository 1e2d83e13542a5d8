//! What a unit's library reads in its folder `resources`: the model's text, the texts that it uses, and the values of its parameters.

use fdm_grammar::Groups;
use fdm_system::{Model, ModelError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The model's own text, in the folder `resources`.
pub(super) const TEXT: &str = "model.fdm";
/// Everything else, beside it.
pub(super) const REST: &str = "model.json";
/// Longer files are none of ours.
const MOST_BYTES: u64 = 256 << 20;

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
            stamp: crate::Stamp::of(model).to_string(),
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
                Ok(length) if length > MOST_BYTES => Err("is too long".to_string()),
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
        if crate::Stamp::of(&model).to_string() == self.stamp { Ok(model) } else { Err(ResourcesError::Changed) }
    }
}
