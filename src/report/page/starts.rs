//! What came of many starts: their costs in order, so that one sees how many minima there are and how often the best was found.

use super::figure::{Figure, Look, Mark, Panel};
use super::number::{shown, text};
use super::section::Section;
use super::subject::{Content, Subject};
use fdm_results::documents::{StartDocument, Terminated};
use maud::html;

/// Costs that are closer to the best than this are drawn here: no data tell them apart.
const SAME: f64 = 1e-3;
/// Starts in the table.
const LISTED: usize = 40;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let (figure, order) = (figure(subject)?, ordered(subject));
    let failed = subject.starts().len() - order.len();
    let reached = order.iter().filter(|s| s.minimum == Some(1)).count();
    let asked = match &subject.content {
        Content::AtWork(told, _) => told.result.starts_asked,
        _ => None,
    };
    let content = html! {
        p {
            (subject.starts().len())
            @if let Some(asked) = asked { " of " (asked) }
            " starts"
            @if reached > 0 { ", of which " (reached) " reached the best minimum" }
            @if failed > 0 { "; " (failed) " failed" }
            "."
        }
        (figure.markup())
        details {
            summary { "as a table" }
            div.scroll { table {
                thead { tr { th.number { "start" } th.number { "cost" } th.number { "minimum" } th.number { "distance" } th.number { "iterations" } th { "end" } } }
                tbody { @for s in order.iter().take(LISTED) { tr {
                    td.number { @if s.start == 1 { "given" } @else { (s.start) } }
                    td.number { (shown(s.cost, 8)) } td.number { (shown(s.minimum.map(|m| m as f64), 4)) } td.number { (shown(s.distance, 2)) }
                    td.number { (s.iterations) } td { (s.message) }
                } } }
            } }
            @if order.len() > LISTED { p.note { (order.len() - LISTED) " more have a higher cost." } }
        }
    };
    Some(Section::new("starts", "Many starts", content))
}

/// Those that have a cost, the least first.
fn ordered(subject: &Subject) -> Vec<&StartDocument> {
    let mut order: Vec<&StartDocument> = subject.starts().iter().filter(|s| s.cost.is_some()).collect();
    order.sort_by(|a, b| cost(a).total_cmp(&cost(b)).then(a.start.cmp(&b.start)));
    order
}

fn cost(start: &StartDocument) -> f64 {
    start.cost.unwrap_or(f64::INFINITY)
}

/// The waterfall.
pub(super) fn figure(subject: &Subject) -> Option<Figure> {
    let order = ordered(subject);
    if order.len() < 2 {
        return None;
    }
    let best = cost(order[0]);
    let above: Vec<f64> = order.iter().map(|s| (cost(s) - best).max(SAME)).collect();
    let those = |wanted: fn(&StartDocument) -> bool| -> Vec<f64> {
        order.iter().zip(&above).map(|(s, v)| if wanted(s) { *v } else { f64::NAN }).collect()
    };
    let converged = |s: &StartDocument| s.termination == Some(Terminated::Converged);
    // while starts are at work nobody has told their minima apart
    let known = order.iter().any(|s| s.minimum.is_some());
    let marks = match known {
        true => vec![
            Mark::dots("best minimum", Look::Model, those(|s| s.minimum == Some(1))),
            Mark::dots(
                "another minimum",
                Look::Residual,
                those(|s| s.minimum != Some(1) && s.termination == Some(Terminated::Converged)),
            ),
            Mark::dots(
                "not converged",
                Look::Measured,
                those(|s| s.minimum != Some(1) && s.termination != Some(Terminated::Converged)),
            ),
        ],
        false => vec![
            Mark::dots("converged", Look::Model, those(converged)),
            Mark::dots("not converged", Look::Measured, those(|s| s.termination != Some(Terminated::Converged))),
        ],
    };
    let marks = marks.into_iter().filter(|m| m.values.iter().any(|v| v.is_finite())).collect();
    let name = |s: &&StartDocument| format!("start {}: {}", s.start, s.message);
    Some(Figure {
        id: "starts-1".into(),
        group: "starts".into(),
        caption: format!("costs of the starts in their order, above the best ({})", text(best, 8)),
        label: "rank of the start".into(),
        logarithmic: false,
        at: (1..=order.len()).map(|k| k as f64).collect(),
        panels: vec![Panel { label: "cost above the best".into(), height: 170, logarithmic: true, marks }],
        names: order.iter().map(name).collect(),
        half: false,
        samples: None,
    })
}
