//! ArduPilot's DataFlash: messages that begin with two fixed bytes and a type; formats are messages too. No checksum.
//!
//! The reader is our own: the crate for it passes over damaged bytes without a word. Damage is what the format does not allow: bytes that
//! begin no message, a type without a format, a format whose length is not that of its fields, a time that runs backwards.
//! Source: <https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html>.

use crate::bytes::{Bytes, Number, name};
use crate::log::{Damage, Field, Log, ReadError, Reader, Topic};
use std::collections::BTreeMap;

/// The reader.
pub(crate) struct DataFlash;

const MAGIC: [u8; 2] = [0xa3, 0x95];
/// The type of messages that are formats, and their length.
const FORMAT: (u8, usize) = (0x80, 89);
/// Places of damage that are named one by one.
const NAMED: usize = 20;

/// A type of messages.
struct Kind {
    name: String,
    /// Bytes, its three leading ones among them.
    length: usize,
    labels: Vec<String>,
    places: Vec<Place>,
    /// By column; text has none.
    columns: Vec<Vec<f64>>,
    /// Where the messages stood.
    offsets: Vec<usize>,
    /// Units and multipliers of its fields, each by a letter.
    units: Option<Letters>,
}

struct Place {
    /// Index of the label.
    label: usize,
    at: usize,
    number: Number,
    scale: Scale,
}

/// How the number in the file becomes the value.
#[derive(Clone, Copy, PartialEq)]
enum Scale {
    One,
    Hundredth,
    TenMillionth,
}

impl Reader for DataFlash {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        let mut state = State {
            units: BTreeMap::new(),
            factors: BTreeMap::new(),
            kinds: BTreeMap::new(),
            damage: Vec::new(),
            faults: 0,
        };
        let mut at = 0;
        while at < bytes.len() {
            at = state.message(bytes, at);
        }
        if state.kinds.is_empty() {
            let what = "it holds no format of a message".into();
            return Err(ReadError::Broken { format: "DataFlash", what, at: 0 });
        }
        Ok(state.finish(bytes.len()))
    }
}

/// What stands for the unit and for the factor of each column.
struct Letters {
    units: Vec<u8>,
    factors: Vec<u8>,
}

struct State {
    kinds: BTreeMap<u8, Kind>,
    units: BTreeMap<u8, String>,
    factors: BTreeMap<u8, f64>,
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

    /// Reads the message at an offset; gives the offset behind it.
    fn message(&mut self, all: &[u8], at: usize) -> usize {
        let mut bytes = Bytes { all, at };
        if bytes.take(2) != Some(&MAGIC) {
            return self.skip(all, at, "bytes that begin no message".into());
        }
        let Some(kind) = bytes.u8() else { return self.skip(all, at, "a message without a type".into()) };
        let length = if kind == FORMAT.0 { Some(FORMAT.1) } else { self.kinds.get(&kind).map(|k| k.length) };
        let Some(length) = length else {
            return self.skip(all, at, format!("a message of type {kind:#04x}, which has no format"));
        };
        let Some(body) = bytes.take(length - 3) else {
            let left = all.len() - at;
            return self.skip(all, at, format!("a message of {length} bytes in a file that ends after {left}"));
        };
        let fault = if kind == FORMAT.0 { self.format(body) } else { self.data(kind, body, at) };
        if let Some(what) = fault {
            self.blame(at, what);
        }
        bytes.at
    }

    /// Names the damage and looks for the next message.
    fn skip(&mut self, all: &[u8], at: usize, what: String) -> usize {
        let known = |kind: u8| kind == FORMAT.0 || self.kinds.contains_key(&kind);
        let next = all[at + 1..].windows(3).position(|w| w[..2] == MAGIC && known(w[2]));
        let next = next.map_or(all.len(), |k| at + 1 + k);
        self.blame(at, format!("{what}; {} bytes are lost", next - at));
        next
    }

    fn format(&mut self, body: &[u8]) -> Option<String> {
        let mut bytes = Bytes::new(body);
        let (kind, length) = (bytes.u8()?, usize::from(bytes.u8()?));
        let text = |bytes: &mut Bytes<'_>, n| bytes.take(n).and_then(name).map(str::to_string);
        let (Some(name), Some(format), Some(labels)) =
            (text(&mut bytes, 4), text(&mut bytes, 16), text(&mut bytes, 64))
        else {
            return Some("a format that is no text".into());
        };
        let word = |t: &str| !t.is_empty() && t.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
        let labels: Vec<String> = labels.split(',').filter(|l| !l.is_empty()).map(str::to_string).collect();
        if !word(&name) || !labels.iter().all(|l| word(l)) {
            return Some("a format whose names are no words".into());
        }
        let mut size = 0;
        let mut places = Vec::new();
        for (label, letter) in format.bytes().enumerate() {
            let Some((bytes, number, scale)) = letter_of(letter) else {
                return Some(format!("the format of `{name}` has the letter `{}`", char::from(letter).escape_debug()));
            };
            places.extend(number.map(|number| Place { label, at: size, number, scale }));
            size += bytes;
        }
        if size + 3 != length || labels.len() != format.len() {
            let fields = format.len();
            return Some(format!(
                "the format of `{name}` has {} names for {fields} fields and a length of {length} for {}",
                labels.len(),
                size + 3
            ));
        }
        if kind == FORMAT.0 {
            return None;
        }
        let columns = places.iter().map(|_| Vec::new()).collect();
        let known = Kind { name, length, labels, places, columns, offsets: Vec::new(), units: None };
        let same = |before: &Kind| before.name == known.name && before.labels == known.labels;
        match self.kinds.get(&kind) {
            // a log that goes on after a restart says its formats again
            Some(before) if same(before) => None,
            Some(before) => Some(format!("the type {kind} of `{}` is given to `{}` too", before.name, known.name)),
            None => {
                self.kinds.insert(kind, known);
                None
            }
        }
    }

    fn data(&mut self, kind: u8, body: &[u8], at: usize) -> Option<String> {
        let found = self.kinds.get_mut(&kind)?;
        found.offsets.push(at);
        for (place, column) in found.places.iter().zip(&mut found.columns) {
            let value = place.number.read(&body[place.at..place.at + place.number.size()], false).unwrap_or(f64::NAN);
            column.push(match place.scale {
                Scale::One => value,
                Scale::Hundredth => value / 100.0,
                Scale::TenMillionth => value / 1e7,
            });
        }
        // these three say the units of the others; their layouts are fixed
        match found.name.as_str() {
            "UNIT" if body.len() == 8 + 1 + 64 => {
                let label = name(&body[9..]).map(str::to_string);
                self.units.insert(body[8], label?);
            }
            "MULT" if body.len() == 8 + 1 + 8 => {
                self.factors.insert(body[8], Number::F64.read(&body[9..], false)?);
            }
            "FMTU" if body.len() == 8 + 1 + 16 + 16 => {
                let letters = |from: usize| body[from..from + 16].to_vec();
                let of = body[8];
                if let Some(kind) = self.kinds.get_mut(&of) {
                    kind.units = Some(Letters { units: letters(9), factors: letters(25) });
                }
            }
            _ => {}
        }
        None
    }

    fn finish(mut self, length: usize) -> Log {
        let mut topics = Vec::new();
        for kind in std::mem::take(&mut self.kinds).into_values() {
            if kind.offsets.is_empty() || matches!(kind.name.as_str(), "UNIT" | "MULT" | "FMTU" | "PARM") {
                continue;
            }
            self.topics(kind, &mut topics);
        }
        if self.faults > self.damage.len() {
            let more = self.faults - self.damage.len();
            self.damage.push(Damage { at: length as u64, what: format!("{more} more places are damaged") });
        }
        topics.sort_by(|a, b| a.name.cmp(&b.name));
        Log { topics, damage: self.damage, ..Log::default() }
    }

    /// One topic for each instance of a sensor.
    fn topics(&mut self, kind: Kind, topics: &mut Vec<Topic>) {
        let letter = |k: usize, of: fn(&Letters) -> &Vec<u8>| kind.units.as_ref().and_then(|u| of(u).get(k)).copied();
        let instance = kind.places.iter().position(|p| letter(p.label, |u| &u.units) == Some(b'#'));
        let numbers: Vec<Option<i64>> = match instance {
            Some(k) => kind.columns[k].iter().map(|v| Some(*v as i64)).collect(),
            None => vec![None; kind.offsets.len()],
        };
        let mut distinct = numbers.clone();
        distinct.sort_unstable();
        distinct.dedup();
        let time = kind.labels.iter().position(|l| l == "TimeUS" || l == "TimeMS");
        let time = time.and_then(|label| kind.places.iter().position(|p| p.label == label));
        for number in distinct {
            let name = number.map_or_else(|| kind.name.clone(), |n| format!("{}[{n}]", kind.name));
            let mut rows = Vec::new();
            let mut last = f64::NEG_INFINITY;
            for row in (0..numbers.len()).filter(|row| numbers[*row] == number) {
                let now = time.map_or(f64::INFINITY, |k| kind.columns[k][row]);
                if now < last {
                    let what = format!("the time of `{name}` falls from {last} to {now}; the message is left out");
                    self.blame(kind.offsets[row], what);
                    continue;
                }
                last = now;
                rows.push(row);
            }
            let field = |(place, column): (&Place, &Vec<f64>)| {
                let label = &kind.labels[place.label];
                let unit = match label.as_str() {
                    "TimeUS" => Some("us".into()),
                    "TimeMS" => Some("ms".into()),
                    _ => self.unit(letter(place.label, |u| &u.units), letter(place.label, |u| &u.factors), place.scale),
                };
                Field::new(label.clone(), unit.as_deref(), rows.iter().map(|r| column[*r]).collect())
            };
            let fields = kind.places.iter().zip(&kind.columns).map(field).collect();
            topics.push(Topic { name, time, fields });
        }
    }

    /// The unit of a field; none where the factor beside it is not that of the letter of its format.
    fn unit(&self, unit: Option<u8>, factor: Option<u8>, scale: Scale) -> Option<String> {
        let label = self.units.get(&unit?)?;
        let factor = self.factors.get(&factor?).copied().filter(|f| *f != 0.0).unwrap_or(1.0);
        let own = match scale {
            Scale::One => 1.0,
            Scale::Hundredth => 0.01,
            Scale::TenMillionth => 1e-7,
        };
        let label = match label.as_str() {
            "degheading" | "deglatitude" | "deglongitude" => "deg",
            "UNKNOWN" | "instance" | "" => return None,
            known => known,
        };
        (factor == own).then(|| label.to_string())
    }
}

/// Bytes of a letter of a format, and what number they hold.
fn letter_of(letter: u8) -> Option<(usize, Option<Number>, Scale)> {
    let number = |n: Number| Some((n.size(), Some(n), Scale::One));
    let hundredths = |n: Number| Some((n.size(), Some(n), Scale::Hundredth));
    match letter {
        b'b' => number(Number::I8),
        b'B' | b'M' => number(Number::U8),
        b'h' => number(Number::I16),
        b'H' => number(Number::U16),
        b'i' => number(Number::I32),
        b'I' => number(Number::U32),
        b'q' => number(Number::I64),
        b'Q' => number(Number::U64),
        b'g' => number(Number::F16),
        b'f' => number(Number::F32),
        b'd' => number(Number::F64),
        b'c' => hundredths(Number::I16),
        b'C' => hundredths(Number::U16),
        b'e' => hundredths(Number::I32),
        b'E' => hundredths(Number::U32),
        b'L' => Some((4, Some(Number::I32), Scale::TenMillionth)),
        b'n' => Some((4, None, Scale::One)),
        b'N' => Some((16, None, Scale::One)),
        b'Z' | b'a' => Some((64, None, Scale::One)),
        _ => None,
    }
}
