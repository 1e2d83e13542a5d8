//! Whole files to runs and errors, as users write them.

use super::*;
use fdm_grammar::Unit;
use fdm_grammar::graph::{Graph, Leaf};
use fdm_grammar::model::{Input, Model, Output, Quantity, State};
use proptest::prelude::*;
use std::path::PathBuf;

fn unit(text: &str) -> Option<Unit> {
    (!text.is_empty()).then(|| Unit::parse(text).unwrap())
}

fn wanted(inputs: &[(&str, &str)], outputs: &[(&str, &str)]) -> Channels {
    let channel = |(name, u): &(&str, &str)| Channel::new(*name, unit(u));
    let list = |c: &[(&str, &str)]| c.iter().map(channel).collect();
    Channels {
        time: Unit::second(),
        timed: true,
        samples: 2,
        inputs: list(inputs),
        outputs: list(outputs),
        driving: Vec::new(),
        slopes: Vec::new(),
        begins_anywhere: None,
    }
}

/// One input `u` and one output `y`, without units.
fn uy() -> Channels {
    wanted(&[("u", "")], &[("y", "")])
}

fn file(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.csv");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn read_bytes(bytes: &[u8], channels: &Channels, options: &ReadOptions) -> Result<(Run, Summary), RecordError> {
    let (_folder, path) = file(bytes);
    read(&path, channels, options)
}

fn good(text: &str, channels: &Channels, options: &ReadOptions) -> (Run, Summary) {
    read_bytes(text.as_bytes(), channels, options).unwrap_or_else(|e| panic!("{text:?}\n{e}"))
}

fn bad(text: &str, channels: &Channels, options: &ReadOptions) -> Vec<Problem> {
    match read_bytes(text.as_bytes(), channels, options) {
        Ok((run, _)) => panic!("{text:?}\n{run:?}"),
        Err(error) => {
            assert!(error.file.ends_with("run.csv") && !error.problems.is_empty());
            error.problems
        }
    }
}

/// The only problem, as the user reads it.
fn one(text: &str, channels: &Channels, options: &ReadOptions) -> String {
    let problems = bad(text, channels, options);
    assert_eq!(problems.len(), 1, "{problems:?}");
    problems[0].to_string()
}

fn plain() -> ReadOptions {
    ReadOptions::default()
}

fn map(pairs: &[(&str, &str)]) -> ReadOptions {
    ReadOptions { map: pairs.iter().map(|(a, b)| ((*a).into(), (*b).into())).collect(), ..plain() }
}

#[test]
fn every_dialect_gives_the_same_run() {
    let texts = [
        "t,u,y\n0.5,1.5,-2\n1.5,2.5,3e1\n",
        "y,note,u,t\r\n-2,a,1.5,0.5\r\n30,\"b, \"\"c\"\"\",2.5,1.5",
        "t;u;y\n0,5;1,5;-2\n1,5;2,5;3e1\n",
        "\u{feff}t\tu\ty\n0.5\t1.5\t-2\n1.5\t2.5\t30\n",
        "# made by a logger\n  t   u  y\n 0.5  1.5   -2\n% more\n\n 1.5  2.5   30.0\n",
        "t u y\n0,5 1,5 -2\n1,5 2,5 30\n",
        "t|u|y\n0.5|1.5|-2\n1.5|2.5|30\n",
        "Time , U,  Y,\n0.5, 1.5, -2,\n1.5, 2.5, 30,\n,,,\n",
        "\"t\",\"u\",\"y\"\n\"0,5\",\"1,5\",\"-2\"\n\"1,5\",\"2,5\",\"30\"\n",
        "# t u y\n0.5 1.5 -2\n1.5 2.5 30\n",
        "T\tu\ty\r0.5\t1.5\t-2\r1.5\t2.5\t30\r",
    ];
    for text in texts {
        let (run, summary) = good(text, &uy(), &plain());
        let expected = (vec![0.0, 1.0], vec![1.5, 2.5], vec![-2.0, 30.0]);
        assert_eq!((run.time, run.inputs, run.measured), expected, "{text:?}");
        assert_eq!((run.name.as_str(), run.held, summary.rows, summary.used), ("run", vec![false], 2, 2), "{text:?}");
    }
}

#[test]
fn units_are_converted_and_assumptions_told() {
    let channels = wanted(&[("T", "degC"), ("free", "")], &[("phi", "rad"), ("x", "m")]);
    let text = "time [ms],T (K),free [ft],phi [deg],x\n1000,293.15,1,180,1\n3000,300,2,90,2\n";
    let (run, summary) = good(text, &channels, &plain());
    assert_eq!(run.time, [0.0, 2.0]);
    assert!((run.inputs[0] - 20.0).abs() < 1e-9 && run.inputs[1] == 1.0);
    assert!((run.measured[0] - std::f64::consts::PI).abs() < 1e-12 && run.measured[1] == 1.0);
    let notes: Vec<_> = summary.notes.iter().map(Note::to_string).collect();
    assert_eq!(
        notes,
        [
            "the input `free` has no unit in the model; column `free [ft]` is taken as it is, in ft",
            "column `x` states no unit; it is taken to be in m, the unit of the output `x`",
        ]
    );
    let columns: Vec<_> = summary.sources.iter().map(|s| (s.channel.as_str(), s.column.as_deref())).collect();
    assert_eq!(columns[..3], [("t", Some("time [ms]")), ("T", Some("T (K)")), ("free", Some("free [ft]"))]);
    // a unit given with --map
    let options = map(&[("t", "clock [min]"), ("x", "X pos (raw) [ft]"), ("phi", "roll")]);
    let text = "clock,T,free,roll [rad],X pos (raw)\n0,1,1,1,1\n1,1,1,1,2\n";
    let channels = wanted(&[], &[("phi", "rad"), ("x", "m")]);
    let error = read_bytes(text.as_bytes(), &channels, &options);
    let (run, _) = error.unwrap();
    assert_eq!((run.time[1], run.measured[1]), (60.0, 0.3048));
}

#[test]
fn logarithms_are_taken_in_the_unit_that_was_given() {
    let channels = wanted(&[], &[("log_c", "1"), ("x", "m")]);
    let text = "t [s],conc [mg/l],pure,x [m]\n0,1000,1,1\n1,2000,,1\n2,,3,1\n";
    let (run, summary) = good(text, &channels, &map(&[("log_c", "log(conc [g/l])")]));
    assert_eq!(&run.measured[..4], [0.0, 1.0, fdm_grammar::math::log(2.0), 1.0]);
    assert!(run.measured[4].is_nan() && summary.sources[1].logarithm && !summary.sources[2].logarithm);
    // as the hint of its absence says
    let (run, _) = good(text, &channels, &map(&[("log_c", "log(conc [mg/l])")]));
    assert_eq!(run.measured[0], fdm_grammar::math::log(1000.0));
    let (run, _) = good(text, &channels, &map(&[("log_c", "log(pure)")]));
    assert_eq!((run.measured[0], run.measured[4]), (0.0, fdm_grammar::math::log(3.0)));
    // a title that reads like a logarithm is a title
    let bare = wanted(&[], &[("log_c", ""), ("x", "m")]);
    let (run, _) = good("t,log(c),x\n0,7,1\n1,8,1\n", &bare, &map(&[("log_c", "log(c)")]));
    assert_eq!(run.measured[0], 7.0);

    let message = |pairs| one(text, &channels, &map(pairs));
    let said = message(&[("log_c", "log(conc)")]);
    assert!(
        said.contains("a logarithm hangs on the unit") && said.contains("--map \"log_c=log(conc [mg/l])\""),
        "{said}"
    );
    let said = message(&[("log_c", "log(conc [m])")]);
    assert!(said.contains("`mg/l`, which cannot be converted to `m`"), "{said}");
    let said = message(&[("log_c", "log(conc [g/ll])")]);
    assert!(said.contains("`g/ll` is not a unit that is known"), "{said}");
    let said = one("t,c [gl],x\n0,1,1\n1,2,1\n", &channels, &map(&[("log_c", "log(c [g/l])")]));
    assert!(said.contains("`gl` is not a unit that is known"), "{said}");
    let said = message(&[("log_c", "log(cnoc [g/l])")]);
    assert!(said.contains("did you mean `conc [mg/l]`?"), "{said}");
    let said = message(&[("x", "log(x [m])"), ("log_c", "pure")]);
    assert!(said.contains("a logarithm is a pure number, and the output `x` is in `m`"), "{said}");
    let text = "t,c,x\n0,1,1\n1,0,1\n2,-3,1\n";
    let said = one(text, &channels, &map(&[("log_c", "log(c)")]));
    assert!(
        said.starts_with(
            "line 3, column `c`: found `0`, expected a number above zero: its logarithm is read; also in line 4"
        ),
        "{said}"
    );
}

#[test]
fn wrong_units_are_refused() {
    let channels = wanted(&[], &[("phi", "rad")]);
    assert_eq!(
        one("t [s],phi [m]\n0,1\n1,2\n", &channels, &plain()),
        "line 1, column `phi [m]`: the column is in `m`, which cannot be converted to `rad`, the unit of the output `phi`"
    );
    let message = one("t [s],phi (dge)\n0,1\n1,2\n", &channels, &plain());
    assert!(message.contains("`dge` is not a unit") && message.contains("did you mean `deg`?"), "{message}");
    let message = one("t [kg],phi\n0,1\n1,2\n", &channels, &map(&[("t", "t")]));
    assert!(message.contains("the unit of the time `t`"), "{message}");
}

#[test]
fn missing_channels_are_told_together_with_the_nearest_name() {
    let channels = wanted(&[("rudder", "")], &[("phi", ""), ("yaw", "")]);
    let problems = bad("time,ruder,phi_deg,z\n0,1,1,1\n1,1,1,1\n", &channels, &plain());
    let texts: Vec<_> = problems.iter().map(Problem::to_string).collect();
    assert_eq!(texts.len(), 3);
    assert_eq!(
        texts[0],
        "no column for the input `rudder`; the columns are `time`, `ruder`, `phi_deg`, `z` \
         (if `ruder` is meant, say --map \"rudder=ruder\")"
    );
    assert!(texts[1].contains("--map \"phi=phi_deg\""), "{}", texts[1]);
    assert!(texts[2].contains("--map yaw=COLUMN"), "{}", texts[2]);
    let message = one("when,u,y\n0,1,1\n", &uy(), &plain());
    assert!(message.contains("no column for the time `t`") && message.contains("--rate N"), "{message}");
    let message = one("timestamp,u,y\n0,1,1\n", &uy(), &plain());
    assert!(message.contains("--map \"t=timestamp [UNIT]\""), "{message}");
    assert!(one("t,a,y\n0,1,1\n", &uy(), &plain()).contains("(name the column `u`, or say --map u=COLUMN)"));
    let many: String = (0..500).map(|k| format!("c{k},")).collect();
    let message = one(&format!("{many}u,y\n"), &uy(), &plain());
    assert!(message.contains("and 490 more") && message.len() < 400, "{message}");
}

#[test]
fn names_match_exactly_first_and_never_steal() {
    // roll rate p and power P
    let channels = wanted(&[], &[("p", ""), ("P", "")]);
    let (run, _) = good("t,P,p\n0,1,2\n1,3,4\n", &channels, &plain());
    assert_eq!(run.measured, [2.0, 1.0, 4.0, 3.0]);
    assert!(one("t,p\n0,1\n1,2\n", &channels, &plain()).contains("no column for the output `P`"));
    assert!(one("t,y,Y\n0,1,1\n", &wanted(&[], &[("y", ""), ("z", "")]), &map(&[("z", "x")])).contains("--map z=x"));
    // duplicates matter only where they are used
    let message = one("t,u,y,y\n0,1,1,1\n", &uy(), &plain());
    assert!(message.starts_with("line 1: `y` stands for 2 columns"), "{message}");
    good("t,u,y,note,note\n0,1,1,a,b\n1,1,1,a,b\n", &uy(), &plain());
    let (run, _) = good("t,u,y [m],y [ft]\n0,1,1,2\n1,1,1,2\n", &uy(), &map(&[("y", "y [ft]")]));
    assert_eq!(run.measured, [2.0, 2.0]);
}

#[test]
fn the_time_column_is_found_by_a_plain_rule() {
    let channels = wanted(&[("T", "degC")], &[]);
    assert_eq!(good("T,time\n20,0\n30,1\n", &channels, &plain()).0.inputs, [20.0, 30.0]);
    assert!(one("T\n20\n30\n", &channels, &plain()).contains("no column for the time"));
    // a temperature is no time
    assert!(one("T [K],u,y\n1,1,1\n2,1,1\n", &uy(), &plain()).contains("no column for the time"));
    assert_eq!(good("T,u,y,t\n1,1,1,0\n1,1,1,4\n", &uy(), &plain()).0.time, [0.0, 4.0]);
    assert_eq!(good("when,u,y,t\n1,1,1,0\n3,1,1,0\n", &uy(), &map(&[("t", "when")])).0.time, [0.0, 2.0]);
}

#[test]
fn options_are_checked_together() {
    let options = ReadOptions {
        any_size: false,
        map: vec![("w".into(), "u".into()), ("y".into(), "why".into()), ("y".into(), "u".into())],
        from: Some(3.0),
        to: Some(1.0),
        every: 0,
        hold: vec!["y".into(), "v".into()],
        require_outputs: true,
        ..ReadOptions::default()
    };
    let texts: Vec<_> = bad("t,u,y\n0,1,1\n", &uy(), &options).iter().map(Problem::to_string).collect();
    let parts =
        ["--every 0", "--from 3 --to 1", "--zoh `y`", "--zoh names the channel `v`", "--map names the channel `w`"];
    for part in parts.iter().chain(&["`y` more than once", "--map y=why: the file has no such column"]) {
        assert!(texts.iter().any(|t| t.contains(part)), "{part}: {texts:?}");
    }
    assert_eq!(texts.len(), 7, "{texts:?}");
}

#[test]
fn rows_are_selected_by_the_time_of_the_file() {
    let text = "t [min],u,y\n10,0,x\n11,1,1\n12,,2\n13,3,3\n14,4,4\n15,5,5\n16,6,x\n";
    let options = ReadOptions { from: Some(11.0), to: Some(15.0), every: 2, ..plain() };
    let (run, summary) = good(text, &uy(), &options);
    assert_eq!(
        (run.time, run.inputs, run.measured),
        (vec![0.0, 120.0, 240.0], vec![1.0, 3.0, 5.0], vec![1.0, 3.0, 5.0])
    );
    assert_eq!((summary.rows, summary.used, run.input_gaps), (7, 3, vec![0]));
    assert_eq!(summary.sampling.map(|s| (s.median, s.is_even())), Some((120.0, true)));
    let message = one(text, &uy(), &ReadOptions { from: Some(20.0), ..plain() });
    assert!(message.contains("the record goes from 10 to 16"), "{message}");
    let message = one(text, &uy(), &ReadOptions { to: Some(11.0), from: Some(11.0), ..plain() });
    assert!(message.contains("1 sample selected, expected at least 2"), "{message}");
}

#[test]
fn gaps_are_counted_bridged_or_not_compared() {
    let text = "t,u,v,y,z\n0,,1,1,NaN\n1,2,,,NA\n3,,-,3,7\n4,8,4,n/a,\n5,,5,null,nan\n";
    let channels = wanted(&[("u", ""), ("v", "")], &[("y", ""), ("z", "")]);
    let (run, summary) = good(text, &channels, &ReadOptions { hold: vec!["v".into()], ..plain() });
    assert_eq!(run.inputs, [2.0, 1.0, 2.0, 1.0, 6.0, 1.0, 8.0, 4.0, 8.0, 5.0]);
    assert_eq!((&run.input_gaps, &run.output_gaps, &run.held), (&vec![3, 2], &vec![3, 4], &vec![false, true]));
    let z: Vec<_> = run.measured.iter().skip(1).step_by(2).map(|v| v.to_string()).collect();
    assert_eq!(z, ["NaN", "NaN", "7", "NaN", "NaN"]);
    assert_eq!(summary.sources.iter().map(|s| s.gaps).collect::<Vec<_>>(), [0, 3, 2, 3, 4]);
    let problems = bad("t,u,y\n0,,\n1,,NaN\n", &uy(), &plain());
    let texts: Vec<_> = problems.iter().map(Problem::to_string).collect();
    assert_eq!(texts[0], "column `u`: the input `u` has no value in any selected row");
    let said =
        "column `y`: the output `y` has no value in any selected row (if it was not measured, say --without-output y)";
    assert_eq!(texts[1], said);
    let lenient = ReadOptions { require_outputs: false, ..plain() };
    let (run, summary) = good("t,u\n0,1\n1,1\n2,1\n", &uy(), &lenient);
    assert!(run.measured.len() == 3 && run.measured.iter().all(|v| v.is_nan()));
    assert!(summary.notes.contains(&Note::NotMeasured { output: "y".into() }), "{:?}", summary.notes);
    assert!(summary.notes.iter().any(|n| n.to_string() == "the input `u` never changes: 1 in all 3 samples"));
    assert!(good("t,u,y\n0,1,\n1,1,\n", &uy(), &lenient).0.measured.iter().all(|v| v.is_nan()));
}

#[test]
fn without_time_samples_are_counted_and_never_bridged() {
    let channels = Channels { timed: false, samples: 1, ..uy() };
    let (run, summary) = good("y,u\n3,1\n4,\n5,2\n", &channels, &plain());
    assert_eq!((&run.time, run.measured[0], run.measured[2]), (&vec![0.0, 1.0, 2.0], 3.0, 5.0));
    assert!(run.measured[1].is_nan() && run.inputs[1].is_finite());
    assert_eq!((run.input_gaps, run.output_gaps, summary.sampling), (vec![1], vec![0], None));
    // repeated samples and any time column are welcome; --from counts rows, or uses the time when there is one
    let text = "t,y,u\n5,3,1\n5,3,1\n2,4,1\n7,5,1\n";
    assert_eq!(good(text, &channels, &plain()).0.measured, [3.0, 3.0, 4.0, 5.0]);
    let from = ReadOptions { from: Some(3.0), ..plain() };
    assert_eq!(good(text, &channels, &from).0.measured, [3.0, 3.0, 5.0]);
    assert_eq!(good("y,u\n1,1\n2,1\n3,1\n4,1\n", &channels, &from).0.measured, [4.0]);
}

#[test]
fn bad_cells_are_named_by_line_and_column_and_not_listed_by_the_thousand() {
    let text = "# logger\n\nt,u [m],y\n0,abc,1\n1,1,1.5.2\n2,1,1e999\n3,-inf,1\n";
    let problems = bad(text, &uy(), &plain());
    let texts: Vec<_> = problems.iter().map(Problem::to_string).collect();
    assert_eq!(texts.len(), 2);
    assert!(
        texts[0].starts_with("line 4, column `u [m]`: found `abc`, expected a number; also in line 7 ("),
        "{texts:?}"
    );
    assert!(texts[1].starts_with("line 5, column `y`: found `1.5.2`, expected a number; also in line 6"), "{texts:?}");
    assert!(one("t,u,y\n0,1,1\n1,1,inf\n", &uy(), &plain()).contains("found `inf`, expected a finite number"));
    let rows: String = (1..=20_000).map(|k| format!("{k},bad,1\n")).collect();
    let message = one(&format!("t,u,y\n0,1,1\n{rows}"), &uy(), &plain());
    assert!(message.contains("also in lines 4, 5, 6 and 19996 more") && message.len() < 250, "{message}");
    let (_, summary) = good("t,u,y\nx,m,m\n0,1,1\n1,1,1\n", &uy(), &plain());
    assert!(summary.notes.iter().any(|n| n.to_string().starts_with("line 2, below the names")), "{:?}", summary.notes);
    let message = one("t,u,y\n0,1,1\n2024-01-01 12:00,1,1\n", &uy(), &plain());
    assert!(message.contains("dates and clock times"), "{message}");
    let wide = format!("t,u,y\n0,1,1\n1,{},1\n", "x".repeat(100_000));
    assert!(one(&wide, &uy(), &plain()).len() < 250);
    assert!(one(&format!("t,u,y\n0,1,\"{}\"\n", "9,\n".repeat(500_000)), &uy(), &plain()).len() < 250);
}

#[test]
fn decimal_marks_do_not_mix() {
    let message = one("t;u;y\n0;1,5;1\n1;2.5;1\n", &uy(), &plain());
    assert!(message.starts_with("line 3, column `u`: found `2.5`, expected a decimal comma as in line 2"), "{message}");
    // the first fraction may come late
    let whole: String = (0..300).map(|k| format!("{k};{k};1\n")).collect();
    let (run, summary) = good(&format!("t;u;y\n{whole}300;1,5;2\n"), &uy(), &plain());
    assert_eq!((run.inputs[300], summary.dialect.decimal), (1.5, Mark::Comma));
    let message = one("t,u,y\n0,\"1,234\",1\n1,\"2,345\",1\n", &uy(), &plain());
    assert!(message.contains("line 2, column `u`: found `1,234`, which may be"), "{message}");
    assert_eq!(good("t,u,y\n0,\"1,234\",1\n1,\"2,34\",1\n", &uy(), &plain()).0.inputs, [1.234, 2.34]);
    assert_eq!(good("t;u;y\n0;1,234;1\n1;2,345;1\n", &uy(), &plain()).0.inputs, [1.234, 2.345]);
}

#[test]
fn time_must_rise() {
    let message = one("t,u,y\n0,1,1\n1,1,1\n1,2,2\n0.5,1,1\n", &uy(), &plain());
    assert!(message.starts_with("line 4, column `t`: the time does not rise from 1 in line 3 to 1"), "{message}");
    assert!(message.contains("also in line 5"), "{message}");
    let message = one("t,u,y\n0,1,1\n5,1,1\n1,2,2\n2,1,1\n", &uy(), &plain());
    assert!(message.contains("falls from 5 in line 3 to 1") && message.contains("several runs"), "{message}");
    assert!(one("t,u,y\n0,1,1\n,1,1\n2,1,1\n", &uy(), &plain()).starts_with("line 3, column `t`: the time is missing"));
    let message = one("t,u,y\n-1e16,1,1\n0.25,1,1\n0.5,1,1\n", &uy(), &plain());
    assert!(message.contains("double precision"), "{message}");
    // the same row twice says nothing new
    let (run, summary) = good("t,u,y\n0,1,1\n1,2,\n1,2,\n2,3,3\n", &uy(), &plain());
    assert_eq!(run.time, [0.0, 1.0, 2.0]);
    assert!(summary.notes.contains(&Note::Repeated { rows: 1, line: 4 }), "{:?}", summary.notes);
    // a pause is told
    let rows: String = (0..20).map(|k| format!("{},{k},{k}\n", if k < 10 { k } else { k + 50 })).collect();
    let (_, summary) = good(&format!("t,u,y\n{rows}"), &uy(), &plain());
    assert!(summary.notes.contains(&Note::Pause { length: 51.0, at: 9.0, median: 1.0 }), "{:?}", summary.notes);
}

#[test]
fn broken_tables_are_refused_with_their_line() {
    let message = one("t,u,y\n0,1,1\n1,1\n2,1,1,4\n3,1,1\n", &uy(), &plain());
    assert_eq!(message, "line 3: found 2 cells, expected 3 as in the header; also in line 4");
    let message = one("t,u,y\n0,1,1\n1,1", &uy(), &plain());
    assert!(message.starts_with("line 3: found 2 cells") && message.contains("cut off"), "{message}");
    assert!(one("t,u,y\n0,1,1\n1,1,2e", &uy(), &plain()).contains("found `2e`, expected a number (the file ends here"));
    assert!(one("t,u,y\n0,1,1\n1,\"1,2\n2,1,1\n3,1,1\n", &uy(), &plain()).contains("a quote that opens in this line"));
    assert!(
        one("0,1,1\n1,1,2\n", &uy(), &plain())
            .starts_with("line 1: no line above the rows holds names of the columns (0, 1, 1)")
    );
    assert!(one("\n\nt,u,y\n\n", &uy(), &plain()).starts_with("line 3: there are no rows below the header"));
    assert!(one("", &uy(), &plain()).contains("holds no rows"));
    assert!(
        one(&format!("t,u,y\n0,1,{}\n", "1".repeat(2 << 20)), &uy(), &plain())
            .starts_with("line 2: the line is longer")
    );
    assert!(one(&format!("{},u,y\n0,1,1\n", "t".repeat(2000)), &uy(), &plain()).contains("a column name of 2000"));
    let error = read_bytes(b"t,u,y\n0,1,1\n1,1,\xb0\n", &uy(), &plain()).unwrap_err().to_string();
    assert!(error.contains("run.csv: line 3, column `y`: found `°`, expected a number"), "{error}");
}

#[test]
fn what_is_no_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let fault = |path: &std::path::Path| *read(path, &uy(), &plain()).unwrap_err().problems.remove(0).fault;
    assert_eq!(fault(folder.path()), Fault::Directory);
    assert_eq!(fault(&folder.path().join("none.csv")), Fault::Unreadable("there is no such file".into()));
    #[cfg(unix)]
    assert_eq!(fault(std::path::Path::new("/dev/zero")), Fault::Device);
    let error = write(&folder.path().join("none/out.csv"), &[]).unwrap_err();
    assert!(matches!(*error.problems[0].fault, Fault::Unwritable(_)), "{error}");
}

#[test]
fn a_written_file_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.csv");
    let (t, u, y) = ([0.0, 0.1, 0.30000000000000004], [1e-300, -0.0, 1.7e308], [f64::NAN, 1.0 / 3.0, 5.0]);
    let column = |name, unit, values| Column { name, unit, values };
    write(&path, &[column("t", Some("s"), &t), column("u", None, &u), column("y, z", Some("deg"), &y)]).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(text, "t [s],u,\"y, z [deg]\"\n0,1e-300,\n0.1,-0,0.3333333333333333\n0.30000000000000004,1.7e308,5\n");
    let (run, summary) =
        read(&path, &wanted(&[("u", "")], &[("y", "deg")]), &ReadOptions { any_size: true, ..map(&[("y", "y, z")]) })
            .unwrap();
    assert_eq!((&run.time[..], &run.inputs[..], run.output_gaps), (&t[..], &u[..], vec![1]));
    assert_eq!((summary.dialect, &run.measured[1..]), (Dialect::default(), &y[1..]));
}

#[test]
fn a_model_says_what_it_wants() {
    let quantity = |name: &str, u: &str| Quantity { name: name.into(), doc: String::new(), unit: unit(u) };
    let mut graph = Graph::default();
    let (x, t) = (graph.leaf(Leaf::Input(0)), graph.leaf(Leaf::Time));
    let mut model = Model {
        name: "m".into(),
        doc: String::new(),
        time: unit("min").unwrap(),
        inputs: vec![Input::new(quantity("u", "deg"))],
        states: Vec::new(),
        params: Vec::new(),
        derived: Vec::new(),
        ties: Vec::new(),
        outputs: vec![Output::new(quantity("y", ""), x)],
        trim: Vec::new(),
        requirements: None,
        tables: Vec::new(),
        graph,
    };
    let expected =
        Channels { time: unit("min").unwrap(), timed: false, samples: 1, ..wanted(&[("u", "deg")], &[("y", "")]) };
    assert_eq!(channels(&model), expected);
    model.outputs[0].expr = t;
    assert!(channels(&model).timed && channels(&model).samples == 1);
    model.states.push(State {
        quantity: quantity("x", ""),
        rate: x,
        initial: x,
        noise: None,
        limits: None,
        resets: Vec::new(),
    });
    assert!(channels(&model).timed && channels(&model).samples == 2);
}

fn dialects() -> impl Strategy<Value = Dialect> {
    use Delimiter::*;
    let delimiter = prop::sample::select(vec![Comma, Semicolon, Tab, Bar, Spaces]);
    let decimal = prop::sample::select(vec![Mark::Point, Mark::Comma]);
    (delimiter, decimal).prop_map(|(delimiter, decimal)| Dialect { delimiter, decimal })
}

fn numbers() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => -100.0..100.0_f64,
        1 => any::<f64>().prop_filter("finite", |v| v.is_finite()),
        1 => (-50..50_i32).prop_map(f64::from),
        1 => Just(f64::NAN),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn writing_then_reading_gives_the_same_bits(
        dialect in dialects(),
        rows in prop::collection::vec((0.001..10.0_f64, -50.0..50.0_f64, numbers()), 2..60),
    ) {
        let time: Vec<f64> = std::iter::once(0.0)
            .chain(rows.iter().scan(0.0, |t, row| { *t += row.0; Some(*t) })).take(rows.len()).collect();
        let (u, y): (Vec<_>, Vec<_>) = rows.iter().map(|row| (row.1, row.2)).unzip();
        let columns = [
            Column { name: "y", unit: Some("m"), values: &y },
            Column { name: "t", unit: Some("s"), values: &time },
            Column { name: "u", unit: None, values: &u },
        ];
        let mut bytes = Vec::new();
        write_to(&mut bytes, dialect, &columns).unwrap();
        let channels = wanted(&[("u", "")], &[("y", "m")]);
        let (run, _) = read_bytes(&bytes, &channels, &ReadOptions { require_outputs: false, any_size: true, ..plain() }).unwrap();
        let bits = |v: &[f64]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(&run.time), bits(&time));
        prop_assert_eq!(bits(&run.inputs), bits(&u));
        prop_assert_eq!(bits(&run.measured), bits(&y));
    }

    #[test]
    fn garbage_is_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200), options in any::<bool>()) {
        let options = ReadOptions { require_outputs: options, ..plain() };
        let told = read_bytes(&bytes, &uy(), &options).map_err(|e| e.to_string());
        prop_assert!(told.is_ok() || told.is_err_and(|text| !text.is_empty()));
    }

    #[test]
    fn garbage_that_looks_like_a_table_is_read_or_refused(
        text in "(t|t \\[s\\])[,; \t]u[,; ]y\r?\n([0-9a,;.\"# \t%\n\r\\[\\(\u{b0}-]|-1.5|nan|1e9){0,80}",
        every in 1..3_usize,
    ) {
        if let Ok((run, summary)) = read_bytes(text.as_bytes(), &uy(), &ReadOptions { every, ..plain() }) {
            prop_assert!(run.time.windows(2).all(|w| w[0] < w[1]) && run.len() >= 2);
            prop_assert!(run.inputs.iter().all(|v| v.is_finite()));
            prop_assert_eq!(run.len(), summary.used);
        }
    }

    #[test]
    fn every_truncation_and_change_of_a_good_file_is_read_or_refused(
        cut in 0..120_usize, at in 0..120_usize, byte in any::<u8>(),
    ) {
        let text = "# c\nt [s];u [m];y [deg]\n0,0;1,5;NaN\n0,1;2,5;3\n\n0,2;\"3\";4\n0,3;;5\n0,4;5;6\n";
        let mut bytes = text.as_bytes()[..cut.min(text.len())].to_vec();
        let _ = read_bytes(&bytes, &uy(), &plain());
        if let Some(changed) = bytes.get_mut(at) {
            *changed = byte;
        }
        let _ = read_bytes(&bytes, &uy(), &plain());
    }
}

#[test]
fn a_last_line_without_its_end_is_told() {
    for (text, open) in
        [("t,u,y\n0,1,1\n1,2,2.5\n", false), ("t,u,y\n0,1,1\n1,2,2", true), ("t u y\r\n0 1 1\r\n1 2 2\r\n", false)]
    {
        let (_, summary) = good(text, &uy(), &plain());
        assert_eq!(summary.notes.contains(&Note::OpenEnd), open, "{text:?}: {:?}", summary.notes);
    }
}

/// `u` is a column, `measured(y)` is not one.
fn driven() -> Channels {
    Channels { driving: vec![1], ..wanted(&[("u", "")], &[("z", ""), ("y", "")]) }
}

#[test]
fn records_that_drive_the_model_stand_behind_the_inputs() {
    let text = "t,u,y,z\n0,1,,5\n1,2,4,5\n2,,,5\n3,4,8,6\n";
    let (run, summary) = good(text, &driven(), &plain());
    assert_eq!(run.inputs, [1.0, 4.0, 2.0, 4.0, 3.0, 6.0, 4.0, 8.0]);
    assert_eq!((run.held, run.input_gaps, run.output_gaps), (vec![false; 2], vec![1, 2], vec![0, 2]));
    assert!(run.measured[1].is_nan() && run.measured[5].is_nan(), "what is compared keeps its gaps");
    let names: Vec<_> = summary.sources.iter().map(|s| (s.role, s.channel.as_str(), s.gaps)).collect();
    let wanted = [(Role::Time, "t", 0), (Role::Input, "u", 1), (Role::Output, "z", 0), (Role::Output, "y", 2)];
    assert_eq!(names, wanted);
    let notes: Vec<String> = summary.notes.iter().map(ToString::to_string).collect();
    let said = "the input `measured(y)` has no value in 2 sample(s); its neighbours in time bridge them";
    assert!(notes.iter().any(|n| n == said), "{notes:?}");
}

#[test]
fn records_that_drive_the_model_must_be_there() {
    let options = ReadOptions { require_outputs: false, ..plain() };
    let said = one("t,u,z\n0,1,2\n1,2,3\n", &driven(), &options);
    assert!(said.contains("no column for the output `y`") && said.contains("`measured(y)` drives the model"), "{said}");
    let said = one("t,u,y\n0,1,\n1,2,\n", &driven(), &options);
    assert!(said.contains("the output `y` has no value in any selected row"), "{said}");
    assert_eq!(good("t,u,y\n0,1,3\n1,2,4\n", &driven(), &options).0.inputs, [1.0, 3.0, 2.0, 4.0]);
    assert!(
        one("t,u,y,z\n0,1,3,1\n1,2,4,1\n", &driven(), &ReadOptions { hold: vec!["y".into()], ..plain() }).contains("y")
    );
}

#[test]
fn a_constant_record_is_told_once() {
    let (_, summary) = good("t,u,y,z\n0,1,7,5\n1,2,7,6\n2,3,7,8\n", &driven(), &plain());
    let constant: Vec<_> = summary.notes.iter().filter(|n| matches!(n, Note::Constant { .. })).collect();
    assert_eq!(constant.len(), 1, "{constant:?}");
}

#[test]
fn without_time_a_sample_that_lacks_the_driving_record_is_not_compared() {
    let channels = Channels { timed: false, samples: 1, ..driven() };
    let (run, _) = good("u,y,z\n1,2,3\n2,,4\n3,4,5\n", &channels, &plain());
    assert!(run.measured[2..4].iter().all(|v| v.is_nan()) && run.measured[4..] == [5.0, 4.0]);
    assert!(run.inputs.iter().all(|v| v.is_finite()));
}
