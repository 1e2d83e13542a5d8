//! Syntax tree to syntax tree of the core language: one equation for each state, scalars only.
//!
//! **In** a [`SyntaxTree`] as written, and the texts of the files that it uses. **Out** one without submodels, vectors and
//! blocks, in which every expression keeps the place where the user wrote it, so that messages of later rooms point
//! there; and what is wrong with them. **Never** looks at values, and never makes more than its limits allow.
//! **Start** at [`expand`]: reactions first, then submodels, since vectors may be connected to them, then vectors, then
//! blocks, which read scalars.
//!
//! How large a model may become when what it says in short is written out.

use crate::diagnostic::{Code, Diagnostic};
use crate::source::{Source, Span};
use crate::syntax::{Expr, SyntaxTree};
use submodels::Submodels;

mod arrays;
mod blocks;
mod files;
mod groups;
mod library;
mod maker;
mod reactions;
mod submodels;
mod tables;

pub use arrays::{Elements, MOST_ELEMENTS, MOST_INVERTED};
pub use files::{MOST_FILES, gather, gather_kept, is_unit};
pub use groups::of_group;
pub(crate) use groups::write_out;
pub use library::library;
pub use submodels::MOST_LEVELS;

/// A tree of the core language.
#[derive(Debug)]
pub struct Expanded {
    /// The tree.
    pub tree: SyntaxTree,
    /// What was wrong; the names that it leaves without meaning are suspended in the tree.
    pub findings: Vec<Diagnostic>,
    /// The vectors and matrices that were written out.
    pub elements: Elements,
}

/// Rewrites what the core language does not have. `check` tells what is wrong with a tree of the core language: every used
/// file is checked by itself.
pub fn expand(source: &Source, tree: SyntaxTree, check: &dyn Fn(&SyntaxTree) -> Vec<Diagnostic>) -> Expanded {
    let judge = |tree: &SyntaxTree| {
        let Expanded { tree, mut findings, elements } = core(tree.clone(), &mut Budget::new());
        findings.extend(elements.told(check(&tree)));
        findings
    };
    let mut budget = Budget::new();
    let mut tree = tree;
    let mut findings = Vec::new();
    reactions::reactions(&mut tree, &mut findings);
    tables::read(source, &mut tree, &mut findings);
    let mut submodels = Submodels::new(source, &judge);
    let tree = submodels.inline(tree, &mut budget);
    findings.extend(submodels.finish());
    let Expanded { tree, findings: more, elements } = core(tree, &mut budget);
    findings.extend(more);
    Expanded { tree, findings, elements }
}

/// What can be said of one file, without the others.
fn core(tree: SyntaxTree, budget: &mut Budget) -> Expanded {
    let mut expanded = arrays::flatten(tree, budget);
    blocks::blocks(&mut expanded.tree, &mut expanded.findings);
    expanded
}

/// Stands where a mistake has been told: later rooms are silent about it.
fn broken() -> Expr {
    Expr::Vector(Vec::new())
}

/// Most names, numbers and signs of a model written out.
pub const MOST_NODES: usize = 4_000_000;
/// Most bytes of names, docs and units of a model written out.
const MOST_BYTES: usize = 256 << 20;

/// What may still be written.
#[derive(Debug)]
struct Budget {
    nodes: usize,
    bytes: usize,
    told: bool,
}

impl Budget {
    fn new() -> Self {
        Self { nodes: MOST_NODES, bytes: MOST_BYTES, told: false }
    }

    /// Takes what is needed; `false` when there is not enough, now or before.
    fn spend(&mut self, nodes: usize, bytes: usize) -> bool {
        match (self.nodes.checked_sub(nodes), self.bytes.checked_sub(bytes)) {
            (Some(nodes), Some(bytes)) => (self.nodes, self.bytes) = (nodes, bytes),
            _ => (self.nodes, self.bytes) = (0, 0),
        }
        !self.is_spent()
    }

    /// Whether something did not fit.
    fn is_spent(&self) -> bool {
        self.nodes == 0 || self.bytes == 0
    }

    /// What is told about it, once.
    fn finding(&mut self, span: Span) -> Option<Diagnostic> {
        if std::mem::replace(&mut self.told, true) {
            return None;
        }
        let message = format!(
            "written out, this model has more than {MOST_NODES} names, numbers and signs, or more than {} MiB of \
             names and docs",
            MOST_BYTES >> 20
        );
        Some(Diagnostic::new(Code::TooLarge, span, message).hint("this is where the limit is passed"))
    }
}
