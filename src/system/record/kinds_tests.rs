//! Tables as loggers and laboratories write them, one small file of each kind: what is read of it, and what is said.

use super::*;
use fdm_grammar::{Model, Unit};
use std::path::PathBuf;

/// A model with states that wants `u` in volts and `y` without a unit.
fn wanted() -> Channels {
    let channel = |name: &str, unit: &str| Channel::new(name, Some(Unit::parse(unit).unwrap()));
    Channels {
        time: Unit::second(),
        timed: true,
        samples: 2,
        inputs: vec![channel("u", "V")],
        outputs: vec![channel("y", "1")],
        driving: Vec::new(),
        slopes: Vec::new(),
        begins_anywhere: None,
    }
}

fn alone() -> Channels {
    Channels { inputs: Vec::new(), ..wanted() }
}

fn file(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.csv");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn all(bytes: &[u8], channels: &Channels, options: &ReadOptions) -> Result<Vec<(Run, Summary)>, String> {
    let (_folder, path) = file(bytes);
    let read = read_each(&[(&path, options)], channels, &[]);
    read.map(|mut files| files.remove(0)).map_err(|e| e[0].to_string())
}

fn mapped(pairs: &[(&str, &str)]) -> ReadOptions {
    let map = pairs.iter().map(|(a, b)| ((*a).to_string(), (*b).to_string())).collect();
    ReadOptions { map, ..ReadOptions::default() }
}

/// Times, inputs and outputs of the only run, and what is said of it.
fn one(bytes: &[u8], options: &ReadOptions) -> (Vec<f64>, Vec<f64>, Vec<f64>, String) {
    let text = String::from_utf8_lossy(bytes);
    let mut runs = all(bytes, &wanted(), options).unwrap_or_else(|e| panic!("{text}\n{e}"));
    assert_eq!(runs.len(), 1, "{text}");
    let (run, summary) = runs.remove(0);
    let said: Vec<String> = summary.notes.iter().map(ToString::to_string).collect();
    (run.time, run.inputs, run.measured, said.join("; "))
}

/// The record that each file below holds.
fn is_it(bytes: &[u8], options: &ReadOptions, part: &str) {
    let (time, inputs, outputs, said) = one(bytes, options);
    let text = String::from_utf8_lossy(bytes);
    let near = |found: &[f64], expected: [f64; 3]| {
        found.len() == 3 && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6)
    };
    assert!(near(&time, [0.0, 0.5, 1.0]), "{text}\n{time:?}\n{said}");
    assert!(
        near(&inputs, [1.0, 1.0, 2.0]) && near(&outputs, [0.25, 0.5, 0.75]),
        "{text}\n{inputs:?} {outputs:?}\n{said}"
    );
    assert!(said.contains(part), "{text}\n{said}");
}

#[test]
fn headers_are_found_whatever_stands_above() {
    let plain = ReadOptions::default();
    for (text, part) in [
        (
            "\"Product\",\"recorder\"\n\"gain\",\"45,80,40\"\nt,u,y\n0,1,0.25\n0.5,1,0.5\n1,2,0.75\n",
            "2 line(s) above the header",
        ),
        ("Starting...\nok\nmillis\tu\ty\n1500\t1\t0.25\n2000\t1\t0.5\n2500\t2\t0.75\n", "in ms, as its name says"),
        ("# by hand\n# t u y\n0 1 0.25\n0.5 1 0.5\n1 2 0.75\n", "line 2 holds the names"),
        ("%t,frame,u,y\n0,base,1,0.25\n0.5,base,1,0.5\n1,base,2,0.75\n", "line 1 holds the names"),
        ("t,u,y,\n\"0\",\"1\",\"0.25\",\n\"0.5\",\"1\",\"0.5\",\n\"1\",\"2\",\"0.75\",\n", ""),
        ("t,u,y\n[s],[V],[-]\n0,1,0.25\n0.5,1,0.5\n1,2,0.75\n", "line 2 holds the units"),
        ("t,u,y\nms,mV,-\n0,1000,0.25\n500,1000,0.5\n1000,2000,0.75\n", "line 2 holds the units"),
        ("#ms, mV, 1\nt, u, y\n0,1000,0.25\n500,1000,0.5\n1000,2000,0.75\n", "line 1 holds the units"),
        ("t,u,y\n0,1,0.25\n0.5,1,0.5\n1,2,0.75\nEnd of data\n", "below the rows"),
        (
            "\"TOA5\",\"st\",\"1\"\n\"TIMESTAMP\",\"u\",\"y\"\n\"TS\",\"V\",\"\"\n\"\",\"Smp\",\"Smp\"\n\
          \"2026-01-01 23:59:59.5\",1,0.25\n\"2026-01-02 00:00:00\",1,0.5\n\"2026-01-02 00:00:00.5\",2,0.75\n",
            "line 3 holds the units",
        ),
    ] {
        is_it(text.as_bytes(), &plain, part);
    }
    is_it(b"t,u,y,T (\xb0C)\n0,1,0.25,20\n0.5,1,0.5,20\n1,2,0.75,20\n", &plain, "Latin-1");
    let wide: Vec<u8> =
        "t\tu\ty\r\n0\t1\t0,25\r\n0,5\t1\t0,5\r\n1\t2\t0,75\r\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    is_it(&[&[0xff, 0xfe][..], &wide].concat(), &plain, "UTF-16");
    let second =
        "Indicated (V),Angle (-),When (hh:mm:ss)\nu,y,Clock\n1,0.25,08:00:01\n1,0.5,08:00:01.5\n2,0.75,08:00:02\n";
    is_it(second.as_bytes(), &plain, "second names");
}

#[test]
fn other_layouts_of_tables_are_one_understanding() {
    let plain = ReadOptions::default();
    for (text, part) in [
        (
            "\"VarName\";\"TimeString\";\"VarValue\";\"Validity\"\n\"u\";\"01.05.2026 12:00:00\";1,0;1\n\"y\";\"01.05.2026 12:00:00\";0,25;1\n\
             \"u\";\"01.05.2026 12:00:00.5\";1,0;1\n\"y\";\"01.05.2026 12:00:00.5\";0,5;1\n\"u\";\"01.05.2026 12:00:01\";2,0;1\n\"y\";\"01.05.2026 12:00:01\";0,75;1\n",
            "each row holds one value",
        ),
        (
            "Date,Time,ms,u,y\n2026/05/01,23:59:59,500,1,0.25\n2026/05/02,00:00:00,0,1,0.5\n2026/05/02,00:00:00,500,2,0.75\n",
            "column `ms` holds the milliseconds of `Time`",
        ),
        ("t:0.0,u:1,y:0.25\nt:0.5,u:1,y:0.5\nt:1,u:2,y:0.75\n", "stand before each value"),
        ("\"Interval\"|\"ms\"|0|0|1,\"u\"|\"V\"|0|5|50,\"y\"|\"\"|0|1|50\n0,1,0.25\n500,1,0.5\n1000,2,0.75\n", ""),
        ("in s,u in V,y\n0,1,0.25\n0.5,1,0.5\n1,2,0.75\n", ""),
        ("Clock,T,u,y\n0:00:00,20,1,0.25\n0:00:00.5,20,1,0.5\n0:00:01,20,2,0.75\n", ""),
        ("T,seconds,u,y\n20,0,1,0.25\n19,0.5,1,0.5\n21,1,2,0.75\n", ""),
        ("Timestamp [s],u,y,state\n0,1,,\n0,,0.25,\n0.5,1,,\n0.5,,0.5,\n1,2,,\n1,,0.75,\n", "they are one sample"),
        ("time,name,value\n0,u,1\n0,y,0.25\n0.5,u,1\n0.5,y,0.5\n1,u,2\n1,y,0.75\n", "each row holds one value"),
        ("SECONDS;PID;VALUE\n0;u;1\n0;y;0.25\n0.5;u;1\n0.5;y;0.5\n1;u;2\n1;y;0.75\n", "each row holds one value"),
        (
            "#group,false\n,result,_start,_time [s],_value,_field\n,,9,0,1,u\n,,9,0.5,1,u\n,,9,1,2,u\n,,9,0,0.25,y\n,,9,0.5,0.5,y\n,,9,1,0.75,y\n",
            "each row holds one value",
        ),
        ("[{\"t\":0,\"u\":1,\"y\":0.25},{\"t\":0.5,\"u\":1,\"y\":0.5},{\"t\":1,\"u\":2,\"y\":0.75}]", ""),
        ("{\"t\":[0,0.5,1],\"u\":[1,1,2],\"y\":[0.25,0.5,0.75]}", ""),
        ("{\"t\":0,\"u\":1,\"y\":0.25}\n{\"t\":0.5,\"u\":1,\"y\":0.5}\n{\"t\":1,\"u\":2,\"y\":0.75}\n", ""),
    ] {
        is_it(text.as_bytes(), &plain, part);
    }
    // by the numbers of columns, where names are no names
    let by_number = mapped(&[("u", "#2 [V]"), ("y", "#3 [1]")]);
    let scope = "SCOPE,12,Waveform\nSegment,TrigTime,Since\n#1,21-Sep-2026 14:13:57,0\nTime,Ampl,Ampl\n0,1,0.25\n0.5,1,0.5\n1,2,0.75\n";
    is_it(scope.as_bytes(), &by_number, "");
    let band = "1790000000, 1790000000\n2.0, 2.0\n1,0.25\n1,0.5\n2,0.75\n";
    is_it(band.as_bytes(), &mapped(&[("u", "#1 [V]"), ("y", "#2 [1]")]), "the first two rows are the start");
    let row = |name: &str, value: &dyn Fn(i32) -> f64| {
        let cells: Vec<String> = (0..40).map(|k| value(k).to_string()).collect();
        format!("{name},{}\n", cells.join(","))
    };
    let lying = row("t", &|k| 0.5 * f64::from(k)) + &row("u", &|k| f64::from(k % 3)) + &row("y", &|k| f64::from(k * k));
    let (time, inputs, outputs, said) = one(lying.as_bytes(), &plain);
    assert!(
        time[39] == 19.5 && inputs[4] == 1.0 && outputs[5] == 25.0 && said.contains("each of the 3 rows is a signal"),
        "{said}"
    );
}

/// A structured array of NumPy: `t`, a text, `u` and `y`.
#[cfg(feature = "npz")]
#[test]
fn arrays_of_records_are_tables() {
    let header = "{'descr': [('t', '<f8'), ('state', '<U2'), ('u', '<i2'), ('y', '<f4')], 'fortran_order': False, 'shape': (3,), }\n";
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    for (t, u, y) in [(0.0_f64, 1_i16, 0.25_f32), (0.5, 1, 0.5), (1.0, 2, 0.75)] {
        bytes.extend(t.to_le_bytes());
        "ok".chars().for_each(|c| bytes.extend(u32::from(c).to_le_bytes()));
        bytes.extend(u.to_le_bytes());
        bytes.extend(y.to_le_bytes());
    }
    is_it(&bytes, &ReadOptions::default(), "");
}

#[test]
fn times_are_read_in_the_unit_that_the_file_tells() {
    let plain = ReadOptions::default();
    for (text, part) in [
        ("time_us,u,y\n0,1,0.25\n500000,1,0.5\n1000000,2,0.75\n", "in us, as its name says"),
        ("time,u,y\n1790000000000,1,0.25\n1790000000500,1,0.5\n1790000001000,2,0.75\n", "counts ms since 1970"),
        (
            "time,u,y\n1790000000000000000,1,0.25\n1790000000500000000,1,0.5\n1790000001000000000,2,0.75\n",
            "counts ns since 1970",
        ),
        ("sats time u y\n8 141359.5 1 0.25\n8 141400.0 1 0.5\n8 141400.5 2 0.75\n", "are clock times, hhmmss"),
        ("Time,u,y\n0 sec,1,0.25\n0.5 sec,1,0.5\n1 sec,2,0.75\n", ""),
        (",u,y\n0 days 00:00:59.5,1,0.25\n0 days 00:01:00,1,0.5\n0 days 00:01:00.5,2,0.75\n", "dates or clock times"),
        ("x-axis,u,y\nsecond,Volt,-\n-0.5,1,0.25\n0,1,0.5\n0.5,2,0.75\n", "line 2 holds the units"),
        (
            "date,clock,u,y\n2026-03-04,23:59:59,1,0.25\n2026-03-04,23:59:59.5,1,0.5\n2026-03-05,00:00:00,2,0.75\n",
            "dates or clock times",
        ),
        (
            "when,u,y\n03/13/2026 1:00:00 PM,1,0.25\n03/13/2026 1:00:00.5 PM,1,0.5\n03/13/2026 1:00:01 PM,2,0.75\n",
            "dates or clock times",
        ),
        ("\"Sample Rate\",2,Hz\nu,y\n1,0.25\n1,0.5\n2,0.75\n", "2 samples a second, as the file says"),
    ] {
        is_it(text.as_bytes(), &plain, part);
    }
    let rated = ReadOptions { rate: Some(2.0), ..plain.clone() };
    is_it(b"u,y\n1,0.25\n1,0.5\n2,0.75\n", &rated, "2 samples a second (--rate)");
    is_it(b"sample,u,y\n7,1,0.25\n8,1,0.5\n9,2,0.75\n", &rated, "column `sample` counts the samples");
    is_it(
        b"Time,u,y\n13/03/2026 01:00:00,1,0.25\n13/03/2026 01:00:00.5,1,0.5\n13/03/2026 01:00:01,2,0.75\n",
        &plain,
        "",
    );
    let refused = |text: &str, options: &ReadOptions| all(text.as_bytes(), &wanted(), options).unwrap_err();
    for (text, advice) in [
        ("u,y\n1,1\n1,2\n", "--rate N"),
        ("sample,u,y\n0,1,1\n1,1,2\n", "--rate N"),
        ("timestamp,u,y\n4000,1,1\n8000,1,2\n", "[UNIT]"),
        ("t,u,y\n03/04/2026 01:00,1,1\n04/04/2026 01:00,1,2\n", "[dd/mm/yyyy]"),
    ] {
        let said = refused(text, &plain);
        assert!(said.contains(advice), "{said}");
    }
    assert!(refused("t,u,y\n0,1,1\n1,1,2\n", &rated).contains("column `t` holds the time"));
    let days = mapped(&[("t", "t [dd/mm/yyyy]")]);
    let (time, ..) = one(b"t,u,y\n03/04/2026 01:00,1,1\n04/04/2026 01:00,1,2\n", &days);
    assert_eq!(time, [0.0, 86_400.0]);
    let (time, .., said) = one(b"t,u,y\n08:00,1,1\n08:15,1,2\n", &plain);
    assert!(time == [0.0, 900.0] && said.contains("hours and minutes"), "{time:?} {said}");
}

#[test]
fn laboratories_repeat_limit_and_code() {
    let plain = ReadOptions::default();
    let read = |text: &str, options: &ReadOptions| all(text.as_bytes(), &alone(), options);
    let values = |runs: &[(Run, Summary)]| runs.iter().map(|(run, _)| run.measured.clone()).collect::<Vec<_>>();
    let runs = read("t,y\n0,1\n0,2\n1,3\n1,4\n1,5\n2,6\n", &plain).unwrap();
    assert_eq!(values(&runs), [vec![1.0, 3.0, 6.0], vec![2.0, 4.0], vec![5.0]]);
    assert!(runs[1].1.notes.iter().any(|n| n.to_string().contains("run 2 of 3")));
    let second = ReadOptions { part: Some(1), ..plain.clone() };
    assert_eq!(values(&read("t,y\n0,1\n0,2\n1,3\n1,4\n2,6\n", &second).unwrap()), [vec![2.0, 4.0]]);
    let table = "ID,TIME,AMT,DV,EVID\n1,0,320,.,1\n1,1,.,2.5,0\n1,2,.,3.5,0\n2,0,320,0,1\n2,1,.,2.75,0\n";
    let said = read(table, &mapped(&[("y", "DV")])).unwrap_err();
    assert!(said.contains("--runs-by \"ID\""), "{said}");
    let by = ReadOptions { runs_by: Some("id".into()), ..mapped(&[("y", "DV")]) };
    let runs = read(table, &by).unwrap();
    let names: Vec<&str> = runs.iter().map(|(run, _)| run.name.as_str()).collect();
    assert_eq!((names, runs[0].0.measured[1..].to_vec()), (vec!["run#1", "run#2"], vec![2.5, 3.5]));
    assert!(runs[1].0.measured[0].is_nan() && runs[1].0.measured[1] == 2.75);
    let said = read("t,y\n0,1\n1,<0.5\n2,BLQ\n", &plain).unwrap_err();
    assert!(said.contains("below a limit") && said.contains("--below-limit 0.5"), "{said}");
    let missing = ReadOptions { below_limit: BelowLimit::Missing, ..plain.clone() };
    let (run, summary) = read("t,y\n0,1\n1,<0.5\n2,BLQ\n", &missing).unwrap().remove(0);
    assert_eq!((run.output_gaps, summary.censored), (vec![2], Vec::new()));
    let limit = ReadOptions { below_limit: BelowLimit::Limit(0.25), ..plain.clone() };
    let (run, summary) = read("t,y\n3,1\n4,<0.5\n5,BLQ\n6,.\n", &limit).unwrap().remove(0);
    let known: Vec<_> = summary.censored.iter().map(|c| (c.output, c.time, c.limit)).collect();
    assert_eq!((known, run.output_gaps), (vec![(0, 1.0, 0.5), (0, 2.0, 0.25)], vec![1]));
    let cut = ReadOptions { begin: Some(3.0), from: Some(5.0), ..limit };
    let (_, summary) = read("t,y\n3,1\n4,<0.5\n5,BLQ\n6,2\n7,1\n", &cut).unwrap().remove(0);
    assert_eq!(summary.censored.iter().map(|c| c.time).collect::<Vec<_>>(), [2.0], "what lies before is not compared");
    let runs = read("t,y\n0,1\n1,<0.5\n1,0.75\n2,<0.5\n2,<0.5\n", &plain).unwrap();
    let counts: Vec<usize> = runs.iter().map(|(_, summary)| summary.censored.len()).collect();
    assert_eq!((values(&runs)[1].len(), counts), (1, vec![2, 0]), "a value beside a limit is a repeat");
    let (run, summary) = read("t,y\n0,1\n1,-999\n2,3\n3,.\n", &plain).unwrap().remove(0);
    assert_eq!(run.output_gaps, [2]);
    assert!(summary.notes.iter().any(|n| n.to_string().contains("1 cell(s) hold -999, read as missing")));
    let said = read("t,y\n0,1\n1,lost\n2,3\n", &plain).unwrap_err();
    assert!(said.contains("--missing lost"), "{said}");
    let lost = ReadOptions { missing: vec!["lost".into()], ..plain };
    assert_eq!(read("t,y\n0,1\n1,lost\n2,3\n", &lost).unwrap()[0].0.output_gaps, [1]);
}

#[test]
fn units_are_read_as_they_are_spelled() {
    let read = |title: &str, unit: &str| {
        let channels = Channels { outputs: vec![Channel::new("y", Some(Unit::parse(unit).unwrap()))], ..alone() };
        let (run, summary) =
            all(format!("t,y [{title}]\n0,1\n1,2\n").as_bytes(), &channels, &ReadOptions::default()).unwrap().remove(0);
        let said: Vec<String> = summary.notes.iter().map(ToString::to_string).collect();
        (run.measured[0], said.join("; "))
    };
    for (title, unit, value, part) in [
        ("knots", "m/s", 1852.0 / 3600.0, "is read as kt"),
        ("Degrees/Sec", "deg/s", 1.0, "is read as"),
        ("g", "m/s^2", 9.80665, "is read as g0"),
        ("G", "1", 1.0, "is read as 1"),
        ("RPM", "rad/s", std::f64::consts::PI / 30.0, "is read as rpm"),
        ("1/min", "rad/s", 1.0 / 60.0, "where turns are meant"),
    ] {
        let (found, said) = read(title, unit);
        assert!((found - value).abs() < 1e-9 * value && said.contains(part), "{title}: {found} {said}");
    }
}

/// Amounts that are given are an input by its derivative.
fn dosed(text: &str) -> Model {
    let body = "param k = 0.5 in [0, 5] [1/h]; state x [mg] = 0; der(x) = der(dose) - k*x; output conc [mg] = x;";
    let text = format!("model m {{ time [h]; input dose [mg]; {text} {body} }}");
    fdm_grammar::compile(&fdm_grammar::Source::new("m.fdm", text)).expect("a model").model
}

#[test]
fn doses_are_the_amount_given_so_far() {
    let model = dosed("");
    let read = |table: &str| all(table.as_bytes(), &channels(&model), &ReadOptions::default());
    let head = "TIME,AMT,RATE,ADDL,II,DV,EVID\n";
    let (run, summary) =
        read(&format!("{head}0,100,0,.,.,.,1\n1,.,.,.,.,9,0\n2,60,30,1,8,.,1\n3,.,.,.,.,8,0\n20,.,.,.,.,1,0\n"))
            .unwrap()
            .remove(0);
    // at once within a billionth of the interval, at 30 an hour from 2 to 4, and once more from 10 to 12
    let width = run.held.len();
    let given: Vec<(f64, f64)> =
        run.time.iter().zip(run.inputs.chunks_exact(width)).map(|(t, row)| (*t, row[0])).collect();
    let wanted = [
        (0.0, 0.0),
        (1e-9, 100.0),
        (1.0, 100.0),
        (2.0, 100.0),
        (3.0, 130.0),
        (4.0, 160.0),
        (10.0, 160.0),
        (12.0, 220.0),
        (20.0, 220.0),
    ];
    assert_eq!(given, wanted);
    assert_eq!((summary.used, run.is_compared(1), run.measured[2]), (5, false, 9.0));
    assert!(summary.notes.iter().any(|n| n.to_string().contains("3 dose(s) of column `AMT`")), "{:?}", summary.notes);
    let said = |rows: &str| read(&format!("{head}{rows}9,.,.,.,.,1,0\n")).unwrap_err();
    for (rows, place, cure) in [
        ("0,100,-2,.,.,.,1\n", "RATE", "write the rate"),
        ("0,100,0,.,.,.,1\n4,.,.,.,.,.,3\n", "EVID", "--runs-by"),
        ("0,100,0,3,.,.,1\n", "ADDL", "`II`"),
    ] {
        let said = said(rows);
        assert!(said.contains(place) && said.contains(cure) && said.contains("line"), "{said}");
    }
    let still =
        fdm_grammar::Source::new("m", "model m { state x = 4; param k = 0.5; der(x) = -k*x; output conc = x; }");
    let still = fdm_grammar::compile(&still).expect("a model").model;
    let read = |table: &str| all(table.as_bytes(), &channels(&still), &ReadOptions::default());
    let (_, summary) = read("TIME,AMT,DV\n0,100,.\n1,.,5\n2,.,3\n").unwrap().remove(0);
    assert!(summary.notes.iter().any(|n| n.to_string().contains("no input takes them")), "{:?}", summary.notes);
}

#[test]
fn a_run_goes_on_behind_a_pause_as_another_where_it_can_begin_anywhere() {
    let of = |initial: &str| {
        let text = format!("model m {{ input u; state y {initial}; param k = 0.5; der(y) = u - k*y; output z = y; }}");
        fdm_grammar::compile(&fdm_grammar::Source::new("m", text)).expect("a model").model
    };
    let row = |k: usize| {
        format!(
            "{},{},{}\n",
            if k < 10 {
                k
            } else if k < 18 {
                k + 40
            } else {
                k + 90
            },
            k % 3,
            k
        )
    };
    let table: String = std::iter::once("t,u,z\n".to_string()).chain((0..19).map(row)).collect();
    let read = |model: &Model| all(table.as_bytes(), &channels(model), &ReadOptions::default()).unwrap();
    let runs = read(&of("= free"));
    let ends: Vec<(usize, f64)> = runs.iter().map(|(run, _)| (run.len(), run.time[run.len() - 1])).collect();
    assert_eq!(ends, [(10, 9.0), (8, 7.0)]);
    let said = "cut at 2 pause(s) into 2 run(s)";
    assert!(runs[1].1.notes.iter().any(|n| n.to_string().contains(said)), "{:?}", runs[1].1.notes);
    assert!(!runs[1].1.notes.iter().any(|n| n.to_string().contains("repeats")));
    let whole = read(&of("= 0"));
    assert_eq!(whole.len(), 1, "its beginning is stated");
    assert!(whole[0].1.notes.iter().any(|n| n.to_string().contains("no sample for")));
}
