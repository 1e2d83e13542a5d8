//! Ties put into effect: a tied parameter gives way to what it is tied to, everywhere.

use super::{Derived, Model, Output, Signal, State};
use crate::graph::{Graph, Leaf, Node, Reference};
use crate::op::{ExprId, Op};

/// `tie a = 2*b;`: an equality between declared parameters that a study may switch off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tie {
    /// The parameter that follows.
    pub param: u32,
    /// What it follows: an expression of parameters, tied ones among them.
    pub expr: ExprId,
}

impl Model {
    /// Names of the parameters that are tied while their ties are on.
    pub fn tied_names(&self) -> impl Iterator<Item = &str> {
        self.ties.iter().map(|tie| self.params[tie.param as usize].quantity.name.as_str())
    }

    /// The model with its ties on, but for those of the params named in `open`: tied params are derived ones, and their
    /// bounds have moved to the param behind a plain tie (`a = b`, `a = 2*b`). The ties are gone from it.
    ///
    /// Ties stand in an order in which none refers to a later one; there are no circles.
    pub fn tied(&self, open: &[&str]) -> Model {
        let shut: Vec<Tie> = self.ties.iter().copied().filter(|tie| !open.contains(&self.name_of(tie.param))).collect();
        let mut model = Model { ties: Vec::new(), ..self.clone() };
        if shut.is_empty() {
            return model;
        }
        shut.iter().rev().for_each(|tie| hand_on_bounds(&mut model, tie));
        let mut place: Vec<Option<u32>> = Vec::with_capacity(self.params.len());
        let mut next = 0..;
        for k in 0..self.params.len() as u32 {
            place.push(if shut.iter().any(|t| t.param == k) { None } else { next.next() });
        }
        let mut graph = Graph::default();
        let mut follows: Vec<Option<ExprId>> = vec![None; self.params.len()];
        for tie in &shut {
            follows[tie.param as usize] = Some(self.rebuilt(&[tie.expr], &mut graph, &place, &follows)[0]);
        }
        let old: Vec<ExprId> = model.expressions_mut().map(|e| *e).collect();
        let new = self.rebuilt(&old, &mut graph, &place, &follows);
        model.expressions_mut().zip(new).for_each(|(e, new)| *e = new);
        let mut derived: Vec<(u32, Derived)> = Vec::new();
        for (k, expr) in follows.iter().enumerate().filter_map(|(k, e)| e.map(|e| (k, e))) {
            derived.push((k as u32, Derived { quantity: self.params[k].quantity.clone(), expr, tied: true }));
        }
        model.derived.extend(derived.into_iter().map(|(_, d)| d));
        let mut k = 0;
        model.params.retain(|_| {
            k += 1;
            place[k - 1].is_some()
        });
        model.graph = graph;
        model
    }

    fn name_of(&self, param: u32) -> &str {
        &self.params[param as usize].quantity.name
    }

    /// Expressions in the new graph, with params at their new places or replaced.
    fn rebuilt(
        &self,
        roots: &[ExprId],
        into: &mut Graph,
        place: &[Option<u32>],
        follows: &[Option<ExprId>],
    ) -> Vec<ExprId> {
        self.graph.rebuild(roots, into, |graph, reference| match reference {
            Reference::Now(Leaf::Param(k)) => match (place[k as usize], follows[k as usize]) {
                (Some(new), _) => graph.leaf(Leaf::Param(new)),
                (None, Some(e)) => e,
                (None, None) => graph.leaf(Leaf::Param(k)),
            },
            other => graph.reference(other),
        })
    }

    /// Every expression of the model.
    pub(super) fn expressions_mut(&mut self) -> impl Iterator<Item = &mut ExprId> {
        let states = self.states.iter_mut().flat_map(State::expressions_mut);
        let outputs = self.outputs.iter_mut().flat_map(Output::expressions_mut);
        let derived = self.derived.iter_mut().map(|d| &mut d.expr);
        let trim = self.trim.iter_mut().map(|(_, e): &mut (Signal, ExprId)| e);
        states.chain(outputs).chain(derived).chain(trim)
    }
}

/// Where a tie is a multiple of one param, that param keeps the bounds of both.
fn hand_on_bounds(model: &mut Model, tie: &Tie) {
    let Some((k, factor)) = multiple(&model.graph, tie.expr).filter(|(_, factor)| *factor != 0.0) else { return };
    let own = &model.params[tie.param as usize];
    let (a, b) = (own.lower / factor, own.upper / factor);
    let other = &mut model.params[k as usize];
    other.lower = other.lower.max(a.min(b));
    other.upper = other.upper.min(a.max(b));
}

/// The parameter and the factor of `b`, `-b`, `2*b`.
fn multiple(graph: &Graph, e: ExprId) -> Option<(u32, f64)> {
    match graph.node(e) {
        Node::Leaf(Leaf::Param(k)) => Some((k, 1.0)),
        Node::Apply(Op::Neg, [a, ..]) => multiple_of_leaf(graph, a, -1.0),
        Node::Apply(Op::Mul, [c, a, _]) => multiple_of_leaf(graph, a, graph.constant(c)?),
        Node::Apply(Op::Div, [a, c, _]) => multiple_of_leaf(graph, a, 1.0 / graph.constant(c)?),
        _ => None,
    }
}

fn multiple_of_leaf(graph: &Graph, e: ExprId, factor: f64) -> Option<(u32, f64)> {
    match graph.node(e) {
        Node::Leaf(Leaf::Param(k)) => Some((k, factor)),
        _ => None,
    }
}
