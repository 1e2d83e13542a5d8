//! What a fit that does not explain an output asks the doctor, and where the answer stands.

use crate::progress::Progress;
use fdm_doctor::leading;
use fdm_estimate::{Estimate, Unexplained, Work};
use fdm_infer::first_cause;
use fdm_results::documents::{About, FitDocument};
use fdm_system::Model;
use fdm_system::record::Run;

/// Where an output is not explained, or moves otherwise than its response does while what is left is no noise, the first finding of the doctor about the
/// records that were fitted: in the document, and behind the verdict.
/// Values that were judged where none had been looked for explain little, whatever the records are.
pub(crate) fn ask_doctor(
    (model, estimate, runs): (&Model, &Estimate, &[Run]),
    document: &mut FitDocument,
    verdict: &mut String,
    progress: &Progress,
) {
    let judged_only = estimate.iterations == 0 && !estimate.termination.is_good();
    let found: Vec<String> = match document.remarks.iter().any(|r| r.about == About::Unexplained) {
        true => Unexplained::of(estimate).into_iter().map(|u| u.output).collect(),
        false if estimate.termination.is_good() => Unexplained::unlike(estimate),
        false => Vec::new(),
    };
    if judged_only || found.is_empty() {
        return;
    }
    let outputs: Vec<&str> = found.iter().map(String::as_str).collect();
    document.first_cause = first_cause(model, runs, &outputs, &Work::until(&progress.halt().aside()));
    let Some(found) = &document.first_cause else { return };
    for line in leading(std::slice::from_ref(found)) {
        verdict.push_str(&format!("\n`fdm doctor` says of the record: {line}; it shows the repair."));
    }
}
