//! The selected rows of a table as numbers in the model's units, and everything that is wrong with them.

use super::channel::{Plan, Source};
use super::clock::{self, Axis};
use super::error::{Fault, Problem, excerpt};
use super::options::ReadOptions;
use super::table::{Delimiter, Mark, Numbers, Row, Table};
use super::text::{self, Cell};
use csv::ByteRecord;

/// Selected rows: times as they stand in the file, channels in the model's units, NaN in gaps.
#[derive(Debug, Default)]
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
    /// Times of the first and last row of the file.
    pub(crate) span: Option<(f64, f64)>,
    /// Rows that repeat the row before, and the line of the first.
    pub(crate) repeated: Option<(usize, usize)>,
    /// Decimal mark of the numbers and where it was seen first.
    mark: Option<(Mark, usize)>,
}

impl Samples {
    /// The decimal mark of the file; a point when no number has one.
    pub(crate) fn decimal(&self) -> Mark {
        self.mark.map_or(Mark::Point, |(mark, _)| mark)
    }
}

/// Reads the rows of a table that `options` select.
///
/// # Errors
/// Every problem of the rows, by column: the first place with its fault, a few more lines, and how many follow.
pub(crate) fn collect(table: &Table, plan: &Plan, timed: bool, options: &ReadOptions) -> Result<Samples, Vec<Problem>> {
    let mut collector = Collector {
        table,
        plan,
        options,
        timed,
        samples: Samples::default(),
        tallies: Vec::new(),
        selected: 0,
        before: None,
        thousands: Thousands::NotSeen,
        axis: Axis::default(),
    };
    if let Some(numbers) = &table.numbers {
        for k in 0..numbers.rows() {
            // in a table without lines the offset of a row is its number
            let row = Row { start: k, end: k };
            collector.row(row, Cells::Numbers(numbers, k), false);
        }
        return collector.finish();
    }
    let (mut rows, mut record, mut previous) = (table.rows(), ByteRecord::new(), ByteRecord::new());
    while let Some(row) = rows.read(&mut record).map_err(|p| vec![p])? {
        collector.row(row, Cells::Text(&record), record == previous);
        std::mem::swap(&mut record, &mut previous);
    }
    collector.finish()
}

/// Columns of a text as numbers, NaN in gaps, whatever a model wants of them; those of `clock` are dates or clock times.
///
/// # Errors
/// Every cell that is neither number nor gap.
pub(crate) fn numbers(table: &Table, columns: &[usize], clock: Option<usize>) -> Result<Vec<Vec<f64>>, Vec<Problem>> {
    let plan = Plan { time: None, strict: false, inputs: Vec::new(), outputs: Vec::new() };
    let options = ReadOptions::default();
    let mut collector = Collector {
        table,
        plan: &plan,
        options: &options,
        timed: false,
        samples: Samples::default(),
        tallies: Vec::new(),
        selected: 0,
        before: None,
        thousands: Thousands::NotSeen,
        axis: Axis::default(),
    };
    let mut found: Vec<Vec<f64>> = columns.iter().map(|_| Vec::new()).collect();
    let (mut rows, mut record) = (table.rows(), ByteRecord::new());
    while let Some(row) = rows.read(&mut record).map_err(|p| vec![p])? {
        let cells = Cells::Text(&record);
        if collector.is_ragged(row, cells) {
            continue;
        }
        for (column, values) in columns.iter().zip(&mut found) {
            let value = if clock == Some(*column) {
                collector.stamp(*column, row, cells)
            } else {
                collector.number(*column, row, cells)
            };
            values.push(value.unwrap_or(f64::NAN));
        }
    }
    collector.finish().map(|_| found)
}

/// One row of a table.
#[derive(Clone, Copy)]
enum Cells<'a> {
    Text(&'a ByteRecord),
    Numbers(&'a Numbers, usize),
}

struct Collector<'a> {
    table: &'a Table,
    plan: &'a Plan,
    options: &'a ReadOptions,
    timed: bool,
    samples: Samples,
    tallies: Vec<Tally>,
    /// Rows between `--from` and `--to`.
    selected: usize,
    /// Time and place of the selected row before.
    before: Option<(f64, usize)>,
    thousands: Thousands,
    /// The axis of dates and clock times.
    axis: Axis,
}

/// Whether decimal commas can be told from separated thousands in a file with commas between its cells.
enum Thousands {
    NotSeen,
    /// Every comma may be either; the first is here.
    Possible(Row, usize, String),
    Excluded,
}

/// Problems of one kind in one column.
struct Tally {
    key: (Kind, Option<usize>),
    fault: Fault,
    row: Row,
    also: Vec<usize>,
    count: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Row,
    Cell,
    Time,
}

impl Collector<'_> {
    /// Whether a row has more or fewer cells than the header, and is blamed for it.
    fn is_ragged(&mut self, row: Row, cells: Cells<'_>) -> bool {
        let Cells::Text(record) = cells else { return false };
        let width = self.table.columns.len();
        let longer = record.len() > width && record.iter().skip(width).any(|c| !c.trim_ascii().is_empty());
        let ragged = record.len() < width || longer;
        if ragged {
            self.blame(Kind::Row, None, row, Fault::Ragged { found: record.len(), expected: width });
        }
        ragged
    }

    /// `same` says whether the row repeats the one before to the letter.
    fn row(&mut self, row: Row, record: Cells<'_>, same: bool) {
        let number = self.samples.rows;
        self.samples.rows += 1;
        if self.is_ragged(row, record) {
            return;
        }
        let Some(time) = self.time(row, record, number) else { return };
        let span = self.samples.span.get_or_insert((time, time));
        span.1 = time;
        let (from, to) = (self.options.first_read(), self.options.to.unwrap_or(f64::INFINITY));
        if time < from || time > to || !self.follows(time, row, same) {
            return;
        }
        let used = self.selected.is_multiple_of(self.options.every);
        self.selected += 1;
        if used {
            self.samples.time.push(time);
            self.channels(row, record);
        }
    }

    /// The time of a row as it stands in the file, or the row's number.
    fn time(&mut self, row: Row, record: Cells<'_>, number: usize) -> Option<f64> {
        let Some(source) = &self.plan.time else { return Some(number as f64) };
        if !self.plan.strict {
            return Some(match record {
                Cells::Numbers(numbers, k) => numbers.columns[source.column][k],
                Cells::Text(record) => {
                    let text = record.get(source.column).and_then(|c| str::from_utf8(c).ok()).unwrap_or("");
                    if let Cell::Number(value, _) = text::scan(text) { value } else { f64::NAN }
                }
            });
        }
        let value = if source.clock {
            self.stamp(source.column, row, record)?
        } else {
            self.number(source.column, row, record)?
        };
        if value.is_nan() {
            self.blame(Kind::Cell, Some(source.column), row, Fault::NoTime);
            return None;
        }
        Some(value)
    }

    /// Whether the row is a new sample: later than the one before, and not the same row once more.
    fn follows(&mut self, time: f64, row: Row, same: bool) -> bool {
        if !self.timed {
            return true;
        }
        let (previous, place) = self.before.replace((time, row.start)).unwrap_or((f64::NEG_INFINITY, 0));
        if time > previous {
            return true;
        }
        if time == previous && same {
            let table = self.table;
            self.samples.repeated.get_or_insert_with(|| (0, table.line(row.start))).0 += 1;
            return false;
        }
        let column = self.plan.time.as_ref().map(|t| t.column);
        let line = if self.is_blamed(Kind::Time, column) { 0 } else { self.table.line(place) };
        let place = self.table.place();
        let fault = Fault::NotRising { before: previous.to_string(), place, line, found: time.to_string() };
        self.blame(Kind::Time, column, row, fault);
        true
    }

    /// The seconds of a date or clock time; `None` when the cell has been blamed.
    fn stamp(&mut self, column: usize, row: Row, record: Cells<'_>) -> Option<f64> {
        let Cells::Text(cells) = record else { return self.number(column, row, record) };
        let text = cells.get(column).and_then(|c| str::from_utf8(c).ok()).unwrap_or("");
        if text.trim().is_empty() {
            return Some(f64::NAN);
        }
        let Some(stamp) = clock::stamp(text) else {
            self.blame(Kind::Cell, Some(column), row, Fault::NotAStamp(excerpt(text)));
            return None;
        };
        Some(self.axis.seconds(stamp))
    }

    fn channels(&mut self, row: Row, record: Cells<'_>) {
        let plan = self.plan;
        for source in &plan.inputs {
            let value = self.channel(source, row, record);
            self.samples.inputs.push(value);
        }
        self.samples.unsampled.resize(plan.outputs.len(), 0);
        for (k, source) in plan.outputs.iter().enumerate() {
            let value = source.as_ref().map_or(f64::NAN, |s| self.channel(s, row, record));
            self.samples.measured.push(value);
            if let (Cells::Numbers(numbers, at), Some(s)) = (record, source)
                && value.is_nan()
                && !numbers.is_sampled(s.column, at)
            {
                self.samples.unsampled[k] += 1;
            }
        }
    }

    fn channel(&mut self, source: &Source, row: Row, record: Cells<'_>) -> f64 {
        let Some(value) = self.number(source.column, row, record) else { return f64::NAN };
        let converted = source.convert(value);
        if converted.is_nan() && !value.is_nan() {
            self.blame(Kind::Cell, Some(source.column), row, Fault::NotPositive(value.to_string()));
        }
        if converted.is_infinite() {
            self.blame(Kind::Cell, Some(source.column), row, Fault::Infinite(value.to_string()));
        }
        converted
    }

    /// The number in a cell, NaN for a gap; `None` when it has been blamed.
    fn number(&mut self, column: usize, row: Row, record: Cells<'_>) -> Option<f64> {
        let record = match record {
            Cells::Text(record) => record,
            Cells::Numbers(numbers, k) => {
                let value = numbers.columns[column][k];
                if value.is_infinite() {
                    self.blame(Kind::Cell, Some(column), row, Fault::Infinite(value.to_string()));
                    return None;
                }
                return Some(value);
            }
        };
        let text = record.get(column).and_then(|c| str::from_utf8(c).ok()).unwrap_or("");
        let (value, mark) = match text::scan(text) {
            Cell::Gap => return Some(f64::NAN),
            Cell::Number(value, mark) => (value, mark),
            Cell::Infinite => {
                self.blame(Kind::Cell, Some(column), row, Fault::Infinite(excerpt(text)));
                return None;
            }
            Cell::Vanishing => {
                self.blame(Kind::Cell, Some(column), row, Fault::Vanishing(excerpt(text)));
                return None;
            }
            Cell::Text => {
                self.blame(Kind::Cell, Some(column), row, Fault::NotANumber(excerpt(text)));
                return None;
            }
        };
        let Some(mark) = mark else { return Some(value) };
        let (expected, place) = *self.samples.mark.get_or_insert((mark, row.start));
        if mark != expected {
            let line = if self.is_blamed(Kind::Cell, Some(column)) { 0 } else { self.table.line(place) };
            self.blame(Kind::Cell, Some(column), row, Fault::MixedMarks { found: excerpt(text), mark: expected, line });
            return None;
        }
        if mark == Mark::Comma {
            self.suspect(text, column, row);
        }
        Some(value)
    }

    /// Between commas that separate cells, `"1,234"` is a decimal comma to some and thousands to others.
    fn suspect(&mut self, text: &str, column: usize, row: Row) {
        if self.table.delimiter != Delimiter::Comma || matches!(self.thousands, Thousands::Excluded) {
            return;
        }
        if !text::may_be_thousands(text) {
            self.thousands = Thousands::Excluded;
        } else if matches!(self.thousands, Thousands::NotSeen) {
            self.thousands = Thousands::Possible(row, column, excerpt(text));
        }
    }

    /// Whether a fault of this kind has been kept: of later ones only the place is shown.
    fn is_blamed(&self, kind: Kind, column: Option<usize>) -> bool {
        self.tallies.iter().any(|t| t.key == (kind, column))
    }

    fn blame(&mut self, kind: Kind, column: Option<usize>, row: Row, fault: Fault) {
        const NAMED: usize = 3;
        let key = (kind, column);
        match self.tallies.iter_mut().find(|t| t.key == key) {
            Some(tally) => {
                tally.count += 1;
                if tally.also.len() < NAMED {
                    tally.also.push(row.start);
                }
            }
            None => self.tallies.push(Tally { key, fault, row, also: Vec::new(), count: 1 }),
        }
    }

    fn finish(mut self) -> Result<Samples, Vec<Problem>> {
        if let Thousands::Possible(row, column, text) = std::mem::replace(&mut self.thousands, Thousands::Excluded) {
            self.blame(Kind::Cell, Some(column), row, Fault::Thousands(text));
        }
        let problems: Vec<_> = self.tallies.iter().map(|t| self.problem(t)).collect();
        if problems.is_empty() { Ok(self.samples) } else { Err(problems) }
    }

    fn problem(&self, tally: &Tally) -> Problem {
        let mut problem = tally.fault.clone().at(self.table.line(tally.row.start));
        problem.place = self.table.place();
        if let Some(column) = tally.key.1 {
            problem = problem.column(&self.table.columns[column].title);
        }
        problem.also = tally.also.iter().map(|start| self.table.line(*start)).collect();
        problem.more = tally.count - 1 - tally.also.len();
        problem.maybe_hint(self.hint(tally))
    }

    fn hint(&self, tally: &Tally) -> Option<String> {
        let hint = match &tally.fault {
            Fault::Ragged { .. } if self.table.line(tally.row.end) > self.table.line(tally.row.start) + 1 => {
                "a quote that opens in this line is not closed in it"
            }
            Fault::Ragged { .. } | Fault::NotANumber(_) if self.table.is_cut(tally.row.end) => {
                "the file ends here without a line end; it may have been cut off"
            }
            Fault::NotANumber(_) if self.table.first_row() == Some(tally.row.start) => {
                "if this row holds the units, write them into the header: `name [unit]`"
            }
            Fault::NotANumber(text) if text.contains(':') || text.matches('-').count() == 2 => {
                "dates and clock times are read in the column of the time alone"
            }
            Fault::NotANumber(_) => "leave a cell empty, or write NaN, where nothing was measured",
            Fault::NotRising { before, found, .. } if before == found => {
                "write the time with more digits, or remove one of the rows"
            }
            Fault::NotRising { .. } => "if the file holds several runs, split it, or choose one with --from and --to",
            Fault::Thousands(_) => "write the numbers without separated thousands and with a decimal point",
            Fault::NotPositive(_) => {
                "leave a cell empty, or write NaN, where nothing was found; numbers near zero do not have noise that is a factor"
            }
            Fault::Vanishing(_) => "write 0, or take a smaller unit",
            Fault::Infinite(_) => "leave a cell empty, or write NaN, where the measurement failed",
            _ => return None,
        };
        Some(hint.into())
    }
}
