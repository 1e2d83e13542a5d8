//! A model that is part of another, and its statements as the whole says them.
//!
//! What the whole gives to the inputs and params of a part.

use crate::diagnostic::{Code, Diagnostic, nearest};
use crate::syntax::{
    Bounds, Declaration, Expr, ExprRef, Limited, Name, Nodes, Role, Smooth, Statement, StatementKind, SyntaxTree,
    Table, Use, Value, When, operands,
};
use std::collections::HashMap;

/// A model that passed its checks, without submodels of its own.
pub(super) struct Part {
    pub(super) tree: SyntaxTree,
    /// What each name was declared as; `None` for tables.
    roles: HashMap<String, Option<Role>>,
    names: usize,
    bytes: usize,
}

impl Part {
    pub(super) fn new(tree: SyntaxTree) -> Self {
        let mut roles = HashMap::new();
        let (mut names, mut bytes) = (0, 0);
        for statement in &tree.statements {
            match &statement.kind {
                StatementKind::Declare(role, list) => {
                    roles.extend(list.iter().map(|d| (d.name.text.clone(), Some(*role))));
                    names += list.len();
                    bytes += list.iter().map(written).sum::<usize>();
                }
                StatementKind::Table(table) => {
                    roles.insert(table.name.text.clone(), None);
                    names += 1;
                    bytes += table.name.text.len() + length(&table.doc);
                }
                StatementKind::Noise(list)
                | StatementKind::Process(list)
                | StatementKind::Trim(list)
                | StatementKind::Tie(list) => {
                    names += list.len();
                    bytes += list.iter().map(|(name, _)| name.text.len()).sum::<usize>();
                }
                StatementKind::When(event) => {
                    names += event.resets.len();
                    bytes += event.resets.iter().map(|(name, _)| name.text.len()).sum::<usize>();
                }
                StatementKind::Limit(list) => {
                    names += list.len();
                    bytes += list.iter().map(|l| l.state.text.len()).sum::<usize>();
                }
                _ => {}
            }
        }
        for (expr, _) in &tree.expressions {
            if let Expr::Name(text) | Expr::Call(Name { text, .. }, _) | Expr::Element(Name { text, .. }, _) = expr {
                names += 1;
                bytes += text.len();
            }
        }
        Self { tree, roles, names, bytes }
    }

    /// What it takes to write the part under a name: expressions and declarations, and the bytes of names.
    pub(super) fn size(&self, alias: &str) -> (usize, usize) {
        let statements = self.tree.statements.len();
        (self.tree.expressions.len() + self.names + statements, self.bytes + self.names * (alias.len() + 1))
    }

    /// What a name was declared as.
    pub(super) fn role(&self, name: &str) -> Option<Option<Role>> {
        self.roles.get(name).copied()
    }

    /// Whether time enters.
    pub(super) fn moves(&self) -> bool {
        let equations = self.tree.statements.iter().any(|s| matches!(s.kind, StatementKind::Equation(..)));
        equations
            || self.tree.expressions.iter().any(|(e, _)| match e {
                Expr::Name(name) => name == "t",
                Expr::Call(name, _) => name.text != "min" && name.text != "max",
                _ => false,
            })
    }

    fn declarations(&self) -> impl Iterator<Item = (Role, &Declaration)> {
        self.tree
            .statements
            .iter()
            .filter_map(|s| match &s.kind {
                StatementKind::Declare(role, list) => Some(list.iter().map(|d| (*role, d))),
                _ => None,
            })
            .flatten()
    }

    /// The inputs in the order of the text.
    pub(super) fn inputs(&self) -> impl Iterator<Item = &Declaration> {
        self.declarations().filter(|(role, _)| *role == Role::Input).map(|(_, d)| d)
    }

    /// What can be connected.
    pub(super) fn connectable(&self) -> impl Iterator<Item = &str> {
        let own = self.declarations().filter(|(role, _)| matches!(role, Role::Input | Role::Param));
        own.map(|(_, d)| d.name.text.as_str())
    }

    /// The consts.
    pub(super) fn consts(&self) -> impl Iterator<Item = (&str, Role)> {
        self.declarations().filter(|(role, _)| *role == Role::Const).map(|(role, d)| (d.name.text.as_str(), role))
    }

    /// Writes the part into the whole, where it is called `alias`.
    pub(super) fn write(
        &self,
        alias: &str,
        connections: &Connections,
        is_const: &dyn Fn(&str) -> bool,
        whole: &mut SyntaxTree,
    ) {
        let by = whole.expressions.len() as u32;
        let writer = Writer { part: self, alias, by, connections };
        for (expr, span) in &self.tree.expressions {
            whole.expressions.push((writer.expr(expr), *span));
        }
        for statement in &self.tree.statements {
            if let Some(kind) = writer.statement(&statement.kind, is_const, whole) {
                whole.statements.push(Statement { kind, span: statement.span });
            }
        }
    }
}

/// Names, doc and unit of a declaration, in bytes.
fn written(d: &Declaration) -> usize {
    d.name.text.len() + length(&d.doc) + length(&d.unit)
}

fn length(name: &Option<Name>) -> usize {
    name.as_ref().map_or(0, |n| n.text.len())
}

struct Writer<'a> {
    part: &'a Part,
    alias: &'a str,
    /// Where the expressions of the part begin in the whole.
    by: u32,
    connections: &'a Connections,
}

impl Writer<'_> {
    fn moved(&self, e: ExprRef) -> ExprRef {
        ExprRef(e.0 + self.by)
    }

    /// A name of the part, with or without an index, as the whole calls it.
    fn named(&self, text: &str) -> String {
        let own = text.split('[').next().unwrap_or(text);
        if self.part.roles.contains_key(own) { format!("{}.{text}", self.alias) } else { text.into() }
    }

    fn name(&self, name: &Name) -> Name {
        Name { text: self.named(&name.text), span: name.span }
    }

    fn expr(&self, expr: &Expr) -> Expr {
        let list = |list: &[ExprRef]| list.iter().map(|e| self.moved(*e)).collect();
        match expr {
            Expr::Number(value) => Expr::Number(*value),
            Expr::Name(name) => Expr::Name(self.named(name)),
            Expr::Unary(sign, a) => Expr::Unary(*sign, self.moved(*a)),
            Expr::Binary(sign, a, b, span) => Expr::Binary(*sign, self.moved(*a), self.moved(*b), *span),
            Expr::Call(name, arguments) => Expr::Call(self.name(name), list(arguments)),
            Expr::If(c, a, b) => Expr::If(self.moved(*c), self.moved(*a), self.moved(*b)),
            Expr::Vector(elements) => Expr::Vector(list(elements)),
            Expr::Element(name, slices) => Expr::Element(self.name(name), slices.clone()),
        }
    }

    /// A statement of the part as one of the whole; `None` for what the whole says itself.
    fn statement(
        &self,
        kind: &StatementKind,
        is_const: &dyn Fn(&str) -> bool,
        whole: &mut SyntaxTree,
    ) -> Option<StatementKind> {
        let pairs = |list: &[(Name, ExprRef)], keep: &dyn Fn(&str) -> bool| -> Vec<(Name, ExprRef)> {
            let kept = list.iter().filter(|(name, _)| keep(name.text.split('[').next().unwrap_or("")));
            kept.map(|(name, e)| (self.name(name), self.moved(*e))).collect()
        };
        Some(match kind {
            StatementKind::Declare(role, list) => {
                let list = list.iter().map(|d| self.declaration(*role, d, is_const, whole)).collect();
                // what drives the part is computed by the whole, which says what is measured
                let role = if matches!(role, Role::Input | Role::Output) { Role::Let } else { *role };
                StatementKind::Declare(role, list)
            }
            StatementKind::Equation(left, right) => StatementKind::Equation(self.moved(*left), self.moved(*right)),
            StatementKind::Prior(list) => {
                let free = list.iter().filter(|(subject, _)| !self.is_connected(*subject));
                StatementKind::Prior(free.map(|(a, b)| (self.moved(*a), self.moved(*b))).collect())
            }
            StatementKind::Trim(list) => {
                StatementKind::Trim(pairs(list, &|name| self.part.role(name) != Some(Some(Role::Input))))
            }
            StatementKind::Process(list) => StatementKind::Process(pairs(list, &|_| true)),
            StatementKind::Tie(list) => StatementKind::Tie(pairs(list, &|name| self.connections.get(name).is_none())),
            StatementKind::Table(table) => StatementKind::Table(self.table(table)),
            StatementKind::Smooth(smooth) => {
                StatementKind::Smooth(Smooth { table: self.name(&smooth.table), ..smooth.clone() })
            }
            StatementKind::Limit(list) => {
                let limited = |l: &Limited| Limited {
                    state: self.name(&l.state),
                    bounds: Bounds { lower: self.moved(l.bounds.lower), upper: self.moved(l.bounds.upper), ..l.bounds },
                    smooth: l.smooth.map(|w| self.moved(w)),
                };
                StatementKind::Limit(list.iter().map(limited).collect())
            }
            StatementKind::When(event) => StatementKind::When(When {
                condition: self.moved(event.condition),
                resets: pairs(&event.resets, &|_| true),
            }),
            StatementKind::Requirement(_)
            | StatementKind::Time(_)
            | StatementKind::Noise(_)
            | StatementKind::Use(_)
            | StatementKind::Reactions(..) => {
                return None;
            }
        })
    }

    /// Whether a prior is about a param that the whole gives.
    fn is_connected(&self, subject: ExprRef) -> bool {
        match self.part.tree.expr(subject) {
            Expr::Name(name) | Expr::Element(Name { text: name, .. }, _) => self.connections.get(name).is_some(),
            _ => false,
        }
    }

    fn table(&self, table: &Table) -> Table {
        let mut nodes = table.nodes.moved(|e| self.moved(e));
        if let Nodes::Written(axes) = &mut nodes {
            axes.iter_mut().filter(|a| a.name.text == table.name.text).for_each(|a| a.name = self.name(&a.name));
        }
        let moved = |b: Bounds| Bounds { lower: self.moved(b.lower), upper: self.moved(b.upper), ..b };
        Table { name: self.name(&table.name), nodes, bounds: table.bounds.map(moved), ..table.clone() }
    }

    fn declaration(
        &self,
        role: Role,
        d: &Declaration,
        is_const: &dyn Fn(&str) -> bool,
        whole: &mut SyntaxTree,
    ) -> Declaration {
        let mut new = Declaration { name: self.name(&d.name), ..d.clone() };
        if let Some(Value::Expr(e)) = &mut new.value {
            *e = self.moved(*e);
        }
        if let Some(bounds) = &mut new.bounds {
            (bounds.lower, bounds.upper) = (self.moved(bounds.lower), self.moved(bounds.upper));
        }
        match (role, self.connections.get(&d.name.text)) {
            (Role::Input, None) => {
                // told already
                whole.expressions.push((super::super::broken(), d.name.span));
                new.value = Some(Value::Expr(ExprRef(whole.expressions.len() as u32 - 1)));
            }
            (Role::Input, Some(given)) => new.value = Some(Value::Expr(given)),
            (Role::Param, Some(given)) => give(&mut new, given, is_const, whole),
            _ => {}
        }
        new
    }
}

/// A param that the whole gives: a number is known, an expression of params defines it.
fn give(d: &mut Declaration, given: ExprRef, is_const: &dyn Fn(&str) -> bool, whole: &SyntaxTree) {
    d.value = Some(Value::Expr(given));
    d.per_run = None;
    let literal = matches!(whole.expr(given), Expr::Vector(_));
    let any_number = || elements(whole, given).into_iter().any(|e| is_constant(whole, e, is_const));
    if is_constant(whole, given, is_const) || literal && any_number() {
        d.fixed = Some(whole.span(given));
    } else {
        (d.bounds, d.fixed, d.log) = (None, None, None);
    }
}

/// The entries of a literal, rows after each other.
fn elements(tree: &SyntaxTree, root: ExprRef) -> Vec<ExprRef> {
    let mut open = vec![root];
    let mut found = Vec::new();
    while let Some(e) = open.pop() {
        match tree.expr(e) {
            Expr::Vector(list) => open.extend(list),
            _ => found.push(e),
        }
    }
    found
}

/// Whether an expression is made of numbers and consts only.
fn is_constant(tree: &SyntaxTree, root: ExprRef, is_const: &dyn Fn(&str) -> bool) -> bool {
    let mut open = vec![root];
    while let Some(e) = open.pop() {
        match tree.expr(e) {
            Expr::Name(name) | Expr::Element(Name { text: name, .. }, _) => {
                if !(is_const(name) || name == "pi" || name == "inf") {
                    return false;
                }
            }
            Expr::Call(name, _) if name.text == "measured" => return false,
            other => operands(other, |operand| open.push(operand)),
        }
    }
    true
}

/// Names that a hint lists.
const MOST_NAMES: usize = 8;

/// By name in the part: the expression of the whole.
pub(super) struct Connections {
    given: HashMap<String, ExprRef>,
}

impl Connections {
    /// Reads the brackets of a `use` and tells what is wrong with them.
    pub(super) fn read(submodel: &Use, part: &Part, findings: &mut Vec<Diagnostic>) -> Self {
        let mut given = HashMap::new();
        let mut places = HashMap::new();
        let mut misspelt = Vec::new();
        let alias = &submodel.alias.text;
        for (name, value) in &submodel.connections {
            let text = &name.text;
            if let Some(first) = places.insert(text.clone(), name.span) {
                let message = format!("`{text}` of `{alias}` is connected a second time");
                let finding = Diagnostic::new(Code::DeclaredTwice, name.span, message);
                findings.push(finding.label(first, "first connected here").hint("remove one of them"));
                continue;
            }
            match part.role(text) {
                Some(Some(Role::Input | Role::Param)) => drop(given.insert(text.clone(), *value)),
                Some(role) => {
                    let what = role.map_or("table", Role::keyword);
                    let article = if what == "output" { "an" } else { "a" };
                    let message = format!("`{text}` is {article} {what} of `{alias}`; inputs and params are connected");
                    let finding = Diagnostic::new(Code::WrongName, name.span, message);
                    findings.push(finding.hint(format!("its value is `{alias}.{text}`")));
                }
                None => {
                    let message = format!("`{alias}` has no input or param `{text}`");
                    let finding = Diagnostic::new(Code::UnknownName, name.span, message);
                    findings.push(finding.hint(meant(text, part)));
                    misspelt.extend(nearest(text, part.connectable()));
                }
            }
        }
        let connections = Self { given };
        for input in part.inputs().filter(|d| !places.contains_key(&d.name.text)) {
            let text = &input.name.text;
            if misspelt.contains(&text.as_str()) {
                continue;
            }
            let message = format!("nothing is connected to the input `{text}` of `{alias}`");
            let finding = Diagnostic::new(Code::NotConnected, submodel.alias.span, message);
            let finding = finding.label(input.name.span, "declared here");
            findings.push(finding.hint(format!("`as {alias}({text} = ...)`, with an expression of this model")));
        }
        connections
    }

    /// What is given to a name.
    pub(super) fn get(&self, name: &str) -> Option<ExprRef> {
        self.given.get(name).copied()
    }
}

fn meant(name: &str, part: &Part) -> String {
    let names: Vec<&str> = part.connectable().collect();
    if let Some(near) = nearest(name, names.iter().copied()) {
        return format!("did you mean `{near}`?");
    }
    let listed: Vec<String> = names.iter().take(MOST_NAMES).map(|n| format!("`{n}`")).collect();
    match (listed.is_empty(), names.len() > MOST_NAMES) {
        (true, _) => "it has neither inputs nor params".into(),
        (false, more) => format!("it has {}{}", listed.join(", "), if more { ", ..." } else { "" }),
    }
}
