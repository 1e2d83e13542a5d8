//! What each name and each call in the text stands for.

use super::functions::{self, Function};
use super::order::Blocks;
use super::records;
use super::tables;
use crate::diagnostic::{Code, Diagnostic, Label};
use crate::external;
use crate::source::Span;
use crate::syntax::{Declaration, Expr, ExprRef, Name, Role, StatementKind, SyntaxTree, Table, word_use};
use crate::unit::Unit;
use std::collections::{HashMap, HashSet};

/// Index of a declared name in [`Scope::symbols`].
pub(super) type SymbolId = usize;

/// A declared name.
pub(super) struct Symbol<'a> {
    /// What it was declared as.
    pub(super) role: Role,
    /// What was written about it.
    pub(super) declaration: &'a Declaration,
    /// Whether the name means this declaration: neither reserved nor taken by an earlier one.
    pub(super) valid: bool,
    /// Whether another declaration wants the same name.
    pub(super) contested: bool,
    /// The declared unit, when it could be read.
    pub(super) unit: Option<Unit>,
    /// Its arguments and its nodes, when it is a table.
    pub(super) table: Option<&'a Table>,
}

impl Symbol<'_> {
    /// The name.
    pub(super) fn name(&self) -> &str {
        &self.declaration.name.text
    }
}

/// Everything that is declared.
pub(super) struct Scope<'a> {
    /// The model as written.
    pub(super) tree: &'a SyntaxTree,
    /// Declared names in the order of the text.
    pub(super) symbols: Vec<Symbol<'a>>,
    /// Unit of `t` and of the time in `der`.
    pub(super) time: Unit,
    /// Whether any unit is written in the model.
    pub(super) has_units: bool,
    names: HashMap<&'a str, SymbolId>,
    suspended: HashSet<&'a str>,
    /// `t`, `pi`, functions and so on that were declared in spite of it: what they mean then, nobody knows.
    misused: HashSet<&'a str>,
}

/// What a node of the text refers to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Meaning {
    /// Neither a name nor a call.
    None,
    /// A declared name.
    Symbol(SymbolId),
    /// `CL(x)`: a table's value
    Table(SymbolId),
    /// `measured(y)`: the record of this output.
    Record(SymbolId),
    /// A name that is only referred to: what it stands for does not enter.
    Quoted,
    /// `t`
    Time,
    /// `pi`
    Pi,
    /// `inf`, for bounds.
    Infinity,
    /// A function, called with a fitting number of arguments.
    Function(Function),
    /// A mistake that has been told.
    Broken,
}

impl<'a> Scope<'a> {
    /// Collects the declarations and the unit of time.
    ///
    /// `tables` are the declarations behind the table statements, in their order.
    pub(super) fn new(tree: &'a SyntaxTree, tables: &'a [Declaration], findings: &mut Vec<Diagnostic>) -> Self {
        let mut scope = Scope {
            tree,
            symbols: Vec::new(),
            time: Unit::second(),
            has_units: false,
            names: HashMap::new(),
            suspended: tree.suspended.iter().map(String::as_str).collect(),
            misused: HashSet::new(),
        };
        let mut time: Option<Span> = None;
        let mut tables = tables.iter();
        for statement in &tree.statements {
            match &statement.kind {
                StatementKind::Declare(role, list) => list.iter().for_each(|d| scope.declare(*role, d, None, findings)),
                StatementKind::Table(table) => {
                    tables.next().into_iter().for_each(|d| scope.declare(Role::Table, d, Some(table), findings));
                }
                StatementKind::Time(unit) => match time {
                    Some(first) => {
                        let message = "the unit of time is given a second time";
                        let finding = Diagnostic::new(Code::DeclaredTwice, statement.span, message);
                        findings.push(finding.label(first, "first given here"));
                    }
                    None => {
                        time = Some(statement.span);
                        scope.set_time(unit, findings);
                    }
                },
                StatementKind::Equation(..)
                | StatementKind::Smooth(_)
                | StatementKind::Requirement(_)
                | StatementKind::Limit(_)
                | StatementKind::When(_)
                | StatementKind::Tie(_)
                | StatementKind::Use(_)
                | StatementKind::Prior(_)
                | StatementKind::Noise(_)
                | StatementKind::Process(_)
                | StatementKind::Reactions(..)
                | StatementKind::Trim(_) => {}
            }
        }
        scope
    }

    /// The declaration that a name means.
    pub(super) fn find(&self, name: &str) -> Option<SymbolId> {
        self.names.get(name).copied()
    }

    /// Whether mistakes with this name are consequences of one that has been told.
    pub(super) fn is_suspended(&self, name: &str) -> bool {
        // names of a submodel, elements of a vector
        let whole = name.split(['.', '[']).next().unwrap_or(name);
        self.suspended.contains(name) || self.suspended.contains(whole)
    }

    /// Whether statements are missing because they could not be read.
    pub(super) fn is_partial(&self) -> bool {
        !self.tree.suspended.is_empty()
    }

    /// Tells nothing about this name any more.
    pub(super) fn suspend(&mut self, name: &'a str) {
        self.suspended.insert(name);
    }

    /// Names that mean their declaration, with their numbers.
    pub(super) fn valid(&self) -> impl Iterator<Item = (SymbolId, &Symbol<'a>)> {
        self.symbols.iter().enumerate().filter(|(_, s)| s.valid)
    }

    fn set_time(&mut self, text: &Name, findings: &mut Vec<Diagnostic>) {
        self.has_units = true;
        match read_unit(text, findings) {
            Some(unit) if unit.same_dimension(&Unit::second()) => self.time = unit,
            Some(unit) => {
                let message = format!("`{unit}` is not a unit of time");
                findings
                    .push(Diagnostic::new(Code::UnitMismatch, text.span, message).hint("`time [s];` or `time [min];`"));
            }
            None => {}
        }
    }

    fn declare(
        &mut self,
        role: Role,
        declaration: &'a Declaration,
        table: Option<&'a Table>,
        findings: &mut Vec<Diagnostic>,
    ) {
        let name = &declaration.name;
        let unit = declaration.unit.as_ref().and_then(|u| read_unit(u, findings));
        self.has_units |=
            declaration.unit.is_some() || table.is_some_and(|t| t.arguments.iter().any(|a| a.unit.is_some()));
        let mut valid = false;
        if let Some(use_) = reserved(&name.text) {
            let message = format!("`{}` {use_} and cannot be declared", name.text);
            findings.push(Diagnostic::new(Code::ReservedName, name.span, message).hint("choose another name"));
            self.suspended.insert(&name.text);
            self.misused.insert(&name.text);
        } else if let Some(first) = self.find(&name.text) {
            findings.push(declared_twice(role, name, &self.symbols[first]));
            self.symbols[first].contested = true;
        } else {
            valid = true;
            self.names.insert(&name.text, self.symbols.len());
        }
        self.symbols.push(Symbol { role, declaration, valid, contested: false, unit, table });
    }
}

fn declared_twice(role: Role, name: &Name, first: &Symbol<'_>) -> Diagnostic {
    let message = format!("`{}` is declared a second time", name.text);
    let finding = Diagnostic::new(Code::DeclaredTwice, name.span, message)
        .label(first.declaration.name.span, format!("first declared here, as {}", first.role.keyword()));
    match (first.role, role) {
        (Role::Output, Role::Output) => finding.hint("give each output a name of its own"),
        (_, Role::Output) => finding.hint(format!("an output has a name of its own: `output {0}_m = {0};`", name.text)),
        _ => finding.hint("remove one of them or choose another name"),
    }
}

/// Why a name cannot be declared, when it belongs to the language.
pub fn reserved(name: &str) -> Option<&'static str> {
    match (name, word_use(name)) {
        ("t", _) => Some("is the time since the run began"),
        ("pi", _) => Some("is the number 3.14159..."),
        ("inf", _) => Some("is infinity"),
        (_, Some(_)) => Some("is a word of the language"),
        _ if Function::find(name).is_some() => Some("is a function"),
        _ => None,
    }
}

/// Reads a unit; a mistake is shown at its place inside the brackets.
pub(super) fn read_unit(text: &Name, findings: &mut Vec<Diagnostic>) -> Option<Unit> {
    let error = match Unit::parse(&text.text) {
        Ok(unit) => return Some(unit),
        Err(error) => error,
    };
    let range = text.span.range();
    // the span may hold the brackets
    let margin = range.len().saturating_sub(text.text.len()) / 2;
    let start = range.start + margin + error.range.start;
    let span = if error.range.is_empty() { text.span } else { Span::new(start, start + error.range.len()) };
    let finding = Diagnostic::new(Code::UnknownUnit, span, error.message);
    findings.push(match error.nearest {
        Some(near) => finding.hint(format!("did you mean `{near}`?")),
        None => finding,
    });
    None
}

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

/// Further places of an unknown name that are shown.
const MOST_PLACES: usize = 8;

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
            return match records::output(self.scope, arguments[0], span) {
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
    if finding.labels.len() < MOST_PLACES {
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

/// The complaint about a wrong number of arguments.
pub(super) fn argument_count(function: Function, name: &Name, given: usize, span: Span) -> Diagnostic {
    let (least, more) = function.arity();
    let wanted = match (least, more) {
        (1, false) => "1 argument".to_string(),
        (n, false) => format!("{n} arguments"),
        (n, true) => format!("{n} or more arguments"),
    };
    let message = format!("`{}` takes {wanted}, {given} given", name.text);
    Diagnostic::new(Code::ArgumentCount, span, message).hint(format!("`{}`", function.form(&name.text)))
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

/// Longer names are not compared with others, and only so many comparisons are made: guessing must stay cheap.
const LONGEST_GUESS: usize = 48;
const MOST_COMPARISONS: usize = 500_000;

impl Scope<'_> {
    /// The state whose derivative people call by this name: `xdot`, `x_dot`, `dx`, `d_x`, `dx_dt`.
    pub(super) fn derivative(&self, name: &str) -> Option<SymbolId> {
        let state = |name: &str| self.find(name).filter(|s| self.symbols[*s].role == Role::State);
        let dotted = ["_dot", "dot", "Dot", "_d", "_p"].iter().filter_map(|end| name.strip_suffix(end));
        let quotient = name.strip_prefix('d').and_then(|rest| rest.strip_suffix("dt"));
        let quotients = quotient.iter().flat_map(|rest| [rest.trim_end_matches('_'), *rest]).collect::<Vec<_>>();
        let prefixed = ["d_", "d", "D"].iter().filter_map(|start| name.strip_prefix(start));
        dotted.chain(quotients).chain(prefixed).find_map(state)
    }

    /// "did you mean ...?" with the nearest declared name that `wanted` accepts, when one is near and not too many
    /// names have been `guessed` before.
    pub(super) fn nearest(&self, name: &str, guessed: usize, wanted: impl Fn(&Symbol<'_>) -> bool) -> Option<String> {
        self.nearest_name(name, guessed, wanted).map(|near| format!("did you mean `{near}`?"))
    }

    /// The nearest declared name, on the same conditions.
    pub(super) fn nearest_name(
        &self,
        name: &str,
        guessed: usize,
        wanted: impl Fn(&Symbol<'_>) -> bool,
    ) -> Option<&str> {
        let length = name.chars().count();
        if length > LONGEST_GUESS || guessed * self.symbols.len() > MOST_COMPARISONS {
            return None;
        }
        let likely = |s: &&Symbol<'_>| {
            let own = s.name().chars().count();
            s.valid && own.abs_diff(length) <= own.max(length).div_ceil(3) && own <= LONGEST_GUESS && wanted(s)
        };
        let declared = self.symbols.iter().filter(likely).map(Symbol::name);
        crate::diagnostic::nearest(name, declared.chain(["t", "pi"]))
    }
}
