//! `fdm export` and `fdm verify`: units, source and matrices as a user writes them, and a unit's library as a simulator calls it.

#![allow(unsafe_code, reason = "a unit's library is loaded and called, as a simulator does")]

use fdm::Model;
use fdm_exchange::Stamp;
use fdm_exchange::fmu::{Kind, Variables, Version};
use fdm_exchange::verify::Artefact;
use libloading::Library;
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::fs;
use std::path::PathBuf;
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
