//! What came out of many starts.

use super::table::{aligned_right, plain, trimmed};
use fdm_estimate::{StartSummary, Termination};
use fdm_grammar::model::Param;
use fdm_results::documents::digits;

/// Starts shown; of more the best.
const SHOWN: usize = 20;

/// The starts in order of their cost, then how many failed and why. `count` is how many were asked for.
pub fn starts_table(starts: &[StartSummary], count: usize) -> String {
    let mut table = plain(&["start", "cost", "minimum", "distance", "iterations", "end"]);
    let mut order: Vec<&StartSummary> = starts.iter().filter(|s| s.cost.is_some()).collect();
    let cost = |s: &StartSummary| s.cost.unwrap_or(f64::INFINITY);
    let rank = |s: &StartSummary| s.minimum.unwrap_or(usize::MAX);
    order.sort_by(|a, b| rank(a).cmp(&rank(b)).then(cost(a).total_cmp(&cost(b))).then(a.number.cmp(&b.number)));
    for s in order.iter().take(SHOWN) {
        let number = if s.number == 1 { String::from("given") } else { s.number.to_string() };
        table.add_row([
            number,
            s.cost.map_or(String::from("-"), |c| format!("{c:.6e}")),
            s.minimum.map_or(String::from("-"), |m| m.to_string()),
            s.distance.map_or(String::from("-"), |d| digits(d, 2)),
            s.iterations.to_string(),
            s.message.clone(),
        ]);
    }
    (0..5).for_each(|column| aligned_right(&mut table, column));
    let mut text = trimmed(&table);
    if order.len() > SHOWN {
        text.push_str(&format!("and {} more\n", order.len() - SHOWN));
    }
    text.push_str(&closing(starts, count));
    text
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

fn closing(starts: &[StartSummary], count: usize) -> String {
    let reached = starts.iter().filter(|s| s.minimum == Some(1)).count();
    let good = |s: &&StartSummary| s.termination.as_ref().is_some_and(Termination::is_good);
    let converged = starts.iter().filter(good).count();
    let mut text = format!("{count} starts: {converged} converged, {reached} reached the best minimum");
    let failed: Vec<&StartSummary> = starts.iter().filter(|s| s.cost.is_none()).collect();
    if !failed.is_empty() {
        let share = 100.0 * failed.len() as f64 / starts.len() as f64;
        text.push_str(&format!(", {} failed ({share:.0} %)", failed.len()));
    }
    if starts.len() < count {
        text.push_str(&format!(", {} were not begun before the interruption", count - starts.len()));
    }
    text.push('\n');
    let ran_out = starts.iter().filter(|s| s.termination == Some(Termination::IterationLimit)).count();
    if ran_out > 0 {
        text.push_str(&format!(
            "{ran_out} used all their iterations, half of those of a fit; --iterations N gives more\n"
        ));
    }
    for (reason, number) in reasons(&failed) {
        let times = if number == 1 { "once".into() } else { format!("{number} times") };
        text.push_str(&format!("failed {times}: {reason}\n"));
    }
    text
}

/// Why starts failed, the most frequent reason first; of many different ones the first few.
fn reasons(failed: &[&StartSummary]) -> Vec<(String, usize)> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_estimate::Reason;

    fn start(number: usize, cost: Option<f64>, minimum: Option<usize>, message: &str) -> StartSummary {
        StartSummary {
            number,
            cost,
            iterations: 7,
            termination: cost.map(|_| Termination::Converged(Reason::SmallStep)),
            message: message.into(),
            minimum,
            distance: minimum.map(|m| (m - 1) as f64 / 2.0),
            values: vec![1.0],
            errors: vec![None],
            reached: Vec::new(),
            degenerate: Vec::new(),
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
