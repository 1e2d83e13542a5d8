//! Expressions of SBML and PEtab, and how fdm's language writes them.
//!
//! Names of SBML and PEtab as the language may declare them.

use fdm_grammar::check::reserved;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// An expression; conditions are expressions too.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Expr {
    Number(f64),
    Name(String),
    /// Time of the experiment.
    Time,
    True,
    False,
    Minus(Box<Expr>),
    Not(Box<Expr>),
    Binary(Sign, Box<Expr>, Box<Expr>),
    /// A function of the language by its name there.
    Call(&'static str, Vec<Expr>),
    /// The first branch whose condition (second) holds, or what stands behind all.
    If(Vec<(Expr, Expr)>, Box<Expr>),
    /// A function that the text itself defines, until it is written out.
    Apply(String, Vec<Expr>),
}

/// A sign between two operands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sign {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Less,
    AtMost,
    Greater,
    AtLeast,
    Equal,
    Unequal,
    And,
    Or,
}

impl Sign {
    fn text(self) -> &'static str {
        match self {
            Self::Add => " + ",
            Self::Subtract => " - ",
            Self::Multiply => "*",
            Self::Divide => "/",
            Self::Power => "^",
            Self::Less => " < ",
            Self::AtMost => " <= ",
            Self::Greater => " > ",
            Self::AtLeast => " >= ",
            Self::Equal => " == ",
            Self::Unequal => " != ",
            Self::And => " and ",
            Self::Or => " or ",
        }
    }

    /// How strongly it binds.
    fn strength(self) -> u8 {
        match self {
            Self::Or => 1,
            Self::And => 2,
            Self::Less | Self::AtMost | Self::Greater | Self::AtLeast | Self::Equal | Self::Unequal => 4,
            Self::Add | Self::Subtract => 5,
            Self::Multiply | Self::Divide => 6,
            Self::Power => 8,
        }
    }

    /// Whether it makes a number of two.
    fn is_arithmetic(self) -> bool {
        matches!(self, Self::Add | Self::Subtract | Self::Multiply | Self::Divide | Self::Power)
    }

    /// Whether it compares two numbers by their size.
    pub(crate) fn is_order(self) -> bool {
        matches!(self, Self::Less | Self::AtMost | Self::Greater | Self::AtLeast)
    }
}

/// Deepest nesting of what is read; the language itself ends at 256.
pub(crate) const DEEPEST: usize = 200;
/// Most signs of one expression, which nest where they stand in a row.
pub(crate) const LONGEST: usize = 10_000;

/// Shorthand for an operand pair.
pub(crate) fn binary(sign: Sign, a: Expr, b: Expr) -> Expr {
    Expr::Binary(sign, Box::new(a), Box::new(b))
}

pub(crate) fn name(text: &str) -> Expr {
    Expr::Name(text.into())
}

/// `a*b`, without factors of 1.
pub(crate) fn times(a: Expr, b: Expr) -> Expr {
    match (a, b) {
        (Expr::Number(1.0), x) | (x, Expr::Number(1.0)) => x,
        (Expr::Minus(one), x) if *one == Expr::Number(1.0) => Expr::Minus(Box::new(x)),
        (a, b) => binary(Sign::Multiply, a, b),
    }
}

/// A number as the language reads it back to the bit.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-4..1e7).contains(&size) { format!("{value:e}") } else { format!("{value}") }
}

impl Expr {
    /// Calls `each` with every part, the whole first.
    pub(crate) fn walk<'a>(&'a self, each: &mut dyn FnMut(&'a Expr)) {
        each(self);
        match self {
            Self::Number(_) | Self::Name(_) | Self::Time | Self::True | Self::False => {}
            Self::Minus(a) | Self::Not(a) => a.walk(each),
            Self::Binary(_, a, b) => {
                a.walk(each);
                b.walk(each);
            }
            Self::Call(_, list) | Self::Apply(_, list) => list.iter().for_each(|a| a.walk(each)),
            Self::If(branches, otherwise) => {
                branches.iter().for_each(|(value, condition)| {
                    value.walk(each);
                    condition.walk(each);
                });
                otherwise.walk(each);
            }
        }
    }

    /// This expression with every part replaced for which `each` has something else, from the inside outwards.
    pub(crate) fn map(self, each: &mut dyn FnMut(Expr) -> Expr) -> Expr {
        let mut boxed = |e: Box<Expr>| Box::new(e.map(each));
        let whole = match self {
            Self::Minus(a) => Self::Minus(boxed(a)),
            Self::Not(a) => Self::Not(boxed(a)),
            Self::Binary(sign, a, b) => {
                let a = boxed(a);
                Self::Binary(sign, a, boxed(b))
            }
            Self::Call(name, list) => Self::Call(name, list.into_iter().map(|a| a.map(each)).collect()),
            Self::Apply(name, list) => Self::Apply(name, list.into_iter().map(|a| a.map(each)).collect()),
            Self::If(branches, otherwise) => {
                let branches = branches.into_iter().map(|(v, c)| (v.map(each), c.map(each))).collect();
                Self::If(branches, Box::new(otherwise.map(each)))
            }
            leaf => leaf,
        };
        each(whole)
    }

    /// Names in it.
    pub(crate) fn names(&self) -> BTreeSet<&str> {
        let mut found = BTreeSet::new();
        self.walk(&mut |e| {
            if let Self::Name(name) = e {
                found.insert(name.as_str());
            }
        });
        found
    }

    /// Whether time stands in it.
    pub(crate) fn has_time(&self) -> bool {
        let mut found = false;
        self.walk(&mut |e| found |= *e == Self::Time);
        found
    }

    /// Whether a function of this name is called in it.
    pub(crate) fn has_call(&self, function: &str) -> bool {
        let mut found = false;
        self.walk(&mut |e| found |= matches!(e, Self::Call(own, _) if *own == function));
        found
    }

    /// This expression with names replaced.
    pub(crate) fn with(self, replaced: &BTreeMap<String, Expr>) -> Expr {
        self.map(&mut |e| match &e {
            Self::Name(name) => replaced.get(name).cloned().unwrap_or(e),
            _ => e,
        })
    }

    /// Its value where names have values and time does not matter.
    pub(crate) fn value(&self, of: &dyn Fn(&str) -> Option<f64>) -> Option<f64> {
        Some(match self {
            Self::Number(v) => *v,
            Self::Name(name) => of(name)?,
            Self::Minus(a) => -a.value(of)?,
            Self::Binary(sign, a, b) => {
                let (a, b) = (a.value(of)?, b.value(of)?);
                match sign {
                    Sign::Add => a + b,
                    Sign::Subtract => a - b,
                    Sign::Multiply => a * b,
                    Sign::Divide => a / b,
                    Sign::Power => a.powf(b),
                    _ => return None,
                }
            }
            _ => return None,
        })
    }

    /// This expression where a number stands: a condition counts as 1 or 0 (SBML level 3 version 2, section 3.4.11).
    pub(crate) fn into_number(self) -> Expr {
        let number = |list: Vec<Expr>| list.into_iter().map(Self::into_number).collect();
        match self {
            Self::Binary(sign, a, b) if sign.is_arithmetic() => binary(sign, a.into_number(), b.into_number()),
            Self::True | Self::False | Self::Not(_) | Self::Binary(..) => {
                Self::If(vec![(Self::Number(1.0), self.into_condition())], Box::new(Self::Number(0.0)))
            }
            Self::Minus(a) => Self::Minus(Box::new(a.into_number())),
            Self::Call(name, list) => Self::Call(name, number(list)),
            Self::Apply(name, list) => Self::Apply(name, number(list)),
            Self::If(branches, otherwise) => {
                let branches = branches.into_iter().map(|(v, c)| (v.into_number(), c.into_condition())).collect();
                Self::If(branches, Box::new(otherwise.into_number()))
            }
            leaf => leaf,
        }
    }

    /// This expression where a condition stands: a number holds where it is not 0.
    pub(crate) fn into_condition(self) -> Expr {
        match self {
            Self::True | Self::False => self,
            Self::Not(a) => Self::Not(Box::new(a.into_condition())),
            Self::Binary(sign @ (Sign::And | Sign::Or), a, b) => binary(sign, a.into_condition(), b.into_condition()),
            Self::Binary(sign, a, b) if !sign.is_arithmetic() => binary(sign, a.into_number(), b.into_number()),
            number => binary(Sign::Unequal, number.into_number(), Self::Number(0.0)),
        }
    }

    /// Whether a comparison of numbers holds.
    pub(crate) fn truth(&self) -> Option<bool> {
        let Self::Binary(sign, a, b) = self else { return None };
        let (a, b) = (a.value(&|_| None)?, b.value(&|_| None)?);
        match sign {
            Sign::Less => Some(a < b),
            Sign::AtMost => Some(a <= b),
            Sign::Greater => Some(a > b),
            Sign::AtLeast => Some(a >= b),
            _ => None,
        }
    }

    /// This expression without a name that is a factor of all of its terms; `None` where it is not.
    pub(crate) fn without_factor(&self, factor: &str) -> Option<Expr> {
        match self {
            Self::Name(name) if name == factor => Some(Self::Number(1.0)),
            Self::Binary(Sign::Multiply, a, b) => match a.without_factor(factor) {
                Some(a) => Some(times(a, (**b).clone())),
                None => b.without_factor(factor).map(|b| times((**a).clone(), b)),
            },
            Self::Binary(Sign::Divide, a, b) => {
                a.without_factor(factor).map(|a| binary(Sign::Divide, a, (**b).clone()))
            }
            Self::Binary(sign @ (Sign::Add | Sign::Subtract), a, b) => {
                Some(binary(*sign, a.without_factor(factor)?, b.without_factor(factor)?))
            }
            Self::Minus(a) => a.without_factor(factor).map(|a| Self::Minus(Box::new(a))),
            _ => None,
        }
    }

    /// The text in the language; `time` is how time is written there.
    pub(crate) fn text(&self, time: &str) -> String {
        let mut out = String::new();
        self.write(&mut out, 0, time);
        out
    }

    fn write(&self, out: &mut String, outside: u8, time: &str) {
        let own = match self {
            Self::Binary(sign, ..) => sign.strength(),
            Self::Minus(_) => 5,
            Self::Not(_) => 3,
            Self::If(..) => 0,
            Self::Number(v) if v.is_sign_negative() => 5,
            _ => 9,
        };
        let enclosed = own < outside || own == 0 && outside > 0;
        if enclosed {
            out.push('(');
        }
        match self {
            Self::Number(v) => out.push_str(&number(*v)),
            Self::Name(name) => out.push_str(name),
            Self::Time => out.push_str(time),
            Self::True => out.push_str("(1 > 0)"),
            Self::False => out.push_str("(1 < 0)"),
            Self::Minus(a) => {
                out.push('-');
                a.write(out, 7, time);
            }
            Self::Not(a) => {
                out.push_str("not ");
                a.write(out, 9, time);
            }
            Self::Binary(sign, a, b) => {
                let (left, right) = match sign {
                    Sign::Power => (9, 9),
                    Sign::Subtract | Sign::Divide => (own, own + 1),
                    _ if own == 4 => (5, 5),
                    _ => (own, own),
                };
                a.write(out, left, time);
                out.push_str(sign.text());
                // a product or sum on the right keeps its own order of operations
                let right = match (&**b, sign) {
                    (Self::Binary(inner, ..), Sign::Multiply | Sign::Add) if inner.strength() == own => own + 1,
                    _ => right,
                };
                b.write(out, right, time);
            }
            Self::Call(name, list) => call(out, name, list, time),
            Self::Apply(name, list) => call(out, name, list, time),
            Self::If(branches, otherwise) => {
                for (value, condition) in branches {
                    out.push_str("if ");
                    condition.write(out, 1, time);
                    out.push_str(" then ");
                    value.write(out, 1, time);
                    out.push_str(" else ");
                }
                otherwise.write(out, if matches!(**otherwise, Self::If(..)) { 0 } else { 1 }, time);
            }
        }
        if enclosed {
            out.push(')');
        }
    }
}

fn call(out: &mut String, name: &str, list: &[Expr], time: &str) {
    let _ = write!(out, "{name}(");
    for (k, argument) in list.iter().enumerate() {
        if k > 0 {
            out.push_str(", ");
        }
        argument.write(out, 0, time);
    }
    out.push(')');
}

/// Names that are taken, and what became of those that could not be kept.
#[derive(Debug, Default)]
pub(crate) struct Names {
    taken: BTreeSet<String>,
    /// Names of the problem that are called differently in the model.
    pub(crate) renamed: BTreeMap<String, String>,
}

impl Names {
    /// A name of the problem: kept where the language allows it.
    pub(crate) fn keep(&mut self, id: &str) {
        let own = self.fresh(id);
        if own != id {
            self.renamed.insert(id.into(), own);
        }
    }

    /// What a name of the problem is called in the model.
    pub(crate) fn called<'a>(&'a self, id: &'a str) -> &'a str {
        self.renamed.get(id).map_or(id, String::as_str)
    }

    /// A name that nothing has yet, near to a wanted one.
    pub(crate) fn fresh(&mut self, wanted: &str) -> String {
        let mut plain: String =
            wanted.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '_' }).collect();
        if !plain.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            plain.insert(0, '_');
        }
        let free = |name: &str, taken: &BTreeSet<String>| reserved(name).is_none() && !taken.contains(name);
        let mut found = plain.clone();
        let mut k = 0;
        while !free(&found, &self.taken) {
            k += 1;
            found = if k == 1 { format!("{plain}_") } else { format!("{plain}_{k}") };
        }
        self.taken.insert(found.clone());
        found
    }
}

#[cfg(test)]
mod tests {
    use crate::formula::formula;

    #[test]
    fn what_is_written_means_what_was_read() {
        let cases = [
            ("a - (b - c)", "a - (b - c)"),
            ("(a - b) - c", "a - b - c"),
            ("a/(b*c)", "a/(b*c)"),
            ("a*(b/c)", "a*(b/c)"),
            ("-x^2", "-x^2"),
            ("(-x)^2", "(-x)^2"),
            ("2^-3", "2^(-3)"),
            ("(a^b)^c", "(a^b)^c"),
            ("a^b^c", "a^(b^c)"),
            ("a**2", "a^2"),
            ("1e-9*a", "1e-9*a"),
            ("ln(x) + log10(y) + log2(z)", "log(x) + log10(y) + log(z)/log(2)"),
            ("pow(a + 1, 2)", "(a + 1)^2"),
            ("piecewise(a, t < 3, b) + 1", "(if t < 3 then a else b) + 1"),
            ("!(a > 1 || b > 1 && c > 1)", "not (a > 1 or b > 1 and c > 1)"),
        ];
        for (read, written) in cases {
            let read = formula(read).map(|e| e.text("t"));
            assert_eq!(read.as_deref(), Ok(written));
        }
    }

    #[test]
    fn conditions_are_numbers_and_numbers_conditions_where_they_stand_so() {
        let cases = [
            ("2 + (a > 1)", "2 + (if a > 1 then 1 else 0)"),
            ("piecewise(a, b, 3)", "if b != 0 then a else 3"),
            ("(a > 1) == (b > 1)", "if (if a > 1 then 1 else 0) == (if b > 1 then 1 else 0) then 1 else 0"),
            ("a - b*c", "a - b*c"),
        ];
        for (read, written) in cases {
            assert_eq!(formula(read).map(|e| e.into_number().text("t")).as_deref(), Ok(written));
        }
        assert_eq!(formula("a > 1").map(|e| e.into_condition().text("t")).as_deref(), Ok("a > 1"));
    }

    #[test]
    fn a_volume_is_cancelled_where_it_is_a_factor() {
        let rate = |text: &str| formula(text).ok().and_then(|e| e.without_factor("V")).map(|e| e.text("t"));
        assert_eq!(rate("V*k*A").as_deref(), Some("k*A"));
        assert_eq!(rate("k*A*V - V*r").as_deref(), Some("k*A - r"));
        assert_eq!(rate("k*A/(1 + V)"), None);
        assert_eq!(rate("-V*k").as_deref(), Some("-k"));
    }
}
