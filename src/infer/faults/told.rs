//! Faults that were found, in words.

use super::ground::{Ground, Planted, Point};
use super::search::{self, Accepted, Found};
use super::weighing::Judged;
use super::{NO_FAULT, Weighed};
use crate::search::log_sum;
use fdm_doctor::{Bias, Fault, Finding, Hypothesis, Repair, Severity, Slot, time_factor};
use fdm_estimate::{Estimate, ParameterEstimate};
use fdm_system::record::Run;

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
    let none = Weighed { what: NO_FAULT.into(), evidence: 0.0, probability: (-all).exp() };
    let of =
        |w: &search::Weighed| Weighed { what: sentence(ground, w), evidence: w.log, probability: (w.log - all).exp() };
    let mut list: Vec<Weighed> = found.first.iter().map(of).chain([none]).collect();
    list.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    list.truncate(SHOWN);
    list
}

/// A hypothesis in a sentence.
fn sentence(ground: &Ground<'_>, weighed: &search::Weighed) -> String {
    let fault = hypothesis(ground, &weighed.point, &weighed.judged, weighed.point.faults.len() - 1);
    match weighed.planted {
        Planted::Beginning(k) => format!("`{}` {}", ground.stated[k].name, fault.what),
        _ => fault.sentence(ground.channels),
    }
}

/// A fault of a point in words, its size with its error.
fn hypothesis(ground: &Ground<'_>, point: &Point, judged: &Judged, k: usize) -> Hypothesis {
    match &point.faults[k] {
        Planted::Discrete(hypothesis) => hypothesis.clone(),
        Planted::Sized(fault, size) => {
            let error = ground.parts(point, judged, k).map_or(1.0, |parts| parts.dispersion().sqrt());
            let error = error * ground.error_of(point, judged, k);
            // a held input that moves within an interval leaves no derivative
            let error = if error < size.abs() { error } else { f64::INFINITY };
            fault.told((*size, error), ground.channels, ground.span)
        }
        Planted::Beginning(state) => {
            let state = &ground.stated[*state];
            let unit = state.unit.as_ref().map_or_else(String::new, |unit| format!(" {unit}"));
            let value = |(run, theta): (&Run, &Vec<f64>)| match ground.runs.len() {
                1 => format!("{:.4}{unit}", theta[state.param]),
                _ => format!("{:.4}{unit} in {}", theta[state.param], run.name),
            };
            let values: Vec<String> = ground.runs.iter().zip(&point.theta).map(value).take(3).collect();
            let stated = ground.model.definition().params[state.param].value;
            let what = format!("begins at {}, where the model states {stated}", values.join(", "));
            Hypothesis { fault: Fault::Beginning, slots: Vec::new(), edits: Vec::new(), what, weight: 1.0, frame: None }
        }
    }
}

/// The accepted faults as findings.
pub(crate) fn findings(ground: &Ground<'_>, found: &Found) -> Vec<Finding> {
    let edits = found.point.edits();
    let factor = time_factor(&edits);
    let of = |(k, accepted): (usize, &Accepted)| {
        let own = hypothesis(ground, &found.point, &found.judged, k);
        let mut finding = own.finding(ground.records, ground.channels, accepted.log_odds);
        if let Planted::Beginning(state) = found.point.faults[k] {
            let name = &ground.stated[state].name;
            finding.channels = vec![name.clone()];
            finding.repair = Some(Repair::words(&format!("free it in the model: state {name} = free")));
        }
        let best = accepted.near.first().map_or(0.0, |w| w.log);
        let others = accepted.near.iter().filter(|w| !w.planted.is_like(&found.point.faults[k]));
        let near: Vec<&search::Weighed> = others.filter(|w| w.log > best - NEAR.ln()).take(3).collect();
        let list: Vec<String> = near.iter().map(|w| sentence(ground, w)).collect();
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
        finding.biases = ground.biases(accepted.without.as_ref().unwrap_or(&found.null), (&found.point, &found.judged));
        finding
    };
    found.accepted.iter().enumerate().map(of).collect()
}

/// What a model may lack that does the same: a constant that moves its inputs, or a lag between all inputs and the only output.
fn lacking(ground: &Ground<'_>, planted: &Planted) -> Option<&'static str> {
    let alone = |s: Slot| matches!(s, Slot::Output(_)) && ground.channels.outputs == 1 && !ground.witness.reads(s);
    match (planted.fault(), &planted.slots()[..]) {
        (Fault::Offset, [Slot::Input(_)]) => Some("; a constant that the model lacks, a trim, would do the same"),
        (Fault::Filtered, [slot]) if alone(*slot) => Some("; a lag that the model lacks would do the same"),
        _ => None,
    }
}
