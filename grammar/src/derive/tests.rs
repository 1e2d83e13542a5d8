//! Both ways to the derivatives give the same numbers, choices included, and neither swells.

use super::Sweep;
use crate::graph::{Graph, Leaf};
use crate::op::{Build, ExprId, Op};

/// Numbers without a pattern.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % bound
    }
}

/// A graph of operations on what was there before, mostly on the latest, with a few roots.
fn random(seed: u64) -> (Graph, Vec<ExprId>) {
    let (mut numbers, mut g) = (Numbers(seed), Graph::default());
    let mut all: Vec<ExprId> = (0..4).map(|k| g.leaf(Leaf::Param(k))).collect();
    all.push(g.leaf(Leaf::State(0)));
    for _ in 0..30 + numbers.below(40) {
        let late = all.len() - 1 - numbers.below(3);
        let (a, b) = (all[late], all[numbers.below(all.len())]);
        let op = [Op::Add, Op::Mul, Op::Sub, Op::Sin, Op::Atan, Op::Div, Op::Min, Op::Max, Op::Select, Op::Sqrt]
            [numbers.below(10)];
        let e = match op {
            Op::Sin | Op::Atan | Op::Sqrt => g.apply(op, &[a]),
            Op::Select => {
                let less = g.apply(Op::Less, &[a, b]);
                let root = g.apply(Op::Sqrt, &[a]);
                g.apply(Op::Select, &[less, root, b])
            }
            _ => g.apply(op, &[a, b]),
        };
        all.push(e);
    }
    let roots = (0..1 + numbers.below(3)).map(|k| all[all.len() - 1 - k * k]).collect();
    (g, roots)
}

#[test]
fn funnels_and_sweeps_give_the_same_derivatives() {
    let (mut compared, mut undefined) = (0, 0);
    for seed in 0..400 {
        let (mut g, roots) = random(seed);
        let sweep = Sweep::new(&g, &roots);
        let [forward, back] = [false, true].map(|funnels| sweep.by(&mut g, |_| true, funnels, usize::MAX).unwrap());
        for at in 0..4 {
            let leaf = |leaf: Leaf| match leaf {
                Leaf::Param(k) => 0.3 + 0.4 * f64::from((k + at) % 4),
                _ => -0.7 + 0.5 * f64::from(at),
            };
            for (which, column) in &forward {
                for root in 0..roots.len() as u32 {
                    let value = |column: &[(u32, ExprId)]| {
                        column.iter().find(|(r, _)| *r == root).map_or(0.0, |(_, d)| g.evaluate(*d, leaf))
                    };
                    let (a, b) = (value(column), value(&back[which]));
                    undefined += usize::from(!a.is_finite());
                    if a.is_finite() && a.abs() < 1e8 {
                        assert!((a - b).abs() <= 1e-9 * (1.0 + a.abs()), "{seed} {which:?} {root} at {at}: {a} {b}");
                        compared += 1;
                    }
                }
            }
        }
    }
    assert!(compared > 5_000 && undefined > 0, "{compared} {undefined}");
}

#[test]
fn a_branch_that_is_not_taken_counts_nothing_however_infinite() {
    let mut g = Graph::default();
    let (x, zero) = (g.leaf(Leaf::Param(0)), g.number(0.0));
    let (root, positive) = (g.apply(Op::Sqrt, &[x]), g.apply(Op::Less, &[zero, x]));
    let mut e = g.apply(Op::Select, &[positive, root, x]);
    for k in 1..5 {
        let p = g.leaf(Leaf::Param(k));
        e = g.apply(Op::Mul, &[e, p]);
    }
    let sweep = Sweep::new(&g, &[e]);
    for funnels in [false, true] {
        let columns = sweep.by(&mut g, |_| true, funnels, usize::MAX).unwrap();
        let slope = g.evaluate(columns[&Leaf::Param(0)][0].1, |l| if l == Leaf::Param(0) { 0.0 } else { 2.0 });
        assert_eq!(slope, 16.0, "{funnels}");
    }
}

/// `sqrt(max(x, 0))` below zero, `hypot` of what rests at zero, `acos` of what is held at one: infinite slopes of nothing.
#[test]
fn a_tangent_that_vanishes_stays_zero() {
    let mut g = Graph::default();
    let (x, zero, one) = (g.leaf(Leaf::Param(0)), g.number(0.0), g.number(1.0));
    let (above, below) = (g.apply(Op::Max, &[x, zero]), g.apply(Op::Min, &[x, one]));
    let (root, power) = (g.apply(Op::Sqrt, &[above]), g.leaf(Leaf::Param(1)));
    let all = [
        root,
        g.apply(Op::Hypot, &[above, zero]),
        g.apply(Op::Log, &[above]),
        g.apply(Op::Pow, &[above, power]),
        g.apply(Op::Acos, &[below]),
        g.apply(Op::Asin, &[below]),
    ];
    let sweep = Sweep::new(&g, &all);
    let columns = sweep.by(&mut g, |leaf| leaf == Leaf::Param(0), false, usize::MAX).unwrap();
    let slope = |at: f64, root: u32| {
        let d = columns[&Leaf::Param(0)].iter().find(|(r, _)| *r == root).unwrap().1;
        g.evaluate(d, |l| if l == Leaf::Param(0) { at } else { 0.5 })
    };
    (0..4).for_each(|root| assert_eq!(slope(-2.0, root), 0.0, "{root}"));
    (4..6).for_each(|root| assert_eq!(slope(2.0, root), 0.0, "{root}"));
    assert_eq!((slope(4.0, 0), slope(4.0, 1), slope(4.0, 2), slope(4.0, 3)), (0.25, 1.0, 0.25, 0.25));
}

#[test]
fn tables_have_the_derivatives_of_their_curves() {
    use super::differentiate;
    use crate::{Model, Source, check::check, syntax::parse};
    for method in ["linear", "cubic", "pchip"] {
        let text = format!(
            "model m {{ input u; param a = 1, b = -0.5, c = 0.3, d = 2;
             table C(x) = {method} {{ -1: a, -0.2: b, 0.5: c, 0.6: d, 2: 1, 3.5: a*b }}; output y = C(u); }}"
        );
        let tree = parse(&Source::new("m", text)).expect("a text");
        let (mut model, _) = check(&tree).expect("a model");
        let partials = differentiate(&mut model).outputs;
        let at = |model: &Model, e: ExprId, x: f64, moved: Option<(u32, f64)>| {
            model.graph.evaluate(e, |leaf| match leaf {
                Leaf::Input(_) => x,
                Leaf::Param(k) => model.params[k as usize].value + moved.filter(|m| m.0 == k).map_or(0.0, |m| m.1),
                _ => f64::NAN,
            })
        };
        let (y, h) = (model.outputs[0].expr, 1e-6);
        for k in 0..60 {
            let x = -1.4 + 5.3 * (f64::from(k) + 0.37) / 60.0;
            let slope = (at(&model, y, x + h, None) - at(&model, y, x - h, None)) / (2.0 * h);
            let own = at(&model, partials.input.entries[0], x, None);
            assert!((slope - own).abs() < 1e-6 * slope.abs().max(1.0), "{method} at {x}: {own} {slope}");
            for (place, j) in partials.param.pattern.row(0) {
                let difference = at(&model, y, x, Some((j as u32, h))) - at(&model, y, x, Some((j as u32, -h)));
                let own = at(&model, partials.param.entries[place], x, None);
                assert!((difference / (2.0 * h) - own).abs() < 1e-7, "{method} by param {j} at {x}");
            }
        }
        for x in [-1.0, -0.2, 0.5, 0.6, 2.0, 3.5] {
            let own = at(&model, partials.input.entries[0], x, None);
            let [left, right] = [-h, h].map(|h| (at(&model, y, x + h, None) - at(&model, y, x, None)) / h);
            let near = [left, right].iter().any(|slope| (slope - own).abs() < 1e-4);
            assert!(near, "{method} at the point {x}: {own}, from the left {left}, from the right {right}");
        }
    }
}

/// By arguments and by nodes, inside and outside the range, and at nodes, where a derivative is that of one side.
#[test]
fn surfaces_have_the_derivatives_of_their_values() {
    use super::differentiate;
    use crate::{Model, Source};
    let grids = [
        "table C(a, b) = METHOD { a: [-1, -0.2, 0.5, 2], b: [0, 0.4, 1.1],
         C: [[p, 0.3, q], [1.3, 1.7*q, -2], [0.1, p*q, 0.7], [q, 2, 0.2]] }; output y = C(u, v);",
        "table C(a, b, c) = METHOD { a: [-1, 0.5, 2], b: [0, 1.1], c: [-2, 0, 1, 3],
         C: free [[[1, 2, -1, 0], [0.3, p1, 0.2, 2.2]], [[1.1, 0.05, 3, 1.4], [2.3, 2.1, -0.4, 1.2]], [[0.1, 0.2, 0.9, 0.35], [1.6, 1.8, 4, 2.5]]] };
         const p1 = 0.6; output y = C(u, v, u + 0.5*v);",
    ];
    for (grid, method) in grids.iter().flat_map(|g| ["linear", "cubic", "pchip"].map(|m| (g, m))) {
        let text = format!("model m {{ input u, v; param p = 1, q = -0.5; {} }}", grid.replace("METHOD", method));
        let mut model = crate::compile(&Source::new("m", text)).expect("a model").model;
        let partials = differentiate(&mut model).outputs;
        let at = |model: &Model, e: ExprId, x: [f64; 2], moved: Option<(u32, f64)>| {
            model.graph.evaluate(e, |leaf| match leaf {
                Leaf::Input(k) => x[k as usize],
                Leaf::Param(k) => model.params[k as usize].value + moved.filter(|m| m.0 == k).map_or(0.0, |m| m.1),
                _ => f64::NAN,
            })
        };
        let (y, h) = (model.outputs[0].expr, 1e-6);
        for k in 0..40 {
            let x = [-1.4 + 3.9 * (f64::from(k) + 0.37) / 40.0, -0.3 + 1.8 * (0.381_966 * f64::from(k)).fract()];
            for (place, j) in partials.input.pattern.row(0) {
                let moved = |h: f64| {
                    let mut x = x;
                    x[j] += h;
                    at(&model, y, x, None)
                };
                let (slope, own) =
                    ((moved(h) - moved(-h)) / (2.0 * h), at(&model, partials.input.entries[place], x, None));
                assert!(
                    (slope - own).abs() < 1e-6 * slope.abs().max(1.0),
                    "{method} by input {j} at {x:?}: {own} {slope}"
                );
            }
            for (place, j) in partials.param.pattern.row(0) {
                let difference = at(&model, y, x, Some((j as u32, h))) - at(&model, y, x, Some((j as u32, -h)));
                let own = at(&model, partials.param.entries[place], x, None);
                assert!((difference / (2.0 * h) - own).abs() < 1e-7, "{method} by param {j} at {x:?}");
            }
        }
        let kink = [0.5, 0.7];
        let place = partials.input.pattern.row(0).next().expect("an entry").0;
        let own = at(&model, partials.input.entries[place], kink, None);
        let [left, right] =
            [-h, h].map(|h| (at(&model, y, [kink[0] + h, kink[1]], None) - at(&model, y, kink, None)) / h);
        let near = [left, right].iter().any(|slope| (slope - own).abs() < 1e-4);
        assert!(near, "{method} at a kink: {own}, from the left {left}, from the right {right}");
    }
}
