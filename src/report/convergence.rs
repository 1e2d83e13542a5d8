//! How the iteration came to its end.

use super::section::{Part, Rows, Section};
use crate::page::figure::{Figure, Look, Mark, Panel};
use crate::page::subject::Subject;
use crate::text;
use fdm_estimate::Iteration;
use fdm_results::documents::digits;

/// One row for the start and each iteration: cost, what it changed, damping, size, and how many steps were refused before it.
pub fn history_table(history: &[Iteration]) -> String {
    text::table(table(history))
}

fn table(history: &[Iteration]) -> Rows<&Iteration> {
    let moved = |i: &Iteration, text: String| if i.number == 0 { String::new() } else { text };
    let mut table = Rows::over(history);
    table.number("iteration", |i| i.number);
    table.number("cost", |i| format!("{:.9e}", i.cost));
    table.number("change", |i| moved(i, format!("{:+.2e}", i.change)));
    table.number("damping", |i| moved(i, if i.damping == 0.0 { "0".into() } else { format!("{:.0e}", i.damping) }));
    table.number("largest step / error", |i| moved(i, digits(i.step, 3)));
    table.number("refused", |i| i.refused);
    table
}

/// Cost and step of a result, or of work that goes on.
pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let table = Part::folded("as a table", vec![table(subject.history()).into()]);
    Some(Section::new("convergence", "Convergence").with(figure(subject)?).with(table))
}

/// Cost and step, iteration by iteration.
pub(crate) fn figure(subject: &Subject) -> Option<Figure> {
    let history = subject.history();
    if history.len() < 2 {
        return None;
    }
    let column = |of: fn(&Iteration) -> f64| history.iter().map(of).collect::<Vec<f64>>();
    let (cost, step) = (column(|h| h.cost), column(|h| h.step));
    let least = cost.iter().copied().fold(f64::INFINITY, f64::min);
    let above = cost.iter().map(|v| v - least).collect();
    let positive =
        |values: Vec<f64>| values.into_iter().map(|v| if v > 0.0 { v } else { f64::NAN }).collect::<Vec<f64>>();
    let panel = |label: &str, logarithmic: bool, look: Look, values: Vec<f64>| {
        Panel::new(label, 110, vec![Mark::line(label, look, values.clone()), Mark::dots("", look, values)])
            .scaled(logarithmic)
    };
    Some(
        Figure::new(
            "convergence-1",
            format!(
                "{} {} iterations",
                subject.fit().map_or("so far".to_string(), |fit| format!("{} after", fit.message)),
                subject.fit().map_or_else(|| history.last().map_or(0, |h| h.number), |fit| fit.iterations)
            ),
            "iteration",
            column(|h| h.number as f64),
        )
        .in_group("convergence")
        .with(panel("cost above the least", true, Look::Model, positive(above)))
        .with(panel("size of the step", true, Look::Other, positive(step))),
    )
}
