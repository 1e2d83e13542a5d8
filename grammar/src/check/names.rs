//! What each name and each call in the text stands for.

use super::beginnings;
use super::functions::{self, Function, argument_count};
use super::order::Blocks;
use super::scope::{LONGEST_GUESS, Meaning, Scope, Symbol};
use super::tables;
use crate::diagnostic::{Code, Diagnostic, Label};
use crate::external;
use crate::source::Span;
use crate::syntax::{Expr, ExprRef, Name, Role};
use std::collections::HashMap;

/// What every node of every block refers to; unknown names and functions, wrong argument counts are told.
pub(super) fn resolve(scope: &Scope<'_>, blocks: &Blocks, findings: &mut Vec<Diagnostic>) -> Vec<Meaning> {
    let mut resolver = Resolver { scope, unknown: HashMap::new(), findings };
    let mut meanings = vec![Meaning::None; scope.tree.expressions.len()];
    for e in &blocks.nodes {
        let span = scope.tree.span(*e);
        meanings[e.0 as usize] = match scope.tree.expr(*e) {
            Expr::Name(name) => resolver.name(name, span),
            Expr::Call(name, arguments) => {
                let meaning = resolver.call(name, arguments, span);
                if let (Meaning::Record(_), [argument]) = (meaning, &arguments[..]) {
                    // the output itself is not needed: it may contain the record
                    meanings[argument.0 as usize] = Meaning::Quoted;
                }
                meaning
            }
            // made scalars before; what could not be has been told
            Expr::Vector(_) | Expr::Element(..) => Meaning::Broken,
            _ => Meaning::None,
        };
    }
    meanings
}

struct Resolver<'a, 'b> {
    scope: &'b Scope<'a>,
    /// Findings about unknown names, so that each name is told once.
    unknown: HashMap<&'a str, usize>,
    findings: &'b mut Vec<Diagnostic>,
}

impl<'a> Resolver<'a, '_> {
    fn name(&mut self, name: &'a str, span: Span) -> Meaning {
        match name {
            _ if self.scope.find(name).is_some() => match self.scope.find(name) {
                Some(s) if self.scope.symbols[s].role == Role::Table => {
                    self.findings.push(tables::without_argument(&self.scope.symbols[s], span));
                    Meaning::Broken
                }
                found => found.map_or(Meaning::Broken, Meaning::Symbol),
            },
            _ if self.scope.misused.contains(name) => Meaning::Broken,
            "t" => Meaning::Time,
            "pi" => Meaning::Pi,
            "inf" => Meaning::Infinity,
            _ if self.scope.is_suspended(name) => Meaning::Broken,
            _ => {
                self.unknown_name(name, span);
                Meaning::Broken
            }
        }
    }

    fn unknown_name(&mut self, name: &'a str, span: Span) {
        if let Some(told) = self.unknown.get(name) {
            return another_place(&mut self.findings[*told], span);
        }
        let hint = match (Function::find(name), name) {
            (Some(function), _) => Some(format!("`{name}` is a function: `{}`", function.form(name))),
            (None, "e" | "E") => Some("Euler's number is `exp(1)`, its powers are `exp(x)`".into()),
            (None, _) => match self.scope.derivative(name) {
                Some(s) => Some(format!("write `der({})`", self.scope.symbols[s].name())),
                None => self.scope.nearest(name, self.unknown.len(), |_| true),
            },
        };
        let finding = Diagnostic::new(Code::UnknownName, span, format!("`{name}` is not declared"));
        self.unknown.insert(name, self.findings.len());
        self.findings.push(match hint {
            Some(hint) => finding.hint(hint),
            None => finding,
        });
    }

    fn call(&mut self, name: &Name, arguments: &[ExprRef], span: Span) -> Meaning {
        if let Some(s) = self.scope.find(&name.text).filter(|s| self.scope.symbols[*s].role == Role::Table) {
            if arguments.len() == self.scope.symbols[s].table.map_or(1, |t| t.arguments.len()) {
                return Meaning::Table(s);
            }
            self.findings.push(tables::argument_count(&self.scope.symbols[s], arguments.len(), span));
            return Meaning::Broken;
        }
        let Some(function) = Function::find(&name.text) else {
            if self.scope.is_suspended(&name.text) {
                return Meaning::Broken;
            }
            self.findings.push(unknown_function(self.scope, name));
            return Meaning::Broken;
        };
        let (least, more) = function.arity();
        let given = arguments.len();
        if given < least || given > least && !more {
            self.findings.push(argument_count(function, name, given, span));
            return Meaning::Broken;
        }
        if function == Function::Der
            && let Some(finding) = steady(self.scope, arguments[0], span)
        {
            self.findings.push(finding);
            return Meaning::Broken;
        }
        if function == Function::Measured {
            return match beginnings::output(self.scope, arguments[0], span) {
                Ok(output) => Meaning::Record(output),
                Err(finding) => {
                    self.findings.extend(finding);
                    Meaning::Broken
                }
            };
        }
        Meaning::Function(function)
    }
}

/// Notes where else a name occurs; the finding stands at the first place in the text.
fn another_place(finding: &mut Diagnostic, span: Span) {
    let first = finding.span.min(span);
    let later = finding.span.max(span);
    finding.span = first;
    // further places of an unknown name that are shown
    if finding.labels.len() < 8 {
        finding.labels.push(Label { span: later, text: "and here".into() });
    }
}

fn unknown_function(scope: &Scope<'_>, name: &Name) -> Diagnostic {
    let text = &name.text;
    let message = format!("`{text}` is not a function");
    let finding = Diagnostic::new(Code::UnknownFunction, name.span, message);
    if functions::BLOCKS.contains(&text.as_str()) {
        // made states everywhere but here
        return finding.hint("a block stands in an expression of a model");
    }
    if text.starts_with(external::PREFIX) {
        return finding
            .hint("the unit that computes it is not where it was when the text was made, or is another one now");
    }
    if scope.find(text).is_some() {
        return finding.hint(format!("a product is written with a sign: `{text}*(...)`"));
    }
    if let Some(own) = functions::translation(text) {
        return finding.hint(format!("write `{own}`"));
    }
    let short = text.chars().count() <= LONGEST_GUESS;
    let mut names: Vec<&str> = Function::names().chain(functions::BLOCKS.iter().copied()).collect();
    names.extend(scope.symbols.iter().filter(|s| s.role == Role::Table).map(Symbol::name));
    match short.then(|| crate::diagnostic::nearest(text, names)).flatten() {
        Some(near) => finding.hint(format!("did you mean `{near}`?")),
        None => finding,
    }
}

/// A derivative is taken of what changes.
fn steady(scope: &Scope<'_>, argument: ExprRef, span: Span) -> Option<Diagnostic> {
    let Expr::Name(name) = scope.tree.expr(argument) else { return None };
    let symbol = &scope.symbols[scope.find(name)?];
    if !matches!(symbol.role, Role::Param | Role::Const) {
        return None;
    }
    let message =
        format!("`{name}` is a {}: it does not change, so that its derivative is zero", symbol.role.keyword());
    Some(Diagnostic::new(Code::WrongName, span, message).label(symbol.declaration.name.span, "declared here"))
}
