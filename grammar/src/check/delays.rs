//! Delays pushed down to signals: a delayed expression is the same expression of delayed signals.
//!
//! Derivatives by time of what stands in `der(.)`: the chain rule over time, states, inputs and delayed signals.
//!
//! While a model is checked, `der(x)` of state k of n is the leaf `State(n + k)`; the equations are solved for these leaves
//! afterwards. `der(u)` of an input is a hidden input.

use crate::graph::{Graph, Leaf, Node, Signal};
use crate::op::{Build, ExprId, Op, Tangents};
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

/// A derivative of something that holds a derivative already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Twice;

/// Derivatives that were taken, and the hidden inputs that they need.
#[derive(Debug, Clone, Default)]
pub(super) struct Derivatives {
    states: u32,
    /// Inputs and records; hidden inputs for derivatives stand behind them.
    inputs: u32,
    /// The inputs (or records) whose derivatives are taken, in the order of their hidden inputs.
    slopes: Vec<u32>,
    /// Structural zeros are `None`.
    known: HashMap<ExprId, Option<ExprId>>,
}

impl Derivatives {
    /// For so many states, and inputs with records.
    pub(super) fn new(states: u32, inputs: u32) -> Self {
        Self { states, inputs, ..Self::default() }
    }

    /// The inputs whose derivatives are taken.
    pub(super) fn slopes(&self) -> &[u32] {
        &self.slopes
    }

    /// Number of states.
    pub(super) fn states(&self) -> u32 {
        self.states
    }

    /// The state of which a leaf is the derivative.
    pub(super) fn rate(&self, leaf: Leaf) -> Option<u32> {
        match leaf {
            Leaf::State(k) => k.checked_sub(self.states),
            _ => None,
        }
    }

    /// The derivative of an expression.
    pub(super) fn of(&mut self, graph: &mut Graph, e: ExprId) -> Result<ExprId, Twice> {
        for k in self.pending(graph, e) {
            let d = match graph.node(k) {
                Node::Constant(_) => None,
                Node::Leaf(leaf) => self.leaf(graph, leaf)?,
                Node::Apply(op, args) => {
                    let mut tangents: Tangents = [None; 3];
                    for (t, a) in tangents.iter_mut().zip(&args[..op.row().arity]) {
                        *t = self.known.get(a).copied().flatten();
                    }
                    (op.row().tangent)(graph, args, k, tangents).filter(|d| graph.constant(*d) != Some(0.0))
                }
            };
            self.known.insert(k, d);
        }
        Ok(self.known.get(&e).copied().flatten().unwrap_or_else(|| graph.number(0.0)))
    }

    /// Nodes below `e` that have no derivative yet, operands first.
    fn pending(&self, graph: &Graph, e: ExprId) -> Vec<ExprId> {
        let mut seen: HashMap<ExprId, ()> = HashMap::new();
        let (mut order, mut open) = (Vec::new(), vec![e]);
        while let Some(k) = open.pop() {
            if !self.known.contains_key(&k) && seen.insert(k, ()).is_none() {
                order.push(k);
                open.extend_from_slice(graph.operands(k));
            }
        }
        order.sort_unstable();
        order
    }

    fn leaf(&mut self, graph: &mut Graph, leaf: Leaf) -> Result<Option<ExprId>, Twice> {
        Ok(Some(match leaf {
            Leaf::Time => graph.number(1.0),
            Leaf::Param(_) => return Ok(None),
            Leaf::State(_) | Leaf::Input(_) => {
                let signal = if let Leaf::State(k) = leaf { Signal::State(k) } else { input(leaf) };
                match self.signal(signal)? {
                    Signal::State(k) => graph.leaf(Leaf::State(k)),
                    Signal::Input(k) => graph.leaf(Leaf::Input(k)),
                }
            }
            Leaf::Delayed(k) => {
                let delayed = graph.delayed()[k as usize];
                let signal = self.signal(delayed.signal)?;
                graph.delay(signal, delayed.tau)
            }
        }))
    }

    fn signal(&mut self, signal: Signal) -> Result<Signal, Twice> {
        match signal {
            Signal::State(k) if k < self.states => Ok(Signal::State(self.states + k)),
            Signal::Input(k) if k < self.inputs => {
                let place = self.slopes.iter().position(|s| *s == k).unwrap_or_else(|| {
                    self.slopes.push(k);
                    self.slopes.len() - 1
                });
                Ok(Signal::Input(self.inputs + place as u32))
            }
            _ => Err(Twice),
        }
    }
}

fn input(leaf: Leaf) -> Signal {
    if let Leaf::Input(k) = leaf { Signal::Input(k) } else { Signal::Input(u32::MAX) }
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

#[cfg(test)]
mod derivatives_tests {
    use super::*;
    use crate::op::Op;

    #[test]
    fn the_chain_rule_over_time_states_inputs_and_delays() {
        let mut g = Graph::default();
        let mut d = Derivatives::new(1, 1);
        let (t, x, u, p) = (g.leaf(Leaf::Time), g.leaf(Leaf::State(0)), g.leaf(Leaf::Input(0)), g.leaf(Leaf::Param(0)));
        let late = g.delay(Signal::Input(0), p);
        // t*x*u + p*delay(u, p)
        let (tx, pl) = (g.apply(Op::Mul, &[t, x]), g.apply(Op::Mul, &[p, late]));
        let txu = g.apply(Op::Mul, &[tx, u]);
        let e = g.apply(Op::Add, &[txu, pl]);
        let dot = d.of(&mut g, e).unwrap();
        let value = g.evaluate(dot, |leaf| match leaf {
            Leaf::Time => 2.0,
            Leaf::State(0) => 3.0,
            Leaf::State(1) => 0.5,
            Leaf::Input(0) => 5.0,
            Leaf::Input(1) => 7.0,
            Leaf::Param(0) => 11.0,
            Leaf::Delayed(k) if g.delayed()[k as usize].signal == Signal::Input(1) => 13.0,
            other => panic!("{other:?}"),
        });
        assert_eq!(value, 3.0 * 5.0 + 2.0 * 0.5 * 5.0 + 2.0 * 3.0 * 7.0 + 11.0 * 13.0);
        assert_eq!(d.slopes(), [0]);
        assert_eq!(d.of(&mut g, dot), Err(Twice));
        let zero = g.number(0.0);
        assert_eq!(d.of(&mut g, p), Ok(zero));
    }
}
