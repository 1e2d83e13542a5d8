//! Vectors and matrices to numbers: `x[1]`, `A[1,2]`.
//!
//! **In** a tree with shapes. **Out** one in which every name is a number, every equation one of numbers; zeros that stand
//! in a matrix never become terms. **Never** more than the budget allows. **Start** at [`flatten`]: `declared.rs` knows what
//! is a vector, `value.rs` and `products.rs` what expressions are worth, `statements.rs` writes the elements.
//!
//! What later rooms say about every element of a vector, said once about the vector.

use super::{Budget, Expanded};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{Expr, Nodes, StatementKind, SyntaxTree};
use declared::Declared;
use std::collections::HashMap;
use value::{Evaluator, FUNCTIONS};
use writer::Writer;

mod declared;
mod grids;
mod products;
mod statements;
mod value;
mod writer;

pub use declared::MOST_ELEMENTS;
pub use products::MOST_INVERTED;

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

/// The vectors and matrices of a model, by the place of their name.
#[derive(Debug, Default, Clone)]
pub struct Elements {
    declared: HashMap<Span, (String, usize)>,
}

impl Elements {
    /// A name with so many elements that are not 0 by structure.
    pub(super) fn add(&mut self, place: Span, name: &str, count: usize) {
        self.declared.insert(place, (name.into(), count));
    }

    /// One finding for a mistake that all elements make; what nothing uses is told when no element is used.
    pub fn told(&self, findings: Vec<Diagnostic>) -> Vec<Diagnostic> {
        if self.declared.is_empty() {
            return findings;
        }
        let mut counts: HashMap<(Code, Span), usize> = HashMap::new();
        for finding in &findings {
            *counts.entry((finding.code, finding.span)).or_default() += 1;
        }
        let mut seen: HashMap<(Code, Span), ()> = HashMap::new();
        let mut told = Vec::with_capacity(findings.len());
        for mut finding in findings {
            let key = (finding.code, finding.span);
            let first = seen.insert(key, ()).is_none();
            if let Some((name, count)) = self.declared.get(&finding.span) {
                let all = counts[&key] >= *count;
                match finding.code {
                    Code::Unused if !all => continue,
                    Code::NoInfluence if !all => {}
                    _ if !first => continue,
                    // one unit is declared for all
                    Code::UnitUnknown => of_all(&mut finding, name),
                    _ if all => of_all(&mut finding, name),
                    _ => {}
                }
            } else if !first {
                continue;
            }
            told.push(finding);
        }
        told
    }
}

/// Says of `x` what was said of `x[1]`.
fn of_all(finding: &mut Diagnostic, name: &str) {
    let start = format!("{name}[");
    for text in [Some(&mut finding.message), finding.hint.as_mut()].into_iter().flatten() {
        let mut rest = std::mem::take(text);
        while let Some(at) = rest.find(&start) {
            let index = at + name.len();
            let Some(end) = rest[index..].find(']') else { break };
            text.push_str(&rest[..index]);
            rest.replace_range(..=index + end, "");
        }
        text.push_str(&rest);
    }
}
