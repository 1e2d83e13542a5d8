//! Units of what tables and blocks take.

use super::measures::{Measure, Measures, factor_between};
use super::scope::{Scope, Symbol, SymbolId, read_unit};
use super::units::Pass;
use crate::diagnostic::{Code, Diagnostic};
use crate::syntax::{Argument, Asked, ExprRef, Want};

/// What the tables take, by symbol and argument; numbers where no unit is declared.
pub(super) fn declared(
    scope: &Scope<'_>,
    measures: &mut Measures,
    findings: &mut Vec<Diagnostic>,
) -> Vec<Vec<Measure>> {
    let mut unit = |argument: &Argument| match &argument.unit {
        None => Measure::Number,
        Some(text) => read_unit(text, findings).map_or(Measure::Broken, |unit| measures.known(unit)),
    };
    let mut units = |symbol: &Symbol<'_>| symbol.table.iter().flat_map(|t| &t.arguments).map(&mut unit).collect();
    scope.symbols.iter().map(&mut units).collect()
}

/// Whether a block of the language has made a name; its unit is that of what the block reads.
pub(super) fn is_of_a_block(symbol: &Symbol<'_>) -> bool {
    symbol.declaration.made.as_ref().is_some_and(|m| m.like.is_some())
}

impl Pass<'_, '_, '_> {
    /// An argument of a table is in the unit that it declares, or in that of its first use.
    pub(super) fn look_up(&mut self, s: SymbolId, arguments: &[ExprRef]) -> Measure {
        arguments.iter().enumerate().for_each(|(k, argument)| self.argument(s, k, *argument));
        self.symbols[s]
    }

    fn argument(&mut self, s: SymbolId, k: usize, argument: ExprRef) {
        let symbol = &self.checked.scope.symbols[s];
        match self.measures.agreed(self.arguments[s][k], self.of(argument)) {
            Ok(measure) => self.arguments[s][k] = measure,
            Err((x, y)) => {
                let (own, other) = (self.measures.unit(x), self.measures.unit(y));
                let factor = factor_between(own, other).map_or(String::new(), |f| format!("; {f}"));
                let own_argument = symbol.table.filter(|t| t.arguments.len() > 1).map(|t| &t.arguments[k].name.text);
                let for_ = own_argument.map_or(String::new(), |name| format!(" for `{name}`"));
                let message = format!("the table `{}` takes {own}{for_}, this is in {other}{factor}", symbol.name());
                let mut finding = Diagnostic::new(Code::UnitMismatch, self.span(argument), message);
                if let Some(unit) = symbol.table.and_then(|t| t.arguments[k].unit.as_ref()) {
                    finding = finding.label(unit.span, "the unit of its argument");
                }
                self.findings.push(self.conversion(finding, x, y));
            }
        }
    }

    pub(super) fn abscissa(&mut self, s: SymbolId, k: usize, value: Measure, root: ExprRef) {
        match self.measures.agreed(self.arguments[s][k], value) {
            Ok(measure) => self.arguments[s][k] = measure,
            Err((x, y)) => {
                let name = self.checked.scope.symbols[s].name();
                let (own, other) = (self.measures.unit(x), self.measures.unit(y));
                let message = format!("the abscissae of the table `{name}` are in {own}, this is in {other}");
                let finding = Diagnostic::new(Code::UnitMismatch, self.span(root), message);
                self.findings.push(self.conversion(finding, x, y));
            }
        }
    }

    pub(super) fn ordinate(&mut self, s: SymbolId, value: Measure, root: ExprRef) {
        let symbol = &self.checked.scope.symbols[s];
        if symbol.declaration.unit.is_some() {
            return self.compare(s, value, root, "this ordinate");
        }
        let known = if let Measure::Unknown(_) = self.symbols[s] { Measure::Number } else { self.symbols[s] };
        match self.measures.agreed(known, value) {
            Ok(Measure::Number) => {}
            Ok(measure) => self.symbols[s] = measure,
            Err((x, y)) => {
                let (own, other) = (self.measures.unit(x), self.measures.unit(y));
                let message =
                    format!("the ordinates of the table `{}` are in {own}, this is in {other}", symbol.name());
                let finding = Diagnostic::new(Code::UnitMismatch, self.span(root), message);
                self.findings.push(self.conversion(finding, x, y));
            }
        }
    }

    /// Compares an argument of a block with what the block takes.
    pub(super) fn want(&mut self, s: SymbolId, number: usize, value: Measure) {
        let scope = self.checked.scope;
        let Some(want) = scope.symbols[s].declaration.made.as_ref().and_then(|m| m.wants.get(number)) else { return };
        let Some(time) = self.time else { return };
        if number == 0 {
            self.polynomials = [None; 2];
        }
        let asked = match want.unit {
            Asked::Time => time,
            Asked::Number => Measures::ONE,
            Asked::Rate => self.measures.joined(Measures::RADIAN, time, true).unwrap_or(Measure::Broken),
            Asked::Coefficient { power, denominator } => {
                return self.coefficient(want, (power, denominator), value, time);
            }
        };
        if let Err((x, y)) = self.measures.agreed(asked, value) {
            let (own, other) = (self.measures.unit(x), self.measures.unit(y));
            let factor = factor_between(other, own).map_or(String::new(), |f| format!("; {f}"));
            let message = format!("{} is in {other}, and must be in {own}{factor}", want.what);
            let finding = Diagnostic::new(Code::UnitMismatch, self.span(want.argument), message);
            self.findings.push(self.conversion(finding, x, y));
        }
    }

    /// Coefficients of one polynomial differ by powers of time; numbers have whatever unit fits.
    fn coefficient(&mut self, want: &Want, (power, denominator): (u32, bool), value: Measure, time: Measure) {
        let (Measure::Known(_), Measure::Known(t)) = (value, time) else { return };
        let scale = self.measures.power(t, power as i32).map(Measure::Known);
        let Ok(reduced) = scale.and_then(|scale| self.measures.joined(value, scale, true)) else { return };
        let Some(first) = self.polynomials[usize::from(denominator)] else {
            self.polynomials[usize::from(denominator)] = Some(reduced);
            return;
        };
        let Err((x, _)) = self.measures.agreed(first, reduced) else { return };
        let Ok(Measure::Known(fits)) = scale.and_then(|scale| self.measures.joined(Measure::Known(x), scale, false))
        else {
            return;
        };
        let Measure::Known(given) = value else { return };
        let (fits, other) = (self.measures.unit(fits), self.measures.unit(given));
        let message = format!("{} is in {other}, where {fits} fits the others", want.what);
        let finding = Diagnostic::new(Code::UnitMismatch, self.span(want.argument), message);
        self.findings.push(finding.hint("a coefficient before s^k is in the unit of the last one times time^k"));
    }
}
