//! The table of parameters: values with both standard errors.

use super::table::{aligned_right, digits, plain, trimmed};
use crate::estimate::{ParameterEstimate, Status};

/// Standard errors beyond this part of the value are worth a mark.
const UNCERTAIN: f64 = 0.2;

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
    // two digits more than the standard error settles, at least five
    let known = p.error().filter(|s| *s > 0.0 && p.value != 0.0);
    let settled = known.map_or(5, |s| ((p.value / s).abs().log10().floor() as i64 + 3).clamp(5, 12) as usize);
    digits(p.value, settled)
}

/// Of the error to be trusted.
fn percent(p: &ParameterEstimate) -> String {
    let Some(error) = p.error().filter(|_| p.value != 0.0) else { return String::new() };
    let part = error / p.value.abs();
    let mark = if part > UNCERTAIN { "!" } else { "" };
    format!("{}{mark}", if part >= 10.0 { String::from(">1000") } else { digits(100.0 * part, 2) })
}

fn interval(p: &ParameterEstimate) -> String {
    let (Some(error), Some([low, high])) = (p.error(), p.interval()) else { return String::new() };
    let shown = |v: f64| {
        let settled = if error > 0.0 && v != 0.0 { (v / error).abs().log10().floor() as i64 + 3 } else { 5 };
        digits(v, settled.clamp(2, 12) as usize)
    };
    format!("{} to {}", shown(low), shown(high))
}

fn status(p: &ParameterEstimate) -> String {
    let bound = |b: Option<f64>| b.map_or(String::new(), |b| digits(b, 4));
    match p.status {
        Status::Estimated => String::new(),
        Status::AtLowerBound => format!("at its lower bound {}", bound(p.lower)),
        Status::AtUpperBound => format!("at its upper bound {}", bound(p.upper)),
        Status::NotDetermined => "not determined".into(),
        Status::Fixed => "fixed".into(),
        Status::Derived => "derived".into(),
        Status::Tied => "tied".into(),
        Status::NotEstimated => "not estimated".into(),
    }
}
