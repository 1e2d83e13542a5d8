//! Which column of a table holds the times, and in what unit: by its title, by its name, by its size where it counts from 1970.

use super::clock::Question;
use super::column::Column;
use super::error::{Fault, Problem};
use super::heading::{Heading, counts_rows, time_name};
use super::note::Note;
use super::table::Table;
use fdm_grammar::Unit;

/// Units of time that times are kept in, and their sizes in seconds.
const UNITS: [(&str, f64); 7] =
    [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0), ("h", 3600.0), ("d", 86_400.0)];

/// Seconds from 1970 to 2000 and to 2100: records of our time lie between, in whatever unit they count.
pub(crate) const OUR_TIME: (f64, f64) = (9.4e8, 4.1e9);

/// What is known of the unit of a column of times.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TimeUnit {
    /// The unit, where it is known.
    pub(crate) unit: Option<String>,
    /// What told it, where that is not a unit in the file.
    pub(crate) note: Option<Note>,
}

/// A unit of time, as it is kept.
fn kept(text: &str) -> Option<&'static str> {
    let unit = Unit::spelled(text).ok()?.unit;
    let is = |size: f64| (unit.factor - size).abs() <= 1e-9 * size;
    unit.same_dimension(&Unit::second()).then_some(())?;
    UNITS.iter().find(|(_, size)| is(*size)).map(|(name, _)| *name)
}

/// The unit of a column of times, by all that the file says.
pub(crate) fn unit_of(table: &Table, column: usize) -> TimeUnit {
    let own = &table.columns[column];
    let heading = &own.heading;
    let title = heading.title.clone();
    if own.stamps.is_some() {
        let note = Note::Clock { column: title, two: own.question.filter(|q| *q != Question::Order) };
        return TimeUnit { unit: Some("s".into()), note: Some(note) };
    }
    if let Some(unit) = &heading.unit {
        return TimeUnit { unit: Some(kept(unit).map_or(unit.clone(), String::from)), note: None };
    }
    let names = [Some(&heading.name), heading.alias.as_ref()];
    if let Some(unit) = names.into_iter().flatten().find_map(|name| time_name(name)?.unit) {
        let note = Note::TimeUnit { column: title, unit: unit.into(), since: false };
        return TimeUnit { unit: Some(unit.into()), note: Some(note) };
    }
    let Some(unit) = since_1970(own) else { return TimeUnit { unit: None, note: None } };
    let note = Note::TimeUnit { column: title, unit: unit.into(), since: true };
    TimeUnit { unit: Some(unit.into()), note: Some(note).filter(|_| unit != "s") }
}

/// The unit in which times count from 1970, where they are as large as such times are.
fn since_1970(column: &Column) -> Option<&'static str> {
    let mut values = column.values.iter().filter(|v| !v.is_nan());
    let (first, last) = (values.next()?, values.next_back()?);
    let (from, to) = OUR_TIME;
    let ours = |size: f64| (from..to).contains(&(first * size)) && (from..to).contains(&(last * size));
    UNITS.iter().take(4).find(|(_, size)| ours(*size)).map(|(unit, _)| *unit)
}

/// The columns that are called as times are, whatever they hold.
pub(crate) fn called_so(table: &Table) -> impl Iterator<Item = usize> {
    let is = |k: &usize| time_name(&table.columns[*k].heading.name).is_some_and(|t| t.rank < 3);
    (0..table.columns.len()).filter(is)
}

/// Columns that are called as times are, the best name first; of a unit that is none of time no column is. With each how well it is known: names below
/// 3 are those of times, and a name such as `time_ms` says its unit.
pub(crate) fn called_times(table: &Table) -> Vec<(usize, usize)> {
    let is_time_unit = |unit: &str| Unit::spelled(unit).is_ok_and(|u| u.unit.same_dimension(&Unit::second()));
    let mut found: Vec<(usize, usize)> = Vec::new();
    for (k, column) in table.columns.iter().enumerate() {
        let heading = &column.heading;
        let fits = heading.unit.as_deref().is_none_or(is_time_unit);
        let names = [Some(&heading.name), heading.alias.as_ref()].into_iter().flatten();
        let rank = names.filter_map(|name| time_name(name)).map(|t| t.rank).min();
        if let Some(rank) = rank.filter(|_| fits && (column.has_numbers() || column.filled() == 0)) {
            found.push((rank, k));
        }
    }
    found.sort_unstable();
    found
}

/// The only column that holds the times by its name and unit, or by what stands in it.
///
/// # Errors
/// Several of the same name.
pub(crate) fn found(table: &Table, may_be: &dyn Fn(&Heading) -> bool) -> Result<Option<usize>, Problem> {
    let mut named: Vec<(usize, usize)> =
        called_times(table).into_iter().filter(|(_, k)| may_be(&table.columns[*k].heading)).collect();
    // a temperature may be called `T`: what advances goes before a name
    if named.iter().any(|(_, k)| advances(&table.columns[*k])) {
        named.retain(|(_, k)| advances(&table.columns[*k]));
    }
    // what is only like a time needs a unit beside its name
    let known = |(rank, k): &&(usize, usize)| *rank < 3 || unit_of(table, *k).unit.is_some();
    if let Some((rank, column)) = named.iter().find(known) {
        let same: Vec<usize> = named.iter().filter(|c| known(c)).filter(|(r, _)| r == rank).map(|(_, k)| *k).collect();
        let clear = same.len() == 1 || *rank >= 3;
        if same.len() > 1 && *rank < 3 {
            let name = table.columns[*column].heading.name.clone();
            let problem = table.in_header(Fault::Ambiguous { name, count: same.len() });
            return Err(problem.hint(
                "say --map t=TITLE with a title that only one of them has, or --map t=#N with the number of its column",
            ));
        }
        if clear && (same.len() == 1 || *rank < 3) {
            return Ok(Some(*column));
        }
        return Ok(None);
    }
    // what is measured in units of time and rises is the time, where there is one such column
    let second = Unit::second();
    let in_time = |h: &Heading| {
        h.unit.as_deref().and_then(|u| Unit::spelled(u).ok()).is_some_and(|u| u.unit.same_dimension(&second))
    };
    let rises = |c: &Column| c.values.len() > 1 && c.values.windows(2).all(|w| w[0] < w[1]);
    let mut measured = (0..table.columns.len()).filter(|k| {
        let column = &table.columns[*k];
        column.stamps.is_none() && in_time(&column.heading) && rises(column) && may_be(&column.heading)
    });
    if let (Some(one), None) = (measured.next(), measured.next()) {
        return Ok(Some(one));
    }
    // dates and clock times can be nothing else; a date goes last
    let clocks = |dates: bool| -> Vec<usize> {
        let is = |k: &usize| {
            let column = &table.columns[*k];
            column.stamps.is_some_and(|s| (s == super::clock::Stamps::Dates) == dates) && may_be(&column.heading)
        };
        (0..table.columns.len()).filter(is).collect()
    };
    let (times, dates) = (clocks(false), clocks(true));
    Ok(match (&times[..], &dates[..]) {
        ([one], _) => Some(*one),
        ([], [one]) => Some(*one),
        _ => None,
    })
}

/// Whether the values of a column rise, but for one step in five: those of several runs fall between them.
fn advances(column: &Column) -> bool {
    let count = |is: fn(f64) -> bool| column.values.windows(2).filter(|w| is(w[1] - w[0])).count();
    let (up, down) = (count(|step| step > 0.0), count(|step| step < 0.0));
    up > 4 * down
}

/// Whether a column counts rows and measures no time: by its name, and by steps of one.
pub(crate) fn counts(column: &Column) -> bool {
    let steps = column.values.windows(2).all(|w| w[1] - w[0] == 1.0);
    counts_rows(&column.heading.name) && column.heading.unit.is_none() && steps
}

/// Why the numbers of a column cannot be taken for times in the unit of a model: nothing says their unit, and their steps are those of clocks that
/// count parts of a second.
pub(crate) fn doubtful(column: &Column) -> Option<f64> {
    /// Steps in seconds are rarely longer; clocks in milliseconds and microseconds take steps of ten and more.
    const LONG: f64 = 50.0;
    let rank = time_name(&column.heading.name).map_or(usize::MAX, |t| t.rank);
    let whole = column.values.iter().all(|v| v.is_nan() || v.fract() == 0.0);
    let mut steps: Vec<f64> = column.values.windows(2).map(|w| w[1] - w[0]).filter(|s| *s > 0.0).collect();
    if rank < 3 || !whole || steps.is_empty() {
        return None;
    }
    let middle = steps.len() / 2;
    let median = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    (median >= LONG).then_some(median)
}

/// The rate of sampling in what a file says above its table, in samples per second.
pub(crate) fn rate_above(table: &Table) -> Option<f64> {
    let named = |name: &str| {
        let lower = name.to_lowercase();
        ["sample rate", "sampling rate", "sample_rate", "sampling frequency", "samplerate", "fs", "rate"]
            .contains(&lower.trim())
    };
    let (_, value) = table.about.iter().find(|(name, _)| named(name))?;
    let mut words = value.split_whitespace();
    let number: f64 = words.next()?.parse().ok()?;
    let hertz = words.next().is_none_or(|unit| unit.eq_ignore_ascii_case("hz"));
    (number > 0.0 && hertz).then_some(number)
}

/// The table with the times of rows that come at an even rate, where `rate` or what the file says above its table tells one: rows are counted by a
/// column that does so, or as they stand. `asked` is the column that was named for the time, if one was.
///
/// # Errors
/// A rate that is none, or beside a column that tells the time.
pub(crate) fn rated(
    table: &mut Table,
    rate: Option<f64>,
    asked: Option<usize>,
    may_be: &dyn Fn(&Heading) -> bool,
) -> Result<(), Problem> {
    let above = || rate_above(table);
    let there = match asked {
        Some(column) => Some(column),
        None => found(table, may_be)?,
    };
    // a name of a time, whose unit nothing tells
    let open =
        |(rank, k): &(usize, usize)| *rank >= 3 && may_be(&table.columns[*k].heading) && !counts(&table.columns[*k]);
    if let (Some(_), None, Some((_, column))) = (rate, there, called_times(table).into_iter().find(open)) {
        let title = table.columns[column].heading.title.clone();
        let hint = format!("say its unit: --map \"t={title} [UNIT]\"");
        return Err(Fault::RateBesideTime(title).anywhere().hint(hint));
    }
    let counter = there.into_iter().chain(0..table.columns.len()).find(|k| counts(&table.columns[*k]));
    let told = there.filter(|k| Some(*k) != counter);
    let (rate, given) = match (rate, told) {
        (Some(rate), _) if !(rate > 0.0 && rate.is_finite()) => return Err(Fault::Rate(rate.to_string()).anywhere()),
        // a clock too coarse for its samples tells no times
        (Some(_), Some(column)) if table.columns[column].values.windows(2).all(|w| w[0] < w[1]) => {
            let title = table.columns[column].heading.title.clone();
            return Err(Fault::RateBesideTime(title).anywhere().hint("leave it out"));
        }
        (Some(rate), _) => (rate, true),
        (None, None) => match above() {
            Some(rate) => (rate, false),
            None => return Ok(()),
        },
        (None, Some(_)) => return Ok(()),
    };
    let count = |row: usize| counter.map_or(row as f64, |k| table.columns[k].values[row]);
    let values = (0..table.rows()).map(|row| count(row) / rate).collect();
    let column = counter.map(|k| table.columns[k].heading.title.clone());
    table.notes.push(match given {
        true => Note::Rate { rate, column },
        false => Note::Layout(format!("rows are {rate} samples a second, as the file says above its table")),
    });
    let time = Column::of_numbers(Heading::plain("t", Some("s".into())), values);
    match there {
        Some(column) => table.columns[column] = time,
        None => table.columns.push(time),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Table {
        Table::of_text(text.as_bytes().to_vec()).unwrap()
    }

    #[test]
    fn units_of_times_are_known_by_name_and_size() {
        for (text, unit) in [
            ("time_ms,u\n0,1\n10,1\n", Some("ms")),
            ("time [sec],u\n0,1\n1,1\n", Some("s")),
            ("time,u\n1650000000041,1\n1650000000051,1\n", Some("ms")),
            ("time,u\n1650000000041313792,1\n1650000000051313792,1\n", Some("ns")),
            ("time,u\n1650000000.25,1\n1650000000.5,1\n", Some("s")),
            ("time,u\n0,1\n10,1\n", None),
            ("time,u\n08:00,1\n08:15,1\n", Some("s")),
        ] {
            let table = table(text);
            let column = found(&table, &|_| true).unwrap().unwrap();
            assert_eq!(unit_of(&table, column).unit.as_deref(), unit, "{text}");
        }
        assert_eq!(found(&table("when,u\n0,1\n10,1\n"), &|_| true).unwrap(), None);
        assert_eq!(found(&table("Timestamp,u\n5.0,1\n5.1,1\n"), &|_| true).unwrap(), None);
    }

    #[test]
    fn counters_and_clocks_without_a_unit_are_doubted() {
        assert!(counts(&table("sample,u\n0,1\n1,1\n2,1\n").columns[0]));
        assert!(!counts(&table("sample,u\n0,1\n0.1,1\n").columns[0]));
        assert_eq!(doubtful(&table("timestamp,u\n4000,1\n8000,1\n").columns[0]), Some(4000.0));
        assert_eq!(doubtful(&table("time,u\n4000,1\n8000,1\n").columns[0]), None);
    }
}
