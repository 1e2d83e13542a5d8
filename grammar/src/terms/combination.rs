//! Coefficients as affine functions of the parameters that are to be found.

use super::split::{Side, split};
use crate::graph::{Graph, Leaf, Node};
use crate::op::{Build, ExprId};

/// `constant + sum slope*parameter`; constant and slopes are expressions of numbers and known parameters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Combination {
    /// What stands without a free parameter.
    pub constant: ExprId,
    /// Free parameters, rising, with their slopes.
    pub slopes: Vec<(u32, ExprId)>,
}

/// Each coefficient as an affine function of the free parameters; `None` for one that is not (`a*b`, `sin(a)`).
pub fn combinations(
    graph: &mut Graph,
    coefficients: &[ExprId],
    free: impl Fn(u32) -> bool,
) -> Vec<Option<Combination>> {
    let side = |leaf| if matches!(leaf, Leaf::Param(k) if free(k)) { Side::Regressor } else { Side::Known };
    let sums = split(graph, coefficients, side);
    let (zero, one) = (graph.number(0.0), graph.number(1.0));
    let combination = |sum: super::sum::Sum| {
        let mut found = Combination { constant: zero, slopes: Vec::new() };
        for term in sum.into_terms() {
            match graph.node(term.regressor) {
                _ if term.regressor == one => found.constant = term.coefficient,
                Node::Leaf(Leaf::Param(k)) => found.slopes.push((k, term.coefficient)),
                _ => return None,
            }
        }
        found.slopes.sort_unstable();
        Some(found)
    };
    sums.into_iter().map(combination).collect()
}
