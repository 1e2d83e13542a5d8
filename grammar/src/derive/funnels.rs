//! Nodes through which every way from another one to the roots leads: what lies behind them is differentiated once.
//!
//! By the leaves of a product of a thousand factors, forward sweeps make half a million nodes. With the derivative of the root by
//! each partial product, which follows from that by the next one, they make a few thousand. The order of multiplication
//! differs from that of a sweep, so small models keep their sweeps. Behind a funnel nothing may choose, and nothing may be
//! infinitely steep: zero times the infinite derivative of a branch that is not taken, or of `sqrt` at zero, is no number.

use super::sweep::{Column, Forward, product, sum};
use crate::graph::{Graph, Leaf, Node};
use crate::op::{Build, ExprId, Form, Op};
use std::collections::BTreeMap;

/// No node: ways part before the roots, or end in one.
const NONE: u32 = u32::MAX;
/// Steps towards the roots, for each node, in search of the funnels; what is not found then is swept over.
const PATIENCE: usize = 64;

/// The nearest funnel of each node (its immediate postdominator), and the derivatives that are known.
pub(super) struct Funnels {
    next: Vec<u32>,
    /// Whether anything that depends on the node chooses.
    chosen: Vec<bool>,
    /// For nodes behind which nothing chooses the last funnel, or the node itself, and its derivative by the node.
    last: Vec<(u32, Option<ExprId>)>,
    /// The derivatives of the roots by last funnels.
    columns: BTreeMap<u32, Column>,
}

impl Funnels {
    /// Goes from the roots back, over the nodes that depend on what is `wanted`, each once.
    pub(super) fn new(forward: &mut Forward<'_>, graph: &mut Graph, wanted: impl Fn(Leaf) -> bool) -> Self {
        let (sweep, depends) = (forward.sweep, graph.depends(wanted));
        let nodes = sweep.users.nodes();
        let (next, chosen, last) = (vec![NONE; nodes], vec![false; nodes], vec![(NONE, None); nodes]);
        let mut funnels = Self { next, chosen, last, columns: BTreeMap::new() };
        let (mut steps, one) = (PATIENCE * nodes, graph.number(1.0));
        for k in (0..nodes).rev().filter(|k| depends[*k]) {
            let users = sweep.users.of(k as u32);
            let chooses = |u: &u32| match graph.node(ExprId(*u)) {
                Node::Apply(Op::Pow, [_, exponent, _]) => graph.constant(exponent).is_none_or(|e| e < 1.0),
                // the derivative by a list is no number
                Node::Apply(op, _) => op.chooses() || op.is_steep() || op.row().form == Form::External,
                _ => false,
            };
            funnels.chosen[k] = users.iter().any(|u| funnels.chosen[*u as usize] || chooses(u));
            if sweep.roots.of(k as u32).is_empty() {
                let meet = users.iter().copied().reduce(|a, b| meet(&funnels.next, a, b, &mut steps));
                funnels.next[k] = meet.unwrap_or(NONE);
            }
            funnels.last[k] = funnels.back(graph, forward, k as u32).unwrap_or((k as u32, Some(one)));
        }
        funnels
    }

    /// The last funnel of a node and its derivative by the node; none where the node is the last one.
    fn back(&self, graph: &mut Graph, forward: &mut Forward<'_>, node: u32) -> Option<(u32, Option<ExprId>)> {
        let next = self.next[node as usize];
        if next == NONE || self.chosen[node as usize] {
            return None;
        }
        let (last, mut total) = (self.last[next as usize].0, None);
        for (user, local) in forward.locals(graph, node) {
            let (end, rest) = self.last[user as usize];
            if end != last {
                // what was not found in time
                return None;
            }
            let part = local.zip(rest).and_then(|(local, rest)| product(graph, local, rest));
            total = sum(graph, total, part);
        }
        Some((last, total))
    }

    /// The derivatives of all roots by a leaf.
    pub(super) fn column(&mut self, graph: &mut Graph, forward: &mut Forward<'_>, leaf: ExprId) -> Column {
        let mut first = leaf.0;
        while first != NONE && self.chosen[first as usize] {
            first = self.next[first as usize];
        }
        if first == NONE {
            return forward.column(graph, leaf);
        }
        let mut column = BTreeMap::new();
        if first != leaf.0 {
            let inner = forward.across(graph, leaf, first);
            self.add(graph, forward, (first, inner), &mut column);
        } else if self.last[first as usize].0 != first {
            let one = graph.number(1.0);
            self.add(graph, forward, (first, Some(one)), &mut column);
        } else {
            // its ways part at once
            let one = graph.number(1.0);
            column.extend(forward.sweep.roots.of(first).iter().map(|root| (*root, one)));
            for use_of in forward.locals(graph, first) {
                self.add(graph, forward, use_of, &mut column);
            }
        }
        column.into_iter().collect()
    }

    /// Adds what a node with this derivative does to the roots.
    fn add(
        &mut self,
        graph: &mut Graph,
        forward: &mut Forward<'_>,
        (node, inner): (u32, Option<ExprId>),
        column: &mut BTreeMap<u32, ExprId>,
    ) {
        let (last, outer) = self.last[node as usize];
        let factor = inner.zip(outer).and_then(|(inner, outer)| product(graph, inner, outer));
        let Some(factor) = factor else { return };
        let behind = self.columns.entry(last).or_insert_with(|| forward.column(graph, ExprId(last)));
        for (root, d) in behind {
            let part = product(graph, *d, factor);
            let total = sum(graph, column.get(root).copied(), part);
            match total {
                Some(total) => _ = column.insert(*root, total),
                None => _ = column.remove(root),
            }
        }
    }
}

/// The first node on the ways of both; users have greater numbers.
fn meet(next: &[u32], mut a: u32, mut b: u32, steps: &mut usize) -> u32 {
    while a != b {
        if *steps == 0 {
            return NONE;
        }
        *steps -= 1;
        if a < b {
            a = next[a as usize];
        } else {
            b = next[b as usize];
        }
    }
    a
}
