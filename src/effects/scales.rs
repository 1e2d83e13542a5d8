//! What only the data know, asked for by name: sizes of signals, the sampling step, the length of the record.

use super::subject::Subject;
use fdm_grammar::syntax::{BinarySign, Expr, ExprRef, SyntaxTree, UnarySign};
use std::collections::HashMap;

/// The value of a signal at the first sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Beginning {
    /// One value in every run.
    Same(f64),
    /// Another in each; a typical one.
    Varies(f64),
}

/// Answers about records and responses, in the units of the model. Signals are inputs, states (of the fitted model) and
/// outputs, by name.
pub trait Scales {
    /// The quantile `q` in [0, 1] of the magnitude of a signal about its middle; 1 asks for the largest.
    fn size(&self, signal: &str, q: f64) -> f64;
    /// The quantile `q` of the magnitude of a signal's rate of change.
    fn speed(&self, signal: &str, q: f64) -> f64;
    /// The quantile `q` in [0, 1] of the values of a signal; 0 asks for the least, 1 for the greatest.
    fn level(&self, signal: &str, q: f64) -> f64;
    /// Value of a signal at the first sample.
    fn beginning(&self, signal: &str) -> Beginning;
    /// Sampling interval, in the model's unit of time.
    fn step(&self) -> f64;
    /// Length of the longest run, in the model's unit of time.
    fn duration(&self) -> f64;
}

/// No data at all: signals between 0 and 1 of speed 1 that begin at 0, a hundred samples a unit of time, ten units long.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nominal;

impl Scales for Nominal {
    fn size(&self, _signal: &str, q: f64) -> f64 {
        q.max(0.01)
    }

    fn speed(&self, _signal: &str, q: f64) -> f64 {
        q.max(0.01)
    }

    fn level(&self, _signal: &str, q: f64) -> f64 {
        q
    }

    fn beginning(&self, _signal: &str) -> Beginning {
        Beginning::Same(0.0)
    }

    fn step(&self) -> f64 {
        0.01
    }

    fn duration(&self) -> f64 {
        10.0
    }
}

/// Functions that ask for something, with the numbers of their arguments.
pub(super) const REQUESTS: &[(&str, usize, &str)] = &[
    ("scale", 2, "scale(x, fraction)"),
    ("size", 1, "size(x)"),
    ("quantile", 2, "quantile(x, q)"),
    ("speed", 2, "speed(x, q)"),
    ("level", 2, "level(x, q)"),
    ("positive", 1, "positive(x)"),
    ("absolute_zero", 1, "absolute_zero(x)"),
    ("start", 1, "start(x)"),
    ("grid", 3, "grid(a, b, n)"),
];
/// What stands for a product of species in an equation, with the numbers of their arguments.
pub(super) const SPECIES: &[(&str, usize, &str)] = &[("consumed", 1, "consumed(p)"), ("made", 1, "made(p)")];
/// Names that ask for something.
pub(super) const NAMED_REQUESTS: &[&str] = &["step", "duration"];
/// A fitted response may undershoot zero by this part of its greatest value.
const NEARLY_ZERO: f64 = 0.01;
/// Most values of one grid.
const MOST_VALUES: usize = 100;

/// Answers the requests of one place: `bound` leads from slots to the user's names, `known` holds what has been valued, the
/// subject knows the units of the user's names.
pub(super) struct Answers<'a> {
    pub(super) pool: &'a SyntaxTree,
    pub(super) bound: &'a HashMap<String, String>,
    pub(super) known: &'a HashMap<String, f64>,
    pub(super) scales: &'a dyn Scales,
    pub(super) subject: Option<&'a Subject>,
}

impl Answers<'_> {
    /// The values of a list such as `a, 2*b, grid(c, d, 4)`.
    pub(super) fn list(&self, list: &[ExprRef]) -> Vec<f64> {
        let mut values = Vec::new();
        for e in list {
            match self.pool.expr(*e) {
                Expr::Call(name, arguments) if name.text == "grid" && arguments.len() == 3 => {
                    let [a, b, n] = [0, 1, 2].map(|k| self.value(arguments[k]).unwrap_or(f64::NAN));
                    values.extend(geometric(a, b, n));
                }
                _ => values.extend(self.value(*e)),
            }
        }
        values.retain(|v| !v.is_nan());
        values.truncate(MOST_VALUES);
        values
    }

    /// One value; `None` when it is not made of numbers and requests.
    pub(super) fn value(&self, root: ExprRef) -> Option<f64> {
        // operands stand before the expressions that use them, and the pool of an effect is small
        let mut values: Vec<Option<f64>> = Vec::with_capacity(root.0 as usize + 1);
        for k in 0..=root.0 {
            let value = self.node(ExprRef(k), &values);
            values.push(value);
        }
        values[root.0 as usize]
    }

    /// The greatest value of a signal that is never below zero; `None` where it is.
    pub(super) fn greatest_of_positive(&self, signal: &str) -> Option<f64> {
        let [least, greatest] = [0.0, 1.0].map(|q| self.scales.level(signal, q));
        (greatest > 0.0 && least >= -NEARLY_ZERO * greatest).then_some(greatest)
    }

    /// Where the absolute zero of temperature is in the unit of a signal; 0 in a unit whose zero is its own.
    fn absolute_zero(&self, signal: &str) -> f64 {
        let unit = self.subject.and_then(|subject| subject.unit(signal));
        unit.filter(|unit| unit.offset != 0.0).map_or(0.0, |unit| -unit.offset / unit.factor)
    }

    fn node(&self, e: ExprRef, values: &[Option<f64>]) -> Option<f64> {
        let at = |e: &ExprRef| values[e.0 as usize];
        Some(match self.pool.expr(e) {
            Expr::Number(v) => *v,
            Expr::Name(name) => match name.as_str() {
                "inf" => f64::INFINITY,
                "pi" => std::f64::consts::PI,
                "step" if !self.known.contains_key(name) => self.scales.step(),
                "duration" if !self.known.contains_key(name) => self.scales.duration(),
                _ => *self.known.get(name)?,
            },
            Expr::Unary(UnarySign::Minus, a) => -at(a)?,
            Expr::Unary(_, a) => at(a)?,
            Expr::Binary(sign, a, b, _) => {
                let (a, b) = (at(a)?, at(b)?);
                match sign {
                    BinarySign::Add => a + b,
                    BinarySign::Subtract => a - b,
                    BinarySign::Multiply => a * b,
                    BinarySign::Divide => a / b,
                    BinarySign::Power => fdm_grammar::math::pow(a, b),
                    _ => return None,
                }
            }
            Expr::Call(name, arguments) => {
                let signal = |k: usize| match self.pool.expr(*arguments.get(k)?) {
                    Expr::Name(slot) => self.bound.get(slot).map(String::as_str),
                    _ => None,
                };
                let number = |k: usize| at(arguments.get(k)?);
                match name.text.as_str() {
                    "scale" => self.scales.size(signal(0)?, 1.0) * number(1)?,
                    "size" => self.scales.size(signal(0)?, 1.0),
                    "quantile" => self.scales.size(signal(0)?, number(1)?.clamp(0.0, 1.0)),
                    "speed" => self.scales.speed(signal(0)?, number(1)?.clamp(0.0, 1.0)),
                    "level" => self.scales.level(signal(0)?, number(1)?.clamp(0.0, 1.0)),
                    "positive" => self.greatest_of_positive(signal(0)?)?,
                    "absolute_zero" => self.absolute_zero(signal(0)?),
                    "min" => number(0)?.min(number(1)?),
                    "max" => number(0)?.max(number(1)?),
                    "sqrt" => number(0)?.sqrt(),
                    _ => return None,
                }
            }
            _ => return None,
        })
    }
}

/// `n` values from `a` to `b`, each the same multiple of the one before.
fn geometric(a: f64, b: f64, n: f64) -> Vec<f64> {
    let n = if n.is_finite() { (n.round().max(1.0) as usize).min(MOST_VALUES) } else { 1 };
    if n == 1 || !(a > 0.0 && b > 0.0 && a.is_finite() && b.is_finite()) {
        return vec![a];
    }
    let ratio = (b / a).ln() / (n - 1) as f64;
    (0..n).map(|k| a * (ratio * k as f64).exp()).collect()
}

/// A number that came from data, with the digits that a reader wants to see.
pub(super) fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod unit {
    use super::*;

    #[test]
    fn grids_are_geometric_and_numbers_short() {
        let values: Vec<f64> = geometric(0.1, 10.0, 3.0).into_iter().map(rounded).collect();
        assert_eq!(values, [0.1, 1.0, 10.0]);
        assert_eq!((rounded(0.0123456), rounded(f64::INFINITY)), (0.0123, f64::INFINITY));
        assert_eq!(geometric(0.0, 1.0, 5.0).len(), 1);
    }
}
