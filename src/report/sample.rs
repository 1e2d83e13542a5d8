//! Draws from a posterior: a row for each parameter, and how the chains went.

use super::table::{aligned_right, plain, trimmed};
use fdm_results::documents::sample::SampleDocument;
use fdm_results::documents::{digits, digits_by_error, digits_of_end};

/// Whether the draws can be used, in a clause.
pub(crate) fn verdict(found: &SampleDocument) -> &'static str {
    match (found.is_good(), found.remarks.is_empty()) {
        (true, true) => "the chains agree, and nothing speaks against the draws",
        (true, false) => "the chains agree; what the draws take for granted is noted below",
        (false, _) => "not to be used yet: what speaks against the draws is said below",
    }
}

/// Verdict, parameters, chains.
pub fn sample_text(found: &SampleDocument) -> String {
    let total = found.draws * found.chains.len();
    let verdict = verdict(found);
    let mut text = format!(
        "{}: posterior of the result in {}\n{verdict}\n{} chains of {} draws ({total} in all), {} before them, seed {}\n\n",
        found.model,
        found.result,
        found.chains.len(),
        found.draws,
        found.warmup,
        found.seed
    );
    let runs = found.parameters.iter().any(|p| p.run.is_some());
    let numbers = ["mean", "deviation", "2.5 %", "median", "97.5 %", "R-hat", "bulk", "tail"];
    let mut header = vec!["parameter"];
    header.extend(runs.then_some("run"));
    let left = header.len();
    header.extend(numbers);
    header.push("unit");
    let mut table = plain(&header);
    for p in &found.parameters {
        let significant = digits_by_error(p.mean, p.deviation, 3).unwrap_or(4);
        let shown = |v: f64| digits(v, significant);
        let count = |v: Option<f64>| v.map_or("-".into(), |v| format!("{v:.0}"));
        let mut row = vec![p.name.clone()];
        row.extend(runs.then(|| p.run.clone().unwrap_or_default()));
        row.extend([
            shown(p.mean),
            digits(p.deviation, 3),
            digits_of_end(p.interval[0], p.deviation),
            shown(p.median),
            digits_of_end(p.interval[1], p.deviation),
            p.r_hat.map_or("-".into(), |r| format!("{r:.3}")),
            count(p.bulk),
            count(p.tail),
            p.unit.clone().filter(|u| u != "1").unwrap_or_default(),
        ]);
        table.add_row(row);
    }
    (left..left + numbers.len()).for_each(|column| aligned_right(&mut table, column));
    text.push_str(&trimmed(&table));
    let mut table = plain(&["chain", "divergent", "step", "acceptance", "steps a draw", "gradients"]);
    for (k, c) in found.chains.iter().enumerate() {
        table.add_row([
            (k + 1).to_string(),
            c.divergent.to_string(),
            digits(c.step, 3),
            format!("{:.2}", c.accepted),
            format!("{:.1}", c.steps),
            c.evaluations.to_string(),
        ]);
    }
    (0..6).for_each(|column| aligned_right(&mut table, column));
    text.push_str(&format!("\n{}", trimmed(&table)));
    text
}
