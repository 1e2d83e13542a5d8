//! Expressions as a hash-consed graph: equal expressions are one node, operands stand before their users.
//!
//! **In** leaves, constants and operations. **Out** [`ExprId`]s, the nodes in topological order.
//! **Never** recurses, and never iterates over its hash map: ids depend only on the order of construction.
//! **Start** at [`Graph`]; the few local simplifications are in `simplify.rs`, printing in `show.rs`.
//!
//! Which node stands where: an index over an array of nodes that holds their numbers only.
//!
//! Calls of foreign code in a graph: their functions, and the lists of their arguments.
//!
//! Expressions built anew in another graph, with other leaves where that is wanted.

use crate::external::Function;
use crate::op::{Args, Build, ExprId, Op};
use hashbrown::hash_table::Entry;
use hashbrown::{DefaultHashBuilder, HashTable};
use std::hash::BuildHasher;

mod show;
mod simplify;

pub use show::{Names, show};

/// What an expression can refer to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Leaf {
    /// Time since the run began, in the model's time unit.
    Time,
    /// A state, by index.
    State(u32),
    /// An input, by index.
    Input(u32),
    /// A parameter, by index.
    Param(u32),
    /// A delayed signal, by index into [`Graph::delayed`].
    Delayed(u32),
}

/// What can be delayed; delays of expressions are delays of the signals in them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Signal {
    /// A state, by index.
    State(u32),
    /// An input, by index.
    Input(u32),
}

/// A signal at an earlier time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct DelayedSignal {
    /// Which signal.
    pub signal: Signal,
    /// The delay, an expression of parameters only, in the model's time unit.
    pub tau: ExprId,
}

/// A node of the graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Node {
    /// A number, by its bits (so that NaN equals itself and 0 differs from -0).
    Constant(u64),
    /// A reference.
    Leaf(Leaf),
    /// An operation; unused places hold [`ExprId::NONE`].
    Apply(Op, Args),
}

/// The expressions of one model.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    memo: Memo,
    delayed: Vec<DelayedSignal>,
}

impl Graph {
    /// The node behind an id.
    #[inline]
    pub fn node(&self, e: ExprId) -> Node {
        self.nodes[e.index()]
    }

    /// All nodes; operands have smaller ids than their users.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The delayed signals that leaves refer to.
    pub fn delayed(&self) -> &[DelayedSignal] {
        &self.delayed
    }

    /// The operands of a node.
    pub fn operands(&self, e: ExprId) -> &[ExprId] {
        match &self.nodes[e.index()] {
            Node::Apply(op, args) => &args[..op.row().arity],
            _ => &[],
        }
    }

    /// A reference.
    pub fn leaf(&mut self, leaf: Leaf) -> ExprId {
        self.intern(Node::Leaf(leaf))
    }

    /// A signal at an earlier time; the same signal with the same delay is one leaf.
    pub fn delay(&mut self, signal: Signal, tau: ExprId) -> ExprId {
        let wanted = DelayedSignal { signal, tau };
        let k = self.delayed.iter().position(|d| *d == wanted).unwrap_or_else(|| {
            self.delayed.push(wanted);
            self.delayed.len() - 1
        });
        self.leaf(Leaf::Delayed(k as u32))
    }

    /// The value of a constant node.
    pub fn constant(&self, e: ExprId) -> Option<f64> {
        match self.node(e) {
            Node::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// Whether a node is a constant that is not finite, or a quotient by the constant 0.
    pub fn is_singular(&self, e: ExprId) -> bool {
        match self.node(e) {
            Node::Constant(bits) => !f64::from_bits(bits).is_finite(),
            Node::Apply(Op::Div, [_, under, ..]) => self.constant(under) == Some(0.0),
            _ => false,
        }
    }

    /// The nodes that `roots` need, in topological order.
    pub fn reachable(&self, roots: impl IntoIterator<Item = ExprId>) -> Vec<ExprId> {
        let mut wanted = vec![false; self.nodes.len()];
        for r in roots {
            wanted[r.index()] = true;
        }
        for k in (0..self.nodes.len()).rev() {
            if wanted[k] {
                self.operands(ExprId(k as u32)).iter().for_each(|a| wanted[a.index()] = true);
            }
        }
        wanted.iter().enumerate().filter(|(_, w)| **w).map(|(k, _)| ExprId(k as u32)).collect()
    }

    /// For each node whether it depends on a leaf that `chosen` accepts.
    pub fn depends(&self, chosen: impl Fn(Leaf) -> bool) -> Vec<bool> {
        let mut depends: Vec<bool> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let d = match node {
                Node::Constant(_) => false,
                Node::Leaf(leaf) => chosen(*leaf),
                Node::Apply(op, args) => args[..op.row().arity].iter().any(|a| depends[a.index()]),
            };
            depends.push(d);
        }
        depends
    }

    /// The value of an expression for given leaves, without recursion; used for constants and tests.
    pub fn evaluate(&self, e: ExprId, leaf: impl Fn(Leaf) -> f64) -> f64 {
        let mut values = vec![f64::NAN; e.index() + 1];
        for k in self.reachable([e]) {
            values[k.index()] = match self.node(k) {
                Node::Apply(op, args) if op.is_external() => self.called(op, args, &values),
                Node::Constant(bits) => f64::from_bits(bits),
                Node::Leaf(l) => leaf(l),
                Node::Apply(op, args) => {
                    let at = |i: usize| values.get(args[i].index()).copied().unwrap_or(f64::NAN);
                    (op.row().value)(at(0), at(1), at(2))
                }
            };
        }
        values[e.index()]
    }

    /// A function of foreign code, from the values of the nodes before it.
    fn called(&self, op: Op, args: Args, values: &[f64]) -> f64 {
        let Some((function, lists)) = call(self, op, args) else { return f64::NAN };
        let n = function.code.arguments();
        let mut operands = vec![0.0; n * lists.len()];
        for (list, own) in lists.iter().zip(operands.chunks_mut(n.max(1))) {
            own.iter_mut().rev().zip(elements(self, *list)).for_each(|(o, e)| *o = values[e.index()]);
        }
        function.compute(op, &operands)
    }

    fn intern(&mut self, node: Node) -> ExprId {
        ExprId(self.memo.place(&mut self.nodes, node))
    }
}

impl Build for Graph {
    fn number(&mut self, value: f64) -> ExprId {
        // one zero: the sign of a structural zero carries no meaning
        let value = if value == 0.0 { 0.0 } else { value };
        self.intern(Node::Constant(value.to_bits()))
    }

    fn apply(&mut self, op: Op, args: &[ExprId]) -> ExprId {
        simplify::simplify(self, op, args).unwrap_or_else(|| {
            let mut padded = [ExprId::NONE; 3];
            padded[..args.len()].copy_from_slice(args);
            self.intern(Node::Apply(op, padded))
        })
    }
}

/// Numbers of nodes, found by the nodes' hashes. The hash is keyed by chance; nothing depends on its order.
#[derive(Debug, Clone, Default)]
struct Memo {
    numbers: HashTable<u32>,
    hasher: DefaultHashBuilder,
}

impl Memo {
    /// The place of a node in `nodes`, where it is put when it is new.
    fn place(&mut self, nodes: &mut Vec<Node>, node: Node) -> u32 {
        let hash = self.hasher.hash_one(node);
        let same = |number: &u32| nodes[*number as usize] == node;
        let again = |number: &u32| self.hasher.hash_one(nodes[*number as usize]);
        match self.numbers.entry(hash, same, again) {
            Entry::Occupied(entry) => *entry.get(),
            Entry::Vacant(entry) => {
                let number = nodes.len() as u32;
                entry.insert(number);
                nodes.push(node);
                number
            }
        }
    }
}

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

/// What a leaf refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// Anything at its own time; never a delayed signal.
    Now(Leaf),
    /// A signal at an earlier time; the delay is an expression of the new graph.
    Earlier(Signal, ExprId),
}

impl Graph {
    /// A reference as it is.
    pub fn reference(&mut self, reference: Reference) -> ExprId {
        match reference {
            Reference::Now(leaf) => self.leaf(leaf),
            Reference::Earlier(signal, tau) => self.delay(signal, tau),
        }
    }

    /// The expressions `roots` of this graph built anew in `into`, where `reference` says what becomes of each leaf.
    /// Delays that no root needs are left behind.
    pub fn rebuild(
        &self,
        roots: &[ExprId],
        into: &mut Graph,
        mut reference: impl FnMut(&mut Graph, Reference) -> ExprId,
    ) -> Vec<ExprId> {
        let mut moved = vec![ExprId::NONE; self.nodes.len()];
        for e in self.reachable(roots.iter().copied().chain(self.delays_of(roots))) {
            moved[e.index()] = match self.node(e) {
                Node::Constant(bits) => into.number(f64::from_bits(bits)),
                Node::Leaf(Leaf::Delayed(k)) => {
                    let delayed = self.delayed[k as usize];
                    reference(into, Reference::Earlier(delayed.signal, moved[delayed.tau.index()]))
                }
                Node::Leaf(leaf) => reference(into, Reference::Now(leaf)),
                Node::Apply(op, args) => {
                    let args = args.map(|a| moved.get(a.index()).copied().unwrap_or(a));
                    into.apply(op, &args[..op.row().arity])
                }
            };
        }
        roots.iter().map(|r| moved[r.index()]).collect()
    }

    /// The delays of the delayed signals that `roots` need, one for each signal.
    pub fn delays_of(&self, roots: &[ExprId]) -> Vec<ExprId> {
        let tau = |e: ExprId| match self.node(e) {
            Node::Leaf(Leaf::Delayed(k)) => Some(self.delayed[k as usize].tau),
            _ => None,
        };
        self.reachable(roots.iter().copied()).into_iter().filter_map(tau).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_expressions_are_one_node() {
        let mut g = Graph::default();
        let (x, y) = (g.leaf(Leaf::State(0)), g.leaf(Leaf::State(1)));
        let a = g.apply(Op::Mul, &[x, y]);
        let b = g.apply(Op::Mul, &[y, x]);
        assert_eq!(a, b, "products commute exactly");
        assert_ne!(g.apply(Op::Sub, &[x, y]), g.apply(Op::Sub, &[y, x]));
    }

    #[test]
    fn evaluates_without_recursion() {
        let mut g = Graph::default();
        let x = g.leaf(Leaf::State(0));
        let mut e = g.leaf(Leaf::Time);
        for _ in 0..200_000 {
            let s = g.apply(Op::Sin, &[e]);
            e = g.apply(Op::Add, &[s, x]);
        }
        assert!(g.evaluate(e, |_| 0.5).is_finite());
    }
}

#[cfg(test)]
mod rebuild_tests {
    use super::*;
    use crate::op::Op;

    #[test]
    fn leaves_are_replaced_also_where_they_are_delayed() {
        let mut old = Graph::default();
        let (x, tau, unused) = (old.leaf(Leaf::State(0)), old.leaf(Leaf::Param(0)), old.leaf(Leaf::Param(1)));
        let (late, _) = (old.delay(Signal::State(0), tau), old.delay(Signal::State(1), unused));
        let sum = old.apply(Op::Add, &[x, late]);
        let mut new = Graph::default();
        let moved = old.rebuild(&[sum], &mut new, |g, reference| match reference {
            Reference::Now(Leaf::State(0)) => g.leaf(Leaf::Input(7)),
            Reference::Earlier(Signal::State(0), tau) => g.delay(Signal::Input(7), tau),
            other => g.reference(other),
        });
        assert_eq!(new.delayed().iter().map(|d| d.signal).collect::<Vec<_>>(), [Signal::Input(7)]);
        let value = new.evaluate(moved[0], |leaf| match leaf {
            Leaf::Input(7) => 2.0,
            Leaf::Delayed(0) => 5.0,
            other => panic!("{other:?}"),
        });
        assert_eq!(value, 7.0);
    }
}
