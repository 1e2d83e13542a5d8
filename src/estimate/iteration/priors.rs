//! What was known about the unknowns before the data: normal distributions of unknowns and of differences between them, each
//! worth one more measurement.

use crate::problem::Problem;
use crate::problem::unknowns::Unknowns;
use fdm_grammar::model::Prior;

/// The prior of each unknown that has one (the copies of every run have it each), and of differences between unknowns.
#[derive(Debug, Clone, Default)]
pub(crate) struct Priors {
    of: Vec<(usize, Prior)>,
    differences: Vec<PriorRow>,
}

/// Most unknowns in one row: differences of order 3.
const MOST_ENTRIES: usize = 4;

impl Priors {
    pub(crate) fn new(problem: &Problem<'_>, unknowns: &Unknowns) -> Self {
        let prior = |j: usize| problem.params[unknowns.owner(j).1].prior.map(|p| (j, p));
        Self { of: (0..unknowns.len()).filter_map(prior).collect(), differences: Vec::new() }
    }

    /// These priors with rows of differences, whose residuals are those where all unknowns are 0.
    pub(crate) fn with(self, differences: Vec<PriorRow>) -> Self {
        Self { differences, ..self }
    }

    /// Whether there is none.
    pub(crate) fn is_empty(&self) -> bool {
        self.of.is_empty() && self.differences.is_empty()
    }

    /// Minus the logarithm of their density, without its constant.
    pub(crate) fn cost(&self, values: &[f64]) -> f64 {
        self.rows(values).map(|row| 0.5 * row.residual * row.residual).sum()
    }

    /// The rows that they add to the whitened [J v].
    pub(crate) fn rows(&self, values: &[f64]) -> impl Iterator<Item = PriorRow> {
        let single = self.of.iter().map(|(j, prior)| {
            PriorRow::new(&[(*j, 1.0 / prior.deviation)], (prior.mean - values[*j]) / prior.deviation)
        });
        single.chain(self.differences.iter().map(|row| row.at(values)))
    }
}

/// One row of [J v]: a combination of few unknowns is measured by its prior alone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PriorRow {
    entries: [(usize, f64); MOST_ENTRIES],
    count: usize,
    /// The last entry.
    pub(crate) residual: f64,
}

impl PriorRow {
    /// From unknowns that rise, at most [`MOST_ENTRIES`], and their entries.
    pub(crate) fn new(list: &[(usize, f64)], residual: f64) -> Self {
        let mut entries = [(0, 0.0); MOST_ENTRIES];
        let count = list.len().min(MOST_ENTRIES);
        entries[..count].copy_from_slice(&list[..count]);
        Self { entries, count, residual }
    }

    /// Unknowns and their entries.
    pub(crate) fn entries(&self) -> &[(usize, f64)] {
        &self.entries[..self.count]
    }

    /// The row whose residual is this one where all unknowns are 0, at other values.
    pub(crate) fn at(&self, values: &[f64]) -> Self {
        let moved: f64 = self.entries().iter().map(|(j, entry)| entry * values[*j]).sum();
        Self { residual: self.residual - moved, ..*self }
    }

    /// The row times a factor.
    pub(crate) fn times(&self, factor: f64) -> Self {
        let mut row = *self;
        row.entries.iter_mut().for_each(|(_, entry)| *entry *= factor);
        row.residual *= factor;
        row
    }

    /// The square of the row's length under a covariance of the unknowns.
    pub(crate) fn variance(&self, covariance: impl Fn(usize, usize) -> f64) -> f64 {
        let pairs = self.entries().iter().flat_map(|a| self.entries().iter().map(move |b| (a, b)));
        pairs.map(|((i, a), (j, b))| a * b * covariance(*i, *j)).sum()
    }
}
