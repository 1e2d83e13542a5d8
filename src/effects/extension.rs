//! A model with an effect in it: the user's text with the new lines in their place, and what they brought.

use super::null::{self, Null};
use fdm_grammar::diagnostic::Diagnostic;
use fdm_grammar::model::Model;
use fdm_grammar::source::Source;
use fdm_grammar::syntax::{StatementKind, SyntaxTree, parse};
use fdm_grammar::unit::Unit;
use fdm_grammar::{Compiled, compile_tree, examine_tree};

/// A parameter that an effect brings.
#[derive(Debug, Clone)]
pub struct NewParam {
    /// Its name in the extended model.
    pub name: String,
    /// Its name in the effect.
    pub local: String,
    /// What it is.
    pub doc: String,
    /// Its unit, when it follows from the model's.
    pub unit: Option<Unit>,
    /// The value at which the effect vanishes, which may be infinite; a nuisance has none: its first trial stands here.
    pub null: f64,
    /// The value in the extended text.
    pub start: f64,
    /// Bounds; infinite where there are none.
    pub lower: f64,
    /// See `lower`.
    pub upper: f64,
    /// The values to try, in the effect's order; empty for a param whose size is left free.
    pub trials: Vec<f64>,
    /// Physics has it at its null or above: a fit that wants it below is told, and is no cause.
    pub positive: bool,
    /// The data cannot see it at the null.
    pub nuisance: bool,
    /// Stays as it is when the extended model is fitted.
    pub fixed: bool,
    /// A value of its own in every run.
    pub per_run: bool,
    /// The first value of a state that follows this signal: a fit begins with what each run recorded first.
    pub begins_as: Option<String>,
}

/// A model's text with an effect in it.
#[derive(Debug, Clone)]
pub struct Extension {
    pub(super) source: Source,
    pub(super) params: Vec<NewParam>,
    pub(super) declared: Vec<String>,
    pub(super) base: Model,
}

impl Extension {
    /// The user's text with the new lines in their place; everything else is as it was, to the byte.
    pub fn text(&self) -> &str {
        self.source.text()
    }

    /// The text under the name of the model's file.
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// The new parameters, in the order of the effect.
    pub fn params(&self) -> &[NewParam] {
        &self.params
    }

    /// The tree of the text with all new declarations behind the old ones, so that parameters and states of the base model
    /// keep their numbers.
    ///
    /// # Errors
    /// Mistakes of the new text, which the effect made.
    pub fn tree(&self) -> Result<SyntaxTree, Vec<Diagnostic>> {
        let mut tree = parse(&self.source)?;
        let new = |kind: &StatementKind| match kind {
            StatementKind::Declare(_, list) => list.iter().all(|d| self.declared.contains(&d.name.text)),
            _ => false,
        };
        tree.statements.sort_by_key(|s| new(&s.kind));
        Ok(tree)
    }

    /// Compiles the tree: the model for screening.
    ///
    /// # Errors
    /// Why the effect does not fit this model, with places in [`Extension::source`].
    pub fn compile(&self) -> Result<Compiled, Vec<Diagnostic>> {
        compile_tree(&self.source, self.tree()?, Vec::new())
    }

    /// The checked model of the tree without programs, for those who choose what is differentiated.
    ///
    /// # Errors
    /// As [`Extension::compile`].
    pub fn model(&self) -> Result<Model, Vec<Diagnostic>> {
        let (loose, _) = examine_tree(&self.source, self.tree()?, Vec::new())?;
        Ok(loose.tied(&[]))
    }

    /// How the effect vanishes at its null values: the extended model compared with the base model, at random points.
    pub fn null(&self, extended: &Model) -> Null {
        null::judge(&self.base, extended, &self.params)
    }
}
