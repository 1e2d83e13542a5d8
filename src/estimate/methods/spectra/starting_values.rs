//! Starting values from equation error: where states are measured, their equations are regressions that need no start.

use crate::methods::equation_error::{Domain, Regressed, RegressionOptions, regress};
use crate::problem::changes::Changes;
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::spectrum::Frequencies;
use serde::{Deserialize, Serialize};

/// Squared ratio of a value to its error from which on a regression is preferred to the model's own value.
const PREFERRED: f64 = 4.0;

/// A value that an estimation begins with, and where it is from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StartingValue {
    /// The parameter.
    pub parameter: String,
    /// The value.
    pub value: f64,
    /// The equations whose regression gave it; none when it is the model's own.
    pub equations: Vec<String>,
}

/// Starting values of all free parameters that are identifiable (`seen`), in the model's order. Values that were set by hand stay.
pub(crate) fn regressed_values(
    model: &Model,
    runs: &[Run],
    seen: &[bool],
    frequencies: &Frequencies,
    changes: &Changes,
) -> Vec<StartingValue> {
    let domain = Domain::Frequency(frequencies.clone());
    let found = regress(model, runs, &RegressionOptions { domain, ..RegressionOptions::default() }).ok();
    let fits = || found.iter().flat_map(|r| &r.fits);
    let regressed = |name: &str| {
        fits().find_map(|fit| {
            let believed = |r: &&Regressed| r.name == *name && r.run.is_none() && r.partial_f >= PREFERRED;
            let one = fit.parameters.iter().find(believed)?;
            Some((one.value, fit.equations.iter().map(|e| e.equation.clone()).collect::<Vec<_>>()))
        })
    };
    let params = model.definition().params.iter().zip(seen).filter(|(p, seen)| !p.fixed && **seen);
    params
        .map(|(p, _)| {
            let name = &p.quantity.name;
            let by_hand = changes.set.iter().any(|(set, _)| set == name);
            let inside = |v: f64| v.is_finite() && v >= p.lower && v <= p.upper;
            let better = regressed(name).filter(|(v, _)| inside(*v) && !by_hand && !p.per_run);
            let (value, equations) = better.unwrap_or((p.value, Vec::new()));
            StartingValue { parameter: name.clone(), value, equations }
        })
        .collect()
}
