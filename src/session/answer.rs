//! What a verb worked out: nothing has to be computed any more to print and to write it.

use crate::checkpoint::OpenCheckpoint;
use crate::conduct::Conduct;
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

    /// With what is said where there was too little time.
    pub(crate) fn in_time(self, conduct: &Conduct) -> Self {
        self.closed(OpenCheckpoint::None, conduct, "the result is the best so far")
    }

    /// With what is said where it was interrupted.
    pub(crate) fn uninterrupted(mut self, conduct: &Conduct) -> Self {
        if conduct.progress.halt().is_interrupted() {
            self.closing.push("interrupted: the result is the best so far".into());
            self.good = false;
        }
        self
    }

    /// With what is said of the checkpoint and of the time, where `late` is what it means for the result that there was too little of it.
    pub(crate) fn closed(mut self, checkpoint: OpenCheckpoint, conduct: &Conduct, late: &str) -> Self {
        self.good &= checkpoint.close(&mut self.closing);
        let late = conduct.progress.halt().late(late);
        self.good &= late.is_none();
        self.closing.extend(late);
        self
    }
}
