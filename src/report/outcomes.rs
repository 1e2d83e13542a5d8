//! What came out of experiments: a table for each, one for all; the same for a page of Markdown.

use super::section::Rows;
use crate::text;
use fdm_results::documents::digits;
use fdm_results::documents::reproduction::Outcome;

/// Every figure that was expected beside the one that came out.
pub fn outcome_table(outcome: &Outcome) -> String {
    let mut text = format!("{}: {}\n{}\n", outcome.system, outcome.title, outcome.source);
    let mut table = Rows::over(&outcome.checks);
    let mut step = "";
    table.words("step", |check| {
        let same = std::mem::replace(&mut step, &check.step) == check.step;
        if same { String::new() } else { check.step.clone() }
    });
    table.words("what", |check| check.what.clone());
    if outcome.checks.iter().any(|c| c.paper.is_some()) {
        table.words("paper", |check| check.paper.clone().unwrap_or_default());
    }
    table.words("expected", |check| check.expected.clone());
    table.words("got", |check| check.got.clone());
    table.span("error", |check| check.standard_error.map_or(String::new(), |e| digits(e, 3)));
    table.span("off", |check| check.off.map_or(String::new(), |z| format!("{z:+.2}")));
    table.words("", |check| if check.passed { "ok" } else { "FAILED" });
    text.push_str(&text::table(table));
    let passed = format!("{} as expected", counts(&outcome));
    let worst = outcome.worst_error_in_standard_errors;
    text.push_str(&format!(
        "{passed}{}\n",
        worst.map_or(String::new(), |w| format!(", the worst {w:.2} standard errors off"))
    ));
    text
}

/// One line for each.
pub fn outcomes_table(outcomes: &[Outcome]) -> String {
    let mut table = Rows::over(outcomes);
    table.words("system", |o| o.system.clone());
    table.number("parameters", |o| o.parameters);
    table.number("worst, in errors", worst);
    table.words("as expected", counts);
    table.words("", |o| if o.passed { "ok" } else { "FAILED" });
    text::table(table)
}

fn worst(o: &&Outcome) -> String {
    o.worst_error_in_standard_errors.map_or("-".into(), |w| format!("{w:.2}"))
}

fn counts(o: &&Outcome) -> String {
    format!("{} of {}", o.count_passed(), o.checks.len())
}

/// Outcomes of reference systems as a table of a page in Markdown.
pub fn outcomes_markdown(outcomes: &[Outcome]) -> String {
    let mut text = String::from(
        "| system | what | parameters | worst error in standard errors | as expected | the paper's figures |\n|---|---|---|---|---|---|\n",
    );
    for o in outcomes {
        let (link, parameters) = (format!("[{0}]({0})", o.system), o.parameters.to_string());
        let row = [&link, &o.title, &parameters, &worst(&o), &counts(&o), &o.remark];
        text.push_str(&format!("| {} |\n", row.map(|cell| cell.replace('|', "\\|").replace('\n', " ")).join(" | ")));
    }
    text
}
