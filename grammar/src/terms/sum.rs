//! A sum of coefficients times regressors, each regressor once.

use super::Term;
use crate::graph::Graph;
use crate::op::{Build, ExprId, Op};
use std::collections::BTreeMap;

/// Regressors with their coefficients, in the order of the regressors' ids.
#[derive(Debug, Clone, Default)]
pub(super) struct Sum(BTreeMap<ExprId, ExprId>);

impl Sum {
    /// `coefficient*regressor`.
    pub(super) fn single(coefficient: ExprId, regressor: ExprId) -> Self {
        Self(BTreeMap::from([(regressor, coefficient)]))
    }

    pub(super) fn len(&self) -> usize {
        self.0.len()
    }

    pub(super) fn terms(&self) -> impl Iterator<Item = Term> + '_ {
        self.0.iter().map(|(regressor, coefficient)| Term { coefficient: *coefficient, regressor: *regressor })
    }

    pub(super) fn into_terms(self) -> impl Iterator<Item = Term> {
        self.0.into_iter().map(|(regressor, coefficient)| Term { coefficient, regressor })
    }

    /// The term, when there is one only.
    pub(super) fn only(&self) -> Option<Term> {
        self.terms().next().filter(|_| self.len() == 1)
    }

    /// The coefficient of a regressor.
    pub(super) fn coefficient(&self, regressor: ExprId) -> Option<ExprId> {
        self.0.get(&regressor).copied()
    }

    /// Adds a term; coefficients that cancel take the regressor with them.
    pub(super) fn add(&mut self, graph: &mut Graph, term: Term) {
        let before = self.0.get(&term.regressor).copied();
        let sum = before.map_or(term.coefficient, |c| graph.apply(Op::Add, &[c, term.coefficient]));
        if graph.constant(sum) == Some(0.0) {
            self.0.remove(&term.regressor);
        } else {
            self.0.insert(term.regressor, sum);
        }
    }

    /// Every coefficient changed.
    pub(super) fn scaled(self, mut change: impl FnMut(ExprId) -> ExprId) -> Self {
        Self(self.0.into_iter().map(|(regressor, coefficient)| (regressor, change(coefficient))).collect())
    }
}
