//! What came of many starts: their costs in order, so that one sees how many minima there are and how often the best was found.

use super::section::{Part, Rows, Section};
use crate::page::figure::{Figure, Look, Mark, Panel};
use crate::page::number::text as number;
use crate::text;
use fdm_grammar::model::Param;
use fdm_results::documents::{StartDocument, Terminated, digits};

/// Costs that are closer to the best than this are drawn here: no data distinguish them.
const SAME: f64 = 1e-3;
/// Starts shown; of more the best.
const SHOWN: usize = 20;

/// The starts in order of their cost, then how many failed and why. `count` is how many were asked for.
pub fn starts_table(starts: &[StartDocument], count: usize) -> String {
    text::sections(&[section(starts, count)])
}

/// Costs in order; of starts at work as far as they have ended.
pub(crate) fn section(starts: &[StartDocument], count: usize) -> Section {
    let mut order: Vec<&StartDocument> = starts.iter().filter(|s| s.cost.is_some()).collect();
    let rank = |s: &StartDocument| s.minimum.unwrap_or(usize::MAX);
    order.sort_by(|a, b| rank(a).cmp(&rank(b)).then(cost(a).total_cmp(&cost(b))).then(a.start.cmp(&b.start)));
    let more = order.len().saturating_sub(SHOWN);
    let mut table = Rows::over(order.into_iter().take(SHOWN));
    table.number("start", |s| if s.start == 1 { "given".into() } else { s.start.to_string() });
    table.number("cost", |s| s.cost.map_or("-".into(), |c| format!("{c:.6e}")));
    table.number("minimum", |s| s.minimum.map_or("-".into(), |m| m.to_string()));
    table.number("distance", |s| s.distance.map_or("-".into(), |d| digits(d, 2)));
    table.number("iterations", |s| s.iterations);
    table.words("end", |s| s.message.clone());
    let more = (more > 0).then(|| Part::Line(format!("and {more} more")));
    let table = std::iter::once(Part::from(table)).chain(more).collect();
    Section::new("starts", "Many starts")
        .with_all(figure(starts))
        .with(Part::folded("as a table", table))
        .with_all(closing(starts, count))
}

fn is_converged(start: &StartDocument) -> bool {
    start.termination == Some(Terminated::Converged)
}

/// What would help the search; empty where there is nothing to say.
pub fn starts_hint(params: &[Param]) -> String {
    let wide = |p: &&Param| p.spans_decades() && p.lower > 0.0 && !p.logarithmic && !p.fixed;
    let names: Vec<&str> = params.iter().filter(wide).map(|p| p.quantity.name.as_str()).collect();
    match &names[..] {
        [] => String::new(),
        [one] => format!("the bounds of {one} span decades: `log` behind them lets the search run in its logarithm\n"),
        more => {
            let names = more.join(", ");
            format!("the bounds of {names} span decades: `log` behind them lets the search run in logarithms\n")
        }
    }
}

fn closing(starts: &[StartDocument], count: usize) -> Vec<Part> {
    let reached = starts.iter().filter(|s| s.minimum == Some(1)).count();
    let converged = starts.iter().filter(|s| is_converged(s)).count();
    let mut text = format!("{count} starts: {converged} converged, {reached} reached the best minimum");
    let failed: Vec<&StartDocument> = starts.iter().filter(|s| s.cost.is_none()).collect();
    if !failed.is_empty() {
        let share = 100.0 * failed.len() as f64 / starts.len() as f64;
        text.push_str(&format!(", {} failed ({share:.0} %)", failed.len()));
    }
    if starts.len() < count {
        text.push_str(&format!(", {} were not begun before the interruption", count - starts.len()));
    }
    let ran_out = starts.iter().filter(|s| s.termination == Some(Terminated::IterationLimit)).count();
    let ran_out = (ran_out > 0)
        .then(|| format!("{ran_out} used all their iterations, half of those of a fit; --iterations N gives more"));
    let reasons = reasons(&failed).into_iter().map(|(reason, number)| {
        let times = if number == 1 { "once".into() } else { format!("{number} times") };
        format!("failed {times}: {reason}")
    });
    std::iter::once(text).chain(ran_out).chain(reasons).map(Part::Line).collect()
}

/// Why starts failed, the most frequent reason first; of many different ones the first few.
fn reasons(failed: &[&StartDocument]) -> Vec<(String, usize)> {
    const REASONS: usize = 5;
    let mut found: Vec<(String, usize)> = Vec::new();
    for s in failed {
        // numbers differ from start to start, the reason does not
        let reason: String = s.message.lines().next().unwrap_or_default().into();
        let kind = reason.split(" at time ").next().unwrap_or_default().to_string();
        match found.iter_mut().find(|(r, _)| *r == kind) {
            Some((_, n)) => *n += 1,
            None => found.push((kind, 1)),
        }
    }
    found.sort_by_key(|(_, number)| std::cmp::Reverse(*number));
    found.truncate(REASONS);
    found
}

/// Starts that have a cost, the least first.
fn ordered(starts: &[StartDocument]) -> Vec<&StartDocument> {
    let mut order: Vec<&StartDocument> = starts.iter().filter(|s| s.cost.is_some()).collect();
    order.sort_by(|a, b| cost(a).total_cmp(&cost(b)).then(a.start.cmp(&b.start)));
    order
}

fn cost(start: &StartDocument) -> f64 {
    start.cost.unwrap_or(f64::INFINITY)
}

/// The waterfall.
pub(crate) fn figure(starts: &[StartDocument]) -> Option<Figure> {
    let order = ordered(starts);
    if order.len() < 2 {
        return None;
    }
    let best = cost(order[0]);
    let above: Vec<f64> = order.iter().map(|s| (cost(s) - best).max(SAME)).collect();
    let those = |wanted: fn(&StartDocument) -> bool| -> Vec<f64> {
        order.iter().zip(&above).map(|(s, v)| if wanted(s) { *v } else { f64::NAN }).collect()
    };
    // while starts are at work their minima are not known
    let known = order.iter().any(|s| s.minimum.is_some());
    let marks = match known {
        true => vec![
            Mark::dots("best minimum", Look::Model, those(|s| s.minimum == Some(1))),
            Mark::dots("another minimum", Look::Residual, those(|s| s.minimum != Some(1) && is_converged(s))),
            Mark::dots("not converged", Look::Measured, those(|s| s.minimum != Some(1) && !is_converged(s))),
        ],
        false => vec![
            Mark::dots("converged", Look::Model, those(is_converged)),
            Mark::dots("not converged", Look::Measured, those(|s| !is_converged(s))),
        ],
    };
    let marks = marks.into_iter().filter(|m| m.values.iter().any(|v| v.is_finite())).collect();
    let name = |s: &&StartDocument| format!("start {}: {}", s.start, s.message);
    Some(
        Figure::new(
            "starts-1",
            format!("costs of the starts in their order, above the best ({})", number(best, 8)),
            "rank of the start",
            (1..=order.len()).map(|k| k as f64).collect(),
        )
        .in_group("starts")
        .with(Panel::new("cost above the best", 170, marks).logarithmic())
        .named(order.iter().map(name).collect()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start(number: usize, cost: Option<f64>, minimum: Option<usize>, message: &str) -> StartDocument {
        StartDocument {
            start: number,
            cost,
            iterations: 7,
            termination: cost.map(|_| Terminated::Converged),
            message: message.into(),
            minimum,
            distance: minimum.map(|m| (m - 1) as f64 / 2.0),
            values: vec![1.0],
        }
    }

    #[test]
    fn the_best_come_first_and_failures_are_counted_with_their_reasons() {
        let starts = [
            start(1, Some(3.0), Some(2), "converged"),
            start(2, Some(-1.0), Some(1), "converged"),
            start(3, None, None, "run `a` diverges at time 1 already"),
            start(4, None, None, "run `a` diverges at time 2 already"),
        ];
        let text = starts_table(&starts, 5);
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        assert!(lines[1].starts_with("2  -1.000000e0        1"), "{text}");
        assert!(lines[2].starts_with("given"), "{text}");
        assert!(text.contains("5 starts: 2 converged, 1 reached the best minimum, 2 failed (50 %), 1 were not begun"));
        assert!(text.ends_with("failed 2 times: run `a` diverges\n"), "{text}");
    }
}
