//! Units of all expressions, in one pass over the nodes: what is added, compared or equated must be of one unit.
//!
//! Numbers keep the units that were declared: nothing is converted silently inside a model.

use super::argument_units;
use super::beginnings;
use super::equations::Equation;
use super::expressions::Expressions;
use super::functions::Function;
use super::kinds::{Kinds, Level};
use super::measures::{Measure, Measures, OutOfRange, factor_between};
use super::order::{Block, Blocks, Owner};
use super::remedies;
use super::remedies::{Ledger, Survey};
use super::scope::{Meaning, Scope, SymbolId};
use super::stated::{Known, Part};
use crate::diagnostic::{Code, Diagnostic};
use crate::op::Op;
use crate::source::Span;
use crate::syntax::{BinarySign, Expr, ExprRef, Role};

/// What the pass reads.
pub(super) struct Checked<'a, 'b> {
    pub(super) scope: &'b Scope<'a>,
    pub(super) blocks: &'b Blocks,
    pub(super) equations: &'b [Equation],
    pub(super) known: &'b [Known],
    pub(super) meanings: &'b [Meaning],
    pub(super) kinds: &'b Kinds,
    pub(super) expressions: &'b Expressions,
}

/// Tells every disagreement of units.
pub(super) fn check(checked: &Checked<'_, '_>, findings: &mut Vec<Diagnostic>) {
    let mut measures = Measures::new();
    let scope = checked.scope;
    let symbols: Vec<Measure> = (0..scope.symbols.len()).map(|s| declared(scope, &mut measures, s)).collect();
    let arguments = argument_units::declared(scope, &mut measures, findings);
    let time = if scope.has_units { Some(measures.known(scope.time.clone())) } else { None };
    let mut found = Vec::new();
    let mut pass = Pass {
        checked,
        measures,
        symbols: symbols.clone(),
        arguments: arguments.clone(),
        polynomials: [None; 2],
        time,
        nodes: vec![Measure::Broken; scope.tree.expressions.len()],
        ledger: Ledger::new(scope),
        left: None,
        findings: &mut found,
    };
    for round in 1..=ROUNDS {
        let before = pass.symbols.clone();
        pass.all();
        let moved = |s: &usize| before[*s] != pass.symbols[*s] && argument_units::is_of_a_block(&scope.symbols[*s]);
        if round == ROUNDS || !(0..before.len()).any(|s| moved(&s)) {
            break;
        }
        // once more, with what the blocks read in place of what was not known yet
        for (s, symbol) in scope.symbols.iter().enumerate() {
            if !argument_units::is_of_a_block(symbol) {
                pass.symbols[s] = symbols[s];
            }
        }
        (pass.arguments, pass.ledger) = (arguments.clone(), Ledger::new(scope));
        pass.findings.clear();
    }
    pass.ledger.tell(scope, pass.findings);
    findings.extend(found);
}

/// Rounds in which the units of blocks that read each other are found; those of longer chains against the order of the text stay open.
const ROUNDS: usize = 12;

/// What a name stands for before its value has been looked at.
fn declared(scope: &Scope<'_>, measures: &mut Measures, s: SymbolId) -> Measure {
    let symbol = &scope.symbols[s];
    match (&symbol.unit, &symbol.declaration.unit) {
        // which of two declarations is meant, the user will say
        _ if symbol.contested => Measure::Broken,
        (Some(unit), _) => measures.known(unit.clone()),
        (None, Some(_)) => Measure::Broken,
        // found from what the block reads
        (None, None) if symbol.declaration.made.is_some() => Measure::Number,
        (None, None) => Measure::Unknown(s),
    }
}

pub(super) struct Pass<'a, 'b, 'c> {
    pub(super) checked: &'c Checked<'a, 'b>,
    pub(super) measures: Measures,
    pub(super) symbols: Vec<Measure>,
    /// By symbol: what a table takes, by argument.
    pub(super) arguments: Vec<Vec<Measure>>,
    /// The coefficients of the numerator and the denominator that are being looked at, by time to their power.
    pub(super) polynomials: [Option<Measure>; 2],
    /// Unit of time; `None` in a model without any unit.
    pub(super) time: Option<Measure>,
    nodes: Vec<Measure>,
    ledger: Ledger,
    /// What was seen on the left of an equation whose right side comes next.
    left: Option<Survey>,
    pub(super) findings: &'c mut Vec<Diagnostic>,
}

impl Pass<'_, '_, '_> {
    /// Whether an expression was written for a block of the language: it is right whenever the block's arguments are.
    fn is_of_a_block(&self, block: &Block) -> bool {
        let owner = match block.owner {
            Owner::Value(s) => Some(s),
            Owner::Right(k) => self.checked.equations[k].state,
            _ => None,
        };
        owner.is_some_and(|s| argument_units::is_of_a_block(&self.checked.scope.symbols[s]))
    }

    /// Looks at all blocks in the order of definition.
    fn all(&mut self) {
        let checked = self.checked;
        for block in &checked.blocks.list {
            if self.is_of_a_block(block) {
                continue;
            }
            let mut survey = self.ledger.survey();
            let radicand = self.radicand(block);
            for e in checked.blocks.nodes(block) {
                // the root of a density has no unit of whole powers: what stands below it is compared
                let measure = if radicand.is_some() && *e == block.root { Measure::Number } else { self.node(*e) };
                self.nodes[e.0 as usize] = measure;
                let meaning = checked.meanings[e.0 as usize];
                if matches!(meaning, Meaning::Symbol(_) | Meaning::Record(_) | Meaning::Table(_)) {
                    self.ledger.see(&mut survey, self.span(*e), measure);
                }
            }
            self.finish(block, survey);
        }
    }

    /// What the intensity of a noise is the square root of.
    fn radicand(&self, block: &Block) -> Option<ExprRef> {
        let Owner::Known(k) = block.owner else { return None };
        match self.checked.scope.tree.expr(block.root) {
            Expr::Call(name, arguments) if self.checked.known[k].part == Part::Intensity && name.text == "sqrt" => {
                arguments.first().copied().filter(|_| arguments.len() == 1)
            }
            _ => None,
        }
    }

    /// Compares the density of a noise, whose root is its intensity, with the square of the rate times the time.
    fn density(&mut self, s: SymbolId, radicand: ExprRef) {
        let (Some(time), Measure::Known(own)) = (self.time, self.symbols[s]) else { return };
        let rate = self.measures.joined(Measure::Known(own), time, true);
        let Ok(Measure::Known(rate)) = rate else { return };
        let Ok(square) = self.measures.power(rate, 2) else { return };
        let Ok(wanted) = self.measures.joined(Measure::Known(square), time, false) else { return };
        let Err((x, y)) = self.measures.agreed(wanted, self.of(radicand)) else { return };
        let (wanted, found) = (self.measures.unit(x), self.measures.unit(y));
        let factor = factor_between(wanted, found).map_or(String::new(), |f| format!("; {f}"));
        let name = self.checked.scope.symbols[s].name();
        let message = format!("the density of the noise of `der({name})` is in {wanted}, this is in {found}{factor}");
        let finding = Diagnostic::new(Code::UnitMismatch, self.span(radicand), message);
        self.findings.push(finding.hint("a density is the square of the rate times the time"));
    }

    pub(super) fn of(&self, e: ExprRef) -> Measure {
        self.nodes[e.0 as usize]
    }

    pub(super) fn span(&self, e: ExprRef) -> Span {
        self.checked.scope.tree.span(e)
    }

    fn node(&mut self, e: ExprRef) -> Measure {
        if self.checked.kinds.of(e).broken {
            return Measure::Broken;
        }
        let meaning = self.checked.meanings[e.0 as usize];
        let tree = self.checked.scope.tree;
        match tree.expr(e) {
            Expr::Number(_) => Measure::Number,
            Expr::Name(_) => match meaning {
                Meaning::Symbol(s) => self.symbols[s],
                Meaning::Time => self.time.unwrap_or(Measure::Number),
                _ => Measure::Number,
            },
            Expr::Unary(_, a) => self.of(*a),
            Expr::Binary(sign, a, b, span) => self.binary(*sign, *a, *b, *span, e),
            Expr::If(_, a, b) => self.agree(&[*a, *b], "the branches of `if`"),
            Expr::Call(name, arguments) => match meaning {
                Meaning::Function(function) => self.call(function, &name.text, arguments, e),
                Meaning::Record(output) => self.record(output),
                Meaning::Table(s) => self.look_up(s, arguments),
                _ => Measure::Broken,
            },
            Expr::Vector(_) | Expr::Element(..) => Measure::Broken,
        }
    }

    fn binary(&mut self, sign: BinarySign, a: ExprRef, b: ExprRef, span: Span, e: ExprRef) -> Measure {
        let verb = match sign {
            BinarySign::Multiply | BinarySign::Divide => {
                let joined = self.measures.joined(self.of(a), self.of(b), sign == BinarySign::Divide);
                return joined.unwrap_or_else(|OutOfRange| self.out_of_range(e));
            }
            BinarySign::Power => return self.power(a, b, e),
            BinarySign::And | BinarySign::Or => return Measure::Number,
            BinarySign::Add => "added",
            BinarySign::Subtract => "subtracted",
            _ => "compared",
        };
        match self.measures.agreed(self.of(a), self.of(b)) {
            Ok(measure) => measure,
            Err((x, y)) => {
                let (left, right) = (self.measures.unit(x), self.measures.unit(y));
                let message = match factor_between(left, right) {
                    Some(factor) => format!("{left} and {right} are {verb} without conversion; {factor}"),
                    None => format!("{left} and {right} cannot be {verb}"),
                };
                let finding = Diagnostic::new(Code::UnitMismatch, span, message)
                    .label(self.span(a), format!("this is in {left}"))
                    .label(self.span(b), format!("this is in {right}"));
                self.findings.push(self.conversion(finding, x, y));
                Measure::Broken
            }
        }
    }

    /// Arguments or branches that must be of one unit.
    fn agree(&mut self, operands: &[ExprRef], what: &str) -> Measure {
        let mut all = Measure::Number;
        let mut first = None;
        for e in operands {
            match self.measures.agreed(all, self.of(*e)) {
                Ok(measure) => {
                    if first.is_none() && matches!(measure, Measure::Known(_)) {
                        first = Some(*e);
                    }
                    all = measure;
                }
                Err((x, y)) => {
                    let (one, other) = (self.measures.unit(x), self.measures.unit(y));
                    let factor = factor_between(one, other).map_or(String::new(), |f| format!("; {f}"));
                    let message = format!("{what} are in {one} and in {other}{factor}");
                    let finding = Diagnostic::new(Code::UnitMismatch, self.span(*e), message);
                    let finding = finding.label(self.span(first.unwrap_or(*e)), format!("this is in {one}"));
                    self.findings.push(self.conversion(finding, x, y));
                    return Measure::Broken;
                }
            }
        }
        all
    }

    fn call(&mut self, function: Function, name: &str, arguments: &[ExprRef], e: ExprRef) -> Measure {
        if let Function::External(_) = function {
            // units are those of the declarations around the call
            return Measure::Number;
        }
        let first = self.of(arguments[0]);
        let what = || format!("the arguments of `{name}`");
        match function {
            Function::Op(Op::Abs) => first,
            Function::Op(Op::Sign) => Measures::ONE,
            Function::Op(Op::Sqrt) => self.square_root(first, arguments[0]),
            Function::Op(Op::Min | Op::Max | Op::Hypot) | Function::Clip | Function::Deadzone => {
                self.agree(arguments, &what())
            }
            Function::Op(Op::Atan2) => match self.agree(arguments, &what()) {
                Measure::Number => Measure::Number,
                _ => Measures::RADIAN,
            },
            Function::Op(op) => {
                let inverse = matches!(op, Op::Asin | Op::Acos | Op::Atan);
                match self.pure(name, arguments[0], matches!(op, Op::Sin | Op::Cos | Op::Tan)) {
                    Measure::Number => Measure::Number,
                    _ if inverse => Measures::RADIAN,
                    _ => Measures::ONE,
                }
            }
            Function::DegToRad | Function::RadToDeg => self.angle(function, name, arguments[0]),
            Function::Delay => {
                self.delay(arguments[1]);
                first
            }
            Function::Initial => first,
            Function::Der => match self.time {
                Some(time) => self.measures.joined(first, time, true).unwrap_or_else(|OutOfRange| self.out_of_range(e)),
                None => first,
            },
            Function::Measured | Function::External(_) => self.of(e),
        }
    }

    /// The argument of a function that needs a pure number of size 1.
    fn pure(&mut self, name: &str, argument: ExprRef, angle: bool) -> Measure {
        let measure = self.of(argument);
        if let Measure::Known(k) = measure
            && !self.measures.unit(k).is_one()
        {
            let unit = self.measures.unit(k);
            let wanted = if angle { "an angle in rad" } else { "a pure number" };
            let hint = remedies::pure(self.checked.scope.tree, name, argument, unit, angle);
            let message = format!("`{name}` needs {wanted}, this is in {unit}");
            self.findings.push(Diagnostic::new(Code::UnitArgument, self.span(argument), message).hint(hint));
        }
        measure
    }

    fn angle(&mut self, function: Function, name: &str, argument: ExprRef) -> Measure {
        let Measure::Known(k) = self.of(argument) else { return self.of(argument) };
        let unit = self.measures.unit(k);
        let (converted, wanted) = match function {
            Function::DegToRad => (unit.degree_to_radian(), "deg"),
            _ => (unit.radian_to_degree(), "rad"),
        };
        if let Some(unit) = converted {
            return self.measures.known(unit);
        }
        let message = format!("`{name}` converts angles in {wanted}, this is in {unit}");
        let finding = Diagnostic::new(Code::UnitArgument, self.span(argument), message);
        self.findings.push(finding.hint(format!("use it for quantities in {wanted}, {wanted}/s and the like")));
        Measure::Broken
    }

    fn square_root(&mut self, measure: Measure, argument: ExprRef) -> Measure {
        let Measure::Known(k) = measure else { return measure };
        match self.measures.root(k, 2) {
            Ok(root) => Measure::Known(root),
            Err(OutOfRange) => {
                let unit = self.measures.unit(k);
                let message = format!("the square root of a quantity in {unit} has no unit");
                let finding = Diagnostic::new(Code::UnitArgument, self.span(argument), message);
                self.findings.push(finding.hint("only even powers, such as m^2/s^2, have a square root"));
                Measure::Broken
            }
        }
    }

    fn power(&mut self, base: ExprRef, exponent: ExprRef, e: ExprRef) -> Measure {
        if let Measure::Known(k) = self.of(exponent)
            && !self.measures.unit(k).is_one()
        {
            let unit = self.measures.unit(k);
            let message = format!("an exponent is a pure number, this is in {unit}");
            let finding = Diagnostic::new(Code::UnitExponent, self.span(exponent), message);
            self.findings.push(finding.hint(format!("divide it by a reference quantity in {unit}")));
            return Measure::Broken;
        }
        let k = match self.of(base) {
            Measure::Number if self.of(exponent) != Measure::Number => return Measures::ONE,
            Measure::Known(k) if self.measures.unit(k).is_one() => return Measures::ONE,
            Measure::Known(k) => k,
            other => return other,
        };
        let constant = self.checked.kinds.of(exponent).level == Level::Constant;
        let value = self.checked.expressions.constant(exponent).filter(|_| constant);
        let Some(value) = value else {
            let message = format!("a quantity in {} has a constant exponent, this one can vary", self.measures.unit(k));
            let finding = Diagnostic::new(Code::UnitExponent, self.span(exponent), message);
            self.findings.push(finding.hint("divide the base by a reference quantity, as in `(x/x0)^n`"));
            return Measure::Broken;
        };
        match rational(value).map(|(p, q)| self.measures.power(k, p).and_then(|u| self.measures.root(u, q))) {
            Some(Ok(unit)) => Measure::Known(unit),
            _ if value.abs() > 127.0 => self.out_of_range(e),
            _ => {
                let message = format!("a quantity in {} to the power {value} has no unit", self.measures.unit(k));
                let finding = Diagnostic::new(Code::UnitExponent, self.span(exponent), message);
                self.findings.push(finding.hint("divide the base by a reference quantity, as in `(x/x0)^n`"));
                Measure::Broken
            }
        }
    }

    /// The record of an output is in the output's declared unit; without one, in that of the state that it is.
    fn record(&mut self, output: SymbolId) -> Measure {
        let scope = self.checked.scope;
        match (declared(scope, &mut self.measures, output), beginnings::state_shown(scope, output)) {
            (Measure::Unknown(_), Some(state)) => self.symbols[state],
            (measure, _) => measure,
        }
    }

    fn delay(&mut self, tau: ExprRef) {
        if let (Some(time), measure) = (self.time, self.of(tau))
            && let Err((x, y)) = self.measures.agreed(time, measure)
        {
            let (time, unit) = (self.measures.unit(x), self.measures.unit(y));
            let factor = factor_between(unit, time).map_or(String::new(), |f| format!("; {f}"));
            let message = format!("a delay is a time in {time}, this is in {unit}{factor}");
            let finding = Diagnostic::new(Code::UnitMismatch, self.span(tau), message);
            self.findings.push(self.conversion(finding, x, y));
        }
    }

    fn out_of_range(&mut self, e: ExprRef) -> Measure {
        let message = "the exponents of the unit of this expression are too large";
        self.findings.push(Diagnostic::new(Code::UnitExponent, self.span(e), message));
        Measure::Broken
    }

    /// Compares a block with what it is for, and settles the unit of the name it defines.
    fn finish(&mut self, block: &Block, mut survey: Survey) {
        let scope = self.checked.scope;
        let value = self.of(block.root);
        match block.owner {
            Owner::Value(s) => {
                let symbol = &scope.symbols[s];
                self.compare(s, value, block.root, "its value");
                let defines = matches!(symbol.role, Role::Let | Role::Output) || self.checked.kinds.derived[s];
                if symbol.declaration.made.is_some() && defines {
                    self.symbols[s] = value;
                } else if symbol.declaration.unit.is_none() && defines {
                    self.symbols[s] = if value == Measure::Number { Measure::Unknown(s) } else { value };
                }
                if symbol.role == Role::Output && value != Measure::Broken {
                    survey.known |= symbol.unit.is_some();
                    self.ledger.enter(survey, || format!("the output `{}`", symbol.name()));
                }
            }
            Owner::Lower(s) | Owner::Upper(s) => self.compare(s, value, block.root, "this bound"),
            Owner::Known(k) if self.checked.known[k].part == Part::Intensity => {
                if let Some(radicand) = self.radicand(block) {
                    self.density(self.checked.known[k].symbol, radicand);
                }
            }
            // a condition has no unit
            Owner::Known(k) if matches!(self.checked.known[k].part, Part::Condition(_)) => {}
            Owner::Known(k) | Owner::Limit(k) => {
                let known = self.checked.known[k];
                self.compare(known.symbol, value, block.root, &known.words(scope));
            }
            Owner::Like(s) => {
                if matches!(value, Measure::Known(_) | Measure::Unknown(_)) {
                    self.symbols[s] = value;
                }
            }
            Owner::Want(s, k) => self.want(s, k, value),
            Owner::Tie(s) => self.compare(s, value, block.root, "what it is tied to"),
            Owner::Abscissa(s, k) => self.abscissa(s, k, value, block.root),
            Owner::Ordinate(s) => self.ordinate(s, value, block.root),
            Owner::Left(_) => self.left = Some(survey),
            Owner::Right(k) if self.checked.equations[k].implicit => self.implicit(k, value, survey),
            Owner::Right(k) => self.equation(k, value, survey),
        }
    }

    /// Compares a value or bound with the declared unit.
    pub(super) fn compare(&mut self, s: SymbolId, value: Measure, root: ExprRef, what: &str) {
        let symbol = &self.checked.scope.symbols[s];
        if symbol.declaration.unit.is_none() {
            return;
        }
        let Err((x, y)) = self.measures.agreed(self.symbols[s], value) else { return };
        let (own, other) = (self.measures.unit(x), self.measures.unit(y));
        let factor = factor_between(own, other).map_or(String::new(), |f| format!("; {f}"));
        let message = format!("`{}` is declared in {own}, {what} is in {other}{factor}", symbol.name());
        let mut finding = Diagnostic::new(Code::UnitMismatch, self.span(root), message);
        if let Some(unit) = &symbol.declaration.unit {
            finding = finding.label(unit.span, "declared here");
        }
        self.findings.push(self.conversion(finding, x, y));
    }

    fn equation(&mut self, k: usize, right: Measure, mut survey: Survey) {
        let equation = &self.checked.equations[k];
        let Some(s) = equation.state.filter(|_| right != Measure::Broken) else { return };
        let symbol = &self.checked.scope.symbols[s];
        let left = self.span(equation.left);
        self.ledger.see(&mut survey, left, self.symbols[s]);
        let rate = match self.time {
            Some(time) => self.measures.joined(self.symbols[s], time, true).unwrap_or(Measure::Broken),
            None => self.symbols[s],
        };
        let Err((x, y)) = self.measures.agreed(rate, right) else {
            return self.ledger.enter(survey, || format!("the equation of `{}`", symbol.name()));
        };
        let (own, other) = (self.measures.unit(x), self.measures.unit(y));
        let factor = factor_between(own, other).map_or(String::new(), |f| format!("; {f}"));
        let message = format!("`der({})` is in {own}, the right side in {other}{factor}", symbol.name());
        let mut finding = Diagnostic::new(Code::UnitMismatch, self.span(equation.right), message);
        if let Some(unit) = &symbol.declaration.unit {
            finding = finding.label(unit.span, "the unit of the state");
        }
        self.findings.push(self.conversion(finding, x, y));
    }

    /// Both sides of an equation that is solved for derivatives.
    fn implicit(&mut self, k: usize, right: Measure, mut survey: Survey) {
        let equation = &self.checked.equations[k];
        let left = self.of(equation.left);
        if let Some(seen) = self.left.take() {
            survey.join(seen);
        }
        let Err((x, y)) = self.measures.agreed(left, right) else {
            if left != Measure::Broken && right != Measure::Broken {
                self.ledger.enter(survey, || "an equation".to_string());
            }
            return;
        };
        let (own, other) = (self.measures.unit(x), self.measures.unit(y));
        let factor = factor_between(own, other).map_or(String::new(), |f| format!("; {f}"));
        let message = format!("the left side is in {own}, the right side in {other}{factor}");
        let finding = Diagnostic::new(Code::UnitMismatch, self.span(equation.right), message);
        let finding = finding.label(self.span(equation.left), format!("this is in {own}"));
        self.findings.push(self.conversion(finding, x, y));
    }

    /// Adds how one unit becomes the other, or what separates them.
    pub(super) fn conversion(&self, finding: Diagnostic, x: u32, y: u32) -> Diagnostic {
        match remedies::conversion(self.measures.unit(x), self.measures.unit(y)) {
            Some(hint) => finding.hint(hint),
            None => finding,
        }
    }
}

/// A decimal number as the fraction that it is meant to be, with a denominator up to 12.
fn rational(value: f64) -> Option<(i32, i32)> {
    if value.is_nan() || value.abs() > 127.0 {
        return None;
    }
    (1..=12).find_map(|q| {
        let p = value * f64::from(q);
        ((p - p.round()).abs() < 1e-9).then_some((p.round() as i32, q))
    })
}
