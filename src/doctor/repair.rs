//! What mends a fault, and the map that holds it.

use crate::record::Record;
use fdm_system::record::frame::Frame;
use fdm_system::record::{ChannelMap, RecordMap};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What mends a fault: lines of a map where a map can, words otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Repair {
    /// As it is typed, or in words.
    pub line: String,
    /// What changes in the map, by channel.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub channels: BTreeMap<String, Change>,
    /// An even grid, in samples per unit of time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// Unit of the time column.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_unit: Option<String>,
    /// The frame that vectors are turned from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<Frame>,
}

/// What changes of one channel: its value becomes `factor*value + offset`, later by `delay`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Factor, with its sign.
    pub factor: f64,
    /// Added behind the factor.
    pub offset: f64,
    /// How much later than the motion the samples are stamped.
    pub delay: f64,
    /// The period of a wrapped angle.
    pub wrap: Option<f64>,
    /// The column that the channel is read from in the place of its own.
    pub from: Option<String>,
    /// Whether the input keeps its value between samples; none where that stays as it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<bool>,
}

impl Default for Change {
    fn default() -> Self {
        Self { factor: 1.0, offset: 0.0, delay: 0.0, wrap: None, from: None, hold: None }
    }
}

impl Repair {
    /// In words alone.
    pub fn words(line: &str) -> Self {
        Self { line: line.into(), channels: BTreeMap::new(), rate: None, time_unit: None, frame: None }
    }

    /// All vectors turned from a frame.
    pub(crate) fn frame(frame: Frame) -> Self {
        Self { frame: Some(frame), ..Self::words(&format!("frame = \"{frame}\"")) }
    }

    /// With more words.
    pub(crate) fn line_with(mut self, more: &str) -> Self {
        self.line.push_str(more);
        self
    }

    pub(crate) fn with_rate(mut self, rate: f64) -> Self {
        self.line = format!("{}{rate:?}", self.line);
        self.rate = Some(rate);
        self
    }

    /// Changes of channels, which are the lines of the map too.
    pub(crate) fn map(changes: impl IntoIterator<Item = (String, Change)>) -> Self {
        let channels: BTreeMap<String, Change> = changes.into_iter().collect();
        let lines = channels.iter().map(|(name, change)| {
            let mut parts = Vec::new();
            parts.extend(change.from.as_ref().map(|from| format!("from = {from:?}")));
            if change.factor == -1.0 {
                parts.push("sign = -1".into());
            } else if change.factor != 1.0 {
                parts.push(format!("scale = {:?}", change.factor));
            }
            if change.offset != 0.0 {
                parts.push(format!("offset = {:?}", change.offset));
            }
            if change.delay != 0.0 {
                parts.push(format!("delay = {:?}", change.delay));
            }
            parts.extend(change.hold.map(|held| format!("hold = {held}")));
            parts.extend(change.wrap.map(|w| format!("wrap = {w:?}")));
            format!("[channel.{name}] {}", parts.join(", "))
        });
        Self { line: lines.collect::<Vec<_>>().join("; "), channels, ..Self::words("") }
    }
}

/// A map with the repairs in it, upon the map that the record was read by or, without one, its columns as they are. Numbers of a channel
/// whose column states a unit are changed in that unit.
pub fn repaired_map<'a>(
    record: &Record,
    before: Option<&RecordMap>,
    repairs: impl IntoIterator<Item = &'a Repair>,
) -> RecordMap {
    let mut map = before.cloned().unwrap_or_default();
    if map.about.is_empty() {
        map.about = "repairs proposed by fdm doctor".into();
    }
    for channel in &record.channels {
        map.channel.entry(channel.name.clone()).or_insert_with(|| ChannelMap::plain(&channel.column));
    }
    let repairs: Vec<&Repair> = repairs.into_iter().collect();
    map.frame = map.frame.or(repairs.iter().find_map(|r| r.frame));
    let names: Vec<&str> = record.channels.iter().map(|c| c.name.as_str()).collect();
    let made = map.frame.map(|frame| frame.turned(&names).0).unwrap_or_default();
    for repair in repairs {
        let columns: BTreeMap<String, ChannelMap> = map.channel.clone();
        map.time.rate = repair.rate.or(map.time.rate);
        map.time.unit = repair.time_unit.clone().or(map.time.unit);
        for (name, change) in &repair.channels {
            // what is wrong with a channel in the axes that are meant is mended in those of the file
            let source = made.iter().find(|t| names[t.channel] == name).and_then(|t| t.of.first());
            let (name, sign) = source.map_or((name.as_str(), 1.0), |(k, factor)| (names[*k], *factor));
            let Some(channel) = map.channel.get_mut(name) else { continue };
            if let Some(other) = change.from.as_ref().and_then(|from| columns.get(from)) {
                *channel = other.clone();
            }
            let scale = record.channels.iter().find(|c| c.name == name).map_or(1.0, |c| c.scale);
            if change.factor < 0.0 {
                channel.sign = -channel.sign;
            }
            channel.scale *= change.factor.abs();
            channel.offset = change.factor * channel.offset + sign * change.offset / scale;
            channel.delay += change.delay;
            channel.wrap = change.wrap.or(channel.wrap);
            channel.hold = change.hold.or(channel.hold);
        }
    }
    map
}
