//! Logs of every format are read whole, and damaged ones with what is damaged in them.

use crate::samples::{ROWS, dataflash, micros, rate, ulog};
use crate::{ChannelMap, ClockMap, FreeDelay, Log, ReadError, RecordMap, TakeError, open, take, unzipped};
use crate::{Field, Topic};

/// The files that the software of each format wrote, by `studies/records/make.py`.
fn file(name: &str) -> Vec<u8> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/samples/");
    std::fs::read(format!("{path}{name}")).expect("a sample")
}

fn values<'a>(log: &'a Log, path: &str) -> &'a [f64] {
    let (topic, field) = log.find(path).unwrap_or_else(|| panic!("{path} in {log:?}"));
    &log.topics[topic].fields[field].values
}

fn expected(of: impl Fn(f64) -> f64) -> Vec<f64> {
    (0..200).map(|k| of(f64::from(k))).collect()
}

fn p(k: f64) -> f64 {
    (k * k) % 97.0 / 16.0 - 3.0
}

/// The four signals that every file of `make.py` holds.
fn is_read(log: &Log, [t, p_name, y, u]: [&str; 4]) {
    assert!(log.damage.is_empty(), "{log:?}");
    assert_eq!(values(log, t), expected(|k| k / 128.0));
    assert_eq!(values(log, p_name), expected(p));
    assert_eq!(values(log, y), expected(|k| -k / 8.0));
    assert_eq!(values(log, u), expected(|k| k % 3.0));
}

#[cfg(feature = "npz")]
#[test]
fn arrays_of_numpy_are_read_to_the_bit() {
    for name in ["plain.npz", "packed.npz"] {
        let log = open(&file(name)).unwrap();
        is_read(&log, ["t", "p", "y[:,1]", "u"]);
        let table = log.topics.iter().find(|t| t.name.is_empty()).unwrap();
        assert_eq!(table.time.map(|k| table.fields[k].name.as_str()), Some("t"));
    }
    let log = open(&file("plain.npz")).unwrap();
    assert_eq!(values(&log, "mass"), [2.5]);
    assert!(log.remarks.iter().any(|r| r.contains("`name` holds `<U6`")), "{:?}", log.remarks);
    let log = open(&file("array.npy")).unwrap();
    assert_eq!(values(&log, "value[:,1]"), expected(p));
}

#[cfg(feature = "mat")]
#[test]
fn variables_of_matlab_are_read_to_the_bit() {
    for name in ["plain.mat", "packed.mat"] {
        let log = open(&file(name)).unwrap();
        is_read(&log, ["t", "p", "y(:,2)", "u"]);
        assert_eq!(values(&log, "run.q"), expected(p));
        assert!(log.remarks.iter().any(|r| r == "`label` is text"), "{:?}", log.remarks);
    }
    let log = open(&file("plain.mat")).unwrap();
    assert_eq!(values(&log, "cells{1}"), expected(p));
    assert_eq!(values(&log, "cells{2}(:,2)"), expected(|k| -k / 8.0));
}

#[cfg(feature = "hdf5")]
#[test]
fn sets_of_hdf5_are_read_to_the_bit() {
    let log = open(&file("table.h5")).unwrap();
    is_read(&log, ["t", "flight/p", "flight/y[:,1]", "flight/u"]);
    let (topic, field) = log.find("flight/p").unwrap();
    assert_eq!(log.topics[topic].fields[field].unit.as_deref(), Some("rad/s"));
    let log = open(&file("matlab73.mat")).unwrap();
    assert_eq!(values(&log, "p"), expected(p));
    assert_eq!(values(&log, "y(:,2)"), expected(|k| -k / 8.0));
}

#[cfg(feature = "parquet")]
#[test]
fn columns_of_parquet_are_read_to_the_bit() {
    let log = open(&file("table.parquet")).unwrap();
    assert_eq!(values(&log, "t [s]"), expected(|k| k / 128.0));
    let found = values(&log, "p [rad/s]");
    assert!(found[5].is_nan());
    assert_eq!((found[4], found[6], found[199]), (p(4.0), p(6.0), p(199.0)));
    assert_eq!(values(&log, "u"), expected(|k| k % 3.0));
}

#[cfg(not(all(feature = "hdf5", feature = "parquet", feature = "xlsx")))]
#[test]
fn a_reader_that_is_off_says_its_feature() {
    let off = |name: &str| open(&file(name)).unwrap_err().to_string();
    #[cfg(not(feature = "hdf5"))]
    assert!(off("matlab73.mat").contains("--features hdf5"), "{}", off("matlab73.mat"));
    #[cfg(not(feature = "xlsx"))]
    assert!(off("table.xlsx").contains("--features xlsx"), "{}", off("table.xlsx"));
    #[cfg(not(feature = "parquet"))]
    assert!(off("table.parquet").contains("--features parquet"), "{}", off("table.parquet"));
}

#[cfg(feature = "ulog")]
#[test]
fn topics_of_px4_are_read_to_the_bit() {
    let log = open(&ulog()).unwrap();
    assert!(log.damage.is_empty(), "{:?}", log.damage);
    let names: Vec<&str> = log.names().collect();
    assert_eq!(names, ["vehicle_angular_velocity[0]", "vehicle_attitude[0]", "vehicle_torque_setpoint[0]"]);
    let found = values(&log, "vehicle_angular_velocity.xyz[1]");
    assert!(found.iter().enumerate().all(|(k, v)| *v == f64::from(rate(k, 1))) && found.len() == ROWS);
    assert_eq!(values(&log, "vehicle_attitude.roll"), vec![0.0; ROWS / 2]);
    assert_eq!(log.topics[0].seconds().unwrap()[3], micros(3, 1) as f64 / 1e6);
    assert_eq!(log.remarks, ["the logger reports 1 dropouts of 0.020 s together"]);
}

#[cfg(feature = "dataflash")]
#[test]
fn messages_of_ardupilot_are_read_to_the_bit() {
    let log = open(&dataflash()).unwrap();
    assert!(log.damage.is_empty(), "{:?}", log.damage);
    let found = values(&log, "IMU[1].GyrY");
    assert!(found.iter().enumerate().all(|(k, v)| *v == f64::from(rate(k, 1) + 1.0)) && found.len() == ROWS);
    assert_eq!(values(&log, "ATT.Pitch")[1], -0.02);
    let (topic, field) = log.find("ATT.Roll").unwrap();
    assert_eq!(log.topics[topic].fields[field].unit.as_deref(), Some("deg"));
    let (topic, field) = log.find("IMU.GyrX").unwrap();
    assert_eq!(
        (log.topics[topic].name.as_str(), log.topics[topic].fields[field].unit.as_deref()),
        ("IMU[0]", Some("rad/s"))
    );
}

/// How many of 200 files that were cut, and of 200 in which eight bits were turned, are read as if they were whole although their numbers are
/// others. What is accepted of a cut file is the beginning of the whole, in any case, and nothing panics.
fn accepted(whole: &[u8]) -> (usize, usize) {
    let all = open(whole).unwrap();
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = |n: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % n as u64) as usize
    };
    let same = |log: &Log| format!("{:?}", (&log.topics, &log.sheets)) == format!("{:?}", (&all.topics, &all.sheets));
    let silent = |bytes: &[u8]| open(bytes).ok().filter(|log| log.damage.is_empty() && !same(log));
    let beginning = |log: &Log| {
        log.topics.iter().all(|topic| {
            let whole = all.topics.iter().find(|t| t.name == topic.name).expect("a topic of the whole");
            topic.fields.iter().all(|f| whole.field(&f.name).is_some_and(|w| w.values.starts_with(&f.values)))
        })
    };
    let cut: Vec<Log> = (0..200).filter_map(|_| silent(&whole[..random(whole.len())])).collect();
    assert!(cut.iter().all(beginning));
    let flipped = (0..200).filter(|_| {
        let mut bytes = whole.to_vec();
        (0..8).for_each(|_| bytes[random(whole.len())] ^= 1 << random(8));
        silent(&bytes).is_some()
    });
    (cut.len(), flipped.count())
}

#[cfg(feature = "npz")]
#[test]
fn damaged_archives_of_numpy_are_never_accepted() {
    assert_eq!(accepted(&file("plain.npz")), (0, 0));
    assert_eq!(accepted(&file("packed.npz")), (0, 0));
    // the numbers of a single array have no checksum
    assert_eq!(accepted(&file("array.npy")), (0, 179));
}

/// A file of MATLAB has no end: one that ends between two variables is whole. Its packed numbers have a checksum, others have none.
#[cfg(feature = "mat")]
#[test]
fn damaged_files_of_matlab_are_seen_as_far_as_the_format_allows() {
    assert_eq!(accepted(&file("packed.mat")), (1, 0));
    assert_eq!(accepted(&file("plain.mat")), (0, 160));
}

/// A log that ends between two messages is whole, and its numbers have no checksum; but few flips do not hit what the format prescribes.
#[cfg(feature = "ulog")]
#[test]
fn damaged_logs_of_px4_are_seen_as_far_as_the_format_allows() {
    assert_eq!(accepted(&ulog()), (13, 5));
}

#[cfg(feature = "dataflash")]
#[test]
fn damaged_logs_of_ardupilot_are_seen_as_far_as_the_format_allows() {
    assert_eq!(accepted(&dataflash()), (13, 1));
}

#[cfg(feature = "hdf5")]
#[test]
fn damaged_sets_of_hdf5_are_seen_as_far_as_the_format_allows() {
    // plain sets have no checksum, and no set has one of its place in the file
    assert_eq!(accepted(&file("table.h5")), (0, 117));
    assert_eq!(accepted(&file("matlab73.mat")), (0, 5));
}

#[cfg(feature = "parquet")]
#[test]
fn damaged_columns_of_parquet_are_never_accepted() {
    assert_eq!(accepted(&file("table.parquet")), (0, 0));
}

#[cfg(feature = "gzip")]
#[test]
fn compressed_text_is_unpacked_with_its_checksum() {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    let text: String = (0..500).map(|k| format!("{k},{}\n", k * k % 97)).collect();
    encoder.write_all(text.as_bytes()).unwrap();
    let packed = encoder.finish().unwrap();
    assert_eq!(unzipped(&packed, 1 << 20).unwrap().unwrap(), text.as_bytes());
    assert!(unzipped(b"t,x\n", 1 << 20).is_none());
    assert!(matches!(unzipped(&packed, 100), Some(Err(ReadError::TooLarge { limit: 100, .. }))));
    for cut in [packed.len() - 1, packed.len() / 2, 12] {
        assert!(matches!(unzipped(&packed[..cut], 1 << 20), Some(Err(ReadError::Broken { .. }))), "{cut}");
    }
}

/// A log of WPILib: a header, records of entries by the shortest numbers, times in microseconds.
#[cfg(feature = "wpilog")]
fn wpilog(extra: &str, records: &[(u32, u64, Vec<u8>)]) -> Vec<u8> {
    let mut out = [b"WPILOG\x00\x01", &(extra.len() as u32).to_le_bytes()[..], extra.as_bytes()].concat();
    let shortest = |v: u64| 8 - (v.leading_zeros() as usize / 8).min(7);
    for (entry, time, payload) in records {
        let lengths = [u64::from(*entry), payload.len() as u64, *time].map(shortest);
        out.push(((lengths[0] - 1) | (lengths[1] - 1) << 2 | (lengths[2] - 1) << 4) as u8);
        for (value, length) in [u64::from(*entry), payload.len() as u64, *time].into_iter().zip(lengths) {
            out.extend(&value.to_le_bytes()[..length]);
        }
        out.extend(payload);
    }
    out
}

#[cfg(feature = "wpilog")]
#[test]
fn entries_of_wpilib_are_read_to_the_bit_and_what_is_cut_off_is_told() {
    let text = |t: &str| [&(t.len() as u32).to_le_bytes()[..], t.as_bytes()].concat();
    let start = |entry: u32, name: &str, kind: &str| {
        let body = [&[0][..], &entry.to_le_bytes(), &text(name), &text(kind), &text("{}")].concat();
        (0, 100, body)
    };
    let doubles = |v: &[f64]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let kinds = ["double", "float", "int64", "boolean", "double[]", "string", "struct:Pose2d"];
    let mut records: Vec<_> = kinds.iter().zip(1..).map(|(kind, k)| start(k, &format!("/{kind}"), kind)).collect();
    for k in 0..300_u64 {
        let time = 70_000 + 20_000 * k;
        records.push((1, time, doubles(&[k as f64 / 7.0])));
        records.push((2, time, (k as f32).to_le_bytes().to_vec()));
        records.push((3, time, (-(k as i64)).to_le_bytes().to_vec()));
        records.push((4, time, vec![u8::from(k % 2 == 1)]));
        records.push((5, time, doubles(&[k as f64, -1.0][..1 + usize::from(k > 0)])));
        records.push((6, time, b"on".to_vec()));
        records.push((7, time, vec![0; 24]));
    }
    // an entry that ends, and one of its name that goes on under another number
    records.push((0, 7_000_000, [&[1][..], &1_u32.to_le_bytes()].concat()));
    records.push(start(900, "/double", "double"));
    records.push((900, 8_000_000, doubles(&[43.0])));
    let bytes = wpilog("{\"robot\":7}", &records);
    let log = open(&bytes).unwrap();
    assert!(log.damage.is_empty(), "{:?}", log.damage);
    let of = |path: &str| values(&log, path).to_vec();
    let all = |of: &dyn Fn(f64) -> f64| (0..300).map(|k| of(f64::from(k))).collect::<Vec<f64>>();
    assert_eq!(of("/double.value"), [all(&|k| k / 7.0), vec![43.0]].concat());
    assert_eq!((of("/float.value"), of("/int64.value")), (all(&|k| k), all(&|k| -k)));
    assert_eq!((of("/boolean.value"), of("/double[].value[0]")), (all(&|k| k % 2.0), all(&|k| k)));
    assert!(of("/double[].value[1]")[0].is_nan() && of("/double[].value[1]")[1..].iter().all(|v| *v == -1.0));
    let (topic, _) = log.find("/double.value").unwrap();
    assert_eq!(log.topics[topic].seconds().unwrap()[299..], [6.05, 8.0]);
    assert_eq!(log.remarks, ["no numbers, left out: `/string` (string), `/struct:Pose2d` (struct:Pose2d)"]);

    let cut = open(&bytes[..bytes.len() - 3]).unwrap();
    assert!(cut.damage[0].to_string().contains("cut off; 12 bytes are lost"), "{:?}", cut.damage);
    let wrong = wpilog("", &[start(1, "a", "double"), (1, 5, vec![0; 3]), (2, 5, vec![0; 8])]);
    let told: Vec<String> = open(&wrong).unwrap().damage.iter().map(|d| d.what.clone()).collect();
    assert!(
        told[0].contains("3 bytes for a value of `a`") && told[1].contains("entry 2, which has not begun"),
        "{told:?}"
    );
    assert!(open(b"WPILOG\x00\x02\0\0\0\0").unwrap_err().to_string().contains("version 2.0, and 1.0 is read"));
}

#[test]
fn formats_of_other_tools_are_refused_with_what_writes_them_as_text() {
    for (bytes, how) in [
        (&b"\x89MCAP0\r\n"[..], "ros2 topic echo --csv"),
        (b"#ROSBAG V2.0\n", "rostopic echo -b"),
        (b"SQLite format 3\0", "ros2 bag play"),
    ] {
        assert!(crate::is_known(bytes) && open(bytes).unwrap_err().to_string().contains(how));
    }
}

fn map(text: &str) -> RecordMap {
    RecordMap::parse(text).unwrap()
}

#[cfg(feature = "ulog")]
#[test]
fn a_map_takes_topics_of_several_clocks() {
    let log = open(&ulog()).unwrap();
    let all = "[channel.p]\nfrom = \"vehicle_angular_velocity.xyz[0]\"\nsign = -1\nunit = \"rad/s\"\n\
               [channel.phi]\nfrom = \"vehicle_attitude.roll\"\n\
               [channel.u]\nfrom = \"vehicle_torque_setpoint.xyz[0]\"\nhold = true\n";
    let taken = take(&log, &map(all), &|_| Some(false)).unwrap();
    let column = |name: &str| &taken.columns.iter().find(|c| c.name == name).unwrap().values;
    let time = taken.time.as_ref().unwrap();
    // up to the last sample of the slowest sensor; each sensor at its own times, a command at all
    assert_eq!((time.len(), time[1]), (ROWS - 1, micros(1, 1) as f64 / 1e6));
    assert!(column("p").iter().enumerate().all(|(k, v)| *v == -f64::from(rate(k, 0))));
    assert!(column("phi").iter().enumerate().all(|(k, v)| v.is_nan() == (k % 2 == 1)));
    assert_eq!((column("u")[127], column("u")[128]), (0.0, 0.5));
    assert_eq!(taken.columns.iter().map(|c| c.unit.as_deref()).collect::<Vec<_>>(), [Some("rad/s"), Some("rad"), None]);
    let grid = take(&log, &map(&format!("[time]\nrate = 20\n{all}")), &|_| Some(false)).unwrap();
    let time = grid.time.unwrap();
    assert!(
        time.windows(2).all(|w| (w[1] - w[0] - 0.05).abs() < 1e-12)
            && grid.columns.iter().all(|c| !c.values[5].is_nan())
    );
    // one topic keeps its own times, to the bit
    let own = take(&log, &map(all), &|name| (name == "p").then_some(false)).unwrap();
    assert_eq!((own.columns.len(), own.time.unwrap().len()), (1, ROWS));
}

#[test]
fn commands_keep_their_own_edges() {
    use crate::{Field, Topic};
    let topic = |name: &str, field: &str, t: Vec<f64>, values: Vec<f64>| Topic {
        name: name.into(),
        time: Some(0),
        fields: vec![Field::new("t", Some("s"), t), Field::new(field, None, values)],
    };
    let sensor = topic("a", "y", (0..6).map(f64::from).collect(), vec![1.0; 6]);
    // one that repeats the value before has no edge
    let command = topic("b", "u", vec![-0.5, 1.25, 2.0, 2.75, 7.0], vec![0.0, 1.0, 1.0, 3.0, 4.0]);
    let log = Log { format: "test", topics: vec![sensor, command], ..Log::default() };
    let text = "[channel.y]\nfrom = \"a.y\"\n[channel.u]\nfrom = \"b.u\"\nhold = true\n";
    let taken = take(&log, &map(text), &|name| Some(name == "u")).unwrap();
    assert_eq!(taken.time.unwrap(), [0.0, 1.0, 1.25, 2.0, 2.75, 3.0, 4.0, 5.0]);
    let column = |name: &str| &taken.columns.iter().find(|c| c.name == name).unwrap().values;
    assert_eq!(*column("u"), [0.0, 0.0, 1.0, 1.0, 3.0, 3.0, 3.0, 3.0]);
    let shown: Vec<bool> = column("y").iter().map(|v| !v.is_nan()).collect();
    assert_eq!(shown, [true, true, false, true, false, true, true, true]);
    // there nothing is missing
    let sampled = |name: &str| &taken.columns.iter().find(|c| c.name == name).unwrap().sampled;
    assert_eq!((sampled("y"), sampled("u").len()), (&shown, 0));
}

#[test]
fn delays_wraps_and_gaps_are_as_the_map_says() {
    use crate::{Field, Topic};
    let t: Vec<f64> = (0..40).map(f64::from).filter(|t| !(10.0..30.0).contains(t)).collect();
    let angle: Vec<f64> = t.iter().map(|t| (t * 50.0) % 360.0).collect();
    let slow = Topic {
        name: "b".into(),
        time: Some(0),
        fields: vec![Field::new("t", None, vec![0.0, 39.0]), Field::new("u", None, vec![0.0, 39.0])],
    };
    let fast = Topic {
        name: "a".into(),
        time: Some(0),
        fields: vec![Field::new("t", Some("s"), t.clone()), Field::new("psi", Some("deg"), angle)],
    };
    let log = Log { topics: vec![fast, slow], ..Log::default() };
    let text = "[channel.psi]\nfrom = \"a.psi\"\nwrap = 360\ndelay = 0.5\n[channel.u]\nfrom = \"b.u\"\n[time]\nrate = 1\nlongest_gap = 100\n";
    let taken = take(&log, &map(text), &|name| Some(name == "u")).unwrap();
    let time = taken.time.clone().unwrap();
    // a sensor that stamps late by half a second shows what was half a step before
    let psi = &taken.columns[0].values;
    assert!((psi[3] - 50.0 * (time[3] + 0.5)).abs() < 1e-9, "{taken:?}");
    assert!(taken.notes[0].contains("jump(s) of 360 are taken out"), "{:?}", taken.notes);
    // an input is linear over what is no gap to the map; a sensor is not shown where it has no samples
    assert_eq!(taken.columns[1].values[15], time[15]);
    assert!(psi[15].is_nan());
    let short = take(&log, &map(&text.replace("= 100", "= 2")), &|name| Some(name == "u")).unwrap();
    assert!(short.notes.iter().any(|n| n.contains("no sample of `u` for 39")), "{:?}", short.notes);
}

/// A clock that runs fast by 1/1024: its samples are back where they were taken, to the rounding of one product.
#[cfg(feature = "dataflash")]
#[test]
fn a_clock_that_drifts_is_set_right() {
    let log = open(&dataflash()).unwrap();
    let text = |clock: &str| format!("{clock}[time]\nsamples = \"ATT\"\n[channel.roll]\nfrom = \"ATT.Roll\"\n");
    let taken = |clock: &str| take(&log, &map(&text(clock)), &|_| Some(false)).unwrap().time.unwrap();
    let (off, right) = (taken(""), taken("[clock.ATT]\noffset = 0.5\ndrift = 0.0009765625\n"));
    for (own, set) in off.iter().zip(&right) {
        assert!((own - 0.5 - (own - off[0]) / 1024.0 - set).abs() < 1e-12, "{own} {set}");
    }
    assert!(right.len() == off.len() && right.windows(2).all(|w| w[0] < w[1]));
    let none = take(&log, &map(&text("[clock.BARO]\noffset = 1\n")), &|_| Some(false)).unwrap_err();
    assert_eq!(none[0].to_string(), "clock.BARO: the log has no such topic");
}

#[test]
fn a_frame_turns_all_vectors_of_a_map() {
    let names = ["x", "y", "z", "phi", "theta", "psi", "q0", "q1", "q2", "q3", "r", "az"];
    let row = [1.0, 2.0, 3.0, 0.1, 0.2, 30.0, 0.5, 0.5, -0.5, 0.5, 4.0, 9.8];
    let column = |(name, value): (&&str, f64)| Field::new(*name, (*name == "psi").then_some("deg"), vec![value; 2]);
    let fields = names.iter().zip(row).map(column).collect();
    let log = Log { topics: vec![Topic { fields, ..Topic::default() }], ..Log::default() };
    let text = |frame: &str, without: &str| {
        let channels = names.iter().filter(|n| **n != without).map(|n| format!("[channel.{n}]\nfrom = \"{n}\"\n"));
        format!("frame = \"{frame}\"\n{}", channels.collect::<String>())
    };
    let turned = |frame: &str, wanted: &dyn Fn(&str) -> Option<bool>| {
        let taken = take(&log, &map(&text(frame, "")), wanted).unwrap();
        taken.columns.into_iter().map(|c| (c.name, c.values[0])).collect::<std::collections::BTreeMap<_, _>>()
    };
    let is = |found: &std::collections::BTreeMap<String, f64>, expected: [f64; 12]| {
        let near = |(name, e): (&&str, f64)| (found[*name] - e).abs() < 1e-12;
        assert!(names.iter().zip(expected).all(near), "{found:?}");
    };
    let h = std::f64::consts::FRAC_1_SQRT_2;
    let all = |_: &str| Some(false);
    is(&turned("enu-flu", &all), [2.0, 1.0, -3.0, 0.1, -0.2, 60.0, h, 0.0, h, 0.0, -4.0, -9.8]);
    is(&turned("nwu-flu", &all), [1.0, -2.0, -3.0, 0.1, -0.2, -30.0, 0.5, 0.5, 0.5, -0.5, -4.0, -9.8]);
    is(&turned("enu-frd", &all), [2.0, 1.0, -3.0, 0.1, 0.2, 30.0, 0.5, 0.5, -0.5, 0.5, 4.0, 9.8]);
    is(&turned("ned-flu", &all), [1.0, 2.0, 3.0, 0.1, 0.2, 30.0, 0.5, 0.5, -0.5, 0.5, -4.0, -9.8]);
    // a component that the model does not want is taken for one that it does
    let found = turned("enu-flu", &|name| (name == "x").then_some(false));
    assert_eq!(found, [("x".to_string(), 2.0)].into());
    let lacking = take(&log, &map(&text("enu-flu", "y")), &all).unwrap_err();
    let said = "frame = \"enu-flu\" makes `x` of `y`, and no channel of that name is there; add it to the map";
    assert_eq!((lacking.len(), lacking[0].to_string().as_str()), (1, said));
    let wrong = |text: &str| RecordMap::parse(text).unwrap_err().to_string();
    assert!(wrong(&text("flu", "")).contains("expected enu-flu, nwu-flu, ned-flu, enu-frd, nwu-frd, ned-frd"));
    let nothing = wrong("frame = \"enu-flu\"\n[channel.speed]\nfrom = \"x\"\n");
    assert!(nothing.contains("frame = \"enu-flu\": expected channels that it turns: x, y, z"), "{nothing}");
    let read = map(&text("enu-flu", ""));
    assert_eq!(RecordMap::parse(&read.text()).unwrap(), read);
}

#[test]
fn maps_that_make_no_sense_are_refused_with_their_key() {
    let wrong = |text: &str| RecordMap::parse(text).unwrap_err().to_string();
    assert!(wrong("[channel.p]\nfrom = \"a\"\nsing = 1\n").contains("sing"));
    assert!(wrong("").contains("channel = nothing: expected at least one"));
    assert!(wrong("[channel.p]\nfrom = \"a\"\nsign = 2\n").contains("channel.p.sign = 2: expected 1 or -1"));
    assert!(wrong("[channel.p]\nfrom = \"a\"\nwrap = 0\n").contains("channel.p.wrap"));
    assert!(wrong("[time]\nunit = \"week\"\n").contains("time.unit = week"));
    let late = "[channel.p]\nfrom = \"a\"\nfree_delay = { lower = 0.1, upper = 1 }\n";
    assert!(wrong(late).contains("channel.p.free_delay = 0.1 to 1: expected bounds around 0"), "{}", wrong(late));
    let runaway = "[clock.IMU]\ndrift = 1\n[channel.p]\nfrom = \"a\"\n";
    assert!(wrong(runaway).contains("clock.IMU = offset 0, drift 1"), "{}", wrong(runaway));
    let free_delay = Some(FreeDelay { lower: -0.1, upper: 0.2, per_run: true });
    let plain = RecordMap {
        channel: [("p".to_string(), ChannelMap { sign: -1.0, free_delay, ..ChannelMap::plain("P") })].into(),
        clock: [("IMU".to_string(), ClockMap { from: Some("SampleUS".into()), offset: 0.25, drift: -4.95e-4 })].into(),
        ..RecordMap::default()
    };
    assert_eq!(RecordMap::parse(&plain.text()).unwrap(), plain);
}

#[cfg(feature = "ulog")]
#[test]
fn shipped_maps_are_maps_and_say_what_was_not_logged() {
    let (none, names) = crate::shipped("nothing");
    assert!(none.is_none());
    let maps: Vec<RecordMap> = names.iter().map(|name| map(crate::shipped(name).0.unwrap())).collect();
    for one in &maps {
        assert_eq!(&map(&one.text()), one);
    }
    let log = open(&ulog()).unwrap();
    let taken = take(&log, &maps[0], &|_| Some(false)).unwrap();
    assert!(taken.columns.len() == 9 && taken.absent.contains(&"V".to_string()), "{taken:?}");
    let mut quiet = log;
    quiet.topics.remove(0);
    let errors = take(&quiet, &maps[0], &|_| Some(false)).unwrap_err();
    assert!(matches!(&errors[0], TakeError::NoField { channel, .. } if channel == "p"));
    assert!(errors[0].to_string().contains("SDLOG_PROFILE"), "{}", errors[0]);
}

/// A topic with the stamps of its samples beside those of its publication, as PX4 logs it.
#[test]
fn a_topic_is_at_the_times_when_its_samples_were_taken() {
    let topic = |name: &str, fields: Vec<Field>| Topic { name: name.into(), time: Some(0), fields };
    let late: Vec<f64> = (0..6).map(|k| 4000.0 * f64::from(k) + 300.0).collect();
    let sampled: Vec<f64> = (0..6).map(|k| 4000.0 * f64::from(k)).collect();
    let gyro = |stamps: Vec<f64>| {
        let axis = |k: usize| Field::new(format!("xyz[{k}]"), None, (0..6).map(|t| f64::from(t) + k as f64).collect());
        let stamps = Field::new("timestamp_sample", None, stamps);
        let published = Field::new("timestamp", Some("us"), late.clone());
        topic("vehicle_angular_velocity", vec![published, stamps, axis(0), axis(1), axis(2)])
    };
    let torque = |t: f64| Field::new(format!("xyz[{t}]"), None, vec![t, t + 1.0]);
    let torque = topic(
        "vehicle_torque_setpoint",
        vec![Field::new("timestamp", Some("us"), vec![0.0, 10_000.0]), torque(0.0), torque(1.0), torque(2.0)],
    );
    let rate = map(crate::shipped("px4-rate").0.unwrap());
    let taken = |gyro: Topic| {
        let log = Log { format: "ULog", topics: vec![gyro, torque.clone()], ..Log::default() };
        take(&log, &rate, &|name| ["p", "u_roll"].contains(&name).then_some(name == "u_roll")).unwrap()
    };
    let found = taken(gyro(sampled.clone()));
    let time = found.time.unwrap();
    let p = found.columns.iter().find(|c| c.name == "p").unwrap();
    let at = |t: f64| time.iter().position(|s| *s == t).map(|k| p.values[k]);
    assert_eq!((at(0.004), at(0.008), at(0.0043)), (Some(1.0), Some(2.0), None), "{time:?}");
    // stamps that say nothing
    for none in [vec![0.0; 6], Vec::from_iter(sampled.into_iter().rev())] {
        assert!(taken(gyro(none)).time.unwrap().contains(&0.0043));
    }
}

#[test]
#[cfg(all(feature = "npz", feature = "mat"))]
fn a_file_is_read_as_its_bytes_are() {
    let from = |bytes: &[u8]| crate::open_from(&mut std::io::Cursor::new(bytes)).unwrap();
    for name in ["plain.npz", "packed.npz", "array.npy", "packed.mat"] {
        let bytes = file(name);
        assert!(from(&bytes).unwrap().damage.is_empty() && from(&bytes) == open(&bytes), "{name}");
        let cut = &bytes[..bytes.len() / 2];
        assert_eq!(from(cut), open(cut), "{name}");
        let mut flipped = bytes.clone();
        flipped[bytes.len() / 3] ^= 4;
        assert_eq!(from(&flipped), open(&flipped), "{name}");
    }
    assert!(crate::open_from(&mut std::io::Cursor::new(b"t,y\n0,1\n")).is_none());
}

/// An archive that says that it holds more than a file of its size can is refused without asking for the memory.
#[test]
#[cfg(feature = "npz")]
fn sizes_that_an_archive_only_claims_cost_no_memory() {
    let mut bytes = file("packed.npz");
    let directory = bytes.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
    bytes[directory + 24..directory + 28].copy_from_slice(&0x7fff_ffff_u32.to_le_bytes());
    let log = open(&bytes).unwrap();
    assert!(log.damage.len() == 1 && log.damage[0].what.contains("is lost"), "{:?}", log.damage);
}

#[cfg(feature = "xlsx")]
#[test]
fn sheets_of_excel_are_read_to_the_bit() {
    let log = open(&file("table.xlsx")).unwrap();
    assert!(log.damage.is_empty() && log.topics.is_empty(), "{log:?}");
    let [flight, clock] = &log.sheets[..] else { panic!("{log:?}") };
    assert_eq!((flight.name.as_str(), clock.name.as_str()), ("flight", "clock"));
    let number = |column: usize| -> Vec<f64> {
        let cell = |line: &str| line.split('\t').nth(column).and_then(|c| c.parse().ok()).unwrap_or(f64::NAN);
        flight.text.lines().skip(1).map(cell).collect()
    };
    assert_eq!(flight.text.lines().next(), Some("t [s]\tp [rad/s]\ty\tu\tnote"));
    assert_eq!((number(0), number(1)), (expected(|k| k / 128.0), expected(p)));
    assert_eq!((number(2), number(3)), (expected(|k| -k / 8.0), expected(|k| k % 3.0)));
    assert_eq!(clock.text.lines().nth(2), Some("2023-03-15T00:11:15.000000"));
    assert_eq!(accepted(&file("table.xlsx")), (0, 0));
    // a day and a number in one column, an error, and a text among numbers stand as they are: who wants the column is told
    let log = open(&file("wrong.xlsx")).unwrap();
    assert!(log.damage.is_empty(), "{log:?}");
    let text = &log.sheets[0].text;
    assert!(text.contains("#DIV/0!") && text.contains("n/a"), "{text}");
}
