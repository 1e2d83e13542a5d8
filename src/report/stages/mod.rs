//! What becomes of a model's text, stage by stage: `fdm show`.
//!
//! **In** a compiled [`Model`]. **Out** [`Shown`]: text for people, and the same for programs. **Never** the numbers of a
//! simulation or a fit. **Start** at [`stage`].

mod code;
mod derivatives;
mod graph;
mod linear;
mod names;
mod schedule;
mod syntax;

use fdm_results::documents::stages::StageDocument;
use fdm_system::Model;

/// The road from text to numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The tree of the text, in normal form.
    Syntax,
    /// What every name is, and the equations.
    Model,
    /// The nodes that the equations share.
    Graph,
    /// Every partial that is not zero.
    Derivatives,
    /// The programs.
    Schedule,
    /// The machine code.
    Code,
    /// The linear model at the trim.
    Linear,
}

/// A stage as text and as a document.
#[derive(Debug, Clone, PartialEq)]
pub struct Shown {
    /// For people.
    pub text: String,
    /// For programs.
    pub document: StageDocument,
}

impl Shown {
    /// The document as JSON in one line.
    ///
    /// # Errors
    /// What the writer of JSON says.
    pub fn json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string(&self.document)
    }
}

/// A stage of a model.
///
/// # Errors
/// A sentence when there is no trim at which the model could be linearised, or no machine code on this machine.
pub fn stage(model: &Model, stage: Stage) -> Result<Shown, String> {
    match stage {
        Stage::Syntax => Ok(syntax::syntax(model)),
        Stage::Model => Ok(names::names(model)),
        Stage::Graph => Ok(graph::graph(model)),
        Stage::Derivatives => Ok(derivatives::derivatives(model)),
        Stage::Schedule => Ok(schedule::schedule(model)),
        Stage::Code => code::code(model),
        Stage::Linear => linear::linear(model),
    }
}

pub use graph::dot;
