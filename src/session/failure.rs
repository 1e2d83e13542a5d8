//! Why a request comes to nothing.

use fdm_grammar::diagnostic::nearest;
use fdm_results::store::reason;
use fdm_system::ModelError;
use fdm_system::record::RecordError;
use std::fmt::{self, Display};
use std::path::Path;

/// Why a request comes to nothing.
#[derive(Debug)]
pub enum Failure {
    /// A word that the command does not know, in a sentence.
    Words {
        /// What is wrong.
        said: String,
        /// The option that is not known, without dashes; none where it is one.
        unknown: Option<String>,
    },
    /// A model that cannot be read or compiled.
    Model(Box<ModelError>),
    /// Records that cannot be used, each with all its problems.
    Records(Vec<RecordError>),
    /// Anything else that is wrong with the input, one sentence each.
    Input(Vec<String>),
    /// Nothing is wrong with the input, but with the numbers.
    Numbers(String),
    /// Numbers went wrong behind a fit, which is told as far as it came.
    Astray {
        /// What went wrong.
        said: String,
        /// The fit.
        so_far: SoFar,
    },
    /// The work was stopped before there was anything to give.
    Stopped(String),
    /// Something was found in the records, and `--strict` refuses to go on.
    Strict,
    /// Nothing is wrong with the input, but a file could not be written.
    Unwritten(Unwritten),
}

/// A fit as far as it came.
#[derive(Debug)]
pub struct SoFar {
    /// Tables and sentences.
    pub text: String,
    /// The document as JSON, where it is wanted.
    pub json: Option<String>,
    /// What goes to standard error behind the text.
    pub remarks: Vec<String>,
}

/// A file that could not be written, and why.
#[derive(Debug)]
pub struct Unwritten(pub String);

impl Display for Unwritten {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl From<Unwritten> for Failure {
    fn from(e: Unwritten) -> Self {
        Self::Unwritten(e)
    }
}

impl From<ModelError> for Failure {
    fn from(e: ModelError) -> Self {
        Self::Model(Box::new(e))
    }
}

impl Failure {
    /// From things that say what is wrong with the input.
    pub fn input(reasons: impl IntoIterator<Item = impl Display>) -> Self {
        Self::Input(reasons.into_iter().map(|r| r.to_string()).collect())
    }

    /// From a file or folder and what is wrong with it.
    pub fn at(path: &Path, error: &std::io::Error) -> Self {
        Self::Input(vec![at(path, error)])
    }
}

impl Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Model(e) => e.fmt(f),
            Self::Records(errors) => {
                f.write_str(&errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))
            }
            Self::Input(reasons) => f.write_str(&reasons.join("; ")),
            Self::Words { said, .. } | Self::Numbers(said) | Self::Astray { said, .. } | Self::Stopped(said) => {
                f.write_str(said)
            }
            Self::Strict => f.write_str("the records have findings, and --strict refuses to go on"),
            Self::Unwritten(file) => file.fmt(f),
        }
    }
}

/// Errors of the packages below, most of which mean that the input is wrong.
pub trait OrFailure<T> {
    /// The value, or the error as wrong input.
    ///
    /// # Errors
    /// [`Failure::Input`]
    fn or_failure(self) -> Result<T, Failure>;
}

impl<T, E: Display> OrFailure<T> for Result<T, E> {
    fn or_failure(self) -> Result<T, Failure> {
        self.map_err(|e| Failure::input([e]))
    }
}

/// A path and what is wrong with it.
pub fn at(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {}", path.display(), reason(error))
}

/// The name that was probably meant, to stand behind a message; empty when none is near.
pub fn did_you_mean<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    nearest(name, known).map_or(String::new(), |near| format!("; did you mean `{near}`?"))
}

/// A document as JSON.
///
/// # Errors
/// [`Failure::Input`], for keys that are no text.
pub fn as_json(document: &impl serde::Serialize) -> Result<String, Failure> {
    fdm_results::documents::to_text(document).map_err(|e| Failure::input([e]))
}
