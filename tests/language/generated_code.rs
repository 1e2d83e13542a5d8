//! Generated C and Rust, compiled by the system's compilers without this project, give the bits of the tape.

#![allow(unsafe_code, reason = "what was compiled is loaded into this process")]
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "figures, and a loud word when nothing could be tested")]

use fdm::Model;
use fdm::code::Tape;
use fdm::dynamics::{Dynamics, Point, Workspace};
use fdm_grammar::emit::{Elementary, Language, stand_alone};
use fdm_grammar::{Layout, Pattern, math};
use libloading::Library;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Points at which each model is compared.
const POINTS: u64 = 7;
/// One of them, where nobody would go.
const FAR: u64 = POINTS - 1;
/// Models that nobody would write.
const RANDOM: usize = 8;

/// Every operation of the language, choices at their edges.
const FUNCTIONS: &str = r#"
model every_function "a back\slash, */ ??/ ä" {
  input a, b;
  state x, y = 0.5 "a state /* odd */";
  param p = 0.3, q = 1.7 in [0.1, 10.0], n = 2.5, kept = 3 fixed;
  let z = if x < y and not (a >= b) then sin(p*x) + cos(q*y) else if x == y or a != b then tan(p*a) else -x;
  der(x) = z + min(x, q*a) - max(y, p*b) + abs(a)*sign(b) + tanh(q*x) + atan2(y, p + x^2) + kept;
  der(y) = exp(-q*x^2) + log(1 + q*y^2) + log10(2 + y^2) + sqrt(1 + x^2) + hypot(x, p*y) + sinh(0.1*x) + cosh(p*y);
  output one = abs(x)^n + q^y + (x^3 - 2*x^2)/q, two = asin(tanh(p*x)) + acos(tanh(q*y)) + atan(p*y)*t;
}
"#;

const DELAYED: &str = "
model late_feedback {
  input u;
  state x = x0, y = free;
  param x0 = 0.2 per run, k = 1.3, tau = 0.4 in [0, 2], lag = 0.1, kept = 0.7 fixed;
  param twice = 2*k;
  let feedback = delay(x*y + u*t, tau);
  der(x) = -k*feedback + delay(x, tau + lag)^2;
  der(y) = delay(feedback, lag) - kept*y*delay(y, 0.25);
  output one = x, two = delay(y, tau)*x + u*twice;
}";

/// Tables of several arguments in every method.
const SURFACES: &str = "
model surfaces {
  input a, b;
  state x, y = 0.3;
  param k = 0.7, c = -0.2;
  table C(p, q) = linear { p: [-1, -0.2, 0.3, 1], q: [-2, 0, 1.5],
    C: [[0.1, k, 2], [1, k*c, -0.3], [c, 0.4, 1], [2, 0, k]] };
  table D(p, q) = cubic { p: [-1, -0.2, 0.3, 1], q: [-2, 0, 1.5, 2], D: free 0.3 };
  table E(p, q, r) = pchip { p: [-1, 0.3, 1], q: [-2, 0.1], r: [0, 1],
    E: [[[0.1, 0.9], [k, 2]], [[1, k], [c, -0.3]], [[c, 0.2], [0.4, 1]]] };
  der(x) = C(x, a) - k*x*D(x - y, b);
  der(y) = E(y, x, a*b) - y + c*b;
  output one = C(a, b) + D(x, y), two = E(x, y, k*b);
}";

/// Long enough to be cut into several functions.
fn long() -> String {
    let n = 14;
    let mut text = String::from("model long { input u; param k = 0.3, c = 0.1;\n");
    (0..n).for_each(|i| text += &format!("state x{i} = 0.1*k; param a{i} = 0.{i}1;\n"));
    for i in 0..n {
        let terms: Vec<String> = (0..n).map(|j| format!("a{j}*sin(x{j} - x{i})*x{i}")).collect();
        text += &format!("der(x{i}) = u - c*x{i} + {};\noutput y{i} = x{i}*exp(-k*x{i}) + t;\n", terms.join(" + "));
    }
    text + "}"
}

/// A model that nobody would write: every operation on every leaf, choices in choices.
fn random(seed: u64) -> String {
    let mut noise = Noise(seed.wrapping_mul(0x5851_F42D_4C95_7F2D) + 1);
    let mut text = String::from(
        "model random { input u, v; state x = a/3, y = free, z; param a = 0.7, b = -1.3, c = 2.1, tau = 0.3, late = 0.2;\n",
    );
    (0..6).for_each(|k| text += &format!("let e{k} = {};\n", expression(&mut noise, k, 3)));
    for (k, state) in ["x", "y", "z"].into_iter().enumerate() {
        text += &format!(
            "der({state}) = e{k} + {};\noutput o{k} = {};\n",
            expression(&mut noise, 6, 2),
            expression(&mut noise, 6, 2)
        );
    }
    text + "}"
}

/// An expression of bounded depth that may use the first `defined` of `e0`, `e1`, ...
fn expression(noise: &mut Noise, defined: usize, depth: usize) -> String {
    const LEAVES: &[&str] =
        &["x", "y", "z", "u", "v", "a", "b", "c", "t", "delay(u, tau)", "delay(x*v, late)", "1.5", "-0.25", "3"];
    const ONE: &[&str] = &[
        "sin", "cos", "tan", "atan", "sinh", "cosh", "tanh", "exp", "log", "log10", "sqrt", "abs", "sign", "asin",
        "acos", "-",
    ];
    const TWO: &[&str] = &["+", "-", "*", "/", "^"];
    const CALLS: &[&str] = &["min", "max", "atan2", "hypot"];
    const SIGNS: &[&str] = &["<", "<=", ">", ">=", "==", "!="];
    fn pick<'a>(noise: &mut Noise, from: &[&'a str]) -> &'a str {
        from[noise.below(from.len())]
    }
    if depth == 0 || noise.below(5) == 0 {
        return match noise.below(3) {
            0 if defined > 0 => format!("e{}", noise.below(defined)),
            _ => pick(noise, LEAVES).into(),
        };
    }
    let part = |noise: &mut Noise| expression(noise, defined, depth - 1);
    match noise.below(8) {
        0 | 1 => format!("{}({})", pick(noise, ONE), part(noise)),
        2..=4 => format!("({}) {} ({})", part(noise), pick(noise, TWO), part(noise)),
        5 => format!("{}({}, {})", pick(noise, CALLS), part(noise), part(noise)),
        6 => format!(
            "(if {} {} {} then {} else {})",
            part(noise),
            pick(noise, SIGNS),
            part(noise),
            part(noise),
            part(noise)
        ),
        _ => format!("clip({}, -1, {})", part(noise), part(noise)),
    }
}

/// The models of the project, and what no reference model has.
fn models() -> Vec<(String, Model)> {
    let root = support::repository().join("models");
    let mut files = Vec::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).expect("models").map(|e| e.expect("entry").path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "fdm") && !path.ends_with("effects.fdm") {
                // a catalogue of effects is no model
                files.push(path);
            }
        }
    }
    files.sort();
    let named = |path: &PathBuf| {
        let name = path.strip_prefix(&root).expect("below").display().to_string();
        (name, Model::from_file(path).unwrap_or_else(|e| panic!("{e}")))
    };
    let mut models: Vec<(String, Model)> = files.iter().map(named).collect();
    assert!(models.len() > 50, "{} models", models.len());
    for (name, text) in [("functions", FUNCTIONS), ("delayed", DELAYED), ("surfaces", SURFACES), ("long", &long())] {
        models.push((name.into(), Model::from_text(name, text).unwrap_or_else(|e| panic!("{e}"))));
    }
    // some are refused: a number in them is infinite, say
    let made_up =
        (0..).filter_map(|seed| Some((format!("random {seed}"), Model::from_text("random", random(seed)).ok()?)));
    models.extend(made_up.take(RANDOM));
    models
}

/// Numbers between -1 and 1 (splitmix64).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        f64::from(u32::try_from((z ^ (z >> 31)) >> 32).expect("32 bits")) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    fn below(&mut self, count: usize) -> usize {
        ((self.next() + 1.0) / 2.0 * count as f64).min(count as f64 - 1.0) as usize
    }

    fn numbers(&mut self, count: usize) -> Vec<f64> {
        std::iter::repeat_with(|| self.next()).take(count).collect()
    }

    /// Far from everything: overflows, infinities, NaN.
    fn far(&mut self, values: &[f64]) -> Vec<f64> {
        values.iter().map(|v| (v + 1.0) * 1e3 * self.next()).collect()
    }

    /// Near the given values, and not zero.
    fn around(&mut self, values: &[f64]) -> Vec<f64> {
        values.iter().map(|v| v + (0.2 * v.abs() + 0.01) * self.next()).collect()
    }
}

/// Where a model is looked at.
struct Site {
    theta: Vec<f64>,
    t: f64,
    x: Vec<f64>,
    drive: Vec<f64>,
    s: Vec<f64>,
    s_delayed: Vec<f64>,
}

impl Site {
    fn new(model: &Model, seed: u64) -> Self {
        let (layout, mut noise) = (model.layout(), Noise(seed));
        let theta = noise.around(&model.definition().start());
        let mut known = vec![0.0; layout.known];
        model.dynamics().prepare(&theta, &mut known, &mut Workspace::new(model.dynamics()));
        let p = layout.params;
        Self {
            t: 3.0 + noise.next(),
            x: match seed {
                FAR => noise.far(&known[layout.initial.clone()]),
                _ => noise.around(&known[layout.initial.clone()]),
            },
            drive: noise.numbers(layout.drive()),
            s: noise.numbers(layout.states * p),
            s_delayed: noise.numbers(layout.delayed.len() * p),
            theta,
        }
    }
}

/// Names of the arrays that a model computes, each with its numbers.
type Numbers = Vec<(&'static str, Vec<f64>)>;

/// What the tape says, in the order of [`calls`].
fn expected(model: &Model, site: &Site) -> Numbers {
    let tape = Tape::new(model.schedule());
    let layout = model.layout();
    let (p, work) = (&layout.patterns, &mut Workspace::new(&tape));
    let (n, q) = (layout.states, layout.outputs);
    let mut known = vec![0.0; layout.known];
    tape.prepare(&site.theta, &mut known, work);
    let at = Point { t: site.t, x: &site.x, drive: &site.drive, known: &known };
    let mut row = vec![0.0; layout.rate_slots()];
    tape.rates_and_partials(at, &mut row, work);
    let f_x: Vec<f64> = layout.stage.by_state.iter().map(|slot| row[*slot as usize]).collect();
    let f_delayed = row[layout.stage.by_delayed..][..p.rates_by_delayed.len()].to_vec();
    let lane = |(_, i, j)| row[layout.stage.by_param(i, j).expect("no parameter is fixed")];
    let f_theta: Vec<f64> = p.rates_by_param.entries().map(lane).collect();
    let mut f = vec![0.0; n];
    tape.rates(at, &mut f, work);
    let mut out = vec![0.0; layout.output_slots()];
    tape.outputs_and_partials(at, &mut out, work);
    let mut y = vec![0.0; q];
    tape.outputs(at, &mut y, work);
    let mut inputs = vec![0.0; layout.input_slots()];
    tape.by_input(at, &mut inputs, work);
    let (y_x, rest) = out[q..].split_at(p.outputs_by_state.len());
    let (y_delayed, y_theta) = rest.split_at(p.outputs_by_delayed.len());
    let (f_u, y_u) = inputs.split_at(p.rates_by_input.len());
    let s0 = dense(layout, n, &p.initial_by_param, &known[layout.initial_by_param.clone()]);
    let mut s_rate = dense(layout, n, &p.rates_by_param, &f_theta);
    chain(layout, &p.rates_by_state, &f_x, &site.s, &mut s_rate);
    chain(layout, &p.rates_by_delayed, &f_delayed, &site.s_delayed, &mut s_rate);
    let mut by_theta = dense(layout, q, &p.outputs_by_param, y_theta);
    chain(layout, &p.outputs_by_state, y_x, &site.s, &mut by_theta);
    chain(layout, &p.outputs_by_delayed, y_delayed, &site.s_delayed, &mut by_theta);
    vec![
        ("known", known.clone()),
        ("f", f.clone()),
        ("f", f.clone()),
        ("f_x", f_x.clone()),
        ("f_delayed", f_delayed.clone()),
        ("f_theta", f_theta.clone()),
        ("y", y.clone()),
        ("y", y.clone()),
        ("y_x", y_x.to_vec()),
        ("y_delayed", y_delayed.to_vec()),
        ("y_theta", y_theta.to_vec()),
        ("f_u", f_u.to_vec()),
        ("y_u", y_u.to_vec()),
        ("x0", known[layout.initial.clone()].to_vec()),
        ("x0_theta", s0),
        ("f", f),
        ("f_x", f_x),
        ("f_delayed", f_delayed),
        ("f_theta", f_theta),
        ("S_rate", s_rate),
        ("y", y),
        ("y_x", y_x.to_vec()),
        ("y_delayed", y_delayed.to_vec()),
        ("y_theta", y_theta.to_vec()),
        ("Y", by_theta),
    ]
}

fn dense(layout: &Layout, rows: usize, pattern: &Pattern, entries: &[f64]) -> Vec<f64> {
    let mut matrix = vec![0.0; rows * layout.params];
    pattern.entries().for_each(|(k, i, j)| matrix[i * layout.params + j] = entries[k]);
    matrix
}

fn chain(layout: &Layout, pattern: &Pattern, entries: &[f64], s: &[f64], out: &mut [f64]) {
    let p = layout.params;
    for (k, i, l) in pattern.entries() {
        (0..p).for_each(|j| out[i * p + j] += entries[k] * s[l * p + j]);
    }
}

/// All functions of a generated file behind one: which, time, what is read, what is written.
type Call = unsafe extern "C" fn(i32, f64, *const *const f64, *const *mut f64);

/// The names of what each function writes, as in [`expected`].
const WRITES: [usize; 9] = [1, 1, 4, 1, 4, 2, 2, 5, 5];

/// What compiled code says.
fn found(call: Call, site: &Site, shape: &Numbers) -> Numbers {
    let mut found: Numbers = shape.iter().map(|(name, v)| (*name, vec![f64::NAN; v.len().max(1)])).collect();
    let mut first = 0;
    for (which, count) in WRITES.iter().enumerate() {
        let (before, written) = found.split_at_mut(first);
        let known = before.first().map_or(&[][..], |(_, known)| known);
        let reads = match which {
            0 => vec![site.theta.as_ptr()],
            6 => vec![known.as_ptr()],
            _ => [&site.x, &site.drive, known, &site.s, &site.s_delayed].map(<[f64]>::as_ptr).to_vec(),
        };
        let writes: Vec<*mut f64> = written[..*count].iter_mut().map(|(_, v)| v.as_mut_ptr()).collect();
        // SAFETY: arrays have the lengths of the layout from which the code was generated.
        unsafe { call(which as i32, site.t, reads.as_ptr(), writes.as_ptr()) };
        first += count;
    }
    found.iter_mut().zip(shape).for_each(|((_, v), (_, s))| v.truncate(s.len()));
    found
}

/// Bits in which every NaN is one: which NaN an operation returns, IEEE leaves open.
fn bits(numbers: &[f64]) -> Vec<u64> {
    numbers.iter().map(|x| if x.is_nan() { f64::NAN } else { *x }.to_bits()).collect()
}

/// Fails with the first number that differs.
fn same(name: &str, by: &str, wanted: &Numbers, found: &Numbers) {
    for ((array, wanted), (_, found)) in wanted.iter().zip(found) {
        for (k, (w, f)) in bits(wanted).into_iter().zip(bits(found)).enumerate() {
            assert!(w == f, "{name} by {by}: {array}[{k}] is {:e}, not {:e}", f64::from_bits(f), f64::from_bits(w));
        }
    }
}

macro_rules! elementary {
    ($($name:ident($($x:ident),*);)*) => {
        /// The project's elementary functions, for code that was compiled without the project.
        #[repr(C)]
        struct Table { $($name: extern "C" fn($($x: elementary!(@f64 $x)),*) -> f64,)* }

        impl Table {
            const PROJECT: Self = Self {
                $($name: { extern "C" fn $name($($x: f64),*) -> f64 { math::$name($($x),*) } $name },)*
            };

            /// The names, and how many numbers each takes.
            const NAMES: &[(&str, usize)] = &[$((stringify!($name), [$(stringify!($x)),*].len())),*];
        }
    };
    (@f64 $x:ident) => { f64 };
}

elementary! {
    sin(x); cos(x); tan(x); asin(x); acos(x); atan(x); atan2(y, x); sinh(x); cosh(x); tanh(x);
    exp(x); log(x); log10(x); pow(x, y); hypot(x, y); sqrt(x);
}

/// Pointers that `bind` fills, and macros that call through them.
fn c_header() -> String {
    let mut text = String::from("#ifndef BOUND\n#define BOUND\nstruct table {\n");
    for (name, arity) in Table::NAMES {
        text += &format!("    double (*{name})({});\n", ["double", "double, double"][arity - 1]);
    }
    text += "};\nextern struct table bound;\nvoid bind_table(const struct table *functions);\n";
    for (name, _) in Table::NAMES {
        text += &format!("#define fdm_{name} bound.{name}\n");
    }
    text + "#endif\n"
}

const C_CALLS: &str = r"
#define CALLS(M) \
    void call_##M(int which, double t, const double *const *in, double *const *out); \
    void call_##M(int which, double t, const double *const *in, double *const *out) \
    { \
        switch (which) { \
        case 0: M##_prepare(in[0], out[0]); break; \
        case 1: M##_rates(t, in[0], in[1], in[2], out[0]); break; \
        case 2: M##_rates_and_partials(t, in[0], in[1], in[2], out[0], out[1], out[2], out[3]); break; \
        case 3: M##_outputs(t, in[0], in[1], in[2], out[0]); break; \
        case 4: M##_outputs_and_partials(t, in[0], in[1], in[2], out[0], out[1], out[2], out[3]); break; \
        case 5: M##_by_input(t, in[0], in[1], in[2], out[0], out[1]); break; \
        case 6: M##_initial(in[0], out[0], out[1]); break; \
        case 7: M##_sensitivity_rates(t, in[0], in[1], in[2], in[3], in[4], out[0], out[1], out[2], out[3], out[4]); break; \
        default: M##_output_sensitivities(t, in[0], in[1], in[2], in[3], in[4], out[0], out[1], out[2], out[3], out[4]); \
        } \
    }
";

/// The root of a crate that is `libm` to the modules in it, by functions that are handed in.
fn rust_root(models: usize) -> String {
    let mut text = String::from("extern crate self as libm;\n#[repr(C)]\n#[derive(Clone, Copy)]\npub struct Table {\n");
    let types = |arity: usize| ["f64", "f64, f64"][arity - 1];
    for (name, arity) in Table::NAMES {
        text += &format!("    {name}: extern \"C\" fn({}) -> f64,\n", types(*arity));
    }
    text += "}\nstatic BOUND: std::sync::OnceLock<Table> = std::sync::OnceLock::new();\n\
             #[unsafe(no_mangle)]\npub extern \"C\" fn bind_table(t: &Table) { BOUND.set(*t).ok(); }\n";
    for (name, arity) in Table::NAMES {
        let (declared, passed) = [("x: f64", "x"), ("x: f64, y: f64", "x, y")][arity - 1];
        text += &format!("pub fn {name}({declared}) -> f64 {{ (BOUND.get().unwrap().{name})({passed}) }}\n");
    }
    text += RUST_CALLS;
    (0..models).for_each(|k| text += &format!("pub mod m{k};\ncalls!(m{k}, call_m{k});\n"));
    text
}

const RUST_CALLS: &str = r#"
macro_rules! calls {
    ($m:ident, $call:ident) => {
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $call(which: i32, t: f64, reads: *const *const f64, writes: *const *mut f64) {
            let (i, o) = (|k: usize| unsafe { *reads.add(k) }, |k: usize| unsafe { *writes.add(k) });
            macro_rules! a { ($p:expr) => { unsafe { &*$p.cast() } } }
            macro_rules! w { ($p:expr) => { unsafe { &mut *$p.cast() } } }
            match which {
                0 => $m::prepare(a!(i(0)), w!(o(0))),
                1 => $m::rates(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0))),
                2 => $m::rates_and_partials(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0)), w!(o(1)), w!(o(2)), w!(o(3))),
                3 => $m::outputs(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0))),
                4 => $m::outputs_and_partials(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0)), w!(o(1)), w!(o(2)), w!(o(3))),
                5 => $m::by_input(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0)), w!(o(1))),
                6 => $m::initial(a!(i(0)), w!(o(0)), w!(o(1))),
                7 => $m::sensitivity_rates(t, a!(i(0)), a!(i(1)), a!(i(2)), a!(i(3)), a!(i(4)), w!(o(0)), w!(o(1)), w!(o(2)), w!(o(3)), w!(o(4))),
                _ => $m::output_sensitivities(t, a!(i(0)), a!(i(1)), a!(i(2)), a!(i(3)), a!(i(4)), w!(o(0)), w!(o(1)), w!(o(2)), w!(o(3)), w!(o(4))),
            }
        }
    };
}
"#;

/// The generated text of a model under the name `m{k}`: two models of the project may have the same one.
fn generated(model: &Model, k: usize, language: &Language) -> String {
    let mut definition = model.definition().clone();
    definition.name = format!("m{k}");
    stand_alone(&definition, model.schedule(), language).expect("short enough")
}

/// Runs a compiler; what it says is an error.
fn compiled(command: &mut Command) {
    let started = std::time::Instant::now();
    let told = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let said = String::from_utf8_lossy(&told.stderr);
    assert!(told.status.success() && said.is_empty(), "{command:?}\n{said}");
    println!("{:?} took {:.1} s", command.get_program(), started.elapsed().as_secs_f64());
}

fn load(library: &Path, bind: bool) -> Library {
    // SAFETY: it was made from generated code, which has no initialisers.
    let library = unsafe { Library::new(library) }.expect("a library that was compiled just now");
    if bind {
        // SAFETY: `bind` copies the table.
        let bind: libloading::Symbol<'_, unsafe extern "C" fn(&Table)> =
            unsafe { library.get(b"bind_table") }.expect("bind");
        unsafe { bind(&Table::PROJECT) };
    }
    library
}

fn call(library: &Library, k: usize) -> Call {
    // SAFETY: the type of every such function.
    *unsafe { library.get(format!("call_m{k}").as_bytes()) }.expect("the function of a model")
}

/// The C compiler's name: what `CC` says, or `cc`, which linking Rust needs anyway.
fn c_compiler() -> Option<String> {
    let name = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    Command::new(&name).arg("--version").output().is_ok_and(|o| o.status.success()).then_some(name)
}

/// One translation unit of the chosen models, made by the strictest of compilers.
fn c_library(cc: &str, folder: &Path, models: &[usize], bound: bool) -> Library {
    let (table, name) =
        ("struct table bound;\nvoid bind_table(const struct table *t)\n{\n    bound = *t;\n}\n", ["system", "bound"]);
    let name = name[usize::from(bound)];
    let mut text = if bound { format!("#include \"elementary.h\"\n{table}") } else { String::new() };
    models.iter().for_each(|k| text += &format!("#include \"m{k}.c\"\n"));
    text += C_CALLS;
    models.iter().for_each(|k| text += &format!("CALLS(m{k})\n"));
    fs::write(folder.join(format!("{name}.c")), text).expect("file");
    let mut command = Command::new(cc);
    command.current_dir(folder).args([
        "-O2",
        "-std=c99",
        "-pedantic",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-shared",
        "-fPIC",
    ]);
    command.args(bound.then_some("-DFDM_ELEMENTARY=\"elementary.h\""));
    compiled(command.arg(format!("{name}.c")).args(["-o", &format!("{name}.so"), "-lm"]));
    load(&folder.join(format!("{name}.so")), bound)
}

#[test]
fn c_has_the_bits_of_the_tape() {
    let Some(cc) = c_compiler() else {
        eprintln!("SKIPPED: NO C COMPILER. Nothing is known about the generated C.");
        return;
    };
    let (models, folder) = (models(), tempfile::tempdir().expect("folder"));
    let mut calling = Vec::new();
    for (k, (name, model)) in models.iter().enumerate() {
        let text = generated(model, k, &Language::C);
        let cut = text.contains(&format!("m{k}_rates_and_partials_1("));
        assert!(cut || name != "long", "no model is long enough to be cut into several functions");
        // what calls no elementary function does not see which are bound
        calling.extend(text.contains("#define fdm_").then_some(k));
        fs::write(folder.path().join(format!("m{k}.c")), text).expect("file");
    }
    fs::write(folder.path().join("elementary.h"), c_header()).expect("file");
    let bound = c_library(&cc, folder.path(), &(0..models.len()).collect::<Vec<_>>(), true);
    let system = c_library(&cc, folder.path(), &calling, false);
    for (k, (name, model)) in models.iter().enumerate() {
        let mut worst: f64 = 0.0;
        for seed in 0..POINTS {
            let site = Site::new(model, seed);
            let wanted = expected(model, &site);
            same(name, "C", &wanted, &found(call(&bound, k), &site, &wanted));
            if calling.contains(&k) && seed != FAR {
                worst = worst.max(apart(&wanted, &found(call(&system, k), &site, &wanted)));
            }
        }
        if calling.contains(&k) {
            println!("{name}: <math.h> is up to {worst:.1} units of the last place away");
            // what nobody would write may be as ill-conditioned as it likes
            assert!(
                worst < 100.0 || name.starts_with("random"),
                "{name}: <math.h> is {worst} units of the last place away"
            );
        }
    }
    println!("{} models, {} of them without elementary functions", models.len(), models.len() - calling.len());
}

/// The greatest difference in units of the last place of the array's largest number.
fn apart(wanted: &Numbers, found: &Numbers) -> f64 {
    let array = |(w, f): (&[f64], &[f64])| {
        let finite = || w.iter().zip(f).filter(|(w, f)| w.is_finite() && f.is_finite());
        let size = finite().map(|(w, _)| w.abs()).fold(f64::MIN_POSITIVE, f64::max);
        finite().map(|(w, f)| (w - f).abs()).fold(0.0, f64::max) / (size * f64::EPSILON)
    };
    let pairs = wanted.iter().zip(found).map(|((_, w), (_, f))| (&w[..], &f[..]));
    pairs.map(array).fold(0.0, f64::max)
}

#[test]
fn rust_has_the_bits_of_the_tape() {
    let (models, folder) = (models(), tempfile::tempdir().expect("folder"));
    let language = Language::Rust(Elementary::Path("libm".into()));
    for (k, (_, model)) in models.iter().enumerate() {
        fs::write(folder.path().join(format!("m{k}.rs")), generated(model, k, &language)).expect("file");
    }
    fs::write(folder.path().join("lib.rs"), rust_root(models.len())).expect("file");
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    let mut command = Command::new(rustc);
    command.current_dir(folder.path()).args([
        "--edition",
        "2024",
        "--crate-type",
        "cdylib",
        "-C",
        "opt-level=1",
        "-D",
        "warnings",
    ]);
    compiled(command.args(["-A", "dead_code", "lib.rs", "-o", "models.so"]));
    let library = load(&folder.path().join("models.so"), true);
    for (k, (name, model)) in models.iter().enumerate() {
        for seed in 0..POINTS {
            let site = Site::new(model, seed);
            let wanted = expected(model, &site);
            same(name, "Rust", &wanted, &found(call(&library, k), &site, &wanted));
        }
    }
}
