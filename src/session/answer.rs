//! What a verb worked out: nothing has to be computed any more to print and to write it.

use crate::failure::{Failure, as_json};
use serde::{Deserialize, Serialize};

/// A file: its name and its contents.
pub type NamedFile = (String, Vec<u8>);

/// What is wanted of an answer beside its text.
#[derive(Debug, Clone, Copy, Default)]
pub struct Wanted {
    /// The document as JSON.
    pub json: bool,
    /// The files of its folder, or of its page.
    pub files: bool,
    /// A folder with its files.
    pub folder: bool,
    /// Its drawing.
    pub plot: bool,
    /// A text with every remark.
    pub verbose: bool,
}

/// What a verb worked out, for people, for programs, and as files.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Tables and sentences.
    pub text: String,
    /// The document as JSON, where it is wanted.
    pub json: Option<String>,
    /// What goes to standard error behind the text.
    pub remarks: Vec<String>,
    /// What is said at the very end, of the work and not of its result.
    pub closing: Vec<String>,
    /// The drawing, where it is wanted.
    pub plot: Option<String>,
    /// The files of the folder, and others that the verb makes, where they are wanted.
    pub files: Vec<NamedFile>,
    /// Whether all is well: the command ends with 0.
    pub good: bool,
}

impl Answer {
    /// A text and its document.
    ///
    /// # Errors
    /// [`Failure::Input`], for a document whose keys are no text.
    pub fn of(text: String, document: &impl Serialize, wanted: Wanted) -> Result<Self, Failure> {
        let json = wanted.json.then(|| as_json(document)).transpose()?;
        Ok(Self { text, json, good: true, ..Self::default() })
    }

    /// The file of this name.
    pub fn file(&self, name: &str) -> Option<&[u8]> {
        self.files.iter().find(|(own, _)| own == name).map(|(_, content)| content.as_slice())
    }
}
