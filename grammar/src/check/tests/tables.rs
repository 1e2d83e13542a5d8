//! Tables against a direct evaluation, and what is told about faulty ones.

use super::{good, told};
use crate::Source;
use crate::graph::{Leaf, Node};
use crate::model::{Model, TableNode};

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

/// The model of the statements with everything written out.
fn compiled(statements: &str) -> Model {
    let source = Source::new("m", format!("model m {{ {statements} }}"));
    match crate::compile(&source) {
        Ok(compiled) => compiled.model,
        Err(findings) => panic!("{statements}\n{findings:#?}"),
    }
}

/// What is told of a whole text.
fn findings(text: &str) -> Vec<String> {
    let mut source = Source::new("m", text);
    crate::gather(&mut source, &mut |_| Err("no such file".into()));
    let findings = crate::compile(&source).map_or_else(|findings| findings, |compiled| compiled.warnings);
    findings.iter().map(|f| f.line(&source)).collect()
}

/// A surface over uneven axes, its values params.
struct Grid {
    axes: Vec<Vec<f64>>,
    values: Vec<f64>,
}

impl Grid {
    fn new(numbers: &mut Numbers, lengths: &[usize]) -> Self {
        let axes: Vec<Vec<f64>> =
            lengths.iter().map(|n| points(numbers, *n).into_iter().map(|p| p.0).collect()).collect();
        let values = (0..lengths.iter().product()).map(|_| 4.0 * numbers.next() - 2.0).collect();
        Self { axes, values }
    }

    fn model(&self, method: &str) -> Model {
        let names = ["a", "b", "c"];
        let d = self.axes.len();
        let inputs = names[..d].iter().map(|n| format!("u{n}")).collect::<Vec<_>>().join(", ");
        let axes: String = self.axes.iter().zip(names).map(|(axis, n)| format!("{n}: {axis:?}, ")).collect();
        let mut parts: Vec<String> = self.values.iter().map(|v| format!("{v:?}")).collect();
        for axis in self.axes.iter().rev() {
            parts = parts.chunks(axis.len()).map(|part| format!("[{}]", part.join(", "))).collect();
        }
        let arguments = names[..d].join(", ");
        compiled(&format!(
            "input {inputs}; table C({arguments}) = {method} {{ {axes} C: free {} }}; output y = C({inputs});",
            parts[0]
        ))
    }

    /// Curves along the last axis give the points of curves along the one before it.
    fn direct(&self, x: &[f64], curve: impl Fn(&[(f64, f64)], f64) -> f64) -> f64 {
        let mut values = self.values.clone();
        for (axis, x) in self.axes.iter().zip(x).rev() {
            let along = |row: &[f64]| curve(&axis.iter().copied().zip(row.iter().copied()).collect::<Vec<_>>(), *x);
            values = values.chunks(axis.len()).map(along).collect();
        }
        values[0]
    }
}

fn surface(model: &Model, x: &[f64]) -> f64 {
    model.graph.evaluate(model.outputs[0].expr, |leaf| match leaf {
        Leaf::Input(k) => x[k as usize],
        Leaf::Param(k) => model.params[k as usize].value,
        _ => f64::NAN,
    })
}

/// One-argument tables of numbers, which other tests compare with their definitions.
fn curve(method: &str, points: &[(f64, f64)], x: f64) -> f64 {
    value(&model(method, points), x)
}

#[test]
fn surfaces_are_curves_of_curves() {
    let mut numbers = Numbers(11);
    for lengths in [&[2, 2][..], &[4, 3], &[3, 5], &[2, 3, 4]] {
        let grid = Grid::new(&mut numbers, lengths);
        for method in ["linear", "cubic", "pchip"] {
            let model = grid.model(method);
            assert_eq!(model.params.len(), grid.values.len());
            for _ in 0..25 {
                let at = |axis: &Vec<f64>, u: f64| axis[0] - 0.3 + (axis[axis.len() - 1] - axis[0] + 0.6) * u;
                let x: Vec<f64> = grid.axes.iter().map(|axis| at(axis, numbers.next())).collect();
                let (got, want) = (surface(&model, &x), grid.direct(&x, |p, x| curve(method, p, x)));
                assert!((got - want).abs() < 1e-11, "{method} {lengths:?} at {x:?}: {got} instead of {want}");
            }
            for (node, want) in grid.values.iter().enumerate() {
                let place = model.tables[0].place(node);
                let x: Vec<f64> = place.iter().zip(&grid.axes).map(|(k, axis)| axis[*k]).collect();
                assert!((surface(&model, &x) - want).abs() < 1e-12, "{method} {lengths:?} at node {place:?}");
            }
        }
    }
}

/// A surface that is a product of parabolas is given back by `cubic`, whichever axis comes first.
#[test]
fn products_of_cubics_are_given_back() {
    let f = |x: f64, y: f64| (1.0 - x + 0.5 * x * x * x) * (0.3 + y - 0.8 * y * y);
    let axes = vec![vec![-1.0, -0.2, 0.5, 1.3, 2.0], vec![0.0, 0.4, 1.0, 1.1]];
    let values = axes[0].iter().flat_map(|x| axes[1].iter().map(|y| f(*x, *y))).collect();
    let model = Grid { axes, values }.model("cubic");
    for (x, y) in [(-0.9, 0.1), (0.0, 0.7), (1.7, 1.05), (0.5, 0.4)] {
        assert!((surface(&model, &[x, y]) - f(x, y)).abs() < 1e-12);
    }
}

/// Nodes that no argument comes near have no influence at all: what is said of unvisited nodes rests on that.
#[test]
fn straight_surfaces_are_local() {
    let mut numbers = Numbers(5);
    let grid = Grid::new(&mut numbers, &[6, 5]);
    let mut model = grid.model("linear");
    let x = [0.37 * grid.axes[0][3] + 0.63 * grid.axes[0][4], 0.81 * grid.axes[1][1] + 0.19 * grid.axes[1][2]];
    let before = surface(&model, &x);
    for k in 0..grid.values.len() {
        let place = model.tables[0].place(k);
        let near = (3..=4).contains(&place[0]) && (1..=2).contains(&place[1]);
        let old = std::mem::replace(&mut model.params[k].value, 1e9);
        assert_eq!(surface(&model, &x) == before, !near, "{place:?}");
        model.params[k].value = old;
    }
}

#[test]
fn grids_are_written_in_several_ways() {
    let text = |nodes: &str| {
        format!(
            "param K[2,3] = [[1, 2, 3], [4, 5, 6]] in [-9, 9]; const x[2] = [0, 1]; input u, v; \
             table C(a, b) = linear {{ {nodes} }}; output y = C(u, v) + K[1,1];"
        )
    };
    let named = compiled(&text("a: x, b: [0, 1, 2], C: K"));
    let literal =
        compiled(&text("b: [0, 1, 2], a: [0, 1], C: [[K[1,1], 2, K[1,3]], K[2,:]]").replace("K[2,:]", "[4, 5, 6]"));
    assert_eq!((surface(&named, &[1.0, 2.0]), surface(&literal, &[0.5, 0.5])), (7.0, 4.0));
    let free = compiled(
        &text("a: x, b: [0, 1, 2], C: free 0.5")
            .replace("K[1,1]", "C[2,3]")
            .replace("output", "prior C[1,2] ~ normal(0, 1); output"),
    );
    let names: Vec<&str> = free.params.iter().map(|p| p.quantity.name.as_str()).collect();
    assert_eq!(names[names.len() - 6..], ["C[1,1]", "C[1,2]", "C[1,3]", "C[2,1]", "C[2,2]", "C[2,3]"]);
    assert!(
        free.params[free.param("C[1,2]").unwrap()].prior.is_some()
            && free.params[free.param("C[2,3]").unwrap()].value == 0.5
    );
    let derived = compiled(
        "param d = 2*e, e = 1, f = 3; input u; table C(a) = linear { a: [0, 1], C: [e, f] }; output y = C(u) + d;",
    );
    let names: Vec<&TableNode> = derived.tables[0].nodes.iter().collect();
    assert_eq!(names, [&TableNode::Param("e".into()), &TableNode::Param("f".into())]);
    // one argument, and three
    let curve =
        compiled("input u; table C(a) = cubic { a: [0, 1, 2], C: free }; smooth C by order 2; output y = C(u);");
    assert_eq!((curve.params.len(), curve.tables[0].smooth), (3, Some(2)));
    let three = compiled(
        "input u; table C(a, b, c) = linear { a: [0, 1], b: [0, 1], c: [0, 1], C: [[[0, 1], [2, 3]], [[4, 5], [6, 7]]] }; output y = C(u, u, 0.5);",
    );
    assert_eq!(surface(&three, &[1.0]), 6.5);
}

#[test]
fn faulty_grids_are_told() {
    let list = |statements: &str| {
        findings(&format!("model m {{ input u, v; param a = 1; {statements} output y = C(u, v) + a; }}"))
    };
    let one = |statements: &str, part: &str| {
        let told = list(statements);
        assert!(told.len() == 1 && told[0].contains(part), "{statements}: {told:?}");
    };
    one(
        "table C(x, y) = linear { 0: 1, 1: 2 };",
        "has 2 arguments, and this is not the name of one; `{ x: [...], y: [...], C: [[...]] }`",
    );
    one("table C(x, y) = linear { x: [0, 1], C: [[1, 2], [3, 4]] };", "lacks the axis `y`");
    one("table C(x, y) = linear { x: [0, 1], y: [0, 1] };", "lacks the values");
    one("table C(x, y) = linear { x: [0, 1], z: [0, 1], C: free };", "`z` is no argument of the table `C`");
    one("table C(x, y) = linear { x: [0, 1], x: [0, 1], C: free };", "`x` is given a second time");
    one(
        "table C(x, y) = linear { x: 1, y: [0, 1], C: free };",
        "the axis `x` of a table is a vector, this is a number",
    );
    one("table C(x, y) = linear { x: [1], y: [0, 1], C: free };", "the axis `x` of the table `C` has a single value");
    one(
        "table C(x, y) = linear { x: [0, 1], y: [0, 2, 1], C: free };",
        "the values of the axis `y` of the table `C` increase, and 1 follows 2",
    );
    one(
        "table C(x, y) = linear { x: [0, 1], y: [0, 1], C: [[1, 2], [3]] };",
        "`C` has 1 value along `y` here, its axis has 2",
    );
    one(
        "table C(x, y) = linear { x: [0, 1], y: [0, 1], C: [1, 2, 3, 4] };",
        "`C` has 4 values along `x` here, its axis has 2",
    );
    one(
        "table C(x, y) = linear { x: [0, 1], y: [0, 1], C: 3 };",
        "the values of the table `C` are [2, 2], this is a number",
    );
    one("table C(x, y) = linear { x: [0, 1], y: [0, 1], C: [[1, 2], [3, u]] };", "cannot depend on the input `u`");
    one(
        "table C(x, y) = linear { x: [0, 1], y: [0, 1], C: free [[1, 2], [3, a]] };",
        "the free values of the table `C` start at numbers",
    );
    one("table C(x, y) = linear { x: [0, a], y: [0, 1], C: free };", "cannot depend on the param `a`");
    one("table C(x, x) = linear { x: [0, 1], C: free };", "two arguments of the table `C` have the name `x`");
    one(
        "table C(x, y, z, w) = linear { x: [0, 1], y: [0, 1], z: [0, 1], w: [0, 1], C: free };",
        "the table `C` has 4 arguments, more than the limit of 3",
    );
    one("table C(x) = linear { 0: 1, 1: 2 };", "the table `C` takes 1 argument, 2 given");
    one(
        "table C(x, y) = linear { x: [0, 1], y: [0, 1], C: free }; let b = C(u); output z = b;",
        "the table `C` takes 2 arguments, 1 given; `C(x, y)`",
    );
    one("table C(x, y) = linear from \"c.csv\";", "the table `C` cannot be read from `c.csv`");
    let smooth = |end: &str, part: &str| {
        one(&format!("table C(x, y) = linear {{ x: [0, 1, 2], y: [0, 1], C: free }}; {end}"), part)
    };
    smooth("smooth D by order 2;", "`D` is not declared");
    smooth("smooth a by order 2;", "`a` is a param; smoothness is of tables");
    smooth("smooth C by order 7;", "the order of differences is 1, 2 or 3");
    smooth("smooth C by order 3;", "differences of order 3 need 4 values of an axis of `C`");
    smooth("smooth C by order 2; smooth C by order 1;", "the smoothness of `C` is given a second time");
    one(
        "table C(x, y) = linear { x: [0, 1, 2], y: [0, 1], C: [[1, 2], [3, 4], [5, 6]] }; smooth C by order 2;",
        "no node of `C` is estimated",
    );
    one(
        "table C(x, y) = linear { x: [0, 1, 2], y: [0, 1], C: [[1, 2], [3, 2*a], [5, 6]] }; smooth C by order 2;",
        "this node of `C` is made of params",
    );
    let deg = findings(
        "model m { input u [rad], v [m]; table C(x [rad], y [s]) [1] = linear { x: [0, 1], y: [0, 1], C: free }; output y [1] = C(u, v); }",
    );
    assert!(deg.len() == 1 && deg[0].contains("the table `C` takes s for `y`, this is in m"), "{deg:?}");
}

/// A model whose table stands in a file.
fn from_file(csv: &str, table: &str) -> Result<Model, Vec<String>> {
    let text = format!(
        "model m {{ input u [rad], v [1]; table C(a [rad], b [1]) [1] = linear {table}; output y [1] = C(u, v); }}"
    );
    let mut source = Source::new("folder/m.fdm", text);
    crate::gather(&mut source, &mut |name| match name {
        "folder/c.csv" => Ok(csv.into()),
        _ => Err("no such file".into()),
    });
    match crate::compile(&source) {
        Ok(compiled) => Ok(compiled.model),
        Err(findings) => {
            Err(findings.iter().map(|f| format!("{}: {}", source.position(f.span.start).line, f.message)).collect())
        }
    }
}

#[test]
fn tables_are_read_from_files() {
    let list = "# lift\na [deg], b, C\n0,0,1\n90,0,3\n\n0,1,2\n90,1,-4e0\n";
    let read = from_file(list, "from \"c.csv\"").unwrap();
    let right = std::f64::consts::FRAC_PI_2;
    assert_eq!((surface(&read, &[0.0, 1.0]), read.params.len()), (2.0, 0));
    assert!(
        (surface(&read, &[right, 1.0]) + 4.0).abs() < 1e-12
            && (surface(&read, &[0.5 * right, 0.0]) - 2.0).abs() < 1e-12
    );
    let free = from_file("a\\b;0;1\r\n0;1;2\r\n1;3;-4\r\n", "from \"c.csv\" free").unwrap();
    let starts: Vec<f64> = free.params.iter().map(|p| p.value).collect();
    assert_eq!((starts, &*free.params[3].quantity.name), (vec![1.0, 2.0, 3.0, -4.0], "C[2,2]"));
    let wrong = |csv: &str, want: &str| {
        let told = from_file(csv, "from \"c.csv\"").unwrap_err();
        assert!(told.len() == 1 && told[0] == want, "{csv:?}: {told:?}");
    };
    wrong("", "1: `folder/c.csv` holds no table: a row of titles and rows of numbers are needed");
    wrong("a,b\n0,0\n", "1: `c.csv` has no column `C`");
    wrong("a,b,C\n0,0,1\n0,1,x\n", "3: `x` is not a finite number");
    wrong("a,b,C\n0,0,1\n0,1,\n", "3: a number is missing here");
    wrong("a,b,C\n0,0,1\n0,1\n", "3: this row has 2 fields, the titles 3");
    wrong("a,b,C\n0,0,1\n0,0,2\n", "3: a = 0, b = 0 is given a second time");
    wrong("a,b,C\n0,0,1\n1,1,2\n", "1: `c.csv` lacks the value at a = 0, b = 1");
    wrong("a [m],b,C\n0,0,1\n", "1: the column `a` is in m, the table in rad");
    wrong("a,1,0\n0,0,1\n1,1,2\n", "1: the values of the axis `b` of the table `C` increase, and 0 follows 1");
    wrong("a,b,C\n0,0,inf\n", "2: `inf` is not a finite number");
}

/// The core model of a text with what `expand` writes out.
fn whole(text: &str) -> Model {
    crate::compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{text}: {e:?}")).model
}

#[test]
fn a_scheduled_param_is_a_table_called_with_what_it_depends_on() {
    let head = "model m { input V [m/s], u [rad]; state q = 0.1 [rad/s];";
    let tail = "der(q) = k*q + u*c; const c = 1 [1/s^2]; output y [rad/s] = q + 0*V*d; const d = 1 [rad/m]; }";
    let short =
        whole(&format!("{head} param k(V) \"damping\" [1/s] in [-9, 0] = cubic [-1, -2, -4] at [20, 40, 80]; {tail}"));
    let long = whole(&format!(
        "{head} table T(V [m/s]) [1/s] = cubic {{ V: [20, 40, 80], T: free [-1, -2, -4] }}; let k = T(V); {tail}"
    ));
    let names: Vec<&str> = short.params.iter().map(|p| p.quantity.name.as_str()).collect();
    assert_eq!(names, ["k[1]", "k[2]", "k[3]"]);
    assert!(short.params.iter().all(|p| (p.lower, p.upper) == (-9.0, 0.0) && p.quantity.doc == "damping"));
    assert_eq!(
        (&*short.tables[0].quantity.name, short.tables[0].nodes[1].clone()),
        ("k(V)", TableNode::Param("k[2]".into()))
    );
    for speed in [10.0, 20.0, 33.0, 50.0, 95.0] {
        let rate = |m: &Model| {
            m.graph.evaluate(m.states[0].rate, |leaf| match leaf {
                Leaf::Input(0) => speed,
                Leaf::Input(_) => 0.3,
                Leaf::State(_) => 0.7,
                Leaf::Param(k) => m.params[k as usize].value,
                _ => f64::NAN,
            })
        };
        assert_eq!(rate(&short).to_bits(), rate(&long).to_bits(), "{speed}");
    }
    let two =
        whole("model m { input V, h; param k(V, h) = 2 at [0, 1], [0, 5, 9]; smooth k by order 1; output y = k; }");
    assert_eq!((two.params.len(), two.tables[0].smooth), (6, Some(1)));
    assert!(two.params.iter().all(|p| p.value == 2.0));
}

#[test]
fn states_with_limits_are_told_what_is_wrong_with_them() {
    let told =
        |statements: &str| told(&format!("model m {{ input u; state x; der(x) = u; {statements} output y = x; }}"));
    assert!(told("limit x in [0, inf];").is_empty());
    assert!(told("param top = 1; limit x in [-top, 2*top] smooth 0.1;").is_empty());
    assert!(
        told("limit x in [1, 0];")[0].contains("E0303 the limits [1, 0] of `x` leave no room; `limit x in [0, 1];`")
    );
    assert!(told("limit x in [0, u];")[0].contains("E0305 the upper limit of `x` cannot depend on the input `u`"));
    assert!(told("limit x in [0, 1] smooth 0;")[0].contains("E0303 the width of the limits of `x` is 0"));
    assert!(told("limit u in [0, 1];")[0].contains("E0207 `u` is an input; a limit is of states"));
    assert!(told("limit x in [0, 1], x in [0, 2];")[0].contains("E0202 the limit of `x` is given a second time"));
    let coupled = super::told(
        "model m { input u; state x, z; der(x) + der(z) = u; der(x) - der(z) = 0; limit x in [0, 1]; output y = x + z; }",
    );
    assert!(
        coupled[0].contains("E0408 `x` has a limit, but its derivative is not given by an equation of its own"),
        "{coupled:?}"
    );
}

#[test]
fn a_limit_of_a_vector_is_one_of_each_element() {
    let model = whole("model m { input u; state x[2]; der(x) = [u, -u]; limit x in [-1, [1, 2]]; output y[2] = x; }");
    let upper: Vec<f64> = model.limits().map(|(_, l)| model.graph.constant(l.upper).unwrap()).collect();
    assert_eq!(upper, [1.0, 2.0]);
    let one = whole("model m { input u; state x[2]; der(x) = [u, -u]; limit x[2] in [-1, 1]; output y[2] = x; }");
    assert_eq!(one.limits().map(|(k, _)| k).collect::<Vec<_>>(), [1]);
}
