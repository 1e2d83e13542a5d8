//! Faults that are planted in records whose truth is known, and records without one.

use crate::hypothesis::{Channels, discrete, edited};
use crate::record::{Channel, Record, Role};
use crate::{
    AloneOptions, BesideOptions, Fault, Finding, Severity, examine_alone, examine_beside, examine_repeats, leading,
};
use fdm_estimate::Work;
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
        stated: Vec::new(),
        output_gaps: vec![0, 0],
    };
    (model, run)
}

fn beside(run: &Run, model: &Model) -> Vec<Finding> {
    let records = vec![Record::of_run(model.definition(), run, None)];
    let runs = std::slice::from_ref(run);
    let found = examine_beside(model, runs, &records, Vec::new(), &BesideOptions::default(), &Work::default());
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
        stated: Vec::new(),
        output_gaps: vec![0; 3],
    };
    let seen = Record::of_run(model.definition(), &run, None);
    let channels = Channels::of(std::slice::from_ref(&seen));
    let all = discrete(&channels, &channels.slots().collect::<Vec<_>>(), true);
    let axes: Vec<_> = all.iter().filter(|h| h.fault == Fault::Axes).collect();
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

#[test]
fn a_zero_that_moves_is_named_with_its_time_and_a_slow_drift_is_not() {
    let (model, mut run) = driven(6);
    for k in 350..N {
        run.measured[2 * k] += 0.25;
    }
    let found = beside(&run, &model);
    assert_eq!((found[0].fault, found[0].channels[0].as_str()), (Fault::ZeroShift, "x_m"), "{found:?}");
    assert!(found[0].place.is_some_and(|p| (p.from - 350.0 * DT).abs() < 0.5), "{found:?}");
    let (model, mut run) = driven(6);
    for k in 0..N {
        run.measured[2 * k] += 0.25 * k as f64 / N as f64;
    }
    assert!(beside(&run, &model).iter().all(|f| f.fault != Fault::ZeroShift), "{:?}", beside(&run, &model));
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
fn inputs_that_move_together_and_modes_between_samples_are_remarks() {
    let text = "model m { input a, b; state s; param c = 50 [1/s], ka = 1 [1/s], kb = 1 [1/s]; \
                der(s) = -c*s + ka*a + kb*b; output y = s; }";
    let model = Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e:?}"));
    let (a, mut noise) = (signal(8), Noise::new(9));
    let run = Run {
        name: "r".into(),
        time: (0..N).map(|k| k as f64 * DT).collect(),
        inputs: a.iter().flat_map(|v| [*v, 2.0 * v]).collect(),
        held: vec![false; 2],
        measured: a.iter().map(|v| 3.0 * v / 50.0 + 1e-4 * noise.next()).collect(),
        input_gaps: vec![0; 2],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let records = vec![Record::of_run(model.definition(), &run, None)];
    let found =
        examine_beside(&model, &[run], &records, Vec::new(), &BesideOptions::default(), &Work::default()).findings;
    let remark = |fault| found.iter().any(|f| f.fault == fault && f.severity == Severity::Remark);
    assert!(remark(Fault::CorrelatedInputs) && remark(Fault::SlowSampling), "{found:?}");
}

#[test]
fn what_is_read_between_samples_counts_without_the_averaging() {
    use crate::hypothesis::{lag_weights, lagged};
    use crate::spectrum::{Bands, interpolated};
    let mut noise = Noise::new(17);
    let white: Vec<f64> = (0..4096).map(|_| noise.next()).collect();
    let whole = |values: &[f64], left: &dyn Fn(f64) -> f64| {
        let mut bands = Bands::new(values.len());
        bands.add(&mut values.to_vec(), left);
        let mut plain = Bands::new(values.len());
        plain.add(&mut white[..values.len()].to_vec(), |_| 1.0);
        bands.gain_over(&plain)
    };
    for part in [0.2, 0.5] {
        let read: Vec<f64> = white.windows(2).map(|w| w[0] + part * (w[1] - w[0])).collect();
        // half a thousandth of a nat for each sample, where the uncorrected gain is a hundred times that
        let found = whole(&read, &|angle| interpolated(part * (1.0 - part), angle));
        assert!(found.abs() < 0.02 * read.len() as f64 && whole(&read, &|_| 1.0) > 0.1 * read.len() as f64, "{found}");
    }
    let times: Vec<f64> = (0..white.len()).map(|k| k as f64 * DT).collect();
    // the answer to a ramp stays behind by the time constant
    let ramp = lagged(&times, &times, 0.1, false);
    assert!((times[400] - ramp[400] - 0.1).abs() < 1e-9);
    let (a, c) = lag_weights(1e9, DT);
    assert!(a < 1.0 && (c - 1.0).abs() < 1e-9);
}

#[test]
fn two_late_outputs_are_named_as_such() {
    let (model, clean) = driven(9);
    let mut late = clean.clone();
    for k in (0..N).rev() {
        late.measured[2 * k] = clean.measured[2 * k.saturating_sub(5)];
        late.measured[2 * k + 1] = clean.measured[2 * k.saturating_sub(9) + 1];
    }
    let found = beside(&late, &model);
    for (channel, by) in [("x_m", 5.0 * DT), ("v_m", 9.0 * DT)] {
        let named = found.iter().find(|f| f.channels.iter().any(|c| c == channel));
        let delay = named.and_then(|f| f.repair.as_ref()).map_or(0.0, |r| r.channels[channel].delay);
        assert!((delay - by).abs() < DT, "{channel} {delay}: {found:?}");
    }
}

#[test]
fn an_output_that_is_late_by_half_a_swing_is_late_and_not_turned() {
    let (model, clean) = driven(14);
    let late = 30;
    let mut run = clean.clone();
    (0..N).for_each(|k| run.measured[2 * k + 1] = clean.measured[2 * k.saturating_sub(late) + 1]);
    for estimated in [true, false] {
        let records = vec![Record::of_run(model.definition(), &run, None)];
        let options = BesideOptions { estimated, most: 1, ..BesideOptions::default() };
        let found =
            examine_beside(&model, std::slice::from_ref(&run), &records, Vec::new(), &options, &Work::default())
                .findings;
        let first = found.iter().find(|f| f.severity == Severity::Finding).unwrap_or_else(|| panic!("{found:?}"));
        let delay = first.repair.as_ref().map_or(0.0, |r| r.channels["v_m"].delay);
        assert!(first.fault == Fault::Delay && (delay - late as f64 * DT).abs() < DT, "{estimated}: {first:?}");
    }
}

#[test]
fn beside_a_response_that_is_lost_the_search_ends_with_the_method_that_works() {
    // an unstable plant that a controller holds in place: 130 e-folds over the record; with a delay it cannot be cut into segments
    let text = "model p { input u; state x = free, v = free; param a = 9 [1/s^2], b = 1 [1/s^2], tau = 0.01 in [0, 0.1] [s]; der(x) = v; \
                der(v) = a*x + b*delay(u, tau); output x_m = x, v_m = v; }";
    let model = Model::from_text("p.fdm", text).unwrap_or_else(|e| panic!("{e:?}"));
    let (mut x, mut v, mut noise) = (0.05_f64, 0.0_f64, Noise::new(77));
    let (mut time, mut inputs, mut measured) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..2000 {
        let command = -30.0 * x - 8.0 * v + 0.5 * noise.next();
        time.push(0.02 * f64::from(k));
        inputs.push(command);
        measured.extend([x + 0.001 * noise.next(), v + 0.002 * noise.next()]);
        for _ in 0..25 {
            v += 0.0008 * (11.0 * x + 1.3 * command);
            x += 0.0008 * v;
        }
    }
    let (held, input_gaps, stated, output_gaps) = (vec![true], vec![0], vec![true], vec![0, 0]);
    let run = Run { name: "r".into(), time, inputs, held, measured, input_gaps, stated, output_gaps };
    let record = Record::of_run(model.definition(), &run, None);
    let found = examine_beside(&model, &[run], &[record], Vec::new(), &BesideOptions::default(), &Work::default());
    assert!(found.findings.iter().all(|f| f.severity == Severity::Remark), "{:?}", found.findings);
    assert!(found.fits < 5 && found.notes.iter().any(|n| n.contains("--method filter-error")), "{found:?}");
}

#[test]
fn a_model_that_lacks_a_lag_is_no_fault_of_its_record() {
    // the input passes an actuator and the output a second lag; neither stands in the model
    let text = "model m { input u; state s; param k = 1 [1/s], c = 0.4 [1/s]; der(s) = k*u - c*s; output y = s; }";
    let model = Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e:?}"));
    for seed in 0..4 {
        let mut noise = Noise::new(70 + seed);
        let u = |t: f64| if (t / (3.0 + 0.7 * seed as f64)) as u64 % 2 == 1 { 1.0 } else { 0.0 };
        let (mut a, mut s, mut y) = (0.0_f64, 0.0_f64, 0.0_f64);
        let (mut inputs, mut measured, mut time) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..N {
            let t = k as f64 * DT;
            time.push(t);
            // commands fall between samples, and the record says ramps
            inputs.push(u(t));
            measured.push(y + 0.01 * noise.next());
            for i in 0..50 {
                let h = DT / 50.0;
                a += h * (u(t + f64::from(i) * h) - a) / 0.3;
                s += h * (a - 0.35 * s);
                y += h * (s - y) / 0.4;
            }
        }
        let run = Run {
            name: "r".into(),
            time,
            inputs,
            held: vec![false],
            measured,
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
        };
        let found = beside(&run, &model);
        assert!(found.is_empty(), "{seed}: {found:?}");
    }
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
fn a_search_without_time_ends_with_what_it_has() {
    use fdm_estimate::{Halt, Stop};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    let (model, mut run) = driven(4);
    run.measured.iter_mut().step_by(2).for_each(|v| *v /= 0.3048);
    run.measured.iter_mut().skip(1).step_by(2).for_each(|v| *v = -*v);
    let records = vec![Record::of_run(model.definition(), &run, None)];
    let asked = Arc::new(AtomicUsize::new(0));
    let judge = |most: usize| {
        asked.store(0, Ordering::Relaxed);
        let count = Arc::clone(&asked);
        let halt = Halt::asking(move || (count.fetch_add(1, Ordering::Relaxed) >= most).then_some(Stop::TimeLimit));
        let runs = std::slice::from_ref(&run);
        examine_beside(&model, runs, &records, Vec::new(), &BesideOptions::default(), &Work::until(&halt))
    };
    let whole = judge(usize::MAX);
    let all = asked.load(Ordering::Relaxed);
    assert!(whole.notes.is_empty() && whole.findings.len() >= 2, "{whole:?}");
    for most in [0, 3, all / 4, all / 2, all - 1] {
        let part = judge(most);
        assert!(part.notes.len() == 1, "{most} of {all}: {part:?}");
        assert!(part.findings.len() <= whole.findings.len() + 1);
    }
}

#[test]
fn a_response_behind_lags_has_the_derivatives_of_its_values() {
    use crate::filtered::Filtered;
    use fdm_estimate::Response;
    use fdm_system::simulate::{Scheme, Simulator, Steps};
    let (model, run) = driven(3);
    let lags = [(0, 0.3), (1, 0.12), (0, 0.2)];
    let simulator = Simulator::new(model.dynamics(), &run, Steps::equal(Scheme::default(), 4)).expect("a simulator");
    let mut response = Filtered::new(simulator, &lags);
    let theta: Vec<f64> = model.definition().params.iter().map(|p| p.value).collect();
    let columns: Vec<usize> = (0..theta.len()).filter(|k| !model.definition().params[*k].fixed).collect();
    let size = run.measured.len();
    let (mut plain, mut y) = (vec![0.0; size], vec![0.0; size]);
    let mut slopes = vec![vec![0.0; size]; columns.len()];
    response.simulate(&theta, &mut plain).expect("a response");
    response
        .sensitivities(&theta, &columns, &mut |block| {
            y[2 * block.first..][..block.y.len()].copy_from_slice(block.y);
            for sample in 0..block.samples() {
                for (o, lanes) in block.layout.outputs.iter().enumerate() {
                    for (column, slope) in lanes.columns.iter().zip(block.row(sample, o)) {
                        slopes[*column as usize][2 * (block.first + sample) + o] = *slope;
                    }
                }
            }
        })
        .expect("sensitivities");
    assert_eq!(plain, y, "the same bits with and without sensitivities");
    for (slopes, column) in slopes.iter().zip(&columns) {
        let mut moved = |by: f64| {
            let (mut theta, mut y) = (theta.clone(), vec![0.0; size]);
            theta[*column] += by;
            response.simulate(&theta, &mut y).expect("a response");
            y
        };
        let (up, down) = (moved(1e-5), moved(-1e-5));
        let largest = slopes.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
        assert!(largest > 0.0, "no derivative is silently zero");
        for k in 0..size {
            let difference = (up[k] - down[k]) / 2e-5;
            assert!((difference - slopes[k]).abs() < 1e-6 * largest, "{k}: {difference} {}", slopes[k]);
        }
    }
}

/// A column of a run (N by 2) behind a first-order lag, with noise behind it.
fn slowed(run: &mut Run, output: usize, lag: f64, noise: f64, seed: u64) {
    let mut random = Noise::new(seed);
    let mut y = run.measured[output];
    for k in 0..N {
        let value = &mut run.measured[2 * k + output];
        // steps of a hundredth of a sample
        for _ in 0..100 {
            y += (*value - y) * DT / 100.0 / lag;
        }
        *value = y + noise * random.next();
    }
}

#[test]
fn a_filtered_output_is_told_from_a_late_one() {
    let (model, clean) = driven(12);
    for (output, name, lag) in [(1, "v_m", 0.4), (0, "x_m", 0.5)] {
        let mut run = clean.clone();
        slowed(&mut run, output, lag, 0.01, 31);
        let found = beside(&run, &model);
        assert!(!found.is_empty(), "{name}");
        assert_eq!((found[0].fault, found[0].channels[0].as_str()), (Fault::Filtered, name), "{found:?}");
    }
}

#[test]
fn a_second_fault_behind_a_unit_of_time_is_found() {
    let (model, clean) = driven(13);
    let mut run = clean.clone();
    run.time.iter_mut().for_each(|t| *t *= 1000.0);
    for k in (0..N).rev() {
        run.measured[2 * k] = clean.measured[2 * k.saturating_sub(6)];
    }
    let found = beside(&run, &model);
    assert!(found.iter().any(|f| f.fault == Fault::TimeUnit), "{found:?}");
    let late = found.iter().find(|f| f.fault == Fault::Delay && f.channels[0] == "x_m");
    let delay = late.and_then(|f| f.repair.as_ref()).map_or(0.0, |r| r.channels["x_m"].delay);
    assert!((delay - 6.0 * DT).abs() < DT, "{found:?}");

    let mut run = clean;
    run.time.iter_mut().for_each(|t| *t *= 1000.0);
    (350..N).for_each(|k| run.measured[2 * k] += 0.25);
    let found = beside(&run, &model);
    let moved = found.iter().find(|f| f.fault == Fault::ZeroShift && f.channels[0] == "x_m");
    assert!(moved.and_then(|f| f.place).is_some_and(|p| (p.from - 350.0 * 1000.0 * DT).abs() < 500.0), "{found:?}");
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
fn a_zero_that_kinematics_know_is_told_beside_a_trim_that_the_model_lacks() {
    let text = "model m { input u; state q [rad/s]; param M = -2 [1/s], d = 3 [rad/s^2]; der(q) = M*q + d*u; output q_m [rad/s] = q; }";
    let model = Model::from_text("m.fdm", text).unwrap_or_else(|e| panic!("{e:?}"));
    let made = |trim: f64, zero: f64| {
        let mut noise = Noise::new(51);
        let (mut q, mut theta) = (0.0, 0.0);
        let (mut inputs, mut measured, mut time, mut angle) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for k in 0..N {
            let t = k as f64 * DT;
            let u = if (t / 2.5) as u64 % 2 == 1 { 0.5 } else { -0.5 };
            time.push(t);
            inputs.push(u);
            measured.push(q + zero + 0.01 * noise.next());
            angle.push(theta + 0.002 * noise.next());
            for _ in 0..50 {
                q += DT / 50.0 * (-2.2 * q + 2.7 * (u + trim));
                theta += DT / 50.0 * q;
            }
        }
        let run = Run {
            name: "r".into(),
            time,
            inputs,
            held: vec![true],
            measured,
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
        };
        let mut record = Record::of_run(model.definition(), &run, None);
        record.channels.push(Channel { unit: Some("rad".into()), role: Role::Unknown, ..channel("theta", angle) });
        let found = examine_beside(&model, &[run], &[record], Vec::new(), &BesideOptions::default(), &Work::default());
        found.findings.into_iter().filter(|f| f.severity == Severity::Finding).collect::<Vec<Finding>>()
    };
    for trim in [0.0, 0.05, -0.05] {
        let found = made(trim, 0.2);
        let zero = found.iter().find(|f| f.fault == Fault::Offset && f.channels[0] == "q_m");
        let offset = zero.and_then(|f| f.repair.as_ref()).map_or(0.0, |r| r.channels["q_m"].offset);
        // beside a trim the number is a compromise with what the model says
        let near = if trim == 0.0 { 0.02 } else { 0.1 };
        assert!((offset + 0.2).abs() < near, "trim {trim}: {found:?}");
        assert!(made(trim, 0.0).is_empty(), "trim {trim}: {:?}", made(trim, 0.0));
    }
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
fn a_start_that_leads_nowhere_is_no_fault_of_the_record() {
    let text = "model two { input u; state x = 0, v = 0; param theta = 1 in [-20, 20]; der(x) = v; der(v) = theta*v + u; output y = x; }";
    let model = Model::from_text("two.fdm", text).expect("compiles");
    let (mut noise, mut x, mut v) = (Noise::new(61), 0.0, 0.0);
    let saw = |t: f64| 2.0 * (t / 6.3).fract() - 1.0;
    let (mut time, mut inputs, mut measured) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..N {
        let t = 0.1 * k as f64;
        time.push(t);
        inputs.push(saw(t));
        measured.push(x + 0.02 * noise.next());
        let next = saw(t + 0.1);
        for i in 0..100 {
            let part = (f64::from(i) + 0.5) / 100.0;
            let u = saw(t) + part * (next - saw(t));
            let middle = v + 0.0005 * (-1.7 * v + u);
            (x, v) = (x + 0.001 * middle, v + 0.001 * (-1.7 * middle + u));
        }
    }
    let (held, input_gaps, output_gaps) = (vec![false], vec![0], vec![0]);
    let run = Run { name: "r".into(), time, inputs, held, measured, input_gaps, stated: Vec::new(), output_gaps };
    let record = Record::of_run(model.definition(), &run, None);
    let found = examine_beside(&model, &[run], &[record], Vec::new(), &BesideOptions::default(), &Work::default());
    assert!(found.findings.iter().all(|f| f.severity == Severity::Remark), "{:?}", found.findings);
}
