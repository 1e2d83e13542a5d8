//! Programs as source text: stand-alone C and Rust that computes what the tape computes, to the bit.
//!
//! **In** a checked [`Model`] and its [`Schedule`]. **Out** [`stand_alone`]: one source file without any dependency on this
//! project; and [`statements`], the lines of one program, which `model!` prints too. **Never** an operation that a compiler
//! could round otherwise: no contraction, no reordering, our own minimum, maximum and sign; the elementary functions are
//! bound by whoever compiles. **Start** at [`stand_alone`].
//!
//! Long programs are cut into functions of bounded length, which hand over what they share in one array, so that the
//! time that a compiler needs stays in proportion to the model.

mod c;
mod entry;
mod notation;
mod rust;
mod tables;
#[cfg(test)]
mod tests;

pub use notation::{Notation, RustNotation, statements};

use crate::model::Model;
use crate::schedule::{Program, Schedule};

/// What is printed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Language {
    /// C99. Elementary functions are `fdm_sin`, `fdm_cos`, ..., by default those of `<math.h>`; whoever compiles may bind them to others.
    C,
    /// Rust, one module.
    Rust(Elementary),
}

/// Where generated Rust finds `sin`, `exp` and the like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Elementary {
    /// A crate or module with functions `sin(f64) -> f64`, ...: `libm` gives the bits of this project.
    Path(String),
    /// The methods of `f64`, as the system's C library computes them.
    Std,
}

/// A program that would need more stack than any thread has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong {
    /// Numbers that wait at the same time.
    pub places: u32,
}

impl std::fmt::Display for TooLong {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "a function of this model would hold {} numbers at a time, more than the {} that are put on a stack",
            self.places,
            entry::MOST_PLACES
        )
    }
}

impl std::error::Error for TooLong {}

/// Why a model does not become a source file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EmitError {
    /// A function would need too much stack.
    TooLong(TooLong),
    /// Events belong to an integrator, which the file does not hold.
    Events,
}

impl From<TooLong> for EmitError {
    fn from(e: TooLong) -> Self {
        Self::TooLong(e)
    }
}

impl std::fmt::Display for EmitError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooLong(e) => e.fmt(f),
            Self::Events => f.write_str(
                "the model has events (`when`), and a source file holds equations only: leave them out of the text",
            ),
        }
    }
}

impl std::error::Error for EmitError {}

/// A source file that computes initial values, delays, rates, outputs, all their partials, and the right side of the sensitivity
/// equations, with the names, units, start values and bounds of the model as tables.
///
/// # Errors
/// [`EmitError::TooLong`] when a function would need more than half a mebibyte of stack, [`EmitError::Events`].
pub fn stand_alone(model: &Model, schedule: &Schedule, language: &Language) -> Result<String, EmitError> {
    if model.has_events() {
        return Err(EmitError::Events);
    }
    Ok(match language {
        Language::C => c::file(model, schedule)?,
        Language::Rust(elementary) => rust::file(model, schedule, elementary)?,
    })
}

/// A name as generated C has it: ASCII letters, digits and `_`, beginning with a letter.
pub fn c_name(name: &str) -> String {
    notation::plain(name)
}

/// A number as C: the same bits come back.
pub fn c_number(value: f64) -> String {
    notation::CNotation { own: "" }.number(value)
}

/// Text as it may stand inside a comment of C.
pub fn c_comment(text: &str) -> String {
    notation::comment(text)
}

/// One program of a schedule as a static function of C99, `void PREFIXname(double t, const double *x, const double *drive,
/// const double *known, double *column)`, in front of it the checks of the compiler and all that it calls.
///
/// # Errors
/// [`TooLong`] when it would need more than half a mebibyte of stack.
pub fn c_function(prefix: &str, name: &'static str, program: &Program) -> Result<String, TooLong> {
    c::program(prefix, name, program)
}
