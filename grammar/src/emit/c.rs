//! A model as one file of C99: plain functions over arrays of `double`.

use super::TooLong;
use super::entry::{Array, Body, Entry, entries, functions};
use super::notation::{CNotation, Notation, is_exact};
use super::notation::{c_string, distinct, plain};
use super::tables::{described, groups, patterns, places, signals, sizes, title, unit};
use crate::model::Model;
use crate::schedule::{Program, Schedule};

/// Behind the model's own lines of the title.
const USAGE: &str = "\
 *
 * The functions are declared below; other files include this one with FDM_DECLARATIONS_ONLY defined. Each reads and writes plain arrays:
 *   t        time since the run began
 *   x        states
 *   drive    inputs, then delayed signals: values of their states or inputs at t - tau
 *   known    what PREFIXprepare made of the parameters theta; from KNOWN_X0 on initial values, from KNOWN_TAU on delays
 * Jacobians hold structural nonzeros only, by rows: entry k of f_x stands at PREFIXf_x_row[k], PREFIXf_x_column[k].
 *
 * The results have the same bits as those of fdm where operations on double are IEEE 754, nothing is contracted to
 * fused operations (gcc and clang: -ffp-contract=off, never -ffast-math), and sin, exp, ... are those of fdm (the Rust crate
 * libm). They are those of <math.h> unless fdm_sin, fdm_exp, ... are macros already, or are made so by the header that
 * FDM_ELEMENTARY names: cc -DFDM_ELEMENTARY='\"elementary.h\"'.
 */
";

const CHECKS: &str = "\
#if defined(__FAST_MATH__)
#error \"-ffast-math changes the results\"
#endif
#if defined(__clang__) || !defined(__GNUC__)
#pragma STDC FP_CONTRACT OFF
#else
#pragma GCC optimize(\"fp-contract=off\")
#endif
#if defined(__GNUC__)
#define FDM_APART __attribute__((noinline))
#else
#define FDM_APART
#endif
#ifdef FDM_ELEMENTARY
#include FDM_ELEMENTARY
#endif
#include <math.h>
";

/// What stands in front of every name of a file.
struct Prefixed<'a> {
    prefix: &'a str,
}

/// A model's prefix, and what is printed.
struct C<'a> {
    prefix: String,
    model: &'a Model,
    schedule: &'a Schedule,
}

/// One program as a function of its own file, in front of it what it calls.
pub(super) fn program(prefix: &str, name: &'static str, program: &Program) -> Result<String, TooLong> {
    let (entry, written) = (Entry::alone(name, program), Prefixed { prefix });
    let head = format!("\nvoid {prefix}{name}(");
    let text = written.entry(&entry)?.replacen(&head, &head.replace("void", "static void"), 1);
    Ok(format!("{CHECKS}{}{}", written.functions([program]), text.trim_start()))
}

/// The whole file.
pub(super) fn file(model: &Model, schedule: &Schedule) -> Result<String, TooLong> {
    let c = C { prefix: format!("{}_", plain(&model.name)), model, schedule };
    let mut text = String::from("/*\n");
    title(model).iter().for_each(|line| text += &format!("{}\n", format!(" * {line}").trim_end()));
    text += &USAGE.replace("PREFIX", &c.prefix);
    text += &c.declarations();
    text += "\n#ifndef FDM_DECLARATIONS_ONLY\n\n";
    text += CHECKS;
    text += &c.prefixed().functions(entries(schedule).map(|e| e.program));
    text += &c.tables();
    for entry in entries(schedule) {
        text += &c.prefixed().entry(&entry)?;
    }
    text += &c.dense();
    text += "\n#endif\n";
    Ok(text)
}

impl C<'_> {
    fn prefixed(&self) -> Prefixed<'_> {
        Prefixed { prefix: &self.prefix }
    }

    /// Constants, tables and functions as other files see them.
    fn declarations(&self) -> String {
        let p = &self.prefix;
        let mut text = format!("#ifndef {p}DECLARED\n#define {p}DECLARED\n\nenum {{\n");
        for (name, value, about) in sizes(&self.schedule.layout) {
            text += &format!("    {p}{name} = {value}, /* {about} */\n");
        }
        text += &format!("    {p}ABI = 1\n}};\n");
        for (group, _, members) in groups(self.model) {
            if members.is_empty() {
                continue;
            }
            let names = distinct(members.iter().map(|q| q.name.as_str()), true);
            let group = group.to_uppercase();
            let line = |(k, name): (usize, &String)| format!("    {p}{group}_{name} = {k}");
            let comma = |k| if k + 1 < members.len() { "," } else { "" };
            let lines = names.iter().enumerate().map(|(k, n)| (line((k, n)), k));
            let lines = lines.map(|(line, k)| format!("{line}{} /* {} */\n", comma(k), described(members[k])));
            text += &format!("\nenum {{\n{}}};\n", lines.collect::<String>());
        }
        text += "\n#ifdef __cplusplus\nextern \"C\" {\n#endif\n\n";
        text += &self.all_tables().iter().map(|t| format!("extern {};\n", t.head)).collect::<String>();
        for entry in entries(self.schedule) {
            let head = self.prefixed().head(entry.name, entry.time, entry.reads, entry.writes, "");
            text += &format!("\n/* {} */\n{head};\n", entry.about);
        }
        for (about, head) in self.dense_heads("") {
            text += &format!("\n/* {about} */\n{head};\n");
        }
        text + "\n#ifdef __cplusplus\n}\n#endif\n\n#endif\n"
    }

    fn tables(&self) -> String {
        let tables = self.all_tables();
        tables.iter().map(|t| format!("{} = {{{}}};\n", t.head, t.values)).collect()
    }

    /// All tables; those without entries hold one that means nothing, because C has no empty arrays.
    fn all_tables(&self) -> Vec<Table> {
        let p = &self.prefix;
        let (model, layout) = (self.model, &self.schedule.layout);
        let table = |kind: &str, name: String, values: Vec<String>| {
            let (length, none) = (values.len().max(1), if values.is_empty() { "0" } else { "" });
            Table { head: format!("const {kind}{p}{name}[{length}]"), values: format!("{}{none}", values.join(", ")) }
        };
        let mut tables = Vec::new();
        for (group, _, members) in groups(model) {
            let strings =
                |of: &dyn Fn(&crate::model::Quantity) -> String| members.iter().map(|q| c_string(&of(q))).collect();
            for (what, values) in
                [("name", strings(&|q| q.name.clone())), ("unit", strings(&unit)), ("doc", strings(&|q| q.doc.clone()))]
            {
                tables.push(table("char *const ", format!("{group}_{what}"), values));
            }
        }
        let notation = CNotation { own: p };
        let number =
            |of: fn(&crate::model::Param) -> f64| model.params.iter().map(|q| notation.number(of(q))).collect();
        let flag =
            |of: fn(&crate::model::Param) -> bool| model.params.iter().map(|q| u8::from(of(q)).to_string()).collect();
        tables.push(table("double ", "param_start".into(), number(|q| q.value)));
        tables.push(table("double ", "param_lower".into(), number(|q| q.lower)));
        tables.push(table("double ", "param_upper".into(), number(|q| q.upper)));
        tables.push(table("int ", "param_fixed".into(), flag(|q| q.fixed)));
        tables.push(table("int ", "param_per_run".into(), flag(|q| q.per_run)));
        let whole = |v: Vec<usize>| v.iter().map(ToString::to_string).collect::<Vec<_>>();
        tables.push(table("int ", "delayed_signal".into(), whole(signals(layout))));
        for (name, pattern) in patterns(layout) {
            let (rows, columns) = places(pattern);
            tables.push(table("int ", format!("{name}_row"), whole(rows)));
            tables.push(table("int ", format!("{name}_column"), whole(columns)));
        }
        tables
    }

    /// What is said and how it is called: initial values and sensitivities as full matrices.
    fn dense_heads(&self, restrict: &str) -> [(&'static str, String); 3] {
        let p = &self.prefix;
        let point = "double t, const double *x, const double *drive, const double *known, const double *S, const double *S_delayed";
        let partials = |y: &str| {
            let names = [y.to_string(), format!("{y}_x"), format!("{y}_delayed"), format!("{y}_theta")];
            names.map(|name| format!("double *{restrict}{name}")).join(", ")
        };
        [
            (
                "Initial values of the states and of S, their derivatives by the parameters (STATES rows of PARAMS columns).",
                format!("void {p}initial(const double *known, double *{restrict}x, double *{restrict}S)"),
            ),
            (
                "Rates with partials, and the right side of the sensitivity equations: S_rate = f_x S + f_delayed S_delayed + f_theta\n \
                 * (STATES rows of PARAMS columns). S_delayed has DELAYED rows: S(t - tau) - x'(t - tau) tau_theta for a delayed\n \
                 * state, -u'(t - tau) tau_theta for a delayed input.",
                format!("void {p}sensitivity_rates({point}, {}, double *{restrict}S_rate)", partials("f")),
            ),
            (
                "Outputs with partials, and their derivatives by the parameters: Y = y_x S + y_delayed S_delayed + y_theta\n \
                 * (OUTPUTS rows of PARAMS columns).",
                format!("void {p}output_sensitivities({point}, {}, double *{restrict}Y)", partials("y")),
            ),
        ]
    }

    /// Matrices filled from the patterns, term by term in their order.
    fn dense(&self) -> String {
        let p = &self.prefix;
        let [(_, initial), (_, rates), (_, outputs)] = self.dense_heads("restrict ");
        let chain = format!(
            "
static void {p}clear(int count, double *out)
{{
    int k;
    for (k = 0; k < count; k++)
        out[k] = 0.0;
}}

static void {p}scatter(int count, const int *row, const int *column, const double *entry, double *out)
{{
    int k;
    for (k = 0; k < count; k++)
        out[row[k] * {p}PARAMS + column[k]] = entry[k];
}}

static void {p}chain(int count, const int *row, const int *column, const double *entry, const double *S, double *restrict out)
{{
    int k, j;
    for (k = 0; k < count; k++)
        for (j = 0; j < {p}PARAMS; j++)
            out[row[k] * {p}PARAMS + j] += entry[k] * S[column[k] * {p}PARAMS + j];
}}
"
        );
        let count = |name: &str| name.to_uppercase();
        let scatter = |name: &str, entry: &str, out: &str| {
            format!("    {p}scatter({p}{}_ENTRIES, {p}{name}_row, {p}{name}_column, {entry}, {out});\n", count(name))
        };
        let chained = |name: &str, s: &str, out: &str| {
            format!("    {p}chain({p}{}_ENTRIES, {p}{name}_row, {p}{name}_column, {name}, {s}, {out});\n", count(name))
        };
        let whole = |y: &str, program: &str, rows: &str, out: &str| {
            let (by_state, by_delayed, by_param) = (format!("{y}_x"), format!("{y}_delayed"), format!("{y}_theta"));
            format!("    {p}{program}(t, x, drive, known, {y}, {by_state}, {by_delayed}, {by_param});\n")
                + &format!("    {p}clear({p}{rows} * {p}PARAMS, {out});\n")
                + &scatter(&by_param, &by_param, out)
                + &chained(&by_state, "S", out)
                + &chained(&by_delayed, "S_delayed", out)
        };
        let start = format!(
            "    int k;
    for (k = 0; k < {p}STATES; k++)
        x[k] = known[{p}KNOWN_X0 + k];
    {p}clear({p}STATES * {p}PARAMS, S);
{}",
            scatter("x0_theta", &format!("known + {p}KNOWN_X0_THETA"), "S")
        );
        let rates_body = whole("f", "rates_and_partials", "STATES", "S_rate");
        let outputs_body = whole("y", "outputs_and_partials", "OUTPUTS", "Y");
        format!("{chain}\n{initial}\n{{\n{start}}}\n\n{rates}\n{{\n{rates_body}}}\n\n{outputs}\n{{\n{outputs_body}}}\n")
    }
}

impl Prefixed<'_> {
    /// What the programs call: elementary functions by default from `<math.h>`, ours written out.
    fn functions<'p>(&self, programs: impl IntoIterator<Item = &'p Program>) -> String {
        let (mut elementary, mut own) = (String::new(), String::from("\n"));
        for name in functions(programs) {
            let p = &self.prefix;
            if !is_exact(name) {
                elementary += &format!("#ifndef fdm_{name}\n#define fdm_{name} {name}\n#endif\n");
                continue;
            }
            let (arguments, body) = match name {
                "sign" => ("double x", "x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x * 0.0"),
                "min" => ("double a, double b", "a <= b ? a : b < a ? b : a + b"),
                "max" => ("double a, double b", "a >= b ? a : b > a ? b : a + b"),
                "less" => ("double a, double b", "(double)(a < b)"),
                "less_equal" => ("double a, double b", "(double)(a <= b)"),
                "equal" => ("double a, double b", "(double)(a == b)"),
                "select" => ("double condition, double a, double b", "condition != 0.0 ? a : b"),
                // the absolute value is `fabs`
                _ => continue,
            };
            own += &format!("static double {p}{name}({arguments})\n{{\n    return {body};\n}}\n\n");
        }
        elementary + &own
    }

    fn notation(&self) -> CNotation<'_> {
        CNotation { own: self.prefix }
    }

    fn head(&self, name: &str, time: bool, reads: &[Array], writes: &[Array], restrict: &str) -> String {
        let time = time.then(|| "double t".to_string());
        let reads = reads.iter().map(|a| format!("const double *{}", a.name));
        let writes = writes.iter().map(|a| format!("double *{restrict}{}", a.name));
        let arguments: Vec<String> = time.into_iter().chain(reads).chain(writes).collect();
        format!("void {}{name}({})", self.prefix, arguments.join(", "))
    }

    /// A program as a function, or as several that one calls.
    fn entry(&self, entry: &Entry<'_>) -> Result<String, TooLong> {
        let notation = self.notation();
        let (mut bodies, places) = entry.bodies(&notation)?;
        let head = self.head(entry.name, entry.time, entry.reads, entry.writes, "restrict ");
        let mut text = String::new();
        let lines = if bodies.len() == 1 {
            bodies.remove(0)
        } else {
            let mut lines = Vec::from([format!("double w[{}];", places.max(1))]);
            for body in &bodies {
                text += &format!("\nFDM_APART static {}", self.piece(body));
                lines.push(format!("{}{}({});", self.prefix, body.name, arguments(body)));
            }
            let whole = || bodies.iter();
            Body {
                name: String::new(),
                time: whole().any(|b| b.time),
                reads: whole().flat_map(|b| b.reads.clone()).collect(),
                writes: whole().flat_map(|b| b.writes.clone()).collect(),
                waits: whole().any(|b| b.waits),
                lines,
            }
        };
        text += &format!("\n{head}\n{{\n");
        text += &lines.lines.iter().map(|l| format!("    {l}\n")).collect::<String>();
        let mut unused: Vec<&str> = Vec::new();
        unused.extend((entry.time && !lines.time).then_some("t"));
        unused.extend(entry.reads.iter().filter(|a| !lines.reads.contains(a)).map(|a| a.name));
        unused.extend(entry.writes.iter().filter(|a| !lines.writes.contains(a)).map(|a| a.name));
        unused.extend((lines.name.is_empty() && !lines.waits).then_some("w"));
        text += &unused.iter().map(|name| format!("    (void){name};\n")).collect::<String>();
        Ok(text + "}\n")
    }

    fn piece(&self, body: &Body) -> String {
        let (reads, writes): (Vec<Array>, Vec<Array>) =
            (body.reads.iter().copied().collect(), body.writes.iter().copied().collect());
        let mut head = self.head(&body.name, body.time, &reads, &writes, "restrict ");
        if body.waits {
            head.pop();
            let comma = if head.ends_with('(') { "" } else { ", " };
            head += &format!("{comma}double *restrict w)");
        }
        let lines: String = body.lines.iter().map(|l| format!("    {l}\n")).collect();
        format!("{}\n{{\n{lines}}}\n", head.replace("()", "(void)"))
    }
}

/// A constant array: how it is declared, and what stands in it.
struct Table {
    head: String,
    values: String,
}

fn arguments(body: &Body) -> String {
    let time = body.time.then_some("t");
    let arrays = body.reads.iter().chain(&body.writes).map(|a| a.name);
    time.into_iter().chain(arrays).chain(body.waits.then_some("w")).collect::<Vec<_>>().join(", ")
}
