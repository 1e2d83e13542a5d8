//! Models that fit the grammar, written in C: what the system's compiler makes of them gives the bits of the tape.
//! Slow, for each input is compiled.
#![no_main]

use arbitrary::Unstructured;
use fdm::code::{Engine, compile};
use fdm::dynamics::{Dynamics, Point, Workspace};
use fdm_fuzz::{bits, numbers};
use fdm_grammar::emit::{Language, stand_alone};
use fdm_grammar::math;
use libfuzzer_sys::fuzz_target;
use libloading::Library;
use std::process::Command;

/// Longest text that is compiled: one input is not to take all the time.
const LONGEST: usize = 60_000;

macro_rules! elementary {
    ($($name:ident($($x:ident),*);)*) => {
        /// The project's elementary functions for code that does not know the project.
        #[repr(C)]
        struct Table { $($name: extern "C" fn($($x: elementary!(@f64 $x)),*) -> f64,)* }

        const PROJECT: Table = Table {
            $($name: { extern "C" fn $name($($x: f64),*) -> f64 { math::$name($($x),*) } $name },)*
        };

        /// What makes the generated code call through the table.
        fn header() -> String {
            let mut text = String::from("#ifndef BOUND\n#define BOUND\nstruct table {\n");
            $(text += concat!("double (*", stringify!($name), ")(", elementary!(@c $($x)*), ");\n");)*
            text += "};\nextern struct table bound;\n";
            $(text += concat!("#define fdm_", stringify!($name), " bound.", stringify!($name), "\n");)*
            text + "#endif\n"
        }
    };
    (@f64 $x:ident) => { f64 };
    (@c $x:ident) => { "double" };
    (@c $x:ident $y:ident) => { "double, double" };
}

elementary! {
    sin(x); cos(x); tan(x); asin(x); acos(x); atan(x); atan2(y, x); sinh(x); cosh(x); tanh(x);
    exp(x); log(x); log10(x); pow(x, y); hypot(x, y); sqrt(x);
}

const AROUND: &str = "#include \"elementary.h\"\n#define FDM_ELEMENTARY \"elementary.h\"\n#include \"m.c\"\n\
    struct table bound;\nvoid bind_table(const struct table *t) { bound = *t; }\n\
    void call_prepare(const double *theta, double *known) { m_prepare(theta, known); }\n\
    void call_rates(double t, const double *x, const double *drive, const double *known, double *const *out)\n\
    { m_rates_and_partials(t, x, drive, known, out[0], out[1], out[2], out[3]); }\n\
    void call_outputs(double t, const double *x, const double *drive, const double *known, double *const *out)\n\
    { m_outputs_and_partials(t, x, drive, known, out[0], out[1], out[2], out[3]); }\n";

type Prepare = unsafe extern "C" fn(*const f64, *mut f64);
type Partials = unsafe extern "C" fn(f64, *const f64, *const f64, *const f64, *const *mut f64);

fuzz_target!(|data: &[u8]| {
    let Ok(model) = fdm_fuzz::Model::arbitrary(&mut Unstructured::new(data)) else { return };
    let text = model.text();
    let Some(compiled) = fdm_fuzz::compile(&text) else { return };
    let mut definition = compiled.model.clone();
    definition.name = "m".into();
    let Ok(written) = stand_alone(&definition, &compiled.schedule, &Language::C) else { return };
    if written.len() > LONGEST {
        return;
    }
    let tape = compile(&compiled.schedule, Engine::Tape);
    let (folder, library) = library(&written);
    let theta = compiled.model.start();
    for seed in 0..4 {
        let (wanted, found) = compared(&*tape, &library, &theta, seed);
        assert_eq!(wanted, found, "{text}");
    }
    drop((library, folder));
});

/// The generated text as a library of the system's compiler.
fn library(written: &str) -> (tempfile::TempDir, Library) {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("a file");
    write("m.c", written);
    write("elementary.h", &header());
    write("all.c", AROUND);
    let mut command = Command::new("cc");
    command.current_dir(folder.path()).args(["-O1", "-std=c99", "-w", "-shared", "-fPIC", "all.c", "-o", "all.so", "-lm"]);
    let told = command.output().expect("a C compiler");
    assert!(told.status.success(), "{}\n{written}", String::from_utf8_lossy(&told.stderr));
    // SAFETY: generated code has no initialisers.
    let library = unsafe { Library::new(folder.path().join("all.so")) }.expect("a library");
    // SAFETY: the function copies the table.
    unsafe {
        let bind: libloading::Symbol<'_, unsafe extern "C" fn(&Table)> = library.get(b"bind_table").expect("bind");
        bind(&PROJECT);
    }
    (folder, library)
}

/// What the tape and the library compute at a point.
fn compared(tape: &dyn Dynamics, library: &Library, theta: &[f64], seed: u64) -> (Vec<u64>, Vec<u64>) {
    let (layout, mut work) = (tape.layout(), Workspace::new(tape));
    let p = &layout.patterns;
    let mut known = vec![0.0; layout.known];
    tape.prepare(theta, &mut known, &mut work);
    let mut number = numbers(seed);
    let x: Vec<f64> = (0..layout.states).map(|_| number()).collect();
    let drive: Vec<f64> = (0..layout.drive()).map(|_| number()).collect();
    let t = number().abs();
    let at = Point { t, x: &x, drive: &drive, known: &known };
    let mut row = vec![0.0; layout.rate_slots()];
    tape.rates_and_partials(at, &mut row, &mut work);
    let mut wanted = known.clone();
    let mut rates = vec![0.0; layout.states];
    tape.rates(at, &mut rates, &mut work);
    wanted.extend(&rates);
    wanted.extend(layout.stage.by_state.iter().map(|slot| row[*slot as usize]));
    wanted.extend(&row[layout.stage.by_delayed..][..p.rates_by_delayed.len()]);
    wanted.extend(p.rates_by_param.entries().filter_map(|(_, i, j)| layout.stage.by_param(i, j).map(|slot| row[slot])));
    let mut outputs = vec![0.0; layout.output_slots()];
    tape.outputs_and_partials(at, &mut outputs, &mut work);
    wanted.extend(&outputs);

    let mut found = vec![f64::NAN; known.len().max(1)];
    // SAFETY: all arrays have the lengths of the layout from which the code was generated; empty ones are not touched.
    unsafe {
        let prepare: libloading::Symbol<'_, Prepare> = library.get(b"call_prepare").expect("prepare");
        prepare(theta.as_ptr(), found.as_mut_ptr());
        found.truncate(known.len());
        let rates = [layout.states, p.rates_by_state.len(), p.rates_by_delayed.len(), p.rates_by_param.len()];
        let outputs = [layout.outputs, p.outputs_by_state.len(), p.outputs_by_delayed.len(), p.outputs_by_param.len()];
        for (name, lengths) in [(&b"call_rates"[..], rates), (b"call_outputs", outputs)] {
            let partials: libloading::Symbol<'_, Partials> = library.get(name).expect("partials");
            let mut arrays = lengths.map(|n| vec![f64::NAN; n.max(1)]);
            let out = arrays.each_mut().map(|a| a.as_mut_ptr());
            partials(t, x.as_ptr(), drive.as_ptr(), known.as_ptr(), out.as_ptr());
            for (array, length) in arrays.iter().zip(lengths) {
                found.extend(&array[..length]);
            }
        }
    }
    (bits(&wanted), bits(&found))
}
