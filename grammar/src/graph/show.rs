//! Prints expressions in the language's own notation.

use super::{Graph, Leaf, Node};
use crate::op::{ExprId, Form, Op};

/// Names for leaves.
pub trait Names {
    /// How a leaf is written.
    fn leaf(&self, leaf: Leaf) -> String;
}

/// Texts longer than this are cut: a derivative can be longer than anybody reads.
const LONGEST: usize = 4000;

fn strength(op: Op) -> u8 {
    match op {
        Op::Select => 0,
        Op::Less | Op::LessEqual | Op::Equal => 1,
        Op::Add | Op::Sub => 2,
        Op::Mul | Op::Div => 3,
        Op::Neg => 4,
        Op::Pow => 5,
        _ => 9,
    }
}

/// The expression as text, without recursion; shared parts are written wherever they are used, and the text
/// is cut with `...` when it grows too long.
pub fn show(graph: &Graph, e: ExprId, names: &dyn Names) -> String {
    enum Part {
        Text(&'static str),
        Expr(ExprId, u8),
    }
    let mut out = String::new();
    let mut parts = vec![Part::Expr(e, 0)];
    while let Some(part) = parts.pop() {
        if out.len() > LONGEST {
            return out + "...";
        }
        match part {
            Part::Text(t) => out.push_str(t),
            Part::Expr(e, least) => match graph.node(e) {
                Node::Constant(bits) => out.push_str(&f64::from_bits(bits).to_string()),
                Node::Leaf(leaf) => out.push_str(&names.leaf(leaf)),
                Node::Apply(op, args) => {
                    let (row, own) = (op.row(), strength(op));
                    let bracket = row.form != Form::Function && own < least;
                    if bracket {
                        out.push('(');
                        parts.push(Part::Text(")"));
                    }
                    match row.form {
                        Form::Prefix => {
                            out.push_str(row.name);
                            parts.push(Part::Expr(args[0], own));
                        }
                        Form::Infix => {
                            parts.push(Part::Expr(args[1], own + 1));
                            let spaced = own < 3;
                            parts.push(Part::Text(if spaced { " " } else { "" }));
                            parts.push(Part::Text(row.name));
                            parts.push(Part::Text(if spaced { " " } else { "" }));
                            parts.push(Part::Expr(args[0], own + u8::from(op == Op::Pow)));
                        }
                        Form::Function => {
                            out.push_str(row.name);
                            out.push('(');
                            parts.push(Part::Text(")"));
                            for (k, a) in args[..row.arity].iter().enumerate().rev() {
                                parts.push(Part::Expr(*a, 0));
                                if k > 0 {
                                    parts.push(Part::Text(", "));
                                }
                            }
                        }
                        Form::Choice => {
                            out.push_str("if ");
                            let texts = [" then ", " else "];
                            for k in (0..3).rev() {
                                parts.push(Part::Expr(args[k], 1));
                                if k > 0 {
                                    parts.push(Part::Text(texts[k - 1]));
                                }
                            }
                        }
                    }
                }
            },
        }
    }
    out
}
