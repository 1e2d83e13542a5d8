//! Histories, tables and pictures of a fit, as files.

use crate::answer::NamedFile;
use crate::bands::edges;
use fdm_estimate::equation_error::{Along, Course, Regression};
use fdm_estimate::{Fit, RunFit};
use fdm_infer::Overlay;
use fdm_lab::posterior::Bands;
use fdm_report::TimeHistory;
use fdm_system::Model;
use fdm_system::record::{Column, Dialect, Run, write_to};

/// Name and meaning of a model.
pub fn title(model: &Model) -> String {
    let (name, doc) = (model.name(), &model.definition().doc);
    if doc.is_empty() { name.to_string() } else { format!("{name}: {doc}") }
}

/// Every output of every run over time: measurement beside response.
pub fn histories<'a>(fit: &Fit, runs: &'a [Run]) -> Vec<TimeHistory<'a>> {
    let definition = fit.model.definition();
    let q = definition.outputs.len();
    let mut histories = Vec::new();
    for (run, result) in runs.iter().zip(&fit.estimate.runs) {
        for (o, output) in definition.outputs.iter().enumerate() {
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
                measured: column(&run.measured, o, q),
                modelled: column(&result.response, o, q),
            });
        }
    }
    histories
}

/// One table for each run: time, inputs, and of every output what was measured, the response and the residual. The name of
/// a file holds the name of its run as far as file systems allow.
pub(crate) fn run_tables(fit: &Fit, runs: &[Run], bands: &[Option<Bands>]) -> Vec<NamedFile> {
    let table = |(k, (run, result)): (usize, (&Run, &RunFit))| {
        let bands = bands.get(k).and_then(Option::as_ref);
        (run_file(k, &run.name), run_table(fit, run, (&result.response, &result.residuals), bands))
    };
    runs.iter().zip(&fit.estimate.runs).enumerate().map(table).collect()
}

fn run_table(fit: &Fit, run: &Run, (response, residuals): (&[f64], &[f64]), bands: Option<&Bands>) -> Vec<u8> {
    let definition = fit.model.definition();
    let q = definition.outputs.len();
    let mut columns = given(&fit.model, run);
    for (k, output) in definition.outputs.iter().enumerate() {
        let (name, unit) = (&output.quantity.name, output.quantity.unit.as_ref().map(ToString::to_string));
        columns.push((name.clone(), unit.clone(), column(&run.measured, k, q)));
        columns.push((format!("{name}_model"), unit.clone(), column(response, k, q)));
        columns.push((format!("{name}_residual"), unit.clone(), column(residuals, k, q)));
        if let Some(bands) = bands {
            let edges = edges(bands, name, response, k, q);
            columns.extend(edges.into_iter().map(|(name, values)| (name, unit.clone(), values)));
        }
    }
    csv(&columns)
}

/// Time and inputs of a run.
fn given(model: &Model, run: &Run) -> Vec<(String, Option<String>, Vec<f64>)> {
    let (definition, m) = (model.definition(), run.held.len());
    let mut columns = vec![("t".to_string(), Some(definition.time.to_string()), run.time.clone())];
    for (k, input) in definition.inputs.iter().enumerate().take(m) {
        let unit = input.quantity.unit.as_ref().map(ToString::to_string);
        columns.push((input.quantity.name.clone(), unit, column(&run.inputs, k, m)));
    }
    columns
}

/// Tables of regressions, one for each run: every rate or output beside what is explained of it and the residual, over time or, as real and
/// imaginary parts, over frequency.
pub(crate) fn course_tables(model: &Model, runs: &[Run], found: &Regression) -> Vec<NamedFile> {
    let table = |(k, run): (usize, &Run)| {
        let own: Vec<&Course> = found.courses.iter().filter(|c| c.run == k).collect();
        let in_time = own.iter().filter_map(|c| match &c.along {
            Along::Time { measured, explained } => Some((c, measured, explained)),
            Along::Frequency { .. } => None,
        });
        let mut columns = Vec::new();
        for (c, measured, explained) in in_time {
            let residual = measured.iter().zip(explained).map(|(z, y)| z - y).collect();
            let parts = [("", measured.clone()), ("_model", explained.clone()), ("_residual", residual)];
            columns.extend(parts.map(|(kind, values)| (format!("{}{kind}", c.equation), c.unit.clone(), values)));
        }
        if !columns.is_empty() {
            return Some((run_file(k, &run.name), csv(&[given(model, run), columns].concat())));
        }
        Some(over_frequency(&own)).filter(|c| c.len() > 1).map(|c| (format!("spectrum_{}.csv", k + 1), csv(&c)))
    };
    runs.iter().enumerate().filter_map(table).collect()
}

/// Frequency, and of every equation real and imaginary parts; of equations that were compared at other frequencies than the first nothing.
fn over_frequency(courses: &[&Course]) -> Vec<(String, Option<String>, Vec<f64>)> {
    let mut columns: Vec<(String, Option<String>, Vec<f64>)> = Vec::new();
    for course in courses {
        let Along::Frequency { frequency, measured, explained } = &course.along else { continue };
        if columns.is_empty() {
            columns.push(("frequency".into(), None, frequency.clone()));
        }
        if columns[0].2 != *frequency {
            continue;
        }
        for (kind, values) in [("", measured), ("_model", explained)] {
            let (re, im) = values.split_at(frequency.len());
            for (part, values) in [("re", re), ("im", im)] {
                columns.push((format!("{}{kind}_{part}", course.equation), course.unit.clone(), values.to_vec()));
            }
        }
    }
    columns
}

/// The table of a run of a diagnosis: time, and of every output what was measured, and the responses before and after.
pub(crate) fn overlay_table(model: &Model, k: usize, overlay: &Overlay) -> NamedFile {
    let definition = model.definition();
    let q = definition.outputs.len();
    let mut columns = vec![("t".to_string(), Some(definition.time.to_string()), overlay.time.clone())];
    for (o, output) in definition.outputs.iter().enumerate() {
        let (name, unit) = (&output.quantity.name, output.quantity.unit.as_ref().map(ToString::to_string));
        columns.push((name.clone(), unit.clone(), column(&overlay.measured, o, q)));
        columns.push((format!("{name}_before"), unit.clone(), column(&overlay.before, o, q)));
        columns.push((format!("{name}_after"), unit, column(&overlay.after, o, q)));
    }
    (run_file(k, &overlay.run), csv(&columns))
}

/// Columns (name, unit, values) as a file.
pub fn csv(columns: &[(String, Option<String>, Vec<f64>)]) -> Vec<u8> {
    let columns: Vec<Column<'_>> =
        columns.iter().map(|(name, unit, values)| Column { name, unit: unit.as_deref(), values }).collect();
    let mut text = Vec::new();
    // memory takes everything that is written to it
    let _ = write_to(&mut text, Dialect::default(), &columns);
    text
}

/// The k-th of `width` values of every row.
pub fn column(rows: &[f64], k: usize, width: usize) -> Vec<f64> {
    rows.iter().skip(k).step_by(width).copied().collect()
}

/// The name of the file of the k-th run.
pub(crate) fn run_file(k: usize, run: &str) -> String {
    const LONGEST: usize = 60;
    let kept = |c: char| if c.is_alphanumeric() || "-_.#".contains(c) { c } else { '_' };
    let plain: String = run.chars().take(LONGEST).map(kept).collect();
    format!("run_{}_{plain}.csv", k + 1)
}
