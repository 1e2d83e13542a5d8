//! Syntax tree to syntax tree of the core language: one equation for each state, scalars only.
//!
//! **In** a [`SyntaxTree`] as written. **Out** one without submodels, vectors and blocks, in which every expression keeps
//! the place where the user wrote it, so that messages of later rooms point there; and what is wrong with them.
//! **Never** looks at values or units, and never makes more than its limits allow. **Start** at [`expand`].

mod blocks;
mod maker;
mod transfer;

use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{Expr, StatementKind, SyntaxTree, each_root};

/// Rewrites what the core language does not have.
pub fn expand(mut tree: SyntaxTree) -> (SyntaxTree, Vec<Diagnostic>) {
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
    blocks::blocks(&mut tree, &mut findings);
    let mut wanted = vec![false; tree.expressions.len()];
    tree.statements.iter().for_each(|s| each_root(&s.kind, |root| wanted[root.0 as usize] = true));
    for k in (0..wanted.len()).rev() {
        if wanted[k] {
            tree.expressions[k].0.each_operand(|operand| wanted[operand.0 as usize] = true);
        }
    }
    let vector = |e: &Expr| matches!(e, Expr::Element(..)) || matches!(e, Expr::Vector(list) if !list.is_empty());
    let arrays = tree.expressions.iter().zip(wanted).filter(|((e, _), wanted)| *wanted && vector(e));
    findings.extend(arrays.map(|((_, span), _)| unsupported(*span, "vectors and matrices")));
    (tree, findings)
}

fn unsupported(span: Span, what: &str) -> Diagnostic {
    Diagnostic::new(Code::Unsupported, span, format!("this version does not compile {what} yet"))
}
