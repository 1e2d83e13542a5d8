//! Estimates as tables that can be read at a glance.

use super::parameters::parameter_table;
use super::remarks::{Remark, estimate_remarks, fit_remarks};
use super::residuals::{output_table, residual_table};
use crate::estimate::{Estimate, Fit};
use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};

/// Parameters with standard errors, then the quality of each output, then what should not be overlooked.
pub fn estimate_table(estimate: &Estimate) -> String {
    let residuals = if estimate.outputs.is_empty() { String::new() } else { output_table(&estimate.outputs) };
    join(parameter_table(&estimate.parameters, false), residuals, &estimate_remarks(estimate))
}

/// The same with what the residuals say; `intervals` adds the interval of 95 %.
pub fn fit_table(fit: &Fit, intervals: bool) -> String {
    if fit.quality.is_empty() {
        return estimate_table(&fit.estimate);
    }
    join(parameter_table(&fit.estimate.parameters, intervals), residual_table(&fit.quality), &fit_remarks(fit))
}

fn join(parameters: String, residuals: String, remarks: &[Remark]) -> String {
    let mut text = parameters;
    if !residuals.is_empty() {
        text.push('\n');
        text.push_str(&residuals);
    }
    remarks.iter().for_each(|remark| text.push_str(&format!("\n{remark}")));
    text
}

/// A number with this many significant digits, as a decimal where that is short.
pub(crate) fn digits(v: f64, significant: usize) -> String {
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
