//! A fit as text: parameters, residuals, what should not be overlooked, and how it came about.

use super::section::{Part, Section};
use crate::{parameters, remarks, residuals, text};
use fdm_estimate::Estimate;
use fdm_results::documents::{FitDocument, OutputDocument, Remark, estimate_remarks};

/// How much a table tells.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Detail {
    /// The interval of 95 % of each parameter.
    pub intervals: bool,
    /// Every remark, not only the five that speak most against the result.
    pub verbose: bool,
}

/// Parameters with standard errors, then the quality of each output, then what should not be overlooked.
pub fn estimate_table(estimate: &Estimate) -> String {
    estimate_text(estimate, Detail { verbose: true, ..Detail::default() })
}

/// Parameters with standard errors, the quality of each output and remarks, with so much detail.
pub fn estimate_text(estimate: &Estimate, detail: Detail) -> String {
    let outputs: Vec<OutputDocument> = estimate.outputs.iter().map(OutputDocument::from).collect();
    let section = Section::new("fit", "Fit").with(parameters::table(&estimate.parameters, false));
    let section = section.with_all((!outputs.is_empty()).then(|| residuals::table(&outputs)));
    closed(section, said(&estimate_remarks(estimate), detail))
}

/// Tables of a fit in the time domain: parameters with standard errors, each output with the tests of its residuals, and remarks, with so
/// much detail; of a filter the measurement noise too.
pub fn fit_table(fit: &FitDocument, detail: Detail) -> String {
    let tested = fit.outputs.iter().any(|o| o.whiteness.is_some());
    let mut last = said(&fit.remarks, detail);
    if let Some(deviations) = &fit.deviations {
        let innovations = "residuals are innovations: measured minus predicted from the sample before";
        if tested {
            last.push(Part::Line(innovations.into()));
        }
        if tested && !deviations.is_empty() {
            last.push(parameters::table(deviations, detail.intervals).into());
        }
    }
    let silent = fit.not_identifiable.iter().flatten();
    last.extend(silent.map(|name| Part::Line(format!("`{name}` stands at 0: the records show no noise there"))));
    let section = Section::new("fit", "Fit").with(parameters::table(&fit.parameters, detail.intervals && tested));
    let section = section.with_all((!fit.outputs.is_empty()).then(|| residuals::table(&fit.outputs)));
    closed(section, last)
}

/// Remarks as lines.
pub(crate) fn said(remarks: &[Remark], detail: Detail) -> Vec<Part> {
    remarks::lines(remarks, detail.verbose).into_iter().map(Part::Line).collect()
}

/// With what is said last; its last line is left open.
pub(crate) fn closed(section: Section, last: Vec<Part>) -> String {
    if last.is_empty() {
        return text::sections(&[section]);
    }
    let text = text::sections(&[section.with(Part::Gap).with_all(last)]);
    text.trim_end_matches('\n').into()
}

/// One line on every strategy that led to the estimates; empty when the plain iteration did.
pub fn way(fit: &FitDocument) -> String {
    let substituted = fit.substituted.as_deref().filter(|states| !states.is_empty());
    let substituted = substituted
        .map(|states| format!("started from a fit with the measured {} in the equations", states.join(", ")));
    let fallback = fit.fallback_message.clone().flatten();
    let shooting = fit.shooting.as_ref().and_then(|cut| cut.as_ref()).map(|cut| {
        let end = match cut.polished {
            true => "the whole model went on from there without cuts".to_string(),
            false => format!("largest gap left {:.0e} of the state's size", cut.largest_gap),
        };
        format!("multiple shooting in {} segments; {end}", cut.segments)
    });
    [substituted, fallback, shooting].into_iter().flatten().map(|line| format!("{line}\n")).collect()
}
