//! The combination of parameters that a record determines least: the eigenvector of the relative covariance with the largest eigenvalue.

use fdm_estimate::{Estimate, ParameterEstimate};
use nalgebra::DMatrix;

/// The combination that is known least.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Weakest {
    /// Parameters and their parts, relative to their values; the largest first.
    pub(super) parts: Vec<(String, f64)>,
    /// Standard error of the combination, relative to the values.
    pub(super) error: f64,
}

/// Parts that are smaller are not named.
const PART: f64 = 0.1;

impl Weakest {
    /// Of the shared parameters; those that belong to a run are left to take what values they need. None when nothing is covered.
    pub(super) fn of(estimate: &Estimate) -> Option<Self> {
        let full = &estimate.corrected_covariance;
        let matrix = if full.size == estimate.covered.len() { full } else { &estimate.covariance };
        let of = |row: &usize| -> Option<&ParameterEstimate> { estimate.parameters.get(*estimate.covered.get(*row)?) };
        let shared = |row: &usize| of(row).is_some_and(|p| p.run.is_none() && p.value != 0.0);
        let rows: Vec<usize> = (0..matrix.size).filter(shared).collect();
        let values: Vec<f64> = rows.iter().filter_map(of).map(|p| p.value).collect();
        let relative =
            DMatrix::from_fn(rows.len(), rows.len(), |i, j| matrix.at(rows[i], rows[j]) / (values[i] * values[j]));
        if rows.is_empty() || relative.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let eigen = relative.symmetric_eigen();
        let largest = (0..rows.len()).max_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]))?;
        let vector = eigen.eigenvectors.column(largest);
        let first = vector.iter().fold(0.0, |a: f64, v| if v.abs() > a.abs() { *v } else { a });
        let names = rows.iter().filter_map(of).map(|p| p.name.clone());
        let mut parts: Vec<(String, f64)> =
            names.zip(vector.iter().map(|v| v / first)).filter(|(_, v)| v.abs() > PART).collect();
        parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
        Some(Self { parts, error: eigen.eigenvalues[largest].max(0.0).sqrt() })
    }
}
