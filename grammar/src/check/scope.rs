//! What is declared, and what a node of the text can refer to.

use super::functions::Function;
use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use crate::syntax::{Declaration, Name, Role, StatementKind, SyntaxTree, Table, word_use};
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
    pub(super) misused: HashSet<&'a str>,
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

/// Longer names are not compared with others, and only so many comparisons are made: guessing must stay cheap.
pub(super) const LONGEST_GUESS: usize = 48;
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
