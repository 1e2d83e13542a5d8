//! Columns over one time from topics with clocks of their own, by a map.
//!
//! A sensor is never shown more often than it was sampled: on times that are not its own it stands, interpolated between its neighbours, at
//! the one nearest to each of its samples. Commands hold, and other inputs are linear. Nothing is bridged over a gap.

use crate::frame::{Frame, NoComponent, whole_turn};
use crate::log::{Field, Log, Topic, in_seconds};
use crate::map::{ChannelMap, RecordMap};

/// Columns over one time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Taken {
    /// The times in seconds (N), rising; none where the file has no time.
    pub time: Option<Vec<f64>>,
    /// The columns.
    pub columns: Vec<TakenColumn>,
    /// Channels of the map that the file does not have, and need not.
    pub absent: Vec<String>,
    /// What was done and left out on the way.
    pub notes: Vec<String>,
}

/// A column that was taken.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TakenColumn {
    /// The channel.
    pub name: String,
    /// Its unit, where map or file state it.
    pub unit: Option<String>,
    /// Its values (N); NaN where it was not sampled.
    pub values: Vec<f64>,
    /// Whether a value holds until the next, or goes in straight lines; none where the map says neither.
    pub hold: Option<bool>,
    /// At which of the times a sensor was sampled (N); empty for what has a value at every time.
    pub sampled: Vec<bool>,
}

impl Taken {
    /// The columns as one table over their time.
    pub fn into_topic(self) -> Topic {
        let time = self.time.map(|values| Field::new("t", Some("s"), values));
        let columns = self.columns.into_iter().map(|c| Field::new(c.name, c.unit.as_deref(), c.values));
        Topic { time: time.as_ref().map(|_| 0), fields: time.into_iter().chain(columns).collect(), ..Topic::default() }
    }
}

/// Why a map does not fit a log.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TakeError {
    /// A channel whose field the log does not have.
    #[error("channel.{channel}.from = \"{from}\": the log has no such field{}", .hint.as_ref().map_or_else(String::new, |h| format!("; {h}")))]
    NoField {
        /// The channel.
        channel: String,
        /// What the map names.
        from: String,
        /// What may be meant, or done.
        hint: Option<String>,
    },
    /// A topic without a time, beside others.
    #[error("the topic `{0}` has no time that is known; name it by `[time] from = \"FIELD\"`")]
    NoTime(String),
    /// A topic named for its times that is not there.
    #[error("time.samples = \"{0}\": the log has no such topic among those of the channels")]
    NoTopic(String),
    /// A clock of a topic that is not there.
    #[error("clock.{0}: the log has no such topic")]
    NoClock(String),
    /// A vector that cannot be turned into the axes that are meant.
    #[error(transparent)]
    Frame(#[from] NoComponent),
    /// The topics do not overlap in time.
    #[error("the topics of the channels have no time in common")]
    Apart,
    /// Nothing is left to take.
    #[error("no channel of the map is wanted and in the log, which has {0}")]
    Nothing(String),
    /// A grid too fine to be meant.
    #[error("time.rate = {0}: the grid would have more than {1} samples")]
    TooMany(String, usize),
}

/// Most samples on an even grid.
const LARGEST: usize = 100_000_000;

/// One channel with the samples of its own.
struct Sampled<'a> {
    name: &'a str,
    map: &'a ChannelMap,
    unit: Option<String>,
    topic: usize,
    /// None where the file has no time.
    time: Option<Vec<f64>>,
    values: Vec<f64>,
    /// Whether it drives a model: then it has a value at every time.
    drives: bool,
}

/// Takes channels from a log. `wanted` says of a channel of the map whether it is taken, and if so whether it drives the model.
///
/// # Errors
/// Every channel whose field is not there, or what is wrong with the times.
pub fn take(log: &Log, map: &RecordMap, wanted: &dyn Fn(&str) -> Option<bool>) -> Result<Taken, Vec<TakeError>> {
    let (mut sampled, mut errors, mut absent, mut notes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (name, clock) in &map.clock {
        let is_off = clock.offset != 0.0 || clock.drift != 0.0;
        if is_off && !log.names().any(|topic| is_topic(topic, name)) {
            errors.push(TakeError::NoClock(name.clone()));
        }
    }
    let partners = partners(map, wanted);
    let needed =
        |name: &str| wanted(name).or_else(|| partners.iter().find(|(n, _)| n == name).map(|(_, drives)| *drives));
    for (name, channel) in &map.channel {
        let Some(drives) = needed(name) else { continue };
        let Some((topic, field)) = log.find(&channel.from) else {
            if channel.optional {
                absent.push(name.clone());
            } else {
                let (hint, from) = (hint(log, channel), channel.from.clone());
                errors.push(TakeError::NoField { channel: name.clone(), from, hint });
            }
            continue;
        };
        let field = &log.topics[topic].fields[field];
        match own_times(log, map, topic) {
            Ok(time) => sampled.push(own(name, channel, field, topic, time, drives || channel.holds(), &mut notes)),
            Err(e) => errors.push(e),
        }
    }
    errors.dedup();
    if !errors.is_empty() {
        return Err(errors);
    }
    let Some(first) = sampled.first() else { return Err(vec![TakeError::Nothing(names_in(log))]) };
    let one = sampled.iter().all(|s| s.topic == first.topic && s.map.delay == 0.0);
    if one && map.time.rate.is_none() {
        let time = first.time.clone();
        return turned(as_it_is(time, sampled, absent, notes), map.frame, wanted);
    }
    if let Some(s) = sampled.iter().find(|s| s.time.is_none()) {
        return Err(vec![TakeError::NoTime(log.topics[s.topic].name.clone())]);
    }
    let base = base(log, map, &sampled, &mut notes).map_err(|e| vec![e])?;
    turned(on_base(base, map, &sampled, absent, notes), map.frame, wanted)
}

/// Channels that are taken for others which are made of them, and whether those drive the model.
fn partners(map: &RecordMap, wanted: &dyn Fn(&str) -> Option<bool>) -> Vec<(String, bool)> {
    let names: Vec<&str> = map.channel.keys().map(String::as_str).collect();
    let (turned, _) = map.frame.map(|frame| frame.turned(&names)).unwrap_or_default();
    let of = |t: &crate::frame::Turned| {
        let drives = wanted(names[t.channel])?;
        Some(t.of.iter().map(|(k, _)| (names[*k].to_string(), drives)).collect::<Vec<_>>())
    };
    turned.iter().filter_map(of).flatten().collect()
}

/// Vectors in the axes that are meant, in place of those of the frame.
fn turned(
    mut taken: Taken,
    frame: Option<Frame>,
    wanted: &dyn Fn(&str) -> Option<bool>,
) -> Result<Taken, Vec<TakeError>> {
    let Some(frame) = frame else { return Ok(taken) };
    let names: Vec<&str> = taken.columns.iter().map(|c| c.name.as_str()).collect();
    let (all, lacking) = frame.turned(&names);
    let mut errors: Vec<TakeError> =
        lacking.into_iter().filter(|e| wanted(&e.channel).is_some()).map(TakeError::from).collect();
    let mut columns = taken.columns.clone();
    for turned in all.iter().filter(|t| wanted(names[t.channel]).is_some()) {
        let Some(first) = turned.of.first().map(|(k, _)| &taken.columns[*k]) else { continue };
        let own = &mut columns[turned.channel];
        let turns =
            if turned.turns == 0.0 { 0.0 } else { turned.turns * whole_turn(first.unit.as_deref(), &first.values) };
        let value = |s: usize| turned.of.iter().map(|(k, factor)| factor * taken.columns[*k].values[s]).sum::<f64>();
        own.values = (0..first.values.len()).map(|s| value(s) + turns).collect();
        (own.unit, own.hold, own.sampled) = (first.unit.clone(), first.hold, first.sampled.clone());
    }
    errors.dedup();
    if !errors.is_empty() {
        return Err(errors);
    }
    let changed: Vec<String> = all.iter().map(|t| format!("`{}`", names[t.channel])).collect();
    taken.notes.push(format!("{} are turned from {}", changed.join(", "), frame.words()));
    columns.retain(|c| wanted(&c.name).is_some());
    Ok(Taken { columns, ..taken })
}

/// The samples of a channel at its own times: those that say nothing are left out.
fn own<'a>(
    name: &'a str,
    map: &'a ChannelMap,
    field: &Field,
    topic: usize,
    time: Option<Vec<f64>>,
    drives: bool,
    notes: &mut Vec<String>,
) -> Sampled<'a> {
    let mut values = field.values.clone();
    if let Some(period) = map.wrap {
        let jumps = unwrap(&mut values, period);
        if jumps > 0 {
            notes.push(format!("`{name}`: {jumps} jump(s) of {period} are taken out"));
        }
    }
    values.iter_mut().for_each(|v| *v = map.convert(*v));
    let unit = map.unit.clone().or_else(|| field.unit.clone().filter(|_| map.scale == 1.0));
    let time = time.map(|time| time.iter().map(|t| t - map.delay).collect());
    Sampled { name, map, unit, topic, time, values, drives }
}

/// Takes out the jumps of an angle (N): from each finite value to the next it goes the short way round. Gives the number of jumps.
pub fn unwrap(values: &mut [f64], period: f64) -> usize {
    let (mut turns, mut before, mut jumps) = (0.0, f64::NAN, 0);
    for value in values.iter_mut().filter(|v| v.is_finite()) {
        let step = ((*value - before) / period).round();
        if step != 0.0 && step.is_finite() {
            turns -= step;
            jumps += 1;
        }
        before = *value;
        *value += turns * period;
    }
    jumps
}

/// Whether a topic is meant by a name: the first instance needs no number.
fn is_topic(topic: &str, name: &str) -> bool {
    topic == name || topic.strip_suffix("[0]") == Some(name)
}

/// The times of a topic in seconds; none for the only table of a file without times.
fn own_times(log: &Log, map: &RecordMap, topic: usize) -> Result<Option<Vec<f64>>, TakeError> {
    let unknown = || TakeError::NoTime(log.topics[topic].name.clone());
    let own = &log.topics[topic].name;
    let clock = map.clock.iter().find(|(name, _)| is_topic(own, name));
    let correct = |mut stamps: Vec<f64>| {
        clock.iter().for_each(|(_, clock)| clock.correct(&mut stamps));
        stamps
    };
    let named = map.time.from.as_ref().and_then(|from| log.find(from)).filter(|(t, _)| *t == topic);
    let sampled = clock.and_then(|(_, clock)| taken_at(&log.topics[topic], clock.from.as_ref()?));
    let usual = log.topics[topic].time;
    let mut table = Topic { time: named.map(|(_, f)| f).or(sampled).or(usual), ..Topic::default() };
    let Some(k) = table.time else {
        let alone = log.topics.iter().filter(|t| t.rows() > 1).count() == 1;
        return if alone && map.time.from.is_none() { Ok(None) } else { Err(unknown()) };
    };
    let mut field = log.topics[topic].fields[k].clone();
    // two stamps of one topic are of one clock
    let of_usual = || usual.and_then(|k| log.topics[topic].fields[k].unit.clone());
    field.unit = map.time.unit.clone().or(field.unit).or_else(of_usual);
    if field.unit.as_deref().is_some_and(|u| in_seconds(u).is_none()) {
        return Err(unknown());
    }
    (table.fields, table.time) = (vec![field], Some(0));
    table.seconds().map(|stamps| Some(correct(stamps))).ok_or_else(unknown)
}

/// The field of this name, where it holds stamps that rise.
fn taken_at(topic: &Topic, name: &str) -> Option<usize> {
    let field = topic.fields.iter().position(|f| f.name == name)?;
    let stamps = &topic.fields[field].values;
    let rise = stamps.windows(2).all(|w| w[0] <= w[1]) && stamps.first() < stamps.last();
    rise.then_some(field)
}

/// The first names of a log, for a message.
fn names_in(log: &Log) -> String {
    const SHOWN: usize = 12;
    let of_topic = |t: &Topic| {
        let fields: Vec<&str> = t.fields.iter().take(SHOWN).map(|f| f.name.as_str()).collect();
        let more = if t.fields.len() > SHOWN { ", .." } else { "" };
        let fields = format!("{}{more}", fields.join(", "));
        if t.name.is_empty() { fields } else { format!("`{}` ({fields})", t.name) }
    };
    let mut topics: Vec<String> = log.topics.iter().take(SHOWN).map(of_topic).collect();
    topics.extend((log.topics.len() > SHOWN).then(|| "..".to_string()));
    if topics.is_empty() { "no fields".into() } else { topics.join("; ") }
}

/// What may be done about a field that is not there.
fn hint(log: &Log, channel: &ChannelMap) -> Option<String> {
    let topic = channel.from.split('.').next().unwrap_or_default();
    let base = topic.split('[').next().unwrap_or_default();
    let fields = |there: &Topic| there.fields.iter().map(|f| f.name.as_str()).take(12).collect::<Vec<_>>().join(", ");
    // a table is one topic without a name
    if let [table] = &log.topics[..]
        && table.name.is_empty()
    {
        return Some(format!("its columns are {}", fields(table)));
    }
    if let Some(there) = log.topics.iter().find(|t| t.name == topic || t.name.split('[').next() == Some(base)) {
        return Some(format!("`{}` has {}", there.name, fields(there)));
    }
    channel.missing.clone().or_else(|| {
        let names: Vec<&str> = log.names().take(12).collect();
        Some(format!("its topics are {}", names.join(", ")))
    })
}

/// All channels of one topic, at its own times.
fn as_it_is(time: Option<Vec<f64>>, sampled: Vec<Sampled<'_>>, absent: Vec<String>, mut notes: Vec<String>) -> Taken {
    let rows = sampled.first().map_or(0, |s| s.values.len());
    let rises = |k: &usize| time.as_ref().is_none_or(|t| *k == 0 || t[*k] != t[*k - 1]);
    let kept: Vec<usize> = (0..rows).filter(rises).collect();
    if kept.len() < rows {
        notes.push(format!("{} sample(s) have the time of the one before and are left out", rows - kept.len()));
    }
    let of = |values: &[f64]| kept.iter().map(|k| values[*k]).collect::<Vec<f64>>();
    let columns = sampled.iter().map(|s| TakenColumn {
        name: s.name.into(),
        unit: s.unit.clone(),
        values: of(&s.values),
        hold: s.map.hold,
        sampled: Vec::new(),
    });
    Taken { columns: columns.collect(), time: time.as_ref().map(|t| of(t)), absent, notes }
}

/// The times that all channels are brought to.
fn base(log: &Log, map: &RecordMap, sampled: &[Sampled<'_>], notes: &mut Vec<String>) -> Result<Vec<f64>, TakeError> {
    let ends = |s: &Sampled<'_>| s.time.as_ref().and_then(|t| Some((*t.first()?, *t.last()?)));
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for (first, last) in sampled.iter().filter_map(ends) {
        // a command that is given once holds
        (from, to) = (from.max(first), to.min(last));
    }
    for s in sampled.iter().filter(|s| s.map.holds()) {
        let others =
            sampled.iter().filter(|o| !o.map.holds()).filter_map(ends).map(|e| e.1).fold(f64::INFINITY, f64::min);
        if ends(s).is_some_and(|(_, last)| last == to) && others.is_finite() {
            to = others;
        }
    }
    if from.partial_cmp(&to) != Some(std::cmp::Ordering::Less) {
        return Err(TakeError::Apart);
    }
    if let Some(rate) = map.time.rate {
        let count = ((to - from) * rate).floor();
        if count >= LARGEST as f64 {
            return Err(TakeError::TooMany(rate.to_string(), LARGEST));
        }
        notes.push(format!("the samples are on a grid of {rate} per second"));
        return Ok((0..=count as usize).map(|k| from + k as f64 / rate).collect());
    }
    let mut times: Vec<f64> = match map.time.samples.as_deref() {
        None | Some("all") => {
            let sensors = sampled.iter().any(|s| !s.drives);
            let shown = sampled.iter().filter(|s| !sensors || !s.drives);
            notes.push("the samples are at the times of every sensor; each sensor is compared at its own".into());
            shown.flat_map(|s| s.time.iter().flatten().copied()).collect()
        }
        Some(topic) => {
            let is = |s: &&Sampled<'_>| is_topic(&log.topics[s.topic].name, topic);
            let found = sampled.iter().find(is).ok_or_else(|| TakeError::NoTopic(topic.into()))?;
            notes.push(format!("the samples are at the times of `{topic}`"));
            found.time.iter().flatten().map(|t| t + found.map.delay).collect()
        }
    };
    let edges = sampled.iter().filter(|s| s.map.holds()).flat_map(edges);
    let sort = |times: &mut Vec<f64>| {
        times.retain(|t| (from..=to).contains(t));
        times.sort_by(f64::total_cmp);
        times.dedup();
    };
    sort(&mut times);
    let sensed = times.len();
    times.extend(edges);
    sort(&mut times);
    if times.len() > sensed {
        let between = times.len() - sensed;
        notes.push(format!("commands change at {between} more instant(s), where nothing is compared"));
    }
    Ok(times)
}

/// The instants at which a command changes: what holds is a function of time with edges of its own, wherever the sensors were sampled.
fn edges<'s>(s: &'s Sampled<'_>) -> impl Iterator<Item = f64> + 's {
    let time = s.time.as_deref().unwrap_or_default();
    let pairs = s.values.windows(2).zip(time.iter().skip(1));
    pairs.filter(|(values, _)| !values[1].is_nan() && values[0] != values[1]).map(|(_, t)| *t)
}

/// Brings all channels to common times.
fn on_base(
    base: Vec<f64>,
    map: &RecordMap,
    sampled: &[Sampled<'_>],
    absent: Vec<String>,
    mut notes: Vec<String>,
) -> Taken {
    let mut kept = vec![true; base.len()];
    let mut columns = Vec::new();
    for s in sampled {
        let time = s.time.as_deref().unwrap_or_default();
        let longest = map.time.longest_gap.unwrap_or_else(|| 10.0 * median(time).max(median(&base)));
        let mut values = vec![f64::NAN; base.len()];
        let mut gap: Option<(f64, f64)> = None;
        let sampled = if s.drives { Vec::new() } else { nearest(&base, time) };
        for (k, t) in base.iter().enumerate().filter(|(k, _)| s.drives || sampled[*k]) {
            let after = time.partition_point(|own| own <= t);
            let Some(left) = after.checked_sub(1) else { continue };
            let exact = time[left] == *t || after == time.len();
            let apart = if exact { 0.0 } else { time[after] - time[left] };
            if s.map.holds() || exact {
                values[k] = s.values[left];
            } else if apart <= longest {
                let part = (t - time[left]) / apart;
                values[k] = s.values[left] + part * (s.values[after] - s.values[left]);
            } else if s.drives {
                kept[k] = false;
                gap.get_or_insert((time[left], apart));
            }
        }
        if let Some((at, length)) = gap {
            notes.push(format!(
                "no sample of `{}` for {length:.6} s from {at:.6} s on; the samples in its gaps are left out",
                s.name
            ));
        }
        columns.push(TakenColumn { name: s.name.into(), unit: s.unit.clone(), values, hold: s.map.hold, sampled });
    }
    for c in &mut columns {
        (c.values, c.sampled) = (chosen(&c.values, &kept), chosen(&c.sampled, &kept));
    }
    Taken { time: Some(chosen(&base, &kept)), columns, absent, notes }
}

/// What is kept of a column.
fn chosen<T: Copy>(values: &[T], kept: &[bool]) -> Vec<T> {
    values.iter().zip(kept).filter(|(_, kept)| **kept).map(|(v, _)| *v).collect()
}

/// At which of the times a sensor is shown: those nearest to its samples.
fn nearest(base: &[f64], time: &[f64]) -> Vec<bool> {
    let mut shown = vec![false; base.len()];
    for t in time {
        let after = base.partition_point(|b| b < t);
        let near = match (after.checked_sub(1), base.get(after)) {
            (Some(left), Some(right)) if t - base[left] < right - t => Some(left),
            (_, Some(_)) => Some(after),
            (left, None) => left,
        };
        // a sample outside says nothing of the ends
        let inside = base.first().is_some_and(|first| t >= first) && base.last().is_some_and(|last| t <= last);
        near.filter(|_| inside).into_iter().for_each(|k| shown[k] = true);
    }
    shown
}

fn median(time: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}
