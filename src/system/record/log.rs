//! Files of every format as tables, and by a map as channels: one road from bytes to columns.

use super::channel::Channels;
use super::column::Column;
use super::error::{Fault, Problem, RecordError};
use super::heading::Heading;
use super::note::Note;
use super::options::ReadOptions;
use super::samples::numbers;
use super::table::Table;
use super::{text, times};
use fdm_readers::{Field, Log, ReadError, RecordMap, Taken, Topic, is_known, open, open_from, take};
use std::path::Path;

/// What a file holds.
pub(crate) enum Content {
    /// The bytes of a text.
    Text(Vec<u8>),
    /// A log or data file.
    Log(Result<Log, ReadError>),
}

/// Tables of a file, each with its name.
struct Opened {
    format: &'static str,
    tables: Vec<(String, Table)>,
}

/// Reads a file or pipe.
pub(crate) fn content(path: &Path) -> Result<Content, Problem> {
    // large arrays go from the file into their columns
    if let Some(log) = text::regular(path).and_then(|mut file| open_from(&mut file)) {
        return Ok(Content::Log(log));
    }
    let bytes = text::load(path)?;
    Ok(if is_known(&bytes) { Content::Log(open(&bytes)) } else { Content::Text(bytes) })
}

/// The tables of a file of any format.
fn opened(content: Content, salvage: bool, notes: &mut Vec<Note>) -> Result<Opened, Problem> {
    let log = match content {
        Content::Text(bytes) => {
            let table = Table::of_text(bytes)?;
            return Ok(Opened { format: "text", tables: vec![(String::new(), table)] });
        }
        Content::Log(log) => whole(log, salvage, notes)?,
    };
    let format = log.format;
    let mut tables = Vec::new();
    for sheet in &log.sheets {
        match Table::of_sheet(format, sheet)? {
            Some(table) => tables.push((sheet.name.clone(), table)),
            None => notes.push(Note::Taken(format!("the sheet `{}` holds no table of numbers", sheet.name))),
        }
    }
    let alone = tables.len() == 1 && log.topics.is_empty();
    tables.iter_mut().filter(|_| alone).for_each(|(name, _)| name.clear());
    tables.extend(log.topics.into_iter().map(|topic| (topic.name.clone(), Table::of_topic(format, topic))));
    Ok(Opened { format, tables })
}

/// A file of any format as a table.
pub(crate) fn table(
    content: Content,
    channels: &Channels,
    options: &ReadOptions,
    notes: &mut Vec<Note>,
) -> Result<Table, Vec<Problem>> {
    let opened = opened(content, options.salvage, notes).map_err(|p| vec![p])?;
    let Some(map) = &options.map_file else { return only(opened, notes).map_err(|p| vec![p]) };
    let format = opened.format;
    let mut topics = Vec::new();
    for (name, table) in opened.tables {
        notes.extend((!table.ended).then_some(Note::OpenEnd));
        notes.extend(table.notes.iter().cloned());
        topics.push(topic(name, table, Some(map), notes)?);
    }
    let drives = |k: usize| channels.driving.contains(&k);
    let wanted = |name: &str| {
        let output =
            channels.outputs.iter().position(|c| c.name == name).filter(|_| !options.without.iter().any(|w| w == name));
        if channels.inputs.iter().any(|c| c.name == name) { Some(true) } else { output.map(drives) }
    };
    let log = Log { format, topics, ..Log::default() };
    let taken = take(&log, map, &wanted);
    let taken = taken.map_err(|e| e.iter().map(|e| Fault::Map(e.to_string()).anywhere()).collect::<Vec<_>>())?;
    notes.extend(taken.notes.iter().cloned().map(Note::Taken));
    Ok(of_taken(format, taken))
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

/// All that a file holds, for people to look at before they map it; the fields that a map wants under the names by which it calls them.
///
/// # Errors
/// [`RecordError`] of a file that cannot be read, holds no numbers, or is damaged while `salvage` is not wanted.
pub fn open_log(path: &Path, salvage: bool, map: Option<&RecordMap>) -> Result<(Log, Vec<Note>), RecordError> {
    let told = |problem| RecordError { file: path.display().to_string(), problems: vec![problem] };
    let mut notes = Vec::new();
    let opened = content(path).and_then(|content| opened(content, salvage, &mut notes)).map_err(told)?;
    let format = opened.format;
    let mut topics = Vec::new();
    for (name, table) in opened.tables {
        notes.extend((!table.ended).then_some(Note::OpenEnd));
        notes.extend(table.notes.iter().cloned());
        if let Some((line, found, _)) = table.ragged.first() {
            let (count, width) = (table.ragged.len(), table.columns.len());
            let said = format!(
                "{count} row(s) have other than {width} cells and are left out, first {} {line} with {found}",
                table.place
            );
            notes.push(Note::Layout(said));
        }
        let topic = topic(name, table, map, &mut notes);
        topics.push(topic.map_err(|problems| RecordError { file: path.display().to_string(), problems })?);
    }
    if topics.iter().all(|t| t.rows() == 0) {
        return Err(told(Fault::Empty.anywhere()));
    }
    Ok((Log { format, topics, ..Log::default() }, notes))
}

/// A table as a topic: its columns of numbers under their names, those that a map wants as it calls them.
///
/// # Errors
/// Cells of the columns that a map wants which hold no numbers.
fn topic(name: String, table: Table, map: Option<&RecordMap>, notes: &mut Vec<Note>) -> Result<Topic, Vec<Problem>> {
    let froms = || map.iter().flat_map(|m| m.channel.values().map(|c| c.from.as_str()).chain(m.time.from.as_deref()));
    let named = |text: &str| {
        let exact = table.headings().position(|h| h.title == text);
        let of_topic = text.strip_prefix(name.as_str()).and_then(|rest| rest.strip_prefix('.'));
        let loose = || table.headings().position(|h| h.is(text) || of_topic.is_some_and(|field| h.is(field)));
        exact.or_else(loose).map(|column| (of_topic.unwrap_or(text).to_string(), column))
    };
    let mut wanted: Vec<(String, usize)> = Vec::new();
    for (from, column) in froms().filter_map(named) {
        if !wanted.iter().any(|(name, _)| *name == from) {
            numbers(&table, column)?;
            wanted.push((from, column));
        }
    }
    let of_map = map.and_then(|m| m.time.from.as_deref()).and_then(named).map(|(_, column)| column);
    let time = of_map.or_else(|| times::found(&table, &|_| true).ok().flatten());
    let unit = time.map(|column| times::unit_of(&table, column));
    notes.extend(unit.iter().filter(|_| map.is_none_or(|m| m.time.unit.is_none())).filter_map(|u| u.note.clone()));
    let mut topic = Topic { name, ..Topic::default() };
    for (column, own) in table.columns.into_iter().enumerate() {
        let is_time = time == Some(column);
        let unit = if is_time { unit.as_ref().and_then(|u| u.unit.clone()) } else { own.heading.unit.clone() };
        let names: Vec<&String> = wanted.iter().filter(|(_, k)| *k == column).map(|(name, _)| name).collect();
        if own.heading.title.is_empty() || names.is_empty() && !own.has_numbers() {
            let title = own.heading.title.escape_debug();
            let text = own.texts().next().map(|(_, text)| super::error::excerpt(text));
            notes.extend(
                text.filter(|_| !title.to_string().is_empty())
                    .map(|text| Note::Taken(format!("`{title}` holds no numbers (`{text}`, ..)"))),
            );
            continue;
        }
        topic.time = topic.time.or_else(|| is_time.then_some(topic.fields.len()));
        let (shown, title) = (own.heading.name.clone(), own.heading.title.clone());
        for name in names.iter().skip(1) {
            topic.fields.push(Field {
                name: (*name).clone(),
                unit: unit.clone(),
                values: own.values.clone(),
                texts: Vec::new(),
            });
        }
        let name = names.first().map_or(if map.is_some() { title } else { shown }, |name| (*name).clone());
        topic.time = if is_time { Some(topic.fields.len()) } else { topic.time };
        topic.fields.push(Field { name, unit, values: own.values, texts: Vec::new() });
    }
    Ok(topic)
}

/// The only table of a file.
fn only(opened: Opened, notes: &mut Vec<Note>) -> Result<Table, Problem> {
    const SHOWN: usize = 12;
    let Opened { format, mut tables } = opened;
    if format == "text" {
        return Ok(tables.swap_remove(0).1);
    }
    let constants = tables.iter().filter(|(_, t)| t.rows() == 1).map(|(_, t)| t.columns.len()).sum::<usize>();
    let mut many: Vec<(String, Table)> = tables.into_iter().filter(|(_, t)| t.rows() > 1).collect();
    if many.len() > 1 {
        let mut names: Vec<&str> = many.iter().take(SHOWN).map(|(name, _)| name.as_str()).collect();
        if many.len() > SHOWN {
            names.push("..");
        }
        let (count, names) = (many.len(), names.join(", "));
        let hint = "name the channels by --map-file MAP.toml; `fdm data FILE --list` shows what is there";
        return Err(Fault::SeveralClocks { format, count, names }.anywhere().hint(hint));
    }
    let Some((_, table)) = many.pop() else { return Err(Fault::Empty.anywhere()) };
    if constants > 0 {
        notes.push(Note::Taken(format!("{constants} single value(s) beside the table are left out")));
    }
    Ok(table)
}

fn of_taken(format: &'static str, taken: Taken) -> Table {
    let held = taken.columns.iter().filter_map(|c| Some((c.name.clone(), c.hold?))).collect();
    let time = taken.time.map(|time| Column::of_numbers(Heading::plain("t", Some("s".into())), time));
    let columns = taken.columns.into_iter().map(|c| {
        let heading = Heading::plain(&c.name, c.unit);
        let mut column = Column::of_numbers(heading, c.values);
        column.sampled = c.sampled;
        column
    });
    Table { held, ..Table::of_columns(format, time.into_iter().chain(columns).collect()) }
}
