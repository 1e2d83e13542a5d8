//! The estimate of a model in segments without what belongs to the cuts.

use crate::estimate::estimate::{Estimate, RunFit, Status, Symmetric};
use fdm_grammar::Model;

/// The model without cuts.
pub(in crate::estimate) struct Uncut<'a> {
    pub(in crate::estimate) outputs: usize,
    pub(in crate::estimate) params: &'a Model,
}

impl Uncut<'_> {
    /// Leaves out the states behind the cuts and the gaps, which have added `gaps` to the cost. Standard errors stay: those of
    /// parameters under the constraint that there are no gaps.
    pub(in crate::estimate) fn of(&self, estimate: Estimate, gaps: f64) -> Estimate {
        let own = |name: &str| self.params.param(name).is_some();
        let kept: Vec<usize> = (0..estimate.parameters.len())
            .filter(|k| {
                matches!(estimate.parameters[*k].status, Status::Derived | Status::Tied)
                    || own(&estimate.parameters[*k].name)
            })
            .collect();
        let rows: Vec<usize> = (0..estimate.covered.len()).filter(|i| kept.contains(&estimate.covered[*i])).collect();
        let covered = rows.iter().filter_map(|i| kept.iter().position(|k| *k == estimate.covered[*i])).collect();
        let shown = |name: &str| self.params.outputs.iter().any(|o| o.quantity.name == name);
        Estimate {
            parameters: kept.iter().map(|k| estimate.parameters[*k].clone()).collect(),
            covered,
            covariance: part(&estimate.covariance, &rows),
            corrected_covariance: match estimate.corrected_covariance.size {
                0 => estimate.corrected_covariance,
                _ => part(&estimate.corrected_covariance, &rows),
            },
            correlations: part(&estimate.correlations, &rows),
            outputs: estimate.outputs.into_iter().filter(|o| shown(&o.name)).collect(),
            cost: estimate.cost.map(|c| c - gaps),
            noise: estimate.noise.map(|n| part(&n, &(0..self.outputs).collect::<Vec<_>>())),
            noise_free: estimate.noise_free.into_iter().filter(|n| shown(n)).collect(),
            undetermined: estimate
                .undetermined
                .into_iter()
                .filter(|d| d.moves.iter().all(|(name, _)| !name.contains(" behind cut ")))
                .collect(),
            runs: estimate.runs.iter().map(|r| self.run(r)).collect(),
            ..estimate
        }
    }

    fn run(&self, run: &RunFit) -> RunFit {
        let width = self.outputs + self.params.states.len();
        let columns = |v: &[f64]| v.chunks(width).flat_map(|row| row[..self.outputs].iter().copied()).collect();
        RunFit { run: run.run.clone(), response: columns(&run.response), residuals: columns(&run.residuals) }
    }
}

fn part(matrix: &Symmetric, rows: &[usize]) -> Symmetric {
    let entries = rows.iter().flat_map(|i| rows.iter().map(move |j| (*i, *j)));
    Symmetric { size: rows.len(), values: entries.map(|(i, j)| matrix.at(i, j)).collect() }
}
