//! The fdm language and its mathematics: text to checked model to exact derivatives to straight-line programs.
//!
//! **In** the text of a model. **Out** [`compile`]: a [`Model`] and its [`Schedule`], or [`Diagnostic`]s.
//! **Never** files, data or matrices. **Start** at [`compile`]; it is the whole road.

pub mod carried;
pub mod check;
pub mod derive;
pub mod diagnostic;
pub mod effect;
pub mod emit;
pub mod expand;
pub mod explain;
pub mod graph;
pub mod linearise;
pub mod math;
pub mod model;
pub mod op;
pub mod schedule;
pub mod source;
#[cfg(test)]
mod stopwatch;
pub mod syntax;
pub mod terms;
pub mod unit;

pub use derive::Pattern;
pub use diagnostic::{Code, Diagnostic, Severity};
pub use expand::gather;
pub use linearise::Linearisation;
pub use model::Model;
pub use schedule::{Layout, Program, Schedule};
pub use source::{Source, Span, Text};
pub use unit::Unit;

/// A model that passed every check, its programs, and the warnings that it left.
#[derive(Debug, Clone)]
pub struct Compiled {
    /// The checked model.
    pub model: Model,
    /// Its programs.
    pub schedule: Schedule,
    /// Findings that do not stop the compilation.
    pub warnings: Vec<Diagnostic>,
}

/// Text to programs; a text that uses files is completed by [`gather`] before.
///
/// # Errors
/// Every mistake of the text that can be found, in the order of the text; at least one of them is an error.
pub fn compile(source: &Source) -> Result<Compiled, Vec<Diagnostic>> {
    let (tree, findings) = syntax::parse_recovering(source);
    match tree {
        Some(tree) => compile_tree(source, tree, findings),
        None => Err(findings),
    }
}

/// A tree of a source's own text to programs; `findings` is what was wrong with that text.
///
/// # Errors
/// As [`compile`].
pub fn compile_tree(
    source: &Source,
    tree: syntax::SyntaxTree,
    mut findings: Vec<Diagnostic>,
) -> Result<Compiled, Vec<Diagnostic>> {
    let expanded = expand::expand(source, tree, &|tree| check::check(tree).err().unwrap_or_default());
    findings.extend(expanded.findings);
    let elements = expanded.elements;
    match check::check(&expanded.tree) {
        Ok((mut model, warnings)) if findings.is_empty() => {
            let mut warnings = elements.told(warnings);
            // not everything that a submodel offers is used
            warnings.retain(|w| w.code != Code::Unused || source.text_at(w.span.start).used_at().is_none());
            let schedule = Schedule::new(&mut model);
            return Ok(Compiled { model, schedule, warnings });
        }
        // Whether something is unused or without influence can not be said while statements are missing.
        Ok(_) => {}
        Err(more) if findings.is_empty() => findings = elements.told(more),
        Err(more) => findings.extend(elements.told(more).into_iter().filter(Diagnostic::is_error)),
    }
    findings.sort_by_key(|f| f.span);
    Err(findings)
}
