//! One pass over the nodes below some expressions, operands first: each becomes a sum of coefficients times regressors.

use super::Sum;
use super::Term;
use super::product;
use crate::graph::{Graph, Leaf, Node};
use crate::op::{Args, Build, ExprId, Op};

/// Where a leaf belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Into a coefficient; what stays whole around it can not be separated.
    Coefficient,
    /// Into a coefficient as a factor; may stand inside a regressor.
    Known,
    Regressor,
}

/// A sum of more terms stays one.
const MOST_TERMS: usize = 1024;

/// What kinds of leaves stand below a node.
#[derive(Debug, Clone, Copy, Default)]
struct Below {
    coefficient: bool,
    regressor: bool,
}

/// The sum that each root is.
pub(super) fn split(graph: &mut Graph, roots: &[ExprId], side: impl Fn(Leaf) -> Side) -> Vec<Sum> {
    let one = graph.number(1.0);
    let nodes = graph.reachable(roots.iter().copied());
    let mut pass = Pass::new(graph, &nodes, roots, one);
    for e in nodes {
        let sum = match pass.graph.node(e) {
            Node::Constant(_) => Sum::single(e, one),
            Node::Leaf(leaf) => match side(leaf) {
                Side::Known => Sum::single(e, one),
                Side::Coefficient => {
                    pass.below[e.index()].coefficient = true;
                    Sum::single(e, one)
                }
                Side::Regressor => {
                    pass.below[e.index()].regressor = true;
                    Sum::single(one, e)
                }
            },
            Node::Apply(op, args) => pass.applied(e, op, args),
        };
        pass.work += sum.len();
        pass.sums[e.index()] = Some(sum);
    }
    roots.iter().map(|r| pass.take(*r)).collect()
}

struct Pass<'a> {
    graph: &'a mut Graph,
    one: ExprId,
    below: Vec<Below>,
    sums: Vec<Option<Sum>>,
    /// Operands and roots that have not asked yet: the last one takes the sum and does not copy it.
    users: Vec<u32>,
    work: usize,
}

impl<'a> Pass<'a> {
    fn new(graph: &'a mut Graph, nodes: &[ExprId], roots: &[ExprId], one: ExprId) -> Self {
        let count = graph.nodes().len();
        let mut users = vec![0; count];
        let operands = nodes.iter().flat_map(|e| graph.operands(*e));
        operands.chain(roots).for_each(|a| users[a.index()] += 1);
        Self { graph, one, below: vec![Below::default(); count], sums: vec![None; count], users, work: 0 }
    }

    /// The sum of a node, for one of its users.
    fn take(&mut self, e: ExprId) -> Sum {
        let users = &mut self.users[e.index()];
        *users = users.saturating_sub(1);
        let sum = &mut self.sums[e.index()];
        let taken = if *users == 0 { sum.take() } else { sum.clone() };
        taken.unwrap_or_default()
    }

    fn applied(&mut self, e: ExprId, op: Op, args: Args) -> Sum {
        let operands = &args[..op.row().arity];
        let of = |a: &ExprId| self.below[a.index()];
        let below = Below {
            coefficient: operands.iter().any(|a| of(a).coefficient),
            regressor: operands.iter().any(|a| of(a).regressor),
        };
        self.below[e.index()] = below;
        let sums: Vec<Sum> = operands.iter().map(|a| self.take(*a)).collect();
        let whole = if below.regressor { Sum::single(self.one, e) } else { Sum::single(e, self.one) };
        // terms that are written during one pass; behind it nothing is taken apart any more
        if !below.regressor || self.work > (1 << 22) {
            return whole;
        }
        let separated = match (op, &sums[..]) {
            (Op::Add | Op::Sub, [_, _]) => self.added(op, sums),
            (Op::Neg, [_]) => sums.into_iter().next().map(|a| a.scaled(|c| self.graph.apply(Op::Neg, &[c]))),
            (Op::Mul, [a, b]) => self.multiplied(args, a, b),
            (Op::Div, [a, b]) if below.coefficient || !self.below[args[1].index()].regressor => {
                self.divided(args, a, b)
            }
            (Op::Abs, [a]) if below.coefficient => a.only().map(|t| {
                let [c, r] = [t.coefficient, t.regressor].map(|x| self.graph.apply(Op::Abs, &[x]));
                Sum::single(c, r)
            }),
            (Op::Select, [_, a, b]) if below.coefficient => self.chosen(args[0], a, b),
            _ => None,
        };
        separated.unwrap_or(whole)
    }

    fn added(&mut self, op: Op, sums: Vec<Sum>) -> Option<Sum> {
        let mut sums = sums.into_iter();
        let (mut a, mut b) = (sums.next()?, sums.next()?);
        if op == Op::Sub {
            b = b.scaled(|c| self.graph.apply(Op::Neg, &[c]));
        }
        // the shorter joins the longer, so that a long chain costs no more than its terms
        if a.len() < b.len() {
            std::mem::swap(&mut a, &mut b);
        }
        b.into_terms().for_each(|term| a.add(self.graph, term));
        (a.len() <= MOST_TERMS).then_some(a)
    }

    fn multiplied(&mut self, [x, y, _]: Args, a: &Sum, b: &Sum) -> Option<Sum> {
        let known = |e: ExprId| !self.below[e.index()].coefficient;
        let (x_known, y_known) = (known(x), known(y));
        if x_known && y_known && !self.holds_linear(a, b) {
            return None;
        }
        // A product of sums that would have more terms is not multiplied out
        if a.len() * b.len() <= 64 || a.len() == 1 || b.len() == 1 {
            return Some(self.product(a, b));
        }
        let rest = |known: bool, e: ExprId| known.then(|| Sum::single(self.one, e));
        match (rest(x_known, x), rest(y_known, y)) {
            (Some(_), Some(_)) | (None, None) => None,
            (Some(a), None) => Some(self.product(&a, b)),
            (None, Some(b)) => Some(self.product(a, &b)),
        }
    }

    fn product(&mut self, a: &Sum, b: &Sum) -> Sum {
        let mut sum = Sum::default();
        for (a, b) in a.terms().flat_map(|a| b.terms().map(move |b| (a, b))) {
            let coefficient = self.graph.apply(Op::Mul, &[a.coefficient, b.coefficient]);
            let regressor = product(self.graph, a.regressor, b.regressor);
            sum.add(self.graph, Term { coefficient, regressor });
        }
        sum
    }

    /// Whether a product of sums without parameters has a constant or linear term, or a factor that is a number.
    fn holds_linear(&self, a: &Sum, b: &Sum) -> bool {
        let constant = |s: &Sum| s.coefficient(self.one).is_some();
        let leaf = |s: &Sum| s.terms().any(|t| matches!(self.graph.node(t.regressor), Node::Leaf(_)));
        let scaled = |s: &Sum| s.only().is_some_and(|t| t.coefficient != self.one);
        let both = |a: &Sum, b: &Sum| constant(a) && (constant(b) || leaf(b));
        both(a, b) || both(b, a) || scaled(a) || scaled(b)
    }

    fn divided(&mut self, [_, y, _]: Args, a: &Sum, b: &Sum) -> Option<Sum> {
        let below = self.below[y.index()];
        let divisor = match b.only() {
            Some(term) => term,
            None if !below.coefficient => Term { coefficient: self.one, regressor: y },
            None => return None,
        };
        let mut sum = Sum::default();
        for term in a.terms() {
            let coefficient = self.graph.apply(Op::Div, &[term.coefficient, divisor.coefficient]);
            let regressor = self.graph.apply(Op::Div, &[term.regressor, divisor.regressor]);
            sum.add(self.graph, Term { coefficient, regressor });
        }
        Some(sum)
    }

    fn chosen(&mut self, condition: ExprId, a: &Sum, b: &Sum) -> Option<Sum> {
        let below = self.below[condition.index()];
        if below.coefficient && below.regressor {
            return None;
        }
        let zero = self.graph.number(0.0);
        let mut sum = Sum::default();
        for (from, other, first) in [(a, b, true), (b, a, false)] {
            for Term { coefficient, regressor } in from.terms() {
                let beside = other.coefficient(regressor);
                if beside == Some(coefficient) {
                    if first {
                        sum.add(self.graph, Term { coefficient, regressor });
                    }
                    continue;
                }
                let mut choose = |e: ExprId| {
                    self.graph.apply(Op::Select, &if first { [condition, e, zero] } else { [condition, zero, e] })
                };
                let term = match below.regressor {
                    true => Term { coefficient, regressor: choose(regressor) },
                    false => Term { coefficient: choose(coefficient), regressor },
                };
                sum.add(self.graph, term);
            }
        }
        (sum.len() <= MOST_TERMS).then_some(sum)
    }
}
