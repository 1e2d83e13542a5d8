//! How a model does on runs that it was not fitted to, beside those that it was.

use super::table::{aligned_right, digits, plain, trimmed};
use crate::quality::OutputQuality;
use serde_json::{Value, json};

/// One row for each output of each run: those that are validated first, then those of the fit. `fitted` is what the
/// fit said about its runs, as [`quality_json`](super::quality_json) has it.
pub fn validation_table(validated: &[OutputQuality], fitted: &Value) -> String {
    let header =
        ["", "run", "output", "RMS of residual", "R^2", "TIC", "of it bias", "variance", "covariance", "residuals"];
    let mut table = plain(&header);
    let own = json!(validated);
    for (role, rows) in [("validated", &own), ("fitted", fitted)] {
        for row in rows.as_array().into_iter().flatten() {
            table.add_row(cells(role, row));
        }
    }
    (3..9).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

fn cells(role: &str, row: &Value) -> Vec<String> {
    let text = |key: &str| row[key].as_str().unwrap_or_default().to_string();
    let fixed = |value: &Value, n: usize| value.as_f64().map_or(String::from("-"), |v| format!("{v:.n$}"));
    let rms = row["rms"].as_f64().map_or(String::from("-"), |v| digits(v, 4));
    let parts = &row["tic_parts"];
    let part = |key: &str| fixed(&parts[key], 2);
    vec![
        role.into(),
        text("run"),
        text("name"),
        rms,
        fixed(&row["r2"], 4),
        fixed(&row["tic"], 4),
        part("bias"),
        part("variance"),
        part("covariance"),
        colour(&row["whiteness"]),
    ]
}

/// What the portmanteau test says.
fn colour(whiteness: &Value) -> String {
    match whiteness["p_value"].as_f64() {
        None => "not tested".into(),
        Some(p) if p < SIGNIFICANT => format!("coloured (p {p:.0e})"),
        Some(p) => format!("white (p {p:.2})"),
    }
}

/// Residuals count as coloured below this p-value, as in [`Whiteness::is_white`](crate::quality::Whiteness::is_white).
const SIGNIFICANT: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validated_and_fitted_runs_stand_below_each_other() {
        let row = |run: &str, p: f64| {
            json!({ "run": run, "name": "y", "rms": 0.5, "r2": 0.75, "tic": null,
                    "tic_parts": { "bias": 0.25, "variance": 0.25, "covariance": 0.5 }, "whiteness": { "p_value": p } })
        };
        let text = validation_table(&[], &json!([row("a", 0.5), row("b", 1e-9)]));
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        assert!(lines[1].starts_with("fitted  a    y") && lines[1].ends_with("white (p 0.50)"), "{text}");
        assert!(lines[2].contains("0.7500") && lines[2].ends_with("coloured (p 1e-9)"), "{text}");
        assert_eq!(validation_table(&[], &Value::Null).lines().count(), 1);
    }
}
