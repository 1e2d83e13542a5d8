//! Logs and data files of other formats, and maps of text files, as tables of numbers.

use super::channel::Channels;
use super::error::{Fault, Problem, RecordError};
use super::note::Note;
use super::options::ReadOptions;
use super::samples::numbers;
use super::table::{Heading, Numbers, Table};
use super::text;
use fdm_readers::{Field, Format, Log, ReadError, RecordMap, Taken, Topic, open, open_from, take};
use std::path::Path;

/// What a file holds.
pub(crate) enum Content {
    /// The bytes of a text.
    Text(Vec<u8>),
    /// A log or data file.
    Log(Result<Log, ReadError>),
}

/// Reads a file or pipe.
pub(crate) fn content(path: &Path) -> Result<Content, Problem> {
    // large arrays go from the file into their columns
    if let Some(log) = text::regular(path).and_then(|mut file| open_from(&mut file)) {
        return Ok(Content::Log(log));
    }
    let bytes = text::load(path)?;
    Ok(if Format::of(&bytes).is_some() { Content::Log(open(&bytes)) } else { Content::Text(bytes) })
}

/// A file of any format as a table.
pub(crate) fn table(
    content: Content,
    channels: &Channels,
    options: &ReadOptions,
    notes: &mut Vec<Note>,
) -> Result<Table, Vec<Problem>> {
    let log = match content {
        Content::Log(log) => {
            let log = whole(log, options.salvage, notes).map_err(|p| vec![p])?;
            match &options.map_file {
                Some(map) => (log, map),
                None => return only(log, notes).map_err(|p| vec![p]),
            }
        }
        Content::Text(bytes) => {
            let table = Table::new(bytes).map_err(|p| vec![p])?;
            match &options.map_file {
                Some(map) => {
                    notes.extend((!table.ended).then_some(Note::OpenEnd));
                    (Log { format: "text", topics: vec![mapped(&table, map)?], ..Log::default() }, map)
                }
                None => return Ok(table),
            }
        }
    };
    let drives = |k: usize| channels.driving.contains(&k);
    let wanted = |name: &str| {
        let output =
            channels.outputs.iter().position(|c| c.name == name).filter(|_| !options.without.iter().any(|w| w == name));
        if channels.inputs.iter().any(|c| c.name == name) { Some(true) } else { output.map(drives) }
    };
    let (log, map) = log;
    let taken = take(&log, map, &wanted);
    let taken = taken.map_err(|e| e.iter().map(|e| Fault::Map(e.to_string()).anywhere()).collect::<Vec<_>>())?;
    notes.extend(taken.notes.iter().cloned().map(Note::Taken));
    Ok(Table::of_numbers(log.format, of_taken(taken)))
}

/// A log that was read; what is damaged in it is said or refused.
fn whole(log: Result<Log, ReadError>, salvage: bool, notes: &mut Vec<Note>) -> Result<Log, Problem> {
    /// Places that are named one by one.
    const SHOWN: usize = 3;
    let log = log.map_err(|e| Fault::Unopened(e.to_string()).anywhere())?;
    let rows: usize = log.topics.iter().map(Topic::rows).sum();
    if !log.damage.is_empty() {
        let mut told: Vec<String> = log.damage.iter().take(SHOWN).map(ToString::to_string).collect();
        let more = log.damage.len().saturating_sub(SHOWN);
        told.extend((more > 0).then(|| format!("and {more} more places")));
        let (places, topics) = (told.join("; "), log.topics.len());
        let fault = Fault::Damaged { format: log.format, places, rows, topics };
        if !salvage {
            return Err(fault.anywhere().hint("go on with what was read by --salvage"));
        }
        notes.push(Note::Taken(format!("salvaged: {fault}")));
    }
    notes.extend(log.remarks.iter().cloned().map(Note::Taken));
    Ok(log)
}

/// All that a log or a table of text holds, for people to look at before they map it.
///
/// # Errors
/// [`RecordError`] of a file that cannot be read, or is damaged while `salvage` is not wanted.
pub fn open_log(path: &Path, salvage: bool) -> Result<(Log, Vec<Note>), RecordError> {
    let told = |problem| RecordError { file: path.display().to_string(), problems: vec![problem] };
    let mut notes = Vec::new();
    let bytes = match content(path).map_err(told)? {
        Content::Log(log) => return whole(log, salvage, &mut notes).map(|log| (log, notes)).map_err(told),
        Content::Text(bytes) => bytes,
    };
    let table = Table::new(bytes).map_err(told)?;
    notes.extend((!table.ended).then_some(Note::OpenEnd));
    let times = ["t", "time", "T", "Time", "TIME"];
    let time = times.iter().find_map(|n| table.columns.iter().position(|h| h.name == *n));
    let time = time.or_else(|| (0..table.columns.len()).find(|k| table.is_clock(*k)));
    let mut topic = Topic::default();
    for (column, heading) in table.columns.iter().enumerate().filter(|(_, h)| !h.title.is_empty()) {
        let is_clock = table.is_clock(column);
        match numbers(&table, &[column], Some(column).filter(|_| is_clock)) {
            Ok(mut values) => {
                topic.time = topic.time.or_else(|| (time == Some(column)).then_some(topic.fields.len()));
                let unit = if is_clock { Some("s".to_string()) } else { heading.unit.clone() };
                topic.fields.push(Field { name: heading.name.clone(), unit, values: values.pop().unwrap_or_default() });
            }
            Err(problems) => notes.extend(problems.iter().take(1).map(|p| Note::Taken(p.to_string()))),
        }
    }
    Ok((Log { format: "text", topics: vec![topic], ..Log::default() }, notes))
}

/// The only table of a file.
fn only(mut log: Log, notes: &mut Vec<Note>) -> Result<Table, Problem> {
    const SHOWN: usize = 12;
    let tables: Vec<&Topic> = log.topics.iter().filter(|t| t.rows() > 1).collect();
    match tables[..] {
        [_] => {}
        [] => return Err(Fault::Empty.anywhere()),
        _ => {
            let mut names: Vec<&str> = tables.iter().take(SHOWN).map(|t| t.name.as_str()).collect();
            if tables.len() > SHOWN {
                names.push("..");
            }
            let (format, count, names) = (log.format, tables.len(), names.join(", "));
            let hint = "name the channels by --map-file MAP.toml; `fdm data FILE --list` shows what is there";
            return Err(Fault::SeveralClocks { format, count, names }.anywhere().hint(hint));
        }
    }
    let constants = log.topics.iter().filter(|t| t.rows() == 1).flat_map(|t| &t.fields).count();
    if constants > 0 {
        notes.push(Note::Taken(format!("{constants} single value(s) beside the table are left out")));
    }
    let place = log.topics.iter().position(|t| t.rows() > 1).unwrap_or_default();
    let topic = log.topics.swap_remove(place);
    let seconds = topic.time.filter(|k| topic.fields[*k].unit.is_some());
    // large arrays stand in memory once
    let columns = topic.fields.into_iter().enumerate();
    let columns = columns.map(|(k, field)| (heading(&field, seconds == Some(k)), field.values));
    Ok(Table::of_numbers(log.format, Numbers::new(columns.collect(), Vec::new())))
}

/// Slices of arrays have brackets that are no units.
fn heading(field: &Field, is_time: bool) -> Heading {
    let title = field.name.clone();
    let name = if is_time { "t".to_string() } else { title.clone() };
    match &field.unit {
        None if !title.contains(":,") => Heading::new(&title),
        unit => Heading { title, name, unit: unit.clone() },
    }
}

fn of_taken(taken: Taken) -> Numbers {
    let held = taken.columns.iter().filter_map(|c| Some((c.name.clone(), c.hold?))).collect();
    let plain = |name: &str, unit: Option<String>| Heading { title: name.into(), name: name.into(), unit };
    let time = taken.time.map(|time| (plain("t", Some("s".into())), time));
    let timed = time.iter().map(|_| Vec::new());
    let sampled = timed.chain(taken.columns.iter().map(|c| c.sampled.clone())).collect();
    let columns = taken.columns.into_iter().map(|c| (plain(&c.name, c.unit), c.values));
    let mut numbers = Numbers::new(time.into_iter().chain(columns).collect(), held);
    numbers.sampled = sampled;
    numbers
}

/// The columns of a text file that a map names, and its time.
pub(crate) fn mapped(table: &Table, map: &RecordMap) -> Result<Topic, Vec<Problem>> {
    let named = |text: &str| {
        let exact = table.columns.iter().position(|h| h.title == text);
        exact.or_else(|| table.columns.iter().position(|h| h.name == text))
    };
    let times = ["t", "time", "T", "Time", "TIME"];
    let time = map.time.from.as_deref().map_or_else(|| times.iter().find_map(|n| named(n)), named);
    let mut wanted: Vec<(String, usize)> = Vec::new();
    let froms = map.channel.values().map(|c| c.from.as_str()).chain(map.time.from.as_deref());
    for from in froms {
        if let Some(column) = named(from).filter(|_| !wanted.iter().any(|(name, _)| name == from)) {
            wanted.push((from.to_string(), column));
        }
    }
    if let Some(column) = time.filter(|column| !wanted.iter().any(|(_, k)| k == column)) {
        wanted.push((table.columns[column].title.clone(), column));
    }
    let is_clock = time.is_some_and(|column| table.is_clock(column));
    let columns: Vec<usize> = wanted.iter().map(|(_, column)| *column).collect();
    let values = numbers(table, &columns, time.filter(|_| is_clock))?;
    let fields = wanted.iter().zip(values).map(|((name, column), values)| Field {
        name: name.clone(),
        unit: if is_clock && time == Some(*column) { Some("s".into()) } else { table.columns[*column].unit.clone() },
        values,
    });
    let fields: Vec<Field> = fields.collect();
    let time = time.and_then(|time| wanted.iter().position(|(_, column)| *column == time));
    Ok(Topic { name: String::new(), time, fields })
}
