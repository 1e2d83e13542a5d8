//! What was found in records, as text.

use crate::visible;
use fdm_doctor::{Finding, Severity};
use fdm_results::documents::DoctorDocument;

/// Parameters that a finding names.
const SHOWN: usize = 4;

/// Every finding with its place, odds, biases and repair.
pub fn doctor_text(found: &DoctorDocument) -> String {
    let (findings, remarks): (Vec<&Finding>, Vec<&Finding>) =
        found.findings.iter().partition(|f| f.severity == Severity::Finding);
    let count = |n: usize, word: &str| format!("{n} {word}{}", if n == 1 { "" } else { "s" });
    let beside = match &found.model {
        Some(model) => format!("beside model {model}, {}", count(found.fits, "fit")),
        None => "without a model".into(),
    };
    let (said, runs) = (count(findings.len(), "finding"), count(found.records.len(), "record"));
    let mut text = format!("{said}, {} in {runs} ({beside})\n", count(remarks.len(), "remark"));
    for (k, finding) in findings.iter().enumerate() {
        text.push_str(&format!("\n{}. {}", k + 1, block(finding)));
    }
    for remark in &remarks {
        text.push_str(&format!("\nremark: {}", block(remark)));
    }
    let assumed = found.records.iter().filter(|r| !r.assumed.is_empty());
    for record in assumed {
        text.push_str(&format!("\nassumed of run {}:\n", visible(&record.run)));
        record.assumed.iter().for_each(|a| text.push_str(&format!("   {}\n", visible(a))));
    }
    found.notes.iter().for_each(|note| text.push_str(&format!("\nnote: {}\n", visible(note))));
    text
}

fn block(finding: &Finding) -> String {
    let channels = finding.channels.join(", ");
    let odds = if finding.severity == Severity::Remark { String::new() } else { format!(" ({})", finding.odds()) };
    let mut text = format!(
        "{} in run {}: {}: {}{odds}\n",
        visible(&channels),
        visible(&finding.run),
        finding.fault,
        visible(&finding.what)
    );
    if let Some(place) = finding.place {
        text.push_str(&format!("   where: {:.6} to {:.6}, {} sample(s)\n", place.from, place.to, place.samples));
    }
    if let Some(line) = bias_line(finding) {
        text.push_str(&format!("   bias: {line}\n"));
    }
    if let Some(repair) = &finding.repair {
        text.push_str(&format!("   repair: {}\n", visible(&repair.line)));
    }
    text
}

/// What a fault does to the parameters it moves most.
pub(crate) fn bias_line(finding: &Finding) -> Option<String> {
    let first = finding.biases.iter().take(SHOWN);
    let list: Vec<String> = first.map(|b| format!("{} {:+.3}", visible(&b.parameter), b.standard_errors)).collect();
    if list.is_empty() {
        return None;
    }
    let more = finding.biases.len().saturating_sub(SHOWN);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    Some(format!("{}{more} standard errors", list.join(", ")))
}
