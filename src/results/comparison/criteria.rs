//! Criteria of Akaike and Schwarz: cost against number of parameters.

use super::candidate::Candidate;
use serde::{Deserialize, Serialize};

/// Twice the cost and what parameters cost, each as its difference to the least of all that are comparable.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct Criteria {
    /// Akaike's: two for each parameter; as if residuals were white.
    pub aic: f64,
    /// Schwarz's: log N for each parameter; as if residuals were white.
    pub bic: f64,
    /// Akaike's with costs over the inflation of coloured residuals (quasi-AIC of Burnham and Anderson); none where that is not known.
    pub coloured_aic: Option<f64>,
    /// Schwarz's, with costs and N over the inflation.
    pub coloured_bic: Option<f64>,
}

/// Fills in what the costs say; returns the inflation, which is that of the richest model: what the poorer ones leave is partly their own
/// error, not noise.
pub(super) fn judge(candidates: &mut [Candidate]) -> Option<f64> {
    let inflation = {
        let comparable = || candidates.iter().filter(|c| c.incomparable.is_none());
        let richest = comparable().max_by_key(|c| c.unknowns)?;
        richest.inflation.map(|c| c.max(1.0))
    };
    for candidate in candidates.iter_mut().filter(|c| c.incomparable.is_none()) {
        let Some(cost) = candidate.cost else { continue };
        let (k, n) = (candidate.unknowns as f64, candidate.samples.max(1) as f64);
        candidate.criteria = Some(Criteria {
            aic: 2.0 * cost + 2.0 * k,
            bic: 2.0 * cost + k * n.ln(),
            coloured_aic: inflation.map(|c| 2.0 * cost / c + 2.0 * k),
            coloured_bic: inflation.map(|c| 2.0 * cost / c + k * (n / c).max(1.0).ln()),
        });
    }
    let all = || candidates.iter().filter_map(|c| c.criteria);
    let least = |of: &dyn Fn(Criteria) -> Option<f64>| all().filter_map(of).fold(f64::INFINITY, f64::min);
    let (aic, bic) = (least(&|c| Some(c.aic)), least(&|c| Some(c.bic)));
    let (coloured_aic, coloured_bic) = (least(&|c| c.coloured_aic), least(&|c| c.coloured_bic));
    for own in candidates.iter_mut().filter_map(|c| c.criteria.as_mut()) {
        (own.aic, own.bic) = (own.aic - aic, own.bic - bic);
        own.coloured_aic = own.coloured_aic.map(|v| v - coloured_aic);
        own.coloured_bic = own.coloured_bic.map(|v| v - coloured_bic);
    }
    inflation
}
