//! Prints expressions in the language's own notation.

use super::{Graph, Leaf, Node};
use super::{call as call_of, elements};
use crate::op::{ExprId, Form, Op};

/// Names for leaves.
pub trait Names {
    /// How a leaf is written.
    fn leaf(&self, leaf: Leaf) -> String;
}

/// What binds more strongly than everything.
const ATOM: u8 = 9;
const POWER: u8 = 8;
const PRODUCT: u8 = 6;
const MINUS: u8 = 5;
const SUM: u8 = 4;
const RELATION: u8 = 2;

enum Part {
    Text(String),
    /// An expression that needs brackets when it binds less strongly than this.
    Expr(ExprId, u8),
    /// A power with a whole exponent, of a factor that stands several times in a product.
    Power(ExprId, usize),
}

/// The expression as people write it, without recursion: sums and products without brackets that mean nothing, repeated factors as
/// powers. Shared parts are written wherever they are used, and the text is cut with `...` when it grows too long.
pub fn show(graph: &Graph, e: ExprId, names: &dyn Names) -> String {
    let mut out = String::new();
    let mut parts = vec![Part::Expr(e, 0)];
    while let Some(part) = parts.pop() {
        // texts longer than this are cut: a derivative can be longer than anybody reads
        if out.len() > 4000 {
            return out + "...";
        }
        let from = parts.len();
        match part {
            Part::Text(text) => out.push_str(&text),
            Part::Power(e, exponent) => {
                parts.extend([Part::Expr(e, ATOM), Part::Text(format!("^{exponent}"))]);
            }
            Part::Expr(e, least) => {
                let bracket = strength(graph, e) < least;
                parts.extend(bracket.then(|| Part::Text("(".into())));
                match graph.node(e) {
                    Node::Constant(bits) => parts.push(Part::Text(number(f64::from_bits(bits)))),
                    Node::Leaf(leaf) => parts.push(Part::Text(names.leaf(leaf))),
                    Node::Apply(op, _) => apply(graph, e, op, &mut parts),
                }
                parts.extend(bracket.then(|| Part::Text(")".into())));
            }
        }
        // what was found is written from its beginning
        parts[from..].reverse();
    }
    out
}

/// How strongly what is written for an expression binds.
fn strength(graph: &Graph, e: ExprId) -> u8 {
    match graph.node(e) {
        Node::Constant(bits) if f64::from_bits(bits).is_sign_negative() => MINUS,
        Node::Constant(_) | Node::Leaf(_) => ATOM,
        Node::Apply(op, _) => match op {
            Op::Select => 0,
            Op::Less | Op::LessEqual | Op::Equal => RELATION,
            Op::Add | Op::Sub => SUM,
            Op::Neg => MINUS,
            Op::Mul if factors(graph, e).len() == 1 => POWER,
            Op::Mul | Op::Div => PRODUCT,
            Op::Pow => POWER,
            _ => ATOM,
        },
    }
}

/// The parts of an operation in the order in which they are written.
fn apply(graph: &Graph, e: ExprId, op: Op, parts: &mut Vec<Part>) {
    let (row, operands) = (op.row(), graph.operands(e));
    let text = |text: &str| Part::Text(text.into());
    match (row.form, operands) {
        (_, [a, b]) if matches!(op, Op::Add | Op::Sub) => {
            parts.push(Part::Expr(*a, SUM));
            // plus minus is minus, minus minus is plus
            let (sign, b) = match graph.node(*b) {
                Node::Apply(Op::Neg, args) => (if op == Op::Add { " - " } else { " + " }, args[0]),
                _ => (if op == Op::Add { " + " } else { " - " }, *b),
            };
            parts.push(text(sign));
            let kept = sign == " + " && matches!(graph.node(b), Node::Apply(Op::Add | Op::Sub, _));
            parts.push(Part::Expr(b, if kept { SUM } else { PRODUCT }));
        }
        (_, _) if op == Op::Mul => {
            for (k, (factor, times)) in factors(graph, e).into_iter().enumerate() {
                parts.extend((k > 0).then(|| text("*")));
                parts.push(if times > 1 { Part::Power(factor, times) } else { Part::Expr(factor, PRODUCT) });
            }
        }
        (Form::Prefix, _) => parts.extend([text(row.name), Part::Expr(operands[0], PRODUCT)]),
        (Form::Infix, [a, b]) => {
            let (left, right, sign) = match op {
                Op::Div => (PRODUCT, PRODUCT + 1, "/".to_string()),
                Op::Pow => (ATOM, POWER, "^".to_string()),
                _ => (SUM, SUM, format!(" {} ", row.name)),
            };
            parts.extend([Part::Expr(*a, left), Part::Text(sign), Part::Expr(*b, right)]);
        }
        (Form::Choice, [condition, a, b]) => {
            parts.extend([text("if "), Part::Expr(*condition, RELATION), text(" then "), Part::Expr(*a, RELATION)]);
            parts.extend([text(" else "), Part::Expr(*b, RELATION)]);
        }
        (Form::External, _) if op.is_external() => call(graph, e, op, parts),
        _ => {
            parts.push(Part::Text(format!("{}(", row.name)));
            for (k, a) in operands.iter().enumerate() {
                parts.extend((k > 0).then(|| text(", ")));
                parts.push(Part::Expr(*a, 0));
            }
            parts.push(text(")"));
        }
    }
}

/// A function of foreign code: its name, its arguments, behind a bar the direction of a derivative.
fn call(graph: &Graph, e: ExprId, op: Op, parts: &mut Vec<Part>) {
    let Node::Apply(_, args) = graph.node(e) else { return };
    let Some((function, lists)) = call_of(graph, op, args) else { return };
    parts.push(Part::Text(format!("{function:?}(")));
    for (k, list) in lists.into_iter().enumerate() {
        parts.extend((k > 0).then(|| Part::Text(" | ".into())));
        for (k, element) in elements(graph, list).into_iter().rev().enumerate() {
            parts.extend((k > 0).then(|| Part::Text(", ".into())));
            parts.push(Part::Expr(element, 0));
        }
    }
    parts.push(Part::Text(")".into()));
}

/// The factors of a product, each once with its number: numbers first, then in their order; products in it are part of it.
fn factors(graph: &Graph, e: ExprId) -> Vec<(ExprId, usize)> {
    let mut found: Vec<(ExprId, usize)> = Vec::new();
    let (mut waiting, mut count) = (vec![e], 0);
    while let Some(e) = waiting.pop() {
        match graph.node(e) {
            // factors of a product that are looked at together
            Node::Apply(Op::Mul, args) if count + waiting.len() < 64 => waiting.extend([args[1], args[0]]),
            _ => {
                count += 1;
                match found.iter_mut().find(|(factor, _)| *factor == e) {
                    Some((_, times)) => *times += 1,
                    None => found.push((e, 1)),
                }
            }
        }
    }
    found.sort_by_key(|(factor, _)| graph.constant(*factor).is_none());
    found
}

/// In the shortest form that comes back.
fn number(value: f64) -> String {
    let text = format!("{value:?}");
    text.strip_suffix(".0").unwrap_or(&text).to_string()
}

#[cfg(test)]
mod tests {
    use crate::{Source, compile};

    fn shown(expression: &str) -> String {
        let text = format!("model m {{ state a, b, c; der(a) = 0; der(b) = 0; der(c) = 0; output y = {expression}; }}");
        let compiled = compile(&Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}"));
        super::show(&compiled.model.graph, compiled.model.outputs[0].expr, &compiled.model)
    }

    #[test]
    fn brackets_stand_only_where_they_mean_something() {
        for text in [
            "a - (b + c)",
            "a - (b - c)",
            "a + b - c",
            "a/(b*c)",
            "a/b/c",
            "(a + b)*c",
            "-a*b",
            "-(a + b)",
            "a^2*b",
            "(a*b)^c",
            "a^b^c",
            "(a^b)^c",
            "(-a)^2.5",
            "a^(-b)",
            "if a < b then a else b + 1",
            "sin(a + b)",
            "1e-9*a",
            "a^4",
            "(if a < b then a else b) + 1",
            "a - b*c",
            "2*a^3 - 1e300*b",
            "max(a, -b)",
            "a*(-b)",
        ] {
            let written = shown(text);
            assert_eq!(shown(&written), written, "what is printed for {text} means something else");
            let same = [text, "-a^2.5", "-a*b"].contains(&written.as_str());
            assert!(same || written.len() <= text.len(), "{text} became {written}");
        }
        assert_eq!(shown("a*(b*(a*c))"), "a^2*b*c");
        assert_eq!(shown("a + (b + (c - a))"), "a + b + c - a");
        assert_eq!(shown("a - (-b)"), "a + b");
    }

    #[test]
    fn a_square_of_squares_stays_short() {
        let mut text = String::from("(a*b + c)");
        (0..30).for_each(|_| text = format!("({text})^2"));
        let shown = shown(&text);
        assert!(shown.len() < 5000, "{shown}");
    }
}
