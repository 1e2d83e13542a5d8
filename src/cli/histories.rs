//! Measurement beside response over time, for pictures and for files.

use fdm::Model;
use fdm::diagnose::diagnosis::Overlay;
use fdm::estimate::Fit;
use fdm::record::{Column, Dialect, Run, write_to};
use fdm::report::TimeHistory;

/// Every output of every run over time.
pub(crate) fn histories<'a>(fit: &Fit, runs: &'a [Run]) -> Vec<TimeHistory<'a>> {
    let definition = fit.model.definition();
    let q = definition.outputs.len();
    let mut histories = Vec::new();
    for (run, result) in runs.iter().zip(&fit.estimate.runs) {
        for (o, output) in definition.outputs.iter().enumerate() {
            let column = |values: &[f64]| values.iter().skip(o).step_by(q).copied().collect();
            let name = &output.quantity.name;
            let unit = output.quantity.unit.as_ref().map_or(String::new(), |u| format!(" {u}"));
            let quality = fit.estimate.outputs.iter().find(|f| f.name == *name && f.run == run.name);
            let rms =
                quality.and_then(|f| f.rms).map_or(String::new(), |r| format!(", RMS of the residual {r:.4}{unit}"));
            histories.push(TimeHistory {
                title: format!("{}: {name} in {}{rms}", fit.model.name(), run.name),
                time_label: format!("t [{}]", definition.time),
                value_label: format!("{name} [{}]", unit.trim()),
                time: &run.time,
                measured: column(&run.measured),
                modelled: column(&result.response),
            });
        }
    }
    histories
}

/// One table for each run: time, inputs, and of every output what was measured, the response and the residual. The name of
/// a file holds the name of its run as far as file systems allow.
pub(crate) fn tables(fit: &Fit, runs: &[Run]) -> Vec<(String, Vec<u8>)> {
    let tables = runs.iter().zip(&fit.estimate.runs).enumerate().map(|(k, (run, result))| {
        let name = format!("run_{}_{}.csv", k + 1, plain(&run.name));
        (name, table(fit, run, &result.response, &result.residuals))
    });
    tables.collect()
}

/// The table of a run of a diagnosis: time, and of every output what was measured, and the responses before and after.
pub(crate) fn overlay_table(model: &Model, k: usize, overlay: &Overlay) -> (String, Vec<u8>) {
    let definition = model.definition();
    let q = definition.outputs.len();
    let pick = |values: &[f64], o: usize| values.iter().skip(o).step_by(q).copied().collect();
    let mut columns = vec![("t".to_string(), Some(definition.time.to_string()), overlay.time.clone())];
    for (o, output) in definition.outputs.iter().enumerate() {
        let (name, unit) = (&output.quantity.name, output.quantity.unit.as_ref().map(ToString::to_string));
        columns.push((name.clone(), unit.clone(), pick(&overlay.measured, o)));
        columns.push((format!("{name}_before"), unit.clone(), pick(&overlay.before, o)));
        columns.push((format!("{name}_after"), unit, pick(&overlay.after, o)));
    }
    (format!("run_{}_{}.csv", k + 1, plain(&overlay.run)), as_file(&columns))
}

fn table(fit: &Fit, run: &Run, response: &[f64], residuals: &[f64]) -> Vec<u8> {
    let definition = fit.model.definition();
    let (m, q) = (run.held.len(), definition.outputs.len());
    let pick = |values: &[f64], k: usize, width: usize| values.iter().skip(k).step_by(width).copied().collect();
    let mut columns: Vec<(String, Option<String>, Vec<f64>)> =
        vec![("t".into(), Some(definition.time.to_string()), run.time.clone())];
    for (k, input) in definition.inputs.iter().enumerate().take(m) {
        let unit = input.quantity.unit.as_ref().map(ToString::to_string);
        columns.push((input.quantity.name.clone(), unit, pick(&run.inputs, k, m)));
    }
    for (k, output) in definition.outputs.iter().enumerate() {
        let (name, unit) = (&output.quantity.name, output.quantity.unit.as_ref().map(ToString::to_string));
        columns.push((name.clone(), unit.clone(), pick(&run.measured, k, q)));
        columns.push((format!("{name}_model"), unit.clone(), pick(response, k, q)));
        columns.push((format!("{name}_residual"), unit, pick(residuals, k, q)));
    }
    as_file(&columns)
}

/// Columns (name, unit, values) as a file.
pub(crate) fn as_file(columns: &[(String, Option<String>, Vec<f64>)]) -> Vec<u8> {
    let columns: Vec<Column<'_>> =
        columns.iter().map(|(name, unit, values)| Column { name, unit: unit.as_deref(), values }).collect();
    let mut text = Vec::new();
    // memory takes everything that is written to it
    let _ = write_to(&mut text, Dialect::default(), &columns);
    text
}

fn plain(name: &str) -> String {
    const LONGEST: usize = 60;
    let kept = |c: char| if c.is_alphanumeric() || "-_.#".contains(c) { c } else { '_' };
    name.chars().take(LONGEST).map(kept).collect()
}
