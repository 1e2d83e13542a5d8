//! `initial(x)`: an expression when a run begins. States have their initial values there, inputs their first samples (before
//! which they had them too, so that a delayed signal has its first value), time is 0.

use crate::graph::{Graph, Leaf, Node, Signal};
use crate::op::{Build, ExprId, Op};
use std::collections::HashMap;

/// Expressions at the beginning, in a graph that only grows.
#[derive(Default)]
pub(super) struct Initials {
    done: HashMap<ExprId, ExprId>,
    /// Inputs whose first sample is needed, in the order of their params.
    pub(super) first: Vec<u32>,
    /// Index of the first param that holds such a sample.
    from: u32,
    /// Inputs; what has a greater index is a derivative.
    inputs: u32,
}

/// What a node needs of the state whose value it is, or is made of.
fn signal(graph: &Graph, leaf: Leaf) -> Option<Signal> {
    match leaf {
        Leaf::State(k) => Some(Signal::State(k)),
        Leaf::Input(k) => Some(Signal::Input(k)),
        Leaf::Delayed(k) => Some(graph.delayed()[k as usize].signal),
        Leaf::Time | Leaf::Param(_) => None,
    }
}

impl Initials {
    /// Nothing yet; `from` is the first index that no param has.
    pub(super) fn new(from: u32, inputs: u32) -> Self {
        Self { from, inputs, ..Self::default() }
    }

    /// The nodes below `e` that have not been looked at, operands first.
    fn pending(&self, graph: &Graph, e: ExprId) -> Vec<ExprId> {
        let (mut order, mut seen, mut open) = (Vec::new(), HashMap::new(), vec![e]);
        while let Some(k) = open.pop() {
            if !self.done.contains_key(&k) && seen.insert(k, ()).is_none() {
                order.push(k);
                open.extend_from_slice(graph.operands(k));
            }
        }
        order.sort_unstable();
        order
    }

    /// States (by index) whose initial values `e` needs and which are not known yet.
    pub(super) fn missing(&self, graph: &Graph, e: ExprId, states: &[Option<ExprId>]) -> Vec<u32> {
        let state = |k: &ExprId| match graph.node(*k) {
            Node::Leaf(leaf) => match signal(graph, leaf) {
                Some(Signal::State(k)) if states.get(k as usize) == Some(&None) => Some(k),
                _ => None,
            },
            _ => None,
        };
        self.pending(graph, e).iter().filter_map(state).collect()
    }

    /// `e` at the beginning; all states that it needs are known.
    pub(super) fn of(&mut self, graph: &mut Graph, e: ExprId, states: &[Option<ExprId>]) -> ExprId {
        for k in self.pending(graph, e) {
            let value = match graph.node(k) {
                Node::Constant(_) | Node::Leaf(Leaf::Param(_)) => k,
                Node::Leaf(leaf) => match signal(graph, leaf) {
                    Some(Signal::State(state)) if (state as usize) < states.len() => {
                        states[state as usize].unwrap_or(k)
                    }
                    Some(Signal::Input(input)) if input < self.inputs => self.sample(graph, input),
                    // time, and derivatives at rest
                    _ => graph.number(0.0),
                },
                Node::Apply(op, args) => self.applied(graph, op, &args[..op.row().arity]),
            };
            self.done.insert(k, value);
        }
        self.done.get(&e).copied().unwrap_or(e)
    }

    fn applied(&self, graph: &mut Graph, op: Op, args: &[ExprId]) -> ExprId {
        let args: Vec<ExprId> = args.iter().map(|a| self.done.get(a).copied().unwrap_or(*a)).collect();
        graph.apply(op, &args)
    }

    /// The param that holds the first sample of an input.
    pub(super) fn sample(&mut self, graph: &mut Graph, input: u32) -> ExprId {
        let place = self.first.iter().position(|k| *k == input).unwrap_or_else(|| {
            self.first.push(input);
            self.first.len() - 1
        });
        graph.leaf(Leaf::Param(self.from + place as u32))
    }
}
