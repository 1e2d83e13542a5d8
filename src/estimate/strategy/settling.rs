//! What estimates from records of different length tell about the confidence in each parameter (Goodman and Sargent 1971,
//! section III): parameters that settle deserve it, those that wander do not.

use super::lengths::LengthFit;
use crate::estimate::estimate::ParameterEstimate;
use serde::Serialize;

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
    use super::*;
    use crate::estimate::estimate::Status;
    use crate::estimate::termination::{Reason, Termination};

    fn parameter(name: &str, value: f64, error: Option<f64>) -> ParameterEstimate {
        ParameterEstimate {
            name: name.into(),
            run: None,
            value,
            standard_error: error,
            corrected_error: None,
            freedom: None,
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
