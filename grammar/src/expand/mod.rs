//! Syntax tree to syntax tree of the core language: one equation for each state, scalars only.
//!
//! **In** a [`SyntaxTree`] as written. **Out** one without submodels, vectors and blocks, in which every expression keeps
//! the place where the user wrote it, so that messages of later rooms point there; and what is wrong with them.
//! **Never** looks at values or units, and never makes more than its limits allow. **Start** at [`expand`].

use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{Expr, StatementKind, SyntaxTree};

/// Rewrites what the core language does not have.
pub fn expand(tree: SyntaxTree) -> (SyntaxTree, Vec<Diagnostic>) {
    let mut findings = Vec::new();
    for statement in &tree.statements {
        match &statement.kind {
            StatementKind::Use(_) => findings.push(unsupported(statement.span, "submodels")),
            StatementKind::Declare(_, list) => {
                let shapes = list.iter().filter_map(|d| d.shape);
                findings.extend(shapes.map(|s| unsupported(s.span, "vectors and matrices")));
            }
            _ => {}
        }
    }
    let arrays = tree.expressions.iter().filter(|(e, _)| matches!(e, Expr::Vector(_) | Expr::Element(..)));
    findings.extend(arrays.map(|(_, span)| unsupported(*span, "vectors and matrices")));
    (tree, findings)
}

fn unsupported(span: Span, what: &str) -> Diagnostic {
    Diagnostic::new(Code::Unsupported, span, format!("this version does not compile {what} yet"))
}
