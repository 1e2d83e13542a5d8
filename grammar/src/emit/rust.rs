//! A model as one module of Rust: functions over arrays whose lengths are constants.

use super::entry::{Array, Body, Entry, entries, functions};
use super::notation::{Notation, RustNotation, is_exact};
use super::notation::{distinct, rust_string};
use super::tables::{described, groups, patterns, places, signals, sizes, title, unit};
use super::{Elementary, TooLong};
use crate::model::{Model, Param, Quantity};
use crate::schedule::Schedule;

const USAGE: &str = "\
//
// A module without dependencies but for the elementary functions: #[allow(dead_code)] #[rustfmt::skip] mod model; Every function reads and writes plain arrays:
//   t        time since the run began
//   x        states
//   drive    inputs, then delayed signals: values of their states or inputs at t - tau
//   known    what `prepare` made of the parameters theta; from KNOWN_X0 on initial values, from KNOWN_TAU on delays
// Jacobians hold structural nonzeros only, by rows: entry k of f_x stands at F_X_ROW[k], F_X_COLUMN[k].
// With the elementary functions of the crate `libm` the results have the same bits as those of fdm.

";

const NOTATION: RustNotation<'static> = RustNotation { elementary: "elementary::", exact: "" };

/// The whole file.
pub(super) fn file(model: &Model, schedule: &Schedule, elementary: &Elementary) -> Result<String, TooLong> {
    let mut text = String::new();
    title(model).iter().for_each(|line| text += &format!("{}\n", format!("// {line}").trim_end()));
    text += USAGE;
    text += &called(schedule, elementary);
    text += &tables(model, schedule);
    for entry in entries(schedule) {
        text += &function(&entry)?;
    }
    Ok(text + DENSE)
}

/// The elementary functions, and ours written out.
fn called(schedule: &Schedule, elementary: &Elementary) -> String {
    let names = functions(entries(schedule).map(|e| e.program));
    let transcendental: Vec<&str> = names.iter().copied().filter(|n| !is_exact(n)).collect();
    let mut text = match elementary {
        _ if transcendental.is_empty() => String::new(),
        Elementary::Path(path) => format!("use {path} as elementary;\n\n"),
        Elementary::Std => {
            let lines: String = transcendental.iter().map(|name| by_method(name)).collect();
            format!("mod elementary {{\n{lines}}}\n\n")
        }
    };
    for name in names.iter().filter(|n| is_exact(n)) {
        let (arguments, body) = match *name {
            "abs" => ("x: f64", "x.abs()"),
            "sign" => ("x: f64", "if x > 0.0 { 1.0 } else if x < 0.0 { -1.0 } else { x * 0.0 }"),
            "min" => ("a: f64, b: f64", "if a <= b { a } else if b < a { b } else { a + b }"),
            "max" => ("a: f64, b: f64", "if a >= b { a } else if b > a { b } else { a + b }"),
            "less" => ("a: f64, b: f64", "f64::from(u8::from(a < b))"),
            "less_equal" => ("a: f64, b: f64", "f64::from(u8::from(a <= b))"),
            "equal" => ("a: f64, b: f64", "f64::from(u8::from(a == b))"),
            _ => ("condition: f64, a: f64, b: f64", "if condition != 0.0 { a } else { b }"),
        };
        text += &format!("#[inline(always)]\nfn {name}({arguments}) -> f64 {{\n    {body}\n}}\n\n");
    }
    text
}

/// An elementary function by the method of `f64`.
fn by_method(name: &str) -> String {
    let (arguments, body) = match name {
        "log" => ("x: f64", "x.ln()".to_string()),
        "pow" => ("x: f64, y: f64", "x.powf(y)".to_string()),
        "atan2" => ("y: f64, x: f64", "y.atan2(x)".to_string()),
        "hypot" => ("x: f64, y: f64", "x.hypot(y)".to_string()),
        other => ("x: f64", format!("x.{other}()")),
    };
    format!("    #[inline(always)]\n    pub fn {name}({arguments}) -> f64 {{\n        {body}\n    }}\n")
}

fn tables(model: &Model, schedule: &Schedule) -> String {
    let layout = &schedule.layout;
    let mut text = String::new();
    for (name, value, about) in sizes(layout) {
        text += &format!("/// {about}\npub const {name}: usize = {value};\n");
    }
    let mut table = |name: String, kind: &str, values: Vec<String>| {
        text += &format!("pub const {name}: [{kind}; {}] = [{}];\n", values.len(), values.join(", "));
    };
    for (group, _, members) in groups(model) {
        let strings = |of: &dyn Fn(&Quantity) -> String| members.iter().map(|q| rust_string(&of(q))).collect();
        let group = group.to_uppercase();
        table(format!("{group}_NAMES"), "&str", strings(&|q| q.name.clone()));
        table(format!("{group}_UNITS"), "&str", strings(&unit));
        table(format!("{group}_DOCS"), "&str", strings(&|q| q.doc.clone()));
    }
    let number = |of: fn(&Param) -> f64| model.params.iter().map(|q| NOTATION.number(of(q))).collect();
    let flag = |of: fn(&Param) -> bool| model.params.iter().map(|q| of(q).to_string()).collect();
    table("PARAM_START".into(), "f64", number(|q| q.value));
    table("PARAM_LOWER".into(), "f64", number(|q| q.lower));
    table("PARAM_UPPER".into(), "f64", number(|q| q.upper));
    table("PARAM_FIXED".into(), "bool", flag(|q| q.fixed));
    table("PARAM_PER_RUN".into(), "bool", flag(|q| q.per_run));
    let whole = |v: Vec<usize>| v.iter().map(ToString::to_string).collect::<Vec<_>>();
    table("DELAYED_SIGNAL".into(), "usize", whole(signals(layout)));
    for (name, pattern) in patterns(layout) {
        let (rows, columns) = places(pattern);
        table(format!("{}_ROW", name.to_uppercase()), "usize", whole(rows));
        table(format!("{}_COLUMN", name.to_uppercase()), "usize", whole(columns));
    }
    for (group, _, members) in groups(model) {
        let names = distinct(members.iter().map(|q| q.name.as_str()), true);
        let line = |(name, (k, q)): (&String, (usize, &&Quantity))| {
            format!("    /// {}\n    pub const {name}: usize = {k};\n", described(q))
        };
        let lines: String = names.iter().zip(members.iter().enumerate()).map(line).collect();
        text += &format!("/// Positions by name\npub mod {group} {{\n{lines}}}\n");
    }
    text
}

/// A program as a function, or as several that one calls.
fn function(entry: &Entry<'_>) -> Result<String, TooLong> {
    let (bodies, places) = entry.bodies(&NOTATION)?;
    let head = head(entry.name, entry.time, entry.reads, entry.writes);
    let unused = |whole: &[Body]| {
        let mut unused: Vec<&str> = Vec::new();
        unused.extend((entry.time && !whole.iter().any(|b| b.time)).then_some("t"));
        unused.extend(entry.reads.iter().filter(|a| !whole.iter().any(|b| b.reads.contains(a))).map(|a| a.name));
        unused.extend(entry.writes.iter().filter(|a| !whole.iter().any(|b| b.writes.contains(a))).map(|a| a.name));
        unused.iter().map(|name| format!("    let _ = {name};\n")).collect::<String>()
    };
    let mut text = format!("\n/// {}\npub fn {head} {{\n{}", entry.about, unused(&bodies));
    if let [body] = &bodies[..] {
        body.lines.iter().for_each(|l| text += &format!("    {l}\n"));
        return Ok(text + "}\n");
    }
    if bodies.iter().any(|b| b.waits) {
        text += &format!("    let mut w = [0.0f64; {places}];\n");
    }
    for body in &bodies {
        let waits = body.waits.then_some("&mut w");
        let time = body.time.then_some("t");
        let arrays = body.reads.iter().chain(&body.writes).map(|a| a.name);
        let arguments: Vec<&str> = time.into_iter().chain(arrays).chain(waits).collect();
        text += &format!("    {}({});\n", body.name, arguments.join(", "));
    }
    text += "}\n";
    for body in &bodies {
        let (reads, writes): (Vec<Array>, Vec<Array>) =
            (body.reads.iter().copied().collect(), body.writes.iter().copied().collect());
        let mut head = self::head(&body.name, body.time, &reads, &writes);
        if body.waits {
            head.pop();
            let comma = if head.ends_with('(') { "" } else { ", " };
            head += &format!("{comma}w: &mut [f64; {places}])");
        }
        let lines: String = body.lines.iter().map(|l| format!("    {l}\n")).collect();
        text += &format!("\n#[inline(never)]\nfn {head} {{\n{lines}}}\n");
    }
    Ok(text)
}

fn head(name: &str, time: bool, reads: &[Array], writes: &[Array]) -> String {
    let time = time.then(|| "t: f64".to_string());
    let reads = reads.iter().map(|a| format!("{}: &[f64; {}]", a.name, a.length));
    let writes = writes.iter().map(|a| format!("{}: &mut [f64; {}]", a.name, a.length));
    format!("{name}({})", time.into_iter().chain(reads).chain(writes).collect::<Vec<_>>().join(", "))
}

/// Initial values and sensitivities as full matrices: filled from the patterns, term by term in their order.
const DENSE: &str = "
/// Initial values of the states and of S, their derivatives by the parameters (STATES rows of PARAMS columns).
pub fn initial(known: &[f64; KNOWN], x: &mut [f64; STATES], s: &mut [f64; STATES * PARAMS]) {
    x.copy_from_slice(&known[KNOWN_X0..KNOWN_X0 + STATES]);
    s.fill(0.0);
    scatter(&X0_THETA_ROW, &X0_THETA_COLUMN, &known[KNOWN_X0_THETA..], s);
}

/// Rates with partials, and the right side of the sensitivity equations: S_rate = f_x S + f_delayed S_delayed + f_theta
/// (STATES rows of PARAMS columns). S_delayed has DELAYED rows: S(t - tau) - x'(t - tau) tau_theta for a delayed state,
/// -u'(t - tau) tau_theta for a delayed input.
#[allow(clippy::too_many_arguments)]
pub fn sensitivity_rates(
    t: f64,
    x: &[f64; STATES],
    drive: &[f64; DRIVE],
    known: &[f64; KNOWN],
    s: &[f64; STATES * PARAMS],
    s_delayed: &[f64; DELAYED * PARAMS],
    f: &mut [f64; STATES],
    f_x: &mut [f64; F_X_ENTRIES],
    f_delayed: &mut [f64; F_DELAYED_ENTRIES],
    f_theta: &mut [f64; F_THETA_ENTRIES],
    s_rate: &mut [f64; STATES * PARAMS],
) {
    rates_and_partials(t, x, drive, known, f, f_x, f_delayed, f_theta);
    s_rate.fill(0.0);
    scatter(&F_THETA_ROW, &F_THETA_COLUMN, f_theta, s_rate);
    chain(&F_X_ROW, &F_X_COLUMN, f_x, s, s_rate);
    chain(&F_DELAYED_ROW, &F_DELAYED_COLUMN, f_delayed, s_delayed, s_rate);
}

/// Outputs with partials, and their derivatives by the parameters: Y = y_x S + y_delayed S_delayed + y_theta
/// (OUTPUTS rows of PARAMS columns).
#[allow(clippy::too_many_arguments)]
pub fn output_sensitivities(
    t: f64,
    x: &[f64; STATES],
    drive: &[f64; DRIVE],
    known: &[f64; KNOWN],
    s: &[f64; STATES * PARAMS],
    s_delayed: &[f64; DELAYED * PARAMS],
    y: &mut [f64; OUTPUTS],
    y_x: &mut [f64; Y_X_ENTRIES],
    y_delayed: &mut [f64; Y_DELAYED_ENTRIES],
    y_theta: &mut [f64; Y_THETA_ENTRIES],
    by_theta: &mut [f64; OUTPUTS * PARAMS],
) {
    outputs_and_partials(t, x, drive, known, y, y_x, y_delayed, y_theta);
    by_theta.fill(0.0);
    scatter(&Y_THETA_ROW, &Y_THETA_COLUMN, y_theta, by_theta);
    chain(&Y_X_ROW, &Y_X_COLUMN, y_x, s, by_theta);
    chain(&Y_DELAYED_ROW, &Y_DELAYED_COLUMN, y_delayed, s_delayed, by_theta);
}

fn scatter(row: &[usize], column: &[usize], entry: &[f64], out: &mut [f64]) {
    for ((i, j), value) in row.iter().zip(column).zip(entry) {
        out[i * PARAMS + j] = *value;
    }
}

fn chain(row: &[usize], column: &[usize], entry: &[f64], s: &[f64], out: &mut [f64]) {
    for ((i, k), value) in row.iter().zip(column).zip(entry) {
        for j in 0..PARAMS {
            out[i * PARAMS + j] += value * s[k * PARAMS + j];
        }
    }
}
";
