//! A file becomes a run: the columns that a model wants, the rows that the user selects, the units of the model; and what was found on the
//! way ([`Summary`]), for people to look at before they trust a fit.

use super::beginning::Lead;
use super::channel::{Channel, Channels, Demand, Plan, Role, Source};
use super::error::{Fault, Names, Problem, RecordError, excerpt};
use super::even_grid::Sampling;
use super::grid::Dialect;
use super::holds::Holds;
use super::note::Note;
use super::options::{Censored, ReadOptions};
use super::pauses::{self, PAUSE};
use super::run::Run;
use super::samples::{self, Samples};
use super::table::Table;
use super::{beginning, derived, doses, known, log, missing, search, shape, times};
use fdm_grammar::diagnostic::nearest;
use std::path::Path;

/// Reads a record for a model, in the model's units, order and time, which is 0 at the run's beginning: the first sample used, where
/// [`ReadOptions::begin`] says nothing else.
///
/// The header is the line above the first long run of rows; titles are `name [unit]` or `name (unit)`, or have their units in a row below; what separates
/// cells and the decimal mark are recognised. Empty cells and the usual words for them (NaN, NA, -) are gaps: outputs are not
/// compared there, inputs are bridged from their neighbours in time. Rows that repeat the row before are used once.
///
/// # Errors
/// All problems that can be told apart: options and columns first, then the cells of the selected rows; and a file of several runs.
pub fn read(path: &Path, channels: &Channels, options: &ReadOptions) -> Result<(Run, Summary), RecordError> {
    let demand = if options.require_outputs { Demand::Needed } else { Demand::Free };
    let mut runs = demanding(path, channels, options, |_| demand)?;
    let several =
        |n: usize| RecordError { file: path.display().to_string(), problems: vec![Fault::SeveralRuns(n).anywhere()] };
    let count = runs.len();
    runs.pop().filter(|_| count == 1).ok_or_else(|| several(count))
}

/// Reads several records for one model, each with options of its own, and gives the runs of each file: more than one where rows of one time are repeats,
/// or a column tells runs apart. An output may be missing in a run, its column or all its values, where another run measures it, or where
/// `elsewhere` (q, or nothing) says so; such a run holds NaN, and a note says it. Outputs are required where the options of the first file say so.
///
/// # Errors
/// As [`read()`], of every file; an output that no run measures, where outputs are required; and a missing output whose column may be there
/// under a name that is nearly the same.
pub fn read_each(
    files: &[(&Path, &ReadOptions)],
    channels: &Channels,
    elsewhere: &[bool],
) -> Result<Vec<Vec<(Run, Summary)>>, Vec<RecordError>> {
    let q = channels.outputs.len();
    let required = files.first().is_some_and(|(_, options)| options.require_outputs);
    let each = |demand: &dyn Fn(usize) -> Demand| {
        let (mut found, mut errors) = (Vec::new(), Vec::new());
        for (path, options) in files {
            match demanding(path, channels, options, demand) {
                Ok(runs) => found.push(runs),
                Err(e) => errors.push(e),
            }
        }
        if errors.is_empty() { Ok(found) } else { Err(errors) }
    };
    if !required {
        return each(&|_| Demand::Free);
    }
    let elsewhere = |k: usize| elsewhere.get(k).copied().unwrap_or(false);
    if files.len() == 1 {
        return each(&|k| if elsewhere(k) { Demand::IfMeasured } else { Demand::Needed });
    }
    let found = each(&|_| Demand::IfMeasured)?;
    let left_out = |k: usize| files.iter().all(|(_, options)| options.without.contains(&channels.outputs[k].name));
    let measured = |k: usize| elsewhere(k) || left_out(k) || found.iter().flatten().any(|(run, _)| run.measures(k));
    let missing: Vec<bool> = (0..q).map(|k| !measured(k)).collect();
    if missing.contains(&true) {
        // read once more, so that each file says what it lacks
        return each(&|k| if missing[k] { Demand::Needed } else { Demand::IfMeasured });
    }
    Ok(found)
}

/// A part of a table that is a run, or several where rows of one time are repeats: what tells it apart, and its rows.
type Part = (Option<(String, String)>, Table);

/// The runs of a file that `options` select.
fn demanding(
    path: &Path,
    channels: &Channels,
    options: &ReadOptions,
    demand: impl Fn(usize) -> Demand,
) -> Result<Vec<(Run, Summary)>, RecordError> {
    let of = |(k, channel): (usize, &Channel)| match () {
        () if channels.driving.contains(&k) => Demand::Needed,
        () if options.without.contains(&channel.name) => Demand::LeftOut,
        () => demand(k),
    };
    let demands: Vec<Demand> = channels.outputs.iter().enumerate().map(of).collect();
    let told = |problems| RecordError { file: path.display().to_string(), problems };
    let mut notes = Vec::new();
    let content = log::content(path).map_err(|p| told(vec![p]))?;
    let asked = known::asked(channels, options).map_err(told)?;
    let (columns, demands) = (&asked.channels, asked.demands(demands));
    let table = log::table(content, columns, options, &mut notes).map_err(told)?;
    let targets = options.map.iter().map(|(_, column)| column.as_str());
    let mut table = shape::long(table, &columns.names().chain(targets).collect::<Vec<_>>());
    missing::take_out(&mut table, options);
    let mut runs = Vec::new();
    for (by, mut part) in parts(table, options).map_err(|p| told(vec![p]))? {
        let named = search::named_time(&mut part, columns, options);
        let may_be = search::may_be_time(columns, options);
        times::rated(&mut part, options.rate, named, &may_be).map_err(|p| told(vec![p]))?;
        let mut notes = notes.clone();
        notes.append(&mut part.notes);
        let value = by.as_ref().map(|(_, value)| value);
        let name = value.map_or_else(|| name_of(path), |value| format!("{}#{value}", name_of(path)));
        let options = &doses::conventions(&part, columns, options);
        runs.extend(
            assemble(name, &part, columns, options, (&demands, notes))
                .map_err(told)?
                .into_iter()
                .map(|run| (by.clone(), run)),
        );
    }
    let of = runs.len();
    let mut found = Vec::new();
    for (number, (by, (run, mut summary))) in runs.into_iter().enumerate() {
        if options.part.is_some_and(|part| part != number) {
            continue;
        }
        let is_piece = by.is_none() && summary.notes.iter().any(|note| matches!(note, Note::Segments { .. }));
        if of > 1 && !is_piece {
            summary.notes.push(Note::Part { number: number + 1, of, by });
        }
        found.push((asked.completed(channels, options, run, &mut summary), summary));
    }
    if found.is_empty() { Err(told(vec![Fault::SeveralRuns(of).anywhere()])) } else { Ok(found) }
}

/// The table, or its parts by a column of runs.
fn parts(table: Table, options: &ReadOptions) -> Result<Vec<Part>, Problem> {
    let Some(name) = &options.runs_by else { return Ok(vec![(None, table)]) };
    let lower = name.to_lowercase();
    let place = |is: &dyn Fn(&str) -> bool| table.headings().position(|h| is(&h.title) || is(&h.name));
    let column = place(&|text| text == name).or_else(|| place(&|text| text.to_lowercase() == lower));
    let Some(column) = column else {
        let hint = nearest(name, table.headings().map(|h| h.name.as_str())).map(|n| format!("did you mean `{n}`?"));
        let fault = Fault::UnknownRuns { column: excerpt(name), columns: table.titles() };
        return Err(fault.anywhere().maybe_hint(hint));
    };
    let title = table.columns[column].heading.title.clone();
    let runs = shape::runs_by(&table, column).into_iter();
    Ok(runs.map(|(value, rows)| (Some((title.clone(), value)), table.part(&rows))).collect())
}

/// The name of the run of a file.
fn name_of(path: &Path) -> String {
    if path == Path::new("-") {
        return "stdin".into();
    }
    let unpacked = if path.extension().is_some_and(|e| e == "gz") { path.with_extension("") } else { path.into() };
    unpacked.file_stem().map_or_else(|| "run".into(), |s| s.to_string_lossy().into_owned())
}

/// The runs of a table: one, or one for each repeat.
fn assemble(
    name: String,
    table: &Table,
    channels: &Channels,
    options: &ReadOptions,
    (demands, mut notes): (&[Demand], Vec<Note>),
) -> Result<Vec<(Run, Summary)>, Vec<Problem>> {
    let mut problems = check_options(channels, options);
    if table.unnamed && options.map.is_empty() {
        let row: Vec<String> =
            table.columns.iter().take(3).filter_map(|c| Some(c.values.first()?.to_string())).collect();
        let hint =
            "name them by their numbers, --map \"t=#1 [s]\" --map u=#2 .., or write names into a line above the rows";
        problems.push(table.in_header(Fault::NoHeader(row.join(", "))).hint(hint));
        return Err(problems);
    }
    let plan = search::plan(table, channels, options, demands, &mut notes).map_err(|p| problems.extend(p));
    let (Ok(plan), true) = (plan, problems.is_empty()) else { return Err(problems) };
    let dosed = doses::inputs(table, &plan, channels);
    let mut repeats = samples::collect((table, &dosed), &plan, channels.timed, options)?;
    doses::give(&mut repeats, (table, &plan), channels, &mut notes)?;
    // a repeat may be short: what all of them hold is enough
    if let Some(first) = repeats.first() {
        check_amount(table, &plan, channels, demands, first)?;
    }
    let free: Vec<usize> = (0..plan.inputs.len()).filter(|k| !dosed.contains(k)).collect();
    let mut whole = |samples| {
        if channels.timed && options.beginning().is_none() {
            pauses::cut(samples, (&free, channels), &mut notes)
        } else {
            vec![samples]
        }
    };
    let pieces: Vec<Samples> = repeats.into_iter().flat_map(&mut whole).collect();
    let one = |samples| run_of(name.clone(), (table, &plan), channels, options, (samples, notes.clone()));
    pieces.into_iter().map(one).collect()
}

/// The run of selected rows.
fn run_of(
    name: String,
    (table, plan): (&Table, &Plan),
    channels: &Channels,
    options: &ReadOptions,
    (mut samples, mut notes): (Samples, Vec<Note>),
) -> Result<(Run, Summary), Vec<Problem>> {
    let first = samples.time.first().copied();
    let lead = beginning::lead(&samples.time, options, channels.timed)?;
    let question = beginning::in_question(&samples.time, plan.time.as_ref(), options);
    notes.extend(samples.repeated.map(|(rows, line)| Note::Repeated { rows, line }));
    notes.extend((samples.merged > 0).then_some(Note::Merged { rows: samples.merged }));
    notes.extend((!table.ended).then_some(Note::OpenEnd));
    let delimiter = table.delimiter.unwrap_or(Dialect::default().delimiter);
    let (rows, dialect) = (samples.rows, Dialect { delimiter, decimal: samples.decimal() });
    let holds = Holds::of(channels, (&options.hold, &options.linear), &table.held, &samples.inputs);
    let taken = holds.taken.iter().map(|k| channels.inputs[*k].name.clone());
    notes.extend(taken.map(|input| Note::TakenForHeld { input }));
    known::unwrapped(&mut samples.measured, &channels.outputs, &mut notes);
    let limits = std::mem::take(&mut samples.limits);
    let inserted = std::mem::take(&mut samples.inserted);
    let name_of_run = name.clone();
    let mut run = finish(name, samples, plan, channels, (holds, &lead), &mut notes)?;
    known::same_in_all(&run, channels).map_err(|problem| vec![problem])?;
    let names: Vec<_> = names(channels).collect();
    // of what is only simulated no squares are taken
    let unheld = if options.any_size { Vec::new() } else { sizes(&run, &names, channels.inputs.len()) };
    if !unheld.is_empty() {
        return Err(unheld);
    }
    let counted = run.time.iter().enumerate().all(|(k, t)| *t == k as f64);
    let recorded = run.time[lead.before()..].iter().enumerate().filter(|(k, _)| !inserted.contains(k));
    let recorded: Vec<f64> = recorded.map(|(_, t)| *t).collect();
    let sampling = if channels.timed || !counted { Sampling::new(&recorded) } else { None };
    limits.iter().for_each(|(_, output, _)| run.output_gaps[*output] -= 1);
    let censored = limits.iter().map(|(sample, output, limit)| Censored {
        run: name_of_run.clone(),
        output: *output,
        time: run.time[sample + lead.before()],
        limit: *limit,
    });
    let first_compared = run.time.get(lead.rows()).copied().unwrap_or(f64::INFINITY);
    let censored: Vec<Censored> = censored.filter(|c| c.time >= first_compared).collect();
    let empty = |(k, _): &(usize, &Option<Source>)| !run.measures(*k) && !limits.iter().any(|l| l.1 == *k);
    let columns = plan.outputs.iter().enumerate().filter(|(_, source)| source.is_some());
    notes.extend(columns.filter(empty).map(|(k, _)| Note::NotMeasured { output: channels.outputs[k].name.clone() }));
    notes.extend(below_limits(&limits, table, plan));
    notes.extend(suspicions(&run, &names, sampling));
    let sources = sources(table, plan, &run, &names);
    let used = run.len() - lead.before() - inserted.len();
    lead.uncompared(&mut run);
    notes.extend(first.and_then(|first| lead.note(first, plan.time.as_ref(), !channels.inputs.is_empty())));
    let format = table.format;
    Ok((run, Summary { format, dialect, rows, used, lead: lead.rows(), question, sources, sampling, censored, notes }))
}

/// What is said of samples below a limit.
fn below_limits(limits: &[(usize, usize, f64)], table: &Table, plan: &Plan) -> Vec<Note> {
    let of = |(o, source): (usize, &Option<Source>)| {
        let cells = limits.iter().filter(|(_, output, _)| *output == o).count();
        let column = &table.columns[source.as_ref().filter(|_| cells > 0)?.column];
        Some(Note::BelowLimit { column: column.heading.title.clone(), cells })
    };
    plan.outputs.iter().enumerate().filter_map(of).collect()
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
    for (option, held) in
        options.hold.iter().map(|n| ("--zoh", n)).chain(options.linear.iter().map(|n| ("--linear", n)))
    {
        if option == "--linear" && options.hold.contains(held) {
            problems.push(Fault::HeldAndLinear(held.clone()).anywhere());
            continue;
        }
        if let Some(k) = channels.inputs.iter().position(|c| c.name == *held) {
            if option == "--zoh" && channels.slopes.iter().any(|s| s.of as usize == k) {
                problems.push(Fault::HeldDerivative(held.clone()).anywhere());
            }
            continue;
        }
        if channels.outputs.iter().any(|c| c.name == *held) {
            problems.push(Fault::NotAnInput { option, channel: held.clone() }.anywhere());
            continue;
        }
        let inputs = || channels.inputs.iter().map(|c| c.name.as_str());
        let hint = nearest(held, inputs()).map(|n| format!("did you mean `{n}`?"));
        let fault = Fault::UnknownChannel { option, channel: held.clone(), channels: Names::new(inputs()) };
        problems.push(fault.anywhere().maybe_hint(hint));
    }
    for (k, channel) in
        channels.inputs.iter().enumerate().filter(|(_, c)| c.held == Some(true) && !options.linear.contains(&c.name))
    {
        if channels.slopes.iter().any(|s| s.of as usize == k) {
            problems.push(Fault::HeldDerivative(channel.name.clone()).anywhere());
        }
    }
    for name in &options.without {
        if channels.drives(name) {
            problems.push(Fault::LeftOutDrives(name.clone()).anywhere());
        } else if !channels.outputs.iter().any(|c| c.name == *name) {
            let outputs = || channels.outputs.iter().map(|c| c.name.as_str());
            let hint = nearest(name, outputs()).map(|n| format!("did you mean `{n}`?"));
            let (option, channel) = ("--without-output", name.clone());
            let fault = Fault::UnknownOutput { option, output: channel, outputs: Names::new(outputs()) };
            problems.push(fault.anywhere().maybe_hint(hint));
        }
    }
    problems
}

/// Enough samples, and a value at least in every channel.
fn check_amount(
    table: &Table,
    plan: &Plan,
    channels: &Channels,
    demands: &[Demand],
    samples: &Samples,
) -> Result<(), Vec<Problem>> {
    let found = samples.time.len();
    if samples.rows == 0 {
        return Err(vec![table.in_header(Fault::NoRows)]);
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
        let source = plan.outputs[k].as_ref().filter(|_| demands[k] == Demand::Needed)?;
        let limited = samples.limits.iter().any(|(_, output, _)| *output == k);
        (empty(&samples.measured, q, k) && !limited).then_some((Role::Output, &channels.outputs[k], source))
    };
    let problem = |(role, channel, source): (Role, &Channel, &Source)| {
        let fault = Fault::NoValues { role, channel: channel.name.clone() };
        let may_go = role == Role::Output && !channels.drives(&channel.name);
        let hint = may_go.then(|| format!("if it was not measured, say --without-output {}", channel.name));
        fault.anywhere().column(&table.columns[source.column].heading.title).maybe_hint(hint)
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
    (holds, lead): (Holds, &Lead),
    notes: &mut Vec<Note>,
) -> Result<Run, Vec<Problem>> {
    let Samples { time, inputs, mut measured, unsampled, .. } = samples;
    let count = time.len();
    let origin = lead.begin.or(time.first().copied()).unwrap_or_default();
    let mut time = match (plan.time.as_ref().map(|source| since(origin, time, source.scale)), channels.timed) {
        (Some(Some(time)), _) => time,
        (Some(None), true) => return Err(vec![Fault::TimeResolution.anywhere()]),
        _ => (0..count).map(|k| k as f64).collect(),
    };
    let (declared, q) = (plan.inputs.len(), plan.outputs.len());
    let mut inputs = derived::beside(time.len(), (&inputs, declared), declared, (&measured, q), &channels.driving);
    let m = declared + channels.driving.len();
    let Holds { mut held, mut stated, .. } = holds;
    held.resize(m, false);
    stated.resize(m, true);
    let gaps = |k: usize| measured.iter().skip(k).step_by(q).filter(|v| v.is_nan()).count();
    // at the times of other sensors, and at the edges of commands, nothing is missing
    let output_gaps = (0..q).map(|k| gaps(k) - unsampled.get(k).copied().unwrap_or(0)).collect();
    if !channels.timed {
        derived::compare_not(&inputs, m, &mut measured, q);
    }
    let mut input_gaps: Vec<_> = (0..m).map(|k| derived::bridge(&time, &mut inputs, m, k, held[k])).collect();
    let hidden = channels.driving.iter().map(|k| format!("measured({})", channels.outputs[*k].name));
    let inputs_by_name = channels.inputs.iter().map(|c| c.name.clone()).chain(hidden);
    for (input, gaps) in inputs_by_name.zip(&input_gaps).filter(|(_, gaps)| **gaps > 0) {
        notes.push(Note::Bridged { input, gaps: *gaps, in_time: channels.timed });
    }
    lead.put_in_front(&mut time, (&mut inputs, m), (&mut measured, q));
    let width = m + channels.slopes.len();
    inputs = derived::widened(&inputs, time.len(), m, channels.slopes.len());
    for (k, slope) in channels.slopes.iter().enumerate() {
        derived::fill_slopes(&time, &mut inputs, width, m + k, *slope);
        held.push(!slope.shown);
        stated.push(true);
        input_gaps.push(input_gaps[slope.of as usize]);
    }
    Ok(Run { name, time, inputs, held, measured, input_gaps, stated, output_gaps })
}

/// Channels of which squares overflow, or vanish beside none that do not.
fn sizes(run: &Run, names: &[(Role, String)], inputs: usize) -> Vec<Problem> {
    const SIZES: std::ops::RangeInclusive<f64> = 1e-100..=1e100;
    let (m, q) = (run.held.len(), names.len() - inputs);
    let largest = |values: &[f64], k: usize, width: usize| {
        // what is missing is not a number
        values.iter().skip(k).step_by(width).map(|v| v.abs()).fold(0.0, f64::max)
    };
    let one = |(k, (role, channel)): (usize, &(Role, String))| {
        let size = if k < inputs { largest(&run.inputs, k, m) } else { largest(&run.measured, k - inputs, q) };
        let is_held = size == 0.0 || SIZES.contains(&size);
        let value = format!("{size:e}");
        (!is_held).then(|| Fault::Size { role: *role, channel: channel.clone(), value }.anywhere())
    };
    names.iter().enumerate().filter_map(one).collect()
}

/// Times since `origin`, scaled; `None` when they do not rise any more, or leave the range of numbers.
pub(super) fn since(origin: f64, mut time: Vec<f64>, scale: f64) -> Option<Vec<f64>> {
    for t in &mut time {
        *t = (*t - origin) * scale;
    }
    let rises = time.windows(2).all(|w| w[0] < w[1]) && time.iter().all(|t| t.is_finite());
    rises.then_some(time)
}

fn sources(table: &Table, plan: &Plan, run: &Run, names: &[(Role, String)]) -> Vec<ChannelSource> {
    let source = |role: Role, channel: &str, source: Option<&Source>, gaps: usize| ChannelSource {
        role,
        channel: channel.to_string(),
        column: source.map(|s| table.columns[s.column].heading.title.clone()),
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

/// What was read from where, and what should be known about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The format, as people call it; `text` for tables of text.
    pub format: &'static str,
    /// How the file is written.
    pub dialect: Dialect,
    /// Rows below the header that are not blank.
    pub rows: usize,
    /// Rows that became samples.
    pub used: usize,
    /// Rows of the run in front of the first sample that is compared: those between its beginning and `from`, and the beginning itself
    /// where no row of the file stands there.
    pub lead: usize,
    /// The first time as it stands in the file, where nobody said where the run begins and the record's own 0 may be meant.
    pub question: Option<f64>,
    /// The time column (when the record has one), inputs, outputs.
    pub sources: Vec<ChannelSource>,
    /// Spacing of the samples; `None` for one sample, and where samples are counted.
    pub sampling: Option<Sampling>,
    /// Samples of which only a limit is known that they lie below.
    pub censored: Vec<Censored>,
    /// What a careful reader would mention.
    pub notes: Vec<Note>,
}

/// Where a channel came from.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelSource {
    /// What it is to the model.
    pub role: Role,
    /// Its name in the model, `t` for the time.
    pub channel: String,
    /// Title of the column; `None` for an output that the file does not have.
    pub column: Option<String>,
    /// Unit of the column, when it is known.
    pub unit: Option<String>,
    /// The model's value is `scale*value + offset`, or the logarithm of that.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Whether the model's value is the natural logarithm of `scale*value + offset`.
    pub logarithm: bool,
    /// Selected cells without a value.
    pub gaps: usize,
}

/// The notes that follow from the samples alone; `names` are those of the columns, inputs before outputs.
pub(crate) fn suspicions(run: &Run, names: &[(Role, String)], sampling: Option<Sampling>) -> Vec<Note> {
    const FEWEST: usize = 3;
    let (width, outputs) = (run.held.len(), run.output_gaps.len());
    let inputs = names.len() - outputs;
    let column = |k: usize| -> (&[f64], usize, usize) {
        if k < inputs { (&run.inputs, width, k) } else { (&run.measured, outputs, k - inputs) }
    };
    let mut notes = Vec::new();
    for (k, (role, name)) in names.iter().enumerate() {
        let (rows, width, at) = column(k);
        let mut values = rows.iter().skip(at).step_by(width).filter(|v| !v.is_nan());
        let Some(first) = values.next() else { continue };
        let samples = values.try_fold(1, |n, v| if v == first { Some(n + 1) } else { None }).unwrap_or(0);
        if samples >= FEWEST {
            notes.push(Note::Constant { role: *role, channel: name.clone(), value: *first, samples });
        }
    }
    if let Some(s) = sampling.filter(|s| s.greatest > PAUSE * s.median) {
        notes.push(Note::Pause { length: s.greatest, at: s.greatest_at, median: s.median });
    }
    notes
}
