//! Maps: from which field each channel of a model is read, and how its numbers become the channel's.

use crate::frame::Frame;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A map, as `map.toml` holds it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordMap {
    /// What it is for.
    #[serde(default)]
    pub about: String,
    /// The axes in which vectors stand; they are turned into north-east-down and forward-right-down. None: they stand there.
    #[serde(default)]
    pub frame: Option<Frame>,
    /// The times of the samples.
    #[serde(default)]
    pub time: TimeMap,
    /// The channels by name.
    #[serde(default)]
    pub channel: BTreeMap<String, ChannelMap>,
    /// Clocks that are off, by the topics whose times are theirs.
    #[serde(default)]
    pub clock: BTreeMap<String, ClockMap>,
}

/// The clock of a topic: a sample that it stamps with `s` was taken at `s - offset - drift*(s - s0)`, where `s0` is its first stamp.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClockMap {
    /// Field of the topic that says when a sample was taken, where its time says when it was published: that time where a log has no such field.
    #[serde(default)]
    pub from: Option<String>,
    /// How much later than the motion its first sample is stamped, in seconds.
    #[serde(default)]
    pub offset: f64,
    /// How much later the stamps become with each second.
    #[serde(default)]
    pub drift: f64,
}

impl ClockMap {
    /// Sets stamps (N) right, in seconds.
    pub(crate) fn correct(&self, stamps: &mut [f64]) {
        let first = stamps.first().copied().unwrap_or_default();
        stamps.iter_mut().for_each(|s| *s -= self.offset + self.drift * (*s - first));
    }
}

/// A delay that is estimated, beside the one that is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FreeDelay {
    /// Lower bound in seconds; 0 or below.
    pub lower: f64,
    /// Upper bound in seconds; 0 or above.
    pub upper: f64,
    /// Whether each run has its own.
    #[serde(default)]
    pub per_run: bool,
}

/// Which times the samples have.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeMap {
    /// Field of the time, where the format does not say it.
    #[serde(default)]
    pub from: Option<String>,
    /// Its unit, where the file does not state it: s, ms, us, ns, min or h.
    #[serde(default)]
    pub unit: Option<String>,
    /// Topic at whose times the samples are, or `all` for the times of every sensor.
    #[serde(default)]
    pub samples: Option<String>,
    /// An even grid instead, in samples per second.
    #[serde(default)]
    pub rate: Option<f64>,
    /// The instant that is the model's time 0, in the times of the samples [default: the first sample].
    #[serde(default)]
    pub begin: Option<f64>,
    /// Longest time without a sample that is bridged, in seconds [default: ten intervals of the topic].
    #[serde(default)]
    pub longest_gap: Option<f64>,
}

/// One channel: its value is `sign*scale*number + offset`, in `unit`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelMap {
    /// `topic.field`, or the field alone in a file of one table.
    pub from: String,
    /// Unit of the value [default: that of the field].
    #[serde(default)]
    pub unit: Option<String>,
    /// 1 or -1.
    #[serde(default = "one")]
    pub sign: f64,
    /// Factor.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added behind sign and factor.
    #[serde(default)]
    pub offset: f64,
    /// Whether a value holds until the next, as commands do, or is linear between samples, as of sensors; unknown where neither is said.
    #[serde(default)]
    pub hold: Option<bool>,
    /// How much later than the motion the samples are stamped, in seconds.
    #[serde(default)]
    pub delay: f64,
    /// What of the delay is estimated: an amount in seconds beyond `delay`.
    #[serde(default)]
    pub free_delay: Option<FreeDelay>,
    /// Period at which the numbers of the field jump back, such as 360 for a heading in degrees: the jumps are taken out.
    #[serde(default)]
    pub wrap: Option<f64>,
    /// Whether a log without the field is taken all the same.
    #[serde(default)]
    pub optional: bool,
    /// What to do where the topic was not logged.
    #[serde(default)]
    pub missing: Option<String>,
}

fn one() -> f64 {
    1.0
}

impl ChannelMap {
    /// A field as it is.
    pub fn plain(from: &str) -> Self {
        Self {
            from: from.into(),
            unit: None,
            sign: 1.0,
            scale: 1.0,
            offset: 0.0,
            hold: None,
            delay: 0.0,
            free_delay: None,
            wrap: None,
            optional: false,
            missing: None,
        }
    }

    /// Whether a value is known to hold until the next.
    pub fn holds(&self) -> bool {
        self.hold == Some(true)
    }

    /// A number of the field as the channel's.
    pub fn convert(&self, number: f64) -> f64 {
        if self.is_as_it_is() { number } else { self.sign * self.scale * number + self.offset }
    }

    /// Whether numbers are left as they are.
    pub(crate) fn is_as_it_is(&self) -> bool {
        self.sign == 1.0 && self.scale == 1.0 && self.offset == 0.0
    }
}

/// A text that is no map.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MapError {
    /// It is no TOML, or has keys that a map does not have.
    #[error("{0}")]
    Text(String),
    /// A value that makes no sense.
    #[error("{key} = {found}: expected {expected}")]
    Value {
        /// The key.
        key: String,
        /// What it holds.
        found: String,
        /// What it may hold.
        expected: &'static str,
    },
}

/// The maps that come with the program, by name.
const SHIPPED: [(&str, &str); 5] = [
    ("px4", include_str!("maps/px4.toml")),
    ("px4-rate", include_str!("maps/px4-rate.toml")),
    ("ardupilot", include_str!("maps/ardupilot.toml")),
    ("ardupilot-rate", include_str!("maps/ardupilot-rate.toml")),
    ("fti", include_str!("maps/fti.toml")),
];

/// The text of a map that comes with the program, and the names of all.
pub fn shipped(name: &str) -> (Option<&'static str>, [&'static str; 5]) {
    (SHIPPED.iter().find(|(known, _)| *known == name).map(|(_, text)| *text), SHIPPED.map(|(known, _)| known))
}

impl RecordMap {
    /// Reads a map.
    ///
    /// # Errors
    /// [`MapError`] of the first thing that a map does not have.
    #[cfg(feature = "maps")]
    pub fn parse(text: &str) -> Result<Self, MapError> {
        let map: Self = toml::from_str(text).map_err(|e| MapError::Text(e.to_string().trim_end().into()))?;
        let wrong =
            |key: String, found: f64, expected| Err(MapError::Value { key, found: found.to_string(), expected });
        let positive = |v: f64| v.is_finite() && v > 0.0;
        for (key, value) in [("rate", map.time.rate), ("longest_gap", map.time.longest_gap)] {
            if let Some(value) = value.filter(|v| !positive(*v)) {
                return wrong(format!("time.{key}"), value, "a number above zero");
            }
        }
        if let Some(begin) = map.time.begin.filter(|b| !b.is_finite()) {
            return wrong("time.begin".into(), begin, "a time");
        }
        if let Some(unit) = map.time.unit.as_ref().filter(|u| crate::log::in_seconds(u).is_none()) {
            return Err(MapError::Value {
                key: "time.unit".into(),
                found: unit.clone(),
                expected: "s, ms, us, ns, min or h",
            });
        }
        if map.channel.is_empty() {
            let (key, found) = ("channel".into(), "nothing".into());
            return Err(MapError::Value {
                key,
                found,
                expected: "at least one `[channel.NAME]` with `from = \"TOPIC.FIELD\"`",
            });
        }
        let names: Vec<&str> = map.channel.keys().map(String::as_str).collect();
        if let Some(frame) = map.frame.filter(|f| f.turned(&names) == (Vec::new(), Vec::new())) {
            return Err(MapError::Value {
                key: "frame".into(),
                found: format!("\"{frame}\""),
                expected: "channels that it turns: x, y, z; vx, vy, vz; u, v, w; phi, theta, psi; q0 to q3; p, q, r; ax, ay, az",
            });
        }
        for (name, channel) in &map.channel {
            let key = |k: &str| format!("channel.{name}.{k}");
            if channel.sign.abs() != 1.0 {
                return wrong(key("sign"), channel.sign, "1 or -1");
            }
            if !channel.scale.is_finite() || channel.scale == 0.0 {
                return wrong(key("scale"), channel.scale, "a number that is not zero");
            }
            if !channel.offset.is_finite() || !channel.delay.is_finite() {
                return wrong(key("offset or delay"), f64::NAN, "numbers");
            }
            if let Some(free) = channel.free_delay {
                let FreeDelay { lower, upper, .. } = free;
                if !(lower.is_finite() && upper.is_finite() && lower <= 0.0 && 0.0 <= upper && lower < upper) {
                    return Err(MapError::Value {
                        key: key("free_delay"),
                        found: format!("{lower} to {upper}"),
                        expected: "bounds around 0 in seconds, such as { lower = 0, upper = 0.2 }",
                    });
                }
            }
            if let Some(wrap) = channel.wrap.filter(|w| !positive(*w)) {
                return wrong(key("wrap"), wrap, "a number above zero, such as 360");
            }
        }
        for (name, clock) in &map.clock {
            if !clock.offset.is_finite() || !clock.drift.is_finite() || clock.drift >= 1.0 {
                return Err(MapError::Value {
                    key: format!("clock.{name}"),
                    found: format!("offset {}, drift {}", clock.offset, clock.drift),
                    expected: "seconds, and a drift below one second a second",
                });
            }
        }
        Ok(map)
    }

    /// The map as text.
    pub fn text(&self) -> String {
        toml_text(self)
    }
}

/// A map as it is written by hand: what is as it is by default is left out.
fn toml_text(map: &RecordMap) -> String {
    let mut text = String::new();
    let mut line = |l: String| {
        text.push_str(&l);
        text.push('\n');
    };
    if !map.about.is_empty() {
        line(format!("about = {:?}\n", map.about));
    }
    map.frame.iter().for_each(|frame| line(format!("frame = \"{frame}\"\n")));
    if map.time != TimeMap::default() {
        line("[time]".into());
        for (key, value) in [("from", &map.time.from), ("unit", &map.time.unit), ("samples", &map.time.samples)] {
            value.iter().for_each(|v| line(format!("{key} = {v:?}")));
        }
        for (key, value) in [("rate", map.time.rate), ("longest_gap", map.time.longest_gap), ("begin", map.time.begin)]
        {
            value.iter().for_each(|v| line(format!("{key} = {v:?}")));
        }
        line(String::new());
    }
    let key = |table: &str, name: &str| {
        let plain = name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-');
        if plain { format!("[{table}.{name}]") } else { format!("[{table}.{name:?}]") }
    };
    for (name, clock) in &map.clock {
        line(key("clock", name));
        clock.from.iter().for_each(|from| line(format!("from = {from:?}")));
        line(format!("offset = {:?}\ndrift = {:?}\n", clock.offset, clock.drift));
    }
    for (name, channel) in &map.channel {
        line(key("channel", name));
        line(format!("from = {:?}", channel.from));
        channel.unit.iter().for_each(|u| line(format!("unit = {u:?}")));
        for (key, value, default) in [
            ("sign", channel.sign, 1.0),
            ("scale", channel.scale, 1.0),
            ("offset", channel.offset, 0.0),
            ("delay", channel.delay, 0.0),
        ] {
            if value != default {
                line(format!("{key} = {value:?}"));
            }
        }
        if let Some(FreeDelay { lower, upper, per_run }) = channel.free_delay {
            let own = if per_run { ", per_run = true" } else { "" };
            line(format!("free_delay = {{ lower = {lower:?}, upper = {upper:?}{own} }}"));
        }
        channel.wrap.iter().for_each(|w| line(format!("wrap = {w:?}")));
        channel.hold.iter().for_each(|hold| line(format!("hold = {hold}")));
        if channel.optional {
            line("optional = true".into());
        }
        channel.missing.iter().for_each(|m| line(format!("missing = {m:?}")));
        line(String::new());
    }
    text
}
