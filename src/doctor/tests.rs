//! Faults that are planted in records whose truth is known, and records without one.

use crate::hypothesis::{Channels, discrete, edited};
use crate::record::{Channel, Record, Role};
use crate::{
    AloneOptions, BesideOptions, Fault, Finding, Severity, examine_alone, examine_beside, examine_repeats, leading,
};
use fdm_system::Model;
use fdm_system::record::Run;

const N: usize = 600;
const DT: f64 = 0.05;

/// A sum of sines with noise, of a stream of its own.
fn signal(seed: u64) -> Vec<f64> {
    let mut noise = Noise::new(seed);
    let tone = |k: usize, f: f64| (f * k as f64 * DT).sin();
    (0..N).map(|k| tone(k, 1.3) + 0.4 * tone(k, 0.37) + 0.02 * noise.next()).collect()
}

/// Normal deviates by the sum of twelve uniform ones: enough for a test, and the same everywhere.
struct Noise(u64);

impl Noise {
    fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

fn channel(name: &str, values: Vec<f64>) -> Channel {
    Channel {
        name: name.into(),
        column: name.into(),
        unit: Some("m".into()),
        stated: true,
        role: Role::Output,
        scale: 1.0,
        values,
    }
}

fn record(seed: u64) -> Record {
    let time = (0..N).map(|k| k as f64 * DT).collect();
    let channels = vec![channel("a", signal(seed)), channel("b", signal(seed + 1000))];
    Record { run: "r".into(), time, clocked: true, channels }
}

fn judged(record: &Record) -> Vec<Finding> {
    let found = examine_alone(record, &AloneOptions::default());
    found.into_iter().filter(|f| f.severity == Severity::Finding).collect()
}

fn first(record: &Record) -> (Fault, String) {
    let found = judged(record);
    found.first().map(|f| (f.fault, f.channels[0].clone())).unwrap_or_else(|| panic!("nothing found"))
}

#[test]
fn clean_records_have_findings_at_the_stated_rate() {
    // of 200 records at 1 %: more than nine has a probability below 1e-4
    let alarms = (0..200).filter(|seed| !judged(&record(seed + 1)).is_empty()).count();
    assert!(alarms <= 9, "{alarms} of 200");
}

#[test]
fn faults_of_values_are_named_with_their_channel() {
    type Edit = fn(&mut Vec<f64>);
    let planted: [(Fault, Edit); 6] = [
        (Fault::Sentinel, |v| [50, 180, 400].iter().for_each(|k| v[*k] = -9999.0)),
        (Fault::Spikes, |v| [90, 333].iter().for_each(|k| v[*k] += 5.0)),
        (Fault::Stuck, |v| {
            let value = v[200];
            v[200..230].fill(value);
        }),
        (Fault::Clipped, |v| v.iter_mut().for_each(|x| *x = x.min(0.8))),
        (Fault::Quantised, |v| v.iter_mut().for_each(|x| *x = 0.2 * (*x / 0.2).round())),
        (Fault::HeldSamples, |v| {
            let old = v.clone();
            (0..v.len()).for_each(|k| v[k] = old[k - k % 4]);
        }),
    ];
    for (fault, plant) in planted {
        let mut record = record(7);
        plant(&mut record.channels[1].values);
        assert_eq!(first(&record), (fault, "b".into()), "{:?}", judged(&record));
    }
}

#[test]
fn faults_of_time_and_rows_are_named() {
    let mut dropout = record(3);
    dropout.time.drain(100..130);
    dropout.channels.iter_mut().for_each(|c| drop(c.values.drain(100..130)));
    assert_eq!(first(&dropout).0, Fault::Gap);
    let mut doubled = record(3);
    for k in [60, 120, 240, 480, 500] {
        doubled.channels.iter_mut().for_each(|c| c.values[k] = c.values[k - 1]);
    }
    assert_eq!(first(&doubled).0, Fault::DoubledRows);
    let mut jitter = record(3);
    let mut noise = Noise::new(5);
    jitter.time.iter_mut().for_each(|t| *t += 0.1 * DT * noise.next());
    assert_eq!(first(&jitter).0, Fault::UnevenTime);
}

#[test]
fn degrees_for_radians_are_named_where_no_unit_is_stated() {
    let mut record = record(11);
    let channel = &mut record.channels[0];
    (channel.unit, channel.stated) = (Some("rad".into()), false);
    channel.values.iter_mut().for_each(|v| *v *= 12.0);
    let found = judged(&record);
    assert_eq!(found[0].fault, Fault::Unit, "{found:?}");
    let repair = found[0].repair.as_ref().map(|r| r.channels["a"].factor);
    assert_eq!(repair, Some(std::f64::consts::PI / 180.0));
    record.channels[0].stated = true;
    assert!(judged(&record).is_empty(), "what is stated is believed");
}

#[test]
fn a_rate_beside_its_angle_tells_sign_unit_and_delay() {
    // an angle in closed form, and its derivative `late` seconds ago
    let made = |factor: f64, late: f64| {
        let mut noise = Noise::new(21);
        let angle = |t: f64| (1.3 * t).sin() + 0.4 * (0.37 * t).sin();
        let rate = |t: f64| 1.3 * (1.3 * t).cos() + 0.4 * 0.37 * (0.37 * t).cos();
        let times: Vec<f64> = (0..N).map(|k| k as f64 * DT).collect();
        let phi = times.iter().map(|t| angle(*t) + 0.001 * noise.next()).collect();
        let p = times.iter().map(|t| factor * (rate(t - late) + 0.005 * noise.next())).collect();
        let channels = vec![
            Channel { unit: Some("rad".into()), ..channel("phi", phi) },
            Channel { unit: Some("rad/s".into()), ..channel("p", p) },
        ];
        Record { run: "r".into(), time: times, clocked: true, channels }
    };
    assert!(judged(&made(1.0, 0.0)).is_empty(), "{:?}", judged(&made(1.0, 0.0)));
    assert_eq!(first(&made(-1.0, 0.0)).0, Fault::Sign);
    let degrees = judged(&made(180.0 / std::f64::consts::PI, 0.0));
    let factor = degrees[0].repair.as_ref().map(|r| r.channels["p"].factor);
    assert_eq!((degrees[0].fault, factor), (Fault::Unit, Some(std::f64::consts::PI / 180.0)), "{degrees:?}");
    let late = judged(&made(1.0, 0.2));
    let delay = late[0].repair.as_ref().map_or(0.0, |r| r.channels["p"].delay);
    assert!(late[0].fault == Fault::Delay && (delay - 0.2).abs() < 0.02, "{late:?}");
}

#[test]
fn the_same_record_under_two_names_is_named_and_others_are_not() {
    let mut other = record(1);
    other.run = "again".into();
    assert_eq!(examine_repeats(&[record(1), other.clone()])[0].fault, Fault::Repeated);
    other.channels[0].values[300] += 1e-9;
    let part = examine_repeats(&[record(1), other]);
    assert!(part[0].what.contains("300 samples"), "{part:?}");
    assert!(examine_repeats(&[record(1), record(2)]).is_empty());
}

#[test]
fn at_most_three_lines_are_told() {
    let mut record = record(2);
    for _ in 0..2 {
        let more = record.channels.clone();
        record.channels.extend(more);
    }
    for (k, channel) in record.channels.iter_mut().enumerate() {
        channel.name = format!("c{k}");
        channel.values[30 + 10 * k] = -9999.0;
    }
    let lines = leading(&judged(&record));
    assert!(lines.len() == 3 && lines[2].contains("6 more findings"), "{lines:?}");
}

const TEXT: &str = "model m { input u [m]; state x [m], v [m/s]; param k = 4 [1/s^2], d = 0.8 [1/s], g = 3 [1/s^2]; \
                    der(x) = v; der(v) = g*u - k*x - d*v; output x_m [m] = x, v_m [m/s] = v; }";

/// A record of the model with parameters a tenth away from the text's, integrated by steps of its own.
fn driven(seed: u64) -> (Model, Run) {
    let model = Model::from_text("m.fdm", TEXT).unwrap_or_else(|e| panic!("{e:?}"));
    let u = |t: f64| {
        if (1.0..4.0).contains(&(t % 9.0)) {
            1.0
        } else if (4.0..6.0).contains(&(t % 9.0)) {
            -1.0
        } else {
            0.0
        }
    };
    let (mut x, mut v, mut noise) = (0.0_f64, 0.0_f64, Noise::new(seed));
    let (mut inputs, mut measured, mut time) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..N {
        let t = k as f64 * DT;
        time.push(t);
        inputs.push(u(t));
        measured.extend([x + 0.01 * noise.next(), v + 0.02 * noise.next()]);
        for _ in 0..50 {
            let h = DT / 50.0;
            let a = 3.3 * u(t) - 4.4 * x - 0.7 * v;
            v += h * a;
            x += h * v;
        }
    }
    let run = Run {
        name: "r".into(),
        time,
        inputs,
        held: vec![true],
        measured,
        input_gaps: vec![0],
        output_gaps: vec![0, 0],
    };
    (model, run)
}

fn beside(run: &Run, model: &Model) -> Vec<Finding> {
    let records = vec![Record::of_run(model.definition(), run, None)];
    let runs = std::slice::from_ref(run);
    let found = examine_beside(model, runs, &records, Vec::new(), &BesideOptions::default());
    found.findings.into_iter().filter(|f| f.severity == Severity::Finding).collect()
}

#[test]
fn turned_axes_are_repaired_as_they_are_told() {
    let text = "model m { state s; param c = 1; der(s) = -c*s; output p = s, q = 2*s, r = 3*s; }";
    let model = Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e:?}"));
    let (names, record) = (["p", "q", "r"], [1.0, 20.0, 300.0]);
    let run = Run {
        name: "r".into(),
        time: vec![0.0, 1.0],
        inputs: Vec::new(),
        held: Vec::new(),
        measured: [record, record].concat(),
        input_gaps: Vec::new(),
        output_gaps: vec![0; 3],
    };
    let channels = Channels::new(model.definition());
    let all = discrete(&channels, &[], true);
    let axes: Vec<_> = all.iter().filter(|h| h.fault == Fault::Axes).collect();
    assert_eq!(axes.len(), 47);
    for hypothesis in axes {
        let new = edited(&run, &hypothesis.edits, model.definition()).unwrap_or_else(|e| panic!("{e:?}"));
        let told = hypothesis.what.strip_prefix("the axes x, y, z are ").unwrap_or_default();
        let told: Vec<&str> = told.split(" (").next().unwrap_or_default().split(", ").collect();
        let repair = channels.repair(&hypothesis.edits);
        for (k, name) in names.iter().enumerate() {
            let sign = if told[k].starts_with('-') { -1.0 } else { 1.0 };
            let from = ["x", "y", "z"].iter().position(|axis| told[k].ends_with(axis));
            assert_eq!(from.map(|j| sign * record[j]), Some(new.measured[k]), "{}", hypothesis.what);
            let change = repair.channels.get(*name).cloned().unwrap_or_default();
            let from = change.from.as_deref().unwrap_or(name);
            let repaired = names.iter().position(|n| *n == from).map(|j| change.factor * record[j]);
            assert_eq!(repaired, Some(new.measured[k]), "{}: {}", hypothesis.what, repair.line);
        }
    }
}

#[test]
fn faults_beside_a_model_are_named_with_repair_and_bias() {
    let (model, clean) = driven(4);
    assert!(beside(&clean, &model).is_empty(), "{:?}", beside(&clean, &model));

    let mut feet = clean.clone();
    feet.measured.iter_mut().step_by(2).for_each(|v| *v /= 0.3048);
    let found = beside(&feet, &model);
    assert_eq!((found[0].fault, found[0].channels[0].as_str()), (Fault::Unit, "x_m"), "{found:?}");
    assert_eq!(found[0].repair.as_ref().map(|r| r.channels["x_m"].factor), Some(0.3048));
    assert!(!found[0].biases.is_empty());

    let mut turned = clean.clone();
    turned.measured.iter_mut().skip(1).step_by(2).for_each(|v| *v = -*v);
    let found = beside(&turned, &model);
    assert_eq!((found[0].fault, found[0].channels[0].as_str()), (Fault::Sign, "v_m"), "{found:?}");

    let mut late = clean.clone();
    for k in (0..N).rev() {
        late.measured[2 * k + 1] = clean.measured[2 * k.saturating_sub(5) + 1];
    }
    let found = beside(&late, &model);
    assert_eq!((found[0].fault, found[0].channels[0].as_str()), (Fault::Delay, "v_m"), "{found:?}");
    let delay = found[0].repair.as_ref().map_or(0.0, |r| r.channels["v_m"].delay);
    assert!((delay - 5.0 * DT).abs() < DT, "{delay}");
}
