//! Writes statements into a tree: fresh names, expressions, states with their equations, each at the place of the text it stands for.

use crate::source::Span;
use crate::syntax::{
    BinarySign, Declaration, Expr, ExprRef, Made, Name, Role, Statement, StatementKind, SyntaxTree, UnarySign, Value,
};
use std::collections::HashSet;
use std::fmt;

/// An argument that may be written several times: a number or a name.
#[derive(Debug, Clone)]
pub(super) struct Atom {
    pub(super) kind: AtomKind,
    /// Whether the name was made here, so that no reader knows it.
    made: bool,
    span: Span,
}

/// What an argument is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum AtomKind {
    Number(f64),
    Name(String),
}

impl Atom {
    /// Whether it is this number, as written.
    pub(super) fn is(&self, value: f64) -> bool {
        self.kind == AtomKind::Number(value)
    }
}

impl fmt::Display for Atom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.kind {
            AtomKind::Number(value) => write!(f, "{value}"),
            AtomKind::Name(name) => f.write_str(name),
        }
    }
}

/// Adds to a tree.
pub(super) struct Maker<'a> {
    pub(super) tree: &'a mut SyntaxTree,
    taken: HashSet<String>,
    /// The place of what is being written.
    span: Span,
}

impl<'a> Maker<'a> {
    pub(super) fn new(tree: &'a mut SyntaxTree) -> Self {
        let mut taken: HashSet<String> = tree.suspended.iter().cloned().collect();
        for statement in &tree.statements {
            match &statement.kind {
                StatementKind::Declare(_, list) => taken.extend(list.iter().map(|d| d.name.text.clone())),
                StatementKind::Table(table) => drop(taken.insert(table.name.text.clone())),
                StatementKind::Use(submodel) => drop(taken.insert(submodel.alias.text.clone())),
                _ => {}
            }
        }
        // a name that is not declared is a mistake, which must not get a meaning
        taken.extend(tree.expressions.iter().filter_map(|(e, _)| match e {
            Expr::Name(name) => Some(name.clone()),
            _ => None,
        }));
        Self { tree, taken, span: Span::new(0, 0) }
    }

    /// From now on everything stands here.
    pub(super) fn begin(&mut self, span: Span) {
        self.span = span;
    }

    /// A name for what a block makes of `x`: `lag_stick`, or `lag_1` when `x` has no name.
    pub(super) fn fresh(&mut self, block: &str, x: &Atom) -> String {
        match &x.kind {
            AtomKind::Name(name) if !x.made => {
                let own: String = name.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
                self.fresh_as(&format!("{block}_{}", own.trim_end_matches('_')))
            }
            _ => self.fresh_as(&format!("{block}_1")),
        }
    }

    /// This name, or the next that is free: `lag_stick_2`.
    pub(super) fn fresh_as(&mut self, wanted: &str) -> String {
        let (stem, first) = match wanted.rsplit_once('_').map(|(stem, end)| (stem, end.parse::<u32>())) {
            Some((stem, Ok(k))) => (stem, k),
            _ => (wanted, 1),
        };
        let mut name = wanted.to_string();
        let mut k = first;
        while !self.taken.insert(name.clone()) {
            k += 1;
            name = format!("{stem}_{k}");
        }
        name
    }

    /// An argument that can be written again: one that is neither a number nor a name is given one.
    pub(super) fn atom(&mut self, e: ExprRef, block: &str, role: &str) -> Atom {
        let span = self.tree.span(e);
        let negative = |e: ExprRef| match self.tree.expr(e) {
            Expr::Number(value) => Some(AtomKind::Number(-value)),
            _ => None,
        };
        let kind = match self.tree.expr(e) {
            Expr::Number(value) => Some(AtomKind::Number(*value)),
            Expr::Name(name) => Some(AtomKind::Name(name.clone())),
            Expr::Unary(UnarySign::Minus, a) => negative(*a),
            _ => None,
        };
        let made = kind.is_none();
        let kind = kind.unwrap_or_else(|| {
            let name = self.fresh_as(&format!("{block}_{role}_1"));
            self.declare(Role::Let, &name, Some(e), Made::default(), span);
            AtomKind::Name(name)
        });
        Atom { kind, made, span }
    }

    fn push(&mut self, e: Expr, span: Span) -> ExprRef {
        self.tree.expressions.push((e, span));
        ExprRef(self.tree.expressions.len() as u32 - 1)
    }

    /// An argument once more.
    pub(super) fn put(&mut self, atom: &Atom) -> ExprRef {
        let e = match &atom.kind {
            AtomKind::Name(name) => Expr::Name(name.clone()),
            AtomKind::Number(value) if *value < 0.0 => {
                let positive = self.push(Expr::Number(-value), atom.span);
                Expr::Unary(UnarySign::Minus, positive)
            }
            AtomKind::Number(value) => Expr::Number(*value),
        };
        self.push(e, atom.span)
    }

    pub(super) fn number(&mut self, value: f64) -> ExprRef {
        self.push(Expr::Number(value), self.span)
    }

    pub(super) fn name(&mut self, name: &str) -> ExprRef {
        self.push(Expr::Name(name.into()), self.span)
    }

    /// A name that stands in the text.
    pub(super) fn named(&mut self, name: &Name) -> ExprRef {
        self.push(Expr::Name(name.text.clone()), name.span)
    }

    pub(super) fn binary(&mut self, sign: BinarySign, a: ExprRef, b: ExprRef) -> ExprRef {
        self.push(Expr::Binary(sign, a, b, self.span), self.span)
    }

    pub(super) fn minus(&mut self, a: ExprRef) -> ExprRef {
        self.push(Expr::Unary(UnarySign::Minus, a), self.span)
    }

    pub(super) fn call(&mut self, function: &str, arguments: Vec<ExprRef>) -> ExprRef {
        let name = Name { text: function.into(), span: self.span };
        self.push(Expr::Call(name, arguments), self.span)
    }

    /// Stands where a mistake has been told: a name about which later rooms are silent.
    pub(super) fn silent(&mut self) -> Expr {
        const NAME: &str = "a block";
        if !self.tree.suspended.iter().any(|name| name == NAME) {
            self.tree.suspended.push(NAME.into());
        }
        Expr::Name(NAME.into())
    }

    /// A `let`, and its name.
    pub(super) fn define(&mut self, name: &str, value: ExprRef, made: Made) -> String {
        self.declare(Role::Let, name, Some(value), made, self.span);
        name.into()
    }

    /// A `const` in a unit.
    pub(super) fn constant(&mut self, name: &str, value: ExprRef, unit: &str) {
        let span = self.span;
        let mut declaration = Declaration::new(Name { text: name.into(), span }, span);
        declaration.value = Some(Value::Expr(value));
        declaration.unit = Some(Name { text: unit.into(), span });
        let kind = StatementKind::Declare(Role::Const, vec![declaration]);
        self.tree.statements.push(Statement { kind, span });
    }

    /// A `state`.
    pub(super) fn state(&mut self, name: &str, initial: Option<ExprRef>, made: Made) {
        self.declare(Role::State, name, initial, made, self.span);
    }

    fn declare(&mut self, role: Role, name: &str, value: Option<ExprRef>, made: Made, span: Span) {
        let mut declaration = Declaration::new(Name { text: name.into(), span }, span);
        declaration.value = value.map(Value::Expr);
        declaration.made = Some(made);
        self.tree.statements.push(Statement { kind: StatementKind::Declare(role, vec![declaration]), span });
    }

    /// `der(state) = rate;`
    pub(super) fn equation(&mut self, state: &str, rate: ExprRef) {
        let state = self.name(state);
        let left = self.call("der", vec![state]);
        self.tree.statements.push(Statement { kind: StatementKind::Equation(left, rate), span: self.span });
    }
}
