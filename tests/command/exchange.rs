//! `fdm export` and `fdm verify`: units, source and matrices as a user writes them, and a unit's library as a simulator calls it.

#![allow(unsafe_code, reason = "a unit's library is loaded and called, as a simulator does")]

use crate::daveml;
use fdm::Model;
use fdm_exchange::Stamp;
use fdm_exchange::daveml::tables;
use fdm_exchange::fmu::{Kind, Variables, Version};
use fdm_exchange::verify::Artefact;
use libloading::Library;
use std::collections::BTreeMap;
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::fs;
use std::path::PathBuf;
use std::process::Command;
use support::Desk;
use support::command::{printed, said};

const ACTUATOR: &str = "model actuator \"a servo with a late sensor\" {
  input u [deg];
  state x [deg] = 0, v [deg/s] = 0;
  param omega = 6 in [1, 20] [rad/s] \"natural frequency\", zeta = 0.4, c = 0.02 [1/deg], tau = 0.13 [s];
  der(x) = v;
  der(v) = omega^2*(u - x) - 2*zeta*omega*v - c*v*abs(v);
  output y [deg] = delay(x, tau);
  output w [deg/s] = v;
}";

/// The library that Cargo built for these tests.
fn library() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let name = format!("{}fdm_fmu{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX);
    test.parent().unwrap().join(name)
}

fn desk() -> Desk {
    let mut record = String::from("t [s], u [deg]\n");
    for k in 0..61 {
        let t = 0.05 * f64::from(k);
        record += &format!("{t}, {}\n", (2.0 * t).sin() + f64::from(u8::from(t > 1.0)));
    }
    Desk::with([("m.fdm", ACTUATOR.to_string()), ("run.csv", record)])
}

fn export(desk: &Desk, words: &str) -> std::process::Output {
    let library = library();
    let words = words.split_whitespace().map(String::from);
    let more = ["--library".to_string(), library.display().to_string()];
    desk.command_of(words.chain(more)).output().unwrap()
}

#[test]
fn units_and_source_are_verified_and_strangers_are_not() {
    let desk = desk();
    for (kind, file) in [("fmu", "two.fmu"), ("fmu --fmi 3", "three.fmu"), ("c", "m.c"), ("rust", "m.rs")] {
        let done = export(&desk, &format!("export m.fdm --set zeta=0.5 --to {kind} -o {file}"));
        assert!(done.status.success(), "{kind}: {}", said(&done));
        let verified = desk.fdm(&format!("verify {file} --against m.fdm --set zeta=0.5"));
        let no_compiler = said(&verified).contains("no compiler");
        assert!(verified.status.success() || no_compiler, "{kind}: {}{}", printed(&verified), said(&verified));
        assert!(
            no_compiler || printed(&verified).contains("verified: all numbers at 8 points"),
            "{}",
            printed(&verified)
        );
        if kind.starts_with("fmu") {
            // the interpreter is that of fdm: the same bits
            assert!(!printed(&verified).contains("e-"), "{}", printed(&verified));
        }
        let other = desk.fdm(&format!("verify {file} --against m.fdm"));
        assert_eq!(other.status.code(), Some(1));
        assert!(said(&other).contains("another model, or from other values"), "{}", said(&other));
    }
    // the same model gives the same file, and a file of ours is replaced
    let first = fs::read(desk.path("two.fmu")).unwrap();
    assert!(export(&desk, "export m.fdm --set zeta=0.5 --to fmu -o two.fmu").status.success());
    assert_eq!(fs::read(desk.path("two.fmu")).unwrap(), first);
    // one that computes something else
    let text = desk.text("m.c");
    let wrong = text.replacen("* drive[", "* 1.001 * drive[", 1).replacen("- x[", "- 1.001 * x[", 1);
    assert_ne!(text, wrong);
    desk.write("wrong.c", wrong);
    let verified = desk.fdm("verify wrong.c --against m.fdm --set zeta=0.5");
    assert_eq!(verified.status.code(), Some(1));
    assert!(printed(&verified).contains("NOT verified") || said(&verified).contains("no compiler"));
}

#[test]
fn what_cannot_be_exported_or_verified_is_said() {
    let desk = desk();
    assert!(desk.refused("export m.fdm --to fmu").contains("a unit is not text"));
    assert!(desk.refused("export m.fdm --to fmu -o a.fmu --library none.so").contains("none.so"));
    desk.write(
        "ahead.fdm",
        "model a { input u; param skew = -0.1 in [-0.5, 0.5]; state x = 0; der(x) = delay(u, skew) - x; output y = x; }",
    );
    let ahead = export(&desk, "export ahead.fdm --to fmu -o a.fmu");
    assert!(said(&ahead).contains("a unit cannot look ahead"), "{}", said(&ahead));
    desk.write("mine.fmu", "my own");
    assert!(desk.refused("export m.fdm --to control -o mine.fmu").contains("left alone"));
    assert!(desk.refused("verify mine.fmu --against m.fdm").contains("mine.fmu: the archive"));
    assert!(desk.refused("verify run.csv --against m.fdm").contains("neither a unit (.fmu) nor source"));
    desk.write("bare.c", "int a;");
    assert!(desk.refused("verify bare.c --against m.fdm").contains("has no stamp of fdm"));
    let matrices = desk.json("export m.fdm --to control");
    assert_eq!(matrices["A"][1][0], -36.0);
    assert_eq!(matrices["delays"][0]["tau"], 0.13);
}

/// Two equations that share a parameter by a tie; a late input, a held one, a value of the run, a measured regressor, an output that is a
/// scaled state with an offset.
const FLIGHT: &str = "model flight {
  input u, e;
  known W per run;
  state x = 0, z = 0;
  param a = -1, b = 1, c = 0.1, d = -1, k = 0.5 fixed, off = 0 per run;
  tie d = 2*a;
  der(x) = a*x + b*delay(u, 0.13) - c*x*z + k*z + 0.1*W;
  der(z) = d*z - x + e*cos(t) + off + 0.2*tanh(measured(y2));
  output y1 = 2*x + 1, y2 = z;
}";

/// What a flight computer would do with the file: samples in, estimates out.
const COMPUTER: &str = "#include \"est.c\"
#include <stdio.h>
int main(void)
{
    static flight_estimator e;
    double sample[1 + flight_INPUTS + flight_OUTPUTS], value[flight_UNKNOWNS], error[flight_UNKNOWNS];
    int k = 0;
    flight_begin(&e);
    while (scanf(\"%lf\", sample + k) == 1)
        if (++k == 1 + flight_INPUTS + flight_OUTPUTS) {
            flight_sample(&e, sample[0], sample + 1, sample + 1 + flight_INPUTS);
            k = 0;
        }
    flight_estimate(&e, value, error);
    for (k = 0; k < flight_UNKNOWNS; k++)
        printf(\"%d %.17g %.17g\\n\", flight_unknown_param[k], value[k], error[k]);
    return flight_sample(&e, 0.0, sample + 1, sample + 1) == -1 ? 0 : 1;
}
";

#[test]
fn an_estimator_in_c_follows_the_parameters_as_fdm_does() {
    let desk = Desk::with([("m.fdm", FLIGHT), ("computer.c", COMPUTER)]);
    let (mut record, mut samples) = (String::from("t, u, e, y1, y2\n"), String::new());
    for k in 0..400_i32 {
        // uneven times, jumps, gaps
        let t = 0.05 * f64::from(k) + 0.01 * (f64::from(k) * 0.7).sin() - if k == 0 { 0.0 } else { 0.002 };
        let (u, e) = ((1.3 * t).sin() + 0.3 * (4.1 * t).cos(), f64::from(u8::from(k % 90 < 40)));
        let (y1, y2) = (1.0 + (0.9 * t + 0.4).sin(), 0.6 * (1.7 * t).cos() + 0.1 * e);
        let cell = |value: f64, gap: bool| if gap { String::new() } else { format!("{value:?}") };
        let (one, two) = (cell(y1, k % 50 == 17), cell(y2, false));
        record += &format!("{t:?}, {u:?}, {e:?}, {one}, {two}\n");
        let number = |cell: &str| if cell.is_empty() { "nan".to_string() } else { cell.to_string() };
        samples += &format!("{t:?} {u:?} {e:?} 3 {} {}\n", number(&one), number(&two));
    }
    desk.write("run.csv", record);
    desk.write("samples.txt", &samples);
    let data = "--data run.csv --known W=3 --zoh e --forgetting 0.98";
    desk.good(&format!("export m.fdm --to c --recursive {data} -o est.c"));
    let fitted = desk.json(&format!("regress m.fdm --recursive --best last {data} --json"));
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    let flags = "-std=c99 -Wall -Wextra -Werror -Wno-unused-function -O2 -ffp-contract=off -o computer computer.c -lm";
    let compiled = Command::new(&compiler).args(flags.split(' ')).current_dir(desk.folder()).output();
    let Ok(compiled) = compiled else { return println!("no compiler `{compiler}` here") };
    assert!(compiled.status.success(), "{}", said(&compiled));
    let samples = fs::File::open(desk.path("samples.txt")).unwrap();
    let told = Command::new(desk.path("computer")).stdin(samples).output().unwrap();
    assert!(told.status.success());
    let definition = Model::from_file(desk.path("m.fdm")).unwrap().definition().clone();
    let mut worst = 0.0_f64;
    let lines = printed(&told);
    for line in lines.lines() {
        let numbers: Vec<f64> = line.split(' ').map(|v| v.parse().unwrap()).collect();
        let name = &definition.params[numbers[0] as usize].quantity.name;
        let own = fitted["parameters"].as_array().unwrap().iter().find(|p| p["name"] == name.as_str()).unwrap();
        for (key, found) in [("value", numbers[1]), ("standard_error", numbers[2])] {
            let expected = own[key].as_f64().unwrap();
            worst = worst.max((found / expected - 1.0).abs());
        }
    }
    assert_eq!(lines.lines().count(), 4, "a, b, c, off: {lines}");
    println!("largest relative difference from fdm regress: {worst:.1e}");
    assert!(worst < 1e-9, "{worst:e}");
    let verified = desk.fdm("verify est.c --against m.fdm");
    assert!(verified.status.success(), "{}{}", printed(&verified), said(&verified));
    assert!(printed(&verified).contains("estimates"), "{}", printed(&verified));
    // one that forgets another way
    let wrong = desk.text("est.c").replace("1.0 / sqrt(e->forgetting)", "1.0 / e->forgetting");
    desk.write("wrong.c", wrong);
    assert_eq!(desk.fdm("verify wrong.c --against m.fdm").status.code(), Some(1));
}

#[test]
fn what_is_no_estimator_is_said() {
    let desk = desk();
    desk.write("run2.csv", "t [s], u [deg], y [deg], w [deg/s]\n0, 0, 0, 0\n0.1, 1, 0.1, 1\n0.2, 1, 0.3, 1\n");
    let told = desk.refused("export m.fdm --to c --recursive --data run2.csv -o e.c");
    assert!(told.contains("no equation of the model is a regression"), "{told}");
    assert!(desk.refused("export m.fdm --to rust --recursive --data run2.csv").contains("--to c"));
    assert!(desk.refused("export m.fdm --to c --data run2.csv").contains("records are for --recursive"));
    assert!(desk.refused("export m.fdm --to c --recursive").contains("--data"));
    // an estimator that estimates nothing is none
    let text = "model s { input u; state x = 0; param a = -1, b = 1; der(x) = a*x + b*u; output y = x; }";
    desk.write("s.fdm", text);
    desk.write("s.csv", "t, u\n0, 0\n0.1, 1\n0.2, 1\n0.3, 2\n");
    assert!(desk.refused("export s.fdm --to c --recursive --data s.csv").contains("no column for the output `y`"));
    desk.write("s.csv", "t, u, y\n0, 0, 0\n0.1, 1,\n0.2, 1, 0.1\n0.3, 2,\n");
    assert!(desk.refused("export s.fdm --to c --recursive --data s.csv").contains("der(x): no sample has all values"));
    let text = "model d { input u; state x = 0; param a = -1, b = 1; der(x) = a*x + b*der(u); output y = x; }";
    desk.write("d.fdm", text);
    let rows: String = (0..40)
        .map(|k| format!("{}, {}, {}\n", 0.1 * f64::from(k), (0.1 * f64::from(k)).sin(), (0.07 * f64::from(k)).cos()))
        .collect();
    desk.write("d.csv", format!("t, u, y\n{rows}"));
    let told = desk.refused("export d.fdm --to c --recursive --data d.csv");
    assert!(told.contains("needs the next sample"), "{told}");
    // records of a project are for what works on them
    desk.write("fdm.toml", "model = \"m.fdm\"\ndata = \"run2.csv\"\n[options]\nzoh = [\"u\"]\n");
    desk.good("export --to c -o plain.c");
    assert!(desk.refused("export --to c --recursive -o e.c").contains("no equation of the model is a regression"));
    // a result says itself how its records were read
    desk.write("fdm.toml", "model = \"s.fdm\"\ndata = \"d.csv\"\n[options]\nzoh = [\"u\"]\n");
    desk.good("fit -q --out kept");
    desk.good("simulate --from-result kept -o again.csv");
}

/// A reader of DAVE-ML that knows what the standard says of gridded tables, and nothing of fdm: the file's own check cases, and the model's outputs.
#[test]
fn tables_are_read_by_another_program() {
    let wing = "model wing \"a wing\" { input alpha [deg], delta [deg], M; state q [rad/s] = 0; param CL1 = 0.6, Cmq = -3 [1/s];
        table CL(alpha [deg], delta [deg]) \"lift\" [1] = linear { alpha: [-5, 0, 10], delta: [-10, 20], CL: [[-0.4, -0.1], [0, CL1], [0.8, 1.1]] };
        table CD(M) = cubic { 0.2: 0.02, 0.5: 0.022, 0.8: 0.04, 1.1: 0.09 };
        table K(alpha [deg], delta [deg], M) = linear { alpha: [0, 1], delta: [0, 2], M: [0, 1, 3],
          K: [[[1, 2, 4], [0, 1, 5]], [[2, 2, 2], [1, 3, 3]]] };
        der(q) = Cmq*q; output L = CL(alpha, delta), D = CD(M), k = K(alpha, delta, M), qm [rad/s] = q; }";
    let desk = Desk::with([("w.fdm", wing)]);
    let done = desk.fdm("export w.fdm --to daveml --set CL1=0.7 -o w.dml");
    assert!(said(&done).contains("`CD` is no linear table"), "{}", said(&done));
    let text = desk.text("w.dml");
    let read = daveml::Functions::read(&text);
    assert_eq!(read.names(), ["CD", "CL", "K"]);
    let cases = daveml::cases(&text);
    assert_eq!(cases.len(), 8);
    for case in &cases {
        for (name, value, tolerance) in &case.outputs {
            let found = read.value(name, &case.inputs);
            assert!((found - value).abs() <= *tolerance, "{name} at {:?}: {found} {value}", case.inputs);
        }
    }
    // and the model's own words
    let points = [[-5.0, -10.0, 0.2], [3.3, 4.4, 0.61], [0.4, 1.7, 1.03], [12.0, 30.0, 2.0], [0.9, 0.3, 0.5]];
    let mut record = String::from("t, alpha, delta, M\n");
    points.iter().enumerate().for_each(|(k, [a, d, m])| record += &format!("{k}, {a}, {d}, {m}\n"));
    desk.write("p.csv", record);
    let simulated = desk.good("simulate w.fdm --set CL1=0.7 --data p.csv --zoh alpha --zoh delta --zoh M");
    let rows: Vec<Vec<f64>> = simulated
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.trim().parse().unwrap()).collect())
        .collect();
    assert_eq!(rows.len(), points.len());
    for (row, point) in rows.iter().zip(&points) {
        let inputs: Vec<(String, f64)> =
            ["alpha", "delta", "M"].iter().zip(point).map(|(n, v)| ((*n).to_string(), *v)).collect();
        for (name, expected, room) in [("CL", row[1], 1e-12), ("CD", row[2], 1e-4), ("K", row[3], 1e-12)] {
            let found = read.value(name, &inputs);
            assert!((found - expected).abs() < room, "{name} at {point:?}: {found} {expected}");
        }
    }
    // the curvature of the spline is below 2/3, a part of an interval 0.3/16 long: straight lines err by h^2/8 of it
    let model = Model::from_file(desk.path("w.fdm")).unwrap();
    let found = tables(&model, &BTreeMap::from([("CL1".to_string(), 0.03), ("Cmq".to_string(), 0.2)])).unwrap();
    let [(name, error)] = &found.resampled[..] else { panic!("{:?}", found.resampled) };
    assert!(name == "CD" && *error > 0.0 && *error < 0.7 * (0.3_f64 / 16.0).powi(2) / 8.0, "{error:e}");
    assert!(found.text.contains("<dataTable>0.0, 0.0, 0.0, 0.03, 0.0, 0.0</dataTable>"), "{}", found.text);
    assert!(found.text.contains("<bounds>0.2</bounds>"), "{}", found.text);
    let variables = found.text.matches("<variableDef ").count();
    assert_eq!(variables, 3 + 3 + 1, "arguments of one name and unit are one variable; nodes are none: {}", found.text);
    let told = |text: &str| {
        desk.write("bad.fdm", text);
        desk.refused("export bad.fdm --to daveml")
    };
    assert!(told(ACTUATOR).contains("has no `table`"));
    let made = "model m { input u; param a = 1; table T(x) = linear { 0: 2*a, 1: 1 }; output y = T(u); }";
    assert!(told(made).contains("a node of the table `T` is an expression"));
}

type Environment = *mut c_void;

/// Functions of FMI 2.0 that the test calls.
struct Two(Library);

#[repr(C)]
struct Callbacks {
    logger: Option<unsafe extern "C" fn(Environment, *const c_char, c_int, *const c_char, *const c_char, ...)>,
    others: [*const c_void; 4],
}

impl Two {
    /// A function by its name and type.
    fn of<F: Copy>(&self, name: &str) -> F {
        // SAFETY: the types below are those of the standard's header
        *unsafe { self.0.get::<F>(name.as_bytes()) }.unwrap()
    }

    fn set(&self, c: Environment, reference: u32, value: f64) -> c_int {
        let set: unsafe extern "C" fn(Environment, *const c_uint, usize, *const f64) -> c_int = self.of("fmi2SetReal");
        // SAFETY: one reference and one value
        unsafe { set(c, &raw const reference, 1, &raw const value) }
    }

    fn get(&self, c: Environment, reference: u32) -> f64 {
        let get: unsafe extern "C" fn(Environment, *const c_uint, usize, *mut f64) -> c_int = self.of("fmi2GetReal");
        let mut value = f64::NAN;
        // SAFETY: as above
        assert_eq!(unsafe { get(c, &raw const reference, 1, &raw mut value) }, 0);
        value
    }

    fn plain(&self, c: Environment, name: &str) -> c_int {
        let call: unsafe extern "C" fn(Environment) -> c_int = self.of(name);
        // SAFETY: an instance of this library
        unsafe { call(c) }
    }
}

/// Unpacks a unit, whose folder has a space in its name, and steps it through the record by the C functions of FMI 2.0: the response is that of
/// `fdm simulate`.
#[test]
fn a_library_steps_through_a_record_as_fdm_simulates_it() {
    let desk = desk();
    let done = export(&desk, "export m.fdm --to fmu -o m.fmu");
    assert!(done.status.success(), "{}", said(&done));
    let model = Model::from_file(desk.path("m.fdm")).unwrap();
    let unit = Artefact::read("m.fmu", &fs::read(desk.path("m.fmu")).unwrap()).unwrap();
    let Artefact::Unit(Version::Two, files) = unit else { panic!("a unit of FMI 2.0") };
    for (name, bytes) in &files {
        let path = desk.path("a unit").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    let binary = files.iter().find(|(name, _)| name.starts_with("binaries/")).unwrap();
    // SAFETY: the library of fdm
    let two = Two(unsafe { Library::new(desk.path("a unit").join(&binary.0)) }.unwrap());
    let make: unsafe extern "C" fn(
        *const c_char,
        c_int,
        *const c_char,
        *const c_char,
        *const Callbacks,
        c_int,
        c_int,
    ) -> Environment = two.of("fmi2Instantiate");
    let token = CString::new(Stamp::of(&model).guid()).unwrap();
    let folder = format!("file://{}", desk.path("a unit/resources").display()).replace(' ', "%20");
    let folder = CString::new(folder).unwrap();
    let callbacks = Callbacks { logger: None, others: [std::ptr::null(); 4] };
    // SAFETY: arguments are those of the standard
    let c = unsafe { make(c"a".as_ptr(), 1, token.as_ptr(), folder.as_ptr(), &raw const callbacks, 0, 0) };
    assert!(!c.is_null());
    // SAFETY: as above
    let stranger = unsafe { make(c"a".as_ptr(), 1, c"{1}".as_ptr(), folder.as_ptr(), &raw const callbacks, 0, 0) };
    assert!(stranger.is_null(), "another token is refused");
    let variables = Variables::of(&model);
    let of = |kind| variables.of_kind(kind).unwrap();
    let (u, y, w) = (of(Kind::Input(0)), of(Kind::Output(0)), of(Kind::Output(1)));
    let set_up: unsafe extern "C" fn(Environment, c_int, f64, f64, c_int, f64) -> c_int = two.of("fmi2SetupExperiment");
    // SAFETY: as above
    assert_eq!(unsafe { set_up(c, 1, 1e-12, 0.0, 0, 0.0) }, 0);
    assert_eq!(two.plain(c, "fmi2EnterInitializationMode"), 0);
    let record: Vec<(f64, f64)> = desk
        .text("run.csv")
        .lines()
        .skip(1)
        .map(|line| {
            let (t, u) = line.split_once(", ").unwrap();
            (t.parse().unwrap(), u.parse().unwrap())
        })
        .collect();
    assert_eq!(two.set(c, u, record[0].1), 0);
    assert_eq!(two.plain(c, "fmi2ExitInitializationMode"), 0);
    let slope: unsafe extern "C" fn(Environment, *const c_uint, usize, *const c_int, *const f64) -> c_int =
        two.of("fmi2SetRealInputDerivatives");
    let step: unsafe extern "C" fn(Environment, f64, f64, c_int) -> c_int = two.of("fmi2DoStep");
    let table = desk.good("simulate m.fdm --data run.csv --integration-accuracy 1e-12");
    let mut rows = table.lines().skip(1);
    let mut worst = 0.0_f64;
    let mut compare = |c: Environment| {
        let row: Vec<f64> = rows.next().unwrap().split(',').map(|cell| cell.trim().parse().unwrap()).collect();
        worst = worst.max((two.get(c, y) - row[1]).abs()).max((two.get(c, w) - row[2]).abs());
    };
    compare(c);
    for pair in record.windows(2) {
        let ((t, a), (end, b)) = (pair[0], pair[1]);
        let h = end - t;
        let rate = (b - a) / h;
        assert_eq!(two.set(c, u, a), 0);
        // SAFETY: one reference, one order, one value
        unsafe {
            assert_eq!(slope(c, &raw const u, 1, &raw const ORDER, &raw const rate), 0);
            assert_eq!(step(c, t, h, 1), 0);
        }
        compare(c);
    }
    println!("largest difference from fdm simulate: {worst:.1e}");
    assert!(worst < 1e-9, "{worst:e}");
    assert_eq!(two.set(c, y, 1.0), 3, "an output cannot be set");
    let free: unsafe extern "C" fn(Environment) = two.of("fmi2FreeInstance");
    // SAFETY: an instance of this library, which nobody uses behind this
    unsafe { free(c) };
}

static ORDER: c_int = 1;

/// `cargo install` copies the program alone.
#[test]
fn a_program_far_from_its_library_finds_it_where_both_were_built() {
    let desk = desk();
    let program = desk.path("installed");
    fs::copy(support::fdm().get_program(), &program).unwrap();
    let mut command = Command::new(&program);
    let words = "export m.fdm --set zeta=0.5 --to fmu -o m.fmu";
    let done = command.args(words.split(' ')).current_dir(desk.folder()).output().unwrap();
    assert!(done.status.success(), "{}", said(&done));
    assert!(fs::metadata(desk.path("m.fmu")).unwrap().len() > 100_000);
}
