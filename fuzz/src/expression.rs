//! Expressions with a meaning of their own, to be compared with what the compiler makes of their text.

use arbitrary::{Result, Unstructured};
use fdm_grammar::math;

/// The names that expressions are made of: states, an input, parameters, the time.
pub const LEAVES: [&str; 6] = ["x1", "x2", "u", "a", "b", "t"];

const NUMBERS: [f64; 10] = [0.0, 1.0, 2.0, 0.5, 3.0, 10.0, 1e-3, 1e6, 0.1, 7.25];
const ONE: [&str; 15] =
    ["sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "log10", "sqrt", "abs", "sign"];
const TWO: [&str; 4] = ["atan2", "min", "max", "hypot"];
const SIGNS: [&str; 5] = ["+", "-", "*", "/", "^"];
const COMPARISONS: [&str; 6] = ["<", ">", "<=", ">=", "==", "!="];

/// An expression.
#[derive(Debug, Clone)]
pub enum Expression {
    /// One of the usual numbers.
    Number(f64),
    /// One of [`LEAVES`].
    Leaf(usize),
    /// `-a`
    Minus(Box<Expression>),
    /// `a + b` and its like.
    Sign(&'static str, Box<[Expression; 2]>),
    /// A function.
    Call(&'static str, Vec<Expression>),
    /// `if a < b then c else d`
    If(&'static str, Box<[Expression; 4]>),
}

use Expression::*;

impl Expression {
    /// An expression of at most `size` parts.
    ///
    /// # Errors
    /// When the bytes end.
    pub fn arbitrary(u: &mut Unstructured<'_>, size: usize) -> Result<Self> {
        if size < 2 {
            return Ok(if u.ratio(1, 3)? { Number(*u.choose(&NUMBERS)?) } else { Leaf(u.choose_index(LEAVES.len())?) });
        }
        let part = |u: &mut Unstructured<'_>, share: usize| Self::arbitrary(u, (size - 1) / share);
        Ok(match u.int_in_range(0..=11)? {
            0..=5 => Sign(u.choose(&SIGNS)?, Box::new([part(u, 2)?, part(u, 2)?])),
            6 => Minus(Box::new(part(u, 1)?)),
            7 | 8 => Call(u.choose(&ONE)?, vec![part(u, 1)?]),
            9 => Call(u.choose(&TWO)?, vec![part(u, 2)?, part(u, 2)?]),
            10 => match u.arbitrary()? {
                true => Call("clip", vec![part(u, 3)?, part(u, 3)?, part(u, 3)?]),
                false => Call("deadzone", vec![part(u, 2)?, part(u, 2)?]),
            },
            _ => If(u.choose(&COMPARISONS)?, Box::new([part(u, 4)?, part(u, 4)?, part(u, 4)?, part(u, 4)?])),
        })
    }

    /// As a user would write it.
    pub fn text(&self) -> String {
        match self {
            Number(v) => v.to_string(),
            Leaf(k) => LEAVES[*k].into(),
            Minus(a) => format!("(-{})", a.text()),
            Sign(sign, pair) => format!("({} {sign} {})", pair[0].text(), pair[1].text()),
            Call(name, args) => format!("{name}({})", args.iter().map(Self::text).collect::<Vec<_>>().join(", ")),
            If(sign, parts) => {
                let [a, b, c, d] = &**parts;
                format!("(if {} {sign} {} then {} else {})", a.text(), b.text(), c.text(), d.text())
            }
        }
    }

    /// Whether everything on the way to its value is finite: infinity times nothing has no value to compare.
    pub fn is_finite(&self, leaves: &[f64; LEAVES.len()]) -> bool {
        let fine = |e: &Self| e.is_finite(leaves);
        let v = |e: &Self| e.value(leaves, 0.0, 0.0);
        let parts = match self {
            Number(_) | Leaf(_) => true,
            Minus(a) => fine(a),
            Sign(_, pair) => pair.iter().all(fine),
            Call(_, args) => args.iter().all(fine),
            If(_, parts) => parts.iter().all(fine),
        };
        parts && v(self).is_finite()
    }

    /// What it is worth, computed in the order of the text, simplified by nothing; every zero on the way is this one, and every
    /// result is off by a relative `rounding`.
    pub fn value(&self, leaves: &[f64; LEAVES.len()], zero: f64, rounding: f64) -> f64 {
        let v = |e: &Self| e.value(leaves, zero, rounding);
        let found = match self {
            Number(value) => *value,
            Leaf(k) => leaves[*k],
            Minus(a) => -v(a),
            Sign(sign, pair) => {
                let (a, b) = (v(&pair[0]), v(&pair[1]));
                match *sign {
                    "+" => a + b,
                    "-" => a - b,
                    "*" => a * b,
                    "/" => a / b,
                    _ => math::pow(a, b),
                }
            }
            Call(name, args) => call(name, &args.iter().map(v).collect::<Vec<_>>()),
            If(sign, parts) => {
                let [a, b, c, d] = &**parts;
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
        };
        match self {
            _ if found == 0.0 => zero,
            Sign(..) | Call(..) => found * (1.0 + rounding),
            _ => found,
        }
    }
}

fn call(name: &str, args: &[f64]) -> f64 {
    let (a, b) = (args[0], args.get(1).copied().unwrap_or(f64::NAN));
    match name {
        "sin" => math::sin(a),
        "cos" => math::cos(a),
        "tan" => math::tan(a),
        "asin" => math::asin(a),
        "acos" => math::acos(a),
        "atan" => math::atan(a),
        "sinh" => math::sinh(a),
        "cosh" => math::cosh(a),
        "tanh" => math::tanh(a),
        "exp" => math::exp(a),
        "log" => math::log(a),
        "log10" => math::log10(a),
        "sqrt" => a.sqrt(),
        "abs" => a.abs(),
        "sign" => math::sign(a),
        "atan2" => math::atan2(a, b),
        "hypot" => math::hypot(a, b),
        "min" => math::min(a, b),
        "max" => math::max(a, b),
        "clip" => math::min(math::max(a, b), args[2]),
        _ => math::max(a - b, 0.0) + math::min(a + b, 0.0),
    }
}
