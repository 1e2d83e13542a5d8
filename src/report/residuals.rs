//! The table of residuals: how well each output is matched, and whether what is left is white.

use super::table::{aligned_right, digits, plain, trimmed};
use crate::quality::{OutputFit, OutputQuality, Whiteness};

/// One row for each output of each run: size of the residual, what it consists of, and the p-value of its whiteness.
///
/// `bias`, `var` and `cov` are the parts of Theil's coefficient; `white p` is the probability of residuals as correlated as
/// these, were they white; `D-W` is the statistic of Durbin and Watson.
pub fn residual_table(quality: &[OutputQuality]) -> String {
    let rows: Vec<_> = quality.iter().map(|q| (&q.fit, q.whiteness.as_ref())).collect();
    table(&rows, true)
}

/// The same without tests.
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
    let fixed = |v: Option<f64>, n: usize| v.map_or(String::from("-"), |v| format!("{v:.n$}"));
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
