//! What may be wrong with the channels of a model's record, each as the edit of the run that would mend it.

use crate::finding::Fault;
use crate::record::{Record, Role};
use crate::repair::{Change, Repair};
use fdm_grammar::Model;
use fdm_system::record::{Incomplete, Run};
use std::borrow::Cow;
use std::f64::consts::PI;

/// A channel of a record: what it is to the model, or a column that the model does not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slot {
    Input(usize),
    Output(usize),
    Other(usize),
}

/// One change of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Edit {
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
    /// The channel went through a first-order lag of this time constant. Of an output the model's response goes through it too
    /// ([`lags_of`]); in kinematics the other channels do, so that all are alike again: for a linear motion there is no difference.
    Filter(Slot, f64),
    /// All times are multiplied.
    Time(f64),
}

/// A fault, and the edits that mend it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hypothesis {
    pub(crate) fault: Fault,
    pub(crate) slots: Vec<Slot>,
    pub(crate) edits: Vec<Edit>,
    /// In words.
    pub(crate) what: String,
    /// Its share of the prior probability of a fault, beside others of its kind.
    pub(crate) weight: f64,
}

/// Names and units of the channels of a record: inputs, outputs, then the columns that no model reads.
pub(crate) struct Channels {
    names: Vec<String>,
    units: Vec<Option<String>>,
    stated: Vec<bool>,
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
}

impl Channels {
    /// Of records with the same channels; a unit counts as stated where all files state it.
    pub(crate) fn of(records: &[Record]) -> Self {
        let first = records.first().map_or(&[][..], |r| &r.channels[..]);
        let count = |role| first.iter().filter(|c| c.role == role).count();
        let stated = |k: usize| records.iter().all(|r| r.channels.get(k).is_none_or(|c| c.stated));
        Self {
            names: first.iter().map(|c| c.name.clone()).collect(),
            units: first.iter().map(|c| c.unit.clone().filter(|u| u != "1")).collect(),
            stated: (0..first.len()).map(stated).collect(),
            inputs: count(Role::Input),
            outputs: count(Role::Output),
        }
    }

    pub(crate) fn slots(&self) -> impl Iterator<Item = Slot> + use<> {
        let (inputs, outputs) = (self.inputs, self.outputs);
        (0..self.names.len()).map(move |k| match k {
            k if k < inputs => Slot::Input(k),
            k if k < inputs + outputs => Slot::Output(k - inputs),
            k => Slot::Other(k - inputs - outputs),
        })
    }

    /// Place of a slot among the channels of a record.
    pub(crate) fn place(&self, slot: Slot) -> usize {
        match slot {
            Slot::Input(k) => k,
            Slot::Output(k) => self.inputs + k,
            Slot::Other(k) => self.inputs + self.outputs + k,
        }
    }

    pub(crate) fn name(&self, slot: Slot) -> &str {
        &self.names[self.place(slot)]
    }

    pub(crate) fn unit(&self, slot: Slot) -> Option<&str> {
        self.units[self.place(slot)].as_deref()
    }

    /// What mends a run, as lines of a map.
    pub(crate) fn repair(&self, edits: &[Edit]) -> Repair {
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

/// Factors that turn numbers of another unit into the model's, by what the unit measures, and the unit's name.
fn factors(unit: Option<&str>) -> Vec<(f64, f64, &'static str)> {
    const DEG: f64 = PI / 180.0;
    let of = |list: &[(f64, &'static str)]| list.iter().map(|(f, name)| (*f, 0.0, *name)).collect();
    match unit {
        Some("rad" | "rad/s" | "rad/s^2") => of(&[(DEG, "degrees"), (1e-3, "thousandths"), (2.0 * PI, "turns")]),
        Some("deg" | "deg/s" | "deg/s^2") => of(&[(1.0 / DEG, "radians"), (1e-2, "hundredths of a degree")]),
        Some("m/s") => of(&[
            (0.514_444, "knots"),
            (0.3048, "feet per second"),
            (1.0 / 3.6, "kilometres per hour"),
            (1e-3, "millimetres per second"),
        ]),
        Some("m/s^2") => {
            of(&[(9.806_65, "g"), (0.3048, "feet per second squared"), (1e-2, "centimetres per second squared")])
        }
        Some("m") => of(&[(0.3048, "feet"), (1e-3, "millimetres"), (1e-2, "centimetres"), (1e3, "kilometres")]),
        Some("kg") => of(&[(0.453_592_37, "pounds"), (1e-3, "grams")]),
        Some("N") => of(&[(4.448_222, "pounds of force"), (1e3, "kilonewtons"), (9.806_65, "kilograms of force")]),
        Some("Pa") => of(&[(1e3, "kilopascals"), (100.0, "hectopascals"), (1e5, "bar"), (6894.757, "psi")]),
        Some("K") => vec![(1.0, 273.15, "degrees Celsius"), (5.0 / 9.0, 255.372_222, "degrees Fahrenheit")],
        Some("degC" | "°C") => vec![(1.0, -273.15, "kelvin"), (5.0 / 9.0, -17.777_778, "degrees Fahrenheit")],
        Some(u) if u.contains("rad") => of(&[(DEG, "degrees"), (1.0 / DEG, "radians for degrees")]),
        None => of(&[
            (DEG, "degrees"),
            (1.0 / DEG, "radians"),
            (1e-2, "per cent"),
            (1e-3, "thousandths"),
            (1e3, "thousands"),
        ]),
        Some(u) if u.contains("/s") => {
            of(&[(1e-3, "thousandths"), (1e3, "thousands"), (1.0 / 60.0, "units per minute")])
        }
        Some(u) if u.contains("/min") => of(&[(1e-3, "thousandths"), (1e3, "thousands"), (60.0, "units per second")]),
        Some(_) => of(&[(1e-3, "thousandths"), (1e3, "thousands")]),
    }
}

/// Hypotheses about these slots with nothing to be estimated: units, signs, places, axes, unit of time. Channels that state their unit have a
/// tenth of the prior probability of another one.
pub(crate) fn discrete(channels: &Channels, slots: &[Slot], timed: bool) -> Vec<Hypothesis> {
    let mut all = Vec::new();
    let mut add = |fault, slots: Vec<Slot>, edits: Vec<Edit>, what: String, weight| {
        all.push(Hypothesis { fault, slots, edits, what, weight });
    };
    for slot in slots.iter().copied() {
        let unit = channels.unit(slot);
        add(Fault::Sign, vec![slot], vec![Edit::Affine(slot, -1.0, 0.0)], "runs against the model".into(), 1.0);
        let weight = if channels.stated[channels.place(slot)] { 0.1 } else { 1.0 };
        for (factor, offset, name) in factors(unit) {
            let what = match unit {
                Some(unit) => format!("in {name} for a model in {unit}"),
                None => format!("in {name}"),
            };
            add(Fault::Unit, vec![slot], vec![Edit::Affine(slot, factor, offset)], what, weight);
        }
    }
    for (k, a) in slots.iter().enumerate() {
        for b in &slots[k + 1..] {
            let alike = channels.unit(*a) == channels.unit(*b);
            let same_role = matches!(a, Slot::Input(_)) == matches!(b, Slot::Input(_));
            if same_role {
                let weight = if alike { 0.3 } else { 0.03 };
                let what = format!("stands in the place of `{}`, and the other way round", channels.name(*b));
                add(Fault::Swapped, vec![*a, *b], vec![Edit::Swap(*a, *b)], what, weight);
            }
        }
    }
    axes(channels, slots, &mut add);
    if timed {
        let units = [
            (1e-3, "milliseconds"),
            (1e-6, "microseconds"),
            (1e3, "thousands"),
            (60.0, "minutes"),
            (1.0 / 60.0, "sixtieths"),
        ];
        for (factor, name) in units {
            add(Fault::TimeUnit, Vec::new(), vec![Edit::Time(factor)], format!("the times are in {name}"), 0.3);
        }
    }
    all
}

/// The 48 signed permutations of triads of measured channels, all triads turned alike; single signs and exchanges are hypotheses of their
/// own.
fn axes(channels: &Channels, slots: &[Slot], add: &mut impl FnMut(Fault, Vec<Slot>, Vec<Edit>, String, f64)) {
    let measured: Vec<Slot> = slots.iter().copied().filter(|s| !matches!(s, Slot::Input(_))).collect();
    let find = |name: &str| measured.iter().copied().find(|s| plain(channels.name(*s)) == name);
    let triads: Vec<[Slot; 3]> =
        [["ax", "ay", "az"], ["p", "q", "r"], ["u", "v", "w"], ["x", "y", "z"], ["vx", "vy", "vz"]]
            .iter()
            .filter_map(|t| Some([find(t[0])?, find(t[1])?, find(t[2])?]))
            .collect();
    if triads.is_empty() {
        return;
    }
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]];
    for order in ORDERS {
        for signs in 0..8u8 {
            let minus: Vec<bool> = (0..3).map(|k| signs & (1 << k) != 0).collect();
            if order == [0, 1, 2] && signs == 0 {
                continue;
            }
            let mut edits = Vec::new();
            for triad in &triads {
                // a permutation as exchanges: k gets what stood at `order[k]`, wherever it stands by now
                let mut stands = [0, 1, 2];
                for k in 0..3 {
                    let now = stands.iter().position(|from| *from == order[k]).unwrap_or(k);
                    if now != k {
                        edits.push(Edit::Swap(triad[k], triad[now]));
                        stands.swap(k, now);
                    }
                }
                edits.extend((0..3).filter(|k| minus[*k]).map(|k| Edit::Affine(triad[k], -1.0, 0.0)));
            }
            let word = |k: usize| format!("{}{}", if minus[k] { "-" } else { "" }, ["x", "y", "z"][order[k]]);
            let frame = match (order, signs) {
                ([0, 1, 2], 0b110) => " (forward-left-up for forward-right-down)",
                ([1, 0, 2], 0b100) => " (east-north-up for north-east-down)",
                _ => "",
            };
            let what = format!("the axes x, y, z are {}, {}, {}{frame}", word(0), word(1), word(2));
            let weight = if frame.is_empty() { 0.02 } else { 0.5 };
            add(Fault::Axes, triads.concat(), edits, what, weight);
        }
    }
}

/// A name as the field writes it: small letters, without what says that it was measured or in which unit.
pub(crate) fn plain(name: &str) -> String {
    let mut name = name.to_ascii_lowercase();
    const ENDINGS: [&str; 10] = ["_measured", "_meas", "_m", "_deg", "_rad", "_degs", "_rads", "_dps", "_mps", "_ft"];
    while let Some(short) = ENDINGS.iter().find_map(|e| name.strip_suffix(e)).filter(|s| !s.is_empty()) {
        name = short.to_string();
    }
    name
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
        }
    }
    Edited { time, columns }
}

/// What edits multiply the times by.
pub(crate) fn time_factor(edits: &[Edit]) -> f64 {
    edits.iter().map(|e| if let Edit::Time(factor) = *e { factor } else { 1.0 }).product()
}

/// The first-order lags behind the model's outputs: output and time constant, in their order.
pub(crate) fn lags_of(edits: &[Edit]) -> Vec<(usize, f64)> {
    let lag = |e: &Edit| if let Edit::Filter(Slot::Output(k), lag) = *e { Some((k, lag)) } else { None };
    edits.iter().filter_map(lag).collect()
}

/// How far between samples a channel is read by delays and drifts: the mean of `f (1 - f)` over the parts `f` of intervals.
pub(crate) fn between_samples(record: &Record, edits: &[Edit], slot: Slot) -> f64 {
    let factor = time_factor(edits);
    let time: Vec<f64> = record.time.iter().map(|t| factor * t).collect();
    let time = &time[..];
    let mut cursor = fdm_system::record::Cursor::default();
    let mut part = |at: f64| {
        let place = cursor.at(time, at);
        place.part * (1.0 - place.part)
    };
    let of = |edit: &Edit| match *edit {
        Edit::Delay(s, tau) if s == slot => Some((tau, 0.0)),
        Edit::Drift(s, rate) if s == slot => Some((0.0, rate)),
        _ => None,
    };
    let moved = edits.iter().filter_map(of);
    let parts = moved.map(|(tau, rate)| time.iter().map(|t| part(t + tau + rate * t)).sum::<f64>() / time.len() as f64);
    // a delay and a drift of one channel read it once
    parts.sum::<f64>().min(0.25)
}

/// A run as the edits of its record make it, with the inputs that the model computes from its records. What a channel went through is
/// left to the response ([`lags_of`]).
///
/// # Errors
/// As [`Run::with_measured`].
pub(crate) fn edited(
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
pub(crate) fn lag_weights(time_constant: f64, interval: f64) -> (f64, f64) {
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
