//! Long, deep, senseless and mistaken input to the command line: the right answer, or an error that names the place
//! with exit code 2; never a panic, a signal, a flood of text or a wait without end.

use fdm::Model;
use fdm::record::Run;
use fdm::simulate::Simulator;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use support::Desk;

/// Unoptimised code on a busy machine included.
const PATIENCE: Duration = Duration::from_secs(60);

/// A folder in which the command is watched: it ends, and says no more than a reader can read.
struct Watched {
    desk: Desk,
}

/// How the command line ended.
struct Outcome {
    /// `None` when a signal ended it.
    code: Option<i32>,
    out: String,
    err: String,
}

impl Watched {
    fn new() -> Self {
        Self { desk: Desk::new() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.desk.path(name)
    }

    fn file(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        self.desk.write(name, content)
    }

    /// `u` over 21 samples: 1, 2, 3, 1, ...
    fn record(&self) -> PathBuf {
        let rows: String =
            (0..21).map(|k| format!("{},{},{}\n", f64::from(k) / 10.0, 1 + k % 3, 2 * (1 + k % 3))).collect();
        self.file("run.csv", format!("t [s],u,y\n{rows}"))
    }

    fn run<S: AsRef<OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Outcome {
        let (out, err) = (self.path("stdout"), self.path("stderr"));
        let mut child = support::fdm()
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(File::create(&out).expect("a file"))
            .stderr(File::create(&err).expect("a file"))
            .spawn()
            .expect("the command line");
        let start = Instant::now();
        let status = loop {
            match child.try_wait().expect("a status") {
                Some(status) => break status,
                None if start.elapsed() > PATIENCE => {
                    child.kill().and_then(|()| child.wait()).expect("an end");
                    panic!("no end after {PATIENCE:?}");
                }
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        let text = |path: &Path| String::from_utf8_lossy(&fs::read(path).expect("output")).into_owned();
        Outcome { code: status.code(), out: text(&out), err: text(&err) }.sober()
    }

    /// The model is right, and so are its derivatives.
    fn checks(&self, model: &Path) {
        let outcome = self.run([OsStr::new("check"), model.as_os_str()]);
        assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    }

    fn simulate(&self, model: &Path, record: &Path) -> Outcome {
        self.run([OsStr::new("simulate"), model.as_os_str(), OsStr::new("--data"), record.as_os_str()])
    }

    /// Every verb refuses the model.
    fn refuses_model(&self, model: &Path, words: &[&str]) {
        let record = self.record();
        for verb in ["simulate", "fit"] {
            let arguments = [OsStr::new(verb), model.as_os_str(), OsStr::new("--data"), record.as_os_str()];
            self.run(arguments).refused(words);
        }
        self.run([OsStr::new("check"), model.as_os_str()]).refused(words);
    }

    /// Every verb refuses the record.
    fn refuses_record(&self, record: &Path, words: &[&str]) {
        let model = self.file("gain.fdm", GAIN);
        for verb in ["simulate", "fit"] {
            let arguments = [OsStr::new(verb), model.as_os_str(), OsStr::new("--data"), record.as_os_str()];
            self.run(arguments).refused(words);
        }
    }
}

const GAIN: &str = "model gain {\n  input u;\n  param a = 1;\n  output y = a*u;\n}\n";

impl Outcome {
    /// Nothing in the output is a fault of the program or a flood.
    fn sober(self) -> Self {
        assert!(self.code.is_some(), "ended by a signal: {}", self.err);
        assert!(!self.err.contains("panicked"), "{}", self.err);
        assert!(self.err.len() < 30_000, "{} bytes of messages", self.err.len());
        let longest = self.err.lines().map(|l| l.chars().count()).max().unwrap_or(0);
        assert!(longest < 500, "a line of {longest} characters");
        self
    }

    fn refused(self, words: &[&str]) {
        assert_eq!((self.code, self.out.as_str()), (Some(2), ""), "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "`{word}` is not in\n{}", self.err);
        }
    }

    /// The columns of the response, without the header.
    fn table(&self) -> Vec<Vec<f64>> {
        assert_eq!(self.code, Some(0), "{}", self.err);
        let row = |line: &str| line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        self.out.lines().skip(1).map(row).collect()
    }
}

/// xorshift64*: the same bytes in every run.
fn noise(count: usize) -> Vec<u8> {
    let mut state = 1_u64;
    let mut next = || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 56) as u8
    };
    (0..count).map(|_| next()).collect()
}

#[test]
fn five_thousand_levels_of_nesting() {
    let desk = Watched::new();
    let text = format!("model deep {{\n  input u;\n  output y = {}u{};\n}}\n", "(".repeat(5000), ")".repeat(5000));
    desk.refuses_model(&desk.file("deep.fdm", text), &["E0102", "deep.fdm:3:", "256 levels"]);
    let open = desk.file("open.fdm", format!("model deep {{ output y = {}", "(".repeat(1_000_000)));
    desk.refuses_model(&open, &["E0102", "open.fdm:1:", "E0104"]);
}

#[test]
fn a_sum_of_two_hundred_thousand_terms() {
    let desk = Watched::new();
    let terms: Vec<String> = (1..=200_000).map(|k| format!("{k}*u")).collect();
    let text = format!("model sum {{\n  input u;\n  output y = {};\n}}\n", terms.join(" + "));
    let table = desk.simulate(&desk.file("sum.fdm", text), &desk.record()).table();
    for (k, row) in table.iter().enumerate() {
        // every partial sum is an integer below 2^53, so the sum is exact
        assert_eq!(row[1], 200_000.0 * 200_001.0 / 2.0 * (1 + k % 3) as f64);
    }
    assert_eq!(table.len(), 21);
}

#[test]
fn sixty_dependent_squarings() {
    let desk = Watched::new();
    let lets: String = (1..=60).map(|k| format!("  let x{k} = x{}^2;\n", k - 1)).collect();
    let text = format!("model squares {{\n  input u;\n  param a = 1;\n  let x0 = a;\n{lets}  output y = x60*u;\n}}\n");
    let model = desk.file("squares.fdm", &text);
    let table = desk.simulate(&model, &desk.record()).table();
    assert!(table.iter().enumerate().all(|(k, row)| row[1] == (1 + k % 3) as f64));

    // a^(2^60) has the derivative 2^60 at a = 1
    let model = Model::from_text("squares.fdm", text).expect("a model");
    let run = Run {
        name: "one".into(),
        time: vec![0.0],
        inputs: vec![1.0],
        measured: vec![f64::NAN],
        held: vec![false],
        input_gaps: vec![0],
        stated: Vec::new(),
        output_gaps: vec![0],
    };
    let mut simulator = Simulator::new(model.dynamics(), &run, 1).expect("suited");
    let (mut y, mut jacobian) = (vec![0.0], vec![0.0; 8]);
    simulator.sensitivities(&[1.0], &[0], &mut y, &mut jacobian).expect("finite");
    assert_eq!((y[0], jacobian[0]), (1.0, 2.0_f64.powi(60)));
    desk.checks(&desk.path("squares.fdm"));
}

#[test]
fn ten_thousand_lets_in_a_chain() {
    let desk = Watched::new();
    // the last first: each is used before it is defined
    let lets: String = (1..=10_000).rev().map(|k| format!("  let l{k} = l{} + 1;\n", k - 1)).collect();
    let text = format!("model chain {{\n  input u;\n{lets}  let l0 = u;\n  output y = l10000;\n}}\n");
    let table = desk.simulate(&desk.file("chain.fdm", text), &desk.record()).table();
    assert!(table.iter().enumerate().all(|(k, row)| row[1] == 10_000.0 + (1 + k % 3) as f64));
    desk.checks(&desk.path("chain.fdm"));
}

#[test]
fn a_thousand_params_states_and_outputs() {
    let desk = Watched::new();
    let lines: String = (0..1000)
        .map(|k| format!("  param a{k} = {k}; state x{k} = a{k}; der(x{k}) = 0*u; output y{k} = x{k} + u;\n"))
        .collect();
    let text = format!("model wide {{\n  input u;\n{lines}}}\n");
    let table = desk.simulate(&desk.file("wide.fdm", text), &desk.record()).table();
    for (k, row) in table.iter().enumerate() {
        assert!((0..1000).all(|o| row[1 + o] == (o + 1 + k % 3) as f64), "row {k}");
    }
    desk.checks(&desk.path("wide.fdm"));
    // measured is none of them
    let (model, record) = (desk.path("wide.fdm"), desk.path("run.csv"));
    let fit = [OsStr::new("fit"), model.as_os_str(), OsStr::new("--data"), record.as_os_str()];
    desk.run(fit).refused(&["no column for the output `y0`", "980 more problems"]);
}

#[test]
fn mistakes_of_meaning() {
    let desk = Watched::new();
    let unit = "model m {\n  input u [m];\n  param a = 1 [s];\n  output y [m] = u + a;\n}\n";
    desk.refuses_model(&desk.file("unit.fdm", unit), &["E0602", "unit.fdm:4:20", "m and s cannot be added"]);
    let circle = "model m {\n  input u;\n  let a = b; let b = c + u; let c = a;\n  output y = a;\n}\n";
    desk.refuses_model(&desk.file("circle.fdm", circle), &["E0206", "circle.fdm:3:7", "`a` -> `b` -> `c` -> `a`"]);
    let circle: String = (0..10_000).map(|k| format!("  let l{k} = l{};\n", (k + 1) % 10_000)).collect();
    let circle = format!("model m {{\n  input u;\n{circle}  output y = l0*u;\n}}\n");
    desk.refuses_model(&desk.file("large.fdm", circle), &["E0206", "large.fdm:3:7", "(10000 names)"]);
}

#[test]
fn very_many_mistakes_are_counted() {
    let desk = Watched::new();
    let unknown: String = (0..20_000).map(|k| format!("  output y{k} = nowhere_{k};\n")).collect();
    let many = desk.file("unknown.fdm", format!("model m {{\n{unknown}}}\n"));
    desk.refuses_model(&many, &["`nowhere_0` is not declared", "20000 errors; 50 are shown"]);
    let twice =
        desk.file("twice.fdm", format!("model m {{\n  output y = 1;\n{}}}\n", "  param a = 1;\n".repeat(20_000)));
    desk.refuses_model(&twice, &["declared a second time", "19999 errors, 1 warning; 50 are shown"]);
    let slips = desk.file("slips.fdm", format!("model m {{\n{}}}\n", "  param a 1;\n".repeat(20_000)));
    desk.refuses_model(&slips, &["19980 more mistakes"]);
}

#[test]
fn bytes_without_sense() {
    let desk = Watched::new();
    let bytes = noise(200_000);
    desk.refuses_model(&desk.file("noise.fdm", &bytes), &["E0106", "noise.fdm:1:", "not UTF-8"]);
    desk.refuses_record(&desk.file("noise.csv", &bytes), &["noise.csv"]);
    let letters: Vec<u8> = bytes.iter().map(|b| b % 95 + 32).collect();
    desk.refuses_model(&desk.file("letters.fdm", &letters), &["letters.fdm:1:", "error"]);
    desk.refuses_record(&desk.file("letters.csv", &letters), &["letters.csv"]);
    let framed = [b"model m {\n".as_slice(), &letters, b"\n}\n"].concat();
    desk.refuses_model(&desk.file("framed.fdm", framed), &["framed.fdm:2:", "error"]);
}

#[test]
fn nothing_at_all() {
    let desk = Watched::new();
    desk.refuses_model(&desk.file("empty.fdm", ""), &["E0101", "empty.fdm:1:1", "holds no model"]);
    desk.refuses_record(&desk.file("empty.csv", ""), &["empty.csv", "holds no rows"]);
    desk.refuses_record(&desk.file("header.csv", "t [s],u,y\n"), &["header.csv", "no rows below the header"]);
    desk.refuses_model(&desk.path("missing.fdm"), &["missing.fdm: there is no such file"]);
    desk.refuses_record(&desk.path("missing.csv"), &["missing.csv: ", "there is no such file"]);
}

#[test]
fn directories() {
    let desk = Watched::new();
    let folder = desk.path("folder");
    fs::create_dir(&folder).expect("a folder");
    desk.refuses_model(&folder, &["folder: is a directory"]);
    desk.refuses_record(&folder, &["folder: this is a directory"]);
}

#[test]
fn a_model_and_a_record_confused() {
    let desk = Watched::new();
    let (model, record) = (desk.file("gain.fdm", GAIN), desk.record());
    for verb in ["simulate", "fit"] {
        let arguments = [OsStr::new(verb), record.as_os_str(), OsStr::new("--data"), record.as_os_str()];
        desk.run(arguments).refused(&["no model among these words", &format!("fdm {verb} ")]);
    }
    let told = desk.run([OsStr::new("check"), record.as_os_str()]);
    told.refused(&["E0101", "run.csv:1:1", "looks like a table"]);
    desk.refuses_record(&model, &["gain.fdm"]);
}

#[test]
fn records_cut_or_without_end_of_line() {
    let desk = Watched::new();
    let cut = desk.file("cut.csv", "t [s],u,y\n0,1,2\n0.1,2,4\n0.2,");
    desk.refuses_record(&cut, &["cut.csv: line 4", "found 2 cells, expected 3"]);
    let whole = desk.file("whole.csv", "t [s],u,y\n0,1,2\n0.1,2,4\n0.2,3,6");
    let model = desk.file("gain.fdm", GAIN);
    assert_eq!(desk.simulate(&model, &whole).table().last().map(|row| row[1]), Some(3.0));
    let line = desk.file("line.csv", format!("t [s],u,y\n{}", "0.1,1,2,".repeat(2_500_000)));
    desk.refuses_record(&line, &["line.csv: line 2", "longer than the limit"]);
    let header = desk.file("header.csv", "x".repeat(20_000_000));
    desk.refuses_record(&header, &["header.csv"]);
}

#[test]
fn options_that_fit_nothing() {
    let desk = Watched::new();
    let (model, record) = (desk.file("gain.fdm", GAIN), desk.record());
    let with = |verb: &str, more: &[&str]| {
        let first = [OsStr::new(verb), model.as_os_str(), OsStr::new("--data"), record.as_os_str()];
        desk.run(first.into_iter().chain(more.iter().map(OsStr::new)))
    };
    for verb in ["simulate", "fit"] {
        with(verb, &["--set", "b=2"]).refused(&["`b`"]);
        with(verb, &["--set", "a=many"]).refused(&["--set", "`many` is not a number"]);
        with(verb, &["--map", "y=angle"]).refused(&["--map y=angle", "no such column"]);
        with(verb, &["--map", "z=y"]).refused(&["`z`", "which the model does not have"]);
        with(verb, &["--zoh", "w"]).refused(&["--zoh", "`w`"]);
        with(verb, &["--every", "0"]).refused(&["--every 0"]);
        with(verb, &["--from", "5"]).refused(&["--from"]);
        with(verb, &["--wrong"]).refused(&["--wrong"]);
        with(verb, &["--steps", "0"]).refused(&["--steps"]);
        for option in ["--steps", "--every", "--threads"] {
            // not taken for an option of that name
            with(verb, &[option, "-1"]).refused(&[option, "invalid value '-1'"]);
        }
        with(verb, &["--threads", "0"]).refused(&["--threads"]);
        with(verb, &["--threads", "60000"]).refused(&["--threads", "1024"]);
        let moving = desk.file("moving.fdm", "model moving { state x = 1; output y = x; param a = 1; der(x) = -a*x; }");
        let record = desk.record();
        let data = [OsStr::new("--data"), record.as_os_str(), OsStr::new("--steps"), OsStr::new("900000000")];
        desk.run([OsStr::new(verb), moving.as_os_str()].into_iter().chain(data))
            .refused(&["18000000000 steps are more than 20000000", "21 samples"]);
    }
    with("fit", &["--noise", "nonsense"]).refused(&["--noise nonsense", "expected NAME=VALUE"]);
    with("fit", &["--noise", "y=-1"]).refused(&["noise"]);
    with("fit", &["--noise", "full", "--noise", "diagonal"]).refused(&["--noise", "exclude each other"]);
    with("fit", &["--fix", "b"]).refused(&["`b`"]);
    for (option, value, words) in [
        ("--starts", "0", "0 is not in 1..=1000000"),
        ("--seed", "-1", "--seed"),
        ("--gain", "0", "gain is 0, but must be above 0"),
        ("--gain", "nan", "gain is NaN"),
        ("--tolerance", "-1", "tolerance is -1, but must be between 0 and 1"),
        ("--continuation", "banana", "a number of lengths from 2 on"),
        ("--continuation", "-3", "a number of lengths from 2 on"),
        ("--shooting", "0", "--shooting"),
        ("--shooting", "99999999", "--shooting"),
        ("--substitute", "nobody", "no state `nobody`"),
        ("--integrator", "euler", "runge-kutta, radau"),
        ("--method", "newton", "equation-error, frequency-response"),
    ] {
        with("fit", &[option, value]).refused(&[words]);
    }
    let beneath = model.join("state");
    let beneath = beneath.to_str().expect("a path of letters");
    with("fit", &["--checkpoint", beneath]).refused(&["the checkpoint cannot be kept"]);
    with("fit", &["--out", beneath]).refused(&["the result folder cannot be written"]);
    with("fit", &["--out", &beneath[..beneath.len() - "/state".len()]]).refused(&["not a result of fdm", "left alone"]);
    // nothing to estimate: the model is compared with the record
    assert_eq!(with("fit", &["--fix", "a", "--quiet"]).code, Some(0));
}

#[test]
fn records_that_drive_a_model_are_needed_by_every_verb() {
    let desk = Watched::new();
    let text = "model driven { state x = 1; param a = 1; der(x) = -a*measured(y); output y = x, z = 2*x; prior a ~ normal(1, 1); }";
    let model = desk.file("driven.fdm", text);
    desk.checks(&model);
    let rows = |title: &str, cell: &dyn Fn(u32) -> String| {
        let rows: String = (0..21).map(|k| format!("{},{}\n", f64::from(k) / 10.0, cell(k))).collect();
        format!("t [s],{title}\n{rows}")
    };
    for (name, header, cell) in [("absent.csv", "z", "1"), ("empty.csv", "y", "")] {
        let record = desk.file(name, rows(header, &|_| cell.into()));
        desk.simulate(&model, &record).refused(&["output `y`", name]);
    }
    let record =
        desk.file("gaps.csv", rows("y", &|k| if k % 3 == 1 { String::new() } else { f64::from(k).to_string() }));
    let outcome = desk.simulate(&model, &record);
    assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    // x = 1 - 5 t^2, as the bridged record is 10 t
    let last: Vec<f64> =
        outcome.out.lines().last().expect("rows").split(',').map(|c| c.parse().expect("numbers")).collect();
    assert!((last[1] + 19.0).abs() < 1e-9, "{last:?}");
    let hold = [OsStr::new("--zoh"), OsStr::new("y")];
    let first = [OsStr::new("simulate"), model.as_os_str(), OsStr::new("--data"), record.as_os_str()];
    desk.run(first.into_iter().chain(hold)).refused(&["--zoh `y`", "only inputs"]);
}

#[test]
fn results_that_cannot_be_written() {
    let desk = Watched::new();
    let (model, record) = (desk.file("gain.fdm", GAIN), desk.record());
    for target in [desk.path("nowhere/out.csv"), desk.desk.folder().to_path_buf()] {
        let option = |verb: &str, option: &str| {
            let first = [OsStr::new(verb), model.as_os_str(), OsStr::new("--data"), record.as_os_str()];
            desk.run(first.into_iter().chain([OsStr::new(option), target.as_os_str()]))
        };
        let name = target.file_name().expect("a name").to_string_lossy().into_owned();
        option("simulate", "-o").refused(&[name.as_str()]);
        // the estimates have been printed by then
        let fit = option("fit", "--plot");
        assert!(fit.code == Some(2) && fit.err.contains(&name), "{}", fit.err);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_printed_is_told_and_a_closed_pipe_is_an_end() {
    let desk = Watched::new();
    let (model, record) = (desk.file("gain.fdm", GAIN), desk.record());
    let folder = desk.path("result");
    let command = |verb: &str, more: &[&OsStr], out: Stdio| {
        let mut command = support::fdm();
        command.arg(verb).arg(&model).args(more).stdin(Stdio::null()).stdout(out).stderr(Stdio::piped());
        command.output().expect("the command line")
    };
    let data: [&OsStr; 2] = [OsStr::new("--data"), record.as_os_str()];
    let out = [data[0], data[1], OsStr::new("--out"), folder.as_os_str()];
    for (verb, more) in [("check", &[][..]), ("simulate", &data), ("fit", &out)] {
        let full = File::options().write(true).open("/dev/full").expect("the device that is always full");
        let ended = command(verb, more, full.into());
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!(ended.status.code(), Some(1), "{verb}: {said}");
        assert!(said.contains("error: the result cannot be printed: the disk is full"), "{verb}: {said}");
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let ended = command(verb, more, writer.into());
        assert_eq!(ended.status.code(), Some(0), "{verb}: {}", String::from_utf8_lossy(&ended.stderr));
    }
    // what could not be printed stands in the folder
    assert!(folder.join("result.txt").is_file());
}
