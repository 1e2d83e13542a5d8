//! Estimates from records of different length, and what they tell about the confidence in each parameter.

use super::estimate::{ParameterEstimate, Status};
use super::fit::Fit;
use super::termination::Termination;
use crate::record::Run;
use serde::Serialize;

/// How much of every run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Length {
    /// This part of each.
    Share(f64),
    /// Up to this time since each began.
    Time(f64),
}

impl Length {
    /// The runs up to this length, two samples at least.
    pub(super) fn cut(self, runs: &[Run]) -> Vec<Run> {
        let one = |run: &Run| {
            let end = match self {
                Self::Share(share) => share * run.time.last().copied().unwrap_or(0.0),
                Self::Time(time) => time,
            };
            // a sample that stands at the end but for rounding belongs to it
            let samples = run.time.partition_point(|t| *t <= end * (1.0 + 1e-12));
            run.part(0..samples.max(2).min(run.len()))
        };
        runs.iter().map(one).collect()
    }
}

/// Estimates from records of one length.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LengthFit {
    /// Time that the longest run lasts, in the model's time unit.
    pub length: f64,
    /// Samples of all runs.
    pub samples: usize,
    /// How the iteration ended.
    pub termination: Termination,
    /// The parameters as in [`Estimate::parameters`](super::Estimate::parameters), those that are not estimated left out.
    pub parameters: Vec<ParameterEstimate>,
}

impl LengthFit {
    pub(super) fn new(runs: &[Run], fit: &Fit) -> Self {
        let ends = runs.iter().filter_map(|r| r.time.last());
        let open = |p: &&ParameterEstimate| !matches!(p.status, Status::Fixed | Status::Derived);
        Self {
            length: ends.copied().fold(0.0, f64::max),
            samples: runs.iter().map(Run::len).sum(),
            termination: fit.estimate.termination.clone(),
            parameters: fit.estimate.parameters.iter().filter(open).cloned().collect(),
        }
    }
}

/// How a parameter settles while the record grows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Settling {
    /// Its name.
    pub name: String,
    /// Its run, when it has one.
    pub run: Option<String>,
    /// Its value from the whole record.
    pub value: f64,
    /// Its standard error from the whole record.
    pub standard_error: Option<f64>,
    /// Root mean square of what its value from shorter records differs from that of the whole, over the records from
    /// half the length on.
    pub wander: f64,
    /// `sqrt(wander^2 + standard_error^2)` relative to the value: the smaller, the more confidence it deserves. Infinite
    /// when the whole record does not determine it.
    pub doubt: f64,
}

/// Parameters in order of confidence, the surest first, from estimates by length of which the last is the whole record's.
///
/// A parameter that a shorter record does not determine, or whose fit went wrong there, counts as off by its own size.
pub fn by_confidence(lengths: &[LengthFit]) -> Vec<Settling> {
    let Some((whole, shorter)) = lengths.split_last() else { return Vec::new() };
    let late: Vec<&LengthFit> = shorter.iter().filter(|l| l.length >= 0.5 * whole.length * (1.0 - 1e-9)).collect();
    let mut table: Vec<Settling> = whole.parameters.iter().map(|p| settling(p, &late)).collect();
    table.sort_by(|a, b| a.doubt.total_cmp(&b.doubt));
    table
}

fn settling(whole: &ParameterEstimate, late: &[&LengthFit]) -> Settling {
    let same = |p: &&ParameterEstimate| p.name == whole.name && p.run == whole.run;
    let off = |l: &&LengthFit| match l.parameters.iter().find(same) {
        Some(p) if l.termination.is_good() && p.standard_error.is_some() => p.value - whole.value,
        _ => whole.value,
    };
    let wander = (late.iter().map(|l| off(l).powi(2)).sum::<f64>() / late.len().max(1) as f64).sqrt();
    let doubt = whole.standard_error.map_or(f64::INFINITY, |s| wander.hypot(s) / whole.value.abs());
    Settling {
        name: whole.name.clone(),
        run: whole.run.clone(),
        value: whole.value,
        standard_error: whole.standard_error,
        wander,
        doubt: if doubt.is_nan() { f64::INFINITY } else { doubt },
    }
}

#[cfg(test)]
mod tests {
    use super::super::termination::Reason;
    use super::*;

    fn parameter(name: &str, value: f64, error: Option<f64>) -> ParameterEstimate {
        ParameterEstimate {
            name: name.into(),
            run: None,
            value,
            standard_error: error,
            unit: None,
            status: Status::Estimated,
            start: None,
            lower: None,
            upper: None,
        }
    }

    fn at(length: f64, values: [(f64, Option<f64>); 3]) -> LengthFit {
        let parameters = ["a", "b", "c"].iter().zip(values).map(|(n, (v, e))| parameter(n, v, e)).collect();
        LengthFit { length, samples: 10, termination: Termination::Converged(Reason::SmallCorrection), parameters }
    }

    #[test]
    fn what_settles_stands_before_what_wanders_and_what_is_not_determined_comes_last() {
        let lengths = [
            at(2.0, [(90.0, Some(1.0)), (2.0, Some(1.0)), (7.0, Some(1.0))]),
            at(5.0, [(1.3, Some(0.1)), (2.0, None), (5.0, None)]),
            at(7.5, [(1.4, Some(0.1)), (2.0, Some(0.1)), (5.0, None)]),
            at(10.0, [(1.0, Some(0.12)), (2.0, Some(0.1)), (5.0, None)]),
        ];
        let order = by_confidence(&lengths);
        assert_eq!(order.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["a", "b", "c"]);
        assert!((order[0].wander - (0.125f64).sqrt()).abs() < 1e-12, "the first length is too short to count");
        assert!((order[0].doubt - (0.125f64 + 0.0144).sqrt()).abs() < 1e-12);
        assert!(
            (order[1].wander - 2f64.sqrt()).abs() < 1e-12,
            "not determined at half the length: off by its own size"
        );
        assert_eq!(order[2].doubt, f64::INFINITY);
    }
}
