//! How outputs show states: what a record of the output says about the state.

use super::Model;
use crate::graph::{Graph, Leaf, Node};
use crate::op::{Build, ExprId, Op};

/// An output that shows a state: `output = slope*state + offset`. Both are expressions of constants and fixed
/// parameters in the graph that [`reading`] was given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reading {
    /// The output, by index.
    pub output: usize,
    /// Factor of the state.
    pub slope: ExprId,
    /// What stands beside it.
    pub offset: ExprId,
}

/// The output that shows a state: the first that is the state itself, else the first that is an invertible affine
/// function of it. `graph` holds the model's expressions and takes the new ones.
pub fn reading(model: &Model, graph: &mut Graph, state: u32) -> Option<Reading> {
    let itself = Node::Leaf(Leaf::State(state));
    let (one, zero) = (graph.number(1.0), graph.number(0.0));
    if let Some(output) = model.outputs.iter().position(|o| graph.node(o.expr) == itself) {
        return Some(Reading { output, slope: one, offset: zero });
    }
    let value = |graph: &Graph, e| {
        graph.evaluate(e, |leaf| match leaf {
            Leaf::Param(k) => model.params[k as usize].value,
            _ => f64::NAN,
        })
    };
    model.outputs.iter().enumerate().find_map(|(output, o)| {
        let (slope, offset) = affine(graph, o.expr, state, |k| model.params[k as usize].fixed)?;
        let (a, b) = (value(graph, slope), value(graph, offset));
        (a != 0.0 && a.is_finite() && b.is_finite()).then_some(Reading { output, slope, offset })
    })
}

/// The output that shows a state but for a bias that is to be estimated: `slope*state + offset` with a known slope, and an offset in which
/// free parameters stand, which are told. What follows from it is known up to a constant.
pub fn biased_reading(model: &Model, graph: &mut Graph, state: u32) -> Option<(Reading, Vec<u32>)> {
    model.outputs.iter().enumerate().find_map(|(output, o)| {
        let (slope, offset) = affine(graph, o.expr, state, |_| true)?;
        let free = |graph: &Graph, e: ExprId| -> Vec<u32> {
            let below = graph.reachable([e]).into_iter().filter_map(|e| match graph.node(e) {
                Node::Leaf(Leaf::Param(k)) if !model.params[k as usize].fixed => Some(k),
                _ => None,
            });
            below.collect()
        };
        let factor = graph.evaluate(slope, |leaf| match leaf {
            Leaf::Param(k) => model.params[k as usize].value,
            _ => f64::NAN,
        });
        let known = free(graph, slope).is_empty() && factor != 0.0 && factor.is_finite();
        known.then(|| (Reading { output, slope, offset }, free(graph, offset)))
    })
}

/// An output that would show a state if parameters in it, a bias or a scale, were not to be estimated.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Unsettled {
    /// The state.
    pub state: String,
    /// The output.
    pub output: String,
    /// The parameters.
    pub parameters: Vec<String>,
}

impl std::fmt::Display for Unsettled {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<String> = self.parameters.iter().map(|p| format!("`{p}`")).collect();
        let verb = if names.len() == 1 { "is" } else { "are" };
        write!(
            f,
            "`{}` shows the state `{}` only together with {}, which {verb} to be estimated",
            self.output,
            self.state,
            names.join(", ")
        )
    }
}

/// The first output that would show a state if fewer parameters were to be estimated. `graph` as in [`reading`].
pub fn unsettled(model: &Model, graph: &mut Graph, state: u32) -> Option<Unsettled> {
    model.outputs.iter().find_map(|o| {
        affine(graph, o.expr, state, |_| true)?;
        let free = graph.reachable([o.expr]).into_iter().filter_map(|e| match graph.node(e) {
            Node::Leaf(Leaf::Param(k)) => Some(&model.params[k as usize]).filter(|p| !p.fixed),
            _ => None,
        });
        let parameters: Vec<String> = free.map(|p| p.quantity.name.clone()).collect();
        let (state, output) = (model.states[state as usize].quantity.name.clone(), o.quantity.name.clone());
        (!parameters.is_empty()).then_some(Unsettled { state, output, parameters })
    })
}

/// Slope and offset of an expression that is affine in one state and otherwise made of constants and `known` parameters.
fn affine(graph: &mut Graph, root: ExprId, state: u32, known: impl Fn(u32) -> bool) -> Option<(ExprId, ExprId)> {
    let zero = graph.number(0.0);
    let mut terms: Vec<Option<(ExprId, ExprId)>> = vec![None; root.index() + 1];
    for e in graph.reachable([root]) {
        let of = |a: ExprId| terms[a.index()];
        terms[e.index()] = match graph.node(e) {
            Node::Constant(_) => Some((zero, e)),
            Node::Leaf(Leaf::State(k)) if k == state => Some((graph.number(1.0), zero)),
            Node::Leaf(Leaf::Param(k)) if known(k) => Some((zero, e)),
            Node::Leaf(_) => None,
            Node::Apply(op, args) => {
                let operands: Option<Vec<_>> = args[..op.row().arity].iter().map(|a| of(*a)).collect();
                applied(graph, op, &operands?, zero)
            }
        };
        terms[e.index()]?;
    }
    terms[root.index()].filter(|(slope, _)| *slope != zero)
}

/// Slope and offset of an operation on operands of known slope and offset.
fn applied(graph: &mut Graph, op: Op, operands: &[(ExprId, ExprId)], zero: ExprId) -> Option<(ExprId, ExprId)> {
    if operands.iter().all(|(slope, _)| *slope == zero) {
        let offsets: Vec<ExprId> = operands.iter().map(|(_, offset)| *offset).collect();
        return Some((zero, graph.apply(op, &offsets)));
    }
    let mut both = |op, (a, b): (ExprId, ExprId), (c, d)| (graph.apply(op, &[a, c]), graph.apply(op, &[b, d]));
    match (op, operands) {
        (Op::Add | Op::Sub, [a, b]) => Some(both(op, *a, *b)),
        (Op::Mul, [a, (slope, factor)]) if *slope == zero => Some(both(op, *a, (*factor, *factor))),
        (Op::Mul, [(slope, factor), b]) if *slope == zero => Some(both(op, (*factor, *factor), *b)),
        (Op::Div, [a, (slope, divisor)]) if *slope == zero => Some(both(op, *a, (*divisor, *divisor))),
        (Op::Neg, [(slope, offset)]) => Some((graph.apply(op, &[*slope]), graph.apply(op, &[*offset]))),
        _ => None,
    }
}
