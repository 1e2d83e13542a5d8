//! What was known about the unknowns before the data: normal distributions, each worth one more measurement.

use crate::problem::Problem;
use crate::unknowns::Unknowns;
use fdm_grammar::model::Prior;

/// The prior of each unknown that has one; the copies of every run have it each.
#[derive(Debug, Clone, Default)]
pub(crate) struct Priors {
    of: Vec<(usize, Prior)>,
}

impl Priors {
    pub(crate) fn new(problem: &Problem<'_>, unknowns: &Unknowns) -> Self {
        let prior = |j: usize| problem.params[unknowns.owner(j).1].prior.map(|p| (j, p));
        Self { of: (0..unknowns.len()).filter_map(prior).collect() }
    }

    /// Whether there is none.
    pub(crate) fn is_empty(&self) -> bool {
        self.of.is_empty()
    }

    /// Minus the logarithm of their density, without its constant.
    pub(crate) fn cost(&self, values: &[f64]) -> f64 {
        self.rows(values).map(|row| 0.5 * row.residual * row.residual).sum()
    }

    /// The rows that they add to the whitened [J v].
    pub(crate) fn rows(&self, values: &[f64]) -> impl Iterator<Item = PriorRow> {
        self.of.iter().map(|(j, prior)| PriorRow {
            unknown: *j,
            weight: 1.0 / prior.deviation,
            residual: (prior.mean - values[*j]) / prior.deviation,
        })
    }
}

/// One row of [J v]: an unknown is measured by its prior alone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PriorRow {
    /// The only unknown with an entry.
    pub(crate) unknown: usize,
    /// That entry.
    pub(crate) weight: f64,
    /// The last entry.
    pub(crate) residual: f64,
}
