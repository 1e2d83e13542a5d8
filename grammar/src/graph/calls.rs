//! Calls of foreign code in a graph: their functions, and the lists of their arguments.

use super::{Graph, Node};
use crate::external::Function;
use crate::op::{ExprId, Op};

/// The elements of a list in front of which zeros were left out, the last one first.
pub(crate) fn elements(graph: &Graph, list: ExprId) -> Vec<ExprId> {
    let (mut found, mut rest) = (Vec::new(), list);
    while let Node::Apply(Op::List, [before, last, _]) = graph.node(rest) {
        found.push(last);
        rest = before;
    }
    found
}

/// The function of a call in a graph, and its lists: arguments, then directions.
pub(crate) fn call(graph: &Graph, op: Op, args: [ExprId; 3]) -> Option<(Function, Vec<ExprId>)> {
    let function = Function::numbered(graph.constant(args[0])?)?;
    let lists = match op {
        Op::External => vec![args[1]],
        Op::ExternalSlope => vec![args[1], args[2]],
        Op::ExternalCurvature => match graph.node(args[2]) {
            Node::Apply(Op::List, [first, second, _]) => vec![args[1], first, second],
            _ => return None,
        },
        _ => return None,
    };
    Some((function, lists))
}

/// For each node whether foreign code has a part in it.
pub(crate) fn above_calls(graph: &Graph) -> Vec<bool> {
    let mut holds: Vec<bool> = Vec::with_capacity(graph.nodes().len());
    for node in graph.nodes() {
        holds.push(match node {
            Node::Apply(op, args) => op.is_external() || args[..op.row().arity].iter().any(|a| holds[a.index()]),
            _ => false,
        });
    }
    holds
}
