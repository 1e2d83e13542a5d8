//! What may be wrong with the channels of a model's record, each as the edit of the run that would mend it.

use crate::finding::Fault;
use crate::repair::{Change, Repair};
use fdm_grammar::Model;
use fdm_system::record::{Incomplete, Run};
use std::f64::consts::PI;

/// A channel of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Slot {
    Input(usize),
    Output(usize),
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

/// Names and units of the channels of a model.
pub(crate) struct Channels<'a> {
    model: &'a Model,
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
}

impl<'a> Channels<'a> {
    pub(crate) fn new(model: &'a Model) -> Self {
        let inputs = model.inputs.iter().filter(|i| i.is_declared()).count();
        Self { model, inputs, outputs: model.outputs.len() }
    }

    pub(crate) fn slots(&self) -> impl Iterator<Item = Slot> + use<> {
        let (inputs, outputs) = (self.inputs, self.outputs);
        (0..inputs).map(Slot::Input).chain((0..outputs).map(Slot::Output))
    }

    pub(crate) fn name(&self, slot: Slot) -> &'a str {
        match slot {
            Slot::Input(k) => &self.model.inputs[k].quantity.name,
            Slot::Output(k) => &self.model.outputs[k].quantity.name,
        }
    }

    pub(crate) fn unit(&self, slot: Slot) -> Option<String> {
        let quantity = match slot {
            Slot::Input(k) => &self.model.inputs[k].quantity,
            Slot::Output(k) => &self.model.outputs[k].quantity,
        };
        quantity.unit.as_ref().map(ToString::to_string).filter(|u| u != "1")
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
                    let words =
                        format!("stamp `{}` by another clock: it gains {rate:.3e} of every unit", self.name(slot));
                    return Repair::words(&words);
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
        Some(_) => of(&[(1e-3, "thousandths"), (1e3, "thousands"), (60.0, "per minute"), (1.0 / 60.0, "minutes")]),
    }
}

/// Hypotheses with nothing to be estimated: units, signs, places, axes, unit of time. `stated` says which channels state their unit (by slot
/// order, inputs first): those have a tenth of the prior probability of another unit.
pub(crate) fn discrete(channels: &Channels<'_>, stated: &[bool], timed: bool) -> Vec<Hypothesis> {
    let slots: Vec<Slot> = channels.slots().collect();
    let mut all = Vec::new();
    let mut add = |fault, slots: Vec<Slot>, edits: Vec<Edit>, what: String, weight| {
        all.push(Hypothesis { fault, slots, edits, what, weight });
    };
    for (k, slot) in slots.iter().copied().enumerate() {
        let unit = channels.unit(slot);
        add(Fault::Sign, vec![slot], vec![Edit::Affine(slot, -1.0, 0.0)], "runs against the model".into(), 1.0);
        let weight = if stated.get(k).copied().unwrap_or(true) { 0.1 } else { 1.0 };
        for (factor, offset, name) in factors(unit.as_deref()) {
            let what = match unit.as_deref() {
                Some(unit) => format!("in {name} for a model in {unit}"),
                None => format!("in {name}"),
            };
            add(Fault::Unit, vec![slot], vec![Edit::Affine(slot, factor, offset)], what, weight);
        }
    }
    for (k, a) in slots.iter().enumerate() {
        for b in &slots[k + 1..] {
            let alike = channels.unit(*a) == channels.unit(*b);
            let same_role = matches!((a, b), (Slot::Input(_), Slot::Input(_)) | (Slot::Output(_), Slot::Output(_)));
            if same_role {
                let weight = if alike { 0.3 } else { 0.03 };
                let what = format!("stands in the place of `{}`, and the other way round", channels.name(*b));
                add(Fault::Swapped, vec![*a, *b], vec![Edit::Swap(*a, *b)], what, weight);
            }
        }
    }
    axes(channels, &mut add);
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

/// The 48 signed permutations of triads of outputs, all triads of the model turned alike; single signs and exchanges are hypotheses of
/// their own.
fn axes(channels: &Channels<'_>, add: &mut impl FnMut(Fault, Vec<Slot>, Vec<Edit>, String, f64)) {
    let plain = |k: usize| {
        let name = channels.name(Slot::Output(k)).to_ascii_lowercase();
        ["_m", "_meas", "_measured"].iter().find_map(|e| name.strip_suffix(e).map(str::to_string)).unwrap_or(name)
    };
    let names: Vec<String> = (0..channels.outputs).map(plain).collect();
    let find = |name: &str| names.iter().position(|n| n == name).map(Slot::Output);
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

/// A run as the edits make it, with the inputs that the model computes from its records.
///
/// # Errors
/// As [`Run::with_measured`].
pub(crate) fn edited(run: &Run, edits: &[Edit], model: &Model) -> Result<Run, Incomplete> {
    let declared = model.inputs.iter().filter(|i| i.is_declared()).count();
    let mut new = run.clone();
    for edit in edits {
        match *edit {
            Edit::Affine(slot, factor, offset) => {
                let (mut values, k) = (column(&new, slot), slot);
                values.iter_mut().for_each(|v| *v = factor * *v + offset);
                put(&mut new, k, &values);
            }
            Edit::Swap(a, b) => {
                let (one, other) = (column(&new, a), column(&new, b));
                put(&mut new, a, &other);
                put(&mut new, b, &one);
            }
            Edit::Delay(slot, tau) => shifted(&mut new, slot, |_| tau),
            Edit::Drift(slot, rate) => shifted(&mut new, slot, |t| rate * t),
            Edit::Time(factor) => new.time.iter_mut().for_each(|t| *t *= factor),
        }
    }
    if model.inputs.len() > declared { new.with_measured(model) } else { Ok(new) }
}

fn layout(run: &Run, slot: Slot) -> (usize, usize) {
    match slot {
        Slot::Input(k) => (k, run.held.len()),
        Slot::Output(k) => (k, run.output_gaps.len()),
    }
}

/// The samples of a channel.
pub(crate) fn column(run: &Run, slot: Slot) -> Vec<f64> {
    let (k, width) = layout(run, slot);
    let rows = if matches!(slot, Slot::Input(_)) { &run.inputs } else { &run.measured };
    rows.iter().skip(k).step_by(width.max(1)).copied().collect()
}

/// Puts samples in the place of a channel's.
pub(crate) fn put(run: &mut Run, slot: Slot, values: &[f64]) {
    let (k, width) = layout(run, slot);
    let rows = if matches!(slot, Slot::Input(_)) { &mut run.inputs } else { &mut run.measured };
    rows.iter_mut().skip(k).step_by(width.max(1)).zip(values).for_each(|(v, new)| *v = *new);
}

/// The value at `t + delay(t)` in place of that at `t`: linear, or held as the input is. Outputs beyond the record are gaps, inputs stay.
fn shifted(run: &mut Run, slot: Slot, delay: impl Fn(f64) -> f64) {
    let values = column(run, slot);
    let held = matches!(slot, Slot::Input(k) if run.held[k]);
    let time = &run.time;
    let (first, last) = (time[0], time[time.len() - 1]);
    let mut cursor = fdm_system::record::Cursor::default();
    let mut new = Vec::with_capacity(values.len());
    for t in time {
        let at = t + delay(*t);
        if matches!(slot, Slot::Output(_)) && (at < first || at > last) {
            new.push(f64::NAN);
            continue;
        }
        let place = cursor.at(time, at);
        let left = values[place.left];
        new.push(if place.rate == 0.0 || held { left } else { left + place.part * (values[place.left + 1] - left) });
    }
    put(run, slot, &new);
}
