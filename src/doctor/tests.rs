//! Faults that are planted in records whose truth is known, and records without one.

use crate::{
    AloneOptions, Channel, Channels, Fault, Finding, Record, Role, Severity, discrete, edited, examine_alone,
    examine_repeats, leading, repaired_map,
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
        stated: Vec::new(),
        output_gaps: vec![0; 3],
    };
    let seen = Record::of_run(model.definition(), &run, None);
    let channels = Channels::of(std::slice::from_ref(&seen));
    let all = discrete(&channels, &channels.slots().collect::<Vec<_>>(), true);
    let axes: Vec<_> = all.iter().filter(|h| h.fault == Fault::Axes && h.frame.is_none()).collect();
    assert_eq!(axes.len(), 47);
    for hypothesis in axes {
        let new = edited(&run, &seen, &channels, &hypothesis.edits, model.definition());
        let new = new.unwrap_or_else(|e| panic!("{e:?}"));
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

/// Euler angles in closed form, and the body rates of that motion (FRD), with noise.
fn attitude(seed: u64) -> Record {
    let mut noise = Noise::new(seed);
    let wave = |a: f64, f: f64, p: f64, t: f64| (a * (f * t + p).sin(), a * f * (f * t + p).cos());
    let mut columns = vec![Vec::new(); 6];
    for k in 0..N {
        let t = k as f64 * DT;
        let ((phi, dphi), (theta, dtheta), (psi, dpsi)) =
            (wave(0.4, 1.1, 0.0, t), wave(0.2, 1.7, 0.5, t), wave(0.6, 0.6, 1.0, t));
        let p = dphi - dpsi * theta.sin();
        let q = dtheta * phi.cos() + dpsi * theta.cos() * phi.sin();
        let r = dpsi * theta.cos() * phi.cos() - dtheta * phi.sin();
        for (column, v) in columns.iter_mut().zip([phi, theta, psi, p, q, r]) {
            column.push(v + 0.002 * noise.next());
        }
    }
    let named = ["phi", "theta", "psi", "p", "q", "r"].into_iter().zip(columns).enumerate();
    let channels = named.map(|(k, (name, values))| Channel {
        unit: Some(if k < 3 { "rad" } else { "rad/s" }.into()),
        role: Role::Unknown,
        ..channel(name, values)
    });
    let time = (0..N).map(|k| k as f64 * DT).collect();
    Record { run: "r".into(), time, clocked: true, channels: channels.collect() }
}

#[test]
fn kinematics_tell_exchanged_angles_turned_axes_and_the_zero_of_a_rate() {
    assert!(judged(&attitude(1)).is_empty(), "{:?}", judged(&attitude(1)));

    let mut exchanged = attitude(2);
    let (phi, theta) = (exchanged.channels[0].values.clone(), exchanged.channels[1].values.clone());
    (exchanged.channels[0].values, exchanged.channels[1].values) = (theta, phi);
    let found = judged(&exchanged);
    assert_eq!((found[0].fault, &found[0].channels[..]), (Fault::Swapped, &["phi".into(), "theta".into()][..]));

    let mut left = attitude(3);
    left.channels[4..].iter_mut().for_each(|c| c.values.iter_mut().for_each(|v| *v = -*v));
    let found = judged(&left);
    assert!(found[0].fault == Fault::Axes && found[0].what.contains("forward-left-up"), "{found:?}");

    let mut zero = attitude(4);
    zero.channels[4].values.iter_mut().for_each(|v| *v += 0.1);
    let found = judged(&zero);
    assert_eq!((found[0].fault, found[0].channels[0].as_str()), (Fault::Offset, "q"), "{found:?}");
    let offset = found[0].repair.as_ref().map_or(0.0, |r| r.channels["q"].offset);
    assert!((offset + 0.1).abs() < 0.01, "{offset}");

    let mut two = attitude(5);
    two.channels[3].values.iter_mut().for_each(|v| *v = -*v);
    two.channels[2].values.iter_mut().for_each(|v| *v *= 57.295_779_513_082_32);
    let found = judged(&two);
    let named = |fault: Fault, channel: &str| found.iter().any(|f| f.fault == fault && f.channels[0] == channel);
    assert!(named(Fault::Sign, "p") && named(Fault::Unit, "psi") && found.len() == 2, "{found:?}");
}

#[test]
fn factors_lines_and_leads_are_remarks() {
    let remarks = |record: &Record| -> Vec<Finding> {
        let found = examine_alone(record, &AloneOptions::default());
        found.into_iter().filter(|f| f.severity == Severity::Remark).collect()
    };
    assert!(remarks(&attitude(7)).is_empty(), "{:?}", remarks(&attitude(7)));
    let mut scaled = attitude(7);
    scaled.channels[3].values.iter_mut().for_each(|v| *v *= 0.8);
    let found = examine_alone(&scaled, &AloneOptions::default());
    assert!(found.iter().any(|f| f.fault == Fault::Scale && f.channels[0] == "p"), "{found:?}");
    // noise hides what it is, and not that there is something
    for (channel, noise) in scaled.channels.iter_mut().zip([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]) {
        let mut random = Noise::new(77);
        channel.values.iter_mut().for_each(|v| *v += noise * random.next());
    }
    let found = examine_alone(&scaled, &AloneOptions::default());
    assert!(found.iter().any(|f| f.fault == Fault::Scale && f.channels[0] == "p"), "{found:?}");

    let mut shaken = record(8);
    // 27.3 turns a second, sampled 20 times: 7.3 are seen
    let times = shaken.time.clone();
    let shake = |t: &f64| 0.05 * (std::f64::consts::TAU * 27.3 * t).sin();
    shaken.channels[1].values.iter_mut().zip(&times).for_each(|(v, t)| *v += shake(t));
    let found = remarks(&shaken);
    assert!(found.len() == 1 && found[0].fault == Fault::Aliased && found[0].channels == ["b"], "{found:?}");
    assert!(found[0].what.contains("7.3"), "{}", found[0].what);

    let mut lead = record(9);
    lead.time.iter_mut().skip(1).for_each(|t| *t += 4.0 * DT);
    let found = examine_alone(&lead, &AloneOptions::default());
    assert_eq!((found[0].fault, found[0].severity), (Fault::Gap, Severity::Remark), "{found:?}");
}

#[test]
fn one_channel_in_another_unit_than_those_that_state_theirs_is_told() {
    let degrees = |record: &mut Record, k: usize| {
        record.channels[k].values.iter_mut().for_each(|v| *v *= 180.0 / std::f64::consts::PI);
        record.channels[k].unit = None;
    };
    let mut one = attitude(9);
    degrees(&mut one, 3);
    let found = judged(&one);
    assert_eq!((found[0].fault, found[0].channels[0].as_str()), (Fault::Unit, "p"), "{found:?}");
    // where nobody states a unit it is the reader's choice
    let mut all = attitude(9);
    (0..6).for_each(|k| degrees(&mut all, k));
    assert!(judged(&all).is_empty(), "{:?}", judged(&all));
}

#[test]
fn commands_are_no_sensors() {
    let wave = |k: usize| (0.1 * k as f64).sin();
    let level = |k: usize| f64::from(u32::try_from(k * k % 41).unwrap_or(0)) - 20.0;
    let given: [(&str, &dyn Fn(usize) -> f64); 9] = [
        ("held levels", &|k| level(k / 10)),
        ("a staircase", &|k| 0.1 * (k / 30) as f64),
        ("gears", &|k| (k / 25 * 7 % 5) as f64),
        ("rest, then a motion", &|k| 0.4 + if k < 90 { 0.0 } else { wave(k - 90) }),
        ("a pause between two motions", &|k| if k < 200 { wave(k) } else { wave(if k < 260 { 200 } else { k - 60 }) }),
        ("a doublet on a trim", &|k| {
            0.3 + if (100..130).contains(&k) { 1.0 } else { -f64::from(u8::from((130..160).contains(&k))) }
        }),
        ("a motion at its limit", &|k| wave(k).clamp(-0.7, 0.7)),
        ("a heater", &|k| (40.0 * wave(k / 2)).max(0.0).round()),
        ("a held motion", &|k| wave(k / 7 * 7)),
    ];
    for (kind, of) in given {
        for role in [Role::Input, Role::Unknown] {
            let mut record = record(31);
            let values = (0..N).map(of).collect();
            record.channels.push(Channel { role, ..channel("u", values) });
            record.channels.rotate_right(1);
            let found = judged(&record);
            assert!(found.is_empty(), "{kind}, {role:?}: {found:?}");
        }
    }
    // what dithers between few levels is measured, whoever has named it
    let mut dithering = record(32);
    let rough: Vec<f64> = dithering.channels[0].values.iter().map(|v| 0.2 * (v / 0.2).round()).collect();
    dithering.channels.push(Channel { role: Role::Unknown, ..channel("c", rough) });
    assert_eq!(first(&dithering), (Fault::Quantised, "c".into()));
}

#[test]
fn gravity_tells_turned_frames_and_the_map_turns_them_back() {
    const G: f64 = 9.806_65;
    // roll, pitch and yaw of `attitude`, and what thrust along z does at a steady height; or accelerometers of one that rests
    let flown = |seed: u64, felt: bool| {
        let mut record = attitude(seed);
        let mut noise = Noise::new(seed + 50);
        let angles: Vec<[f64; 3]> = (0..N).map(|k| [0, 1, 2].map(|c| record.channels[c].values[k])).collect();
        let mut rows = vec![Vec::new(); 3];
        let (mut velocity, mut before) = ([2.0, -1.0, 0.0], [0.0; 2]);
        for [phi, theta, psi] in &angles {
            let ahead = -G * theta.tan();
            let right = G * phi.tan() / theta.cos();
            let force = [G * theta.sin(), -G * theta.cos() * phi.sin(), -G * theta.cos() * phi.cos()];
            // by the trapezoidal rule, as exact as the samples
            let now = [ahead * psi.cos() - right * psi.sin(), ahead * psi.sin() + right * psi.cos()];
            for (k, (v, w)) in velocity.iter_mut().zip(now).enumerate() {
                *v += 0.5 * DT * (before[k] + w);
                before[k] = w;
            }
            for (k, row) in rows.iter_mut().enumerate() {
                row.push(if felt { force[k] + 0.1 * noise.next() } else { velocity[k] + 0.05 * noise.next() });
            }
        }
        if !felt {
            record.channels.truncate(3);
        }
        let (names, unit) = if felt { (["ax", "ay", "az"], "m/s^2") } else { (["vx", "vy", "vz"], "m/s") };
        let made = names.into_iter().zip(rows);
        record.channels.extend(made.map(|(name, values)| Channel {
            unit: Some(unit.into()),
            role: Role::Unknown,
            ..channel(name, values)
        }));
        record
    };
    // from north-east-down and forward-right-down
    let turned = |record: &mut Record, changes: &[(&str, &str, f64, f64)]| {
        let before = record.clone();
        for (name, from, sign, offset) in changes {
            let of = |n: &str| before.channels.iter().position(|c| c.name == n).unwrap_or_else(|| panic!("{n}"));
            let values = before.channels[of(from)].values.iter().map(|v| sign * v + offset).collect();
            record.channels[of(name)].values = values;
        }
    };
    for felt in [true, false] {
        let found = judged(&flown(7, felt));
        assert!(found.is_empty(), "{found:?}");
    }
    let half = std::f64::consts::FRAC_PI_2;
    let over = |name| (name, name, -1.0, 0.0);
    for (felt, frame, changes) in [
        (
            true,
            "enu-flu",
            vec![over("theta"), ("psi", "psi", -1.0, half), over("q"), over("r"), over("ay"), over("az")],
        ),
        (true, "ned-flu", vec![over("q"), over("r"), over("ay"), over("az")]),
        (
            false,
            "enu-flu",
            vec![over("theta"), ("psi", "psi", -1.0, half), ("vx", "vy", 1.0, 0.0), ("vy", "vx", 1.0, 0.0), over("vz")],
        ),
        (false, "nwu-frd", vec![over("vy"), over("vz")]),
        (false, "enu-frd", vec![("vx", "vy", 1.0, 0.0), ("vy", "vx", 1.0, 0.0), over("vz")]),
    ] {
        let mut record = flown(9, felt);
        turned(&mut record, &changes);
        let found = judged(&record);
        let repair = found.first().and_then(|f| f.repair.clone()).unwrap_or_else(|| panic!("{frame}: nothing"));
        assert_eq!((found[0].fault, repair.line), (Fault::Axes, format!("frame = \"{frame}\"")), "{found:#?}");
        let map = repaired_map(&record, None, found.iter().filter_map(|f| f.repair.as_ref()));
        assert_eq!(map.frame.map(|f| f.to_string()).as_deref(), Some(frame));
    }
}
