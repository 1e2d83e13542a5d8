//! A simulation-based calibration: ranks of the truth among draws, a row and a histogram for each parameter.

use super::overlay::bars;
use super::section::{Part, Report, Rows, Section, Trust, Verdict, sentence};
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::{html, text};
use fdm_numeric::statistics::normal_quantile;
use fdm_results::documents::calibration::{CalibratedParameter, CalibrationDocument};
use fdm_results::documents::with_run;

/// Parameters that are drawn.
const DRAWN: usize = 24;

/// Verdict, then a row for each parameter.
pub fn calibration_text(found: &CalibrationDocument) -> String {
    let head = format!("{}: {}\n{}\n", found.model, verdict(found).1, facts(found));
    text::below(head, &[ranks(found)])
}

/// A page of a calibration.
pub fn calibration_page(found: &CalibrationDocument) -> String {
    let drawn = found.parameters.iter().take(DRAWN).enumerate().map(|(k, p)| histogram(k, p, found.done));
    let histograms = Section::new("ranks", "Histograms")
        .line("Uniform where the draws are those of the posterior. The band holds 95 of 100 columns.")
        .with(Part::Pair(drawn.collect()));
    let (trust, clause) = verdict(found);
    html::page(&Report {
        kind: "calibration".into(),
        name: found.model.clone(),
        doc: None,
        verdict: Verdict::new(trust, sentence(clause)).with_facts(format!("{}.", facts(found))),
        sections: vec![ranks(found), histograms],
    })
}

/// What the ranks say, in a clause.
fn verdict(found: &CalibrationDocument) -> (Trust, &'static str) {
    match (found.is_good(), found.done == found.asked) {
        (true, _) => (Trust::Good, "the ranks are uniform: draws and intervals are what they say"),
        (false, false) => (Trust::Reserved, "repeats are missing"),
        (false, true) => (Trust::Bad, "the ranks are not uniform: draws and intervals are not what they say"),
    }
}

fn facts(found: &CalibrationDocument) -> String {
    format!(
        "{} of {} repeats, family-wise p {:.3}, {} divergent, seed {}",
        found.done, found.asked, found.p, found.divergent, found.seed
    )
}

fn ranks(found: &CalibrationDocument) -> Section {
    let mut table = Rows::over(&found.parameters);
    table.name("parameter", |p| p.name.clone());
    table.runs(|p| p.run.as_deref());
    table.words("ranks", |p| bars(&p.counts)).in_text();
    table.number("mean rank", |p| format!("{:.3}", p.mean_rank));
    table.number("shift", |p| format!("{:.1}", p.shift));
    table.number("spread", |p| format!("{:.1}", p.spread));
    table.number("p", |p| format!("{:.3}", p.p));
    table.words("", |p| p.judgement(found.alone()));
    let note = "Shift and spread are standard normal variates where ranks are uniform. p is that of Neyman's smooth test of order 4.";
    Section::new("parameters", "Ranks of the truth").with(table).explained(note)
}

fn histogram(k: usize, p: &CalibratedParameter, done: usize) -> Figure {
    let columns = p.counts.len();
    let share = 1.0 / columns as f64;
    let mean = done as f64 * share;
    let half = normal_quantile(0.975) * (mean * (1.0 - share)).sqrt();
    let marks = vec![
        Mark::between(
            "95 of 100 columns",
            Look::Bound,
            Shape::Band,
            vec![(mean - half).max(0.0); columns],
            vec![mean + half; columns],
        ),
        Mark::between(
            "repeats",
            Look::Measured,
            Shape::Columns,
            vec![0.0; columns],
            p.counts.iter().map(|n| *n as f64).collect(),
        ),
    ];
    Figure::new(
        format!("ranks-{}", k + 1),
        with_run(&p.name, p.run.as_deref()),
        "rank of the truth [%]",
        (0..columns).map(|c| (c as f64 + 0.5) * 100.0 * share).collect(),
    )
    .in_group("ranks")
    .with(Panel::new("repeats", 130, marks))
    .half()
}
