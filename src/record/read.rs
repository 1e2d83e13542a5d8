//! A file becomes a run: the columns that a model wants, the rows that the user selects, the units of the model.

use super::bridge;
use super::channel::{Channel, Channels, Plan, Role, Source};
use super::dialect::Dialect;
use super::error::{Names, Problem, RecordError};
use super::fault::Fault;
use super::measured;
use super::run::Run;
use super::samples::{self, Samples};
use super::search;
use super::slope;
use super::summary::{self, ChannelSource, Note, Sampling, Summary};
use super::table::Table;
use fdm_grammar::diagnostic::nearest;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What the user chose beside the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReadOptions {
    /// Channel and the column that it is read from: title or name, possibly with a unit (`time [ms]`) for a column
    /// that states none; `log(c [mol/l])` is the natural logarithm of its numbers in this unit. The time is the channel `t`.
    pub map: Vec<(String, String)>,
    /// First time to be used, as it stands in the file; a row number from 0 where the file has no time.
    pub from: Option<f64>,
    /// Last time to be used, as it stands in the file.
    pub to: Option<f64>,
    /// Use every n-th selected row, beginning with the first.
    pub every: usize,
    /// Inputs that keep their value until the next sample.
    pub hold: Vec<String>,
    /// Whether every output must have a column with values; otherwise missing ones are all NaN.
    pub require_outputs: bool,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { map: Vec::new(), from: None, to: None, every: 1, hold: Vec::new(), require_outputs: true }
    }
}

/// Reads a record for a model, in the model's units, order and time, which begins at 0 with the first sample used.
///
/// The first row holds titles, `name [unit]` or `name (unit)`; delimiter and decimal mark are recognised; lines that
/// begin with `#` or `%` are comments. Empty cells and the usual words for them (NaN, NA, -) are gaps: outputs are not
/// compared there, inputs are bridged from their neighbours in time. Rows that repeat the row before are used once.
///
/// # Errors
/// All problems that can be told apart: options and columns first, then the cells of the selected rows.
pub fn read(path: &Path, channels: &Channels, options: &ReadOptions) -> Result<(Run, Summary), RecordError> {
    let told = |problems| RecordError { file: path.display().to_string(), problems };
    let table = Table::open(path).map_err(|p| told(vec![p]))?;
    let name = path.file_stem().map_or_else(|| "run".into(), |s| s.to_string_lossy().into_owned());
    assemble(name, &table, channels, options).map_err(told)
}

fn assemble(
    name: String,
    table: &Table,
    channels: &Channels,
    options: &ReadOptions,
) -> Result<(Run, Summary), Vec<Problem>> {
    let mut problems = check_options(channels, options);
    let mut notes = Vec::new();
    let plan = search::plan(table, channels, options, &mut notes).map_err(|p| problems.extend(p));
    let (Ok(plan), true) = (plan, problems.is_empty()) else { return Err(problems) };
    let samples = samples::collect(table, &plan, channels.timed, options)?;
    check_amount(table, &plan, channels, options, &samples)?;
    notes.extend(samples.repeated.map(|(rows, line)| Note::Repeated { rows, line }));
    notes.extend((!table.ended).then_some(Note::OpenEnd));
    let (rows, dialect) = (samples.rows, Dialect { delimiter: table.delimiter, decimal: samples.decimal() });
    let run = finish(name, samples, &plan, channels, options, &mut notes)?;
    let names: Vec<_> = names(channels).collect();
    let sampling = if channels.timed { Sampling::new(&run.time) } else { None };
    notes.extend(summary::suspicions(&run, &names, sampling));
    let sources = sources(table, &plan, &run, &names);
    let used = run.len();
    Ok((run, Summary { dialect, rows, used, sources, sampling, notes }))
}

fn names(channels: &Channels) -> impl Iterator<Item = (Role, String)> {
    let inputs = channels.inputs.iter().map(|c| (Role::Input, c.name.clone()));
    inputs.chain(channels.outputs.iter().map(|c| (Role::Output, c.name.clone())))
}

fn check_options(channels: &Channels, options: &ReadOptions) -> Vec<Problem> {
    let mut problems = Vec::new();
    if options.every == 0 {
        problems.push(Fault::EveryNone.anywhere());
    }
    let (from, to) = (options.from.unwrap_or(f64::NEG_INFINITY), options.to.unwrap_or(f64::INFINITY));
    if from.is_nan() || to.is_nan() || from > to {
        problems.push(Fault::Window { from: from.to_string(), to: to.to_string() }.anywhere());
    }
    for held in &options.hold {
        if let Some(k) = channels.inputs.iter().position(|c| c.name == *held) {
            if channels.slopes.iter().any(|s| s.of as usize == k) {
                problems.push(Fault::HeldDerivative(held.clone()).anywhere());
            }
            continue;
        }
        if channels.outputs.iter().any(|c| c.name == *held) {
            problems.push(Fault::NotAnInput(held.clone()).anywhere());
            continue;
        }
        let inputs = || channels.inputs.iter().map(|c| c.name.as_str());
        let hint = nearest(held, inputs()).map(|n| format!("did you mean `{n}`?"));
        let fault = Fault::UnknownChannel { option: "--hold", channel: held.clone(), channels: Names::new(inputs()) };
        problems.push(fault.anywhere().maybe_hint(hint));
    }
    problems
}

/// Enough samples, and a value at least in every channel.
fn check_amount(
    table: &Table,
    plan: &Plan,
    channels: &Channels,
    options: &ReadOptions,
    samples: &Samples,
) -> Result<(), Vec<Problem>> {
    let found = samples.time.len();
    if samples.rows == 0 {
        return Err(vec![Fault::NoRows.at(table.header_line)]);
    }
    if let (0, Some((first, last))) = (found, samples.span) {
        let (first, last) = (first.to_string(), last.to_string());
        return Err(vec![Fault::NothingSelected { first, last }.anywhere()]);
    }
    if found < channels.samples {
        return Err(vec![Fault::TooFew { found, expected: channels.samples }.anywhere()]);
    }
    let empty = |rows: &[f64], width: usize, k: usize| rows.iter().skip(k).step_by(width).all(|v| v.is_nan());
    let (m, q) = (plan.inputs.len(), plan.outputs.len());
    let no_input =
        |k: usize| empty(&samples.inputs, m, k).then_some((Role::Input, &channels.inputs[k], &plan.inputs[k]));
    let no_output = |k: usize| {
        let source = plan.outputs[k].as_ref().filter(|_| channels.needs(k, options.require_outputs))?;
        empty(&samples.measured, q, k).then_some((Role::Output, &channels.outputs[k], source))
    };
    let problem = |(role, channel, source): (Role, &Channel, &Source)| {
        let fault = Fault::NoValues { role, channel: channel.name.clone() };
        fault.anywhere().column(&table.columns[source.column].title)
    };
    let problems: Vec<_> = (0..m).filter_map(no_input).chain((0..q).filter_map(no_output)).map(problem).collect();
    if problems.is_empty() { Ok(()) } else { Err(problems) }
}

/// Time from 0 in the model's unit, gaps counted and bridged.
fn finish(
    name: String,
    samples: Samples,
    plan: &Plan,
    channels: &Channels,
    options: &ReadOptions,
    notes: &mut Vec<Note>,
) -> Result<Run, Vec<Problem>> {
    let Samples { time, inputs, mut measured, .. } = samples;
    let time = match plan.time.as_ref().filter(|_| channels.timed) {
        Some(source) => since_first(time, source.scale).ok_or_else(|| vec![Fault::TimeResolution.anywhere()])?,
        None => (0..time.len()).map(|k| k as f64).collect(),
    };
    let (declared, q) = (plan.inputs.len(), plan.outputs.len());
    let mut inputs = measured::beside(time.len(), (&inputs, declared), declared, (&measured, q), &channels.driving);
    let m = declared + channels.driving.len();
    let mut held: Vec<_> = channels.inputs.iter().map(|c| options.hold.contains(&c.name)).collect();
    held.resize(m, false);
    let output_gaps = (0..q).map(|k| measured.iter().skip(k).step_by(q).filter(|v| v.is_nan()).count()).collect();
    if !channels.timed {
        bridge::compare_not(&inputs, m, &mut measured, q);
    }
    let mut input_gaps: Vec<_> = (0..m).map(|k| bridge(&time, &mut inputs, m, k, held[k])).collect();
    let hidden = channels.driving.iter().map(|k| format!("measured({})", channels.outputs[*k].name));
    let inputs_by_name = channels.inputs.iter().map(|c| c.name.clone()).chain(hidden);
    for (input, gaps) in inputs_by_name.zip(&input_gaps).filter(|(_, gaps)| **gaps > 0) {
        notes.push(Note::Bridged { input, gaps: *gaps, in_time: channels.timed });
    }
    let width = m + channels.slopes.len();
    inputs = slope::widened(&inputs, time.len(), m, channels.slopes.len());
    for (k, slope) in channels.slopes.iter().enumerate() {
        slope::fill(&time, &mut inputs, width, m + k, *slope);
        held.push(!slope.shown);
        input_gaps.push(input_gaps[slope.of as usize]);
    }
    Ok(Run { name, time, inputs, held, measured, input_gaps, output_gaps })
}

/// Times since the first, scaled; `None` when they do not rise any more, or leave the range of numbers.
fn since_first(mut time: Vec<f64>, scale: f64) -> Option<Vec<f64>> {
    let first = *time.first()?;
    for t in &mut time {
        *t = (*t - first) * scale;
    }
    let rises = time.windows(2).all(|w| w[0] < w[1]) && time.iter().all(|t| t.is_finite());
    rises.then_some(time)
}

fn sources(table: &Table, plan: &Plan, run: &Run, names: &[(Role, String)]) -> Vec<ChannelSource> {
    let source = |role: Role, channel: &str, source: Option<&Source>, gaps: usize| ChannelSource {
        role,
        channel: channel.to_string(),
        column: source.map(|s| table.columns[s.column].title.clone()),
        unit: source.and_then(|s| s.unit.clone()),
        scale: source.map_or(1.0, |s| s.scale),
        offset: source.map_or(0.0, |s| s.offset),
        logarithm: source.is_some_and(|s| s.logarithm),
        gaps,
    };
    let columns = plan.inputs.iter().map(Some).chain(plan.outputs.iter().map(Option::as_ref));
    let gaps = run.input_gaps.iter().take(plan.inputs.len()).chain(&run.output_gaps);
    let channels = names.iter().zip(columns).zip(gaps).map(|(((role, name), s), gaps)| source(*role, name, s, *gaps));
    plan.time.iter().map(|t| source(Role::Time, "t", Some(t), 0)).chain(channels).collect()
}
