//! Why a file is not compared ([`VerifyError`]).

use crate::Stamp;
use fdm_units::UnitError;

/// Why there is no comparison.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// Neither a unit nor source.
    #[error("`{0}` is neither a unit (.fmu) nor source (.c, .rs): of the others the stamp says all")]
    Kind(String),
    /// A unit that cannot be opened.
    #[error(transparent)]
    Unit(#[from] UnitError),
    /// The file is not text.
    #[error("is not UTF-8 text")]
    Text,
    /// Nothing says what the file was made from.
    #[error("has no stamp of fdm: it was not written by `fdm export`, or its last line was taken away")]
    Unstamped,
    /// The file was made from another model, or from other values.
    #[error(
        "was made from another model, or from other values of the parameters: it says {found}, and should say {expected}"
    )]
    Other {
        /// What stands in the file.
        found: Stamp,
        /// That of the model.
        expected: Stamp,
    },
    /// There is no compiler.
    #[error("no compiler `{0}` here: the stamp agrees, and values were not compared")]
    NoCompiler(String),
    /// The compiler refuses.
    #[error("`{compiler}` refuses the file: {said}")]
    Refused {
        /// Its name.
        compiler: String,
        /// Its first words.
        said: String,
    },
    /// An estimator that is none of this model.
    #[error("an estimator whose recursion cannot be repeated: {0}")]
    Estimator(String),
    /// The library cannot be loaded.
    #[error("its library cannot be loaded: {0}")]
    Unloadable(#[from] libloading::Error),
    /// A unit's function failed.
    #[error("`{function}` of the unit ends with status {status}")]
    Status {
        /// The function.
        function: &'static str,
        /// What it gave.
        status: i32,
    },
}
