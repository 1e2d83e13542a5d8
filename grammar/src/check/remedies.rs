//! What mends a disagreement of units: a conversion, a factor, a unit for a number of the text.
//!
//! Equations and outputs whose units cannot be checked: told once for each name that lacks a unit.

use super::measures::{Measure, six_digits};
use super::scope::{Scope, SymbolId};
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{BinarySign, Expr, ExprRef, SyntaxTree};
use crate::unit::Unit;

/// How a quantity in `got` becomes one in `wanted`, or what separates them.
pub(super) fn conversion(wanted: &Unit, got: &Unit) -> Option<String> {
    let is = |a: Option<Unit>, b: &Unit| a.is_some_and(|a| a.same_size(b));
    if is(got.degree_to_radian(), wanted) {
        return Some(format!("`deg2rad(...)` converts {got} to {wanted}"));
    }
    if is(wanted.degree_to_radian(), got) {
        return Some(format!("`rad2deg(...)` converts {got} to {wanted}"));
    }
    let between = wanted.quotient(got)?;
    Some(match got.conversion(wanted) {
        Some((scale, _)) => format!("convert with a constant, `const c = {} [{between}];`", decimal(scale)),
        None => format!("a factor in {between} lies between them"),
    })
}

/// What is missing where a function wants a pure number or an angle, and its argument is in `unit`.
pub(super) fn pure(tree: &SyntaxTree, function: &str, argument: ExprRef, unit: &Unit, angle: bool) -> String {
    if unit.degree_to_radian().is_some_and(|rad| rad.is_one()) {
        return format!("`{function}(deg2rad(...))` converts it");
    }
    let one = if angle { Unit::radian() } else { Unit::one() };
    if let Some((scale, _)) = unit.conversion(&one) {
        return format!("1 {unit} is {}: convert one of the quantities", six_digits(scale));
    }
    if let Some((number, divides)) = factor(tree, argument)
        && let Some(missing) = if divides { unit.quotient(&one) } else { one.quotient(unit) }
    {
        let name = if angle && !divides { "w" } else { "c" };
        return format!("give the number its unit: `const {name} = {number} [{missing}];`");
    }
    format!("divide by a reference quantity in {unit}")
}

/// The number of the text by which an expression is multiplied or (true) divided.
fn factor(tree: &SyntaxTree, root: ExprRef) -> Option<(f64, bool)> {
    let mut e = root;
    loop {
        e = match tree.expr(e) {
            Expr::Unary(_, a) => *a,
            Expr::Binary(sign @ (BinarySign::Multiply | BinarySign::Divide), a, b, _) => {
                if let Some(value) = number(tree, *b) {
                    return Some((value, *sign == BinarySign::Divide));
                }
                if let Some(value) = number(tree, *a) {
                    return Some((value, false));
                }
                *a
            }
            _ => return None,
        };
    }
}

/// A number of the text, whatever its sign.
fn number(tree: &SyntaxTree, e: ExprRef) -> Option<f64> {
    match tree.expr(e) {
        Expr::Number(value) => Some(*value),
        Expr::Unary(_, a) => match tree.expr(*a) {
            Expr::Number(value) => Some(*value),
            _ => None,
        },
        _ => None,
    }
}

/// The value without the traces of rounding, when few digits make it.
fn decimal(value: f64) -> String {
    let near = |text: &String| text.parse::<f64>().is_ok_and(|v| (v - value).abs() <= 1e-15 * value.abs());
    let short = (0..12).map(|digits| format!("{value:.digits$e}")).find(near);
    short.and_then(|text| text.parse::<f64>().ok()).unwrap_or(value).to_string()
}

/// Which names of one block have units and which have not.
#[derive(Default)]
pub(super) struct Survey {
    /// Whether any has.
    pub(super) known: bool,
    /// Names without, each where it occurs first.
    unknown: Vec<(Span, SymbolId)>,
}

impl Survey {
    /// What another part of the same statement shows.
    pub(super) fn join(&mut self, other: Survey) {
        self.known |= other.known;
        self.unknown.extend(other.unknown);
    }
}

/// What cannot be checked because of one name.
#[derive(Clone)]
struct Unchecked {
    first: String,
    place: Span,
    more: usize,
}

/// What cannot be checked, by the names that are to blame.
pub(super) struct Ledger {
    entries: Vec<Option<Unchecked>>,
    /// By symbol: the survey that has seen it last.
    seen: Vec<usize>,
    surveys: usize,
}

impl Ledger {
    /// Nothing yet.
    pub(super) fn new(scope: &Scope<'_>) -> Self {
        Self { entries: vec![None; scope.symbols.len()], seen: vec![0; scope.symbols.len()], surveys: 0 }
    }

    /// Begins to look at another block.
    pub(super) fn survey(&mut self) -> Survey {
        self.surveys += 1;
        Survey::default()
    }

    /// A name in the block, with what is known of its unit.
    pub(super) fn see(&mut self, survey: &mut Survey, place: Span, measure: Measure) {
        match measure {
            Measure::Known(_) => survey.known = true,
            Measure::Unknown(s) if self.seen[s] != self.surveys => {
                self.seen[s] = self.surveys;
                survey.unknown.push((place, s));
            }
            _ => {}
        }
    }

    /// The block is an equation or an output; it cannot be checked when only some of its names have units.
    pub(super) fn enter(&mut self, survey: Survey, what: impl Fn() -> String) {
        for (place, s) in survey.unknown.into_iter().filter(|_| survey.known) {
            match &mut self.entries[s] {
                Some(entry) => entry.more += 1,
                none => *none = Some(Unchecked { first: what(), place, more: 0 }),
            }
        }
    }

    /// One warning for each name.
    pub(super) fn tell(self, scope: &Scope<'_>, findings: &mut Vec<Diagnostic>) {
        for (s, entry) in self.entries.into_iter().enumerate() {
            let Some(Unchecked { first, place, more }) = entry else { continue };
            let name = &scope.symbols[s].declaration.name;
            let others = match more {
                0 => String::new(),
                1 => " and of one more equation".into(),
                n => format!(" and of {n} more equations"),
            };
            let message = format!("`{}` has no unit: the units of {first}{others} cannot be checked", name.text);
            let finding = Diagnostic::new(Code::UnitUnknown, name.span, message).label(place, "this is not checked");
            findings.push(finding.hint("declare one, such as `[m/s]`, or `[1]` for a pure number"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversions_are_written_as_people_write_numbers() {
        let unit = |text| Unit::parse(text).unwrap();
        let told = |wanted, got| conversion(&unit(wanted), &unit(got)).unwrap();
        assert_eq!(told("mol/min", "mol/s"), "convert with a constant, `const c = 60 [s/min];`");
        assert_eq!(told("m", "ft"), "convert with a constant, `const c = 0.3048 [m/ft];`");
        assert_eq!(told("deg/s", "rad/s"), "`rad2deg(...)` converts rad/s to deg/s");
        assert_eq!(told("m", "s"), "a factor in m/s lies between them");
        assert_eq!(decimal(59.99999999999999), "60");
        assert_eq!(decimal(1.0 / 60.0), "0.016666666666666666");
    }
}
