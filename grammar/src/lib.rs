//! The fdm language and its mathematics: text to checked model to exact derivatives to straight-line programs.
//!
//! **In** the text of a model. **Out** [`compile`]: a [`Model`] and its [`Schedule`], or [`Diagnostic`]s.
//! **Never** files, data or matrices. **Start** at [`compile`]; it is the whole road.

pub mod carried;
pub mod check;
pub mod derive;
pub mod diagnostic;
pub mod emit;
pub mod expand;
pub mod explain;
pub mod external;
pub mod format;
pub mod graph;
pub mod linearise;
pub mod math;
pub mod model;
pub mod number;
pub mod op;
pub mod requirement;
pub mod schedule;
pub mod source;
#[cfg(test)]
mod stopwatch;
pub mod syntax;
pub mod terms;
pub mod unit;

pub use derive::Pattern;
pub use diagnostic::{Code, Diagnostic, Severity};
pub use expand::{gather, gather_kept, library};
pub use linearise::Linearisation;
pub use model::Model;
pub use schedule::{Layout, Program, Schedule};
pub use source::{Groups, Source, Span, Text};
pub use unit::Unit;

/// A model that passed every check, its programs, and the warnings that it left.
#[derive(Debug, Clone)]
pub struct Compiled {
    /// The checked model, its ties on.
    pub model: Model,
    /// The checked model with its ties open; none when it has no ties.
    pub loose: Option<Box<Model>>,
    /// Its programs.
    pub schedule: Schedule,
    /// Findings that do not stop the compilation.
    pub warnings: Vec<Diagnostic>,
}

/// Most operations of a model and its derivatives; their programs take about a hundred bytes for each.
const MOST_NODES: usize = 4_000_000;

fn swollen(model: &Model) -> Diagnostic {
    let name = &model.name;
    let message = format!(
        "the derivatives of `{name}` by its states, inputs and parameters take more than {MOST_NODES} operations"
    );
    Diagnostic::new(Code::TooLarge, Span::default(), message)
        .hint("`fixed` parameters have no derivatives; long chains of `if`, `min` and `max` have one for each of them and each link")
}

/// Text to programs; a text that uses files is completed by [`gather`] before.
///
/// # Errors
/// Every mistake of the text that can be found, in the order of the text; at least one of them is an error.
pub fn compile(source: &Source) -> Result<Compiled, Vec<Diagnostic>> {
    programs(examine(source)?)
}

/// A tree of a source's own text to programs; `findings` is what was wrong with that text.
///
/// # Errors
/// As [`compile`].
pub fn compile_tree(
    source: &Source,
    tree: syntax::SyntaxTree,
    findings: Vec<Diagnostic>,
) -> Result<Compiled, Vec<Diagnostic>> {
    programs(examine_tree(source, tree, findings)?)
}

fn programs((loose, warnings): (Model, Vec<Diagnostic>)) -> Result<Compiled, Vec<Diagnostic>> {
    let mut model = loose.tied(&[]);
    let loose = (!loose.ties.is_empty()).then(|| Box::new(loose));
    match Schedule::within(&mut model, MOST_NODES) {
        Ok(schedule) => Ok(Compiled { model, loose, schedule, warnings }),
        Err(derive::Swollen) => Err(vec![swollen(&model)]),
    }
}

/// Text to a checked model, its ties open, and its warnings: what editors ask for at every key.
///
/// # Errors
/// As [`compile`].
pub fn examine(source: &Source) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    let (tree, findings) = syntax::parse_recovering(source);
    match tree {
        Some(tree) => examine_tree(source, tree, findings),
        None => Err(findings),
    }
}

/// A tree of a source's own text to a checked model, its ties open, and its warnings; `findings` is what was wrong with that text.
///
/// # Errors
/// As [`compile`].
pub fn examine_tree(
    source: &Source,
    tree: syntax::SyntaxTree,
    mut findings: Vec<Diagnostic>,
) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    let expanded = expand::expand(source, tree, &|tree| check::check(tree).err().unwrap_or_default());
    findings.extend(expanded.findings);
    let elements = expanded.elements;
    let mut tree = expand::write_out(expanded.tree, source.groups());
    let wanted = requirement::taken(&mut tree);
    let mut checked = check::check(&tree);
    if let (Ok((model, warnings)), false) = (&mut checked, wanted.is_empty()) {
        let used = requirement::mentioned(&tree, &wanted);
        warnings.retain(|w| w.code != Code::Unused || !used.contains(source.slice(w.span)));
        match requirement::requirements(source, &tree, &wanted, model) {
            Ok(requirements) => model.requirements = Some(std::sync::Arc::new(requirements)),
            Err(more) => checked = Err(more),
        }
    }
    match checked {
        Ok((model, warnings)) if findings.is_empty() => {
            let mut warnings = elements.told(warnings);
            // not everything that a submodel offers is used
            warnings.retain(|w| w.code != Code::Unused || source.text_at(w.span.start).used_at().is_none());
            return Ok((model, warnings));
        }
        // Whether something is unused or without influence can not be said while statements are missing.
        Ok(_) => {}
        Err(more) if findings.is_empty() => findings = elements.told(more),
        Err(more) => findings.extend(elements.told(more).into_iter().filter(Diagnostic::is_error)),
    }
    findings.sort_by_key(|f| f.span);
    Err(findings)
}
