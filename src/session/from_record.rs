//! A first model from a record: which columns drive it, which it explains, and equations that a fit can begin with.

use crate::failure::Failure;
use fdm_doctor::{AloneOptions, Finding, Record, examine_alone, leading};
use fdm_grammar::Unit;
use fdm_numeric::dense::Cholesky;
use fdm_system::Model;
use fdm_system::record::{Field, Topic, moves_at_samples, open_log};
use std::path::Path;

/// What a record says before there is a model.
pub struct Looked {
    /// Times in seconds (N), rising.
    time: Vec<f64>,
    /// What may drive a model.
    pub inputs: Vec<Column>,
    /// What it may explain.
    pub outputs: Vec<Column>,
    /// Names of columns that are neither: constant, counters, without numbers, or beyond the most that are modelled.
    pub left_out: Vec<String>,
    /// What was understood of the file, and the leading findings of the doctor.
    pub notes: Vec<String>,
}

/// A column of the record.
pub struct Column {
    /// As the file has it.
    pub title: String,
    /// A name in the language.
    pub name: String,
    /// Its unit in the language, where it is known.
    pub unit: Option<String>,
    /// Whether it keeps its values between samples.
    pub held: bool,
    values: Vec<f64>,
}

/// Outputs that a first model has at most: who has more begins with a part.
const OUTPUTS: usize = 4;
/// Inputs that a first model has at most.
const INPUTS: usize = 4;

/// Parts of names that commands, controls and conditions have.
const DRIVING: [&str; 47] = [
    "u",
    "in",
    "input",
    "cmd",
    "command",
    "commanded",
    "ref",
    "reference",
    "set",
    "setpoint",
    "sp",
    "target",
    "desired",
    "demand",
    "stick",
    "pedal",
    "ped",
    "cyclic",
    "collective",
    "coll",
    "col",
    "lever",
    "elevator",
    "elev",
    "aileron",
    "ail",
    "rudder",
    "rud",
    "throttle",
    "thr",
    "flap",
    "steer",
    "steering",
    "volt",
    "voltage",
    "pwm",
    "duty",
    "heater",
    "power",
    "valve",
    "torque",
    "actuator",
    "control",
    "drive",
    "ambient",
    "de",
    "da",
];

/// Sticks of a helicopter, which are called as a position over the earth is.
const STICKS: [&str; 4] = ["lat", "lon", "dlat", "dlon"];
/// Part of its size by which a position over the earth does not change: a tenth of ten degrees is 110 km, farther than a test flight.
const STAYS: f64 = 0.1;

/// Looks at the largest table of a file.
///
/// # Errors
/// [`Failure`], where it cannot be read, or holds no times or no signals.
pub fn looked_at(path: &Path) -> Result<Looked, Failure> {
    let (log, notes) = open_log(path, false, None).map_err(|e| Failure::Records(vec![e]))?;
    let refused = |what: &str| Failure::input([format!("{}: {what}", path.display())]);
    let timed = log.topics.iter().filter(|t| t.time.is_some() && t.rows() > 2);
    let Some(topic) = timed.max_by_key(|t| t.rows() * t.fields.len()) else {
        return Err(refused(
            "no column holds the time: write `t [s]` above it, or give the record to `fdm fit` with --rate",
        ));
    };
    let Some(time) = topic.seconds() else {
        return Err(refused("the unit of the time is not known: write it behind its name, as in `t [s]`"));
    };
    let mut notes: Vec<String> = notes.iter().map(ToString::to_string).collect();
    let record = Record::of_topic(&path.file_stem().unwrap_or_default().to_string_lossy(), topic);
    let options = AloneOptions { kinematics: true, ..AloneOptions::default() };
    let mut findings: Vec<Finding> = examine_alone(&record, &options);
    fdm_doctor::sort(&mut findings);
    notes.extend(leading(&findings));
    let mut looked = Looked { time, inputs: Vec::new(), outputs: Vec::new(), left_out: Vec::new(), notes };
    for (k, field) in topic.fields.iter().enumerate().filter(|(k, _)| topic.time != Some(*k)) {
        looked.sort_in(k, field, topic);
    }
    if looked.outputs.is_empty() {
        return Err(refused("no column changes that a model could explain"));
    }
    Ok(looked)
}

impl Looked {
    fn sort_in(&mut self, k: usize, field: &Field, topic: &Topic) {
        let finite = || field.values.iter().copied().filter(|v| v.is_finite());
        let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let counts = field.values.windows(2).all(|w| w[1] - w[0] == 1.0);
        let again = topic.fields[..k].iter().any(|f| f.name == field.name);
        if low >= high || counts || again || 2 * finite().count() < field.values.len() {
            return self.left_out.push(field.name.clone());
        }
        let held = moves_at_samples(finite());
        let names = |c: &Column| c.name.clone();
        let taken: Vec<String> = self.inputs.iter().chain(&self.outputs).map(names).collect();
        let unit = field.unit.as_deref().and_then(|u| Unit::spelled(u).ok()).map(|u| {
            let text = u.unit.text().to_string();
            u.taken_for.unwrap_or(text)
        });
        let column = Column {
            title: field.name.clone(),
            name: identifier(&field.name, &taken),
            unit,
            held,
            values: field.values.clone(),
        };
        let moves = high - low > STAYS * low.abs().max(high.abs());
        let drives = is_called(&field.name, &DRIVING) || moves && is_called(&field.name, &STICKS);
        let (list, most) = match held || drives {
            true => (&mut self.inputs, INPUTS),
            false => (&mut self.outputs, OUTPUTS),
        };
        if list.len() < most { list.push(column) } else { self.left_out.push(column.title) }
    }

    /// Samples, and the usual time between them.
    pub fn sampling(&self) -> (usize, f64) {
        let mut steps: Vec<f64> = self.time.windows(2).map(|w| w[1] - w[0]).filter(|s| *s > 0.0).collect();
        steps.sort_by(f64::total_cmp);
        (self.time.len(), steps.get(steps.len() / 2).copied().unwrap_or(1.0))
    }

    /// The text of a model of this name: each output follows all inputs with a lag of its own, from an unknown beginning.
    ///
    /// # Errors
    /// [`Failure`], where no such text is a model.
    pub fn model(&self, name: &str, from: &str) -> Result<String, Failure> {
        let mut last = None;
        // units of columns may not belong together; numbers are then taken as they are
        for units in [true, false] {
            let text = self.text(name, from, units);
            match Model::from_text(format!("{name}.fdm"), text.clone()) {
                Ok(model) => return Ok(fdm_grammar::format::format(model.source()).unwrap_or(text)),
                Err(e) => last = Some(e),
            }
        }
        Err(last.map_or_else(|| Failure::input(["no model was written"]), Failure::from))
    }

    fn text(&self, name: &str, from: &str, units: bool) -> String {
        let unit = |text: String| if units && !text.is_empty() { format!(" [{text}]") } else { String::new() };
        let own = |c: &Column| c.unit.clone().unwrap_or_default();
        let mut lines = vec![
            format!(
                "// A first model of {from}: each output follows the inputs with a lag. Change it to your equations."
            ),
            format!("model {name} {{"),
        ];
        for input in &self.inputs {
            let held = if input.held { " held" } else { "" };
            lines.push(format!("  input {}{held}{};", input.name, unit(own(input))));
        }
        let (_, interval) = self.sampling();
        let length = self.time.last().copied().unwrap_or(1.0) - self.time.first().copied().unwrap_or(0.0);
        let (shortest, longest) = (digits(0.1 * interval), digits(100.0 * length));
        let mut equations = Vec::new();
        for output in &self.outputs {
            let (x, of) = (format!("{}_x", output.name), &output.name);
            let start = self.start(output, interval);
            lines.push(format!("  state {x}{} = free;", unit(own(output))));
            let lag = digits(start.lag.clamp(2.0 * interval, 10.0 * length));
            let mut params = vec![format!("T_{of} = {lag} in [{shortest}, {longest}]{}", unit("s".into()))];
            let mut sum = vec![format!("b_{of}")];
            for (input, gain) in self.inputs.iter().zip(&start.gains) {
                let gain_unit = match (&output.unit, &input.unit) {
                    (Some(y), Some(u)) => unit(format!("({y})/({u})")),
                    _ => String::new(),
                };
                params.push(format!("K_{of}_{} = {}{gain_unit}", input.name, digits(*gain)));
                sum.push(format!("K_{of}_{0}*{0}", input.name));
            }
            params.push(format!("b_{of} = {}{}", digits(start.offset), unit(own(output))));
            lines.push(format!("  param {};", params.join(", ")));
            equations.push(format!("  der({x}) = ({} - {x})/T_{of};", sum.join(" + ")));
            equations.push(format!("  output {of}{} = {x};", unit(own(output))));
        }
        lines.append(&mut equations);
        lines.push("}\n".into());
        lines.join("\n")
    }

    /// Lag, gains and offset by the regression of each sample on the one before it and its inputs.
    fn start(&self, output: &Column, interval: f64) -> Start {
        let m = self.inputs.len();
        let width = m + 2;
        let (mut normal, mut right) = (vec![0.0; width * width], vec![0.0; width]);
        for k in 1..self.time.len() {
            let mut row = vec![output.values[k - 1], 1.0];
            row.extend(self.inputs.iter().map(|u| u.values[k - 1]));
            let even = (self.time[k] - self.time[k - 1] - interval).abs() < 0.5 * interval;
            if !even || !output.values[k].is_finite() || row.iter().any(|v| !v.is_finite()) {
                continue;
            }
            for (i, a) in row.iter().enumerate() {
                right[i] += a * output.values[k];
                row.iter().enumerate().for_each(|(j, b)| normal[i * width + j] += a * b);
            }
        }
        let plain = || Start {
            lag: 20.0 * interval,
            gains: vec![1.0; m],
            offset: output.values.iter().copied().find(|v| v.is_finite()).unwrap_or(0.0),
        };
        let Some(factor) = Cholesky::new(normal, width) else { return plain() };
        factor.solve(&mut right);
        let kept = right[0];
        if !(0.0..1.0).contains(&kept) || kept == 0.0 || right.iter().any(|v| !v.is_finite()) {
            return plain();
        }
        let to_rest = |v: f64| v / (1.0 - kept);
        Start {
            lag: -interval / fdm_grammar::math::log(kept),
            gains: right[2..].iter().map(|b| to_rest(*b)).collect(),
            offset: to_rest(right[1]),
        }
    }
}

/// Where a fit begins.
struct Start {
    lag: f64,
    gains: Vec<f64>,
    offset: f64,
}

/// Three digits are enough to begin with.
fn digits(value: f64) -> String {
    let short: f64 = format!("{value:.2e}").parse().unwrap_or(value);
    short.to_string()
}

/// Whether a part of a name is one of these words.
fn is_called(name: &str, words: &[&str]) -> bool {
    let lower = name.to_lowercase();
    let mut parts = lower.split(|c: char| !c.is_alphabetic()).filter(|p| !p.is_empty());
    parts.any(|part| words.contains(&part))
}

/// A name of the language, unlike those that are taken.
fn identifier(title: &str, taken: &[String]) -> String {
    let plain: String = title.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    let plain = plain.trim_matches('_');
    let begun =
        if plain.starts_with(|c: char| c.is_ascii_alphabetic()) { plain.to_string() } else { format!("c{plain}") };
    let is_name = |name: &str| {
        let text = format!("model m {{ input {name}; output out_{name} = {name}; }}");
        !taken.iter().any(|t| t == name) && Model::from_text("m.fdm", text).is_ok()
    };
    let numbered = (2..).map(|k| format!("{begun}_{k}"));
    let candidates = [begun.clone(), format!("{begun}_m")].into_iter().chain(numbered).take(1000);
    candidates.into_iter().find(|name| is_name(name)).unwrap_or(begun)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_columns_become_names_of_the_language() {
        assert_eq!(identifier("/drive/voltage", &[]), "drive_voltage");
        assert_eq!(identifier("2 x", &[]), "c2_x");
        assert_eq!(identifier("input", &[]), "input_m");
        assert_eq!(identifier("u", &["u".into()]), "u_m");
        let drives = |name| is_called(name, &DRIVING);
        assert!(drives("stick_cmd") && drives("Throttle (%)") && !drives("roll rate") && !drives("cmdline9x"));
    }

    #[test]
    fn sticks_of_a_helicopter_drive_and_positions_do_not() {
        let wave = |k: usize, mean: f64, size: f64| mean + size * (0.3 * k as f64).sin() * (0.07 * k as f64).cos();
        let names = ["lat", "lon", "ped", "col", "p"];
        let mut topic = Topic { fields: Vec::new(), ..Topic::default() };
        let mut looked = |size: f64| {
            let of = |k: usize| (0..200).map(|t| wave(t + 9 * k, 48.0 * (1.0 - size), size)).collect::<Vec<f64>>();
            topic.fields = names.iter().enumerate().map(|(k, name)| Field::new(*name, None, of(k))).collect();
            let time = (0..200).map(f64::from).collect();
            let (inputs, outputs, left_out, notes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
            let mut looked = Looked { time, inputs, outputs, left_out, notes };
            topic.fields.iter().enumerate().for_each(|(k, field)| looked.sort_in(k, field, &topic));
            looked.inputs.iter().map(|c| c.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(looked(1.0), ["lat", "lon", "ped", "col"]);
        assert_eq!(looked(1e-3), ["ped", "col"], "a track about a place");
    }
}
