//! What came out of experiments: a table for each, one for all; the same for a page of Markdown.

use super::table::{aligned_right, plain, trimmed};
use fdm_results::documents::digits;
use fdm_results::documents::reproduction::Outcome;

/// Every figure that was expected beside the one that came out.
pub fn outcome_table(outcome: &Outcome) -> String {
    let mut text = format!("{}: {}\n{}\n", outcome.system, outcome.title, outcome.source);
    let with_paper = outcome.checks.iter().any(|c| c.paper.is_some());
    let mut header = vec!["step", "what"];
    header.extend(with_paper.then_some("paper"));
    header.extend(["expected", "got", "error", "off", ""]);
    let mut table = plain(&header);
    let mut step = "";
    for check in &outcome.checks {
        let shown = if check.step == step { "" } else { check.step.as_str() };
        step = &check.step;
        let mut row = vec![shown.to_string(), check.what.clone()];
        row.extend(with_paper.then(|| check.paper.clone().unwrap_or_default()));
        row.extend([check.expected.clone(), check.got.clone()]);
        row.push(check.standard_error.map_or(String::new(), |e| digits(e, 3)));
        row.push(check.off.map_or(String::new(), |z| format!("{z:+.2}")));
        row.push(if check.passed { "ok".into() } else { "FAILED".into() });
        table.add_row(row);
    }
    text.push_str(&trimmed(&table));
    let passed = format!("{} of {} as expected", outcome.count_passed(), outcome.checks.len());
    let worst = outcome.worst_error_in_standard_errors;
    text.push_str(&format!(
        "{passed}{}\n",
        worst.map_or(String::new(), |w| format!(", the worst {w:.2} standard errors off"))
    ));
    text
}

/// One line for each.
pub fn outcomes_table(outcomes: &[Outcome]) -> String {
    let mut table = plain(&["system", "parameters", "worst, in errors", "as expected", ""]);
    for column in [1, 2] {
        aligned_right(&mut table, column);
    }
    for o in outcomes {
        let worst = o.worst_error_in_standard_errors.map_or("-".into(), |w| format!("{w:.2}"));
        let counts = format!("{} of {}", o.count_passed(), o.checks.len());
        let passed = if o.passed { "ok" } else { "FAILED" };
        table.add_row([o.system.clone(), o.parameters.to_string(), worst, counts, passed.into()]);
    }
    trimmed(&table)
}

/// Outcomes of reference systems as a table of a page in Markdown.
pub fn outcomes_markdown(outcomes: &[Outcome]) -> String {
    let mut text = String::from(
        "| system | what | parameters | worst error in standard errors | as expected | the paper's figures |\n|---|---|---|---|---|---|\n",
    );
    for o in outcomes {
        let worst = o.worst_error_in_standard_errors.map_or("-".into(), |w| format!("{w:.2}"));
        let counts = format!("{} of {}", o.count_passed(), o.checks.len());
        let row = [&format!("[{0}]({0})", o.system), &o.title, &o.parameters.to_string(), &worst, &counts, &o.remark];
        text.push_str(&format!("| {} |\n", row.map(|cell| cell.replace('|', "\\|").replace('\n', " ")).join(" | ")));
    }
    text
}
