//! Which equation belongs to which state.
//!
//! Which equation is solved for which derivative, and which equations hang together.

use super::functions::{Function, argument_count};
use super::reach::{Reach, each_node};
use super::scope::{Scope, Symbol, SymbolId};
use crate::diagnostic::{Code, Diagnostic};
use crate::syntax::{BinarySign, Expr, ExprRef, Name, Role, StatementKind};
use std::collections::VecDeque;

/// `left = right`.
pub(super) struct Equation {
    /// The left side, whole.
    pub(super) left: ExprRef,
    /// The right side.
    pub(super) right: ExprRef,
    /// The state whose derivative is the left side; `None` when that is something else.
    pub(super) state: Option<SymbolId>,
    /// The derivatives in it are to be solved for.
    pub(super) implicit: bool,
}

/// What stands on the left.
enum Left {
    /// The derivative of a state, alone.
    Derivative(SymbolId),
    /// An expression of an equation in which derivatives stand somewhere.
    Sum,
}

/// Reads the left sides. Every state must have exactly one equation; where equations are to be solved for derivatives, which
/// belongs to which is found later.
pub(super) fn read(scope: &mut Scope<'_>, findings: &mut Vec<Diagnostic>) -> Vec<Equation> {
    let tree = scope.tree;
    let reach = Reach::new(scope);
    let mut first: Vec<Option<ExprRef>> = vec![None; scope.symbols.len()];
    // states that a faulty left side mentions: their equation is there, only not well written
    let mut excused = vec![false; scope.symbols.len()];
    let mut equations = Vec::new();
    let mut guesses = 0;
    for statement in &tree.statements {
        let StatementKind::Equation(left, right) = statement.kind else { continue };
        let mut equation = Equation { left, right, state: None, implicit: false };
        match left_side(scope, &reach, left, right, &mut guesses) {
            Ok(Some(Left::Derivative(s))) => match first[s] {
                Some(_) if reach.derivative(scope, right) => equation.implicit = true,
                Some(earlier) => findings.push(second_equation(scope, s, left, earlier)),
                None => (first[s], equation.state) = (Some(left), Some(s)),
            },
            Ok(Some(Left::Sum)) => equation.implicit = true,
            Ok(None) => {}
            Err(finding) => {
                findings.extend(finding);
                excuse(scope, left, guesses, &mut excused);
            }
        }
        equations.push(equation);
    }
    if equations.iter().any(|e| e.implicit) {
        return equations;
    }
    for (s, symbol) in scope.valid().filter(|(_, symbol)| symbol.role == Role::State) {
        if first[s].is_none() && !excused[s] && !scope.is_suspended(symbol.name()) {
            findings.push(no_equation(scope, s));
        }
    }
    equations
}

/// The complaint about a state whose derivative nothing determines.
pub(super) fn no_equation(scope: &Scope<'_>, s: SymbolId) -> Diagnostic {
    let name = &scope.symbols[s].declaration.name;
    let message = format!("the state `{}` has no equation", name.text);
    Diagnostic::new(Code::MissingEquation, name.span, message).hint(format!("`der({}) = ...;`", name.text))
}

fn second_equation(scope: &Scope<'_>, s: SymbolId, left: ExprRef, first: ExprRef) -> Diagnostic {
    let message = format!("the state `{}` has a second equation", scope.symbols[s].name());
    Diagnostic::new(Code::TwoEquations, scope.tree.span(left), message)
        .label(scope.tree.span(first), "its first equation")
        .hint("add the right sides or remove one of the equations")
}

/// What the left side is; `Ok(None)` when what is wrong has been told elsewhere.
fn left_side(
    scope: &Scope<'_>,
    reach: &Reach,
    left: ExprRef,
    right: ExprRef,
    guesses: &mut usize,
) -> Result<Option<Left>, Option<Diagnostic>> {
    let tree = scope.tree;
    let derivatives = || reach.derivative(scope, left) || reach.derivative(scope, right);
    match tree.expr(left) {
        Expr::Call(name, arguments) if name.text == "der" => match arguments[..] {
            [argument] if !is_state_name(scope, argument) && reach.state(scope, argument) => Ok(Some(Left::Sum)),
            [argument] => Ok(differentiated(scope, left, argument, guesses)?.map(Left::Derivative)),
            _ => Err(Some(argument_count(Function::Der, name, arguments.len(), tree.span(left)))),
        },
        Expr::Name(name) => match scope.find(name).map(|s| scope.symbols[s].role) {
            // a value given to an output below its declaration is a slip, whatever it is made of
            Some(role) if role != Role::Output && derivatives() => Ok(Some(Left::Sum)),
            _ => Err(not_a_derivative(scope, left, right, name)),
        },
        _ if derivatives() => Ok(Some(Left::Sum)),
        _ => {
            let message = "the left side of an equation is the derivative of a state";
            let finding = Diagnostic::new(Code::NotADerivative, tree.span(left), message);
            Err(Some(finding.hint(match meant(scope, left) {
                Some((s, Form::Quotient)) => format!("write `der({}) = ...;`", scope.symbols[s].name()),
                Some((s, Form::Initial)) => {
                    format!(
                        "an initial value is given where the state is declared: `state {} = ...;`",
                        scope.symbols[s].name()
                    )
                }
                None => "write `der(x) = ...;`, or `let name = ...;` for a definition".into(),
            })))
        }
    }
}

/// Left sides of other languages.
enum Form {
    /// `dx/dt`
    Quotient,
    /// `x(0)`
    Initial,
}

/// The state that such a left side means.
fn meant(scope: &Scope<'_>, left: ExprRef) -> Option<(SymbolId, Form)> {
    match scope.tree.expr(left) {
        Expr::Binary(BinarySign::Divide, over, under, _) => match (scope.tree.expr(*over), scope.tree.expr(*under)) {
            (Expr::Name(over), Expr::Name(under)) if under == "dt" => Some((scope.derivative(over)?, Form::Quotient)),
            _ => None,
        },
        Expr::Call(name, _) => {
            let state = scope.find(&name.text).filter(|s| scope.symbols[*s].role == Role::State)?;
            Some((state, Form::Initial))
        }
        _ => None,
    }
}

fn differentiated(
    scope: &Scope<'_>,
    left: ExprRef,
    argument: ExprRef,
    guesses: &mut usize,
) -> Result<Option<SymbolId>, Option<Diagnostic>> {
    let tree = scope.tree;
    let Expr::Name(name) = tree.expr(argument) else {
        let message = "no state is in this derivative";
        let finding = Diagnostic::new(Code::NotADerivative, tree.span(left), message);
        return Err(Some(finding.hint("an equation says how states change: `der(x) = ...;`")));
    };
    let Some(s) = scope.find(name) else {
        if scope.is_suspended(name) {
            return Err(None);
        }
        if matches!(name.as_str(), "t" | "pi" | "inf") {
            let message = format!("`{name}` is not a state");
            return Err(Some(Diagnostic::new(Code::NotADerivative, tree.span(left), message)));
        }
        *guesses += 1;
        let finding = Diagnostic::new(Code::UnknownName, tree.span(argument), format!("`{name}` is not declared"));
        let near = scope.nearest(name, *guesses, is_state);
        return Err(Some(finding.hint(near.unwrap_or_else(|| format!("`state {name};` declares it")))));
    };
    let symbol = &scope.symbols[s];
    if symbol.role == Role::State {
        return Ok(Some(s));
    }
    let message = format!("`{name}` {}; only a state has an equation", role_text(symbol.role));
    let finding = Diagnostic::new(Code::NotADerivative, tree.span(left), message);
    let finding = finding.label(symbol.declaration.name.span, "declared here");
    Err(Some(match symbol.role {
        Role::Input => finding.hint("remove the equation: the values come from the record"),
        _ => finding.hint(format!("declare it as `state {name};`")),
    }))
}

fn not_a_derivative(scope: &Scope<'_>, left: ExprRef, right: ExprRef, name: &str) -> Option<Diagnostic> {
    if scope.is_suspended(name) {
        return None;
    }
    let role = scope.find(name).map(|s| scope.symbols[s].role);
    let (what, hint) = match role {
        Some(Role::State) => ("is a state", format!("write `der({name}) = ...;`")),
        Some(Role::Input) => ("is an input: its values come from the record", "remove the equation".to_string()),
        Some(role) => {
            let form = format!("give the value where it is declared: `{} {name} = ...;`", role.keyword());
            (role_text(role), form)
        }
        None => match (scope.derivative(name), scope.tree.expr(right)) {
            (Some(s), _) => ("is not a derivative", format!("write `der({}) = ...;`", scope.symbols[s].name())),
            (None, Expr::Number(_)) => {
                ("is not declared", format!("`param {name} = ...;` or `const {name} = ...;` gives a number a name"))
            }
            _ => ("is not a derivative", format!("`let {name} = ...;` defines a name, `der({name}) = ...;` a state")),
        },
    };
    let message = format!("the left side of an equation is the derivative of a state; `{name}` {what}");
    Some(Diagnostic::new(Code::NotADerivative, scope.tree.span(left), message).hint(hint))
}

fn role_text(role: Role) -> &'static str {
    match role {
        Role::Output => "is an output",
        Role::Let => "is a let",
        Role::Const => "is a const",
        Role::Input => "is an input",
        Role::Table => "is a table",
        _ => "is a param",
    }
}

fn is_state_name(scope: &Scope<'_>, e: ExprRef) -> bool {
    let Expr::Name(name) = scope.tree.expr(e) else { return false };
    scope.find(name).is_some_and(|s| is_state(&scope.symbols[s]))
}

fn is_state(symbol: &Symbol<'_>) -> bool {
    symbol.role == Role::State
}

/// Marks states, and silences undeclared names, that a faulty left side mentions.
fn excuse<'a>(scope: &mut Scope<'a>, left: ExprRef, guesses: usize, excused: &mut [bool]) {
    let mut names: Vec<&'a str> = Vec::new();
    let tree = scope.tree;
    each_node(scope, left, |e| match e {
        Expr::Name(name) | Expr::Call(Name { text: name, .. }, _) => names.push(name),
        _ => {}
    });
    let bare = matches!(tree.expr(left), Expr::Name(_));
    for name in names {
        let near = || scope.nearest_name(name, guesses, is_state).filter(|_| !bare).and_then(|near| scope.find(near));
        if let Some(s) = scope.find(name).or_else(|| scope.derivative(name)).or_else(near) {
            excused[s] = true;
        }
        if bare && scope.find(name).is_none() {
            scope.suspend(name);
        }
    }
}

/// A largest set of pairs of equation and derivative, each in one pair at most.
pub struct Matching {
    /// By equation: the derivative.
    pub of_equation: Vec<Option<usize>>,
    /// By derivative: the equation.
    pub of_rate: Vec<Option<usize>>,
}

impl Matching {
    /// `incidence` says by equation which derivatives are in it; `preferred` pairs stay where nothing speaks against them.
    pub fn new(incidence: &[Vec<usize>], rates: usize, preferred: &[Option<usize>]) -> Self {
        let mut pairs = Self { of_equation: vec![None; incidence.len()], of_rate: vec![None; rates] };
        for (k, rate) in preferred.iter().enumerate() {
            if let Some(rate) = rate.filter(|r| pairs.of_rate[*r].is_none()) {
                pairs.join(k, rate);
            }
        }
        for (k, own) in incidence.iter().enumerate() {
            let free = own.iter().find(|r| pairs.of_rate[**r].is_none());
            if let (None, Some(rate)) = (pairs.of_equation[k], free) {
                pairs.join(k, *rate);
            }
        }
        for k in 0..incidence.len() {
            if pairs.of_equation[k].is_none() {
                pairs.augment(incidence, k);
            }
        }
        pairs
    }

    fn join(&mut self, equation: usize, rate: usize) {
        (self.of_equation[equation], self.of_rate[rate]) = (Some(rate), Some(equation));
    }

    /// Finds a derivative for an equation by changing others, along a shortest alternating path.
    fn augment(&mut self, incidence: &[Vec<usize>], from: usize) {
        let mut reached: Vec<Option<usize>> = vec![None; self.of_rate.len()];
        let mut queue = VecDeque::from([from]);
        while let Some(k) = queue.pop_front() {
            for rate in &incidence[k] {
                if reached[*rate].is_some() {
                    continue;
                }
                reached[*rate] = Some(k);
                let Some(next) = self.of_rate[*rate] else { return self.turn(&reached, from, *rate) };
                queue.push_back(next);
            }
        }
    }

    fn turn(&mut self, reached: &[Option<usize>], from: usize, mut rate: usize) {
        while let Some(equation) = reached[rate] {
            let before = self.of_equation[equation];
            self.join(equation, rate);
            match before.filter(|_| equation != from) {
                Some(next) => rate = next,
                None => return,
            }
        }
    }

    /// The equations that have too few derivatives among them because some have none left, of which one is given, and these
    /// derivatives (Dulmage and Mendelsohn 1958).
    pub(super) fn too_many(&self, incidence: &[Vec<usize>], equation: usize) -> (Vec<usize>, Vec<usize>) {
        let mut idle: Vec<Vec<usize>> = vec![Vec::new(); self.of_rate.len()];
        for k in (0..incidence.len()).filter(|k| self.of_equation[*k].is_none()) {
            incidence[k].iter().for_each(|rate| idle[*rate].push(k));
        }
        let (mut equations, mut rates) = (vec![equation], Vec::new());
        let mut seen = vec![false; self.of_rate.len()];
        let mut listed = vec![false; incidence.len()];
        listed[equation] = true;
        let mut next = 0;
        while next < equations.len() {
            for rate in &incidence[equations[next]] {
                if !std::mem::replace(&mut seen[*rate], true) {
                    rates.push(*rate);
                    let others = self.of_rate[*rate].iter().chain(&idle[*rate]);
                    equations.extend(others.filter(|k| !std::mem::replace(&mut listed[**k], true)));
                }
            }
            next += 1;
        }
        equations.sort_unstable();
        rates.sort_unstable();
        (equations, rates)
    }

    /// The derivatives that have too few equations because some have none, of which one is given, and these equations.
    pub(super) fn too_few(&self, incidence: &[Vec<usize>], rate: usize) -> (Vec<usize>, Vec<usize>) {
        let mut users: Vec<Vec<usize>> = vec![Vec::new(); self.of_rate.len()];
        incidence.iter().enumerate().for_each(|(k, own)| own.iter().for_each(|r| users[*r].push(k)));
        let (mut equations, mut rates) = (Vec::new(), vec![rate]);
        let mut seen = vec![false; incidence.len()];
        let mut listed = vec![false; self.of_rate.len()];
        listed[rate] = true;
        let mut next = 0;
        while next < rates.len() {
            for k in &users[rates[next]] {
                if std::mem::replace(&mut seen[*k], true) {
                    continue;
                }
                equations.push(*k);
                let idle = incidence[*k].iter().filter(|r| self.of_rate[**r].is_none());
                let others = idle.chain(&self.of_equation[*k]);
                rates.extend(others.filter(|r| !std::mem::replace(&mut listed[**r], true)));
            }
            next += 1;
        }
        equations.sort_unstable();
        rates.sort_unstable();
        (equations, rates)
    }
}

#[cfg(test)]
mod matching_tests {
    use super::*;

    #[test]
    fn pairs_are_changed_until_every_equation_has_one() {
        let incidence = vec![vec![0], vec![0, 1], vec![1, 2]];
        let pairs = Matching::new(&incidence, 3, &[None, Some(0), Some(1)]);
        assert_eq!(pairs.of_equation, [Some(0), Some(1), Some(2)]);
        assert_eq!(pairs.of_rate, [Some(0), Some(1), Some(2)]);
    }

    #[test]
    fn what_has_none_names_those_that_stand_in_the_way() {
        let incidence = vec![vec![0, 1], vec![0, 1], vec![0, 1], vec![2, 3]];
        let pairs = Matching::new(&incidence, 4, &[None; 4]);
        let left = (0..4).find(|k| pairs.of_equation[*k].is_none()).unwrap();
        assert_eq!(pairs.too_many(&incidence, left), (vec![0, 1, 2], vec![0, 1]));
        let rate = (0..4).find(|r| pairs.of_rate[*r].is_none()).unwrap();
        assert_eq!(pairs.too_few(&incidence, rate), (vec![3], vec![2, 3]));
    }
}
