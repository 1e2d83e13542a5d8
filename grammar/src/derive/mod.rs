//! Partials of every equation with their sparsity, as expressions of the same graph.
//!
//! **In** a checked [`Model`]. **Out** [`Derivatives`]: f_x, f_u, f_delay, f_theta, h_x ..., x0_theta, tau_theta.
//! **Never** differences: everything is exact; `fdm check` compares with complex steps afterwards.
//! **Start** at [`differentiate`].
//!
//! Tangents are propagated forward, one leaf at a time, because a choice (`if`, `min`, `abs`) must choose between
//! derivatives: a reverse sweep would multiply the branch not taken by zero, and zero times infinity is NaN
//! (`if x > 0 then sqrt(x) else 0` at x = 0). Structural zeros never become nodes. Where sweeps of all leaves would come over the
//! same long ways again and again, a way behind which nothing chooses is gone once for all of them (`funnels.rs`).

mod funnels;
mod kinks;
mod sweep;
#[cfg(test)]
mod tests;

use crate::graph::{Graph, Leaf};
use crate::model::Model;
use crate::op::ExprId;
use std::collections::BTreeMap;
use sweep::{Column, Sweep};

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
    let kinks = kinks::switching(model);
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
