//! Where rates have kinks: the switching functions of `max`, `min`, `abs` and `if`, whose sign says which branch counts.

use crate::graph::{Graph, Leaf, Node};
use crate::model::Model;
use crate::op::{Build, ExprId, Op};

/// The switching functions of the rates that change during a run; new nodes join the graph. Knots of tables are among them, since tables are
/// sums of `min` and `max`. Hard limits are not: who takes steps knows them as such. Nor are the jumps of `sign`, behind which nothing goes
/// on as before. A model with events or delays has none: they have instants of their own, or a past that does not know of any.
pub(super) fn switching(model: &mut Model) -> Vec<ExprId> {
    if model.has_events() || !model.graph.delayed().is_empty() {
        return Vec::new();
    }
    let varies = model.graph.depends(|leaf| !matches!(leaf, Leaf::Param(_)));
    let limits = clamped(model);
    let rates: Vec<ExprId> = model.states.iter().map(|s| s.rate).collect();
    let zero = model.graph.number(0.0);
    let mut sides: Vec<[ExprId; 2]> = Vec::new();
    for e in model.graph.reachable(rates) {
        let pair = match model.graph.node(e) {
            Node::Apply(Op::Max | Op::Min, [a, b, _]) if !limits.contains(&[a, b]) => [a, b],
            Node::Apply(Op::Less | Op::LessEqual, [a, b, _]) => [a, b],
            Node::Apply(Op::Abs, [a, ..]) => [a, zero],
            _ => continue,
        };
        if pair.iter().any(|side| varies.get(side.index()).is_some_and(|v| *v)) {
            sides.push(pair);
        }
    }
    let mut found: Vec<ExprId> = Vec::with_capacity(sides.len());
    for pair in sides {
        let switch = model.graph.apply(Op::Sub, &pair);
        if !found.contains(&switch) {
            found.push(switch);
        }
    }
    found
}

/// The operands of `max` and `min` that hold states inside their limits.
fn clamped(model: &mut Model) -> Vec<[ExprId; 2]> {
    let limits: Vec<_> = model.limits().collect();
    let graph: &mut Graph = &mut model.graph;
    let mut pairs = Vec::with_capacity(2 * limits.len());
    for (state, limit) in limits {
        let x = graph.leaf(Leaf::State(state as u32));
        let above = graph.apply(Op::Max, &[x, limit.lower]);
        pairs.extend([[x, limit.lower], [above, limit.upper]]);
    }
    pairs
}
