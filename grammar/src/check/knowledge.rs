//! What is known beside the equations: `prior a ~ normal(mean, deviation);`, `noise y = deviation;` (one number, or an expression of everything), `noise der(x) = intensity;`,
//! `trim { x = value; }`.

use super::expressions::{Expressions, Indices};
use super::kinds::{Kinds, Level};
use super::scope::{Scope, Symbol, SymbolId};
use super::stated::{Known, Part};
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::graph::Signal;
use crate::model::{Limits, Prior, Reset};
use crate::op::ExprId;
use crate::source::Span;
use crate::syntax::{Expr, ExprRef, Limited, Name, Role, StatementKind, Value, When};
use std::collections::HashMap;

/// Reads all statements of knowledge; each subject has one at most.
pub(super) fn read(scope: &Scope<'_>, findings: &mut Vec<Diagnostic>) -> Vec<Known> {
    let mut reader = Reader { scope, findings, first: HashMap::new(), guesses: 0, known: Vec::new(), events: 0 };
    for statement in &scope.tree.statements {
        match &statement.kind {
            StatementKind::Prior(list) => list.iter().for_each(|(subject, value)| reader.prior(*subject, *value)),
            StatementKind::Noise(list) => list.iter().for_each(|(output, value)| reader.noise(output, *value)),
            StatementKind::Process(list) => list.iter().for_each(|(state, value)| reader.process(state, *value)),
            StatementKind::Limit(list) => list.iter().for_each(|limited| reader.limit(limited)),
            StatementKind::Trim(list) => list.iter().for_each(|(signal, value)| reader.trim(signal, *value)),
            StatementKind::When(event) => reader.event(event),
            _ => {}
        }
    }
    reader.known
}

struct Reader<'a, 'b> {
    scope: &'b Scope<'a>,
    findings: &'b mut Vec<Diagnostic>,
    /// Where something was said about a symbol first, and what.
    first: HashMap<(SymbolId, &'static str), Span>,
    guesses: usize,
    known: Vec<Known>,
    /// Events so far.
    events: usize,
}

impl Reader<'_, '_> {
    fn tell(&mut self, code: Code, span: Span, message: impl Into<String>, hint: impl Into<String>) {
        self.findings.push(Diagnostic::new(code, span, message).hint(hint));
    }

    fn prior(&mut self, subject: ExprRef, value: ExprRef) {
        let subject = self.prior_subject(subject);
        let (Some((s, span)), Some([mean, deviation])) = (subject, self.normal(value)) else { return };
        if self.is_first(s, span, "prior") {
            self.known.push(Known { part: Part::Mean, symbol: s, subject: span, root: mean });
            self.known.push(Known { part: Part::Deviation, symbol: s, subject: span, root: deviation });
        }
    }

    fn noise(&mut self, output: &Name, value: ExprRef) {
        let scope = self.scope;
        let Some(s) = self.declared(&output.text, output.span, |s| s.role == Role::Output) else { return };
        let symbol = &scope.symbols[s];
        if symbol.role != Role::Output {
            let message = format!("`{}` is {}; noise is known of outputs", output.text, symbol.role.with_article());
            return self.tell(Code::WrongName, output.span, message, "`noise y = 0.1;` where `y` is an output");
        }
        if self.is_first(s, output.span, "noise") {
            self.known.push(Known { part: Part::Noise, symbol: s, subject: output.span, root: value });
        }
    }

    fn process(&mut self, state: &Name, value: ExprRef) {
        let scope = self.scope;
        let Some(s) = self.declared(&state.text, state.span, |s| s.role == Role::State) else { return };
        let symbol = &scope.symbols[s];
        if symbol.role != Role::State {
            let message = format!("`{}` is {}; `der` is of states", state.text, symbol.role.with_article());
            let hint = match symbol.role {
                Role::Output => format!("`noise {} = 0.1;` is the noise of its measurement", state.text),
                _ => "noise enters the equations of states".to_string(),
            };
            return self.tell(Code::WrongName, state.span, message, hint);
        }
        if self.is_first(s, state.span, "process noise") {
            self.known.push(Known { part: Part::Intensity, symbol: s, subject: state.span, root: value });
        }
    }

    fn limit(&mut self, limited: &Limited) {
        let (scope, state) = (self.scope, &limited.state);
        let Some(s) = self.declared(&state.text, state.span, |s| s.role == Role::State) else { return };
        let symbol = &scope.symbols[s];
        if symbol.role != Role::State {
            let message = format!("`{}` is {}; a limit is of states", state.text, symbol.role.with_article());
            let hint = match symbol.role {
                Role::Param => {
                    format!("bounds of a param stand in its declaration: `param {} = 1 in [0, 2];`", state.text)
                }
                _ => format!("a value is limited by `clip({}, lower, upper)`", state.text),
            };
            return self.tell(Code::WrongName, state.span, message, hint);
        }
        if self.is_first(s, state.span, "limit") {
            let Limited { bounds, smooth, .. } = limited;
            let parts = [(Part::Lower, Some(bounds.lower)), (Part::Upper, Some(bounds.upper)), (Part::Width, *smooth)];
            for (part, root) in parts.into_iter().filter_map(|(part, root)| Some((part, root?))) {
                self.known.push(Known { part, symbol: s, subject: state.span, root });
            }
        }
    }

    fn trim(&mut self, signal: &Name, value: ExprRef) {
        let scope = self.scope;
        let varies = |role: Role| matches!(role, Role::State | Role::Input);
        let Some(s) = self.declared(&signal.text, signal.span, |s| varies(s.role)) else { return };
        let symbol = &scope.symbols[s];
        if !varies(symbol.role) {
            let message =
                format!("`{}` is {}; a trim is of states and inputs", signal.text, symbol.role.with_article());
            let hint = match symbol.role {
                Role::Output | Role::Let => "give the states and inputs that it is made of",
                _ => "its value is the same everywhere",
            };
            return self.tell(Code::WrongName, signal.span, message, hint);
        }
        if self.is_first(s, signal.span, "trim") {
            self.known.push(Known { part: Part::Trim, symbol: s, subject: signal.span, root: value });
        }
    }

    fn event(&mut self, event: &When) {
        let (scope, number, before) = (self.scope, self.events, self.known.len());
        self.events += 1;
        for (state, value) in &event.resets {
            let Some(s) = self.declared(&state.text, state.span, |s| s.role == Role::State) else { continue };
            let symbol = &scope.symbols[s];
            if symbol.role != Role::State {
                let message = format!("`{}` is {}; an event sets states", state.text, symbol.role.with_article());
                let hint =
                    format!("what changes at events alone is a state at rest: `state {0}; der({0}) = 0;`", state.text);
                self.tell(Code::WrongName, state.span, message, hint);
                continue;
            }
            if let Some(first) = self.known[before..].iter().find(|k| k.symbol == s) {
                let message = format!("the event sets `{}` a second time", symbol.name());
                let finding = Diagnostic::new(Code::DeclaredTwice, state.span, message);
                self.findings.push(finding.label(first.subject, "first set here").hint("remove one of them"));
                continue;
            }
            self.known.push(Known { part: Part::Reset(number), symbol: s, subject: state.span, root: *value });
        }
        if let Some(first) = self.known.get(before).copied() {
            self.known.push(Known { part: Part::Condition(number), root: event.condition, ..first });
        }
    }

    /// The symbol of a name; an unknown one is told with the nearest that would do.
    fn declared(&mut self, name: &str, span: Span, wanted: impl Fn(&Symbol<'_>) -> bool) -> Option<SymbolId> {
        if let Some(s) = self.scope.find(name) {
            return Some(s);
        }
        if !self.scope.is_suspended(name) {
            self.guesses += 1;
            let finding = Diagnostic::new(Code::UnknownName, span, format!("`{name}` is not declared"));
            let near = self.scope.nearest(name, self.guesses, wanted);
            self.findings.push(near.into_iter().fold(finding, Diagnostic::hint));
        }
        None
    }

    /// The param, or the state of `x(0)`.
    fn prior_subject(&mut self, subject: ExprRef) -> Option<(SymbolId, Span)> {
        let scope = self.scope;
        let span = scope.tree.span(subject);
        let (name, initial) = match scope.tree.expr(subject) {
            Expr::Name(name) => (name, false),
            Expr::Call(name, arguments) if is_zero(scope, arguments) => (&name.text, true),
            _ => {
                self.tell(
                    Code::WrongName,
                    span,
                    "a prior is known of a param or of an initial value",
                    "`prior a ~ normal(1, 0.1);`, `prior x(0) ~ normal(1, 0.1);`",
                );
                return None;
            }
        };
        let s = self.declared(name, span, |s| (s.role == Role::State) == initial && is_estimable(s.role))?;
        let symbol = &scope.symbols[s];
        match (symbol.role, initial, symbol.declaration.value) {
            (Role::Param, false, _) | (Role::State, true, Some(Value::Free(_))) => return Some((s, span)),
            (Role::State, true, _) => {
                let message =
                    format!("the initial value of `{name}` is not estimated by itself, so that it has no prior");
                let hint = format!("`state {name} = free;` estimates it; a param that it is made of has its own prior");
                self.tell(Code::WrongName, span, message, hint);
            }
            (Role::State, false, _) => {
                let message = format!("`{name}` is a state; a prior is known of a param or of an initial value");
                self.tell(
                    Code::WrongName,
                    span,
                    message,
                    format!("`prior {name}(0) ~ ...` is about its initial value"),
                );
            }
            (role, ..) => {
                let message =
                    format!("`{name}` is {}; a prior is known of a param or of an initial value", role.with_article());
                self.tell(Code::WrongName, span, message, "`prior a ~ normal(1, 0.1);` where `a` is a param");
            }
        }
        None
    }

    /// Mean and deviation of `normal(mean, deviation)`.
    fn normal(&mut self, value: ExprRef) -> Option<[ExprRef; 2]> {
        let (tree, span) = (self.scope.tree, self.scope.tree.span(value));
        const FORM: &str = "`normal(mean, deviation)`";
        match tree.expr(value) {
            Expr::Call(name, arguments) if name.text == "normal" => match arguments[..] {
                [mean, deviation] => return Some([mean, deviation]),
                _ => {
                    let message = format!("`normal` takes 2 arguments, {} given", arguments.len());
                    self.tell(Code::ArgumentCount, span, message, FORM);
                }
            },
            Expr::Call(name, _) => {
                let message = format!("`{}` is not a distribution that priors have", name.text);
                let hint = match name.text.to_lowercase().as_str() {
                    "uniform" => "bounds hold what is equally likely: `param a = 1 in [0, 2];`".to_string(),
                    "gauss" | "gaussian" | "norm" | "n" => format!("write {FORM}"),
                    lower => match nearest(lower, ["normal"]) {
                        Some(near) => format!("did you mean `{near}`?"),
                        None => format!("priors are {FORM}"),
                    },
                };
                self.tell(Code::UnknownFunction, name.span, message, hint);
            }
            _ => self.tell(Code::WrongName, span, "a prior is a distribution", FORM),
        }
        None
    }

    fn is_first(&mut self, s: SymbolId, span: Span, what: &'static str) -> bool {
        let Some(first) = self.first.get(&(s, what)).copied() else {
            self.first.insert((s, what), span);
            return true;
        };
        let message = format!("the {what} of `{}` is given a second time", self.scope.symbols[s].name());
        let finding = Diagnostic::new(Code::DeclaredTwice, span, message).label(first, "first given here");
        self.findings.push(finding.hint("remove one of them"));
        false
    }
}

fn is_zero(scope: &Scope<'_>, arguments: &[ExprRef]) -> bool {
    matches!(arguments, [argument] if *scope.tree.expr(*argument) == Expr::Number(0.0))
}

fn is_estimable(role: Role) -> bool {
    matches!(role, Role::Param | Role::State)
}

/// The priors by parameter of the model, the noise by output, its intensity, limits and events by state, the trim by state or input.
#[derive(Default)]
pub(super) struct Knowledge {
    pub(super) process: Vec<(u32, ExprId)>,
    pub(super) trim: Vec<(Signal, ExprId)>,
    pub(super) priors: Vec<(u32, Prior)>,
    pub(super) noise: Vec<(u32, f64)>,
    pub(super) noise_models: Vec<(u32, ExprId)>,
    pub(super) limits: Vec<(u32, Limits)>,
    pub(super) resets: Vec<(u32, Reset)>,
}

/// The numbers behind all statements, checked: deviations are positive, and what they are about is estimated.
pub(super) fn values(
    scope: &Scope<'_>,
    kinds: &Kinds,
    indices: &Indices,
    expressions: &Expressions,
    known: &[Known],
    findings: &mut Vec<Diagnostic>,
) -> Knowledge {
    let mut knowledge = Knowledge::default();
    // what is not finite has been told
    let value = |k: &Known| expressions.constant(k.root).filter(|v| v.is_finite() && !kinds.of(k.root).broken);
    let (mut mean, mut lower) = (None, None);
    let fades = |s: SymbolId| known.iter().any(|k| k.part == Part::Width && k.symbol == s);
    for k in known.iter().filter(|k| !k.part.is_of_event()) {
        if k.part.is_limit() {
            // a smooth limit stands in the rate alone
            let e = expressions.of(k.root);
            lower = if k.part == Part::Lower { Some(e) } else { lower };
            if let (Part::Upper, false, Some(lower)) = (k.part, fades(k.symbol), lower) {
                knowledge.limits.push((indices.of[k.symbol], Limits { lower, upper: e }));
            }
            continue;
        }
        if k.part == Part::Trim {
            let index = indices.of[k.symbol];
            let state = scope.symbols[k.symbol].role == Role::State;
            let signal = if state { Signal::State(index) } else { Signal::Input(index) };
            knowledge.trim.push((signal, expressions.of(k.root)));
            continue;
        }
        if k.part == Part::Intensity {
            knowledge.process.push((indices.of[k.symbol], expressions.of(k.root)));
            intensity(scope, kinds, expressions, k, findings);
            continue;
        }
        if k.part == Part::Noise && kinds.of(k.root).level > Level::Constant {
            if !kinds.of(k.root).broken {
                knowledge.noise_models.push((indices.of[k.symbol], expressions.of(k.root)));
            }
            continue;
        }
        if k.part == Part::Mean {
            mean = value(k);
            estimated(scope, kinds, k, findings);
            continue;
        }
        let Some(deviation) = value(k) else { continue };
        if deviation <= 0.0 {
            let message = format!("{} is {deviation}, and must be above 0", k.words(scope));
            let finding = Diagnostic::new(Code::NeedlessValue, scope.tree.span(k.root), message);
            findings.push(finding.hint(match k.part {
                Part::Noise => "without this statement the noise is estimated".to_string(),
                _ => {
                    format!("what is known exactly is a value: `param {} = ... fixed;`", scope.symbols[k.symbol].name())
                }
            }));
        } else if k.part == Part::Noise {
            knowledge.noise.push((indices.of[k.symbol], deviation));
        } else if let Some(mean) = mean {
            let param = indices.initial[k.symbol].unwrap_or(indices.of[k.symbol]);
            knowledge.priors.push((param, Prior { mean, deviation }));
        }
    }
    knowledge
}

/// Tells an intensity that is a number and not above 0.
fn intensity(scope: &Scope<'_>, kinds: &Kinds, expressions: &Expressions, k: &Known, findings: &mut Vec<Diagnostic>) {
    let value = expressions.constant(k.root).filter(|v| v.is_finite() && !kinds.of(k.root).broken);
    if let Some(value) = value.filter(|v| *v <= 0.0) {
        let message = format!("{} is {value}, and must be above 0", k.words(scope));
        let finding = Diagnostic::new(Code::NeedlessValue, scope.tree.span(k.root), message);
        findings.push(
            finding.hint("without this statement no noise enters the equation; a param in its place is estimated"),
        );
    }
}

/// Tells a prior of what is not estimated.
fn estimated(scope: &Scope<'_>, kinds: &Kinds, known: &Known, findings: &mut Vec<Diagnostic>) {
    let symbol = &scope.symbols[known.symbol];
    let span = known.subject;
    if kinds.derived[known.symbol] {
        let message = format!("`{}` is defined by other params, so that it has no prior of its own", symbol.name());
        findings
            .push(Diagnostic::new(Code::WrongName, span, message).hint("give priors for the params in its definition"));
    } else if let Some(fixed) = symbol.declaration.fixed {
        let message = format!("the prior of `{}` is not used while it is fixed", symbol.name());
        let finding = Diagnostic::new(Code::Unused, span, message).label(fixed, "fixed here");
        findings.push(finding.hint("remove `fixed`, or the prior"));
    }
}
