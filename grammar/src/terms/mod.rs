//! Expressions taken apart: sums of coefficients, which parameters decide, times regressors, which signals and time decide.
//!
//! **In** expressions of a graph. **Out** [`Separated`]: `sum coefficient*regressor`, equal regressors collected, and what
//! can not be taken apart; [`Combination`]: a coefficient as an affine function of the parameters that are estimated.
//! **Never** numbers, and never more terms than a reader could want: what grows too long stays whole.
//! **Start** at [`separate`].
//!
//! Coefficients as affine functions of the parameters that are to be found.
//!
//! Products of signals in one order, so that `x*u*x` and `x^2*u` are one regressor.
//!
//! A sum of coefficients times regressors, each regressor once.

use crate::graph::{Graph, Leaf, Node};
use crate::op::{Build, ExprId, Op};
use split::{Side, split};
use std::collections::BTreeMap;

mod split;
#[cfg(test)]
mod tests;

/// A product `coefficient*regressor`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Term {
    /// An expression of constants and parameters.
    pub coefficient: ExprId,
    /// An expression of states, inputs, delayed signals and time; the number 1 for a constant term. Parameters that are
    /// known can stand in it (`tanh(v/v0)` with a fixed `v0`); delays can be free.
    pub regressor: ExprId,
}

/// An expression as a sum: of `terms` and of `rest`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Separated {
    /// What could be taken apart, each regressor once.
    pub terms: Vec<Term>,
    /// Terms in whose regressors a free parameter stands: these are not separable.
    pub rest: Vec<Term>,
}

/// Takes expressions apart; `free` says which parameters are to be found. New nodes join the graph.
///
/// Products are distributed over sums where a parameter or a linear term comes out. An expression with very many terms
/// stays one, and is then `rest` when a free parameter stands in it.
pub fn separate(graph: &mut Graph, roots: &[ExprId], free: impl Fn(u32) -> bool) -> Vec<Separated> {
    let side = |leaf| match leaf {
        Leaf::Param(k) if free(k) => Side::Coefficient,
        Leaf::Param(_) => Side::Known,
        _ => Side::Regressor,
    };
    let sums = split(graph, roots, side);
    let entered = graph.depends(|leaf| matches!(leaf, Leaf::Param(k) if free(k)));
    let whole = |sum: Sum| {
        let (rest, terms) = sum.into_terms().partition(|t: &Term| entered[t.regressor.index()]);
        Separated { terms, rest }
    };
    sums.into_iter().map(whole).collect()
}

/// `constant + sum slope*parameter`; constant and slopes are expressions of numbers and known parameters.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Combination {
    /// What stands without a free parameter.
    pub constant: ExprId,
    /// Free parameters, rising, with their slopes.
    pub slopes: Vec<(u32, ExprId)>,
}

/// Each coefficient as an affine function of the free parameters; `None` for one that is not (`a*b`, `sin(a)`).
pub fn combinations(
    graph: &mut Graph,
    coefficients: &[ExprId],
    free: impl Fn(u32) -> bool,
) -> Vec<Option<Combination>> {
    let side = |leaf| if matches!(leaf, Leaf::Param(k) if free(k)) { Side::Regressor } else { Side::Known };
    let sums = split(graph, coefficients, side);
    let (zero, one) = (graph.number(0.0), graph.number(1.0));
    let combination = |sum: Sum| {
        let mut found = Combination { constant: zero, slopes: Vec::new() };
        for term in sum.into_terms() {
            match graph.node(term.regressor) {
                _ if term.regressor == one => found.constant = term.coefficient,
                Node::Leaf(Leaf::Param(k)) => found.slopes.push((k, term.coefficient)),
                _ => return None,
            }
        }
        found.slopes.sort_unstable();
        Some(found)
    };
    sums.into_iter().map(combination).collect()
}

/// The product of two regressors.
fn product(graph: &mut Graph, a: ExprId, b: ExprId) -> ExprId {
    let mut factors = Vec::new();
    if !(collect(graph, a, &mut factors) && collect(graph, b, &mut factors)) {
        return graph.apply(Op::Mul, &[a, b]);
    }
    factors.sort_unstable();
    let one = graph.number(1.0);
    factors.into_iter().fold(one, |product, factor| graph.apply(Op::Mul, &[product, factor]))
}

/// Appends the factors of an expression; says whether there were few enough.
fn collect(graph: &Graph, e: ExprId, factors: &mut Vec<ExprId>) -> bool {
    let mut open = vec![e];
    while let Some(e) = open.pop() {
        // products of more factors keep the order in which they were written
        if factors.len() + open.len() > 64 {
            return false;
        }
        match graph.node(e) {
            Node::Apply(Op::Mul, [a, b, _]) => open.extend([a, b]),
            _ => factors.push(e),
        }
    }
    true
}

/// Regressors with their coefficients, in the order of the regressors' ids.
#[derive(Debug, Clone, Default)]
struct Sum(BTreeMap<ExprId, ExprId>);

impl Sum {
    /// `coefficient*regressor`.
    fn single(coefficient: ExprId, regressor: ExprId) -> Self {
        Self(BTreeMap::from([(regressor, coefficient)]))
    }

    fn len(&self) -> usize {
        self.0.len()
    }

    fn terms(&self) -> impl Iterator<Item = Term> + '_ {
        self.0.iter().map(|(regressor, coefficient)| Term { coefficient: *coefficient, regressor: *regressor })
    }

    fn into_terms(self) -> impl Iterator<Item = Term> {
        self.0.into_iter().map(|(regressor, coefficient)| Term { coefficient, regressor })
    }

    /// The term, when there is one only.
    fn only(&self) -> Option<Term> {
        self.terms().next().filter(|_| self.len() == 1)
    }

    /// The coefficient of a regressor.
    fn coefficient(&self, regressor: ExprId) -> Option<ExprId> {
        self.0.get(&regressor).copied()
    }

    /// Adds a term; coefficients that cancel take the regressor with them.
    fn add(&mut self, graph: &mut Graph, term: Term) {
        let before = self.0.get(&term.regressor).copied();
        let sum = before.map_or(term.coefficient, |c| graph.apply(Op::Add, &[c, term.coefficient]));
        if graph.constant(sum) == Some(0.0) {
            self.0.remove(&term.regressor);
        } else {
            self.0.insert(term.regressor, sum);
        }
    }

    /// Every coefficient changed.
    fn scaled(self, mut change: impl FnMut(ExprId) -> ExprId) -> Self {
        Self(self.0.into_iter().map(|(regressor, coefficient)| (regressor, change(coefficient))).collect())
    }
}
