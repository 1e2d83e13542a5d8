//! Minima of many starts that are as good as the one that was kept.

use super::digits::digits;
use fdm_estimate::{Fit, ParameterEstimate, StartSummary, Status};

/// Parameters that are named.
const NAMED: usize = 4;
/// Standard errors by which a parameter is elsewhere.
const ELSEWHERE: f64 = 1.0;

/// For each of them where it is, by the parameters that differ.
pub(super) fn equal_minima(fit: &Fit) -> Vec<String> {
    let estimated = |p: &&ParameterEstimate| !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied);
    let free: Vec<&ParameterEstimate> = fit.estimate.parameters.iter().filter(estimated).collect();
    let line = |start: &StartSummary| {
        let elsewhere = |(p, value): &(&ParameterEstimate, &f64)| {
            let off = (p.value - **value).abs();
            p.standard_error.map_or(off > 1e-6 * p.value.abs(), |error| off > ELSEWHERE * error)
        };
        let all: Vec<String> = free
            .iter()
            .copied()
            .zip(&start.values)
            .filter(elsewhere)
            .map(|(p, value)| {
                let of = p.run.as_ref().map_or(String::new(), |run| format!(" of {run}"));
                format!("{}{of} {} in place of {}", p.name, digits(*value, 4), digits(p.value, 4))
            })
            .collect();
        let more = all.len().saturating_sub(NAMED);
        let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
        let places = all[..all.len().min(NAMED)].join(", ");
        format!("another minimum is as good (start {}): {places}{rest}", start.number)
    };
    fit.equal_minima().into_iter().map(line).collect()
}
