//! Which equation belongs to which state.

use super::functions::Function;
use super::names::{Scope, Symbol, SymbolId, argument_count};
use super::order::each_operand;
use crate::diagnostic::{Code, Diagnostic};
use crate::syntax::{BinarySign, Expr, ExprRef, Name, Role, StatementKind};

/// `left = right`, with the state whose derivative stands on the left.
pub(super) struct Equation {
    /// The left side, whole.
    pub(super) left: ExprRef,
    /// The right side.
    pub(super) right: ExprRef,
    /// The state; `None` when the left side is no derivative of one.
    pub(super) state: Option<SymbolId>,
}

/// Reads the left sides. Every state must have exactly one equation.
pub(super) fn read(scope: &mut Scope<'_>, findings: &mut Vec<Diagnostic>) -> Vec<Equation> {
    let tree = scope.tree;
    let mut first: Vec<Option<ExprRef>> = vec![None; scope.symbols.len()];
    // states that a faulty left side mentions: their equation is there, only not well written
    let mut excused = vec![false; scope.symbols.len()];
    let mut equations = Vec::new();
    let mut guesses = 0;
    for statement in &tree.statements {
        let StatementKind::Equation(left, right) = statement.kind else { continue };
        let state = match derivative_of(scope, left, right, &mut guesses) {
            Ok(state) => state,
            Err(finding) => {
                findings.extend(finding);
                excuse(scope, left, guesses, &mut excused);
                None
            }
        };
        if let Some(s) = state {
            match first[s] {
                Some(earlier) => findings.push(second_equation(scope, s, left, earlier)),
                None => first[s] = Some(left),
            }
        }
        equations.push(Equation { left, right, state });
    }
    for (s, symbol) in scope.valid().filter(|(_, symbol)| symbol.role == Role::State) {
        if first[s].is_none() && !excused[s] && !scope.is_suspended(symbol.name()) {
            let name = &symbol.declaration.name;
            let message = format!("the state `{}` has no equation", name.text);
            let finding = Diagnostic::new(Code::MissingEquation, name.span, message);
            findings.push(finding.hint(format!("`der({}) = ...;`", name.text)));
        }
    }
    equations
}

fn second_equation(scope: &Scope<'_>, s: SymbolId, left: ExprRef, first: ExprRef) -> Diagnostic {
    let message = format!("the state `{}` has a second equation", scope.symbols[s].name());
    Diagnostic::new(Code::TwoEquations, scope.tree.span(left), message)
        .label(scope.tree.span(first), "its first equation")
        .hint("add the right sides or remove one of the equations")
}

/// The state of `der(state)`; `Ok(None)` when what is wrong has been told elsewhere.
fn derivative_of(
    scope: &Scope<'_>,
    left: ExprRef,
    right: ExprRef,
    guesses: &mut usize,
) -> Result<Option<SymbolId>, Option<Diagnostic>> {
    let tree = scope.tree;
    match tree.expr(left) {
        Expr::Call(name, arguments) if name.text == "der" => match arguments[..] {
            [argument] => differentiated(scope, left, argument, guesses),
            _ => Err(Some(argument_count(Function::Der, name, arguments.len(), tree.span(left)))),
        },
        Expr::Name(name) => Err(not_a_derivative(scope, left, right, name)),
        _ if mentions(scope, left, |e| matches!(e, Expr::Call(name, _) if name.text == "der")) => {
            let message = "an equation is solved for one derivative; other left sides are not compiled yet";
            let finding = Diagnostic::new(Code::Unsupported, tree.span(left), message);
            Err(Some(finding.hint("solve it by hand: `der(x) = ...;`")))
        }
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
        let message = "`der` is taken of a state, by its name";
        let finding = Diagnostic::new(Code::NotADerivative, tree.span(left), message);
        return Err(Some(finding.hint("declare a `state` for this quantity")));
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

fn mentions(scope: &Scope<'_>, root: ExprRef, wanted: impl Fn(&Expr) -> bool) -> bool {
    let mut found = false;
    each_node(scope, root, |e| found |= wanted(e));
    found
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

fn each_node<'a>(scope: &Scope<'a>, root: ExprRef, mut visit: impl FnMut(&'a Expr)) {
    let tree = scope.tree;
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        visit(tree.expr(e));
        each_operand(tree.expr(e), |operand| open.push(operand));
    }
}
