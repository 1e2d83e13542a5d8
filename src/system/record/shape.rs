//! Tables that do not stand as others do: signals in rows, one value a row with its name, dates and clock times in two columns, many runs in one
//! table.

use super::clock::{DAY, Stamps};
use super::column::Column;
use super::grid::Rows;
use super::heading::Heading;
use super::layout::Layout;
use super::note::Note;
use super::table::Table;
use super::text;
use csv::ByteRecord;
use std::collections::HashMap;

/// Rows of a table whose rows are signals, at most.
const SIGNALS: usize = 64;
/// How much wider than high such a table is.
const WIDER: usize = 8;

/// A table far wider than high is read by rows.
pub(crate) fn lying(text: &str, layout: &Layout) -> Option<Table> {
    let rows = text.lines().filter(|l| !l.trim().is_empty()).count();
    if rows == 0 || rows > SIGNALS || layout.width < 2 * WIDER {
        return None;
    }
    let (mut reader, mut record) = (Rows::new(text, 0, layout.delimiter), ByteRecord::new());
    let mut signals: Vec<Vec<String>> = Vec::new();
    while let Ok(Some(row)) = reader.read(&mut record) {
        let cells: Vec<String> = record.iter().map(|c| String::from_utf8_lossy(c).trim().to_string()).collect();
        if cells.len() + 1 >= layout.width && row.line >= layout.first_line.min(layout.header_line) {
            signals.push(cells);
        }
    }
    let width = signals.iter().map(Vec::len).max().filter(|w| *w >= WIDER * signals.len())?;
    let is_name = |cell: &String| text::scan(cell) == text::Cell::Text;
    let named = signals.iter().all(|s| s.first().is_some_and(is_name));
    // names of columns above: then the rows are rows
    if !named && !layout.headings.is_empty() {
        return None;
    }
    let numbers = |s: &Vec<String>| s.iter().skip(1).filter(|c| text::is_number(c)).count();
    if signals.is_empty() || signals.iter().any(|s| 2 * numbers(s) < width) {
        return None;
    }
    let columns = signals.iter().enumerate().map(|(k, cells)| {
        let title = if named { cells[0].clone() } else { format!("#{}", k + 1) };
        let padded = (usize::from(named)..width).map(|k| cells.get(k).map_or("", String::as_str));
        Column::of_cells(Heading::new(&title), padded)
    });
    let mut table = Table::of_columns("text", columns.collect());
    let unnamed = if named { "" } else { "; they have no names and are called `#1`, `#2`, .." };
    table.notes.push(Note::Layout(format!("each of the {} rows is a signal{unnamed}", signals.len())));
    table.delimiter = Some(layout.delimiter);
    table.unnamed = !named;
    Some(table)
}

/// What the columns of names and of values are called in tables of one value a row.
const NAMES: [&str; 18] = [
    "name",
    "signal",
    "channel",
    "variable",
    "field",
    "_field",
    "topic",
    "key",
    "measurement",
    "parameter",
    "tag",
    "sensor",
    "analyte",
    "observable",
    "observableid",
    "quantity",
    "entry",
    "signal_name",
];
const VALUES: [&str; 9] = ["value", "_value", "val", "data", "reading", "result", "measured", "observation", "amount"];

/// A table of times, names and values becomes one with a column for each name: where its columns are called so, or where names that are `wanted`, and
/// are no columns, stand in a column of texts beside one of values.
pub(crate) fn long(table: Table, wanted: &[&str]) -> Table {
    /// Names that are channels, at most.
    const CHANNELS: usize = 2000;
    let called = |k: usize, known: &[&str]| {
        let lower = table.columns[k].heading.name.to_lowercase();
        known.contains(&lower.as_str()) || lower.ends_with(known[0])
    };
    let time = match super::times::found(&table, &|_| true) {
        Ok(Some(time)) => time,
        _ => match super::times::called_times(&table).first() {
            Some((_, time)) => *time,
            None => return table,
        },
    };
    let all = || (0..table.columns.len()).filter(|k| *k != time);
    let is_text = |k: &usize| {
        !table.columns[*k].has_numbers() && table.columns[*k].stamps.is_none() && !table.columns[*k].labels().is_empty()
    };
    let is_there = |name: &str| table.headings().any(|h| h.is(name));
    let holds = |k: &usize| wanted.iter().any(|w| !is_there(w) && table.columns[*k].labels().iter().any(|l| l == w));
    let names = all().filter(is_text).find(|k| called(*k, &NAMES) || holds(k));
    let numbers: Vec<usize> = all().filter(|k| table.columns[*k].has_numbers()).collect();
    let values = numbers.iter().copied().find(|k| called(*k, &VALUES));
    let only = || match numbers[..] {
        [one] if names.is_some_and(|k| holds(&k)) => Some(one),
        _ => None,
    };
    let (Some(names), Some(values)) = (names, values.or_else(only)) else { return table };
    let labels = table.columns[names].labels();
    if labels.len() > CHANNELS || table.rows() < 2 {
        return table;
    }
    // an instant has a row for each of its names; a name that comes again at it begins a row
    let stamps = &table.columns[time].values;
    let mut rows: Vec<(f64, usize)> = Vec::new();
    let mut last: HashMap<(u64, &str), usize> = HashMap::new();
    let mut cells: Vec<Vec<(usize, f64)>> = vec![Vec::new(); labels.len()];
    let mut instants: HashMap<u64, Vec<usize>> = HashMap::new();
    for (row, label) in table.columns[names].texts() {
        let (t, value) = (stamps[row], table.columns[values].values[row]);
        if t.is_nan() || value.is_nan() {
            continue;
        }
        let index = labels.iter().position(|l| l == label).unwrap_or_default();
        let repeat = last.entry((t.to_bits(), label)).or_insert(0);
        let own = instants.entry(t.to_bits()).or_default();
        if own.len() <= *repeat {
            rows.push((t, row));
            own.push(rows.len() - 1);
        }
        cells[index].push((own[*repeat], value));
        *repeat += 1;
    }
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by(|a, b| rows[*a].0.total_cmp(&rows[*b].0).then(a.cmp(b)));
    let mut place_of = vec![0; rows.len()];
    order.iter().enumerate().for_each(|(new, old)| place_of[*old] = new);
    let unit_column = table.columns.iter().find(|c| matches!(c.heading.name.to_lowercase().as_str(), "unit" | "units"));
    let picked: Vec<usize> = order.iter().map(|k| rows[*k].1).collect();
    let mut columns = vec![table.columns[time].rows(&picked)];
    for (label, own) in labels.iter().zip(cells).filter(|(_, own)| !own.is_empty()) {
        let mut values = vec![f64::NAN; rows.len()];
        own.iter().for_each(|(row, value)| values[place_of[*row]] = *value);
        let row = table.columns[names].texts().find(|(_, l)| *l == label).map_or(0, |(row, _)| row);
        let heading = Heading::new(label).with_unit(unit_column.and_then(|c| c.text(row)).unwrap_or_default());
        columns.push(Column::of_numbers(heading, values));
    }
    let said = format!(
        "each row holds one value: the {} names of column `{}` are columns",
        columns.len() - 1,
        table.columns[names].heading.title
    );
    let lines =
        if table.lines.is_empty() { Vec::new() } else { order.iter().map(|k| table.lines[rows[*k].1]).collect() };
    let mut notes = table.notes;
    notes.push(Note::Layout(said));
    Table { columns, lines, notes, ..table }
}

/// Clock times beside dates in a column of their own: both together are the time.
pub(crate) fn dated(table: &mut Table) {
    let of = |wanted: Stamps| {
        let mut found = (0..table.columns.len()).filter(|k| table.columns[*k].stamps == Some(wanted));
        (found.next(), found.next())
    };
    let ((Some(date), None), (Some(clock), None)) = (of(Stamps::Dates), of(Stamps::Clock)) else { return };
    let days = table.columns[date].values.clone();
    if days.windows(2).all(|w| w[0] == w[1]) {
        return;
    }
    let clock = &mut table.columns[clock];
    clock.values.iter_mut().zip(&days).for_each(|(t, day)| *t = t.rem_euclid(DAY) + day);
    clock.stamps = Some(Stamps::Both);
    let said =
        format!("the dates of column `{}` belong to `{}`", table.columns[date].heading.title, clock_title(table));
    table.notes.push(Note::Layout(said));
}

fn clock_title(table: &Table) -> &str {
    let both = table.columns.iter().find(|c| c.stamps == Some(Stamps::Both));
    both.map_or("", |c| c.heading.title.as_str())
}

/// Milliseconds in a column of their own beside clock times of whole seconds: both together are the time.
pub(crate) fn split_seconds(table: &mut Table) {
    let mut clocks = (0..table.columns.len()).filter(|k| table.columns[*k].stamps.is_some_and(|s| s != Stamps::Dates));
    let (Some(clock), None) = (clocks.next(), clocks.next()) else { return };
    let is = |c: &Column| {
        let named = ["ms", "msec", "millis", "millisec", "millisecond", "milliseconds"];
        let part = |v: &f64| (0.0..1000.0).contains(v) && v.fract() == 0.0;
        named.contains(&c.heading.name.to_lowercase().as_str()) && c.stamps.is_none() && c.values.iter().all(part)
    };
    let Some(part) = table.columns.iter().position(is) else { return };
    let whole = &table.columns[clock].values;
    let both: Vec<f64> = whole.iter().zip(&table.columns[part].values).map(|(s, ms)| s + ms / 1000.0).collect();
    // where they are, the clock alone stands still and both together do not
    let rises = |v: &[f64]| v.windows(2).all(|w| w[0] < w[1]);
    if whole.iter().any(|s| s.fract() != 0.0) || rises(whole) || !rises(&both) {
        return;
    }
    let (parts, title) = (table.columns[part].heading.title.clone(), table.columns[clock].heading.title.clone());
    table.columns[clock].values = both;
    table.notes.push(Note::Layout(format!("column `{parts}` holds the milliseconds of `{title}`")));
}

/// Rows above a table without names that hold one number each, the start since 1970 and the rate of sampling in hertz: both are said of the table.
pub(crate) fn begun(table: &mut Table) {
    let one = |row: usize| {
        let first = table.columns.first()?.values.get(row).copied()?;
        table.columns.iter().all(|c| c.values[row] == first).then_some(first)
    };
    let ours = |v: f64| (super::times::OUR_TIME.0..super::times::OUR_TIME.1).contains(&v);
    let (Some(start), Some(rate)) = (one(0), one(1)) else { return };
    let below = |c: &Column| c.values.iter().skip(1).any(|v| ours(*v));
    if !table.unnamed || !ours(start) || rate <= 0.0 || table.rows() < 4 || table.columns.iter().any(below) {
        return;
    }
    let rows: Vec<usize> = (2..table.rows()).collect();
    let mut part = table.part(&rows);
    part.about.push(("sample rate".into(), rate.to_string()));
    part.notes.push(Note::Layout(format!("the first two rows are the start, {start} s since 1970, and the rate")));
    *table = part;
}

/// Rows whose cells are all `name:value`, with the same names: these, and the text without them.
pub(crate) fn labelled(text: &str) -> Option<(Vec<String>, String)> {
    let mark = [',', ';', '\t'].into_iter().find(|m| text.contains(*m)).unwrap_or(' ');
    let names = |line: &str| -> Option<Vec<String>> {
        let name = |cell: &str| {
            let (name, value) = cell.trim().split_once(':')?;
            let word = name.starts_with(|c: char| c.is_alphabetic()) && text::is_number(value);
            word.then(|| name.trim().to_string())
        };
        line.trim().split(mark).filter(|c| !c.trim().is_empty()).map(name).collect()
    };
    let mut lines = text.lines().filter(|l| !l.trim().is_empty());
    let first = names(lines.next()?).filter(|n| n.len() > 1)?;
    if !lines.all(|line| names(line).as_ref() == Some(&first)) {
        return None;
    }
    let value = |cell: &str| cell.split_once(':').map_or(cell, |(_, value)| value).to_string();
    let plain = |line: &str| line.split(mark).map(value).collect::<Vec<_>>().join(&mark.to_string());
    Some((first, text.split_inclusive('\n').map(plain).collect()))
}

/// Clock times that are written as numbers, `hhmmss.s`: told where a minute ends, for there the numbers leap and the times do not. Within a minute
/// both readings are the same.
pub(crate) fn packed(table: &mut Table) {
    let seconds = |v: f64| (v / 1e4).floor() * 3600.0 + (v / 100.0).floor() % 100.0 * 60.0 + v % 100.0;
    let valid = |v: &f64| (0.0..24e4).contains(v) && v % 100.0 < 60.0 && (v / 100.0).floor() % 100.0 < 60.0;
    for (_, k) in super::times::called_times(table) {
        let column = &mut table.columns[k];
        let written = &column.values;
        if column.heading.unit.is_some() || column.stamps.is_some() || written.len() < 2 || !written.iter().all(valid) {
            continue;
        }
        let times: Vec<f64> = written.iter().map(|v| seconds(*v)).collect();
        let steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
        let longest = steps.iter().copied().fold(0.0, f64::max);
        let leaps =
            written.windows(2).zip(&steps).any(|(w, step)| w[1] - w[0] > step + 39.0 && w[1] - w[0] > 2.0 * longest);
        if leaps && steps.iter().all(|s| *s >= 0.0) {
            (column.values, column.heading.unit) = (times, Some("s".into()));
            let said = format!("the numbers of column `{}` are clock times, hhmmss", column.heading.title);
            table.notes.push(Note::Layout(said));
        }
    }
}

/// The rows of each run, where a column says the run: its name, and the rows (by index).
pub(crate) fn runs_by(table: &Table, column: usize) -> Vec<(String, Vec<usize>)> {
    let own = &table.columns[column];
    let mut runs: Vec<(String, Vec<usize>)> = Vec::new();
    let mut places: HashMap<String, usize> = HashMap::new();
    for row in 0..table.rows() {
        let name = match own.text(row) {
            Some(text) => text.to_string(),
            None if own.values[row].is_nan() => continue,
            None => own.values[row].to_string(),
        };
        let at = *places.entry(name.clone()).or_insert_with(|| {
            runs.push((name, Vec::new()));
            runs.len() - 1
        });
        runs[at].1.push(row);
    }
    runs
}
