//! Random trees never panic; random expressions compute what a plain evaluator computes.

use super::limits::Written;
use crate::check::check;
use crate::graph::Leaf;
use crate::syntax::*;
use crate::{Code, Diagnostic, Span, math};
use proptest::prelude::*;

const NAMES: [&str; 12] = ["u", "x", "z", "a", "b", "c", "l", "y", "t", "pi", "inf", "w"];
const FUNCTIONS: [&str; 14] = [
    "sin", "min", "atan2", "clip", "deadzone", "deg2rad", "delay", "der", "sqrt", "lag", "foo", "u", "measured",
    "normal",
];
const UNITS: [&str; 8] = ["m", "ft", "deg", "rad", "s", "1/s", "%", "mm^200"];

/// One random node over the earlier ones.
fn node(w: &mut Written, [kind, a, b, c]: [u8; 4]) {
    use BinarySign::*;
    let signs = [Add, Subtract, Multiply, Divide, Power, Less, LessEqual, Greater, Equal, NotEqual, And, Or];
    let count = w.expressions.len() as u32;
    let earlier = |k: u8| ExprRef(count.saturating_sub(1 + u32::from(k) % count.max(1)));
    let span = Span::new(usize::from(a), usize::from(a) + usize::from(b));
    let leaf = count == 0;
    let expr = match kind % 8 {
        0 => Expr::Number([0.0, 1.0, 2.0, 0.5, -3.0, f64::INFINITY, f64::NAN, 1e300][usize::from(a % 8)]),
        _ if leaf => Expr::Number(1.0),
        1 | 2 => Expr::Name(NAMES[usize::from(a) % NAMES.len()].into()),
        3 => Expr::Unary([UnarySign::Minus, UnarySign::Plus, UnarySign::Not][usize::from(a % 3)], earlier(b)),
        4 | 5 => Expr::Binary(signs[usize::from(a) % signs.len()], earlier(b), earlier(c), span),
        6 => Expr::If(earlier(a), earlier(b), earlier(c)),
        _ => {
            let text = FUNCTIONS[usize::from(a) % FUNCTIONS.len()];
            let arguments = (0..c % 4).map(|k| earlier(b.wrapping_add(k))).collect();
            Expr::Call(Name { text: text.into(), span }, arguments)
        }
    };
    w.expr(expr);
}

/// One random statement over the nodes.
fn statement(w: &mut Written, [kind, a, b, c]: [u8; 4]) {
    let count = w.expressions.len() as u32;
    let any = |k: u8| ExprRef(u32::from(k) % count);
    let span = Span::new(usize::from(c), usize::from(c) + 3);
    let name = |text: &str| Name { text: text.into(), span };
    let kind = match kind % 10 {
        6 => {
            let x = w.name(NAMES[usize::from(a % 4)]);
            let der = w.expr(Expr::Call(name("der"), vec![x]));
            StatementKind::Equation(if b % 8 == 0 { any(c) } else { der }, any(b))
        }
        8 => {
            let subject = if a % 4 == 0 { any(a) } else { w.name(NAMES[usize::from(a) % NAMES.len()]) };
            let value =
                w.expr(Expr::Call(name(["normal", "normal", "uniform"][usize::from(c % 3)]), vec![any(b), any(c)]));
            StatementKind::Prior(vec![(subject, if c % 8 == 0 { any(c) } else { value })])
        }
        9 if c % 2 == 1 => StatementKind::Process(vec![(name(NAMES[usize::from(a) % NAMES.len()]), any(b))]),
        9 => StatementKind::Noise(vec![(name(NAMES[usize::from(a) % NAMES.len()]), any(b))]),
        7 => StatementKind::Time(name(UNITS[usize::from(a) % UNITS.len()])),
        role => {
            let mut d = Declaration::new(name(NAMES[usize::from(a) % NAMES.len()]), span);
            d.unit = (b % 3 > 0).then(|| name(UNITS[usize::from(c) % UNITS.len()]));
            d.value = match b % 8 {
                0 => None,
                1 => Some(Value::Free(span)),
                _ => Some(Value::Expr(any(c))),
            };
            d.bounds = (c % 5 == 0).then(|| Bounds { lower: any(a), upper: any(b), span });
            d.fixed = (b % 16 == 3).then_some(span);
            d.per_run = (c % 16 == 3).then_some(span);
            StatementKind::Declare(Role::ALL[usize::from(role)], vec![d])
        }
    };
    w.statements.push(Statement { kind, span });
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, ..ProptestConfig::default() })]
    #[test]
    fn no_tree_panics(nodes: Vec<[u8; 4]>, statements: Vec<[u8; 4]>) {
        let mut w = Written::default();
        node(&mut w, [0; 4]);
        nodes.iter().take(40).for_each(|n| node(&mut w, *n));
        statements.iter().take(20).for_each(|s| statement(&mut w, *s));
        match check(&w.tree()) {
            Ok((model, warnings)) => {
                prop_assert!(!model.outputs.is_empty() && warnings.iter().all(|f| !f.is_error()));
                prop_assert!(model.params.iter().all(|p| p.value.is_finite() && p.lower < p.upper));
                prop_assert!(model.params.iter().filter_map(|p| p.prior).all(|p| p.deviation > 0.0 && p.mean.is_finite()));
                prop_assert!(model.outputs.iter().filter_map(|o| o.noise).all(|noise| noise > 0.0));
                let states: Vec<usize> = (0..model.states.len()).collect();
                if let Ok(substituted) = model.substituted(&states) {
                    prop_assert!(substituted.inputs.len() >= model.inputs.len());
                }
            }
            Err(findings) => prop_assert!(findings.iter().any(Diagnostic::is_error)),
        }
    }
}

/// An expression of x, u, a with its own meaning.
#[derive(Debug, Clone)]
enum Plain {
    Number(f64),
    Name(usize),
    Sign(char, Box<Plain>, Box<Plain>),
    Minus(Box<Plain>),
    Call(&'static str, Vec<Plain>),
    If(&'static str, [Box<Plain>; 4]),
}

use Plain::{Call, If, Minus, Name as Leafname, Number, Sign};

impl Plain {
    fn text(&self) -> String {
        match self {
            Number(v) => v.to_string(),
            Leafname(k) => ["x", "u", "a"][*k].into(),
            Sign(sign, a, b) => format!("({} {sign} {})", a.text(), b.text()),
            Minus(a) => format!("(-{})", a.text()),
            Call(name, args) => format!("{name}({})", args.iter().map(Plain::text).collect::<Vec<_>>().join(", ")),
            If(sign, [a, b, c, d]) => {
                format!("(if {} {sign} {} then {} else {})", a.text(), b.text(), c.text(), d.text())
            }
        }
    }

    fn value(&self, names: [f64; 3]) -> f64 {
        let v = |e: &Plain| e.value(names);
        match self {
            Number(value) => *value,
            Leafname(k) => names[*k],
            Sign('+', a, b) => v(a) + v(b),
            Sign('-', a, b) => v(a) - v(b),
            Sign('*', a, b) => v(a) * v(b),
            Sign(_, a, b) => v(a) / v(b),
            Minus(a) => -v(a),
            Call("sin", args) => math::sin(v(&args[0])),
            Call("abs", args) => v(&args[0]).abs(),
            Call("min", args) => args.iter().map(v).fold(f64::INFINITY, math::min),
            Call("clip", args) => math::min(math::max(v(&args[0]), v(&args[1])), v(&args[2])),
            Call(_, args) => math::max(v(&args[0]) - v(&args[1]), 0.0) + math::min(v(&args[0]) + v(&args[1]), 0.0),
            If(sign, [a, b, c, d]) => {
                let (a, b) = (v(a), v(b));
                let holds = match *sign {
                    "<" => a < b,
                    ">" => a > b,
                    "<=" => a <= b,
                    ">=" => a >= b,
                    "==" => a == b,
                    _ => a != b,
                };
                if holds { v(c) } else { v(d) }
            }
        }
    }
}

fn plain() -> impl Strategy<Value = Plain> {
    let leaf = prop_oneof![(1..9_u8).prop_map(|k| Number(f64::from(k) / 2.0)), (0..3_usize).prop_map(Leafname)];
    leaf.prop_recursive(5, 40, 4, |inner| {
        let boxed = || inner.clone().prop_map(Box::new);
        let signs = prop::sample::select(vec!['+', '-', '*', '/']);
        let comparisons = prop::sample::select(vec!["<", ">", "<=", ">=", "==", "!="]);
        prop_oneof![
            4 => (signs, boxed(), boxed()).prop_map(|(s, a, b)| Sign(s, a, b)),
            1 => boxed().prop_map(Minus),
            1 => list_of("sin", inner.clone(), 1..2),
            1 => list_of("abs", inner.clone(), 1..2),
            1 => list_of("min", inner.clone(), 2..5),
            1 => list_of("clip", inner.clone(), 3..4),
            1 => list_of("deadzone", inner.clone(), 2..3),
            1 => (comparisons, [boxed(), boxed(), boxed(), boxed()]).prop_map(|(s, e)| If(s, e)),
        ]
    })
}

fn list_of(
    name: &'static str,
    inner: impl Strategy<Value = Plain>,
    size: std::ops::Range<usize>,
) -> impl Strategy<Value = Plain> {
    prop::collection::vec(inner, size).prop_map(move |args| Call(name, args))
}

proptest! {
    #[test]
    fn expressions_compute_what_they_say(e in plain(), x in -3.0..3.0_f64, u in -3.0..3.0_f64, a in -3.0..3.0_f64) {
        let want = e.value([x, u, a]);
        let text = format!("state x; input u; param a = 1; der(x) = a*u; let l = {}; output y = l + 0*x;", e.text());
        let model = match super::checked(&format!("model m {{ {text} }}")) {
            Ok((model, _)) => model,
            Err(findings) => {
                let mut errors = findings.iter().filter(|f| f.is_error());
                prop_assert!(errors.all(|f| f.code == Code::NotFinite), "{}: {findings:?}", e.text());
                return Ok(());
            }
        };
        let got = model.graph.evaluate(model.outputs[0].expr, |leaf| match leaf {
            Leaf::State(_) => x,
            Leaf::Input(_) => u,
            _ => a,
        });
        // rewrites are exact in real numbers, not in the last bits
        let same = (got - want).abs() <= 1e-9 * want.abs().max(1.0) || got.is_nan() || want.is_nan() || want.abs() > 1e9;
        prop_assert!(same, "{}: {got}, not {want}", e.text());
    }
}
