//! Random shapes: a model of matrices computes, to the bit, what the model written out by hand computes.

use crate::graph::Leaf;
use crate::{Model, Source, compile};
use proptest::prelude::*;

/// An entry: 0 by structure, a start value, a param, or an expression of params.
fn entry(k: u8) -> &'static str {
    ["0", "0.3", "-1.5", "p", "2*p*k", "0", "2", "-k"][usize::from(k % 8)]
}

/// `[[a, b], [c, d]]`
fn literal(entries: &[u8], columns: usize) -> String {
    let row = |row: &[u8]| format!("[{}]", row.iter().map(|k| entry(*k)).collect::<Vec<_>>().join(", "));
    format!("[{}]", entries.chunks(columns).map(row).collect::<Vec<_>>().join(", "))
}

/// The scalar declarations of a matrix.
fn scalars(name: &str, entries: &[u8], columns: usize) -> String {
    let one =
        |(at, k): (usize, &u8)| format!("param {name}_{}_{} = {};\n", at / columns + 1, at % columns + 1, entry(*k));
    entries.iter().enumerate().filter(|(_, k)| entry(**k) != "0").map(one).collect()
}

/// `A_1_1*x_1 + A_1_2*x_2`, without the zeros.
fn row(name: &str, entries: &[u8], columns: usize, i: usize, x: &str) -> Option<String> {
    let terms = (0..columns).filter(|j| entry(entries[i * columns + j]) != "0");
    let terms: Vec<String> = terms.map(|j| format!("{name}_{}_{}*{x}_{}", i + 1, j + 1, j + 1)).collect();
    (!terms.is_empty()).then(|| terms.join(" + "))
}

fn vector_model(n: usize, m: usize, a: &[u8], b: &[u8], c: &[u8]) -> String {
    let (a, b, c) = (literal(a, n), literal(b, m), literal(c, n));
    format!(
        "model m {{ input u[{m}, 1]; param p = 0.7, k = 1.3, x0[{n}] = 0.1; state x[{n}] = x0;
         param A[{n}, {n}] = {a}, B[{n}, {m}] = {b}, C[2, {n}] = {c}; let w[{n}] = (k + sin(p*t))*tanh(x)/p;
         der(x) = A*x + B*u - w; output y[2] = C*(x - w), z = dot(x, w) + norm(x) + sum(-x); }}"
    )
}

fn scalar_model(n: usize, m: usize, a: &[u8], b: &[u8], c: &[u8]) -> String {
    let each = |count: usize, text: &dyn Fn(usize) -> String| (1..=count).map(text).collect::<Vec<_>>();
    let mut text = format!("model m {{ input {};\n", each(m, &|k| format!("u_{k}_1")).join(", "));
    text += "param p = 0.7, k = 1.3;";
    each(n, &|k| format!("param x0_{k} = 0.1; state x_{k} = x0_{k};")).iter().for_each(|s| text += s);
    text += &(scalars("A", a, n) + &scalars("B", b, m) + &scalars("C", c, n));
    for i in 0..n {
        let ax = row("A", a, n, i, "x");
        let bu =
            row("B", b, m, i, "u").map(|r| (1..=m).fold(r, |r, j| r.replace(&format!("*u_{j}"), &format!("*u_{j}_1"))));
        let sums = [ax.map(|r| format!("({r})")), bu.map(|r| format!("({r})"))];
        let sum: Vec<String> = sums.into_iter().flatten().collect();
        text += &format!("let w_{0} = (k + sin(p*t))*tanh(x_{0})/p, d_{0} = x_{0} - w_{0};\n", i + 1);
        text += &format!("der(x_{0}) = {1} - w_{0};\n", i + 1, sum.join(" + "));
    }
    for i in 0..2 {
        text += &format!("output y_{} = {};\n", i + 1, row("C", c, n, i, "d").unwrap_or("0".into()));
    }
    let dot = each(n, &|k| format!("x_{k}*w_{k}")).join(" + ");
    let norm = (2..=n).fold("x_1".to_string(), |norm, k| format!("hypot({norm}, x_{k})"));
    let norm = if n == 1 { "abs(x_1)".into() } else { norm };
    let sum = each(n, &|k| format!("(-x_{k})")).join(" + ");
    text + &format!("output z = ({dot}) + {norm} + ({sum}); }}")
}

fn model(text: &str) -> Model {
    compile(&Source::new("m", text)).unwrap_or_else(|e| panic!("{text}\n{:?}", e[0])).model
}

/// Rates and outputs at a point that depends on the names' places only.
fn values(model: &Model) -> Vec<u64> {
    let at = |leaf: Leaf| match leaf {
        Leaf::Time => 0.37,
        Leaf::State(k) => 0.3 - 0.7 * f64::from(k),
        Leaf::Input(k) => 1.1 * f64::from(k) - 0.2,
        Leaf::Param(k) => model.params[k as usize].value + 0.01 * f64::from(k),
        _ => 0.0,
    };
    let expressions = model.states.iter().map(|s| s.rate).chain(model.outputs.iter().map(|o| o.expr));
    expressions.map(|e| model.graph.evaluate(e, at).to_bits()).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]
    #[test]
    fn matrices_compute_what_is_written_out(n in 2usize..5, m in 1usize..4, seed in proptest::collection::vec(any::<u8>(), 60)) {
        let (a, rest) = seed.split_at(n * n);
        let (b, rest) = rest.split_at(n * m);
        let c = &rest[..2 * n];
        let (one, other) = (model(&vector_model(n, m, a, b, c)), model(&scalar_model(n, m, a, b, c)));
        let written = |name: &str| name.replace("[", "_").replace(",", "_").replace("]", "");
        let names = |model: &Model| model.params.iter().map(|p| (written(&p.quantity.name), p.value.to_bits())).collect::<Vec<_>>();
        // params stand in the order of their declaration
        prop_assert_eq!(names(&one).len(), names(&other).len());
        prop_assert_eq!(values(&one), values(&other), "{}\n{}", vector_model(n, m, a, b, c), scalar_model(n, m, a, b, c));
    }
}
