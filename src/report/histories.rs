//! What was measured beside what the model answers, output by output, with the residual beneath on the same axis.

use super::section::{Part, Section};
use crate::page::columns::{Column, Columns};
use crate::page::figure::{Figure, Look, Mark, Panel, Shape};
use crate::page::number::{behind, bracketed, shown};
use crate::page::subject::Subject;
use crate::page::thinning::Kept;

/// Points of all figures together, and of one at least and at most.
const POINTS: usize = 150_000;
const FEWEST: usize = 1200;
const MOST: usize = 6000;
/// Runs that stand open.
const OPEN: usize = 2;
/// What stands behind the name of an output in the columns that belong to it.
const PARTS: [&str; 6] = ["model", "residual", "low", "high", "measured_low", "measured_high"];
/// Inputs in one figure.
const INPUTS: usize = 6;

pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let most = most(subject);
    let runs = subject.runs.iter().enumerate().map(|(k, (run, table))| {
        let figures = figures_of(subject, k, run, table, most).into_iter().map(Part::from).collect();
        Part::Folded { summary: run.clone(), open: k < OPEN, class: "run", parts: figures }
    });
    (!subject.runs.is_empty()).then(|| Section::new("histories", "Time histories").with_all(runs))
}

/// All time histories, run by run.
pub(crate) fn figures(subject: &Subject) -> Vec<Figure> {
    let most = most(subject);
    let runs = subject.runs.iter().enumerate();
    runs.flat_map(|(k, (run, table))| figures_of(subject, k, run, table, most)).collect()
}

/// Points of one figure.
fn most(subject: &Subject) -> usize {
    let outputs = |table: &Columns| table.columns.iter().filter(|c| is_output(table, c)).count();
    let figures: usize = subject.runs.iter().map(|(_, table)| outputs(table) + 1).sum();
    (POINTS / figures.max(1)).clamp(FEWEST, MOST)
}

fn is_output(table: &Columns, column: &Column) -> bool {
    table.column(&format!("{}_model", column.name)).is_some()
        && table.column(&format!("{}_residual", column.name)).is_some()
}

fn figures_of(subject: &Subject, k: usize, run: &str, table: &Columns, most: usize) -> Vec<Figure> {
    let Some(time) = table.columns.first() else { return Vec::new() };
    let outputs: Vec<&Column> = table.columns.iter().filter(|c| is_output(table, c)).collect();
    let part = |c: &Column| {
        let own = |o: &&Column| c.name.strip_prefix(o.name.as_str()).and_then(|rest| rest.strip_prefix('_'));
        outputs.iter().filter_map(own).any(|kind| PARTS.contains(&kind))
    };
    let inputs: Vec<&Column> =
        table.columns[1..].iter().filter(|c| !is_output(table, c) && !part(c)).take(INPUTS).collect();
    let overlaid = outputs.iter().enumerate().map(|(o, output)| {
        let id = format!("history-{}-{}", k + 1, o + 1);
        overlay(&id, k, caption(subject, run, output), table, [time, output], most)
    });
    let given = (!inputs.is_empty()).then(|| given(k, time, &inputs, most));
    overlaid.chain(given).collect()
}

fn overlay(id: &str, k: usize, caption: String, table: &Columns, [time, output]: [&Column; 2], most: usize) -> Figure {
    let other = |kind: &str| table.column(&format!("{}_{kind}", output.name)).map_or(&[][..], |c| &c.values);
    let (model, residual) = (other("model"), other("residual"));
    let kept = Kept::new(&[&output.values, model, residual], most);
    let pick = |values: &[f64]| kept.pick(values);
    let unit = bracketed(output.unit.as_deref());
    let mut marks = Vec::new();
    for (kind, name, look) in
        [("measured_", "95 % of measurements", Look::Bound), ("", "95 % of the response", Look::Model)]
    {
        let (low, high) = (other(&format!("{kind}low")), other(&format!("{kind}high")));
        if !low.is_empty() && !high.is_empty() {
            marks.push(Mark::between(name, look, Shape::Band, pick(low), pick(high)));
        }
    }
    marks.push(Mark::samples("measured", Look::Measured, pick(&output.values)));
    marks.push(Mark::line("model", Look::Model, pick(model)));
    let residual = vec![Mark::samples("measured − model", Look::Residual, pick(residual))];
    Figure::new(id, caption, label(time), pick(&time.values))
        .in_group(format!("run-{k}"))
        .with(Panel::new(format!("{}{unit}", output.name), 210, marks))
        .with(Panel::new(format!("residual{unit}"), 90, residual))
        .thinned(kept.samples())
}

/// The inputs below each other.
fn given(k: usize, time: &Column, inputs: &[&Column], most: usize) -> Figure {
    let lines: Vec<&[f64]> = inputs.iter().map(|c| &c.values[..]).collect();
    let kept = Kept::new(&lines, most);
    let pick = |values: &[f64]| kept.pick(values);
    let panel = |c: &&Column| {
        Panel::new(
            format!("{}{}", c.name, bracketed(c.unit.as_deref())),
            90,
            vec![Mark::line(&c.name, Look::Input, pick(&c.values))],
        )
    };
    Figure::new(format!("inputs-{}", k + 1), "what was given", label(time), pick(&time.values))
        .in_group(format!("run-{k}"))
        .with_all(inputs.iter().map(panel).collect())
        .thinned(kept.samples())
}

fn label(time: &Column) -> String {
    format!("time{}", bracketed(time.unit.as_deref()))
}

fn caption(subject: &Subject, run: &str, output: &Column) -> String {
    let found = subject.outputs().iter().find(|o| o.name == output.name && o.run == run);
    let Some(found) = found else { return output.name.clone() };
    let unit = behind(output.unit.as_deref());
    format!(
        "{}: RMS of the residual {}{unit}, R² {}, TIC {}",
        output.name,
        shown(found.rms, 4),
        shown(found.r2, 5),
        shown(found.tic, 3)
    )
}
