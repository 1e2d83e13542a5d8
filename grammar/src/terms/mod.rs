//! Expressions taken apart: sums of coefficients, which parameters decide, times regressors, which signals and time decide.
//!
//! **In** expressions of a graph. **Out** [`Separated`]: `sum coefficient*regressor`, equal regressors collected, and what
//! can not be taken apart; [`Combination`]: a coefficient as an affine function of the parameters that are estimated.
//! **Never** numbers, and never more terms than a reader could want: what grows too long stays whole.
//! **Start** at [`separate`].

mod combination;
mod monomial;
mod split;
mod sum;
#[cfg(test)]
mod tests;

pub use combination::{Combination, combinations};

use crate::graph::{Graph, Leaf};
use crate::op::ExprId;
use split::{Side, split};

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
    let whole = |sum: sum::Sum| {
        let (rest, terms) = sum.into_terms().partition(|t: &Term| entered[t.regressor.index()]);
        Separated { terms, rest }
    };
    sums.into_iter().map(whole).collect()
}
