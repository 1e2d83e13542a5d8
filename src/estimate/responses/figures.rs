//! What frequency-domain identifiers look at beside standard errors: bounds of Cramer and Rao, and insensitivity, from the curvature of the cost.

use crate::estimate::estimate::Estimate;
use nalgebra::DMatrix;
use serde::Serialize;

/// How well the cost determines a parameter, in percent of its value: H are the second derivatives of the sum of all pairs' costs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sensitivity {
    /// The parameter.
    pub parameter: String,
    /// `100 * 2 sqrt((H^-1)_ii)/|theta_i|`: good up to 20.
    pub cramer_rao: f64,
    /// `100/(sqrt(H_ii) |theta_i|)`: good up to 10; more, and the parameter hardly moves the cost.
    pub insensitivity: f64,
}

/// The figures of all estimated parameters of which the covariance is known. Residuals are such that their squares add up to the cost.
pub(super) fn sensitivities(estimate: &Estimate) -> Vec<Sensitivity> {
    let (covariance, variance) = (&estimate.covariance, estimate.noise.as_ref().map_or(0.0, |n| n.values[0]));
    // the cost is the sum of squares, its second derivatives are twice the products of sensitivities
    let inverse = DMatrix::from_row_slice(covariance.size, covariance.size, &covariance.values) / (2.0 * variance);
    let Some(curvature) = inverse.clone().try_inverse() else { return Vec::new() };
    let figures = estimate.covered.iter().enumerate().map(|(k, p)| {
        let p = &estimate.parameters[*p];
        Sensitivity {
            parameter: p.name.clone(),
            cramer_rao: 200.0 * inverse[(k, k)].sqrt() / p.value.abs(),
            insensitivity: 100.0 / (curvature[(k, k)].sqrt() * p.value.abs()),
        }
    });
    figures.filter(|s| s.cramer_rao.is_finite() && s.insensitivity.is_finite()).collect()
}
