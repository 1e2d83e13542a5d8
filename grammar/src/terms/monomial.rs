//! Products of signals in one order, so that `x*u*x` and `x^2*u` are one regressor.

use crate::graph::{Graph, Node};
use crate::op::{Build, ExprId, Op};

/// Products of more factors keep the order in which they were written.
const MOST_FACTORS: usize = 64;

/// The product of two regressors.
pub(super) fn product(graph: &mut Graph, a: ExprId, b: ExprId) -> ExprId {
    let mut factors = Vec::new();
    if !(collect(graph, a, &mut factors) && collect(graph, b, &mut factors)) {
        return graph.apply(Op::Mul, &[a, b]);
    }
    factors.sort_unstable();
    let one = graph.number(1.0);
    factors.into_iter().fold(one, |product, factor| graph.apply(Op::Mul, &[product, factor]))
}

/// Appends the factors of an expression; says whether there were few enough.
fn collect(graph: &Graph, e: ExprId, factors: &mut Vec<ExprId>) -> bool {
    let mut open = vec![e];
    while let Some(e) = open.pop() {
        if factors.len() + open.len() > MOST_FACTORS {
            return false;
        }
        match graph.node(e) {
            Node::Apply(Op::Mul, [a, b, _]) => open.extend([a, b]),
            _ => factors.push(e),
        }
    }
    true
}
