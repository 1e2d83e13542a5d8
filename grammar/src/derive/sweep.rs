//! Tangents forward through the graph: from one node to what depends on it.

use super::Swollen;
use super::funnels::Funnels;
use crate::graph::{Graph, Leaf, Node};
use crate::op::{Build, ExprId, Op, Tangents};
use std::collections::BTreeMap;

/// The tangents of all roots by one leaf: (root, derivative), structural zeros left out.
pub(super) type Column = Vec<(u32, ExprId)>;

/// How often the sweeps of all leaves together may come over a node, on average, before ways that many of them share are gone
/// once; and how often in small models.
const MOST_VISITS: usize = 30;
const FEW_VISITS: usize = 20_000;

/// What a sweep needs: the nodes below the roots, and who uses whom.
pub(super) struct Sweep {
    /// For each node the roots that it is.
    pub(super) roots: Lists,
    pub(super) users: Lists,
    leaves: Vec<(ExprId, Leaf)>,
}

/// A list of numbers for each node, all in one array.
pub(super) struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    /// `pairs` of node and item; items keep their order.
    fn new(nodes: usize, pairs: impl Iterator<Item = (ExprId, u32)> + Clone) -> Self {
        let mut starts = vec![0; nodes + 1];
        pairs.clone().for_each(|(e, _)| starts[e.index() + 1] += 1);
        for k in 0..nodes {
            starts[k + 1] += starts[k];
        }
        let (mut next, mut items) = (starts.clone(), vec![0; starts[nodes] as usize]);
        for (e, item) in pairs {
            items[next[e.index()] as usize] = item;
            next[e.index()] += 1;
        }
        Self { starts, items }
    }

    pub(super) fn of(&self, node: u32) -> &[u32] {
        &self.items[self.starts[node as usize] as usize..self.starts[node as usize + 1] as usize]
    }

    pub(super) fn nodes(&self) -> usize {
        self.starts.len() - 1
    }
}

impl Sweep {
    pub(super) fn new(graph: &Graph, roots: &[ExprId]) -> Self {
        let (nodes, reachable) = (graph.nodes().len(), graph.reachable(roots.iter().copied()));
        let leaf = |e: &ExprId| match graph.node(*e) {
            Node::Leaf(leaf) => Some((*e, leaf)),
            _ => None,
        };
        Self {
            roots: Lists::new(nodes, roots.iter().enumerate().map(|(i, r)| (*r, i as u32))),
            users: Lists::new(nodes, reachable.iter().flat_map(|e| graph.operands(*e).iter().map(|a| (*a, e.0)))),
            leaves: reachable.iter().filter_map(leaf).collect(),
        }
    }

    /// The derivatives of all roots by the leaves that `wanted` accepts; new nodes join the graph.
    ///
    /// # Errors
    /// [`Swollen`] when the graph then has more nodes than `most`.
    pub(super) fn tangents(
        &self,
        graph: &mut Graph,
        wanted: impl Fn(Leaf) -> bool,
        most: usize,
    ) -> Result<BTreeMap<Leaf, Column>, Swollen> {
        let (mut forward, mut leaves) = (Forward::new(self), self.leaves.iter().filter(|(_, leaf)| wanted(*leaf)));
        let (mut visits, few) = (0, FEW_VISITS + MOST_VISITS * self.users.items.len());
        let short = leaves.all(|(e, _)| {
            visits += forward.dependents(*e, None).len();
            visits <= few
        });
        self.by(graph, wanted, !short, most)
    }

    /// Derivatives by one of both ways: a sweep for each leaf, or one backwards.
    pub(super) fn by(
        &self,
        graph: &mut Graph,
        wanted: impl Fn(Leaf) -> bool,
        funnels: bool,
        most: usize,
    ) -> Result<BTreeMap<Leaf, Column>, Swollen> {
        let leaves = self.leaves.iter().filter(|(_, leaf)| wanted(*leaf));
        let mut forward = Forward::new(self);
        let mut funnels = funnels.then(|| Funnels::new(&mut forward, graph, &wanted));
        let column = |(e, leaf): &(ExprId, Leaf)| {
            let column = match &mut funnels {
                Some(funnels) => funnels.column(graph, &mut forward, *e),
                None => forward.column(graph, *e),
            };
            if graph.nodes().len() <= most { Ok((*leaf, column)) } else { Err(Swollen) }
        };
        leaves.map(column).collect()
    }
}

/// The memory of sweeps; between them nothing is seen and nothing has a tangent.
pub(super) struct Forward<'s> {
    pub(super) sweep: &'s Sweep,
    tangent: Vec<Option<ExprId>>,
    seen: Vec<bool>,
}

impl<'s> Forward<'s> {
    fn new(sweep: &'s Sweep) -> Self {
        let nodes = sweep.users.nodes();
        Self { sweep, tangent: vec![None; nodes], seen: vec![false; nodes] }
    }

    /// The derivatives of all roots by a node.
    pub(super) fn column(&mut self, graph: &mut Graph, from: ExprId) -> Column {
        let touched = self.run(graph, from, None);
        let roots = &self.sweep.roots;
        let hit = |k: &u32| self.tangent[*k as usize].map(|d| roots.of(*k).iter().map(move |root| (*root, d)));
        let mut column: Column = touched.iter().filter_map(hit).flatten().collect();
        column.sort_unstable_by_key(|(root, _)| *root);
        self.forget(&touched);
        column
    }

    /// The derivative of a node by another one from which all ways to the roots lead through it.
    pub(super) fn across(&mut self, graph: &mut Graph, from: ExprId, to: u32) -> Option<ExprId> {
        let touched = self.run(graph, from, Some(to));
        let d = self.tangent[to as usize];
        self.forget(&touched);
        d
    }

    /// The nodes that use a node, each with its derivative by that node alone.
    pub(super) fn locals(&mut self, graph: &mut Graph, node: u32) -> Vec<(u32, Option<ExprId>)> {
        let mut users = self.sweep.users.of(node).to_vec();
        users.dedup();
        self.tangent[node as usize] = Some(graph.number(1.0));
        let locals = users.iter().map(|u| (*u, tangent_of(graph, ExprId(*u), &self.tangent))).collect();
        self.tangent[node as usize] = None;
        locals
    }

    fn run(&mut self, graph: &mut Graph, from: ExprId, to: Option<u32>) -> Vec<u32> {
        let touched = self.dependents(from, to);
        self.tangent[from.index()] = Some(graph.number(1.0));
        for k in touched.iter().skip(1) {
            self.tangent[*k as usize] = tangent_of(graph, ExprId(*k), &self.tangent);
        }
        touched
    }

    fn forget(&mut self, touched: &[u32]) {
        touched.iter().for_each(|k| self.tangent[*k as usize] = None);
    }

    /// A node and every node that depends on it, in topological order; what depends on it by way of `to` alone is left out.
    fn dependents(&mut self, from: ExprId, to: Option<u32>) -> Vec<u32> {
        let mut order = vec![from.0];
        self.seen[from.index()] = true;
        let mut next = 0;
        while next < order.len() {
            let node = order[next];
            next += 1;
            if to == Some(node) {
                continue;
            }
            for u in self.sweep.users.of(node) {
                if !std::mem::replace(&mut self.seen[*u as usize], true) {
                    order.push(*u);
                }
            }
        }
        order.iter().for_each(|k| self.seen[*k as usize] = false);
        order.sort_unstable();
        order
    }
}

fn tangent_of(graph: &mut Graph, e: ExprId, tangent: &[Option<ExprId>]) -> Option<ExprId> {
    let Node::Apply(op, args) = graph.node(e) else { return None };
    let mut tangents: Tangents = [None; 3];
    for (t, a) in tangents.iter_mut().zip(&args[..op.row().arity]) {
        *t = tangent[a.index()];
    }
    let d = (op.row().tangent)(graph, args, e, tangents)?;
    (graph.constant(d) != Some(0.0)).then_some(d)
}

/// The product of two derivatives; none when it is structurally zero.
pub(super) fn product(graph: &mut Graph, a: ExprId, b: ExprId) -> Option<ExprId> {
    let d = graph.apply(Op::Mul, &[a, b]);
    (graph.constant(d) != Some(0.0)).then_some(d)
}

/// The sum of two derivatives; none when it is structurally zero.
pub(super) fn sum(graph: &mut Graph, a: Option<ExprId>, b: Option<ExprId>) -> Option<ExprId> {
    match (a, b) {
        (Some(a), Some(b)) => Some(graph.apply(Op::Add, &[a, b])).filter(|d| graph.constant(*d) != Some(0.0)),
        (one, None) | (None, one) => one,
    }
}
