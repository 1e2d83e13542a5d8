//! What may be wrong with the channels of a record, each as the edits that would mend it, with its share of the prior probability.

use crate::edit::{Channels, Edit, Slot};
use crate::finding::{Fault, Finding, Severity};
use crate::record::Record;
use crate::repair::Repair;
use fdm_system::record::frame::{Frame, plain};
use std::f64::consts::PI;

/// A fault, and the edits that mend it.
#[derive(Debug, Clone, PartialEq)]
pub struct Hypothesis {
    /// Its kind.
    pub fault: Fault,
    /// The channels that it is about.
    pub slots: Vec<Slot>,
    /// What mends it.
    pub edits: Vec<Edit>,
    /// In words.
    pub what: String,
    /// Its share of the prior probability of a fault, beside others of its kind.
    pub weight: f64,
    /// The frame that the edits turn all vectors from.
    pub frame: Option<Frame>,
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
pub fn discrete(channels: &Channels, slots: &[Slot], timed: bool) -> Vec<Hypothesis> {
    let mut all = Vec::new();
    let mut add = |fault, slots: Vec<Slot>, edits: Vec<Edit>, what: String, weight| {
        all.push(Hypothesis { fault, slots, edits, what, weight, frame: None });
    };
    for slot in slots.iter().copied() {
        let unit = channels.unit(slot);
        add(Fault::Sign, vec![slot], vec![Edit::Affine(slot, -1.0, 0.0)], "runs against the model".into(), 1.0);
        let weight = if channels.is_stated(slot) { 0.1 } else { 1.0 };
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
    let mut frames: Vec<Hypothesis> = Vec::new();
    for hypothesis in Frame::TURNED.into_iter().filter_map(|frame| turned(frame, channels, slots)) {
        // where what tells two frames apart is not there
        if !frames.iter().any(|h| h.edits == hypothesis.edits) {
            frames.push(hypothesis);
        }
    }
    all.extend(frames);
    let mut add = |fault, slots: Vec<Slot>, edits: Vec<Edit>, what: String, weight| {
        all.push(Hypothesis { fault, slots, edits, what, weight, frame: None });
    };
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
            let what = format!("the axes x, y, z are {}, {}, {}", word(0), word(1), word(2));
            add(Fault::Axes, triads.concat(), edits, what, 0.02);
        }
    }
}

/// All vectors in another frame, where one is there whole.
fn turned(frame: Frame, channels: &Channels, slots: &[Slot]) -> Option<Hypothesis> {
    let (turned, lacking) = frame.turned(&channels.names());
    let all: Vec<Slot> = channels.slots().collect();
    let touched: Vec<Slot> = turned.iter().map(|t| all[t.channel]).collect();
    let read = touched.iter().any(|s| slots.contains(s));
    if touched.len() < 2 || !read || !lacking.is_empty() || !Frame::has_vector(&channels.names()) {
        return None;
    }
    let mut edits = Vec::new();
    for part in &turned {
        // no equation reads quaternions
        let [(from, factor)] = part.of[..] else { continue };
        // two channels that are made of each other are exchanged once
        if from > part.channel {
            edits.push(Edit::Swap(all[part.channel], all[from]));
        }
        let slot = all[part.channel];
        edits.push(Edit::Affine(slot, factor, part.turns * channels.whole_turn(slot)));
    }
    edits.sort_by_key(|e| !matches!(e, Edit::Swap(..)));
    edits.retain(|e| !matches!(e, Edit::Affine(_, factor, offset) if *factor == 1.0 && *offset == 0.0));
    // robots, simulators and motion capture log their vectors so (ROS, REP 103): as usual as a wrong sign, for each of the channels
    let weight = if frame == Frame::TURNED[0] { 3.0 } else { 1.0 };
    let what = format!("vectors are in {}", frame.words());
    Some(Hypothesis { fault: Fault::Axes, slots: touched, edits, what, weight, frame: Some(frame) })
}

/// A fault with one number that is estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimated {
    /// Its kind: a delay, a drift, a filter, an offset, a shift of zero or a scale factor.
    pub fault: Fault,
    /// The channel.
    pub slot: Slot,
    /// Of a shift of zero: when it happens.
    pub at: f64,
}

impl Estimated {
    /// A fault that is there from the beginning on.
    pub fn new(fault: Fault, slot: Slot) -> Self {
        Self { fault, slot, at: 0.0 }
    }

    /// What mends a fault of this size; of a scale factor the size is its logarithm.
    pub fn edit(self, size: f64) -> Edit {
        let Self { fault, slot, at } = self;
        match fault {
            Fault::ZeroShift => Edit::Step(slot, at, size),
            Fault::Delay => Edit::Delay(slot, size),
            Fault::Drift => Edit::Drift(slot, size),
            Fault::Filtered => Edit::Filter(slot, size),
            Fault::Offset => Edit::Affine(slot, 1.0, size),
            _ => Edit::Affine(slot, size.exp(), 0.0),
        }
    }

    /// Its share of the prior probability. Drifts and scale factors are rarer than delays and offsets. An input is early where all sensors are late
    /// together; one sensor is early only where all others and the inputs are late alike.
    pub fn weight(self, size: f64) -> f64 {
        match (self.fault, self.slot) {
            (Fault::Delay, Slot::Input(_)) if size < 0.0 => 0.2,
            (Fault::Delay, _) if size < 0.0 => 0.01,
            (Fault::Delay | Fault::Offset, _) => 1.0,
            _ => 0.5,
        }
    }

    /// The fault at a size with this error, in words; `span` is the length of the record. Its edit has the digits that are told.
    pub fn told(self, (size, error): (f64, f64), channels: &Channels, span: f64) -> Hypothesis {
        let Self { fault, slot, at } = self;
        let weight = self.weight(size);
        let unit = channels.unit(slot).map_or_else(String::new, |u| format!(" {u}"));
        let (value, error) = if fault == Fault::Scale { (size.exp(), size.exp() * error) } else { (size, error) };
        let (value, what) = sized(fault, (value, error), &unit, (span, at));
        let size = if fault == Fault::Scale { value.ln() } else { value };
        Hypothesis { fault, slots: vec![slot], edits: vec![self.edit(size)], what, weight, frame: None }
    }
}

/// A size as far as its error lets it be told, and the sentence about it.
fn sized(fault: Fault, (value, error): (f64, f64), unit: &str, (span, at): (f64, f64)) -> (f64, String) {
    let places = places(value, error);
    let value: f64 = format!("{value:.places$}").parse().unwrap_or(value);
    let (size, error) = match error.is_finite() {
        true => (format!("{:.places$}", value.abs()), format!(" +- {error:.places$}")),
        false => (format!("{:.places$}", value.abs()), String::new()),
    };
    let what = match fault {
        Fault::Delay => format!("comes {size} too {}{error}", if value > 0.0 { "late" } else { "early" }),
        Fault::Drift => format!(
            "its clock {} {size} of every unit of time{error}, {:.4} over the record",
            if value > 0.0 { "gains" } else { "loses" },
            value.abs() * span
        ),
        Fault::ZeroShift => format!("its zero moves by {:.4}{unit} at {at:.4}", -value),
        Fault::Filtered => format!("went through a filter: a first-order lag of {size}{error}"),
        Fault::Offset => format!("is {size}{unit} too {}{error}", if value < 0.0 { "large" } else { "small" }),
        _ => format!("its numbers have to be multiplied by {size}{error}"),
    };
    (value, what)
}

/// Decimal places that leave a fifth of an error, or four digits where there is none.
fn places(value: f64, error: f64) -> usize {
    const MOST: f64 = 12.0;
    let least = if error.is_finite() && error > 0.0 { error / 5.0 } else { 1e-4 * value.abs() };
    (-least.log10().floor()).clamp(0.0, MOST) as usize
}

impl Hypothesis {
    /// As it is found in records, with these log odds.
    pub fn finding(&self, records: &[Record], channels: &Channels, log_odds: f64) -> Finding {
        let mut names: Vec<String> = self.slots.iter().map(|s| channels.name(*s).to_string()).collect();
        if names.is_empty() {
            names.push("t".into());
        }
        Finding {
            run: if let [record] = records { record.run.clone() } else { "all".into() },
            channels: names,
            fault: self.fault,
            severity: Severity::Finding,
            place: None,
            what: self.what.clone(),
            log_odds,
            biases: Vec::new(),
            repair: Some(self.frame.map_or_else(|| channels.repair(&self.edits), Repair::frame)),
            samples: Vec::new(),
        }
    }

    /// In a sentence, as what may be meant beside another one.
    pub fn sentence(&self, channels: &Channels) -> String {
        let names: Vec<String> = self.slots.iter().map(|s| format!("`{}`", channels.name(*s))).collect();
        match names.is_empty() {
            true => self.what.clone(),
            false => format!("{} {}", names.join(", "), self.what),
        }
    }
}
