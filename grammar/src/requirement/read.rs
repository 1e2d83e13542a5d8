//! Reads requirements: each call of a function of `mod.rs` becomes a measure, and a name that stands for it; what is left are expressions of params,
//! which are checked as those of a model.

use super::{Argument, Asks, DRIVES, FUNCTIONS, Function};
use super::{Drive, Form, Measure, Observed, OfCourse, OfMode, OfResponse, Requirement, Requirements, Target, What};
use crate::check::check;
use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::model::Model;
use crate::source::{Source, Span};
use crate::syntax::{
    Declaration, Expr, ExprRef, Name, Role, Statement, StatementKind, SyntaxTree, UnarySign, Value, operands,
};
use crate::unit::Unit;
use std::collections::{HashMap, HashSet};

/// Takes the requirements out of a tree: no later pass knows of them.
pub(crate) fn taken(tree: &mut SyntaxTree) -> Vec<Declaration> {
    let mut list = Vec::new();
    tree.statements.retain_mut(|statement| match &mut statement.kind {
        StatementKind::Requirement(own) => {
            list.append(own);
            false
        }
        _ => true,
    });
    list
}

/// The names that stand in requirements.
pub(crate) fn mentioned<'t>(tree: &'t SyntaxTree, list: &[Declaration]) -> HashSet<&'t str> {
    let mut names = HashSet::new();
    for root in list.iter().flat_map(roots) {
        each(tree, root, |_, expr| {
            if let Expr::Name(name) | Expr::Call(Name { text: name, .. }, _) = expr {
                names.insert(name.as_str());
            }
            true
        });
    }
    names
}

/// Value and limits.
fn roots(d: &Declaration) -> impl Iterator<Item = ExprRef> {
    let value = if let Some(Value::Expr(e)) = d.value { Some(e) } else { None };
    value.into_iter().chain(d.bounds.iter().flat_map(|b| [b.lower, b.upper]))
}

/// Visits an expression and what is in it, as long as `visit` says to go on.
fn each<'t>(tree: &'t SyntaxTree, root: ExprRef, mut visit: impl FnMut(ExprRef, &'t Expr) -> bool) {
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        if visit(e, tree.expr(e)) {
            operands(tree.expr(e), |operand| open.push(operand));
        }
    }
}

/// The requirements of a model that was checked from the rest of this tree.
///
/// # Errors
/// Every mistake in them.
pub(crate) fn requirements(
    source: &Source,
    tree: &SyntaxTree,
    list: &[Declaration],
    model: &Model,
) -> Result<Requirements, Vec<Diagnostic>> {
    let mut reader = Reader::new(source, tree, model);
    for d in list {
        reader.requirement(d);
    }
    reader.finish()
}

/// A number among the arguments of a measure, which is an output of the model of requirements until its value is known.
#[derive(Debug, Clone, Copy)]
struct Number {
    /// Place among the outputs that are made for numbers.
    at: usize,
    span: Span,
    argument: Argument,
}

/// A measure whose numbers are not known yet.
struct Pending {
    text: String,
    unit: Option<Unit>,
    call: Call,
}

/// What a call says.
struct Call {
    asks: Asks,
    signals: Vec<Observed>,
    state: u32,
    row: Option<Target>,
    column: u32,
    input: u32,
    numbers: Vec<Number>,
    drives: Vec<(usize, u32, Vec<Number>)>,
}

struct Reader<'a> {
    source: &'a Source,
    tree: &'a SyntaxTree,
    model: &'a Model,
    roles: HashMap<&'a str, Option<Role>>,
    /// Names of what varies: inputs, states, outputs, and lets that are made of such.
    varying: HashSet<&'a str>,
    expressions: Vec<(Expr, Span)>,
    pending: Vec<Pending>,
    outputs: Vec<Declaration>,
    /// Outputs behind those of the requirements: limits and numbers.
    constants: Vec<Declaration>,
    list: Vec<(Requirement, [Option<usize>; 2], Span)>,
    seen: HashMap<&'a str, Span>,
    findings: Vec<Diagnostic>,
}

impl<'a> Reader<'a> {
    fn new(source: &'a Source, tree: &'a SyntaxTree, model: &'a Model) -> Self {
        let mut roles = HashMap::new();
        for statement in &tree.statements {
            match &statement.kind {
                StatementKind::Declare(role, list) => {
                    roles.extend(list.iter().map(|d| (d.name.text.as_str(), Some(*role))));
                }
                StatementKind::Table(table) => {
                    roles.insert(table.name.text.as_str(), None);
                }
                _ => {}
            }
        }
        let varying = varying(tree, &roles);
        Self {
            source,
            tree,
            model,
            roles,
            varying,
            expressions: tree.expressions.clone(),
            pending: Vec::new(),
            outputs: Vec::new(),
            constants: Vec::new(),
            list: Vec::new(),
            seen: HashMap::new(),
            findings: Vec::new(),
        }
    }

    fn tell(&mut self, code: Code, span: Span, message: impl Into<String>, hint: impl Into<String>) {
        self.findings.push(Diagnostic::new(code, span, message).hint(hint));
    }

    fn slice(&self, e: ExprRef) -> String {
        self.source.slice(self.tree.span(e)).split_whitespace().collect::<Vec<_>>().join(" ")
    }

    fn requirement(&mut self, d: &'a Declaration) {
        let name = &d.name.text;
        if let Some(first) = self.seen.insert(name, d.name.span) {
            let message = format!("the requirement `{name}` is declared a second time");
            let finding =
                Diagnostic::new(Code::DeclaredTwice, d.name.span, message).label(first, "first declared here");
            self.findings.push(finding.hint("give it another name"));
        }
        if self.roles.contains_key(name.as_str()) {
            let message = format!("`{name}` is declared in the model already");
            self.tell(Code::DeclaredTwice, d.name.span, message, "give the requirement another name");
        }
        let attributes = [
            d.fixed,
            d.per_run,
            d.log,
            d.hold.map(|h| h.span),
            d.shape.map(|s| s.span),
            d.wrap.as_ref().map(|w| w.span),
        ];
        for span in attributes.into_iter().flatten().chain(d.group.as_ref().map(|g| g.span)) {
            let message = format!("the requirement `{name}` has a unit and limits, nothing else");
            self.tell(Code::WrongAttribute, span, message, "`requirement name [unit] = expression in [lower, upper];`");
        }
        let Some(Value::Expr(root)) = d.value else {
            let message = format!("the requirement `{name}` has no expression");
            let hint = "`requirement name = expression in [lower, upper];`";
            return self.tell(Code::MissingValue, d.name.span, message, hint);
        };
        self.expression(root);
        let limits = d.bounds.map(|b| {
            [b.lower, b.upper].map(|e| match self.infinity(e) {
                Some(infinite) => (None, infinite),
                None => (Some(self.constant(e, d.unit.as_ref().map(|u| u.text.clone()))), 0.0),
            })
        });
        let limits = limits.unwrap_or([(None, f64::NEG_INFINITY), (None, f64::INFINITY)]);
        let text = self.slice(root);
        let bounds_span = d.bounds.map_or(d.name.span, |b| b.span);
        let own_unit = d.unit.as_ref().and_then(|u| Unit::parse(&u.text).ok());
        // that of a measure which stands alone
        let unit = own_unit.or_else(|| match &self.expressions[root.0 as usize].0 {
            Expr::Name(name) => measure_number(name).and_then(|k| self.pending.get(k)?.unit.clone()),
            _ => None,
        });
        let doc = d.doc.as_ref().map_or(String::new(), |doc| doc.text.clone());
        let quantity = crate::model::Quantity { name: name.clone(), doc, unit };
        let [(lower_at, lower), (upper_at, upper)] = limits;
        self.list.push((Requirement { quantity, text, lower, upper }, [lower_at, upper_at], bounds_span));
        let output = Declaration { bounds: None, ..Declaration::new(d.name.clone(), d.span) };
        self.outputs.push(Declaration { value: Some(Value::Expr(root)), unit: d.unit.clone(), ..output });
    }

    /// `inf`, `-inf`
    fn infinity(&self, e: ExprRef) -> Option<f64> {
        match self.tree.expr(e) {
            Expr::Name(name) if name == "inf" => Some(f64::INFINITY),
            Expr::Number(value) if value.is_infinite() => Some(*value),
            Expr::Unary(UnarySign::Minus, a) => self.infinity(*a).map(|v| -v),
            _ => None,
        }
    }

    /// An output for a number that must not depend on params.
    fn constant(&mut self, e: ExprRef, unit: Option<String>) -> usize {
        self.expression(e);
        let span = self.tree.span(e);
        let name = Name { text: format!("number {}", self.constants.len() + 1), span };
        let unit = unit.map(|text| Name { text, span });
        self.constants.push(Declaration { value: Some(Value::Expr(e)), unit, ..Declaration::new(name, span) });
        self.constants.len() - 1
    }

    /// Measures become names; what varies is refused.
    fn expression(&mut self, root: ExprRef) {
        let tree = self.tree;
        let mut calls = Vec::new();
        let mut wrong = Vec::new();
        each(tree, root, |e, expr| match expr {
            Expr::Call(name, _)
                if Function::find(&name.text).is_some() && !self.roles.contains_key(name.text.as_str()) =>
            {
                calls.push(e);
                false
            }
            Expr::Name(name) if self.varying.contains(name.as_str()) || name == "t" => {
                wrong.push((tree.span(e), name.clone()));
                true
            }
            Expr::Call(name, _) if ["der", "delay", "measured", "initial"].contains(&name.text.as_str()) => {
                wrong.push((name.span, name.text.clone()));
                false
            }
            _ => true,
        });
        for (span, name) in wrong {
            let message = format!("`{name}` varies with time, and a requirement is about numbers");
            let hint = format!("say what of it, such as `maximum({name}, duration, step(u, size))`, `mode_damping(x)`");
            self.tell(Code::NotConstant, span, message, hint);
        }
        for e in calls {
            let Expr::Call(name, arguments) = tree.expr(e) else { continue };
            let stands = match self.call(e, name, arguments) {
                Some(pending) => {
                    self.pending.push(pending);
                    Expr::Name(measure_name(self.pending.len() - 1))
                }
                None => Expr::Vector(Vec::new()),
            };
            // numbers among the arguments are outputs of their own
            self.expressions[e.0 as usize].0 = stands;
        }
        // a function that is near to one of these is told here: the checker knows only its own
        let mut unknown = Vec::new();
        each(tree, root, |_, expr| match expr {
            Expr::Call(name, _) if Function::find(&name.text).is_some() => false,
            Expr::Call(name, _) => {
                let known =
                    self.roles.contains_key(name.text.as_str()) || crate::check::function_form(&name.text).is_some();
                if !known {
                    unknown.push(name.clone());
                }
                true
            }
            _ => true,
        });
        for name in unknown {
            let message = format!("the function `{}` does not exist", name.text);
            let near = nearest(&name.text, FUNCTIONS.iter().map(|f| f.name));
            let near = near
                .and_then(Function::find)
                .map_or("requirements are made of modes, responses and params".to_string(), |f| {
                    format!("did you mean `{}`?", f.form)
                });
            self.tell(Code::UnknownFunction, name.span, message, near);
        }
    }

    /// A measure; `None` where a mistake has been told.
    fn call(&mut self, e: ExprRef, name: &Name, arguments: &[ExprRef]) -> Option<Pending> {
        let function = Function::find(&name.text)?;
        let wanted = function.arguments();
        let many = wanted.last() == Some(&Argument::Drives);
        let enough = if many { arguments.len() >= wanted.len() } else { arguments.len() == wanted.len() };
        if !enough {
            let least = if many { "at least " } else { "" };
            let message = format!("`{}` takes {least}{} arguments, {} given", name.text, wanted.len(), arguments.len());
            self.tell(Code::ArgumentCount, self.tree.span(e), message, format!("`{}`", function.form));
            return None;
        }
        let mut call = Call {
            asks: function.asks,
            signals: Vec::new(),
            state: 0,
            row: None,
            column: 0,
            input: 0,
            numbers: Vec::new(),
            drives: Vec::new(),
        };
        let mut sound = true;
        for (k, e) in arguments.iter().enumerate() {
            let kind = wanted.get(k).copied().unwrap_or(Argument::Drives);
            sound &= self.argument(*e, kind, function, &mut call).is_some();
        }
        if !sound {
            return None;
        }
        Some(Pending { text: self.slice(e), unit: self.unit(&call), call })
    }

    fn argument(&mut self, e: ExprRef, kind: Argument, function: Function, call: &mut Call) -> Option<()> {
        let time = self.model.time.to_string();
        match kind {
            Argument::State => call.state = self.index(e, Role::State, "a state", function)?,
            Argument::Input => call.input = self.index(e, Role::Input, "an input", function)?,
            Argument::Signal => call.signals.push(self.signal(e, function)?),
            Argument::Row => {
                let Observed { target, negative } = self.signal(e, function)?;
                if negative {
                    let message = "a coefficient is that of an equation, which has no sign";
                    self.tell(Code::WrongName, self.tree.span(e), message, "put the minus before the call");
                    return None;
                }
                call.row = Some(target);
            }
            Argument::Column => {
                let state = matches!(self.tree.expr(e), Expr::Name(n) if self.roles.get(n.as_str()) == Some(&Some(Role::State)));
                call.column = match state {
                    true => self.index(e, Role::State, "a state or an input", function)?,
                    false => {
                        self.model.states.len() as u32 + self.index(e, Role::Input, "a state or an input", function)?
                    }
                };
            }
            Argument::Duration => self.number(e, kind, Some(time), call),
            Argument::Frequency => self.number(e, kind, Some(format!("rad/({time})")), call),
            Argument::Level => {
                let unit = call.signals.last().and_then(|s| self.unit_of(s.target)).map(|u| u.to_string());
                self.number(e, kind, unit, call);
            }
            Argument::Size => {
                let unit = self.model.inputs[call.input as usize].quantity.unit.as_ref().map(ToString::to_string);
                self.number(e, kind, unit, call);
            }
            Argument::Count => self.number(e, kind, Some("1".into()), call),
            Argument::Drives => {
                let drive = self.drive(e, function)?;
                call.drives.push(drive);
            }
        }
        Some(())
    }

    fn number(&mut self, e: ExprRef, argument: Argument, unit: Option<String>, call: &mut Call) {
        let at = self.constant(e, unit);
        call.numbers.push(Number { at, span: self.tree.span(e), argument });
    }

    fn drive(&mut self, e: ExprRef, function: Function) -> Option<(usize, u32, Vec<Number>)> {
        let tree = self.tree;
        let span = tree.span(e);
        let hint = || DRIVES.iter().map(|(_, form, _)| format!("`{form}`")).collect::<Vec<_>>().join(", ");
        let Expr::Call(name, arguments) = tree.expr(e) else {
            let message = format!("`{}` ends with what the inputs do", function.form);
            self.tell(Code::WrongName, span, message, format!("standard inputs are {}", hint()));
            return None;
        };
        let Some(which) = DRIVES.iter().position(|(n, ..)| *n == name.text) else {
            let near = nearest(&name.text, DRIVES.iter().map(|(n, ..)| *n));
            let hint =
                near.map_or_else(|| format!("standard inputs are {}", hint()), |n| format!("did you mean `{n}`?"));
            self.tell(Code::UnknownFunction, name.span, format!("`{}` is not a standard input", name.text), hint);
            return None;
        };
        let (_, form, numbers) = DRIVES[which];
        if arguments.len() != numbers + 1 {
            let message = format!("`{}` takes {} arguments, {} given", name.text, numbers + 1, arguments.len());
            self.tell(Code::ArgumentCount, span, message, format!("`{form}`"));
            return None;
        }
        let input = self.index(arguments[0], Role::Input, "an input", function)?;
        let unit = self.model.inputs[input as usize].quantity.unit.as_ref().map(ToString::to_string);
        let units = [unit, Some(self.model.time.to_string())];
        let kinds = [Argument::Size, Argument::Duration];
        let mut read = Vec::new();
        for (k, e) in arguments[1..].iter().enumerate() {
            let at = self.constant(*e, units[k].clone());
            read.push(Number { at, span: tree.span(*e), argument: kinds[k] });
        }
        Some((which, input, read))
    }

    /// The index of a name of this role.
    fn index(&mut self, e: ExprRef, role: Role, what: &str, function: Function) -> Option<u32> {
        let span = self.tree.span(e);
        let Expr::Name(name) = self.tree.expr(e) else {
            let message = format!("`{}` wants the name of {what} here", function.form);
            self.tell(Code::WrongName, span, message, "an expression has no mode and drives nothing");
            return None;
        };
        let model = self.model;
        let list: Vec<&str> = match role {
            Role::State => model.states.iter().map(|s| s.quantity.name.as_str()).collect(),
            _ => {
                model.inputs.iter().filter(|i| i.is_declared() && !i.known).map(|i| i.quantity.name.as_str()).collect()
            }
        };
        if let Some(k) = list.iter().position(|n| n == name) {
            return Some(match role {
                Role::State => k as u32,
                _ => model.inputs.iter().position(|i| i.quantity.name == *name).unwrap_or_default() as u32,
            });
        }
        self.stranger(name, span, what, &list, function);
        None
    }

    /// A state or an output, perhaps with a minus.
    fn signal(&mut self, e: ExprRef, function: Function) -> Option<Observed> {
        let (inner, negative) = match self.tree.expr(e) {
            Expr::Unary(UnarySign::Minus, inner) => (*inner, true),
            _ => (e, false),
        };
        let span = self.tree.span(e);
        let Expr::Name(name) = self.tree.expr(inner) else {
            let message = format!("`{}` wants the name of a state or an output here", function.form);
            self.tell(
                Code::WrongName,
                span,
                message,
                "declare the expression as an output, or as a state that integrates it",
            );
            return None;
        };
        let model = self.model;
        let states = model.states.iter().map(|s| s.quantity.name.as_str());
        let outputs = model.outputs.iter().map(|o| o.quantity.name.as_str());
        let target = match states.clone().position(|n| n == name) {
            Some(k) => Some(Target::State(k as u32)),
            None => outputs.clone().position(|n| n == name).map(|k| Target::Output(k as u32)),
        };
        if target.is_none() {
            let all: Vec<&str> = states.chain(outputs).collect();
            self.stranger(name, span, "a state or an output", &all, function);
        }
        Some(Observed { target: target?, negative })
    }

    fn stranger(&mut self, name: &str, span: Span, what: &str, known: &[&str], function: Function) {
        match self.roles.get(name) {
            Some(role) => {
                let role = role.map_or_else(|| "a table".into(), Role::with_article);
                let message = format!("`{}` wants {what} here, and `{name}` is {role}", function.form);
                let hint = nearest(name, known.iter().copied());
                let hint = hint.map_or_else(|| format!("name {what}"), |n| format!("did you mean `{n}`?"));
                self.tell(Code::WrongName, span, message, hint);
            }
            None => {
                let hint = nearest(name, known.iter().copied());
                let hint = hint.map_or_else(|| format!("name {what}"), |n| format!("did you mean `{n}`?"));
                self.tell(Code::UnknownName, span, format!("`{name}` is not declared"), hint);
            }
        }
    }

    fn unit_of(&self, target: Target) -> Option<Unit> {
        match target {
            Target::State(k) => self.model.states[k as usize].quantity.unit.clone(),
            Target::Output(k) => self.model.outputs[k as usize].quantity.unit.clone(),
        }
    }

    fn unit(&self, call: &Call) -> Option<Unit> {
        let time = &self.model.time;
        let rate = || Unit::radian().quotient(time);
        let signal = || call.signals.first().and_then(|s| self.unit_of(s.target));
        let input = || self.model.inputs[call.input as usize].quantity.unit.clone();
        match call.asks {
            Asks::Mode(OfMode::Frequency) => rate(),
            Asks::Mode(OfMode::Damping) => Some(Unit::one()),
            Asks::Mode(OfMode::Real) => Unit::one().quotient(time),
            Asks::Mode(OfMode::TimeToHalf | OfMode::TimeToDouble) => Some(time.clone()),
            Asks::Coefficient => {
                let n = self.model.states.len();
                let column = match (call.column as usize).checked_sub(n) {
                    Some(k) => self.model.inputs[k].quantity.unit.clone(),
                    None => self.model.states[call.column as usize].quantity.unit.clone(),
                };
                let row = call.row?;
                let own = self.unit_of(row)?.quotient(&column?)?;
                if matches!(row, Target::State(_)) { own.quotient(time) } else { Some(own) }
            }
            Asks::Response(of) => match of {
                OfResponse::Gain(_) | OfResponse::Steady => signal()?.quotient(&input()?),
                OfResponse::Phase(_) | OfResponse::PhaseMargin => Some(Unit::degree()),
                OfResponse::GainMargin => Some(Unit::one()),
                OfResponse::PhaseDelay => Some(time.clone()),
                _ => rate(),
            },
            Asks::Course(of) => match of {
                OfCourse::Overshoot => Some(Unit::one()),
                OfCourse::RiseTime | OfCourse::SettlingTime | OfCourse::When(_) => Some(time.clone()),
                OfCourse::Integral => signal()?.product(time),
                _ => signal(),
            },
            Asks::Reached | Asks::Zigzag => signal(),
        }
    }

    /// Checks the expressions as those of a model of params and measures, and puts the numbers into the measures.
    fn finish(mut self) -> Result<Requirements, Vec<Diagnostic>> {
        if !self.findings.is_empty() {
            return Err(self.findings);
        }
        let tree = self.own_tree();
        let checked = match check(&tree) {
            Ok((model, _)) => model,
            Err(mut findings) => {
                findings.retain(Diagnostic::is_error);
                return Err(findings);
            }
        };
        let first = self.outputs.len();
        let constant = |at: usize| checked.graph.constant(checked.outputs[first + at].expr);
        let mut findings = Vec::new();
        let mut value = |at: usize, span: Span| {
            let value = constant(at);
            if value.is_none() {
                let message = "this number must not depend on params";
                let finding = Diagnostic::new(Code::NotConstant, span, message);
                findings.push(finding.hint("a number or a const; the value of the requirement may depend on params"));
            }
            value.unwrap_or(f64::NAN)
        };
        let constants = self.constants;
        let span = |at: usize| constants[at].span;
        let mut list = Vec::new();
        let mut empty = Vec::new();
        for (mut requirement, [lower, upper], bounds) in self.list {
            if let Some(at) = lower {
                requirement.lower = value(at, span(at));
            }
            if let Some(at) = upper {
                requirement.upper = value(at, span(at));
            }
            if requirement.lower > requirement.upper {
                empty.push((bounds, requirement.quantity.name.clone()));
            }
            list.push(requirement);
        }
        let mut wrong = Vec::new();
        let mut measures = Vec::new();
        for Pending { text, unit, call } in self.pending {
            let mut read = |n: &Number| {
                let v = value(n.at, n.span);
                let bad = match n.argument {
                    Argument::Duration | Argument::Frequency => v <= 0.0 || v.is_infinite(),
                    Argument::Count => !(1.0..=100.0).contains(&v) || v.fract() != 0.0,
                    _ => v.is_infinite(),
                };
                if bad {
                    wrong.push((n.span, n.argument, v));
                }
                v
            };
            let numbers: Vec<f64> = call.numbers.iter().map(&mut read).collect();
            let drives: Vec<Drive> = call
                .drives
                .iter()
                .map(|(which, input, own)| {
                    let own: Vec<f64> = own.iter().map(&mut read).collect();
                    Drive { input: *input, form: form(*which, &own) }
                })
                .collect();
            measures.push(Measure { text, unit, what: what(&call, &numbers, drives) });
        }
        for (span, name) in empty {
            let message = format!("the limits of the requirement `{name}` are reversed");
            findings.push(Diagnostic::new(Code::BadBounds, span, message).hint("`in [lower, upper]`"));
        }
        for (span, argument, v) in wrong {
            let (message, hint) = match argument {
                Argument::Count => {
                    (format!("an overshoot has a number from 1 to 100, not {v}"), "1 is the first overshoot")
                }
                Argument::Duration => (
                    format!("this time is {v}, and must be above 0"),
                    "how long the response is followed, in the model's time",
                ),
                Argument::Frequency => (
                    format!("this frequency is {v}, and must be above 0"),
                    "`steady(y, u)` is the response to a constant input",
                ),
                _ => (format!("this number is {v}"), "give a finite number"),
            };
            findings.push(Diagnostic::new(Code::NeedlessValue, span, message).hint(hint));
        }
        match findings.is_empty() {
            true => Ok(Requirements { list, measures, model: checked }),
            false => Err(findings),
        }
    }

    /// Params, consts, and lets of these; measures as inputs, requirements and their numbers as outputs.
    fn own_tree(&mut self) -> SyntaxTree {
        let mut statements = Vec::new();
        for statement in &self.tree.statements {
            let kind = match &statement.kind {
                StatementKind::Declare(role @ (Role::Param | Role::Const | Role::Known), list) => {
                    StatementKind::Declare(*role, list.clone())
                }
                StatementKind::Declare(Role::Let, list) => {
                    let kept = list.iter().filter(|d| !self.varying.contains(d.name.text.as_str())).cloned();
                    StatementKind::Declare(Role::Let, kept.collect())
                }
                StatementKind::Time(_) | StatementKind::Table(_) | StatementKind::Tie(_) => statement.kind.clone(),
                _ => continue,
            };
            statements.push(Statement { kind, span: statement.span });
        }
        let span = self.tree.name.span;
        let input = |(k, p): (usize, &Pending)| {
            let unit = p.unit.as_ref().map(|u| Name { text: u.to_string(), span });
            Declaration { unit, ..Declaration::new(Name { text: measure_name(k), span }, span) }
        };
        let inputs = self.pending.iter().enumerate().map(input).collect();
        let outputs = self.outputs.iter().chain(&self.constants).cloned().collect();
        // in front of `known`, so that measures are the first inputs
        statements.insert(0, Statement { kind: StatementKind::Declare(Role::Input, inputs), span });
        statements.push(Statement { kind: StatementKind::Declare(Role::Output, outputs), span });
        SyntaxTree {
            name: self.tree.name.clone(),
            doc: None,
            statements,
            expressions: std::mem::take(&mut self.expressions),
            suspended: Vec::new(),
        }
    }
}

/// What a measure is called in the model of requirements: no user can write such a name.
fn measure_name(k: usize) -> String {
    format!("measure {k}")
}

fn measure_number(name: &str) -> Option<usize> {
    name.strip_prefix("measure ")?.parse().ok()
}

fn form(which: usize, numbers: &[f64]) -> Form {
    match (DRIVES[which].0, numbers) {
        ("step", [size]) => Form::Step(*size),
        ("pulse", [size, length]) => Form::Pulse(*size, *length),
        ("doublet", [size, length]) => Form::Doublet(*size, *length),
        (_, numbers) => Form::Hold(numbers.first().copied().unwrap_or_default()),
    }
}

fn what(call: &Call, numbers: &[f64], drives: Vec<Drive>) -> What {
    let number = |k: usize| numbers.get(k).copied().unwrap_or(f64::NAN);
    let none = Observed { target: Target::State(0), negative: false };
    let signal = call.signals.first().copied().unwrap_or(none);
    match call.asks {
        Asks::Mode(of) => What::Mode { state: call.state, of },
        Asks::Coefficient => What::Coefficient { row: call.row.unwrap_or(none.target), column: call.column },
        Asks::Response(of) => {
            let of = match of {
                OfResponse::Gain(_) => OfResponse::Gain(number(0)),
                OfResponse::Phase(_) => OfResponse::Phase(number(0)),
                of => of,
            };
            What::Response { signal, input: call.input, of }
        }
        Asks::Course(OfCourse::When(_)) => {
            What::Course { signal, duration: number(1), drives, of: OfCourse::When(number(0)) }
        }
        Asks::Course(of) => What::Course { signal, duration: number(0), drives, of },
        Asks::Reached => {
            let other = call.signals.get(1).copied().unwrap_or(none);
            What::Course { signal, duration: number(1), drives, of: OfCourse::Reached(other, number(0)) }
        }
        Asks::Zigzag => What::Zigzag {
            signal,
            input: call.input,
            size: number(0),
            level: number(1),
            number: number(2) as u32,
            duration: number(3),
        },
    }
}

/// Names of what varies with time: inputs, states, outputs, and the lets that mention them.
fn varying<'t>(tree: &'t SyntaxTree, roles: &HashMap<&'t str, Option<Role>>) -> HashSet<&'t str> {
    let signal = |role: &Option<Role>| matches!(role, Some(Role::Input | Role::State | Role::Output));
    let mut open: Vec<&str> = roles.iter().filter(|(_, role)| signal(role)).map(|(name, _)| *name).collect();
    open.push("t");
    let mut users: HashMap<&str, Vec<&str>> = HashMap::new();
    for statement in &tree.statements {
        let StatementKind::Declare(Role::Let, list) = &statement.kind else { continue };
        for d in list {
            let Some(Value::Expr(root)) = d.value else { continue };
            each(tree, root, |_, expr| {
                if let Expr::Name(name) = expr {
                    users.entry(name.as_str()).or_default().push(&d.name.text);
                }
                true
            });
        }
    }
    let mut varying: HashSet<&str> = open.iter().copied().collect();
    while let Some(name) = open.pop() {
        for user in users.get(name).into_iter().flatten() {
            if varying.insert(user) {
                open.push(user);
            }
        }
    }
    varying
}
