//! An estimate as tables that can be read at a glance: parameters, residuals, what should not be overlooked, the iteration.

use super::table::{aligned_right, plain, trimmed};
use fdm_estimate::residuals::{OutputFit, OutputQuality, Whiteness};
use fdm_estimate::{Estimate, Fit, Iteration, ParameterEstimate, Status};
use fdm_results::documents::{
    Remark, digits, digits_by_error, estimate_remarks, fit_remarks, fixed, limit_within_bounds,
};

/// Standard errors beyond this part of the value are worth a mark.
const UNCERTAIN: f64 = 0.2;

/// How much a table tells.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Detail {
    /// The interval of 95 % of each parameter.
    pub intervals: bool,
    /// Every remark, not only the five that speak most against the result.
    pub verbose: bool,
}

/// Parameters with standard errors, then the quality of each output, then what should not be overlooked.
pub fn estimate_table(estimate: &Estimate) -> String {
    estimate_text(estimate, Detail { verbose: true, ..Detail::default() })
}

/// Parameters with standard errors, the quality of each output and remarks, with so much detail.
pub fn estimate_text(estimate: &Estimate, detail: Detail) -> String {
    let residuals = if estimate.outputs.is_empty() { String::new() } else { output_table(&estimate.outputs) };
    join(parameter_table(&estimate.parameters, false), residuals, &estimate_remarks(estimate), detail)
}

/// Tables of a fit: parameters with standard errors, each output with the tests of its residuals, and remarks, with so
/// much detail.
pub fn fit_table(fit: &Fit, detail: Detail) -> String {
    if fit.quality.is_empty() {
        return estimate_text(&fit.estimate, detail);
    }
    let parameters = parameter_table(&fit.estimate.parameters, detail.intervals);
    join(parameters, residual_table(&fit.quality), &fit_remarks(fit), detail)
}

fn join(parameters: String, residuals: String, remarks: &[Remark], detail: Detail) -> String {
    let mut text = parameters;
    if !residuals.is_empty() {
        text.push('\n');
        text.push_str(&residuals);
    }
    remark_lines(remarks, detail).iter().for_each(|line| text.push_str(&format!("\n{line}")));
    text
}

/// Remarks as lines: all of them, or the heaviest with what to do about each.
pub(super) fn remark_lines(remarks: &[Remark], detail: Detail) -> Vec<String> {
    if detail.verbose { shortened(remarks) } else { first(remarks) }
}

/// Remarks that are shown where not all are wanted.
const FIRST: usize = 5;

/// One line for each kind, the heaviest first: the first of its kind, how many there are like it, and what to do.
fn first(remarks: &[Remark]) -> Vec<String> {
    let mut kinds: Vec<(&Remark, usize)> = Vec::new();
    for remark in remarks {
        match kinds.iter_mut().find(|(first, _)| first.about == remark.about) {
            Some((_, count)) => *count += 1,
            None => kinds.push((remark, 1)),
        }
    }
    kinds.sort_by_key(|(remark, _)| remark.about.rank());
    let line = |(remark, count): &(&Remark, usize)| {
        let alike = if *count > 1 { format!(" (and {} like it)", count - 1) } else { String::new() };
        let advice = remark.about.advice().map_or(String::new(), |advice| format!("; {advice}"));
        format!("{}{alike}{advice}", cut(&remark.sentence))
    };
    let mut lines: Vec<String> = kinds.iter().take(FIRST).map(line).collect();
    let more = remarks.len() - kinds.len().min(FIRST);
    if more > 0 {
        lines.push(format!("{more} more remark{}: --verbose", if more == 1 { "" } else { "s" }));
    }
    lines
}

/// Remarks of one kind that are shown; JSON holds all of them.
const SHOWN: usize = 8;
/// Characters of a remark that are shown.
const LONGEST: usize = 600;

/// Remarks as lines: of each kind the first few and how many more there are, long ones cut between words.
fn shortened(remarks: &[Remark]) -> Vec<String> {
    let mut lines = Vec::new();
    for alike in remarks.chunk_by(|a, b| a.about == b.about) {
        // one more than is shown takes no more room than a line that says so
        let shown = if alike.len() > SHOWN + 1 { SHOWN } else { alike.len() };
        lines.extend(alike[..shown].iter().map(|remark| cut(&remark.sentence)));
        if shown < alike.len() {
            lines.push(format!("and {} more remarks of this kind (--json has all)", alike.len() - shown));
        }
    }
    lines
}

fn cut(sentence: &str) -> String {
    let Some((end, _)) = sentence.char_indices().nth(LONGEST) else { return sentence.into() };
    let end = sentence[..end].rfind(' ').unwrap_or(end);
    format!("{} ... (--json has the whole of it)", &sentence[..end])
}

/// One row for each parameter, per-run ones once for every run; `intervals` adds the interval that holds the true value in 95 of 100 cases.
pub(super) fn parameter_table(parameters: &[ParameterEstimate], intervals: bool) -> String {
    let runs = parameters.iter().any(|p| p.run.is_some());
    let corrected = parameters.iter().any(|p| p.corrected_error.is_some());
    let mut columns: Vec<Column> = vec![("parameter", false, |p| p.name.clone())];
    if runs {
        columns.push(("run", false, |p| p.run.clone().unwrap_or_default()));
    }
    columns.push(("value", true, value));
    columns.push((if corrected { "Cramer-Rao" } else { "standard error" }, true, |p| error(p.standard_error)));
    if corrected {
        columns.push(("corrected", true, |p| error(p.corrected_error)));
    }
    columns.push(("%", true, percent));
    if intervals {
        columns.push(("95 % interval", false, interval));
    }
    columns.push(("unit", false, |p| p.unit.clone().unwrap_or_default()));
    columns.push(("status", false, status));
    let mut table = plain(&columns.iter().map(|c| c.0).collect::<Vec<_>>());
    for p in parameters {
        table.add_row(columns.iter().map(|(_, _, cell)| cell(p)));
    }
    let right = columns.iter().enumerate().filter(|(_, c)| c.1);
    right.for_each(|(k, _)| aligned_right(&mut table, k));
    trimmed(&table)
}

/// Title, whether it is aligned to the right, and the cell of a parameter.
type Column = (&'static str, bool, fn(&ParameterEstimate) -> String);

fn error(error: Option<f64>) -> String {
    error.map_or(String::new(), |s| digits(s, 3))
}

fn value(p: &ParameterEstimate) -> String {
    if p.status == Status::Unvisited {
        return "unknown".into();
    }
    digits(p.value, p.error().and_then(|s| digits_by_error(p.value, s, 3)).unwrap_or(5))
}

/// Of the error to be trusted.
fn percent(p: &ParameterEstimate) -> String {
    let Some(error) = p.error().filter(|_| p.value != 0.0) else { return String::new() };
    let part = error / p.value.abs();
    let mark = if part > UNCERTAIN { "!" } else { "" };
    format!("{}{mark}", if part >= 10.0 { String::from(">1000") } else { digits(100.0 * part, 2) })
}

fn interval(p: &ParameterEstimate) -> String {
    let Some([low, high]) = p.interval().filter(|_| p.limit.is_none() || limit_within_bounds(p).is_some()) else {
        return String::new();
    };
    let error = p.error().unwrap_or(high - low);
    let shown = |v: f64| digits(v, digits_by_error(v, error, 2).unwrap_or(5));
    format!("{} to {}", shown(low), shown(high))
}

fn status(p: &ParameterEstimate) -> String {
    let bound = |b: Option<f64>| b.map_or(String::new(), |b| digits(b, 4));
    let limit =
        |sign: &str, limit: Option<f64>| limit.map_or(String::new(), |l| format!(", 95 % {sign} {}", digits(l, 3)));
    match p.status {
        Status::Estimated => String::new(),
        Status::AtLowerBound => format!("at its lower bound {}{}", bound(p.lower), limit("<", limit_within_bounds(p))),
        Status::AtUpperBound => format!("at its upper bound {}{}", bound(p.upper), limit(">", limit_within_bounds(p))),
        Status::NotDetermined => "not determined".into(),
        Status::Unvisited => "no run visits it".into(),
        Status::Fixed => "fixed".into(),
        Status::Derived => "derived".into(),
        Status::Tied => "tied".into(),
        Status::NotEstimated => "not estimated".into(),
    }
}

/// One row for each output of each run: size of the residual, what it consists of, and the p-value of its whiteness.
///
/// `bias`, `var` and `cov` are the parts of Theil's coefficient; `white p` is the probability of residuals as correlated as
/// these, were they white; `D-W` is the statistic of Durbin and Watson.
pub fn residual_table(quality: &[OutputQuality]) -> String {
    let rows: Vec<_> = quality.iter().map(|q| (&q.fit, q.whiteness.as_ref())).collect();
    table(&rows, true)
}

/// One row for each output: size of the residual and what it consists of, without tests.
pub(super) fn output_table(outputs: &[OutputFit]) -> String {
    table(&outputs.iter().map(|o| (o, None)).collect::<Vec<_>>(), false)
}

fn table(rows: &[(&OutputFit, Option<&Whiteness>)], tested: bool) -> String {
    let mut header = vec!["output", "run", "RMS", "mean", "R^2", "TIC", "bias", "var", "cov"];
    if tested {
        header.extend(["white p", "D-W"]);
    }
    header.push("compared");
    let mut table = plain(&header);
    let number = |v: Option<f64>, n: usize| v.map_or(String::from("-"), |v| digits(v, n));
    for (o, whiteness) in rows {
        let mut row = vec![o.name.clone(), o.run.clone(), number(o.rms, 4), number(o.bias, 2)];
        row.extend([fixed(o.r2, 4), fixed(o.tic, 4)]);
        row.extend([
            fixed(o.tic_parts.map(|p| p.bias), 2),
            fixed(o.tic_parts.map(|p| p.variance), 2),
            fixed(o.tic_parts.map(|p| p.covariance), 2),
        ]);
        if tested {
            row.extend([probability(whiteness.map(|w| w.p_value)), fixed(whiteness.and_then(|w| w.durbin_watson), 2)]);
        }
        row.push(o.compared.to_string());
        table.add_row(row);
    }
    (2..header.len()).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

fn probability(p: Option<f64>) -> String {
    match p {
        None => "-".into(),
        Some(p) if p < 1e-3 => "<0.001".into(),
        Some(p) => format!("{p:.3}"),
    }
}

/// One row for the start and each correction: cost, what it changed, damping, size, and how many were refused before it.
pub fn history_table(history: &[Iteration]) -> String {
    let header = ["correction", "cost", "change", "damping", "largest step / error", "refused"];
    let mut table = plain(&header);
    for i in history {
        let moved = |text: String| if i.number == 0 { String::new() } else { text };
        table.add_row([
            i.number.to_string(),
            format!("{:.9e}", i.cost),
            moved(format!("{:+.2e}", i.change)),
            moved(if i.damping == 0.0 { "0".into() } else { format!("{:.0e}", i.damping) }),
            moved(digits(i.step, 3)),
            i.refused.to_string(),
        ]);
    }
    (0..header.len()).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_results::documents::About;

    fn remark(about: About, sentence: &str) -> Remark {
        Remark { about, sentence: sentence.into() }
    }

    #[test]
    fn long_lists_and_long_remarks_are_shortened_and_short_ones_are_not() {
        let many: Vec<Remark> = (0..90).map(|k| remark(About::Input, &format!("run {k}"))).collect();
        let lines = shortened(&[&[remark(About::Colour, "coloured")], &many[..]].concat());
        assert_eq!(lines.len(), 1 + SHOWN + 1);
        assert_eq!(lines[SHOWN + 1], "and 82 more remarks of this kind (--json has all)");
        assert_eq!(shortened(&many[..SHOWN + 1]).len(), SHOWN + 1);
        let long = vec!["`parameter`"; 10_000].join(", ");
        let line = &shortened(&[remark(About::Undetermined, &long)])[0];
        assert!(line.len() < 700 && line.ends_with("`parameter`, ... (--json has the whole of it)"), "{line}");
    }

    #[test]
    fn the_heaviest_remarks_come_first_and_say_what_to_do() {
        let kinds = [About::Iteration, About::Correlated, About::Colour, About::Input, About::Bound, About::Table];
        let mut all: Vec<Remark> = kinds.iter().map(|about| remark(*about, &format!("{about:?}"))).collect();
        all.insert(2, remark(About::Correlated, "other"));
        let lines = first(&all);
        let expected = [
            "Bound",
            "Input; `fdm diagnose` looks for what is missing",
            "Colour",
            "Correlated (and 1 like it); fix one, give a prior, or add a run that tells them apart (`fdm design`)",
            "Table",
            "2 more remarks: --verbose",
        ];
        assert_eq!(lines, expected);
        assert!(first(&[]).is_empty() && remark_lines(&all, Detail { verbose: true, ..Detail::default() }).len() == 7);
    }
}
