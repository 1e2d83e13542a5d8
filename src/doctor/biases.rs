//! What a fault does to the parameters: a fit without its repair beside one with it.

use crate::finding::{Bias, Finding};
use crate::hypothesis::Slot;
use crate::hypothesis::{Channels, column, put};
use fdm_estimate::Estimate;
use fdm_system::Model;
use fdm_system::record::{Run, bridge};

/// Values of the first fit minus those of the second, in standard errors of the second; the largest first, those above a tenth.
pub(crate) fn biases_of(without: Option<&Estimate>, with: Option<&Estimate>) -> Vec<Bias> {
    let (Some(without), Some(with)) = (without, with) else { return Vec::new() };
    const LEAST: f64 = 0.1;
    let bias = |p: &fdm_estimate::ParameterEstimate| {
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

/// The runs without the samples that findings do not believe: gaps of outputs, bridged inputs.
pub(crate) fn mask(model: &Model, runs: &[Run], findings: &[Finding]) -> Vec<Run> {
    let channels = Channels::new(model.definition());
    let mut masked: Vec<Run> = runs.to_vec();
    for finding in findings.iter().filter(|f| !f.samples.is_empty()) {
        let (Some(run), Some(slot)) = (
            masked.iter_mut().find(|r| r.name == finding.run),
            channels.slots().find(|s| finding.channels.first().is_some_and(|c| c == channels.name(*s))),
        ) else {
            continue;
        };
        let mut values = column(run, slot);
        finding.samples.iter().for_each(|k| values[*k] = f64::NAN);
        if values.iter().all(|v| v.is_nan()) {
            continue;
        }
        if matches!(slot, Slot::Input(_)) {
            let time = run.time.clone();
            bridge(&time, &mut values, 1, 0, false);
        }
        put(run, slot, &values);
    }
    masked
}
