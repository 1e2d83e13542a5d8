//! What was found in records: each finding in words, what it does and how it is mended, and its channel over time with the place marked.

use super::section::{Part, Report, Section, Trust, Verdict};
use crate::page::figure::{Figure, Look, Mark, Panel};
use crate::page::number::bracketed;
use crate::page::thinning::Kept;
use crate::{html, text, visible};
use fdm_doctor::{Channel, Finding, Record, Severity};
use fdm_results::documents::DoctorDocument;
use fdm_system::record::Assumptions;

/// Parameters that a finding names.
const SHOWN: usize = 4;
/// Points of a figure.
const POINTS: usize = 4000;
/// Channels that are drawn of one finding.
const DRAWN: usize = 3;

/// Every finding with its place, odds, biases and repair.
pub fn doctor_text(found: &DoctorDocument) -> String {
    text::below(format!("{}\n", facts(found)), &sections(found, &[]))
}

/// A page of what was found in records, with the records themselves.
pub fn doctor_page(found: &DoctorDocument, records: &[Record]) -> String {
    let of = |severity: Severity| found.findings.iter().filter(move |f| f.severity == severity);
    let (findings, remarks) = (of(Severity::Finding).count(), of(Severity::Remark).count());
    let (trust, said) = match (findings, remarks) {
        (0, 0) => (Trust::Good, "Nothing was found that speaks against these records.".to_string()),
        (0, 1) => (Trust::Good, "No fault was found; one thing is worth knowing of these records:".into()),
        (0, n) => (Trust::Good, format!("No fault was found; {n} things are worth knowing of these records:")),
        (1, _) => (Trust::Reserved, "One thing should be mended before these records are used:".into()),
        (n, _) => (Trust::Reserved, format!("{n} things should be mended before these records are used:")),
    };
    let name = found.model.clone().or_else(|| records.first().map(|r| r.run.clone()));
    html::page(&Report {
        kind: "records judged".into(),
        name: name.unwrap_or_else(|| "records".into()),
        doc: None,
        verdict: Verdict::new(trust, said)
            .with_facts(format!("{}.", facts(found)))
            .with_points(of(Severity::Finding).map(finding_sentence), "findings")
            .with_points(of(Severity::Remark).map(finding_sentence), "remarks"),
        sections: sections(found, records),
    })
}

/// How much was found in how much.
fn facts(found: &DoctorDocument) -> String {
    let count = |n: usize, word: &str| format!("{n} {word}{}", if n == 1 { "" } else { "s" });
    let findings = found.findings.iter().filter(|f| f.severity == Severity::Finding).count();
    let remarks = count(found.findings.len() - findings, "remark");
    let beside = match &found.model {
        Some(model) => format!("beside model {model}, {}", count(found.fits, "fit")),
        None => "without a model".into(),
    };
    format!("{}, {remarks} in {} ({beside})", count(findings, "finding"), count(found.records.len(), "record"))
}

fn sections(found: &DoctorDocument, records: &[Record]) -> Vec<Section> {
    let (findings, remarks): (Vec<_>, Vec<_>) =
        found.findings.iter().enumerate().partition(|(_, f)| f.severity == Severity::Finding);
    let numbered = findings.iter().enumerate().flat_map(|(n, (k, f))| parts(&format!("{}.", n + 1), *k, f, records));
    let noted = remarks.iter().flat_map(|(k, f)| parts("remark:", *k, f, records));
    let mut all = vec![
        Section::new("findings", "Findings").with_all(numbered),
        Section::new("remarks", "Remarks").with_all(noted),
        assumed(found),
    ];
    all.retain(|s| !s.parts.is_empty());
    all
}

/// A finding in a sentence.
fn finding_sentence(finding: &Finding) -> String {
    let sure = if finding.severity == Severity::Remark { String::new() } else { format!(" ({})", finding.sureness()) };
    let (channels, what) = (finding.channels.join(", "), visible(&finding.what));
    format!("{} in run {}: {}: {what}{sure}", visible(&channels), visible(&finding.run), finding.fault)
}

/// A finding with its place, what it does, its repair, and a figure; it has the place `k` among all.
fn parts(number: &str, k: usize, finding: &Finding, records: &[Record]) -> Vec<Part> {
    let place = finding.place.map(|p| format!("where: {:.6} to {:.6}, {} sample(s)", p.from, p.to, p.samples));
    let bias = bias_line(finding).map(|line| format!("bias: {line}"));
    let repair = finding.repair.as_ref().map(|repair| format!("repair: {}", visible(&repair.line)));
    let more: Vec<String> = [place, bias, repair].into_iter().flatten().collect();
    let mut parts = vec![Part::Heading(format!("{number} {}", finding_sentence(finding)))];
    if !more.is_empty() {
        parts.push(Part::List(more));
    }
    parts.extend(figure(k, finding, records).map(Part::from));
    parts
}

/// What a fault does to the parameters it moves most.
fn bias_line(finding: &Finding) -> Option<String> {
    let first = finding.biases.iter().take(SHOWN);
    let list: Vec<String> = first.map(|b| format!("{} {:+.3}", visible(&b.parameter), b.standard_errors)).collect();
    let more = finding.biases.len().saturating_sub(SHOWN);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!list.is_empty()).then(|| format!("{}{more} standard errors", list.join(", ")))
}

/// What was assumed about the records, and what could not be looked at.
fn assumed(found: &DoctorDocument) -> Section {
    let of = |record: &Assumptions| {
        let (run, sentences) = (visible(&record.run).into_owned(), record.sentences());
        let list: Vec<String> = sentences.iter().map(|a| visible(a).into_owned()).collect();
        let mut parts = vec![Part::Line(format!("`{run}`: {} samples", record.used)).on_page()];
        if !list.is_empty() {
            parts.extend([Part::Heading(format!("assumed of run {run}:")).in_text(), Part::List(list)]);
        }
        parts
    };
    let notes = found.notes.iter().flat_map(|note| [Part::Gap, Part::Note(format!("note: {}", visible(note)))]);
    Section::new("records", "Records").with_all(found.records.iter().flat_map(of)).with_all(notes)
}

/// The channels of a finding in its run, or in the first where it is about all.
fn figure(k: usize, finding: &Finding, records: &[Record]) -> Option<Figure> {
    let record = records.iter().find(|r| r.run == finding.run).or_else(|| records.first())?;
    let named: Vec<&Channel> =
        record.channels.iter().filter(|c| finding.channels.contains(&c.name)).take(DRAWN).collect();
    if record.time.is_empty() {
        return None;
    }
    let intervals: Vec<f64> = record.time.windows(2).map(|w| w[1] - w[0]).chain([f64::NAN]).collect();
    let lines: Vec<&[f64]> =
        if named.is_empty() { vec![&intervals] } else { named.iter().map(|c| &c.values[..]).collect() };
    let kept = Kept::new(&lines, POINTS);
    let pick = |values: &[f64]| kept.pick(values);
    let within = |values: &[f64]| -> Vec<f64> {
        let Some(place) = finding.place else { return Vec::new() };
        let inside = |k: &usize| record.time[*k] >= place.from && record.time[*k] <= place.to;
        kept.indices().iter().map(|k| if inside(k) { values[*k] } else { f64::NAN }).collect()
    };
    let panel = |label: String, values: &[f64]| {
        let mut marks = vec![Mark::samples("record", Look::Measured, pick(values))];
        let marked = within(values);
        if marked.iter().any(|v| v.is_finite()) {
            marks.push(Mark::dots("finding", Look::Residual, marked));
        }
        Panel::new(label, 150, marks)
    };
    let panels = match named.is_empty() {
        true => vec![panel("interval".into(), &intervals)],
        false => {
            named.iter().map(|c| panel(format!("{}{}", c.name, bracketed(c.unit.as_deref())), &c.values)).collect()
        }
    };
    Some(
        Figure::new(
            format!("finding-{}", k + 1),
            format!("{} in run {}", finding.fault, record.run),
            "t",
            pick(&record.time),
        )
        .in_group(format!("run-{}", record.run))
        .with_all(panels)
        .thinned(kept.samples()),
    )
}
