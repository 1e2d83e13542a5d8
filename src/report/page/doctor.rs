//! The page of the doctor: each finding in words, and its channel over time with the place marked.

use super::document::{Head, frame};
use super::figure::{Figure, Look, Mark, Panel};
use super::headline::judgement;
use super::number::bracketed;
use super::section::{Section, Trust, quoted};
use super::thinning::kept;
use crate::doctor::bias_line;
use fdm_doctor::{Channel, Finding, Record, Severity};
use fdm_results::documents::DoctorDocument;
use maud::{Markup, html};

/// Points of a figure.
const POINTS: usize = 4000;
/// Channels that are drawn of one finding.
const DRAWN: usize = 3;

/// A page of what was found in records, with the records themselves.
pub fn doctor_page(found: &DoctorDocument, records: &[Record]) -> String {
    let (findings, remarks): (Vec<_>, Vec<_>) =
        found.findings.iter().enumerate().partition(|(_, f)| f.severity == Severity::Finding);
    let mut sections = Vec::new();
    for (anchor, title, list) in [("findings", "Findings", &findings), ("remarks", "Remarks", &remarks)] {
        if !list.is_empty() {
            let content = html! { @for (k, finding) in list { (one(*k, finding, records)) } };
            sections.push(Section::new(anchor, title, content));
        }
    }
    sections.push(Section::new("records", "Records", assumed(found)));
    let (trust, sentence) = match (findings.len(), remarks.len()) {
        (0, 0) => (Trust::Good, "Nothing was found that speaks against these records.".to_string()),
        (0, 1) => (Trust::Good, "No fault was found; one thing is worth knowing of these records:".into()),
        (0, n) => (Trust::Good, format!("No fault was found; {n} things are worth knowing of these records:")),
        (1, _) => (Trust::Reserved, "One thing should be mended before these records are used:".into()),
        (n, _) => (Trust::Reserved, format!("{n} things should be mended before these records are used:")),
    };
    let point = |f: &Finding, odds: &str| format!("`{}`: {}: {}{odds}", f.channels.join("`, `"), f.fault, f.what);
    let points = findings
        .iter()
        .map(|(_, f)| (point(f, &format!(" ({})", f.odds())), "findings"))
        .chain(remarks.iter().map(|(_, f)| (point(f, ""), "remarks")));
    let verdict = judgement((trust, sentence, points.collect()), None, &["findings", "remarks"]);
    let name =
        found.model.clone().unwrap_or_else(|| records.first().map_or_else(|| "records".into(), |r| r.run.clone()));
    frame(&Head { kind: "records judged", name: &name, doc: None, verdict }, &sections)
}

fn one(k: usize, finding: &Finding, records: &[Record]) -> Markup {
    let odds = if finding.severity == Severity::Finding { format!(" ({})", finding.odds()) } else { String::new() };
    let said = format!(
        "`{}` in run `{}`: {}: {}{odds}",
        finding.channels.join("`, `"),
        finding.run,
        finding.fault,
        finding.what
    );
    html! {
        h3 { (quoted(&said)) }
        @if let Some(place) = finding.place {
            p { "From " (super::number::text(place.from, 6)) " to " (super::number::text(place.to, 6)) ", " (place.samples) " sample(s)." }
        }
        @if let Some(line) = bias_line(finding) { p { "Bias: " (line) "." } }
        @if let Some(repair) = &finding.repair { p { "Repair: " code { (repair.line) } } }
        @if let Some(figure) = figure(k, finding, records) { (figure.markup()) }
    }
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
    let indices = kept(&lines, POINTS);
    let pick = |values: &[f64]| indices.iter().filter_map(|k| values.get(*k).copied()).collect::<Vec<f64>>();
    let within = |values: &[f64]| -> Vec<f64> {
        let Some(place) = finding.place else { return Vec::new() };
        let inside = |k: &usize| record.time[*k] >= place.from && record.time[*k] <= place.to;
        indices.iter().map(|k| if inside(k) { values[*k] } else { f64::NAN }).collect()
    };
    let panel = |label: String, values: &[f64]| {
        let mut marks = vec![Mark::line("record", Look::Measured, pick(values))];
        let marked = within(values);
        if marked.iter().any(|v| v.is_finite()) {
            marks.push(Mark::dots("finding", Look::Residual, marked));
        }
        Panel { label, height: 150, logarithmic: false, marks }
    };
    let panels = match named.is_empty() {
        true => vec![panel("interval".into(), &intervals)],
        false => {
            named.iter().map(|c| panel(format!("{}{}", c.name, bracketed(c.unit.as_deref())), &c.values)).collect()
        }
    };
    Some(Figure {
        id: format!("finding-{}", k + 1),
        group: format!("run-{}", record.run),
        caption: format!("{} in run {}", finding.fault, record.run),
        label: "t".into(),
        logarithmic: false,
        at: pick(&record.time),
        panels,
        names: Vec::new(),
        half: false,
        samples: (indices.len() < record.time.len()).then_some(record.time.len()),
    })
}

fn assumed(found: &DoctorDocument) -> Markup {
    html! {
        @for record in &found.records {
            @let sentences = record.sentences();
            p { code { (record.run) } ": " (record.used) " samples" }
            @if !sentences.is_empty() { ul { @for sentence in &sentences { li { (quoted(sentence)) } } } }
        }
        @for note in &found.notes { p.note { (note) } }
    }
}
