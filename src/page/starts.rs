//! What came of many starts: their costs in order, so that one sees how many minima there are and how often the best was found.

use super::document::Section;
use super::figure::{Figure, Look, Mark, Panel};
use super::number::{shown, text};
use super::subject::Subject;
use maud::html;
use serde_json::Value;

/// Costs that are closer to the best than this are drawn here: no data tell them apart.
const SAME: f64 = 1e-3;
/// Starts in the table.
const LISTED: usize = 40;

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let (figure, order) = (figure(subject)?, ordered(subject));
    let failed = subject.list("starts").len() - order.len();
    let reached = order.iter().filter(|s| s["minimum"] == 1).count();
    let content = html! {
        p {
            (subject.list("starts").len())
            @if let Some(asked) = subject.result["starts_asked"].as_u64() { " of " (asked) }
            " starts"
            @if reached > 0 { ", of which " (reached) " reached the best minimum" }
            @if failed > 0 { "; " (failed) " failed" }
            "."
        }
        (figure.markup())
        details {
            summary { "as a table" }
            div.scroll { table {
                thead { tr { th.number { "start" } th.number { "cost" } th.number { "minimum" } th.number { "distance" } th.number { "corrections" } th { "end" } } }
                tbody { @for s in order.iter().take(LISTED) { tr {
                    td.number { @if s["start"] == 1 { "given" } @else { (s["start"]) } }
                    td.number { (shown(&s["cost"], 8)) } td.number { (shown(&s["minimum"], 4)) } td.number { (shown(&s["distance"], 2)) }
                    td.number { (s["iterations"]) } td { (s["message"].as_str().unwrap_or_default()) }
                } } }
            } }
            @if order.len() > LISTED { p.note { (order.len() - LISTED) " more have a higher cost." } }
        }
    };
    Some(Section::new("starts", "Many starts", content))
}

/// Those that have a cost, the least first.
fn ordered(subject: &Subject) -> Vec<&Value> {
    let mut order: Vec<&Value> = subject.list("starts").iter().filter(|s| s["cost"].is_number()).collect();
    order.sort_by(|a, b| cost(a).total_cmp(&cost(b)).then(a["start"].as_u64().cmp(&b["start"].as_u64())));
    order
}

fn cost(start: &Value) -> f64 {
    start["cost"].as_f64().unwrap_or(f64::INFINITY)
}

/// The waterfall.
pub(super) fn figure(subject: &Subject) -> Option<Figure> {
    let order = ordered(subject);
    if order.len() < 2 {
        return None;
    }
    let best = cost(order[0]);
    let above: Vec<f64> = order.iter().map(|s| (cost(s) - best).max(SAME)).collect();
    let those = |wanted: fn(&Value) -> bool| -> Vec<f64> {
        order.iter().zip(&above).map(|(s, v)| if wanted(s) { *v } else { f64::NAN }).collect()
    };
    let converged = |s: &Value| s["termination"] == "converged";
    // while starts are at work nobody has told their minima apart
    let known = order.iter().any(|s| s["minimum"].is_number());
    let marks = match known {
        true => vec![
            Mark::dots("best minimum", Look::Model, those(|s| s["minimum"] == 1)),
            Mark::dots(
                "another minimum",
                Look::Residual,
                those(|s| s["minimum"] != 1 && s["termination"] == "converged"),
            ),
            Mark::dots(
                "not converged",
                Look::Measured,
                those(|s| s["minimum"] != 1 && s["termination"] != "converged"),
            ),
        ],
        false => vec![
            Mark::dots("converged", Look::Model, those(converged)),
            Mark::dots("not converged", Look::Measured, those(|s| s["termination"] != "converged")),
        ],
    };
    let marks = marks.into_iter().filter(|m| m.values.iter().any(|v| v.is_finite())).collect();
    let name = |s: &&Value| format!("start {}: {}", s["start"], s["message"].as_str().unwrap_or_default());
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
