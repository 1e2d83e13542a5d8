//! What comes apart, what stays whole, and that nothing is lost on the way.

use super::{combinations, separate};
use crate::graph::{Graph, Leaf, show};
use crate::model::Model;
use crate::op::{Build, ExprId, Op};
use crate::source::Source;
use crate::stopwatch::timed;

fn model(equations: &str) -> Model {
    let text = format!(
        "model m {{ input u, w; param a = 0.7, b = -1.3, c = 2.1, k = 0.4 fixed, tau = 0.1; state x, z; {equations} }}"
    );
    crate::compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}")).model
}

/// (coefficient, regressor) as text, then those of the rest, of der(x).
fn apart(rate: &str) -> (Vec<String>, Vec<String>) {
    let mut m = model(&format!("der(x) = {rate}; der(z) = -z; output y = x + z;"));
    let free: Vec<bool> = m.params.iter().map(|p| !p.fixed).collect();
    let rate = m.states[0].rate;
    let found = separate(&mut m.graph, &[rate], |k| free[k as usize]).remove(0);
    same_value(&m, rate, found.terms.iter().chain(&found.rest).map(|t| (t.coefficient, t.regressor)));
    let text = |t: &super::Term| {
        let shown = [t.coefficient, t.regressor].map(|e| show(&m.graph, e, &m));
        format!("{} | {}", shown[0], shown[1])
    };
    let mut lists = [found.terms, found.rest].map(|list| list.iter().map(text).collect::<Vec<_>>());
    lists.iter_mut().for_each(|l| l.sort());
    let [terms, rest] = lists;
    (terms, rest)
}

fn same_value(m: &Model, whole: ExprId, parts: impl Iterator<Item = (ExprId, ExprId)>) {
    let leaf = |leaf: Leaf| match leaf {
        Leaf::Time => 0.37,
        Leaf::State(k) => [0.6, -1.7][k as usize],
        Leaf::Input(k) => [1.2, -0.8][k as usize],
        Leaf::Param(k) => m.params[k as usize].value,
        Leaf::Delayed(k) => 0.2 + k as f64,
    };
    let sum: f64 = parts.map(|(c, r)| m.graph.evaluate(c, leaf) * m.graph.evaluate(r, leaf)).sum();
    let wanted = m.graph.evaluate(whole, leaf);
    assert!((sum - wanted).abs() < 1e-13 * wanted.abs().max(1.0), "{sum} instead of {wanted}");
}

fn terms(rate: &str) -> Vec<String> {
    let (terms, rest) = apart(rate);
    assert!(rest.is_empty(), "{rate}: {rest:?}");
    terms
}

#[test]
fn products_over_sums_and_equal_regressors() {
    assert_eq!(terms("a*(x + b*u) - c*x"), ["a - c | x", "a*b | u"]);
    assert_eq!(terms("a*x*abs(x) + b*(x*u)*x + c*u*x^2"), ["a | x*abs(x)", "b + c | x^2*u"]);
    assert_eq!(terms("a*(x - z)^2 + 3"), ["3 | 1", "a | (x - z)^2"]);
    assert_eq!(terms("a*(x - 1)^2").len(), 3);
    assert_eq!(terms("x - x + a"), ["a | 1"]);
    assert_eq!(terms("(1 + u)*x"), ["1 | u*x", "1 | x"]);
    assert_eq!(terms("(a*x + b)*(c*z + 1)"), ["a | x", "a*c | x*z", "b | 1", "b*c | z"]);
    assert_eq!(terms("a*delay(u, tau) + b*sin(x + 2*t)"), ["a | delay(u, tau)", "b | sin(x + 2*t)"]);
}

#[test]
fn quotients_choices_and_sizes() {
    assert_eq!(terms("a*x/(b*u)"), ["a/b | x/u"]);
    assert_eq!(terms("a*x/(k + u)"), ["a | x/(u + k)"]);
    assert_eq!(terms("(a*x + b)/sqrt(1 + u^2)").len(), 2);
    assert_eq!(terms("abs(a*x)"), ["abs(a) | abs(x)"]);
    assert_eq!(terms("if x > 0 then a*x else b*x"), ["a | if 0 < x then x else 0", "b | if 0 < x then 0 else x"]);
    assert_eq!(terms("if a > b then c*x else x + u").len(), 2);
    assert_eq!(terms("(x + z)/(x - z)"), ["1 | (x + z)/(x - z)"]);
}

#[test]
fn free_parameters_inside_stay_there_and_known_ones_may() {
    assert_eq!(terms("a*tanh(x/k)"), ["a | tanh(x/k)"]);
    let (some, rest) = apart("a*tanh(x/b) + c*x");
    assert_eq!((some, rest), (vec!["c | x".to_string()], vec!["a | tanh(x/b)".to_string()]));
    assert_eq!(apart("x/(b + x)").1, ["1 | x/(b + x)"]);
    assert_eq!(apart("if x > a then x else 0").1.len(), 1);
}

#[test]
fn coefficients_are_affine_or_not() {
    let mut m = model("der(x) = (2*a - k*b + 3)*x + a*b*z + exp(k)*c*u + k*w; der(z) = x; output y = x;");
    let rate = m.states[0].rate;
    let found = separate(&mut m.graph, &[rate], |k| k != 3).remove(0);
    let coefficients: Vec<ExprId> = found.terms.iter().map(|t| t.coefficient).collect();
    let all = combinations(&mut m.graph, &coefficients, |k| k != 3);
    let shown = |c: &super::Combination| {
        let slopes: Vec<String> = c
            .slopes
            .iter()
            .map(|(p, e)| format!("{}: {}", m.params[*p as usize].quantity.name, show(&m.graph, *e, &m)))
            .collect();
        format!("{}; {}", show(&m.graph, c.constant, &m), slopes.join(", "))
    };
    let mut text: Vec<_> = all.iter().map(|c| c.as_ref().map(shown)).collect();
    text.sort();
    let wanted = [None, Some("0; c: exp(k)"), Some("3; a: 2, b: -k"), Some("k; ")];
    assert_eq!(text, wanted.map(|w| w.map(String::from)));
}

#[test]
fn neither_long_nor_deep_expressions_take_long() {
    let mut g = Graph::default();
    let (a, x) = (g.leaf(Leaf::Param(0)), g.leaf(Leaf::State(0)));
    // a sum of very many terms
    let mut sum = x;
    for k in 0..100_000 {
        let k = g.number(f64::from(k) + 0.5);
        let shifted = g.apply(Op::Add, &[x, k]);
        let sine = g.apply(Op::Sin, &[shifted]);
        let term = g.apply(Op::Mul, &[a, sine]);
        sum = g.apply(Op::Add, &[sum, term]);
    }
    // a product of sums whose terms double with every factor
    let mut product = x;
    for k in 0..2000 {
        let input = g.leaf(Leaf::Input(k));
        let factor = g.apply(Op::Mul, &[a, input]);
        let factor = g.apply(Op::Add, &[factor, x]);
        product = g.apply(Op::Mul, &[product, factor]);
        product = g.apply(Op::Add, &[product, factor]);
    }
    let before = g.nodes().len();
    let (found, time) = timed(|| separate(&mut g, &[sum, product], |_| true));
    assert!(found.iter().all(|s| !s.rest.is_empty()), "too long, so whole, with a parameter inside");
    assert!(g.nodes().len() < before + (1 << 21), "{} nodes", g.nodes().len());
    assert!(time.as_secs() < 20, "{time:?}");
}
