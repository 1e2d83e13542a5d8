//! The page of a simulation-based calibration: ranks of the truth among draws, parameter by parameter.

use super::document::{Head, frame};
use super::figure::{Figure, Look, Mark, Panel, Shape};
use super::headline::judgement;
use super::number::{probability, shown};
use super::section::{Section, Trust};
use super::subject::called;
use fdm_numeric::statistics::normal_quantile;
use fdm_results::documents::calibration::{CalibratedParameter, CalibrationDocument};
use maud::{Markup, html};

/// Parameters that are drawn.
const DRAWN: usize = 24;

/// A page of a calibration.
pub fn calibration_page(found: &CalibrationDocument) -> String {
    let figures: Vec<Figure> =
        found.parameters.iter().take(DRAWN).enumerate().map(|(k, p)| histogram(k, p, found.done)).collect();
    let sections = vec![
        Section::new("parameters", "Ranks of the truth", table(found)),
        Section::new(
            "ranks",
            "Histograms",
            html! {
                p { "Uniform where the draws are those of the posterior. The band holds 95 of 100 columns." }
                div.pair { @for figure in &figures { (figure.markup()) } }
            },
        ),
    ];
    let (trust, sentence) = match (found.is_good(), found.done == found.asked) {
        (true, _) => (Trust::Good, "The ranks are uniform: draws and intervals are what they say."),
        (false, false) => (Trust::Reserved, "Repeats are missing."),
        (false, true) => (Trust::Bad, "The ranks are not uniform: draws and intervals are not what they say."),
    };
    let facts = format!(
        "{} of {} repeats, {} ranks, family-wise p {}, seed {}.",
        found.done,
        found.asked,
        found.levels,
        probability(found.p),
        found.seed
    );
    let verdict = judgement((trust, sentence.into(), Vec::new()), Some(facts), &[]);
    frame(&Head { kind: "calibration", name: &found.model, doc: None, verdict }, &sections)
}

fn table(found: &CalibrationDocument) -> Markup {
    html! {
        div.scroll { table {
            thead { tr { th { "parameter" } th.number { "mean rank" } th.number { "shift" } th.number { "spread" } th.number { "p" } th { "draws" } } }
            tbody { @for p in &found.parameters { tr {
                th scope="row" { code { (called(&p.name, p.run.as_deref())) } }
                td.number { (shown(p.mean_rank, 3)) } td.number { (shown(p.shift, 2)) } td.number { (shown(p.spread, 2)) }
                td.number { (probability(p.p)) } td { (p.said(found.alone())) }
            } } }
        } }
        p.note { "Shift and spread are standard normal variates where ranks are uniform. p is that of Neyman's smooth test of order 4." }
    }
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
    Figure {
        id: format!("ranks-{}", k + 1),
        group: "ranks".into(),
        caption: called(&p.name, p.run.as_deref()),
        label: "rank of the truth [%]".into(),
        logarithmic: false,
        at: (0..columns).map(|c| (c as f64 + 0.5) * 100.0 * share).collect(),
        panels: vec![Panel { label: "repeats".into(), height: 130, logarithmic: false, marks }],
        names: Vec::new(),
        half: true,
        samples: None,
    }
}
