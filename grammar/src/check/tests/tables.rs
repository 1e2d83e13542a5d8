//! Tables against a direct evaluation, and what is told about faulty ones.

use super::{good, told};
use crate::graph::{Leaf, Node};
use crate::model::Model;

/// Deterministic numbers between 0 and 1.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Points with uneven distances.
fn points(numbers: &mut Numbers, count: usize) -> Vec<(f64, f64)> {
    let mut x = -1.0;
    let mut point = || {
        x += 0.05 + numbers.next();
        (x, 4.0 * numbers.next() - 2.0)
    };
    (0..count).map(|_| point()).collect()
}

/// A model whose ordinates are params.
fn model(method: &str, points: &[(f64, f64)]) -> Model {
    let params: Vec<String> = points.iter().enumerate().map(|(k, (_, y))| format!("y{k} = {y:?}")).collect();
    let list: Vec<String> = points.iter().enumerate().map(|(k, (x, _))| format!("{x:?}: y{k}")).collect();
    let (params, list) = (params.join(", "), list.join(", "));
    good(&format!("input u; param {params}; table C(a) = {method} {{ {list} }}; output y = C(u);"))
}

fn value(model: &Model, x: f64) -> f64 {
    model.graph.evaluate(model.outputs[0].expr, |leaf| match leaf {
        Leaf::Input(_) => x,
        Leaf::Param(k) => model.params[k as usize].value,
        _ => f64::NAN,
    })
}

/// Values inside and outside the range.
fn places(points: &[(f64, f64)]) -> Vec<f64> {
    let (first, last) = (points[0].0, points[points.len() - 1].0);
    let inside = (0..=200).map(|k| first + (last - first) * f64::from(k) / 200.0);
    inside.chain(points.iter().map(|p| p.0)).chain([first - 3.0, last + 0.1, 1e9, -1e9]).collect()
}

fn piece(points: &[(f64, f64)], x: f64) -> (usize, f64) {
    let x = x.clamp(points[0].0, points[points.len() - 1].0);
    let k = points[1..points.len() - 1].iter().filter(|p| p.0 <= x).count();
    (k, x)
}

fn agree(method: &str, direct: impl Fn(&[(f64, f64)], f64) -> f64) {
    let mut numbers = Numbers(7);
    for count in [2, 3, 4, 5, 9, 40] {
        let points = points(&mut numbers, count);
        let model = model(method, &points);
        for x in places(&points) {
            let (got, want) = (value(&model, x), direct(&points, x));
            assert!((got - want).abs() < 1e-11, "{method} of {count} points at {x}: {got} instead of {want}");
        }
        assert!(value(&model, f64::NAN).is_nan());
    }
}

#[test]
fn straight_lines() {
    agree("linear", |p, x| {
        let (k, x) = piece(p, x);
        p[k].1 + (p[k + 1].1 - p[k].1) * (x - p[k].0) / (p[k + 1].0 - p[k].0)
    });
}

/// Fritsch and Butland's slopes and three-point ends, written as in their paper.
fn slopes(p: &[(f64, f64)]) -> Vec<f64> {
    let h: Vec<f64> = p.windows(2).map(|w| w[1].0 - w[0].0).collect();
    let d: Vec<f64> = p.windows(2).map(|w| (w[1].1 - w[0].1) / (w[1].0 - w[0].0)).collect();
    let n = p.len();
    if n == 2 {
        return vec![d[0]; 2];
    }
    let end = |h0: f64, h1: f64, d0: f64, d1: f64| {
        let s = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
        if s.signum() != d0.signum() {
            0.0
        } else if d0.signum() != d1.signum() && s.abs() > 3.0 * d0.abs() {
            3.0 * d0
        } else {
            s
        }
    };
    let mut all = vec![end(h[0], h[1], d[0], d[1])];
    for k in 1..n - 1 {
        let (w, v) = (2.0 * h[k] + h[k - 1], h[k] + 2.0 * h[k - 1]);
        all.push(if d[k - 1] * d[k] <= 0.0 { 0.0 } else { (w + v) / (w / d[k - 1] + v / d[k]) });
    }
    all.push(end(h[n - 2], h[n - 3], d[n - 2], d[n - 3]));
    all
}

#[test]
fn monotone_curves() {
    agree("pchip", |p, x| {
        let (k, x) = piece(p, x);
        let (m, h) = (slopes(p), p[k + 1].0 - p[k].0);
        let s = (x - p[k].0) / h;
        let (s2, s3) = (s * s, s * s * s);
        (2.0 * s3 - 3.0 * s2 + 1.0) * p[k].1
            + (s3 - 2.0 * s2 + s) * h * m[k]
            + (3.0 * s2 - 2.0 * s3) * p[k + 1].1
            + (s3 - s2) * h * m[k + 1]
    });
    // between points that rise nothing falls
    let p = [(0.0, 0.0), (1.0, 0.1), (2.0, 5.0), (2.5, 5.0), (4.0, 6.0)];
    let model = model("pchip", &p);
    let values: Vec<f64> = (0..=400).map(|k| value(&model, f64::from(k) / 100.0)).collect();
    assert!(values.windows(2).all(|w| w[0] <= w[1] + 1e-12));
}

#[test]
fn splines_are_smooth_and_give_back_cubics() {
    let cubic = |x: f64| 0.3 - x + 0.7 * x * x - 0.4 * x * x * x;
    let mut numbers = Numbers(3);
    for count in [4, 5, 12] {
        let mut p = points(&mut numbers, count);
        p.iter_mut().for_each(|p| p.1 = cubic(p.0));
        let model = model("cubic", &p);
        for x in places(&p) {
            let (got, want) = (value(&model, x), cubic(piece(&p, x).1));
            assert!((got - want).abs() < 1e-9 * want.abs().max(1.0), "{count} points at {x}: {got} {want}");
        }
    }
    let parabola = [(0.0, 1.0), (1.0, -1.0), (3.0, 4.0)];
    let through = model("cubic", &parabola);
    assert!((value(&through, 2.0) - (1.0 - 3.5 * 2.0 + 1.5 * 4.0)).abs() < 1e-12);
    // second derivatives from both sides of inner points, third ones beside the second and the last but one
    let p = points(&mut numbers, 9);
    let model = model("cubic", &p);
    let f = |x: f64| value(&model, x);
    for k in 1..p.len() - 1 {
        let (x, h) = (p[k].0, 1e-3);
        let second = |s: f64| (f(x) - 2.0 * f(x + s * h) + f(x + 2.0 * s * h)) / (h * h);
        let third =
            |s: f64| s * (f(x + 3.0 * s * h) - 3.0 * f(x + 2.0 * s * h) + 3.0 * f(x + s * h) - f(x)) / (h * h * h);
        // the one-sided quotient is off by h times the third derivative
        let (left, right) = (second(-1.0) + h * third(-1.0), second(1.0) - h * third(1.0));
        assert!((left - right).abs() < 1e-5 * left.abs().max(1.0), "{k}: {left} {right}");
        if k == 1 || k == p.len() - 2 {
            assert!((third(-1.0) - third(1.0)).abs() < 1e-4 * third(1.0).abs().max(1.0), "not a knot");
        }
    }
}

#[test]
fn equal_calls_are_one_expression_and_constants_fold() {
    let m = good("input u; table C(a) = cubic { 0: 1, 1: 2, 2: 0, 3: 1 }; output y = C(2*u) - C(2*u), z = C(1.5);");
    assert!(m.graph.constant(m.outputs[1].expr).is_some());
    let Node::Apply(_, [a, b, _]) = m.graph.node(m.outputs[0].expr) else { panic!() };
    assert_eq!(a, b);
    // a table in an ordinate, called before the text declares it
    let m = good(
        "param p = 2; output y = D(0.5); table D(x) = linear { 0: C(1), 1: p }; table C(x) = linear { 0: 0, 2: 8 };",
    );
    let y = m.graph.evaluate(m.outputs[0].expr, |_| 2.0);
    assert_eq!(y, 3.0);
}

#[test]
fn faulty_tables_are_told() {
    let list = |statements: &str| told(&format!("model m {{ input u; param a = 1; {statements} output y = C(u); }}"));
    let one = |statements: &str, part: &str| {
        let told = list(statements);
        assert!(told.len() == 1 && told[0].contains(part), "{statements}: {told:?}");
    };
    one("table C(x) = linear { 0: a };", "a single point");
    one("table C(x) = linear { 0: a, 0: 2 };", "0 follows 0");
    one("table C(x) = linear { 0: a, 2: 1, 1: 2 };", "1 follows 2");
    one(
        "table C(x) = spline { 0: a, 1: 2 };",
        "`spline` is not a kind of table; a spline through the points is `cubic`",
    );
    one("table C(x) = linear { 0: a, a: 2 };", "the abscissae of the table `C` cannot depend on the param `a`");
    one("table C(x) = linear { 0: a, 1: u };", "the ordinates of the table `C` cannot depend on the input `u`");
    one("table C(x) = linear { 0: a, 1: C(2) };", "`C` is defined by itself");
    let deg = told(
        "model m { input u [rad]; param a = 1 [1]; table C(x [deg]) [1] = linear { 0: a, 1: 2 }; output y [1] = C(u); }",
    );
    assert!(deg.len() == 1 && deg[0].contains("the table `C` takes deg, this is in rad"), "{deg:?}");
    one(
        "const d = 1 [m]; table C(x [rad]) = linear { 0: a, d: 2 };",
        "the abscissae of the table `C` are in rad, this is in m",
    );
    one("table C(x) = linear { 0: a, 1: 2 }; let b = C; output z = b;", "stands here without its argument; `C(x)`");
    one(
        "table C(x) = linear { 0: a, 1: 2 }; let b = C(1, 2); output z = b;",
        "the table `C` takes 1 argument, 2 given",
    );
    one("table C(x) = linear { 0: a, 1: 2 }; table D(x) = linear { 0: 1, 1: 2 };", "the table `D` is not used");
    let many: Vec<String> = (0..1001).map(|k| format!("{k}: 1")).collect();
    one(
        &format!("param b = 1; table C(x) = linear {{ {}, 2000: a*b }};", many.join(", ")),
        "1002 points, more than the limit of 1000",
    );
}

#[test]
fn tables_do_not_swell_beyond_their_limit() {
    let points: Vec<String> = (0..1000).map(|k| format!("{k}: {}", k % 7)).collect();
    let calls: Vec<String> = (0..200).map(|k| format!("C(u + {k})")).collect();
    let text = format!(
        "model m {{ input u; table C(x) = linear {{ {} }}; output y = {}; }}",
        points.join(", "),
        calls.join(" + ")
    );
    let told = told(&text);
    assert!(told.len() == 1 && told[0].contains("more than 100000 pieces"), "{}", told.len());
    let params: Vec<String> = (0..400).map(|k| format!("p{k} = {}", k % 3)).collect();
    let points: Vec<String> = (0..400).map(|k| format!("{k}: p{k}")).collect();
    let of = |method: &str| {
        let (params, points) = (params.join(", "), points.join(", "));
        format!("model m {{ input u; param {params}; table C(x) = {method} {{ {points} }}; output y = C(u); }}")
    };
    assert!(super::checked(&of("pchip")).is_ok());
    assert_eq!(super::told(&of("cubic")).len(), 1);
}
