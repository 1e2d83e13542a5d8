//! Generated source, compiled here and loaded.

#![allow(unsafe_code, reason = "what was compiled is loaded into this process")]

use super::VerifyError;
use super::{Numbers, Site};
use crate::fmu::Files;
use fdm_grammar::emit::c_name;
use fdm_system::Model;
use libloading::Library;
use std::path::Path;
use std::process::Command;

/// All functions of a file behind one: which, time, what is read, what is written.
type Call = unsafe extern "C" fn(i32, f64, *const *const f64, *const *mut f64);

/// Its name in the library.
const CALL: &str = "fdm_verified_call";

/// How many arrays each function writes, in the order of [`Site::expected`]: of parameters; of rates, without and with
/// partials; of outputs, the same; and partials by inputs.
const WRITES: [usize; 6] = [1, 1, 4, 1, 4, 2];

/// The source, and a function that calls its functions.
pub(super) fn c_files(model: &Model, text: &str) -> Files {
    let p = prefix_of(model, text, "_DECLARED");
    let calls = format!(
        "#include \"model.c\"
void {CALL}(int which, double t, const double *const *in, double *const *out);
void {CALL}(int which, double t, const double *const *in, double *const *out)
{{
    switch (which) {{
    case 0: {p}_prepare(in[0], out[0]); break;
    case 1: {p}_rates(t, in[0], in[1], in[2], out[0]); break;
    case 2: {p}_rates_and_partials(t, in[0], in[1], in[2], out[0], out[1], out[2], out[3]); break;
    case 3: {p}_outputs(t, in[0], in[1], in[2], out[0]); break;
    case 4: {p}_outputs_and_partials(t, in[0], in[1], in[2], out[0], out[1], out[2], out[3]); break;
    default: {p}_by_input(t, in[0], in[1], in[2], out[0], out[1]);
    }}
}}
"
    );
    vec![("model.c".into(), text.as_bytes().to_vec()), ("calls.c".into(), calls.into_bytes())]
}

/// The prefix that a file itself uses, in front of the name that guards its declarations.
pub(super) fn prefix_of(model: &Model, text: &str, guard: &str) -> String {
    let marked = text.lines().find_map(|l| l.trim().strip_prefix("#define ")?.strip_suffix(guard));
    marked.map_or_else(|| c_name(model.name()), str::to_string)
}

/// The elementary functions by the methods of `f64`, where the file asks for a module.
const METHODS: &str = "
    pub fn sin(x: f64) -> f64 { x.sin() } pub fn cos(x: f64) -> f64 { x.cos() } pub fn tan(x: f64) -> f64 { x.tan() }
    pub fn asin(x: f64) -> f64 { x.asin() } pub fn acos(x: f64) -> f64 { x.acos() } pub fn atan(x: f64) -> f64 { x.atan() }
    pub fn atan2(y: f64, x: f64) -> f64 { y.atan2(x) } pub fn sinh(x: f64) -> f64 { x.sinh() }
    pub fn cosh(x: f64) -> f64 { x.cosh() } pub fn tanh(x: f64) -> f64 { x.tanh() } pub fn exp(x: f64) -> f64 { x.exp() }
    pub fn log(x: f64) -> f64 { x.ln() } pub fn log10(x: f64) -> f64 { x.log10() } pub fn sqrt(x: f64) -> f64 { x.sqrt() }
    pub fn pow(x: f64, y: f64) -> f64 { x.powf(y) } pub fn hypot(x: f64, y: f64) -> f64 { x.hypot(y) }
";

/// What is compiled to verify generated Rust.
pub(super) fn rust_files(text: &str) -> Files {
    // whatever module it asks for, the system's functions stand in
    let line = text.lines().find(|line| line.starts_with("use ") && line.ends_with(" as elementary;"));
    let text = line.map_or(text.to_string(), |line| text.replace(line, "use super::methods as elementary;"));
    let root = format!(
        "#[allow(dead_code)] mod methods {{{METHODS}}}
#[allow(dead_code)] mod model;
#[unsafe(no_mangle)]
pub unsafe extern \"C\" fn {CALL}(which: i32, t: f64, reads: *const *const f64, writes: *const *mut f64) {{
    let (i, o) = (|k: usize| unsafe {{ *reads.add(k) }}, |k: usize| unsafe {{ *writes.add(k) }});
    macro_rules! a {{ ($p:expr) => {{ unsafe {{ &*$p.cast() }} }} }}
    macro_rules! w {{ ($p:expr) => {{ unsafe {{ &mut *$p.cast() }} }} }}
    match which {{
        0 => model::prepare(a!(i(0)), w!(o(0))),
        1 => model::rates(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0))),
        2 => model::rates_and_partials(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0)), w!(o(1)), w!(o(2)), w!(o(3))),
        3 => model::outputs(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0))),
        4 => model::outputs_and_partials(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0)), w!(o(1)), w!(o(2)), w!(o(3))),
        _ => model::by_input(t, a!(i(0)), a!(i(1)), a!(i(2)), w!(o(0)), w!(o(1))),
    }}
}}
"
    );
    vec![("model.rs".into(), text.into_bytes()), ("root.rs".into(), root.into_bytes())]
}

const LIBRARY: &str = "verified.lib";

pub(super) fn c_library(folder: &Path) -> Result<Library, VerifyError> {
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    let mut command = Command::new(&compiler);
    command.args(["-std=c99", "-O1", "-ffp-contract=off", "-fPIC", "-shared", "-o", LIBRARY, "calls.c", "-lm"]);
    compile(command, compiler, folder)
}

pub(super) fn rust_library(folder: &Path) -> Result<Library, VerifyError> {
    let compiler = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    let mut command = Command::new(&compiler);
    command.args([
        "--edition=2024",
        "--crate-type=cdylib",
        "-Copt-level=1",
        "-Cpanic=abort",
        "-Awarnings",
        "-o",
        LIBRARY,
        "root.rs",
    ]);
    compile(command, compiler, folder)
}

fn compile(mut command: Command, compiler: String, folder: &Path) -> Result<Library, VerifyError> {
    let Ok(told) = command.current_dir(folder).output() else { return Err(VerifyError::NoCompiler(compiler)) };
    if !told.status.success() {
        let said = String::from_utf8_lossy(&told.stderr);
        let said = said.lines().find(|l| l.contains("error")).or(said.lines().next()).unwrap_or_default().to_string();
        return Err(VerifyError::Refused { compiler, said });
    }
    // SAFETY: it was compiled just now from generated functions, which have no initialisers
    Ok(unsafe { Library::new(folder.join(LIBRARY)) }?)
}

/// What the compiled functions say.
pub(super) fn numbers(library: &Library, site: &Site, shape: &Numbers) -> Result<Numbers, VerifyError> {
    // SAFETY: its type is that of the source above
    let call = unsafe { library.get::<Call>(CALL.as_bytes()) }?;
    // an array of nothing still has an address
    let mut found: Numbers = shape.iter().map(|(name, v)| (*name, vec![f64::NAN; v.len().max(1)])).collect();
    let mut first = 0;
    for (which, count) in WRITES.iter().enumerate() {
        let (before, written) = found.split_at_mut(first);
        let known = before.first().map_or(&[][..], |(_, known)| known);
        let reads = match which {
            0 => vec![site.theta.as_ptr()],
            _ => [&site.x[..], &site.drive, known].map(<[f64]>::as_ptr).to_vec(),
        };
        let writes: Vec<*mut f64> = written[..*count].iter_mut().map(|(_, v)| v.as_mut_ptr()).collect();
        // SAFETY: the stamp says that the source is of this model, and so arrays have the lengths of its layout
        unsafe { call(which as i32, site.t, reads.as_ptr(), writes.as_ptr()) };
        first += count;
    }
    found.iter_mut().zip(shape).for_each(|((_, v), (_, s))| v.truncate(s.len()));
    Ok(found)
}
