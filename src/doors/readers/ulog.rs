//! PX4's ULog: definitions of messages, then messages with a two-byte length, without any checksum.
//!
//! The reader is our own: the crate for it takes lengths on trust and ends the process on some damaged files, and says nothing of what a
//! truncated file lost. Here every byte is accounted for. Damage is what the format does not allow: a message beyond the end, of an unknown
//! type or a length that is not its format's, of a topic that was not announced, a time that runs backwards.
//! Source: <https://docs.px4.io/main/en/dev_log/ulog_file_format.html>.

use crate::bytes::{Bytes, Number, name};
use crate::log::{Damage, Field, Log, ReadError, Reader, Topic};
use fdm_numeric::elementary::{asin, atan2};
use std::collections::HashMap;

/// The reader.
pub(crate) struct ULog;

/// Depth to which formats stand in formats; PX4's own have two.
const DEEPEST: usize = 8;
/// Numbers in one message; PX4's largest have a few thousand bytes.
const WIDEST: usize = 1 << 16;
/// Faults that are named one by one.
const NAMED: usize = 20;
/// The time stands in this field, in microseconds.
const TIME: &str = "timestamp";

/// A number in a message.
struct Place {
    name: String,
    at: usize,
    number: Number,
}

/// A topic that was announced.
struct Subscription {
    name: String,
    places: Vec<Place>,
    size: usize,
    /// Index of the time among the places.
    time: Option<usize>,
    columns: Vec<Vec<f64>>,
    last: f64,
}

struct State<'a> {
    formats: HashMap<&'a str, &'a str>,
    topics: HashMap<u16, usize>,
    found: Vec<Subscription>,
    damage: Vec<Damage>,
    faults: usize,
    dropouts: (usize, f64),
}

impl Reader for ULog {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        if bytes.len() < 16 {
            let what = format!("it ends after {} bytes, within its header", bytes.len());
            return Err(ReadError::Broken { format: "ULog", what, at: bytes.len() as u64 });
        }
        let mut state = State {
            formats: HashMap::new(),
            topics: HashMap::new(),
            found: Vec::new(),
            damage: Vec::new(),
            faults: 0,
            dropouts: (0, 0.0),
        };
        let mut at = 16;
        while at < bytes.len() {
            at = state.message(bytes, at);
        }
        Ok(state.finish(bytes.len()))
    }
}

impl<'a> State<'a> {
    fn blame(&mut self, at: usize, what: String) {
        self.faults += 1;
        if self.damage.len() < NAMED {
            self.damage.push(Damage { at: at as u64, what });
        }
    }

    /// Reads the message at an offset; gives the offset behind it.
    fn message(&mut self, all: &'a [u8], at: usize) -> usize {
        let mut bytes = Bytes { all, at };
        let header = bytes.u16().zip(bytes.u8());
        let Some((size, kind)) = header else {
            self.blame(at, format!("the file ends within a message; {} bytes are lost", all.len() - at));
            return all.len();
        };
        let Some(body) = bytes.take(usize::from(size)) else {
            let left = all.len() - at;
            self.blame(at, format!("a message of {} bytes in a file that ends after {left}; they are lost", size + 3));
            return self.resume(all, at);
        };
        let end = bytes.at;
        let fault = match kind {
            b'B' => flags(body),
            b'F' => self.format(body),
            b'A' => self.announced(body),
            b'D' => self.data(body),
            b'O' => self.dropout(body),
            b'I' | b'M' | b'P' | b'Q' => key(kind, body),
            b'L' | b'C' | b'S' | b'R' => None,
            _ => {
                let what = format!("a message of the unknown type {kind:#04x}");
                self.blame(at, what);
                return self.resume(all, at);
            }
        };
        if let Some(what) = fault {
            self.blame(at, what);
        }
        end
    }

    /// The next place where reading can go on: a synchronisation message of the logger; the end without one.
    fn resume(&self, all: &[u8], at: usize) -> usize {
        const SYNC: [u8; 11] = [8, 0, b'S', 0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12];
        let rest = &all[at + 1..];
        rest.windows(SYNC.len()).position(|w| w == SYNC).map_or(all.len(), |k| at + 1 + k)
    }

    fn format(&mut self, body: &'a [u8]) -> Option<String> {
        let text = name(body).filter(|t| t.len() == body.len()).and_then(|t| t.split_once(':'));
        let Some((name, fields)) = text.filter(|(name, _)| is_word(name)) else {
            return Some("a format of a message that is no text".into());
        };
        match self.formats.insert(name, fields) {
            Some(before) if before != fields => Some(format!("two formats of the message `{name}`")),
            _ => None,
        }
    }

    fn announced(&mut self, body: &[u8]) -> Option<String> {
        let mut bytes = Bytes::new(body);
        let (Some(instance), Some(id)) = (bytes.u8(), bytes.u16()) else {
            return Some("a topic that is announced in less than three bytes".into());
        };
        let named = str::from_utf8(&body[3..]).ok().filter(|n| is_word(n));
        let Some(name) = named else { return Some("a topic whose name is no text".into()) };
        let (mut places, mut size) = (Vec::new(), 0);
        if let Err(what) = flatten(&self.formats, name, "", 0, &mut places, &mut size) {
            return Some(what);
        }
        // what pads the end of a message may be left out of it
        let time = places.iter().position(|p| p.name == TIME);
        let columns = places.iter().map(|_| Vec::new()).collect();
        let last = f64::NEG_INFINITY;
        let topic = Subscription { name: format!("{name}[{instance}]"), places, size, time, columns, last };
        self.found.push(topic);
        let before = self.topics.insert(id, self.found.len() - 1);
        before.map(|_| format!("the number {id} is given to the topic `{name}` and to one before"))
    }

    fn data(&mut self, body: &[u8]) -> Option<String> {
        let Some(id) = Bytes::new(body).u16() else { return Some("a message without a topic".into()) };
        let Some(topic) = self.topics.get(&id).map(|k| &mut self.found[*k]) else {
            return Some(format!("a message of the topic {id}, which was not announced"));
        };
        let content = &body[2..];
        let least = topic.places.last().map_or(0, |p| p.at + p.number.size());
        if content.len() > topic.size || content.len() < least {
            let (name, found, expected) = (&topic.name, content.len(), topic.size);
            return Some(format!("a message of `{name}` has {found} bytes, expected {expected}"));
        }
        let value = |p: &Place| p.number.read(&content[p.at..p.at + p.number.size()], false).unwrap_or(f64::NAN);
        if let Some(k) = topic.time {
            let time = value(&topic.places[k]);
            // loggers write two messages of one time, and never one of the past
            if time < topic.last {
                let (name, before) = (&topic.name, topic.last);
                return Some(format!(
                    "the time of `{name}` falls from {before} us to {time} us; the message is left out"
                ));
            }
            topic.last = time;
        }
        for (place, column) in topic.places.iter().zip(&mut topic.columns) {
            column.push(value(place));
        }
        None
    }

    fn dropout(&mut self, body: &[u8]) -> Option<String> {
        let Some(length) = Bytes::new(body).u16() else { return Some("a dropout without a length".into()) };
        self.dropouts.0 += 1;
        self.dropouts.1 += f64::from(length) / 1000.0;
        None
    }

    fn finish(mut self, length: usize) -> Log {
        if self.faults > self.damage.len() {
            let more = self.faults - self.damage.len();
            self.damage.push(Damage { at: length as u64, what: format!("{more} more places are damaged") });
        }
        let mut remarks = Vec::new();
        if self.dropouts.0 > 0 {
            let (count, seconds) = self.dropouts;
            remarks.push(format!("the logger reports {count} dropouts of {seconds:.3} s together"));
        }
        let topics = self.found.into_iter().filter(|t| t.columns.first().is_some_and(|c| !c.is_empty()));
        Log { topics: topics.map(topic).collect(), damage: self.damage, remarks, ..Log::default() }
    }
}

/// What a file of a later version may hold that changes the meaning of the rest.
fn flags(body: &[u8]) -> Option<String> {
    match body.get(8..16) {
        Some(incompatible) if incompatible[0] & !1 == 0 && incompatible[1..].iter().all(|b| *b == 0) => None,
        Some(_) => Some("flags of a later version of the format".into()),
        None => Some("the flags are shorter than 16 bytes".into()),
    }
}

/// A message with a key and a value.
fn key(kind: u8, body: &[u8]) -> Option<String> {
    let at = usize::from(matches!(kind, b'M' | b'Q'));
    let length = usize::from(*body.get(at)?);
    let text = body.get(at + 1..at + 1 + length).and_then(|k| str::from_utf8(k).ok());
    text.filter(|t| t.contains(' ')).map_or_else(|| Some("a setting whose name is no text".into()), |_| None)
}

fn is_word(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"_-/.".contains(&b))
}

/// The numbers of a message with their offsets; formats stand in formats.
fn flatten(
    formats: &HashMap<&str, &str>,
    message: &str,
    prefix: &str,
    depth: usize,
    places: &mut Vec<Place>,
    size: &mut usize,
) -> Result<(), String> {
    let Some(fields) = formats.get(message) else { return Err(format!("the message `{message}` has no format")) };
    if depth > DEEPEST {
        return Err(format!("the format of `{message}` holds itself"));
    }
    for field in fields.split(';').filter(|f| !f.is_empty()) {
        let bad = || format!("the format of `{message}` has the field `{}`", field.escape_debug());
        let (kind, name) = field.split_once(' ').filter(|(_, n)| is_word(n)).ok_or_else(bad)?;
        let (kind, count) = match kind.split_once('[') {
            Some((kind, count)) => {
                (kind, count.strip_suffix(']').and_then(|c| c.parse().ok()).filter(|n| *n <= WIDEST).ok_or_else(bad)?)
            }
            None => (kind, 0),
        };
        for k in 0..count.max(1) {
            let name = if count > 0 { format!("{prefix}{name}[{k}]") } else { format!("{prefix}{name}") };
            let number = match kind {
                "int8_t" => Number::I8,
                "uint8_t" | "bool" | "char" => Number::U8,
                "int16_t" => Number::I16,
                "uint16_t" => Number::U16,
                "int32_t" => Number::I32,
                "uint32_t" => Number::U32,
                "int64_t" => Number::I64,
                "uint64_t" => Number::U64,
                "float" => Number::F32,
                "double" => Number::F64,
                _ => {
                    flatten(formats, kind, &format!("{name}."), depth + 1, places, size)?;
                    continue;
                }
            };
            if *size > WIDEST {
                return Err(format!("the format of `{message}` is larger than a message can be"));
            }
            // text and padding take their room, and are no numbers
            if kind != "char" && !name.contains("_padding") {
                places.push(Place { name, at: *size, number });
            }
            *size += number.size();
        }
    }
    Ok(())
}

/// A topic of a log, with the angles of a quaternion that stands in it.
fn topic(found: Subscription) -> Topic {
    let mut fields: Vec<Field> = Vec::new();
    for (place, values) in found.places.into_iter().zip(found.columns) {
        let unit = (place.name == TIME).then(|| "us".to_string());
        fields.push(Field::new(place.name, unit.as_deref(), values));
    }
    let angles = {
        let q = |k: usize| fields.iter().find(|f| f.name == format!("q[{k}]")).map(|f| &f.values);
        match (q(0), q(1), q(2), q(3)) {
            (Some(w), Some(x), Some(y), Some(z)) => Some(angles([w, x, y, z])),
            _ => None,
        }
    };
    fields.extend(angles.into_iter().flatten());
    let time = fields.iter().position(|f| f.name == TIME);
    Topic { name: found.name, time, fields }
}

/// Euler angles (3-2-1) of a quaternion from body (FRD) to earth (NED), as PX4 logs attitudes.
fn angles([w, x, y, z]: [&Vec<f64>; 4]) -> [Field; 3] {
    let of = |angle: &dyn Fn(f64, f64, f64, f64) -> f64| -> Vec<f64> {
        (0..w.len()).map(|k| angle(w[k], x[k], y[k], z[k])).collect()
    };
    let roll = of(&|w, x, y, z| atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)));
    let pitch = of(&|w, x, y, z| asin((2.0 * (w * y - z * x)).clamp(-1.0, 1.0)));
    let yaw = of(&|w, x, y, z| atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)));
    let field = |name: &str, values| Field::new(name, Some("rad"), values);
    [field("roll", roll), field("pitch", pitch), field("yaw", yaw)]
}
