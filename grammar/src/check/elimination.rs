//! Coupled derivatives solved for: Gaussian elimination on expressions, pivots chosen for few new terms (Markowitz 1957), then numbers
//! before parameters before what varies. Equal parts are one node, so that the result grows with the work and no faster.

use super::start::Start;
use crate::graph::{Graph, Node};
use crate::op::{Build, ExprId, Op};
use std::collections::BTreeMap;

/// `sum coefficient*derivative = rest`.
pub(super) struct Row {
    /// By state.
    pub(super) terms: BTreeMap<usize, Entry>,
    /// The right side.
    pub(super) rest: ExprId,
}

/// A coefficient.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// What it is.
    pub(super) expr: ExprId,
    /// Size of what it was subtracted from, at the start values; against it rounding is judged.
    pub(super) scale: f64,
}

/// Why equations do not determine their derivatives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Singular {
    /// Whatever the parameters; the rows that are left.
    Always(Vec<usize>),
    /// At the start values.
    AtStart(Vec<usize>),
    /// More would be written than a model should have: the leaves below the equations.
    TooLong(usize),
}

/// Most products that one set of coupled equations may need, times the leaves by which each may have a derivative.
pub(super) const MOST_WORK: usize = 4_000_000;
/// Fewer products are always possible.
const FEW: usize = 1000;

/// A pivot smaller than this part of its column loses digits.
const THRESHOLD: f64 = 0.01;

/// State and derivative of every row.
pub(super) fn solve(
    graph: &mut Graph,
    mut rows: Vec<Row>,
    start: &mut Start<'_>,
) -> Result<Vec<(usize, ExprId)>, Singular> {
    let mut left: Vec<usize> = (0..rows.len()).collect();
    let mut pivots: Vec<(usize, usize)> = Vec::with_capacity(rows.len());
    let (mut products, mut leaves) = (0, None);
    while !left.is_empty() {
        start.look(graph);
        let (row, state) = pivot(graph, &rows, &left, start)?;
        left.retain(|k| *k != row);
        let users: Vec<usize> = left.iter().copied().filter(|k| rows[*k].terms.contains_key(&state)).collect();
        products += users.len() * rows[row].terms.len();
        if products > FEW {
            let leaves = *leaves.get_or_insert_with(|| leaves_below(graph, &rows));
            if products * leaves > MOST_WORK {
                return Err(Singular::TooLong(leaves));
            }
        }
        for k in users {
            eliminate(graph, &mut rows, (row, state), k, start);
        }
        pivots.push((row, state));
    }
    let mut solved: BTreeMap<usize, ExprId> = BTreeMap::new();
    for (row, state) in pivots.into_iter().rev() {
        let mut rest = rows[row].rest;
        for (other, entry) in rows[row].terms.iter().filter(|(other, _)| **other != state) {
            if let Some(rate) = solved.get(other) {
                let product = graph.apply(Op::Mul, &[entry.expr, *rate]);
                rest = graph.apply(Op::Sub, &[rest, product]);
            }
        }
        let rate = rows[row].terms.get(&state).map_or(rest, |p| graph.apply(Op::Div, &[rest, p.expr]));
        solved.insert(state, rate);
    }
    Ok(solved.into_iter().collect())
}

/// How many leaves equations depend on.
fn leaves_below(graph: &Graph, rows: &[Row]) -> usize {
    let roots = rows.iter().flat_map(|row| row.terms.values().map(|e| e.expr).chain([row.rest]));
    graph.reachable(roots).into_iter().filter(|e| matches!(graph.node(*e), Node::Leaf(_))).count()
}

/// Subtracts a multiple of the pivot's row from row k.
fn eliminate(graph: &mut Graph, rows: &mut [Row], (row, state): (usize, usize), k: usize, start: &mut Start<'_>) {
    let (Some(p), Some(a)) = (rows[row].terms.get(&state).copied(), rows[k].terms.remove(&state)) else { return };
    let factor = graph.apply(Op::Div, &[a.expr, p.expr]);
    let others: Vec<(usize, Entry)> =
        rows[row].terms.iter().filter(|(s, _)| **s != state).map(|(s, e)| (*s, *e)).collect();
    let zero = graph.number(0.0);
    for (s, entry) in others {
        let product = graph.apply(Op::Mul, &[factor, entry.expr]);
        let before = rows[k].terms.get(&s).copied().unwrap_or(Entry { expr: zero, scale: 0.0 });
        let expr = graph.apply(Op::Sub, &[before.expr, product]);
        start.look(graph);
        if graph.constant(expr) == Some(0.0) {
            rows[k].terms.remove(&s);
        } else {
            let sizes = [start.value(product).abs(), start.value(before.expr).abs()];
            let scale = sizes.into_iter().fold(before.scale, f64::max);
            rows[k].terms.insert(s, Entry { expr, scale });
        }
    }
    let product = graph.apply(Op::Mul, &[factor, rows[row].rest]);
    rows[k].rest = graph.apply(Op::Sub, &[rows[k].rest, product]);
}

/// The best pivot: its row and state.
fn pivot(graph: &Graph, rows: &[Row], left: &[usize], start: &Start<'_>) -> Result<(usize, usize), Singular> {
    let mut columns: BTreeMap<usize, (usize, f64)> = BTreeMap::new();
    for (state, entry) in left.iter().flat_map(|k| &rows[*k].terms) {
        let column = columns.entry(*state).or_insert((0, 0.0));
        *column = (column.0 + 1, column.1.max(start.value(entry.expr).abs()));
    }
    let mut best: Option<((usize, u8), (usize, usize))> = None;
    for k in left {
        for (state, entry) in &rows[*k].terms {
            let (users, largest) = columns[state];
            let value = start.value(entry.expr).abs();
            // what is not known at the start may be anything
            // what is lost to rounding, relative to what was subtracted
            if value <= 1e-12 * entry.scale || value == 0.0 || value < THRESHOLD * largest {
                continue;
            }
            let kind = match graph.constant(entry.expr) {
                Some(v) if v.abs() == 1.0 => 0,
                Some(_) => 1,
                None if !start.varies(entry.expr) => 2,
                None => 3,
            };
            let cost = ((users - 1) * (rows[*k].terms.len() - 1), kind);
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, (*k, *state)));
            }
        }
    }
    let left = || left.to_vec();
    best.map(|(_, place)| place)
        .ok_or_else(|| if columns.is_empty() { Singular::Always(left()) } else { Singular::AtStart(left()) })
}
