//! Derivatives replaced by what they were solved for: the graph built anew, and equations as sums over the derivatives that are
//! still to be found.

use super::delays::Delays;
use super::delays::Derivatives;
use crate::graph::{Graph, Leaf, Node, Signal};
use crate::op::{Args, Build, ExprId, Op};
use std::collections::{BTreeMap, HashMap};

/// `rest + sum coefficient*derivative`, expressions of the new graph.
#[derive(Debug, Clone)]
pub(super) struct Form {
    /// What stands without an unknown derivative.
    pub(super) rest: ExprId,
    /// State and coefficient of its derivative.
    pub(super) terms: BTreeMap<usize, ExprId>,
}

/// Why an expression is no such sum.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Obstacle {
    /// The derivatives of these states are multiplied with each other, or stand inside a function or a condition.
    Nonlinear(Vec<usize>),
    /// A derivative at an earlier time decides about itself.
    Earlier(usize),
    /// The delays stand for too many signals.
    Delays,
    /// The sums are too long.
    TooLong,
}

/// Builds a graph anew while derivatives become known.
pub(super) struct Substitution<'a> {
    old: &'a Graph,
    derivatives: &'a Derivatives,
    /// The new graph.
    pub(super) graph: Graph,
    /// By old node: whether a derivative is in it.
    carries: Vec<bool>,
    moved: Vec<Option<ExprId>>,
    /// By state: its derivative in the new graph.
    pub(super) rates: Vec<Option<ExprId>>,
    delays: Delays,
    terms: usize,
}

impl<'a> Substitution<'a> {
    /// No derivative is known yet.
    pub(super) fn new(old: &'a Graph, derivatives: &'a Derivatives) -> Self {
        let is_rate = |signal| matches!(signal, Signal::State(k) if k >= derivatives.states());
        let carries = old.depends(|leaf| match leaf {
            Leaf::Delayed(k) => is_rate(old.delayed()[k as usize].signal),
            leaf => derivatives.rate(leaf).is_some(),
        });
        Self {
            carries,
            moved: vec![None; old.nodes().len()],
            rates: vec![None; derivatives.states() as usize],
            graph: Graph::default(),
            delays: Delays::default(),
            terms: 0,
            old,
            derivatives,
        }
    }

    /// Whether a derivative is in an old expression.
    pub(super) fn carries(&self, e: ExprId) -> bool {
        self.carries[e.index()]
    }

    /// The states whose derivatives are in an old expression: now, and at an earlier time.
    pub(super) fn rates_in(&self, e: ExprId) -> (Vec<usize>, Vec<usize>) {
        let (mut now, mut earlier) = (Vec::new(), Vec::new());
        let mut seen: HashMap<ExprId, ()> = HashMap::new();
        let mut open = vec![e];
        while let Some(k) = open.pop() {
            if !self.carries(k) || seen.insert(k, ()).is_some() {
                continue;
            }
            match self.old.node(k) {
                Node::Leaf(Leaf::Delayed(d)) => earlier.extend(self.delayed_rate(d)),
                Node::Leaf(leaf) => now.extend(self.derivatives.rate(leaf).map(|s| s as usize)),
                _ => open.extend_from_slice(self.old.operands(k)),
            }
        }
        for list in [&mut now, &mut earlier] {
            list.sort_unstable();
            list.dedup();
        }
        (now, earlier)
    }

    fn delayed_rate(&self, delayed: u32) -> Option<usize> {
        match self.old.delayed()[delayed as usize].signal {
            Signal::State(k) => k.checked_sub(self.derivatives.states()).map(|s| s as usize),
            Signal::Input(_) => None,
        }
    }

    /// An old expression in the new graph; all derivatives in it are known.
    pub(super) fn moved(&mut self, e: ExprId) -> Result<ExprId, Obstacle> {
        let form = self.form(e)?;
        match form.terms.is_empty() {
            true => Ok(form.rest),
            false => Err(Obstacle::Nonlinear(form.terms.into_keys().collect())),
        }
    }

    /// An old expression as a sum over the derivatives that are not known yet.
    pub(super) fn form(&mut self, e: ExprId) -> Result<Form, Obstacle> {
        let mut forms: HashMap<ExprId, Form> = HashMap::new();
        for k in self.pending(e) {
            let form = match self.old.node(k) {
                Node::Constant(bits) => self.whole_number(f64::from_bits(bits)),
                Node::Leaf(leaf) => self.leaf(leaf)?,
                Node::Apply(op, args) => self.applied(op, args, &forms)?,
            };
            self.terms += form.terms.len();
            // most terms that sums of one model may have together
            if self.terms > 4_000_000 {
                return Err(Obstacle::TooLong);
            }
            if form.terms.is_empty() {
                self.moved[k.index()] = Some(form.rest);
            } else {
                forms.insert(k, form);
            }
        }
        Ok(self.known(e, &forms))
    }

    fn pending(&self, e: ExprId) -> Vec<ExprId> {
        let mut seen: HashMap<ExprId, ()> = HashMap::new();
        let (mut order, mut open) = (Vec::new(), vec![e]);
        while let Some(k) = open.pop() {
            if self.moved[k.index()].is_none() && seen.insert(k, ()).is_none() {
                order.push(k);
                open.extend_from_slice(self.old.operands(k));
                if let Node::Leaf(Leaf::Delayed(d)) = self.old.node(k) {
                    open.push(self.old.delayed()[d as usize].tau);
                }
            }
        }
        order.sort_unstable();
        order
    }

    fn known(&self, e: ExprId, forms: &HashMap<ExprId, Form>) -> Form {
        let whole = || Form { rest: self.moved[e.index()].unwrap_or(ExprId::NONE), terms: BTreeMap::new() };
        forms.get(&e).cloned().unwrap_or_else(whole)
    }

    fn whole_number(&mut self, value: f64) -> Form {
        Form { rest: self.graph.number(value), terms: BTreeMap::new() }
    }

    fn leaf(&mut self, leaf: Leaf) -> Result<Form, Obstacle> {
        let whole = |rest| Form { rest, terms: BTreeMap::new() };
        if let Leaf::Delayed(k) = leaf {
            let delayed = self.old.delayed()[k as usize];
            let tau = self.moved[delayed.tau.index()].unwrap_or(delayed.tau);
            let Some(state) = self.delayed_rate(k) else { return Ok(whole(self.graph.delay(delayed.signal, tau))) };
            let rate = self.rates[state].ok_or(Obstacle::Earlier(state))?;
            return match self.delays.delay(&mut self.graph, rate, tau) {
                Ok(e) => Ok(whole(e)),
                Err(_) => Err(Obstacle::Delays),
            };
        }
        let Some(state) = self.derivatives.rate(leaf) else { return Ok(whole(self.graph.leaf(leaf))) };
        Ok(match self.rates[state as usize] {
            Some(rate) => whole(rate),
            None => {
                let (zero, one) = (self.graph.number(0.0), self.graph.number(1.0));
                Form { rest: zero, terms: BTreeMap::from([(state as usize, one)]) }
            }
        })
    }

    fn applied(&mut self, op: Op, args: Args, forms: &HashMap<ExprId, Form>) -> Result<Form, Obstacle> {
        let operands: Vec<Form> = args[..op.row().arity].iter().map(|a| self.known(*a, forms)).collect();
        let free = |k: usize| operands[k].terms.is_empty();
        let rests: Vec<ExprId> = operands.iter().map(|f| f.rest).collect();
        if (0..operands.len()).all(free) {
            return Ok(Form { rest: self.graph.apply(op, &rests), terms: BTreeMap::new() });
        }
        let g = &mut self.graph;
        Ok(match op {
            Op::Add | Op::Sub => joined(g, op, &operands[0], &operands[1]),
            Op::Neg => each(g, &operands[0], |g, e| g.apply(Op::Neg, &[e])),
            Op::Mul if free(0) => each(g, &operands[1], |g, e| g.apply(Op::Mul, &[rests[0], e])),
            Op::Mul if free(1) => each(g, &operands[0], |g, e| g.apply(Op::Mul, &[e, rests[1]])),
            Op::Div if free(1) => each(g, &operands[0], |g, e| g.apply(Op::Div, &[e, rests[1]])),
            Op::Select if free(0) => chosen(g, rests[0], &operands[1], &operands[2]),
            _ => {
                let mut states: Vec<usize> = operands.iter().flat_map(|f| f.terms.keys().copied()).collect();
                states.sort_unstable();
                states.dedup();
                return Err(Obstacle::Nonlinear(states));
            }
        })
    }
}

fn each(graph: &mut Graph, form: &Form, change: impl Fn(&mut Graph, ExprId) -> ExprId) -> Form {
    let terms = form.terms.iter().map(|(s, e)| (*s, change(graph, *e))).collect();
    Form { rest: change(graph, form.rest), terms }
}

fn joined(graph: &mut Graph, op: Op, a: &Form, b: &Form) -> Form {
    let mut sum = Form { rest: graph.apply(op, &[a.rest, b.rest]), terms: a.terms.clone() };
    let zero = graph.number(0.0);
    for (state, e) in &b.terms {
        let before = a.terms.get(state).copied().unwrap_or(zero);
        sum.terms.insert(*state, graph.apply(op, &[before, *e]));
    }
    sum.terms.retain(|_, e| graph.constant(*e) != Some(0.0));
    sum
}

fn chosen(graph: &mut Graph, condition: ExprId, a: &Form, b: &Form) -> Form {
    let zero = graph.number(0.0);
    let mut choose = |a: ExprId, b: ExprId| graph.apply(Op::Select, &[condition, a, b]);
    let rest = choose(a.rest, b.rest);
    let mut terms = BTreeMap::new();
    for state in a.terms.keys().chain(b.terms.keys()) {
        let of = |form: &Form| form.terms.get(state).copied().unwrap_or(zero);
        terms.insert(*state, choose(of(a), of(b)));
    }
    Form { rest, terms }
}

/// `left - right`, and what it must be equal to: `sum coefficient*derivative = rest`.
pub(super) fn equated(graph: &mut Graph, left: &Form, right: &Form) -> Form {
    let mut form = joined(graph, Op::Sub, left, right);
    form.rest = graph.apply(Op::Sub, &[right.rest, left.rest]);
    form
}
