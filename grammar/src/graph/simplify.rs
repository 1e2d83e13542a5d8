//! The few rewrites made while a node is built: local, exact in real arithmetic, never longer than what they replace.
//!
//! Refused: expanding or factoring sums (changes rounding and may swell), `x/x = 1` (hides a division by zero).
//! Accepted knowingly: `0*x = 0`; a structural zero must stay one, and a NaN in x is seen through x itself.

use super::{Graph, Node};
use super::{call, elements};
use crate::op::{Build, ExprId, Form, Op};

/// The simpler expression that `op(args)` stands for, if there is one.
pub(super) fn simplify(g: &mut Graph, op: Op, args: &[ExprId]) -> Option<ExprId> {
    if let Some(value) = folded(g, op, args) {
        return Some(g.number(value));
    }
    let (a, b) = (args[0], args.get(1).copied().unwrap_or(ExprId::NONE));
    match op {
        Op::Add => add(g, a, b),
        Op::Sub => subtract(g, a, b),
        Op::Mul => multiply(g, a, b),
        Op::Div => divide(g, a, b),
        Op::Neg => match g.node(a) {
            Node::Apply(Op::Neg, inner) => Some(inner[0]),
            Node::Apply(Op::Sub, inner) => Some(g.apply(Op::Sub, &[inner[1], inner[0]])),
            _ => None,
        },
        Op::Pow => power(g, a, b),
        Op::Abs => match g.node(a) {
            Node::Apply(Op::Abs, _) => Some(a),
            Node::Apply(Op::Neg, inner) => Some(g.apply(Op::Abs, &[inner[0]])),
            _ => None,
        },
        Op::Min | Op::Max if a == b => Some(a),
        Op::Select => match g.constant(a) {
            Some(c) => Some(if c != 0.0 { b } else { args[2] }),
            None if b == args[2] => Some(b),
            // what is chosen by a choice of one or nothing
            None => match g.node(a) {
                Node::Apply(Op::Select, inner) if is(g, inner[1], 1.0) && is(g, inner[2], 0.0) => {
                    Some(g.apply(Op::Select, &[inner[0], b, args[2]]))
                }
                _ => None,
            },
        },
        Op::List if is(g, a, 0.0) && is(g, b, 0.0) => Some(a),
        Op::ExternalSlope | Op::ExternalCurvature => along(g, op, args),
        _ => None,
    }
}

/// The derivative of a function of foreign code along directions without the arguments that it does not depend on, which is a
/// structural zero where nothing is left of one.
fn along(g: &mut Graph, op: Op, args: &[ExprId]) -> Option<ExprId> {
    let (function, lists) = call(g, op, [args[0], args[1], args[2]])?;
    let last = function.code.arguments();
    let (mut changed, mut directions) = (false, Vec::new());
    for list in &lists[1..] {
        let mut rest = g.number(0.0);
        for (k, e) in elements(g, *list).into_iter().enumerate().rev() {
            let matters = function.code.depends(function.function, last.checked_sub(k + 1)?);
            changed |= !matters && !is(g, e, 0.0);
            let e = if matters { e } else { g.number(0.0) };
            rest = g.apply(Op::List, &[rest, e]);
        }
        if is(g, rest, 0.0) {
            return Some(rest);
        }
        directions.push(rest);
    }
    if !changed {
        return None;
    }
    let direction = match directions[..] {
        [first, second] => g.apply(Op::List, &[first, second]),
        _ => directions[0],
    };
    Some(g.apply(op, &[args[0], args[1], direction]))
}

fn folded(g: &Graph, op: Op, args: &[ExprId]) -> Option<f64> {
    if op.row().form == Form::External {
        // foreign code is not run while a model is compiled
        return None;
    }
    let mut values = [0.0; 3];
    for (v, a) in values.iter_mut().zip(args) {
        *v = g.constant(*a)?;
    }
    Some((op.row().value)(values[0], values[1], values[2]))
}

fn is(g: &Graph, e: ExprId, value: f64) -> bool {
    g.constant(e) == Some(value)
}

/// The operand of a negation.
fn negated(g: &Graph, e: ExprId) -> Option<ExprId> {
    match g.node(e) {
        Node::Apply(Op::Neg, args) => Some(args[0]),
        _ => None,
    }
}

fn commuted(g: &mut Graph, op: Op, a: ExprId, b: ExprId) -> Option<ExprId> {
    (b < a).then(|| g.apply(op, &[b, a]))
}

fn add(g: &mut Graph, a: ExprId, b: ExprId) -> Option<ExprId> {
    if is(g, a, 0.0) {
        return Some(b);
    }
    if is(g, b, 0.0) {
        return Some(a);
    }
    if a == b {
        let two = g.number(2.0);
        return Some(g.apply(Op::Mul, &[two, a]));
    }
    if let Some(n) = negated(g, b) {
        return Some(g.apply(Op::Sub, &[a, n]));
    }
    if let Some(n) = negated(g, a) {
        return Some(g.apply(Op::Sub, &[b, n]));
    }
    commuted(g, Op::Add, a, b)
}

fn subtract(g: &mut Graph, a: ExprId, b: ExprId) -> Option<ExprId> {
    if is(g, b, 0.0) {
        return Some(a);
    }
    if is(g, a, 0.0) {
        return Some(g.apply(Op::Neg, &[b]));
    }
    negated(g, b).map(|n| g.apply(Op::Add, &[a, n]))
}

fn multiply(g: &mut Graph, a: ExprId, b: ExprId) -> Option<ExprId> {
    for (p, q) in [(a, b), (b, a)] {
        if is(g, p, 0.0) {
            return Some(p);
        }
        if is(g, p, 1.0) {
            return Some(q);
        }
        if is(g, p, -1.0) {
            return Some(g.apply(Op::Neg, &[q]));
        }
        if let Some(n) = negated(g, p) {
            let m = g.apply(Op::Mul, &[n, q]);
            return Some(g.apply(Op::Neg, &[m]));
        }
        if let Some(e) = absolute(g, p, q) {
            return Some(e);
        }
        // k1*(k2*x) = (k1 k2)*x: what abs(x) leaves behind after differentiation
        if let (Some(k), Node::Apply(Op::Mul, inner)) = (g.constant(p), g.node(q))
            && let Some(l) = g.constant(inner[0])
        {
            let k = g.number(k * l);
            return Some(g.apply(Op::Mul, &[k, inner[1]]));
        }
    }
    // constants first, else by id: products commute exactly, so one order serves both
    match (g.constant(a).is_some(), g.constant(b).is_some()) {
        (true, _) => None,
        (false, true) => Some(g.apply(Op::Mul, &[b, a])),
        _ => commuted(g, Op::Mul, a, b),
    }
}

/// `x*sign(x)` and `(k*x)*sign(x)` are `abs(x)` and `k*abs(x)`.
fn absolute(g: &mut Graph, sign: ExprId, other: ExprId) -> Option<ExprId> {
    let Node::Apply(Op::Sign, [x, ..]) = g.node(sign) else { return None };
    if other == x {
        return Some(g.apply(Op::Abs, &[x]));
    }
    let Node::Apply(Op::Mul, [p, q, _]) = g.node(other) else { return None };
    let factor = if p == x {
        q
    } else if q == x {
        p
    } else {
        return None;
    };
    let abs = g.apply(Op::Abs, &[x]);
    Some(g.apply(Op::Mul, &[factor, abs]))
}

fn divide(g: &mut Graph, a: ExprId, b: ExprId) -> Option<ExprId> {
    if is(g, b, 1.0) {
        return Some(a);
    }
    if is(g, a, 0.0) {
        return Some(a);
    }
    if let Some(n) = negated(g, a) {
        let q = g.apply(Op::Div, &[n, b]);
        return Some(g.apply(Op::Neg, &[q]));
    }
    // division by a power of two is exact as a product, and a product is faster
    let k = g.constant(b)?;
    let exact = k.is_normal() && k.to_bits() & ((1 << 52) - 1) == 0 && (1.0 / k).is_normal();
    exact.then(|| {
        let inverse = g.number(1.0 / k);
        g.apply(Op::Mul, &[inverse, a])
    })
}

fn power(g: &mut Graph, a: ExprId, b: ExprId) -> Option<ExprId> {
    let n = g.constant(b)?;
    if n == 0.5 {
        return Some(g.apply(Op::Sqrt, &[a]));
    }
    // greatest integer exponent that is written out as products
    if n.fract() != 0.0 || n.abs() > 64.0 {
        return None;
    }
    if n == 0.0 {
        return Some(g.number(1.0));
    }
    let mut rest = n.abs() as u32;
    let (mut square, mut product) = (a, None);
    while rest > 0 {
        if rest & 1 == 1 {
            product = Some(product.map_or(square, |p| g.apply(Op::Mul, &[p, square])));
        }
        rest >>= 1;
        if rest > 0 {
            square = g.apply(Op::Mul, &[square, square]);
        }
    }
    let product = product?;
    if n > 0.0 {
        return Some(product);
    }
    let one = g.number(1.0);
    Some(g.apply(Op::Div, &[one, product]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Leaf;

    #[test]
    fn derivative_of_x_abs_x_is_two_abs_x() {
        let mut g = Graph::default();
        let (x, c) = (g.leaf(Leaf::State(0)), g.leaf(Leaf::Param(0)));
        let cx = g.apply(Op::Mul, &[c, x]);
        let (abs, sign) = (g.apply(Op::Abs, &[x]), g.apply(Op::Sign, &[x]));
        let left = g.apply(Op::Mul, &[c, abs]);
        let right = g.apply(Op::Mul, &[cx, sign]);
        assert_eq!(left, right);
        let sum = g.apply(Op::Add, &[left, right]);
        assert!(matches!(g.node(sum), Node::Apply(Op::Mul, [k, rest, _]) if is(&g, k, 2.0) && rest == left));
    }

    #[test]
    fn powers_are_products() {
        let mut g = Graph::default();
        let x = g.leaf(Leaf::State(0));
        for n in [-3.0, -1.0, 0.0, 1.0, 2.0, 7.0, 64.0, 0.5, 1.7] {
            let k = g.number(n);
            let e = g.apply(Op::Pow, &[x, k]);
            let (got, want) = (g.evaluate(e, |_| 1.3), 1.3_f64.powf(n));
            assert!((got - want).abs() < 1e-14 * want.abs(), "{n}: {got} {want}");
        }
    }
}
