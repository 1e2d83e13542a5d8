//! WPILib's data log: records of entries that control records begin and name, each with a time in microseconds. No checksum.
//!
//! Source: <https://github.com/wpilibsuite/allwpilib/blob/main/wpiutil/doc/datalog.adoc>, version 1.0.

use crate::bytes::{Bytes, Number};
use crate::log::{Damage, Field, Log, ReadError, Reader, Topic};
use std::collections::BTreeMap;

/// The reader.
pub(crate) struct WpiLog;

const MAGIC: &[u8] = b"WPILOG";
/// Columns that one entry of arrays may have.
const WIDEST: usize = 256;
/// Places of damage, and names of what is left out, that are told one by one.
const NAMED: usize = 20;

/// An entry: one signal, or one array of signals.
struct Entry {
    name: String,
    kind: String,
    /// None where its values are no numbers.
    number: Option<Number>,
    is_array: bool,
    /// Time in microseconds, and values.
    rows: Vec<(f64, Vec<f64>)>,
}

impl Reader for WpiLog {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        let broken = |what: String, at: usize| ReadError::Broken { format: "WPILOG", what, at: at as u64 };
        let mut from = Bytes::new(bytes);
        let header = from.take(MAGIC.len()).and_then(|_| Some((from.u16()?, from.u32()?)));
        let Some((version, extra)) = header else { return Err(broken("the header is cut off".into(), 0)) };
        if version >> 8 != 1 {
            return Err(broken(format!("version {}.{}, and 1.0 is read", version >> 8, version & 0xff), MAGIC.len()));
        }
        if from.take(extra as usize).is_none() {
            return Err(broken(format!("a header of {extra} bytes in a file that ends before"), MAGIC.len() + 2));
        }
        let mut state = State::default();
        while from.left() > 0 {
            let at = from.at;
            match record(&mut from) {
                Some((entry, time, payload)) => state.record(entry, time, payload, at),
                None => {
                    let left = bytes.len() - at;
                    state.blame(at, format!("a record that is cut off; {left} bytes are lost"));
                    break;
                }
            }
        }
        Ok(state.finish(bytes.len()))
    }
}

/// Entry, time in microseconds and contents of the next record.
fn record<'a>(from: &mut Bytes<'a>) -> Option<(u64, f64, &'a [u8])> {
    let lengths = usize::from(from.u8()?);
    let mut number = |length: usize| {
        let mut all = [0; 8];
        all[..length].copy_from_slice(from.take(length)?);
        Some(u64::from_le_bytes(all))
    };
    let (entry, size) = (number((lengths & 3) + 1)?, number((lengths >> 2 & 3) + 1)?);
    let time = number((lengths >> 4 & 7) + 1)? as i64 as f64;
    Some((entry, time, from.take(usize::try_from(size).ok()?)?))
}

#[derive(Default)]
struct State {
    /// By the number that names them in records; behind it, those that have ended.
    entries: BTreeMap<u64, usize>,
    all: Vec<Entry>,
    damage: Vec<Damage>,
    faults: usize,
}

impl State {
    fn blame(&mut self, at: usize, what: String) {
        self.faults += 1;
        if self.damage.len() < NAMED {
            self.damage.push(Damage { at: at as u64, what });
        }
    }

    fn record(&mut self, entry: u64, time: f64, payload: &[u8], at: usize) {
        let fault = if entry == 0 { self.control(payload) } else { self.data(entry, time, payload) };
        if let Some(what) = fault {
            self.blame(at, what);
        }
    }

    /// A record about entries; says what is wrong with it.
    fn control(&mut self, payload: &[u8]) -> Option<String> {
        let mut from = Bytes::new(payload);
        let wrong = || Some("a control record that is none".to_string());
        let (Some(kind), Some(entry)) = (from.u8(), from.u32()) else { return wrong() };
        let mut text = || {
            let length = from.u32()? as usize;
            str::from_utf8(from.take(length)?).ok().map(str::to_string)
        };
        match kind {
            0 => {
                let (Some(name), Some(kind), Some(_)) = (text(), text(), text()) else { return wrong() };
                // an entry that begins again goes on
                let same = self.all.iter().position(|e| e.name == name && e.kind == kind);
                let place = same.unwrap_or_else(|| {
                    self.all.push(Entry::new(name, kind));
                    self.all.len() - 1
                });
                self.entries.insert(u64::from(entry), place);
                None
            }
            1 => {
                self.entries.remove(&u64::from(entry));
                None
            }
            2 => None,
            _ => wrong(),
        }
    }

    fn data(&mut self, entry: u64, time: f64, payload: &[u8]) -> Option<String> {
        let Some(place) = self.entries.get(&entry) else {
            return Some(format!("a record of the entry {entry}, which has not begun"));
        };
        let entry = &mut self.all[*place];
        let Some(number) = entry.number else {
            entry.rows.push((time, Vec::new()));
            return None;
        };
        let (size, name) = (payload.len(), &entry.name);
        if size % number.size() != 0 || !entry.is_array && size != number.size() {
            return Some(format!("{size} bytes for a value of `{name}`, which is `{}`; it is left out", entry.kind));
        }
        if size / number.size() > WIDEST {
            return Some(format!("an array of `{name}` longer than {WIDEST}; it is left out"));
        }
        entry.rows.push((time, number.read_all(payload, false)));
        None
    }

    fn finish(mut self, length: usize) -> Log {
        let mut log = Log::default();
        let (mut left_out, mut sorted) = (Vec::new(), Vec::new());
        for mut entry in self.all.into_iter().filter(|e| !e.rows.is_empty()) {
            if entry.number.is_none() {
                left_out.push(format!("`{}` ({})", entry.name, entry.kind));
                continue;
            }
            if entry.rows.windows(2).any(|w| w[1].0 < w[0].0) {
                sorted.push(format!("`{}`", entry.name));
                entry.rows.sort_by(|a, b| a.0.total_cmp(&b.0));
            }
            log.topics.push(entry.topic());
        }
        let told = |names: &[String]| {
            let more = if names.len() > NAMED { format!(" and {} more", names.len() - NAMED) } else { String::new() };
            format!("{}{more}", names[..names.len().min(NAMED)].join(", "))
        };
        if !left_out.is_empty() {
            log.remarks.push(format!("no numbers, left out: {}", told(&left_out)));
        }
        if !sorted.is_empty() {
            log.remarks.push(format!("times that fall, put in order: {}", told(&sorted)));
        }
        if self.faults > self.damage.len() {
            let more = self.faults - self.damage.len();
            self.damage.push(Damage { at: length as u64, what: format!("{more} more places are damaged") });
        }
        log.topics.sort_by(|a, b| a.name.cmp(&b.name));
        log.damage = self.damage;
        log
    }
}

impl Entry {
    fn new(name: String, kind: String) -> Self {
        let number = match kind.trim_end_matches("[]") {
            "double" => Some(Number::F64),
            "float" => Some(Number::F32),
            "int64" => Some(Number::I64),
            "boolean" => Some(Number::U8),
            _ => None,
        };
        Self { is_array: kind.ends_with("[]"), name, kind, number, rows: Vec::new() }
    }

    /// Its times and values; short arrays end in gaps.
    fn topic(self) -> Topic {
        let width = self.rows.iter().map(|(_, values)| values.len()).max().unwrap_or(0);
        let time = self.rows.iter().map(|(time, _)| *time).collect();
        let mut fields = vec![Field::new("timestamp", Some("us"), time)];
        for k in 0..width {
            let name = if self.is_array { format!("value[{k}]") } else { "value".into() };
            let values = self.rows.iter().map(|(_, v)| v.get(k).copied().unwrap_or(f64::NAN));
            fields.push(Field::new(name, None, values.collect()));
        }
        Topic { name: self.name, time: Some(0), fields }
    }
}
