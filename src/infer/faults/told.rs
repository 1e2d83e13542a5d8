//! Faults that were found, in words.

use super::ground::{Ground, Planted, Point};
use super::search::{self, Accepted, Found};
use super::{BesideOptions, Weighed};
use crate::search::log_sum;
use fdm_doctor::{Bias, Edit, Fault, Finding, Hypothesis, Severity, Slot, time_factor};
use fdm_estimate::{Estimate, ParameterEstimate};

/// Odds within which another hypothesis is named beside a finding.
const NEAR: f64 = 10.0;
/// Explanations that are shown.
const SHOWN: usize = 10;

/// Values of the first fit minus those of the second, in standard errors of the second; the largest first, those above a tenth.
pub(crate) fn biases_of(without: &Estimate, with: &Estimate) -> Vec<Bias> {
    const LEAST: f64 = 0.1;
    let bias = |p: &ParameterEstimate| {
        let error = p.standard_error.filter(|e| *e > 0.0 && e.is_finite())?;
        let before = without.parameter(&p.name, p.run.as_deref())?;
        let name = p.run.as_ref().map_or_else(|| p.name.clone(), |run| format!("{} ({run})", p.name));
        Some(Bias { parameter: name, standard_errors: (before.value - p.value) / error })
    };
    let mut all: Vec<Bias> = with.parameters.iter().filter_map(bias).collect();
    all.retain(|b| b.standard_errors.abs() >= LEAST);
    all.sort_by(|a, b| b.standard_errors.abs().total_cmp(&a.standard_errors.abs()));
    all
}

/// What was weighed for the first fault, with no fault among it.
pub(crate) fn weighed(ground: &Ground<'_>, found: &Found) -> Vec<Weighed> {
    let logs: Vec<f64> = found.first.iter().map(|w| w.log).chain([0.0]).collect();
    let all = log_sum(&logs);
    let none = Weighed { what: "no fault of the record".into(), evidence: 0.0, probability: (-all).exp() };
    let of = |w: &search::Weighed| Weighed {
        what: hypothesis(ground, &w.planted, ground.error_of(&w.point, &w.judged, w.point.faults.len() - 1)).sentence(ground.channels),
        evidence: w.log,
        probability: (w.log - all).exp(),
    };
    let mut list: Vec<Weighed> = found.first.iter().map(of).chain([none]).collect();
    list.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    list.truncate(SHOWN);
    list
}

/// A fault in words, its size with this error.
fn hypothesis(ground: &Ground<'_>, planted: &Planted, error: f64) -> Hypothesis {
    match planted {
        Planted::Discrete(hypothesis) => hypothesis.clone(),
        Planted::Sized(fault, size) => fault.told((*size, error), ground.channels, ground.span),
    }
}

/// The accepted faults as findings; `null` is the fit without any.
pub(crate) fn findings(ground: &Ground<'_>, found: &Found, null: &Point, _: &BesideOptions) -> Vec<Finding> {
    let edits = found.point.edits();
    let factor = time_factor(&edits);
    let of = |(k, accepted): (usize, &Accepted)| {
        let error = ground.error_of(&found.point, &found.judged, k);
        let own = hypothesis(ground, &found.point.faults[k], error);
        let mut finding = own.finding(ground.records, ground.channels, accepted.log_odds);
        let best = accepted.near.first().map_or(0.0, |w| w.log);
        let others = accepted.near.iter().filter(|w| !w.planted.is_like(&found.point.faults[k]));
        let near: Vec<&search::Weighed> = others.filter(|w| w.log > best - NEAR.ln()).take(3).collect();
        let words = |w: &&search::Weighed| {
            let error = ground.error_of(&w.point, &w.judged, w.point.faults.len() - 1);
            hypothesis(ground, &w.planted, error).sentence(ground.channels)
        };
        let list: Vec<String> = near.iter().map(words).collect();
        if !list.is_empty() {
            finding.what.push_str(&format!("; nearly as likely: {}", list.join(", or ")));
        }
        if let Some(words) = lacking(ground, &found.point.faults[k]) {
            finding.what.push_str(words);
            finding.severity = Severity::Remark;
        }
        if let Planted::Sized(fault, _) = &found.point.faults[k]
            && fault.fault == Fault::ZeroShift
            && let Some(record) = ground.records.first()
        {
            // behind a unit of time that was mended, in the times of the record
            let at = fault.at / factor;
            let behind = record.time.iter().filter(|t| **t >= at).count();
            finding = finding.at(at, record.time.last().copied().unwrap_or(at), behind);
        }
        finding.biases = ground.biases(accepted.without.as_ref().unwrap_or(null), (&found.point, &found.judged));
        finding
    };
    found.accepted.iter().enumerate().map(of).collect()
}

/// What a model may lack that does the same: a constant that moves its inputs, or a lag between all inputs and the only output.
fn lacking(ground: &Ground<'_>, planted: &Planted) -> Option<&'static str> {
    let alone = |s: Slot| matches!(s, Slot::Output(_)) && ground.channels.outputs == 1 && !ground.witness.reads(s);
    match (planted.fault(), &planted.slots()[..], &planted.edits()[..]) {
        (Fault::Offset, [Slot::Input(_)], _) => Some("; a constant that the model lacks, a trim, would do the same"),
        (Fault::Filtered, [slot], _) if alone(*slot) => Some("; a lag that the model lacks would do the same"),
        (Fault::Delay, [slot], [Edit::Delay(_, by)]) if *by > 0.0 && alone(*slot) => None,
        _ => None,
    }
}
