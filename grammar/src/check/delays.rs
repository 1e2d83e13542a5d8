//! Delays pushed down to signals: a delayed expression is the same expression of delayed signals.

use crate::graph::{Graph, Leaf, Node, Signal};
use crate::op::{Build, ExprId, Op};
use std::collections::HashMap;

/// Most delayed signals of a model, and most nodes that delays may copy: a chain of n nested sums of two delays
/// stands for 2^n delayed signals.
pub(super) const MOST_DELAYED: usize = 4096;
const MOST_COPIES: usize = 1_000_000;

/// More delayed signals than [`MOST_DELAYED`], or expressions too large to be delayed that often.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TooMany;

/// What delays need to know about the nodes of a graph that only grows, and what they have done before.
#[derive(Default)]
pub(super) struct Delays {
    varies: Vec<bool>,
    done: HashMap<(ExprId, ExprId), ExprId>,
}

impl Delays {
    /// `e` at the time `t - tau`: time, inputs, states and delayed signals are shifted, parameters stay. `tau` is an
    /// expression of parameters.
    pub(super) fn delay(&mut self, graph: &mut Graph, e: ExprId, tau: ExprId) -> Result<ExprId, TooMany> {
        if graph.constant(tau) == Some(0.0) {
            return Ok(e);
        }
        self.look(graph);
        for k in self.pending(graph, e, tau) {
            let shifted = match graph.node(k) {
                Node::Constant(_) => k,
                Node::Leaf(leaf) => shifted_leaf(graph, leaf, tau),
                Node::Apply(op, mut args) => {
                    let arity = op.row().arity;
                    for a in &mut args[..arity] {
                        *a = self.shifted(*a, tau);
                    }
                    graph.apply(op, &args[..arity])
                }
            };
            self.done.insert((k, tau), shifted);
            if graph.delayed().len() > MOST_DELAYED || self.done.len() > MOST_COPIES {
                return Err(TooMany);
            }
        }
        Ok(self.shifted(e, tau))
    }

    fn shifted(&self, e: ExprId, tau: ExprId) -> ExprId {
        self.done.get(&(e, tau)).copied().unwrap_or(e)
    }

    /// The nodes below `e` that vary and have not been shifted by `tau` yet, operands first.
    fn pending(&self, graph: &Graph, e: ExprId, tau: ExprId) -> Vec<ExprId> {
        let mut order = Vec::new();
        let mut seen: HashMap<ExprId, ()> = HashMap::new();
        let mut open = vec![e];
        while let Some(k) = open.pop() {
            let settled = !self.varies[k.index()] || self.done.contains_key(&(k, tau));
            if !settled && seen.insert(k, ()).is_none() {
                order.push(k);
                open.extend_from_slice(graph.operands(k));
            }
        }
        order.sort_unstable();
        order
    }

    /// Learns about the nodes that have joined the graph.
    fn look(&mut self, graph: &Graph) {
        for k in self.varies.len()..graph.nodes().len() {
            let e = ExprId(k as u32);
            let varies = match graph.node(e) {
                Node::Constant(_) | Node::Leaf(Leaf::Param(_)) => false,
                Node::Leaf(_) => true,
                Node::Apply(..) => graph.operands(e).iter().any(|a| self.varies[a.index()]),
            };
            self.varies.push(varies);
        }
    }
}

fn shifted_leaf(graph: &mut Graph, leaf: Leaf, tau: ExprId) -> ExprId {
    match leaf {
        Leaf::Time => {
            let t = graph.leaf(Leaf::Time);
            graph.apply(Op::Sub, &[t, tau])
        }
        Leaf::State(k) => graph.delay(Signal::State(k), tau),
        Leaf::Input(k) => graph.delay(Signal::Input(k), tau),
        Leaf::Param(_) => graph.leaf(leaf),
        Leaf::Delayed(k) => {
            let inner = graph.delayed()[k as usize];
            let sum = graph.apply(Op::Add, &[inner.tau, tau]);
            graph.delay(inner.signal, sum)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Input k at time s.
    fn signal(k: u32, s: f64) -> f64 {
        (1.3 * s + f64::from(k)).sin()
    }

    fn at(graph: &Graph, e: ExprId, t: f64, params: [f64; 2]) -> f64 {
        graph.evaluate(e, |leaf| match leaf {
            Leaf::Time => t,
            Leaf::Input(k) => signal(k, t),
            Leaf::State(k) => signal(k + 10, t),
            Leaf::Param(k) => params[k as usize],
            Leaf::Delayed(k) => {
                let d = graph.delayed()[k as usize];
                let tau = graph.evaluate(d.tau, |l| if let Leaf::Param(k) = l { params[k as usize] } else { f64::NAN });
                match d.signal {
                    Signal::Input(k) => signal(k, t - tau),
                    Signal::State(k) => signal(k + 10, t - tau),
                }
            }
        })
    }

    #[test]
    fn a_delayed_expression_is_the_expression_earlier() {
        let mut g = Graph::default();
        let (u, x, t) = (g.leaf(Leaf::Input(0)), g.leaf(Leaf::State(0)), g.leaf(Leaf::Time));
        let (a, tau) = (g.leaf(Leaf::Param(0)), g.leaf(Leaf::Param(1)));
        let (au, tx) = (g.apply(Op::Mul, &[a, u]), g.apply(Op::Mul, &[t, x]));
        let e = g.apply(Op::Add, &[au, tx]);
        let mut delays = Delays::default();
        let once = delays.delay(&mut g, e, tau).unwrap();
        let twice = delays.delay(&mut g, once, tau).unwrap();
        let p = [0.7, 0.25];
        assert!((at(&g, once, 3.0, p) - at(&g, e, 2.75, p)).abs() < 1e-15);
        assert!((at(&g, twice, 3.0, p) - at(&g, e, 2.5, p)).abs() < 1e-15);
        assert_eq!(delays.delay(&mut g, a, tau), Ok(a), "parameters do not change");
        let zero = g.number(0.0);
        assert_eq!(delays.delay(&mut g, e, zero), Ok(e));
    }

    #[test]
    fn doubling_delays_end_in_an_error() {
        let mut g = Graph::default();
        let mut e = g.leaf(Leaf::Input(0));
        let mut delays = Delays::default();
        for k in 0..60 {
            let (a, b) = (g.leaf(Leaf::Param(2 * k)), g.leaf(Leaf::Param(2 * k + 1)));
            let Ok(p) = delays.delay(&mut g, e, a) else { return };
            let Ok(q) = delays.delay(&mut g, e, b) else { return };
            e = g.apply(Op::Add, &[p, q]);
        }
        panic!("2^60 delayed signals");
    }
}
