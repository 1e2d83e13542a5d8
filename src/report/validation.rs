//! How a model does on runs that it was not fitted to, beside those that it was.

use super::table::{aligned_right, digits, plain, trimmed};
use crate::diagnose::misfit::{Misfit, Window};
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

/// The root mean square of the error in each fifth of each run: whether a prediction runs away, and when.
pub fn validation_by_time(misfits: &[Misfit], time: &str) -> String {
    let mut table = plain(&["RMS of residual", "run", "fifth 1", "2", "3", "4", "5", &format!("ends at [{time}]")]);
    for m in misfits {
        for own in m.windows.chunk_by(|a, b| a.run == b.run) {
            let fifth = |windows: &[Window]| {
                let (share, samples) = windows.iter().fold((0.0, 0.0), |(e, n), w| (e + w.share, n + w.samples));
                if samples > 0.0 { digits(m.rms * f64::sqrt(share / samples), 3) } else { "-".into() }
            };
            let mut row = vec![m.output.clone(), own[0].run.clone()];
            row.extend((0..5).map(|k| fifth(&own[k * own.len() / 5..(k + 1) * own.len() / 5])));
            row.push(own.last().map_or(String::new(), |w| digits(w.to, 4)));
            table.add_row(row);
        }
    }
    (2..8).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// The error by frequency, in octaves: its size, that of noise as strong as in the upper frequencies, and how much of the record is
/// explained there.
pub fn validation_by_frequency(misfits: &[Misfit], time: &str) -> String {
    let per = if time == "s" { "Hz".to_string() } else { format!("1/{time}") };
    let heads = ["output", &format!("from [{per}]"), "to", "RMS of residual", "noise alone", "of the record explained"];
    let mut table = plain(&heads);
    for m in misfits {
        for band in &m.bands {
            let part = |share: f64| digits(m.rms * share.sqrt(), 3);
            let explained = band.explained.map_or("-".into(), explained);
            let (low, high) = (digits(band.low, 3), digits(band.high, 3));
            table.add_row([m.output.clone(), low, high, part(band.share), part(band.noise), explained]);
        }
    }
    (1..6).for_each(|column| aligned_right(&mut table, column));
    trimmed(&table)
}

/// A part in percent; what is far worse than no model needs no digits.
fn explained(part: f64) -> String {
    if part < -9.99 { "< -999 %".into() } else { format!("{:.0} %", 100.0 * part) }
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
