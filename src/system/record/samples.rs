//! The selected rows of a table as numbers in the model's units, and everything that is wrong with them.

use super::channel::{Plan, Source};
use super::column::{Column, Thousands};
use super::error::{Fault, Problem, excerpt};
use super::grid::{Delimiter, Mark};
use super::options::{BelowLimit, ReadOptions};
use super::table::{CUT, Table};
use super::text::{self, Cell};
use std::ops::Range;

/// Selected rows: times as they stand in the file, channels in the model's units, NaN in gaps.
#[derive(Debug, Default, Clone)]
pub(crate) struct Samples {
    /// Rows below the header, selected or not.
    pub(crate) rows: usize,
    /// Times of the samples in the file's unit, or row numbers (N); NaN where a time that is not needed cannot be read.
    pub(crate) time: Vec<f64>,
    /// Inputs (N by m).
    pub(crate) inputs: Vec<f64>,
    /// Outputs (N by q).
    pub(crate) measured: Vec<f64>,
    /// Samples of each output without a value at which its sensor was not sampled (q, or nothing).
    pub(crate) unsampled: Vec<usize>,
    /// Samples that are known to lie below a limit, where they hold NaN: sample, output, limit in the model's unit.
    pub(crate) limits: Vec<(usize, usize, f64)>,
    /// Samples at instants of doses that have no row.
    pub(crate) inserted: Vec<usize>,
    /// Times of the first and last row of the file.
    pub(crate) span: Option<(f64, f64)>,
    /// Rows that repeat the row before, and the line of the first.
    pub(crate) repeated: Option<(usize, usize)>,
    /// Rows of the instant before, with values that it lacked.
    pub(crate) merged: usize,
    /// Decimal mark of the numbers.
    pub(crate) mark: Option<Mark>,
}

impl Samples {
    /// The decimal mark of the file; a point when no number has one.
    pub(crate) fn decimal(&self) -> Mark {
        self.mark.unwrap_or(Mark::Point)
    }
}

impl Samples {
    /// Some neighbouring samples.
    pub(crate) fn piece(&self, of: Range<usize>) -> Self {
        let n = self.time.len().max(1);
        let rows = |values: &[f64]| {
            let width = values.len() / n;
            values[of.start * width..of.end * width].to_vec()
        };
        let measured = rows(&self.measured);
        let q = self.unsampled.len();
        let gaps = |k: usize| measured.iter().skip(k).step_by(q).filter(|v| v.is_nan()).count();
        // which of the gaps are those is not kept
        let unsampled = self.unsampled.iter().enumerate().map(|(k, all)| gaps(k).min(*all)).collect();
        let limits = self.limits.iter().filter(|l| of.contains(&l.0)).map(|l| (l.0 - of.start, l.1, l.2)).collect();
        let inserted = self.inserted.iter().filter(|k| of.contains(k)).map(|k| k - of.start).collect();
        let time = self.time[of.clone()].to_vec();
        Self { time, inputs: rows(&self.inputs), measured, unsampled, limits, inserted, ..self.clone() }
    }
}

/// Times up to which rows of one time are taken for repeats of a laboratory without a word.
const FEW_TIMES: usize = 200;

/// Reads the rows of a table that `options` select: a part for each repeat, where rows of one time are repeats.
///
/// # Errors
/// Every problem of the rows, by column: the first place with its fault, a few more lines, and how many follow.
pub(crate) fn collect(
    (table, dosed): (&Table, &[usize]),
    plan: &Plan,
    timed: bool,
    options: &ReadOptions,
) -> Result<Vec<Samples>, Vec<Problem>> {
    let all: Vec<usize> = (0..table.rows()).collect();
    let mut collector = Collector::new((table, dosed), plan, options, timed);
    collector.marks();
    let mut repeats = collector.rows(&all);
    let few = collector.samples.time.len() <= FEW_TIMES;
    if let (Some((time, row)), false) = (repeats.first(), options.replicates || few && plan.inputs.is_empty()) {
        let (column, before) = (plan.time.as_ref().map(|t| t.column), table.line(*row - 1));
        let (time, place) = (time.to_string(), table.place);
        let fault = Fault::NotRising { before: time.clone(), place, line: before, found: time };
        collector.blame(Kind::Time, column, *row, fault);
        repeats[1..].iter().for_each(|(_, row)| collector.blame(Kind::Time, column, *row, Fault::NoTime));
    }
    let mut parts = vec![collector.finish()?];
    while !repeats.is_empty() {
        let mut collector = Collector::new((table, dosed), plan, options, timed);
        let rows: Vec<usize> = repeats.iter().map(|(_, row)| *row).collect();
        repeats = collector.rows(&rows);
        parts.push(collector.finish()?);
    }
    Ok(parts)
}

/// A column of a table as numbers, NaN in gaps, whatever a model wants of it.
///
/// # Errors
/// Every cell that is neither number nor gap.
pub(crate) fn numbers(table: &Table, column: usize) -> Result<(), Vec<Problem>> {
    let (plan, options) = (Plan::default(), ReadOptions::default());
    let mut collector = Collector::new((table, &[]), &plan, &options, false);
    let is_clock = table.is_clock(column);
    for (row, _) in table.columns[column].texts() {
        if table.columns[column].values[row].is_nan() {
            let _ = if is_clock { collector.stamp(column, row) } else { collector.number(column, row) };
        }
    }
    collector.finish().map(drop)
}

struct Collector<'a> {
    table: &'a Table,
    plan: &'a Plan,
    options: &'a ReadOptions,
    timed: bool,
    samples: Samples,
    /// Inputs that are read from amounts of doses, cell by cell of no row.
    dosed: &'a [usize],
    tallies: Vec<Tally>,
    /// Instants between `--from` and `--to`.
    selected: usize,
    /// Time and row of the selected row before, and whether it is a sample.
    before: Option<(f64, usize, bool)>,
}

/// Problems of one kind in one column.
struct Tally {
    key: (Kind, Option<usize>),
    fault: Fault,
    line: usize,
    hint: Option<String>,
    also: Vec<usize>,
    count: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Row,
    Cell,
    Time,
}

impl<'a> Collector<'a> {
    fn new((table, dosed): (&'a Table, &'a [usize]), plan: &'a Plan, options: &'a ReadOptions, timed: bool) -> Self {
        let samples = Samples { unsampled: vec![0; plan.outputs.len()], ..Samples::default() };
        Self { table, plan, options, timed, samples, dosed, tallies: Vec::new(), selected: 0, before: None }
    }

    /// Reads rows; gives those whose time the row before has too, with other values: time and row.
    fn rows(&mut self, rows: &[usize]) -> Vec<(f64, usize)> {
        self.samples.rows = rows.len();
        if rows.len() == self.table.rows() {
            self.samples.rows += self.table.ragged.len();
            for (line, found, hint) in &self.table.ragged {
                let fault = Fault::Ragged { found: *found, expected: self.table.columns.len() };
                self.blame_line(Kind::Row, None, *line, fault, hint.map(String::from));
            }
        }
        rows.iter().filter_map(|row| self.row(*row)).collect()
    }

    /// Gives the time of a row that belongs to another repeat.
    fn row(&mut self, row: usize) -> Option<(f64, usize)> {
        let time = self.time(row)?;
        let span = self.samples.span.get_or_insert((time, time));
        span.1 = time;
        let (from, to) = (self.options.first_read(), self.options.to.unwrap_or(f64::INFINITY));
        if time < from || time > to {
            return None;
        }
        let before = self.before.filter(|_| self.timed);
        if let Some((previous, at, used)) = before.filter(|(previous, ..)| time <= *previous) {
            if time == previous && self.table.columns.iter().all(|c| c.same(at, row)) {
                let line = self.table.line(row);
                self.samples.repeated.get_or_insert((0, line)).0 += 1;
                return None;
            }
            if time == previous {
                self.before = Some((time, row, used));
                return (used && !self.merged(row)).then_some((time, row));
            }
            let column = self.plan.time.as_ref().map(|t| t.column);
            let (place, line) = (self.table.place, self.table.line(at));
            let fault = Fault::NotRising { before: previous.to_string(), place, line, found: time.to_string() };
            self.blame(Kind::Time, column, row, fault);
        }
        let used = self.selected.is_multiple_of(self.options.every);
        self.before = Some((time, row, used));
        self.selected += 1;
        if used {
            self.samples.time.push(time);
            let (inputs, outputs) = self.channels(row);
            self.samples.inputs.extend(inputs);
            self.samples.measured.extend(outputs);
        }
        None
    }

    /// Adds the values of a row to the sample of the same instant, unless it has others.
    fn merged(&mut self, row: usize) -> bool {
        let known = self.samples.limits.len();
        let (inputs, outputs) = self.channels(row);
        let own = |values: &[f64], width: usize| values.len() - width;
        let (i, o) = (own(&self.samples.inputs, inputs.len()), own(&self.samples.measured, outputs.len()));
        let (have, seen) = (&mut self.samples.inputs[i..], &mut self.samples.measured[o..]);
        let differs = |(a, b): (&f64, &f64)| !a.is_nan() && !b.is_nan() && a != b;
        // a limit beside a value, or another limit, is a repeat
        let sample = self.samples.time.len().saturating_sub(1);
        let (before, new) = self.samples.limits.split_at(known);
        let limited = |o: usize| before.iter().any(|(at, output, _)| (*at, *output) == (sample, o));
        let clash = |o: usize| limited(o) && !outputs[o].is_nan() || !seen[o].is_nan() && new.iter().any(|n| n.1 == o);
        let twice = new.iter().any(|(_, o, _)| limited(*o)) || (0..outputs.len()).any(clash);
        if twice || have.iter().zip(&inputs).any(differs) || seen.iter().zip(&outputs).any(differs) {
            self.samples.limits.truncate(known);
            return false;
        }
        let new = have.iter_mut().chain(seen.iter_mut()).zip(inputs.iter().chain(&outputs));
        new.filter(|(own, _)| own.is_nan()).for_each(|(own, value)| *own = *value);
        self.samples.merged += 1;
        true
    }

    /// The time of a row as it stands in the file, or the row's number.
    fn time(&mut self, row: usize) -> Option<f64> {
        let Some(source) = &self.plan.time else { return Some(row as f64) };
        if !self.plan.strict {
            return Some(self.table.columns[source.column].values[row]);
        }
        let value = if source.clock { self.stamp(source.column, row)? } else { self.number(source.column, row)? };
        if value.is_nan() {
            self.blame(Kind::Cell, Some(source.column), row, Fault::NoTime);
            return None;
        }
        Some(value)
    }

    /// The seconds of a date or clock time; `None` when the cell has been blamed.
    fn stamp(&mut self, column: usize, row: usize) -> Option<f64> {
        let own = &self.table.columns[column];
        let value = own.values[row];
        if let Some(text) = own.text(row).filter(|_| value.is_nan()) {
            self.blame(Kind::Cell, Some(column), row, Fault::NotAStamp(excerpt(text)));
            return None;
        }
        Some(value)
    }

    fn channels(&mut self, row: usize) -> (Vec<f64>, Vec<f64>) {
        let plan = self.plan;
        let of =
            |(k, source): (usize, &Source)| if self.dosed.contains(&k) { f64::NAN } else { self.channel(source, row) };
        let inputs = plan.inputs.iter().enumerate().map(of).collect();
        let mut outputs = Vec::with_capacity(plan.outputs.len());
        for (k, source) in plan.outputs.iter().enumerate() {
            let below = source.as_ref().and_then(|s| Some((s, self.below(s, row)?)));
            let value = match (&below, source) {
                (None, Some(source)) => self.channel(source, row),
                _ => f64::NAN,
            };
            if let Some((source, Some(limit))) = below {
                let sample = self.samples.time.len().saturating_sub(1);
                self.samples.limits.push((sample, k, source.convert(limit)));
            }
            outputs.push(value);
            let sampled = |s: &Source| self.table.columns[s.column].sampled.get(row).is_none_or(|sampled| *sampled);
            if source.as_ref().is_some_and(|s| value.is_nan() && !sampled(s)) {
                self.samples.unsampled[k] += 1;
            }
        }
        (inputs, outputs)
    }

    fn channel(&mut self, source: &Source, row: usize) -> f64 {
        let Some(value) = self.number(source.column, row) else { return f64::NAN };
        let converted = source.convert(value);
        if converted.is_nan() && !value.is_nan() {
            self.blame(Kind::Cell, Some(source.column), row, Fault::NotPositive(value.to_string()));
        }
        if converted.is_infinite() {
            self.blame(Kind::Cell, Some(source.column), row, Fault::Infinite(value.to_string()));
        }
        converted
    }

    /// Of a cell of an output that is below a limit, that limit in the unit of the column; none within where the sample is to be left out, or the cell
    /// has been blamed.
    fn below(&mut self, source: &Source, row: usize) -> Option<Option<f64>> {
        let text = self.table.columns[source.column].text(row)?;
        let Cell::Below(stated) = text::scan(text) else { return None };
        let limit = match self.options.below_limit {
            BelowLimit::Missing => return Some(None),
            BelowLimit::Censored => stated,
            BelowLimit::Limit(limit) => stated.or(Some(limit)),
        };
        // turned about it would be above, and a logarithm may have none
        let usable = limit.filter(|limit| source.scale > 0.0 && source.convert(*limit).is_finite());
        if usable.is_none() {
            self.blame(Kind::Cell, Some(source.column), row, Fault::BelowLimit(excerpt(text)));
        }
        Some(usable)
    }

    /// The number in a cell, NaN for a gap; `None` when it has been blamed.
    fn number(&mut self, column: usize, row: usize) -> Option<f64> {
        let own = &self.table.columns[column];
        let value = own.values[row];
        if value.is_infinite() {
            self.blame(Kind::Cell, Some(column), row, Fault::Infinite(value.to_string()));
            return None;
        }
        let Some(text) = own.text(row) else { return Some(value) };
        let fault = match text::scan(text) {
            Cell::Below(_) if self.options.below_limit == BelowLimit::Missing => return Some(f64::NAN),
            Cell::Below(_) => Fault::BelowLimit(excerpt(text)),
            Cell::Infinite => Fault::Infinite(excerpt(text)),
            Cell::Vanishing => Fault::Vanishing(excerpt(text)),
            _ => Fault::NotANumber(excerpt(text)),
        };
        self.blame(Kind::Cell, Some(column), row, fault);
        None
    }

    /// Decimal marks and separated thousands of the columns that are used.
    fn marks(&mut self) {
        let plan = self.plan;
        let time = plan.time.iter().filter(|_| plan.strict);
        let mut used: Vec<usize> =
            time.chain(&plan.inputs).chain(plan.outputs.iter().flatten()).map(|s| s.column).collect();
        used.sort_unstable();
        used.dedup();
        let columns = || used.iter().map(|k| (*k, &self.table.columns[*k]));
        let marked = |c: &Column, k: usize| c.marks[k].as_ref().map(|(row, _)| *row);
        let point = columns().filter_map(|(_, c)| marked(c, 0)).min();
        let comma = columns().filter_map(|(_, c)| marked(c, 1)).min();
        let (expected, first) = match (point, comma) {
            (Some(point), Some(comma)) if comma < point => (Mark::Comma, comma),
            (None, Some(comma)) => (Mark::Comma, comma),
            (Some(point), _) => (Mark::Point, point),
            (None, None) => return,
        };
        self.samples.mark = Some(expected);
        let other = usize::from(expected == Mark::Point);
        let wrong: Vec<(usize, usize, String)> =
            columns().filter_map(|(k, c)| c.marks[other].as_ref().map(|(row, cell)| (k, *row, cell.clone()))).collect();
        for (column, row, cell) in wrong {
            let fault = Fault::MixedMarks { found: excerpt(&cell), mark: expected, line: self.table.line(first) };
            self.blame(Kind::Cell, Some(column), row, fault);
        }
        let commas = self.table.delimiter == Some(Delimiter::Comma);
        if commas && !columns().any(|(_, c)| c.thousands == Thousands::Excluded) {
            let possible = columns().find_map(|(k, c)| match &c.thousands {
                Thousands::Possible(row, cell) => Some((k, *row, cell.clone())),
                _ => None,
            });
            if let Some((column, row, cell)) = possible {
                self.blame(Kind::Cell, Some(column), row, Fault::Thousands(excerpt(&cell)));
            }
        }
    }

    fn blame(&mut self, kind: Kind, column: Option<usize>, row: usize, fault: Fault) {
        let known = self.tallies.iter().any(|t| t.key == (kind, column));
        let hint = if known { None } else { self.hint(&fault, row) };
        self.blame_line(kind, column, self.table.line(row), fault, hint);
    }

    fn blame_line(&mut self, kind: Kind, column: Option<usize>, line: usize, fault: Fault, hint: Option<String>) {
        const NAMED: usize = 3;
        let key = (kind, column);
        match self.tallies.iter_mut().find(|t| t.key == key) {
            Some(tally) => {
                tally.count += 1;
                let (mut line, mut fault) = (line, fault);
                if line < tally.line {
                    std::mem::swap(&mut line, &mut tally.line);
                    std::mem::swap(&mut fault, &mut tally.fault);
                }
                if tally.also.len() < NAMED {
                    tally.also.push(line);
                }
            }
            None => self.tallies.push(Tally { key, fault, line, hint, also: Vec::new(), count: 1 }),
        }
    }

    fn finish(self) -> Result<Samples, Vec<Problem>> {
        let problem = |tally: Tally| {
            let mut problem = tally.fault.at(tally.line);
            problem.place = self.table.place;
            if let Some(column) = tally.key.1 {
                problem = problem.column(&self.table.columns[column].heading.title);
            }
            problem.more = tally.count - 1 - tally.also.len();
            problem.also = tally.also;
            problem.maybe_hint(tally.hint)
        };
        let problems: Vec<_> = self.tallies.into_iter().map(problem).collect();
        if problems.is_empty() { Ok(self.samples) } else { Err(problems) }
    }

    fn hint(&self, fault: &Fault, row: usize) -> Option<String> {
        let hint = match fault {
            Fault::NotANumber(_) if self.table.is_cut(row) => CUT.into(),
            Fault::NotANumber(_) if row == 0 => {
                "if this row holds the units, write them into the header: `name [unit]`".into()
            }
            Fault::NotANumber(text) if text.contains(':') || text.matches('-').count() == 2 => {
                "dates and clock times are read in the column of the time alone".into()
            }
            Fault::NotANumber(text) => {
                format!("leave a cell empty where nothing was measured, or say --missing {text}")
            }
            Fault::BelowLimit(_) => {
                "of an output say the limit in the unit of the column, --below-limit 0.5, or write `<0.5`; \
                 --below-limit missing leaves such samples out, and estimates lean then to what was seen"
                    .into()
            }
            Fault::NotRising { before, found, .. } if before == found => {
                let runs = self.column_of_runs().map_or(String::new(), |by| format!("; --runs-by \"{by}\" for the runs of a table"));
                format!(
                    "say --replicates where rows of one time are repeats, --rate N where the clock is too coarse for samples at an even rate{runs}"
                )
            }
            Fault::NotRising { .. } => match self.column_of_runs() {
                Some(by) => format!("if `{by}` tells several runs apart, say --runs-by \"{by}\"; or choose one with --from and --to"),
                None => "if the file holds several runs, split it, or choose one with --from and --to".into(),
            },
            Fault::Thousands(_) => "write the numbers without separated thousands and with a decimal point".into(),
            Fault::NotPositive(_) => {
                "leave a cell empty, or write NaN, where nothing was found; numbers near zero do not have noise that is a factor".into()
            }
            Fault::Vanishing(_) => "write 0, or take a smaller unit".into(),
            Fault::Infinite(_) => "leave a cell empty, or write NaN, where the measurement failed".into(),
            _ => return None,
        };
        Some(hint)
    }

    /// A column that changes where the time falls or stands still, and nowhere else.
    fn column_of_runs(&self) -> Option<String> {
        let time = &self.table.columns[self.plan.time.as_ref()?.column].values;
        let falls = |k: &usize| time[*k] <= time[*k - 1];
        let used = |k: usize| {
            let sources = self.plan.time.iter().chain(&self.plan.inputs).chain(self.plan.outputs.iter().flatten());
            sources.into_iter().any(|s| s.column == k)
        };
        let tells = |column: &Column| {
            let changes = |k: &usize| !column.same(*k, *k - 1);
            let (mut at_falls, mut elsewhere, mut count) = (0, 0, 0);
            for k in 1..time.len() {
                count += usize::from(falls(&k));
                at_falls += usize::from(falls(&k) && changes(&k));
                elsewhere += usize::from(!falls(&k) && changes(&k));
            }
            at_falls > 0 && elsewhere == 0 && 2 * at_falls >= count
        };
        let columns = self.table.columns.iter().enumerate().filter(|(k, c)| !used(*k) && !c.heading.title.is_empty());
        columns.into_iter().find(|(_, c)| tells(c)).map(|(_, c)| excerpt(&c.heading.title))
    }
}
