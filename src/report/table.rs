//! Estimates as tables that can be read at a glance.

use crate::estimate::{Estimate, ParameterEstimate, Status};
use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};

/// Correlations beyond this are worth a line.
const CORRELATED: f64 = 0.9;
/// Standard errors beyond this part of the value are worth a mark.
const UNCERTAIN: f64 = 0.2;

/// Parameters with standard errors, then the quality of each output, then what should not be overlooked.
pub fn estimate_table(estimate: &Estimate) -> String {
    let mut text = parameters(&estimate.parameters);
    if !estimate.outputs.is_empty() {
        text.push('\n');
        text.push_str(&outputs(estimate));
    }
    for remark in remarks(estimate) {
        text.push_str(&format!("\n{remark}"));
    }
    text
}

fn parameters(parameters: &[ParameterEstimate]) -> String {
    let several = parameters.iter().any(|p| p.run.is_some());
    let mut header = vec!["parameter", "value", "standard error", "%", "unit", "status"];
    if several {
        header.insert(1, "run");
    }
    let mut table = plain(&header);
    for p in parameters {
        let error = p.standard_error.map_or(String::new(), |s| digits(s, 3));
        let mut row = vec![p.name.clone(), value(p), error, percent(p), p.unit.clone().unwrap_or_default(), status(p)];
        if several {
            row.insert(1, p.run.clone().unwrap_or_default());
        }
        table.add_row(row);
    }
    let shift = usize::from(several);
    for column in [1, 2, 3] {
        aligned_right(&mut table, column + shift);
    }
    trimmed(&table)
}

fn outputs(estimate: &Estimate) -> String {
    let mut table = plain(&["output", "run", "RMS of residual", "mean", "R^2", "TIC", "compared"]);
    for o in &estimate.outputs {
        let number = |v: Option<f64>, n: usize| v.map_or(String::from("-"), |v| digits(v, n));
        let fixed = |v: Option<f64>| v.map_or(String::from("-"), |v| format!("{v:.4}"));
        table.add_row([
            o.name.clone(),
            o.run.clone(),
            number(o.rms, 4),
            number(o.bias, 2),
            fixed(o.r2),
            fixed(o.tic),
            o.compared.to_string(),
        ]);
    }
    (2..7).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// What a careful reader would ask about.
fn remarks(estimate: &Estimate) -> Vec<String> {
    let mut remarks: Vec<String> =
        estimate.undetermined.iter().map(|d| format!("not determined: {}", d.sentence)).collect();
    for d in &estimate.determined_by_prior {
        let what = if d.moves.len() == 1 { "what is known of it is its prior" } else { "priors alone tell them apart" };
        remarks.push(format!("not determined by the data: {}; {what}", d.sentence));
    }
    for (a, b, r) in estimate.correlated(CORRELATED) {
        let name = |k: usize| {
            let p = &estimate.parameters[k];
            p.run.as_ref().map_or(p.name.clone(), |run| format!("{} ({run})", p.name))
        };
        remarks.push(format!("correlated: {} and {} ({r:+.3})", name(a), name(b)));
    }
    for aid in &estimate.aids {
        remarks.push(format!("the iteration needed help: {aid}"));
    }
    for output in &estimate.noise_free {
        remarks.push(format!("`{output}` is matched to rounding: its noise and the standard errors mean nothing"));
    }
    remarks
}

fn value(p: &ParameterEstimate) -> String {
    // two digits more than the standard error settles, at least five
    let known = p.standard_error.filter(|s| *s > 0.0 && p.value != 0.0);
    let settled = known.map_or(5, |s| ((p.value / s).abs().log10().floor() as i64 + 3).clamp(5, 12) as usize);
    digits(p.value, settled)
}

fn percent(p: &ParameterEstimate) -> String {
    let Some(error) = p.standard_error.filter(|_| p.value != 0.0) else { return String::new() };
    let part = error / p.value.abs();
    let mark = if part > UNCERTAIN { "!" } else { "" };
    format!("{}{mark}", if part >= 10.0 { String::from(">1000") } else { digits(100.0 * part, 2) })
}

fn status(p: &ParameterEstimate) -> String {
    match p.status {
        Status::Estimated => String::new(),
        Status::AtLowerBound => format!("at its lower bound {}", p.lower.map_or(String::new(), |b| digits(b, 4))),
        Status::AtUpperBound => format!("at its upper bound {}", p.upper.map_or(String::new(), |b| digits(b, 4))),
        Status::NotDetermined => "not determined".into(),
        Status::Fixed => "fixed".into(),
        Status::Derived => "derived".into(),
        Status::NotEstimated => "not estimated".into(),
    }
}

/// A number with this many significant digits, as a decimal where that is short.
pub(super) fn digits(v: f64, significant: usize) -> String {
    if v == 0.0 || !v.is_finite() {
        return format!("{v}");
    }
    let rounded = format!("{v:.*e}", significant.max(1) - 1);
    let exponent: i32 = rounded.split('e').nth(1).and_then(|e| e.parse().ok()).unwrap_or(0);
    if !(-4..7).contains(&exponent) {
        return rounded;
    }
    let decimals = (significant as i32 - 1 - exponent).max(0) as usize;
    format!("{v:.decimals$}")
}

pub(super) fn plain(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(NOTHING).set_header(header.iter().copied());
    table
}

pub(super) fn aligned_right(table: &mut Table, column: usize) {
    if let Some(column) = table.column_mut(column) {
        column.set_cell_alignment(CellAlignment::Right);
    }
}

/// Without the blanks that fill the last column.
pub(super) fn trimmed(table: &Table) -> String {
    table.to_string().lines().map(|l| format!("{}\n", l.trim_end())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_are_asked_for() {
        let shown: Vec<String> = [(6.054_928, 5), (1.5e-7, 3), (123_456.7, 3), (-0.02, 2), (9.999_96, 5), (0.0, 3)]
            .iter()
            .map(|(v, n)| digits(*v, *n))
            .collect();
        assert_eq!(shown, ["6.0549", "1.50e-7", "123457", "-0.020", "10.000", "0"]);
    }
}
