//! Edits of a record, each of which would mend a fault: what they make of its columns, of a run, and of a map.

use crate::record::{Record, Role};
use crate::repair::{Change, Repair};
use fdm_grammar::Model;
use fdm_system::record::frame::whole_turn;
use fdm_system::record::{Incomplete, Run};
use std::borrow::Cow;

/// A channel of a record: what it is to the model, or a column that the model does not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Slot {
    /// An input of the model.
    Input(usize),
    /// An output of the model.
    Output(usize),
    /// A column that the model does not read.
    Other(usize),
}

/// One change of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Edit {
    /// `factor*value + offset`.
    Affine(Slot, f64, f64),
    /// Two channels change places.
    Swap(Slot, Slot),
    /// The samples are stamped so much later than the motion.
    Delay(Slot, f64),
    /// The clock of the channel gains so much of every unit of time.
    Drift(Slot, f64),
    /// Constant that is added from a time on.
    Step(Slot, f64, f64),
    /// The channel went through a first-order lag of this time constant. Of an output the model's response goes through it too;
    /// in kinematics the other channels do, so that all are alike again: for a linear motion there is no difference.
    Filter(Slot, f64),
    /// All times are multiplied.
    Time(f64),
    /// An input keeps its value between samples, or goes in straight lines.
    Hold(Slot, bool),
}

/// Names and units of the channels of a record: inputs, outputs, then the columns that no model reads.
pub struct Channels {
    names: Vec<String>,
    units: Vec<Option<String>>,
    stated: Vec<bool>,
    /// A whole turn of each, were it an angle.
    turns: Vec<f64>,
    /// How many drive the model.
    pub inputs: usize,
    /// How many are compared with it.
    pub outputs: usize,
}

impl Channels {
    /// Of records with the same channels; a unit counts as stated where all files state it.
    pub fn of(records: &[Record]) -> Self {
        let first = records.first().map_or(&[][..], |r| &r.channels[..]);
        let count = |role| first.iter().filter(|c| c.role == role).count();
        let stated = |k: usize| records.iter().all(|r| r.channels.get(k).is_none_or(|c| c.stated));
        Self {
            names: first.iter().map(|c| c.name.clone()).collect(),
            units: first.iter().map(|c| c.unit.clone().filter(|u| u != "1")).collect(),
            stated: (0..first.len()).map(stated).collect(),
            turns: first.iter().map(|c| whole_turn(c.unit.as_deref(), &c.values)).collect(),
            inputs: count(Role::Input),
            outputs: count(Role::Output),
        }
    }

    /// All of them.
    pub fn slots(&self) -> impl Iterator<Item = Slot> + use<> {
        let (inputs, outputs) = (self.inputs, self.outputs);
        (0..self.names.len()).map(move |k| match k {
            k if k < inputs => Slot::Input(k),
            k if k < inputs + outputs => Slot::Output(k - inputs),
            k => Slot::Other(k - inputs - outputs),
        })
    }

    /// Place of a slot among the channels of a record.
    pub fn place(&self, slot: Slot) -> usize {
        match slot {
            Slot::Input(k) => k,
            Slot::Output(k) => self.inputs + k,
            Slot::Other(k) => self.inputs + self.outputs + k,
        }
    }

    /// Its name.
    pub fn name(&self, slot: Slot) -> &str {
        &self.names[self.place(slot)]
    }

    /// Its unit, where it has one.
    pub fn unit(&self, slot: Slot) -> Option<&str> {
        self.units[self.place(slot)].as_deref()
    }

    /// All names, in the order of their places.
    pub(crate) fn names(&self) -> Vec<&str> {
        self.names.iter().map(String::as_str).collect()
    }

    /// A whole turn in its unit, were it an angle.
    pub(crate) fn whole_turn(&self, slot: Slot) -> f64 {
        self.turns[self.place(slot)]
    }

    /// Whether all files state its unit.
    pub fn is_stated(&self, slot: Slot) -> bool {
        self.stated[self.place(slot)]
    }

    /// What mends a run, as lines of a map.
    pub fn repair(&self, edits: &[Edit]) -> Repair {
        let mut time = None;
        // what each channel that is touched is made of, edit by edit: an exchange takes along what was done before it
        let mut changes: Vec<(Slot, Change)> = Vec::new();
        let of = |changes: &mut Vec<(Slot, Change)>, slot: Slot| {
            changes.iter().position(|(s, _)| *s == slot).unwrap_or_else(|| {
                changes.push((slot, Change { from: Some(self.name(slot).into()), ..Change::default() }));
                changes.len() - 1
            })
        };
        for edit in edits {
            match *edit {
                Edit::Affine(slot, factor, offset) => {
                    let k = of(&mut changes, slot);
                    let change = &mut changes[k].1;
                    (change.factor, change.offset) = (factor * change.factor, factor * change.offset + offset);
                }
                Edit::Delay(slot, delay) => {
                    let k = of(&mut changes, slot);
                    changes[k].1.delay += delay;
                }
                Edit::Swap(a, b) => {
                    let (a, b) = (of(&mut changes, a), of(&mut changes, b));
                    let one = changes[a].1.clone();
                    changes[a].1 = std::mem::replace(&mut changes[b].1, one);
                }
                Edit::Drift(slot, rate) => {
                    let words = format!(
                        "multiply the times of `{}` by {:.6}: its clock is another one",
                        self.name(slot),
                        1.0 - rate
                    );
                    return Repair::words(&words);
                }
                Edit::Step(slot, at, by) => {
                    return Repair::words(&format!(
                        "add {by:.4} to `{}` from {at:.4} on, or fit the parts before and behind as runs of their own: --from, --to",
                        self.name(slot)
                    ));
                }
                Edit::Filter(slot, lag) => {
                    let name = self.name(slot);
                    return Repair::words(&format!(
                        "give the model the filter: state {name}_f; der({name}_f) = (x - {name}_f)/{lag:.4}, where `{name}` measures x"
                    ));
                }
                Edit::Time(factor) => time = Some(factor),
                Edit::Hold(slot, held) => {
                    let k = of(&mut changes, slot);
                    changes[k].1.hold = Some(held);
                }
            }
        }
        let changes = changes.into_iter().filter_map(|(slot, mut change)| {
            let name = self.name(slot);
            change.from = change.from.filter(|from| from != name);
            (change != Change::default()).then(|| (name.to_string(), change))
        });
        match time {
            Some(factor) => {
                let unit = [(1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"), (60.0, "min"), (3600.0, "h")]
                    .iter()
                    .find(|(f, _)| (factor / f - 1.0).abs() < 1e-9)
                    .map(|(_, unit)| *unit);
                let mut repair = Repair::words(&match unit {
                    Some(unit) => format!("[time] unit = {unit:?}"),
                    None => format!("multiply the times by {factor}"),
                });
                repair.time_unit = unit.map(String::from);
                repair
            }
            None => Repair::map(changes),
        }
    }
}

/// A record as edits make it. Only what changes is copied.
pub(crate) struct Edited<'a> {
    pub(crate) time: Cow<'a, [f64]>,
    pub(crate) columns: Vec<Cow<'a, [f64]>>,
}

/// Time constants after which a lag has forgotten where it began, but for less than a hundredth.
const FORGOTTEN: f64 = 5.0;

/// A record as the edits make it; `held` says which inputs keep their value between samples.
pub(crate) fn edited_record<'a>(record: &'a Record, channels: &Channels, edits: &[Edit], held: &[bool]) -> Edited<'a> {
    let mut columns: Vec<Cow<'a, [f64]>> = record.channels.iter().map(|c| Cow::Borrowed(&c.values[..])).collect();
    let mut time = Cow::Borrowed(&record.time[..]);
    for edit in edits {
        match *edit {
            Edit::Affine(slot, factor, offset) => {
                columns[channels.place(slot)].to_mut().iter_mut().for_each(|v| *v = factor * *v + offset);
            }
            Edit::Swap(a, b) => columns.swap(channels.place(a), channels.place(b)),
            Edit::Delay(slot, tau) => {
                let column = &mut columns[channels.place(slot)];
                *column = Cow::Owned(shifted(&time, column, slot, held, |_| tau));
            }
            Edit::Drift(slot, rate) => {
                let column = &mut columns[channels.place(slot)];
                *column = Cow::Owned(shifted(&time, column, slot, held, |t| rate * t));
            }
            Edit::Step(slot, at, by) => {
                let column = columns[channels.place(slot)].to_mut();
                column.iter_mut().zip(time.iter()).filter(|(_, t)| **t >= at).for_each(|(v, _)| *v += by);
            }
            Edit::Filter(slot, lag) => {
                let own = channels.place(slot);
                for (k, column) in columns.iter_mut().enumerate().filter(|(k, _)| *k != own) {
                    let held = held.get(k).copied().unwrap_or(false);
                    let mut slow = lagged(&time, column, lag, held);
                    // nobody knows where the filter stood before the record; inputs are taken for at rest
                    if k >= channels.inputs {
                        let known = time[0] + FORGOTTEN * lag;
                        slow.iter_mut().zip(time.iter()).filter(|(_, t)| **t < known).for_each(|(v, _)| *v = f64::NAN);
                    }
                    *column = Cow::Owned(slow);
                }
            }
            Edit::Time(factor) => time.to_mut().iter_mut().for_each(|t| *t *= factor),
            Edit::Hold(..) => (),
        }
    }
    Edited { time, columns }
}

/// What edits multiply the times by.
pub fn time_factor(edits: &[Edit]) -> f64 {
    edits.iter().map(|e| if let Edit::Time(factor) = *e { factor } else { 1.0 }).product()
}

/// A run as the edits of its record make it, with the inputs that the model computes from its records. What a channel went through is
/// left to the response.
///
/// # Errors
/// As [`Run::with_measured`].
pub fn edited(
    run: &Run,
    record: &Record,
    channels: &Channels,
    edits: &[Edit],
    model: &Model,
) -> Result<Run, Incomplete> {
    let mut new = run.clone();
    let of_samples: Vec<Edit> = edits.iter().filter(|e| !matches!(e, Edit::Filter(..))).copied().collect();
    let edits = &of_samples[..];
    let edited = edited_record(record, channels, edits, &run.held);
    for slot in channels.slots().take(channels.inputs + channels.outputs) {
        if let Cow::Owned(values) = &edited.columns[channels.place(slot)] {
            put(&mut new, slot, values);
        }
    }
    for edit in edits {
        if let Edit::Hold(Slot::Input(k), held) = *edit {
            new.held[k] = held;
        }
        if let Edit::Swap(a, b) = *edit {
            // exchanged columns may both be borrowed
            for slot in [a, b] {
                put(&mut new, slot, &edited.columns[channels.place(slot)]);
            }
        }
    }
    new.time = edited.time.into_owned();
    if model.inputs.len() > channels.inputs { new.with_measured(model) } else { Ok(new) }
}

/// Over an interval, the answer of a first-order lag to what is linear between samples: `a` of its own value, `c - a` of the first value and
/// `1 - c` of the second.
pub fn lag_weights(time_constant: f64, interval: f64) -> (f64, f64) {
    let ratio = interval / time_constant;
    let a = (-ratio).exp();
    (a, if ratio < 1e-6 { 1.0 - 0.5 * ratio } else { -(-ratio).exp_m1() / ratio })
}

/// A channel behind a first-order lag that begins at rest. Linear between samples, or held; gaps stay.
pub(crate) fn lagged(time: &[f64], values: &[f64], time_constant: f64, held: bool) -> Vec<f64> {
    let mut before: Option<(f64, f64, f64)> = None;
    let answer = |(t, x): (&f64, &f64)| {
        if !x.is_finite() {
            return *x;
        }
        let y = before.map_or(*x, |(t0, x0, y0)| {
            let (a, c) = lag_weights(time_constant, t - t0);
            if held { a * y0 + (1.0 - a) * x0 } else { a * y0 + (c - a) * x0 + (1.0 - c) * x }
        });
        before = Some((*t, *x, y));
        y
    };
    time.iter().zip(values).map(answer).collect()
}

/// Puts samples in the place of a channel's.
pub(crate) fn put(run: &mut Run, slot: Slot, values: &[f64]) {
    let (rows, k, width) = match slot {
        Slot::Input(k) => (&mut run.inputs, k, run.held.len()),
        Slot::Output(k) => (&mut run.measured, k, run.output_gaps.len()),
        Slot::Other(_) => return,
    };
    rows.iter_mut().skip(k).step_by(width.max(1)).zip(values).for_each(|(v, new)| *v = *new);
}

/// The value at `t + delay(t)` in place of that at `t`: linear, or held as the input is. Outputs beyond the record are gaps, inputs stay.
fn shifted(time: &[f64], values: &[f64], slot: Slot, held: &[bool], delay: impl Fn(f64) -> f64) -> Vec<f64> {
    let held = matches!(slot, Slot::Input(k) if held.get(k).copied().unwrap_or(false));
    let (first, last) = (time[0], time[time.len() - 1]);
    let mut cursor = fdm_system::record::Cursor::default();
    let value = |t: &f64| {
        let at = t + delay(*t);
        if !matches!(slot, Slot::Input(_)) && (at < first || at > last) {
            return f64::NAN;
        }
        let place = cursor.at(time, at);
        let left = values[place.left];
        if place.rate == 0.0 || held { left } else { left + place.part * (values[place.left + 1] - left) }
    };
    time.iter().map(value).collect()
}
