//! Partials of every equation with their sparsity, as expressions of the same graph.
//!
//! **In** a checked [`Model`]. **Out** [`Derivatives`]: f_x, f_u, f_delay, f_theta, h_x ..., x0_theta, tau_theta.
//! **Never** differences: everything is exact; `fdm check` compares with complex steps afterwards.
//! **Start** at [`differentiate`].
//!
//! Tangents are propagated forward, one leaf at a time, because a choice (`if`, `min`, `abs`) must choose between
//! derivatives: a reverse sweep would multiply the branch not taken by zero, and zero times infinity is NaN
//! (`if x > 0 then sqrt(x) else 0` at x = 0). Structural zeros never become nodes. Where sweeps of all leaves would come over the
//! same long ways again and again, a way behind which nothing chooses is gone once for all of them (`Funnels`).
//!
//! Where rates have kinks: the switching functions of `max`, `min`, `abs` and `if`, whose sign says which branch counts.
//!
//! Tangents forward through the graph: from one node to what depends on it.
//!
//! Nodes through which every way from another one to the roots leads: what lies behind them is differentiated once.
//!
//! By the leaves of a product of a thousand factors, forward sweeps make half a million nodes. With the derivative of the root by
//! each partial product, which follows from that by the next one, they make a few thousand. The order of multiplication
//! differs from that of a sweep, so small models keep their sweeps. Behind a funnel nothing may choose, and nothing may be
//! infinitely steep: zero times the infinite derivative of a branch that is not taken, or of `sqrt` at zero, is no number.

use crate::graph::{Graph, Leaf, Node};
use crate::model::Model;
use crate::op::{Build, ExprId, Form, Op, Tangents};
use std::collections::BTreeMap;

#[cfg(test)]
mod tests;

/// Which entries of a Jacobian can be other than zero, row by row.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Pattern {
    /// `rows[i]..rows[i + 1]` are the entries of row i; length rows + 1.
    pub rows: Vec<u32>,
    /// Column of each entry, ascending within a row.
    pub columns: Vec<u32>,
}

impl Pattern {
    /// Number of structural nonzeros.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Whether every entry is a structural zero.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// The entries (position, column) of a row.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let range = self.rows[i] as usize..self.rows[i + 1] as usize;
        range.map(|k| (k, self.columns[k] as usize))
    }

    /// All entries as (position, row, column).
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        (0..self.rows.len().saturating_sub(1)).flat_map(move |i| self.row(i).map(move |(k, j)| (k, i, j)))
    }
}

/// A sparse Jacobian of expressions.
#[derive(Debug, Clone, Default)]
pub struct Jacobian {
    /// Where the entries stand.
    pub pattern: Pattern,
    /// The entries, in the order of the pattern.
    pub entries: Vec<ExprId>,
}

/// Partials of one group of equations by each kind of leaf.
#[derive(Debug, Clone, Default)]
pub struct Partials {
    /// By states.
    pub state: Jacobian,
    /// By inputs.
    pub input: Jacobian,
    /// By delayed signals.
    pub delayed: Jacobian,
    /// By parameters, `fixed` ones left out.
    pub param: Jacobian,
}

/// All partials of a model.
#[derive(Debug, Clone, Default)]
pub struct Derivatives {
    /// Of the rates f.
    pub rates: Partials,
    /// Of the outputs h.
    pub outputs: Partials,
    /// Of the initial values, by parameters.
    pub initial: Jacobian,
    /// Of the delays, by parameters.
    pub tau: Jacobian,
    /// Of the lower and the upper limit of every state that has them, by parameters.
    pub limits: Jacobian,
    /// The switching functions of the rates, of a model without events.
    pub kinks: Vec<ExprId>,
    /// Of the guards of all events, then of the values that they set; or of the switching functions.
    pub events: Partials,
    /// Of the guards of all events, then of the values that they set, by time.
    pub events_by_time: Jacobian,
    /// Of the rates by time, where there are events, limits or kinks: elsewhere nothing asks for it.
    pub rates_by_time: Jacobian,
}

/// The graph of a model's derivatives has more nodes than were allowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Swollen;

/// Differentiates every equation of the model by every leaf it depends on; new nodes join the model's graph.
pub fn differentiate(model: &mut Model) -> Derivatives {
    differentiate_within(model, u32::MAX as usize).unwrap_or_default()
}

/// Differentiates every equation of the model by every leaf it depends on, as long as the graph does not have more
/// nodes than `most` by then.
///
/// # Errors
/// [`Swollen`]; what joined the graph by then is still there.
pub fn differentiate_within(model: &mut Model, most: usize) -> Result<Derivatives, Swollen> {
    let rates: Vec<ExprId> = model.states.iter().map(|s| s.rate).collect();
    let outputs: Vec<ExprId> = model.outputs.iter().map(|o| o.expr).collect();
    let initial: Vec<ExprId> = model.states.iter().map(|s| s.initial).collect();
    let tau: Vec<ExprId> = model.graph.delayed().iter().map(|d| d.tau).collect();
    let limits: Vec<ExprId> = model.limits().flat_map(|(_, l)| [l.lower, l.upper]).collect();
    let kinks = switching(model);
    let list = model.events();
    let resets = list.iter().flat_map(|event| event.resets.iter().map(|(_, value)| *value));
    let guards = list.iter().map(|event| event.guard).chain(kinks.iter().copied());
    let events: Vec<ExprId> = guards.chain(resets).collect();
    let roots = [&rates[..], &outputs[..], &initial[..], &tau[..], &limits[..], &events[..]].concat();
    let free: Vec<bool> = model.params.iter().map(|p| !p.fixed).collect();
    let sweep = Sweep::new(&model.graph, &roots);
    let wanted = |leaf| match leaf {
        Leaf::Time => !events.is_empty() || !limits.is_empty(),
        Leaf::Param(k) => free[k as usize],
        _ => true,
    };
    let columns = sweep.tangents(&mut model.graph, wanted, most)?;
    let block = |from: usize, len: usize, kind: fn(Leaf) -> Option<u32>| gather(&columns, from, len, kind);
    let partials = |from: usize, len: usize| Partials {
        state: block(from, len, |l| if let Leaf::State(k) = l { Some(k) } else { None }),
        input: block(from, len, |l| if let Leaf::Input(k) = l { Some(k) } else { None }),
        delayed: block(from, len, |l| if let Leaf::Delayed(k) = l { Some(k) } else { None }),
        param: block(from, len, by_param),
    };
    let (n, q) = (rates.len(), outputs.len());
    let by_time = |l| matches!(l, Leaf::Time).then_some(0);
    let behind = n + q + n + tau.len() + limits.len();
    Ok(Derivatives {
        rates: partials(0, n),
        outputs: partials(n, q),
        initial: block(n + q, n, by_param),
        tau: block(n + q + n, tau.len(), by_param),
        limits: block(n + q + n + tau.len(), limits.len(), by_param),
        kinks,
        events: partials(behind, events.len()),
        events_by_time: block(behind, events.len(), by_time),
        rates_by_time: block(0, n, by_time),
    })
}

/// The derivatives of expressions by the leaves that `wanted` accepts: for each leaf (root, derivative), structural zeros
/// left out; new nodes join the graph.
pub fn tangents(
    graph: &mut Graph,
    roots: &[ExprId],
    wanted: impl Fn(Leaf) -> bool,
) -> BTreeMap<Leaf, Vec<(u32, ExprId)>> {
    Sweep::new(graph, roots).tangents(graph, wanted, u32::MAX as usize).unwrap_or_default()
}

fn by_param(leaf: Leaf) -> Option<u32> {
    if let Leaf::Param(k) = leaf { Some(k) } else { None }
}

fn gather(columns: &BTreeMap<Leaf, Column>, from: usize, len: usize, kind: impl Fn(Leaf) -> Option<u32>) -> Jacobian {
    let mut rows: Vec<Vec<(u32, ExprId)>> = vec![Vec::new(); len];
    for (leaf, column) in columns {
        let Some(j) = kind(*leaf) else { continue };
        for (root, d) in column {
            if let Some(row) = (*root as usize).checked_sub(from).and_then(|i| rows.get_mut(i)) {
                row.push((j, *d));
            }
        }
    }
    let mut jacobian = Jacobian { pattern: Pattern { rows: vec![0], columns: Vec::new() }, entries: Vec::new() };
    for row in rows {
        for (j, d) in row {
            jacobian.pattern.columns.push(j);
            jacobian.entries.push(d);
        }
        jacobian.pattern.rows.push(jacobian.entries.len() as u32);
    }
    jacobian
}

/// The switching functions of the rates that change during a run; new nodes join the graph. Knots of tables are among them, since tables are
/// sums of `min` and `max`. Hard limits are not: who takes steps knows them as such. Nor are the jumps of `sign`, behind which nothing goes
/// on as before. A model with events or delays has none: they have instants of their own, or a past that does not know of any.
fn switching(model: &mut Model) -> Vec<ExprId> {
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

/// The tangents of all roots by one leaf: (root, derivative), structural zeros left out.
type Column = Vec<(u32, ExprId)>;

/// How often the sweeps of all leaves together may come over a node, on average, before ways that many of them share are gone
/// once; and how often in small models.
const MOST_VISITS: usize = 30;
const FEW_VISITS: usize = 20_000;

/// What a sweep needs: the nodes below the roots, and who uses whom.
struct Sweep {
    /// For each node the roots that it is.
    roots: Lists,
    users: Lists,
    leaves: Vec<(ExprId, Leaf)>,
}

/// A list of numbers for each node, all in one array.
struct Lists {
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

    fn of(&self, node: u32) -> &[u32] {
        &self.items[self.starts[node as usize] as usize..self.starts[node as usize + 1] as usize]
    }

    fn nodes(&self) -> usize {
        self.starts.len() - 1
    }
}

impl Sweep {
    fn new(graph: &Graph, roots: &[ExprId]) -> Self {
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
    fn tangents(
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
    fn by(
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
struct Forward<'s> {
    sweep: &'s Sweep,
    tangent: Vec<Option<ExprId>>,
    seen: Vec<bool>,
}

impl<'s> Forward<'s> {
    fn new(sweep: &'s Sweep) -> Self {
        let nodes = sweep.users.nodes();
        Self { sweep, tangent: vec![None; nodes], seen: vec![false; nodes] }
    }

    /// The derivatives of all roots by a node.
    fn column(&mut self, graph: &mut Graph, from: ExprId) -> Column {
        let touched = self.run(graph, from, None);
        let roots = &self.sweep.roots;
        let hit = |k: &u32| self.tangent[*k as usize].map(|d| roots.of(*k).iter().map(move |root| (*root, d)));
        let mut column: Column = touched.iter().filter_map(hit).flatten().collect();
        column.sort_unstable_by_key(|(root, _)| *root);
        self.forget(&touched);
        column
    }

    /// The derivative of a node by another one from which all ways to the roots lead through it.
    fn across(&mut self, graph: &mut Graph, from: ExprId, to: u32) -> Option<ExprId> {
        let touched = self.run(graph, from, Some(to));
        let d = self.tangent[to as usize];
        self.forget(&touched);
        d
    }

    /// The nodes that use a node, each with its derivative by that node alone.
    fn locals(&mut self, graph: &mut Graph, node: u32) -> Vec<(u32, Option<ExprId>)> {
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
fn product(graph: &mut Graph, a: ExprId, b: ExprId) -> Option<ExprId> {
    let d = graph.apply(Op::Mul, &[a, b]);
    (graph.constant(d) != Some(0.0)).then_some(d)
}

/// The sum of two derivatives; none when it is structurally zero.
fn sum(graph: &mut Graph, a: Option<ExprId>, b: Option<ExprId>) -> Option<ExprId> {
    match (a, b) {
        (Some(a), Some(b)) => Some(graph.apply(Op::Add, &[a, b])).filter(|d| graph.constant(*d) != Some(0.0)),
        (one, None) | (None, one) => one,
    }
}

/// No node: ways part before the roots, or end in one.
const NONE: u32 = u32::MAX;

/// The nearest funnel of each node (its immediate postdominator), and the derivatives that are known.
struct Funnels {
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
    fn new(forward: &mut Forward<'_>, graph: &mut Graph, wanted: impl Fn(Leaf) -> bool) -> Self {
        let (sweep, depends) = (forward.sweep, graph.depends(wanted));
        let nodes = sweep.users.nodes();
        let (next, chosen, last) = (vec![NONE; nodes], vec![false; nodes], vec![(NONE, None); nodes]);
        let mut funnels = Self { next, chosen, last, columns: BTreeMap::new() };
        // steps towards the roots, for each node, in search of the funnels; what is not found then is swept over
        let (mut steps, one) = (64 * nodes, graph.number(1.0));
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
    fn column(&mut self, graph: &mut Graph, forward: &mut Forward<'_>, leaf: ExprId) -> Column {
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
