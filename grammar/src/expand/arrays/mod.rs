//! Vectors and matrices to numbers: `x[1]`, `A[1,2]`.
//!
//! **In** a tree with shapes. **Out** one in which every name is a number, every equation one of numbers; zeros that stand
//! in a matrix never become terms. **Never** more than the budget allows. **Start** at [`flatten`]: `declared.rs` knows what
//! is a vector, `value.rs`, `products.rs` and `rotations.rs` what expressions are worth, `statements.rs` writes the elements.

mod declared;
mod grids;
mod products;
mod rotations;
mod shape;
mod statements;
mod value;
mod writer;

pub use products::MOST_INVERTED;
pub use shape::MOST_ELEMENTS;

use super::Expanded;
use super::budget::Budget;
use super::elements::Elements;
use crate::syntax::{Expr, Nodes, StatementKind, SyntaxTree};
use declared::Declared;
use value::{Evaluator, FUNCTIONS};
use writer::Writer;

/// Writes out vectors and matrices.
pub(super) fn flatten(tree: SyntaxTree, budget: &mut Budget) -> Expanded {
    if !has_arrays(&tree) {
        return Expanded { tree, findings: Vec::new(), elements: Elements::default() };
    }
    let mut findings = Vec::new();
    let declared = Declared::new(&tree, &mut findings);
    let mut elements = Elements::default();
    declared.arrays().for_each(|(name, array)| elements.add(array.span, name, array.present()));
    let mut suspended = tree.suspended.clone();
    suspended.extend(declared.refused.iter().map(|name| name.to_string()));
    let mut out = Writer::new(&declared, budget, findings);
    let mut statements = Vec::with_capacity(tree.statements.len());
    let mut evaluator = Evaluator::new(&tree, &mut out);
    tree.statements.iter().for_each(|s| evaluator.statement(s, &mut suspended, &mut statements));
    if out.budget.is_spent() {
        // what is missing is a consequence
        suspended.extend(declared.arrays().map(|(name, _)| name.to_string()));
    }
    suspended.sort_unstable();
    suspended.dedup();
    statements.append(&mut out.lets);
    let (expressions, findings) = (out.expressions, out.findings);
    let tree = SyntaxTree { name: tree.name.clone(), doc: tree.doc.clone(), statements, expressions, suspended };
    Expanded { tree, findings, elements }
}

/// Whether anything is not a number.
fn has_arrays(tree: &SyntaxTree) -> bool {
    let shaped = tree.statements.iter().any(|s| match &s.kind {
        StatementKind::Declare(_, list) => list.iter().any(|d| d.shape.is_some()),
        StatementKind::Noise(list)
        | StatementKind::Process(list)
        | StatementKind::Trim(list)
        | StatementKind::Tie(list) => list.iter().any(|(name, _)| name.text.contains('[')),
        StatementKind::Limit(list) => list.iter().any(|l| l.state.text.contains('[')),
        StatementKind::When(event) => event.resets.iter().any(|(name, _)| name.text.contains('[')),
        StatementKind::Table(table) => matches!(table.nodes, Nodes::Written(_)),
        _ => false,
    });
    shaped
        || tree.expressions.iter().any(|(e, _)| match e {
            Expr::Vector(list) => !list.is_empty(),
            Expr::Element(..) => true,
            Expr::Call(name, _) => FUNCTIONS.contains(&name.text.as_str()),
            _ => false,
        })
}
